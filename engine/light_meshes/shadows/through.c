/* Adds refracted paths to the light of straight rays (through.py). */
#include "targets.h"

/* Adds Σ_j α_j of the paths start[k]..start[k+1] to S of receiver rows[k]. With focus each path is multiplied by
   (N·ω_j)/(N·L_i), because Ω contains the cosine of the straight way. */
KERNEL(through_add_paths,
       "rows i64[k]  start i64[e]  alpha f64[c,3]  ends f64[c,3]  light i64  focus i64  P f64[n,3]  N f64[n,3]  "
       "position f64[L,3]  directional bool[L]  S f32[n,L,C]!"
       ";  e=k+1  1<=C<=3  0<=rows<n  0<=start<=c  rising(start)  0<=light<L")
i64 through_add_paths(i64 k, i64 e, i64 c, i64 n, i64 L, i64 C, const i64 *rows, const i64 *start, const f64 *alpha,
                      const f64 *ends, i64 light, i64 focus, const f64 *P, const f64 *N, const f64 *position,
                      const u8 *directional, f32 *S) {
    Targets targets = {position, directional};
    (void)e, (void)c, (void)n;
    for (i64 at = 0; at < k; at++) {
        i64 p = rows[at];
        for (i64 j = start[at]; j < start[at + 1]; j++) {
            f64 share = 1.0;
            if (focus) {
                f64 own = cosine_towards(ends + 3 * j, P + 3 * p, N + 3 * p);
                share = (own > 0.0 ? own : 0.0) / cosine_to(&targets, light, P + 3 * p, N + 3 * p);
            }
            for (i64 channel = 0; channel < C; channel++) {
                f32 *sum = S + (p * L + light) * C + channel;
                *sum = (f32)(*sum + share * alpha[3 * j + channel]);
            }
        }
    }
    return 0;
}
