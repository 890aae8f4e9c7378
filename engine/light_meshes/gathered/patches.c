/* The light that patches gather from other patches (patches.py). */
#include "native.h"

/* Fills what each patch gathers: its links begin..begin+count, each to a patch whose light has a row in `light`. weight:
   of each link, None: all count `even`. */
KERNEL(patches_gather,
       "begin i64[n]  count i64[n]  other i32[q]  weight f32[q,3]?  even f64  light f64[m,3]  out f64[n,3]!")
i64 patches_gather(i64 n, i64 q, i64 m, const i64 *begin, const i64 *count, const i32 *other, const f32 *weight,
                   f64 even, const f64 *light, f64 *out) {
    (void)q, (void)m;
    for (i64 k = 0; k < n; k++) {
        f64 sum[3] = {0};
        for (i64 i = begin[k]; i < begin[k] + count[k]; i++) {
            const f64 *L = light + 3 * (i64)other[i];
            for (int j = 0; j < 3; j++) sum[j] += weight ? weight[3 * i + j] * L[j] : L[j];
        }
        for (int j = 0; j < 3; j++) out[3 * k + j] = even * sum[j];
    }
    return 0;
}
