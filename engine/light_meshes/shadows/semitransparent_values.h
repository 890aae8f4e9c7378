/* The kernel of semitransparent.c that reads node values. It is included once for each type T of the values. */

/* Returns the value of one channel at a node. If its paths are stored separately, their contribution at P is added. */
static f64 NAME(value_at)(const Around *a, const T *value, i64 stride, i64 channel, const f64 *x, const f64 *P,
                          const f64 *N, f64 cosine) {
    f64 sum = value[channel];
    if (stride == a->channels) return sum;
    i64 first = (i64)value[a->channels], last = first + (i64)value[a->channels + 1];
    for (i64 j = first; j < last; j++) {
        f64 share, here = cosine_towards(a->ends + 3 * j, a->focus ? x : P, N);
        if (a->focus) share = (here > 0.0 ? here : 0.0) / cosine;
        else share = here > 0.0 ? 1.0 : 0.0;
        sum += share * a->alpha[3 * j + channel];
    }
    return sum;
}

/* Computes eq. (7) without Ω: S[rows] = (1/m) Σ_l v(x_l,P)·v(i,x_l) over m nodes with v(x_l,P) > 0; smooth: Σ w_l…/Σ
   w_l.

   If paths are stored separately, v(i,x_l) = V + Σ_j α_j·ξ(P_j,P), the end of paper §5. With focus each path has its
   own cosine at P: α_j·(N·ω_j)/(N·L_i), because Ω contains the cosine of the straight way. */
KERNEL(NAME(semitransparent_mean),
       "start i64[n,s]  candidate i32[c]  weight f32[c,C]  kept bool[c]  uniform bool[n]  values " T_NAME "[u,v]  "
       "soft u64[n,W]  ring i64[L]  smooth i64  radius f64[K]  P f64[n,3]  N f64[n,3]  position f64[L,3]  "
       "directional bool[L]  node f64[u,3]  alpha f64[a,3]  ends f64[a,3]  focus i64  m i32[n,K]  rows i64[n]  "
       "S f32[r,L,C]!"
       ";  1<=C<=3  s=K+1  W=words(L)  v=L*C|v=L*C+2*L  0<=ring<K  0<=rows<r;  0<=candidate<u  0<=start<=c  "
       "rising(start)")
i64 NAME(semitransparent_mean)(i64 n, i64 s, i64 c, i64 C, i64 u, i64 v, i64 W, i64 L, i64 K, i64 a, i64 r, const i64 *start,
                       const i32 *candidate, const f32 *weight, const u8 *kept, const u8 *uniform, const T *values,
                       const u64 *soft, const i64 *ring, i64 smooth, const f64 *radius, const f64 *P, const f64 *N,
                       const f64 *position, const u8 *directional, const f64 *node, const f64 *alpha, const f64 *ends,
                       i64 focus, const i32 *m, const i64 *rows, f32 *S) {
    Targets targets = {position, directional};
    Around around = {C, focus, alpha, ends};
    i64 stride = L ? v / L : 0;
    (void)c, (void)u, (void)a, (void)r;
    for (i64 p = 0; p < n; p++) {
        const f64 *here = P + 3 * p, *normal = N + 3 * p;
        i64 first = start[p * s];
        for (i64 i = 0; i < L; i++) {
            i64 size = m[p * K + ring[i]];
            if (!size || !has(soft + p * W, i)) continue;
            /* uniform: all have the value of the first */
            i64 last = uniform[p] ? first + 1 : start[p * s + ring[i] + 1];
            f64 cosine = cosine_to(&targets, i, here, normal), reach = radius[ring[i]] * radius[ring[i]];
            for (i64 k = 0; k < C; k++) {
                f64 total = 0.0, all = 0.0, base = 0.0;
                for (i64 at = first; at < last; at++) {
                    const T *value = values + candidate[at] * v + i * stride;
                    const f64 *x = node + 3 * (i64)candidate[at];
                    f64 share = uniform[p] ? 1.0 : weight[at * C + k];
                    f64 seen = NAME(value_at)(&around, value, stride, k, x, here, normal, cosine);
                    if (!smooth) {
                        total += share * seen;
                        continue;
                    }
                    if (!uniform[p] && !kept[at]) continue;
                    seen *= share;
                    if (all == 0.0) base = seen;
                    f64 w = falloff(squared_distance(x, here) / reach);
                    all += w;
                    total += w * (seen - base);  /* exactly 0 if all agree */
                }
                S[(rows[p] * L + i) * C + k] = (f32)(smooth ? base + total / all : total / (f64)size);
            }
        }
    }
    return 0;
}
