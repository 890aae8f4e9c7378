/* Ψ where surfaces let light through: eq. (7) (semitransparent.py). */
#include "meshes/averaging.h"
#include "targets.h"

/* How node values are read: the channels for each light, and the refracted paths of all nodes if they are stored
   separately. */
typedef struct {
    i64 channels, focus;
    const f64 *alpha, *ends;
} Around;

#define T f32
#define T_NAME "f32"
#define NAME(kernel) kernel
#include "semitransparent_values.h"
#undef T
#undef T_NAME
#undef NAME
#define T f64  /* if paths are stored separately, because their row numbers need more digits */
#define T_NAME "f64"
#define NAME(kernel) kernel##_apart
#include "semitransparent_values.h"

/* Marks receivers whose candidates all have the same values, for the soft lights that count them. */
KERNEL(semitransparent_uniform,
       "start i64[n,s]  candidate i32[c]  values f32[u,v]  soft u64[n,W]  ring i64[L]  channels i64  uniform bool[n]!"
       ";  0<channels  v<=L*channels  W=words(L)  0<=ring<s-1;  0<=candidate<u  0<=start<=c  rising(start)")
i64 semitransparent_uniform(i64 n, i64 s, i64 c, i64 u, i64 v, i64 W, i64 L, const i64 *start, const i32 *candidate,
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
