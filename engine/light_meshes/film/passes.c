/* Sums over the rays of a tile (passes.py). */
#include "native.h"

/* Adds weight·colour to samples[pixel], beginning at column `first`. If several rays belong to one pixel, they are
   added in their order. */
KERNEL(passes_add, "samples f64[s,q]!  first i64  pixel i64[n]  weight f64[n,c]  colour f64[n,c]")
i64 passes_add(i64 s, i64 q, i64 n, i64 c, f64 *samples, i64 first, const i64 *pixel, const f64 *weight, const f64 *colour) {
    (void)s;
    for (i64 k = 0; k < n; k++)
        for (i64 j = 0; j < c; j++) samples[pixel[k] * q + first + j] += weight[k * c + j] * colour[k * c + j];
    return 0;
}
