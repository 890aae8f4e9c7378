/* Logarithm, exponential and arc cosine that compilers make vectors of: no branches, no calls. Errors below 1e-9 of the
   result (acos 2e-8); the same bits on all processors. */
#pragma once
#include "native.h"

/* ln x of a normal number x > 0. */
static inline f64 fast_log(f64 x) {
    u64 bits;
    memcpy(&bits, &x, sizeof bits);
    u64 high = (bits >> 52) | 0x4330000000000000u;  /* the exponent, as the last bits of 2^52 */
    u64 low = (bits & 0x000FFFFFFFFFFFFFu) | 0x3FF0000000000000u;
    f64 exponent, m;
    memcpy(&exponent, &high, sizeof exponent), memcpy(&m, &low, sizeof m);
    exponent -= 0x1p52 + 1023.0;
    f64 over = m > 1.4142135623730951 ? 1.0 : 0.0;
    m *= 1.0 - 0.5 * over, exponent += over;
    f64 s = (m - 1.0) / (m + 1.0), t = s * s;
    f64 sum = 1.0 + t * (1.0 / 3 + t * (1.0 / 5 + t * (1.0 / 7 + t * (1.0 / 9 + t * (1.0 / 11 + t * (1.0 / 13))))));
    return exponent * 0.6931471805599453 + 2.0 * s * sum;
}

/* exp(-x) for x >= 0; 0 beyond 700. */
static inline f64 fast_exp_minus(f64 x) {
    f64 y = (x < 700.0 ? x : 700.0) * -1.4426950408889634, shifted = y + 0x1.8p52;
    u64 bits;
    memcpy(&bits, &shifted, sizeof bits);  /* y, rounded, in its last bits */
    f64 r = (y - (shifted - 0x1.8p52)) * 0.6931471805599453;
    f64 power = 1.0 + r * (1.0 + r * (1.0 / 2 + r * (1.0 / 6 + r * (1.0 / 24 + r * (1.0 / 120 + r * (1.0 / 720 + r * (1.0 / 5040 + r * (1.0 / 40320))))))));
    u64 scale = (bits + 1023u) << 52;
    f64 two;
    memcpy(&two, &scale, sizeof two);
    return x < 700.0 ? power * two : 0.0;
}

/* acos x over sqrt(1 - x), for 0 <= x <= 1 (Abramowitz and Stegun 4.4.46). */
static inline f64 acos_over(f64 x) {
    return 1.5707963050 + x * (-0.2145988016 + x * (0.0889789874 + x * (-0.0501743046 + x * (0.0308918810 + x * (
           -0.0170881256 + x * (0.0066700901 + x * -0.0012624911))))));
}

/* cos x for |x| <= pi. */
static inline f64 fast_cos(f64 x) {
    f64 h = 0.5 * x, t = h * h;  /* 1 - 2·sin² of half the angle, which is at most pi/2 */
    f64 s = h * (1.0 + t * (-1.0 / 6 + t * (1.0 / 120 + t * (-1.0 / 5040 + t * (1.0 / 362880 + t * (-1.0 / 39916800 + t * (1.0 / 6227020800.0)))))));
    return 1.0 - 2.0 * s * s;
}
