/* Looks up what air scatters (atmosphere.py). */
#include "native.h"

/* Sets out to the sum of tables, each times its phase function, between the entries at column x and row y. */
KERNEL(atmosphere_look, "tables f64[k,r,a,3]  x f64[n]  y f64[n]  phases f64[k,n]  out f64[n,3]!"
       ";  2<=r  2<=a")
i64 atmosphere_look(i64 k, i64 r, i64 a, i64 n, const f64 *tables, const f64 *x, const f64 *y, const f64 *phases,
                    f64 *out) {
    for (i64 p = 0; p < n; p++) {
        i64 i = x[p] >= (f64)(a - 2) ? a - 2 : x[p] > 0.0 ? (i64)x[p] : 0;
        i64 j = y[p] >= (f64)(r - 2) ? r - 2 : y[p] > 0.0 ? (i64)y[p] : 0;
        f64 fx = fmin(fmax(x[p] - (f64)i, 0.0), 1.0), fy = fmin(fmax(y[p] - (f64)j, 0.0), 1.0);
        f64 *own = out + 3 * p;
        own[0] = own[1] = own[2] = 0.0;
        for (i64 t = 0; t < k; t++) {
            const f64 *here = tables + 3 * ((t * r + j) * a + i), *above = here + 3 * a;
            for (int c = 0; c < 3; c++)
                own[c] += phases[t * n + p] * ((here[c] * (1.0 - fx) + here[3 + c] * fx) * (1.0 - fy)
                                               + (above[c] * (1.0 - fx) + above[3 + c] * fx) * fy);
        }
    }
    return 0;
}
