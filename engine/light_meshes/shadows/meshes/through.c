/* Ψ where surfaces let light through: eq. (7), and refracted paths (semitransparent.py). */
#include "../targets.h"
#include "averaging.h"

/* How node values are read: channels a light, and the refracted paths of all nodes where they are kept apart. */
typedef struct {
    i64 channels, focus;
    const f64 *alpha, *ends;
} Around;

#define T f32
#define T_NAME "f32"
#define NAME(kernel) kernel
#include "through_values.h"
#undef T
#undef T_NAME
#undef NAME
#define T f64  /* with the paths apart, whose rows need more digits */
#define T_NAME "f64"
#define NAME(kernel) kernel##_apart
#include "through_values.h"

/* Marks receivers all of whose candidates have the same values, for the soft lights that count them. */
KERNEL(through_uniform,
       "start i64[n,s]  candidate i32[c]  values f32[u,v]  soft u64[n,W]  ring i64[L]  channels i64  uniform bool[n]!")
i64 through_uniform(i64 n, i64 s, i64 c, i64 u, i64 v, i64 W, i64 L, const i64 *start, const i32 *candidate,
                    const f32 *values, const u64 *soft, const i64 *ring, i64 channels, u8 *uniform) {
    (void)c, (void)u, (void)L;
    for (i64 p = 0; p < n; p++) {
        i64 begin = start[p * s];
        int agree = 1, any_soft = 0;
        for (i64 i = 0; i < v / channels; i++) {
            i64 end = start[p * s + ring[i] + 1];
            if (end == begin || !has(soft + p * W, i)) continue;
            any_soft = 1;
            for (i64 k = i * channels; k < (i + 1) * channels; k++) {
                f32 first = values[candidate[begin] * v + k];
                for (i64 at = begin + 1; agree && at < end; at++) agree = values[candidate[at] * v + k] == first;
            }
        }
        uniform[p] = agree && any_soft;
    }
    return 0;
}

/* S += Σ_j α_j of the paths start[k]..start[k+1] of receiver rows[k]; with focus times (N·ω_j)/(N·L_i), as Ω has the
   cosine of the straight way. */
KERNEL(through_add_paths,
       "rows i64[k]  start i64[e]  alpha f64[c,3]  ends f64[c,3]  light i64  focus i64  P f64[n,3]  N f64[n,3]  "
       "position f64[L,3]  directional bool[L]  S f32[n,L,C]!")
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
