/* Places points on lamps with a size (area_sampling.py). */
#include "targets.h"

/* Returns a uniform number in [0,1) from 64 bits (SplitMix64's finaliser). */
static f64 random_of(u64 x) {
    x = (x ^ x >> 30) * MIX;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    x ^= x >> 31;
    return (f64)(x >> 11) * 0x1p-53;
}

/* Computes point s of `samples` on the light of each pair: strata of equal area in one axis, van der Corput's order
   in the other. The pattern of each pair is rotated at random; the random number depends only on its position, so
   the result is the same for any tiles, threads and order. free: the light is a sphere or a sun, which the receiver
   sees as a disc of radius `size`; rectangle: a rectangle, otherwise an ellipse. u, v: half-axes. */
KERNEL(area_sample,
       "s i64  samples i64  seed u64  P f64[n,3]  row i32[k]  position f64[L,3]  directional bool[L]  light i32[k]  "
       "free bool[L]  rectangle bool[L]  size f64[L]  u f64[L,3]  v f64[L,3]  out f64[k,3]!"
       ";  0<=s  0<samples  0<=row<n  0<=light<L")
i64 area_sample(i64 n, i64 k, i64 L, i64 s, i64 samples, u64 seed, const f64 *P, const i32 *row, const f64 *position,
                const u8 *directional, const i32 *light, const u8 *free, const u8 *rectangle, const f64 *size,
                const f64 *u, const f64 *v, f64 *out) {
    f64 inverse = 0.0, digit = 0.5;
    (void)n, (void)L;
    for (i64 rest = s; rest; rest >>= 1, digit *= 0.5) inverse += digit * (f64)(rest & 1);
    for (i64 at = 0; at < k; at++) {
        i64 i = light[at];
        const f64 *from = P + 3 * (i64)row[at], *c = position + 3 * i, *a_axis = u + 3 * i, *b_axis = v + 3 * i;
        f64 *point = out + 3 * at;
        u64 key = seed + (u64)i * 0x9E3779B97F4A7C15u, bits;
        for (int j = 0; j < 3; j++) {
            memcpy(&bits, from + j, sizeof bits);
            key = (key ^ bits) * 0xD6E8FEB86659FD93u;
            key ^= key >> 32;
        }
        f64 a = ((f64)s + random_of(key + (u64)s * 2)) / (f64)samples;
        f64 b = fmod(inverse + random_of(key ^ 0xA0761D6478BD642Fu), 1.0);
        if (rectangle[i]) {
            for (int j = 0; j < 3; j++) point[j] = c[j] + (2.0 * a - 1.0) * a_axis[j] + (2.0 * b - 1.0) * b_axis[j];
            continue;
        }
        f64 x = sqrt(a) * cos(2 * PI * b), y = sqrt(a) * sin(2 * PI * b);
        if (!free[i]) {
            for (int j = 0; j < 3; j++) point[j] = c[j] + x * a_axis[j] + y * b_axis[j];
            continue;
        }
        /* The disc that the receiver sees of a sphere (or of the sun). */
        f64 d[3] = {c[0], c[1], c[2]};
        if (!directional[i]) {
            for (int j = 0; j < 3; j++) d[j] = c[j] - from[j];
            f64 length = sqrt(dot(d, d));
            for (int j = 0; j < 3; j++) d[j] /= length;
        }
        f64 sign = d[2] >= 0.0 ? 1.0 : -1.0, f = -1.0 / (sign + d[2]), g = d[0] * d[1] * f;
        x = x * size[i], y = y * size[i];
        point[0] = c[0] + x * (1.0 + sign * d[0] * d[0] * f) + y * g;
        point[1] = c[1] + x * sign * g + y * (sign + d[1] * d[1] * f);
        point[2] = c[2] - x * sign * d[0] - y * d[1];
    }
    return 0;
}
