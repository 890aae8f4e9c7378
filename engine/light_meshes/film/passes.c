/* Sums over the rays of a tile (passes.py). */
#include "native.h"

/* Adds weight·colour to samples[pixel], beginning at column `first`; colour has a row for each ray, or one for all. If
   several rays belong to one pixel, they are added in their order. */
KERNEL(passes_add, "samples f64[s,q]!  first i64  pixel i64[n]  weight f64[n,c]  colour f64[m,c]"
       ";  m=n|m=1  0<=first  first+c<=q  0<=pixel<s")
i64 passes_add(i64 s, i64 q, i64 n, i64 c, i64 m, f64 *samples, i64 first, const i64 *pixel, const f64 *weight,
               const f64 *colour) {
    (void)s;
    for (i64 k = 0; k < n; k++) {
        const f64 *own = colour + (m == 1 ? 0 : k * c);
        for (i64 j = 0; j < c; j++) samples[pixel[k] * q + first + j] += weight[k * c + j] * own[j];
    }
    return 0;
}

/* The means of the samples of each pixel, added in order. */
KERNEL(passes_means, "samples f64[s,q]  means f64[p,q]!"
       ";  p<=s")
i64 passes_means(i64 s, i64 q, i64 p, const f64 *samples, f64 *means) {
    i64 count = p ? s / p : 0;
    for (i64 k = 0; k < p; k++)
        for (i64 j = 0; j < q; j++) {
            const f64 *from = samples + k * count * q + j;
            f64 total = from[0];
            for (i64 i = 1; i < count; i++) total += from[i * q];
            means[k * q + j] = total / (f64)count;
        }
    return 0;
}
