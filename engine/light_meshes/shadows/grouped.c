/* Groups of lamps whose shadows one of them stands for, receiver by receiver (grouped.py). */
#include <stdlib.h>

#include "native.h"

/* SplitMix64's finaliser. */
static u64 mixed(u64 x) {
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    return x ^ x >> 31;
}

typedef struct {
    i64 leaves;         /* a power of two; leaf j is node leaves + j of the tree, whose root is 1 */
    const i32 *order;   /* the lamp of each leaf, −1: none */
    const u8 *together; /* whether all lamps of a node may be in one group */
    f64 *sum;           /* of e, of each node */
    i32 *group;         /* (L,) */
} Tree;

/* Lets one lamp below a node stand for all: each is as likely as its e is large, by the number u in [0,1). Returns the
   e of the others. */
static f64 choose(const Tree *t, i64 node, f64 u, i64 *chosen) {
    i64 first = node, last = node;
    f64 left = u * t->sum[node];
    for (i64 at = node; at < t->leaves;) {
        at *= 2;
        if (left >= t->sum[at] && t->sum[at + 1] > 0.0) left -= t->sum[at], at++;
        else if (!(t->sum[at] > 0.0)) at++;
        *chosen = at;
    }
    while (first < t->leaves) first *= 2, last = 2 * last + 1;
    for (i64 leaf = first; leaf <= last; leaf++)
        if (t->sum[leaf] > 0.0) t->group[t->order[leaf - t->leaves]] = t->order[*chosen - t->leaves];
    return t->sum[node] - t->sum[*chosen];
}

/* For each receiver the largest nodes of the tree of lamps that may be together and together give it at most the share
   `threshold` of the light e (n,L) that it returns are groups. group (n,L): the lamp that stands for each lamp, −1 where it is not active;
   asked: of active, those that stand for some; several: those of them that stand for more than themselves; weight: e, and
   of the latter that of their groups; bound (n,): the sum of e of the lamps that others stand for. */
KERNEL(lamp_groups,
       "P f64[n,3]  active u64[n,W]  e f32[n,L]  threshold f64  order i32[l]  together bool[m]  group i32[n,L]!  "
       "asked u64[n,W]!  several u64[n,W]!  weight f32[n,L]!  bound f64[n]!"
       ";  W=words(L)  m=2*l  power(l)  -1<=order<L")
i64 lamp_groups(i64 n, i64 W, i64 L, i64 l, i64 m, const f64 *P, const u64 *active, const f32 *e, f64 threshold,
                const i32 *order, const u8 *together, i32 *group, u64 *asked, u64 *several, f32 *weight, f64 *bound) {
    f64 *sum = malloc((size_t)(2 * l) * sizeof *sum);
    i64 *stack = malloc(128 * sizeof *stack);
    if (!sum || !stack || m != 2 * l) {
        free(sum), free(stack);
        return 1;
    }
    memset(asked, 0, (size_t)(n * W) * sizeof *asked), memset(several, 0, (size_t)(n * W) * sizeof *several);
    memcpy(weight, e, (size_t)(n * L) * sizeof *weight);
    for (i64 p = 0; p < n; p++) {
        Tree t = {l, order, together, sum, group + p * L};
        u64 key = 0x9E3779B97F4A7C15u, bits;
        for (int j = 0; j < 3; j++) memcpy(&bits, P + 3 * p + j, sizeof bits), key = mixed(key ^ bits);
        for (i64 i = 0; i < L; i++) {  /* those that give nothing here are no group */
            int alone = has(active + p * W, i) && !(e[p * L + i] > 0.0f);
            t.group[i] = alone ? (i32)i : -1;
            if (alone) asked[p * W + (i >> 6)] |= bit(i);
        }
        for (i64 j = 0; j < l; j++) {
            i64 i = order[j];
            sum[l + j] = i >= 0 && has(active + p * W, i) && e[p * L + i] > 0.0f ? (f64)e[p * L + i] : 0.0;
        }
        for (i64 j = l - 1; j > 0; j--) sum[j] = sum[2 * j] + sum[2 * j + 1];
        f64 most = threshold * sum[1];
        i64 depth = 0;
        bound[p] = 0.0;
        for (stack[depth++] = 1; depth;) {
            i64 node = stack[--depth], chosen = node;
            if (!(sum[node] > 0.0)) continue;
            if (node < l && !(together[node] && sum[node] <= most)) {
                stack[depth++] = 2 * node, stack[depth++] = 2 * node + 1;
                continue;
            }
            f64 others = choose(&t, node, (f64)(mixed(key + (u64)node) >> 11) * 0x1p-53, &chosen);
            i64 lamp = order[chosen - l];
            asked[p * W + (lamp >> 6)] |= bit(lamp);
            bound[p] += others;
            if (others > 0.0) several[p * W + (lamp >> 6)] |= bit(lamp), weight[p * L + lamp] = (f32)sum[node];
        }
    }
    free(sum), free(stack);
    return 0;
}

/* S of each lamp becomes that of the lamp that stands for it. */
KERNEL(lamp_groups_spread, "group i32[n,L]  S f32[n,L,C]!"
       ";  -1<=group<L")
i64 lamp_groups_spread(i64 n, i64 L, i64 C, const i32 *group, f32 *S) {
    for (i64 p = 0; p < n; p++)
        for (i64 i = 0; i < L; i++) {
            i64 from = group[p * L + i];
            if (from >= 0 && from != i)
                for (i64 c = 0; c < C; c++) S[(p * L + i) * C + c] = S[(p * L + from) * C + c];
        }
    return 0;
}
