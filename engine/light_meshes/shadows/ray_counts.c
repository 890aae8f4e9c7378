/* How many rays go from a receiver to each of many lamps (ray_counts.py). */
#include "native.h"

enum { COUNTS = 8 };

/* out (n,L): 0 where a lamp is not active; else the largest of `counts`, in ascending order, that mean·(e/ē)^.8·(shown·Σe)^.8
   reaches, or the least. e: what of the lamp's light the receiver returns, from light_each; ē: its mean over the lamps,
   weighed by e; shown (n,): 0 is that the last factor is 1. */
KERNEL(lamp_ray_counts,
       "active u64[n,W]  e f32[n,L]  shown f64[n]  mean f64  counts f64[q]  out u8[n,L]!"
       ";  W=words(L)  1<=q<=8")
i64 lamp_ray_counts(i64 n, i64 W, i64 L, i64 q, const u64 *active, const f32 *e, const f64 *shown, f64 mean,
                    const f64 *counts, u8 *out) {
    if (q > COUNTS) return 1;
    for (i64 p = 0; p < n; p++) {
        const f32 *mine = e + p * L;
        const u64 *on = active + p * W;
        f64 sum = 0.0, squares = 0.0, least[COUNTS] = {0.0};
        memset(out + p * L, 0, (size_t)L);
        for (i64 w = 0; w < W; w++) /* of thousands of lamps few are active */
            for (u64 bits = on[w]; bits; bits &= bits - 1) {
                i64 i = 64 * w + __builtin_ctzll(bits);
                if (i < L) sum += mine[i], squares += (f64)mine[i] * mine[i];
            }
        for (i64 k = 1; k < q && sum > 0.0; k++)
            least[k] = squares / sum * pow(counts[k] / mean, 1.25) / (shown[p] > 0.0 ? shown[p] * sum : 1.0);
        for (i64 w = 0; w < W; w++)
            for (u64 bits = on[w]; bits; bits &= bits - 1) {
                i64 i = 64 * w + __builtin_ctzll(bits);
                u8 count = (u8)counts[0];
                for (i64 k = 1; i < L && count && k < q; k++)
                    if (mine[i] >= least[k]) count = (u8)counts[k];
                if (i < L) out[p * L + i] = count;
            }
    }
    return 0;
}
