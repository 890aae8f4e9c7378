/* Steps 4 and 5 of Ψ for a batch of receivers (averaging.py explains start, serve, ring and m). */
#include <stdlib.h>

#include "averaging.h"

#define INLINE static inline __attribute__((always_inline))

KERNEL(psi_ask, "start i64[n,s]  candidate i32[c]  soft u64[n,W]  serve u64[K,W]  need u64[u,W]!"
       ";  s=K+1;  0<=candidate<u  0<=start<=c  rising(start)")
i64 psi_ask(i64 n, i64 s, i64 c, i64 W, i64 K, i64 u, const i64 *start, const i32 *candidate, const u64 *soft,
            const u64 *serve, u64 *need) {
    (void)c, (void)u;
    for (i64 p = 0; p < n; p++) ask_for(start + p * s, candidate, soft + p * W, serve, K, W, need);
    return 0;
}

/* Returns whether all candidates of a receiver agree, for every soft light that counts them. */
static int agree(const i64 *start, const i32 *candidate, const u64 *values, const u64 *soft, const u64 *serve, i64 K,
                 i64 W) {
    int any_soft = 0;
    if (start[K] == start[0]) return 0;
    for (i64 w = 0; w < W; w++)
        for (i64 g = 0; g < K; g++) {
            u64 lights = soft[w] & serve[g * W + w];
            if (!lights || start[g + 1] == start[g]) continue;
            any_soft = 1;
            /* The first candidate is in the innermost ring that is not empty; all lights with a set count this ring. */
            u64 first = values[candidate[start[0]] * W + w] & lights;
            for (i64 at = start[g]; at < start[g + 1]; at++)
                if ((values[candidate[at] * W + w] & lights) != first) return 0;
        }
    return any_soft;
}

/* Keeps the mark `holds` of receivers P that are lifted above the plane of their facet, through foot with normal `up`,
   only where their rays start as far above it as those of other receivers: half of `margin`. Rays start by so much along
   N. */
KERNEL(psi_free_start, "P f64[n,3]  N f64[n,3]  foot f64[n,3]  up f64[n,3]  margin f64  holds bool[n]!")
i64 psi_free_start(i64 n, const f64 *P, const f64 *N, const f64 *foot, const f64 *up, f64 margin, u8 *holds) {
    for (i64 p = 0; p < n; p++) {
        f64 above = 0.0;
        for (i64 j = 3 * p; j < 3 * p + 3; j++) above += (P[j] - foot[j] + 0.5 * margin * N[j]) * up[j];
        holds[p] &= above >= 0.5 * margin;
    }
    return 0;
}

/* Marks a receiver's candidates from `first` to `last` as seen that are more than `margin` above the plane through P with
   normal N. Returns how many. */
static i64 certify(const f64 *P, const f64 *N, const i32 *candidate, i64 first, i64 last, const f64 *position, f64 margin,
                   u8 *seen) {
    i64 count = 0;
    for (i64 at = first; at < last; at++) {
        const f64 *x = position + 3 * (i64)candidate[at];
        f64 above = (x[0] - P[0]) * N[0] + (x[1] - P[1]) * N[1] + (x[2] - P[2]) * N[2];
        seen[at] = above > margin;
        count += seen[at];
    }
    return count;
}

/* Finds out which short rays are not needed. Marks receivers as uniform whose candidates all have the same values; without
   values, `uniform` says which they are. Marks candidates of receivers with a certificate, `holds`, as seen: of a uniform
   receiver only the first, because no more are needed. foot, up: the planes of their facets. end: of the candidates that need
   a ray first, of uniform receivers one, of others none. counts: receivers with a certificate, and candidates that are
   seen. */
KERNEL(psi_spare,
       "start i64[n,s]  candidate i32[c]  values u64[u,W]?  soft u64[n,W]  serve u64[K,W]  holds bool[n]?  foot f64[n,3]?  "
       "up f64[n,3]?  position f64[v,3]  margin f64  uniform bool[n]!  seen bool[c]!  end i64[n]!  counts i64[2]!"
       ";  s=K+1  u=0|u=v;  0<=candidate<v  0<=start<=c  rising(start)")
i64 psi_spare(i64 n, i64 s, i64 c, i64 u, i64 W, i64 K, i64 v, const i64 *start, const i32 *candidate, const u64 *values,
              const u64 *soft, const u64 *serve, const u8 *holds, const f64 *foot, const f64 *up, const f64 *position,
              f64 margin, u8 *uniform, u8 *seen, i64 *end, i64 *counts) {
    (void)u, (void)v;
    memset(seen, 0, (size_t)c * sizeof *seen);
    counts[0] = counts[1] = 0;
    for (i64 p = 0; p < n; p++) {
        const i64 *begin = start + p * s;
        if (values) uniform[p] = (u8)agree(begin, candidate, values, soft + p * W, serve, K, W);
        end[p] = *begin + uniform[p];
        if (!holds || !holds[p]) continue;
        counts[0]++;
        counts[1] += certify(foot + 3 * p, up + 3 * p, candidate, *begin, uniform[p] ? end[p] : begin[K], position, margin, seen);
    }
    return 0;
}

/* Returns the end of the candidates of a receiver that need a short ray. */
static i64 end_of(const i64 *start, const u64 *soft, const u64 *serve, i64 K, i64 W) {
    for (i64 g = K - 1; g >= 0; g--)
        for (i64 w = 0; w < W; w++)
            if (soft[w] & serve[g * W + w]) return start[g + 1];
    return start[0];
}

/* Lists (receiver, index into candidate) of every short ray that is needed; candidates that are `seen` need none.
   Returns how many; if row and index are None it only counts. */
KERNEL(psi_listed,
       "start i64[n,s]  soft u64[n,W]  serve u64[K,W]  uniform bool[n]  seen bool[c]  row i32[r]?!  index i64[r]?!"
       ";  s=K+1;  0<=start<=c  rising(start)")
i64 psi_listed(i64 n, i64 s, i64 W, i64 K, i64 c, i64 r, const i64 *start, const u64 *soft, const u64 *serve,
               const u8 *uniform, const u8 *seen, i32 *row, i64 *index) {
    i64 count = 0;
    (void)c;
    for (i64 p = 0; p < n; p++) {
        if (uniform[p]) continue;
        i64 last = end_of(start + p * s, soft + p * W, serve, K, W);
        for (i64 at = start[p * s]; at < last; at++) {
            if (seen[at]) continue;
            if (row && count == r) return OUTSIDE;
            if (row) row[count] = (i32)p, index[count] = at;
            count++;
        }
    }
    return count;
}

/* Keeps the mark `uniform` only where the first candidate is seen. Fills end with that of the candidates that need a short
   ray then; returns how many receivers are uniform. */
KERNEL(psi_ends, "start i64[n,s]  soft u64[n,W]  serve u64[K,W]  seen bool[c]  uniform bool[n]!  end i64[n]!"
       ";  s=K+1;  0<=start<=c  rising(start)")
i64 psi_ends(i64 n, i64 s, i64 W, i64 K, i64 c, const i64 *start, const u64 *soft, const u64 *serve, const u8 *seen,
             u8 *uniform, i64 *end) {
    i64 count = 0;
    (void)c;
    for (i64 p = 0; p < n; p++) {
        const i64 *begin = start + p * s;
        uniform[p] = uniform[p] && seen[*begin];
        end[p] = uniform[p] ? *begin : end_of(begin, soft + p * W, serve, K, W);
        count += uniform[p];
    }
    return count;
}

/* Fills answered with the soft lights of a receiver whose set is not empty: if the smallest ball that has a node belongs to
   class k, the lights of all classes from k on have a set. Returns whether a soft light has none. */
static int answer_of(const i32 *m, i64 K, i64 W, const u64 *soft, const u64 *serve, u64 *answered) {
    i64 k = 0;
    u64 left = 0;
    while (k < K && m[k] <= 0) k++;
    for (i64 w = 0; w < W; w++) {
        answered[w] = k < K ? soft[w] & serve[k * W + w] : 0;
        left |= soft[w] & ~answered[w];
    }
    return left != 0;
}

/* The same for many; empty: whether a soft light has no set; returns how many receivers have one. */
KERNEL(psi_answered, "m i32[n,K]  soft u64[n,W]  serve u64[K,W]  answered u64[n,W]!  empty bool[n]!")
i64 psi_answered(i64 n, i64 K, i64 W, const i32 *m, const u64 *soft, const u64 *serve, u64 *answered, u8 *empty) {
    i64 count = 0;
    for (i64 p = 0; p < n; p++) {
        empty[p] = (u8)answer_of(m + p * K, K, W, soft + p * W, serve, answered + p * W);
        count += empty[p];
    }
    return count;
}

/* Fills m of a receiver: how many nodes step 3 keeps in the ball of each class. */
static void size_of(const i64 *begin, i64 K, const u8 *kept, int uniform, i32 *m) {
    i64 total = 0;
    for (i64 g = 0; g < K; g++) {
        if (uniform)  /* all agree, and the first is seen: every m gives the same quotients */
            total = begin[g + 1] > begin[0];
        else
            for (i64 at = begin[g]; at < begin[g + 1]; at++) total += kept[at];
        m[g] = (i32)total;
    }
}

KERNEL(psi_sizes, "start i64[n,s]  kept bool[c]  uniform bool[n]  m i32[n,K]!"
       ";  s=K+1;  0<=start<=c  rising(start)")
i64 psi_sizes(i64 n, i64 s, i64 c, i64 K, const i64 *start, const u8 *kept, const u8 *uniform, i32 *m) {
    (void)c;
    for (i64 p = 0; p < n; p++) size_of(start + p * s, K, kept, uniform[p], m + p * K);
    return 0;
}

/* Sets the bits of `count` numbers, which are 0 there, to those of 1 for each light that is in `lights`. */
INLINE void set_ones(u64 lights, i64 count, f32 *S) {
    u32 number[64], half[2] = {(u32)lights, (u32)(lights >> 32)};
    memcpy(number, S, (size_t)count * sizeof *number);
    for (i64 i = 0; i < count; i++) number[i] |= (half[i >> 5] >> (i & 31) & 1) * 0x3F800000u;
    memcpy(S, number, (size_t)count * sizeof *number);
}

/* Sets S (L) to 1 for each light of word w that is in `lights`, for which it is 0, without a branch. */
static void spread(u64 lights, i64 w, i64 L, f32 *S) {
    if (L - 64 * w >= 64) set_ones(lights, 64, S + 64 * w);
    else set_ones(lights, L - 64 * w, S + 64 * w);
}

enum { QUOTIENTS = 64, MANY = 6 };  /* nodes of which quotients stand ready; lights that are counted together */

typedef u8 Bytes __attribute__((vector_size(32)));

/* Adds `number of words of column in which the light's bit is set`/count to S for each of the first lights of a word that
   is in `lights`. All 64 are counted together, a byte each. quotient: by that number. */
static void add_shares(const u64 *column, i64 count, u64 lights, i64 left, const f32 *quotient, f32 *S) {
    static const Bytes BITS = {1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128,
                               1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128};
    typedef u64 Words __attribute__((vector_size(32)));
    Bytes low = {0}, high = {0};
    u8 number[64];
    for (i64 k = 0; k < count; k++) {
        u64 word = column[k] & lights;
        Bytes four = (Bytes)(Words){word, word, word, word};
        Bytes a = __builtin_shufflevector(four, four, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1,
                                          18, 18, 18, 18, 18, 18, 18, 18, 19, 19, 19, 19, 19, 19, 19, 19);
        Bytes b = __builtin_shufflevector(four, four, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 5, 5, 5, 5, 5,
                                          22, 22, 22, 22, 22, 22, 22, 22, 23, 23, 23, 23, 23, 23, 23, 23);
        low -= (Bytes)((a & BITS) == BITS), high -= (Bytes)((b & BITS) == BITS);
    }
    memcpy(number, &low, sizeof low), memcpy(number + 32, &high, sizeof high);
    if (left >= 64)
        for (int i = 0; i < 64; i++) S[i] += quotient[number[i]];
    else
        for (int i = 0; i < left; i++) S[i] += quotient[number[i]];
}

/* Receivers, their candidates and what is known of them (averaging.py). */
typedef struct {
    i64 s, W, K, L;
    const i64 *start;
    const i32 *candidate, *m;
    const u8 *kept, *uniform;
    const u64 *values, *soft, *serve, *own;
    const i64 *ring;
    const f64 *radius, *P, *position;
} Near;

/* The memory that the means of receivers use one after the other. */
typedef struct {
    u64 *column;
    f32 quotient[QUOTIENTS][QUOTIENTS];
    i64 *lights, *ends;  /* the lights whose sums are needed; those of word w end at ends[w+1] */
    f64 *seen;
    u64 *every, *some;
} Scratch;

/* Returns whether there is memory for it. */
static int scratch_for(Scratch *t, const Near *near, i64 n) {
    i64 most = 1;
    for (i64 p = 0; p < n; p++) {
        i64 all = near->start[p * near->s + near->K] - near->start[p * near->s];
        most = all > most ? all : most;
    }
    t->column = malloc((size_t)most * sizeof *t->column);
    t->lights = malloc((size_t)(near->L + near->W + 1) * sizeof *t->lights), t->ends = t->lights + near->L;
    t->seen = malloc((size_t)(near->L + 1) * sizeof *t->seen);
    t->every = malloc((size_t)(2 * near->W + 1) * sizeof *t->every), t->some = t->every + near->W;
    for (int of = 1; of < QUOTIENTS; of++)
        for (int number = 0; number <= of; number++) t->quotient[of][number] = (f32)((f64)number / of);
    return t->column && t->lights && t->seen && t->every;
}

/* Adds to S (L) of receiver p, which is 0: number of kept nodes that see the light/m, eq. (4). */
static void mean(const Near *near, i64 p, Scratch *t, f32 *S) {
    const i64 *begin = near->start + p * near->s, W = near->W, K = near->K;
    const i32 *size = near->m + p * K;
    u64 *column = t->column;
    if (!size[K - 1]) return;
    i64 inner = 0;  /* the innermost ring with a kept node; lights whose ball ends before it have no set */
    while (!size[inner]) inner++;
    for (i64 w = 0; w < W; w++) {
        u64 lit = near->soft[p * W + w] & near->serve[inner * W + w], every = lit, some = 0;
        i64 count = 0;
        if (!lit) continue;
        if (near->uniform[p]) {
            every &= near->values[near->candidate[begin[0]] * W + w];
            some = every;
        } else {
            for (i64 g = 0; g < K; g++) {
                u64 lights = lit & near->serve[g * W + w];
                if (!lights) break;
                for (i64 at = begin[g]; at < begin[g + 1]; at++) {
                    if (!near->kept[at]) continue;
                    u64 seen = near->values[near->candidate[at] * W + w];
                    column[count++] = seen;
                    every &= seen | ~lights;
                    some |= seen & lights;
                }
            }
        }
        u64 differing = some & ~every;
        if (K == 1 && count < QUOTIENTS && __builtin_popcountll(differing) >= MANY) {
            add_shares(column, count, lit, near->L - 64 * w, t->quotient[count], S + 64 * w);
            continue;
        }
        spread(every, w, near->L, S);
        /* for all other lights the nodes agree, which is the most frequent case */
        for (u64 mixed = differing; mixed; mixed &= mixed - 1) {
            int at = lowest(mixed);
            i64 i = 64 * w + at, of = size[near->ring[i]];
            u64 number = 0;
            for (i64 k = 0; k < of; k++) number += column[k] >> at & 1;
            S[i] = (f32)((f64)number / of);
        }
    }
}

/* Adds to S (L) of receiver p, which is 0 for these lights: Σ w·v / Σ w over the kept nodes, w = falloff(|x − P|²/r²), for the lights of class k. */
static void smooth_mean(const Near *near, i64 p, i64 k, Scratch *t, f32 *S) {
    i64 W = near->W, first = near->start[p * near->s], count = 0;
    i64 last = near->uniform[p] ? first + 1 : near->start[p * near->s + k + 1];
    const u64 *soft = near->soft + p * W, *own = near->own + k * W;
    if (!near->m[p * near->K + k]) return;
    /* Which lights do all, and which do some, of the kept nodes see? */
    for (i64 w = 0; w < W; w++) t->every[w] = soft[w] & own[w], t->some[w] = 0;
    for (i64 at = first; at < last; at++) {
        if (!near->uniform[p] && !near->kept[at]) continue;
        for (i64 w = 0; w < W; w++) {
            t->every[w] &= near->values[near->candidate[at] * W + w];
            t->some[w] |= near->values[near->candidate[at] * W + w];
        }
    }
    t->ends[0] = 0;
    for (i64 w = 0; w < W; w++) {
        /* lights that no kept node sees have S = 0; sums are needed only for the others */
        spread(t->every[w], w, near->L, S);
        u64 mixed = t->some[w] & ~t->every[w] & soft[w] & own[w];
        for (; mixed; mixed &= mixed - 1) {
            t->lights[count] = 64 * w + lowest(mixed);
            t->seen[count++] = 0.0;
        }
        t->ends[w + 1] = count;
    }
    if (!count) return;

    /* The weighted sums of the lights that only some of them see */
    f64 total = 0.0, radius = near->radius[k];
    for (i64 at = first; at < last; at++) {
        if (!near->uniform[p] && !near->kept[at]) continue;
        i64 node = near->candidate[at];
        f64 weight = falloff(squared_distance(near->position + 3 * node, near->P + 3 * p) / (radius * radius));
        total += weight;
        for (i64 w = 0; w < W; w++) {
            u64 v = near->values[node * W + w];
            for (i64 j = t->ends[w]; j < t->ends[w + 1]; j++) t->seen[j] += weight * (f64)(v >> (t->lights[j] & 63) & 1);
        }
    }
    for (i64 j = 0; j < count; j++) S[t->lights[j]] = (f32)(t->seen[j] / total);
}

/* Does step 5 for receivers: fills m (psi_sizes), answered and empty (psi_answered), and sets S[rows] to the means, with
   `smooth` weights or equal ones. own, radius: the lights of each class, and its radius, world. counts[0]: how many
   receivers have a soft light without a set. Returns 1 if there is not enough memory. */
KERNEL(psi_means,
       "start i64[n,s]  candidate i32[c]  kept bool[c]  uniform bool[n]  values u64[u,W]  soft u64[n,W]  ring i64[L]  "
       "radius f64[K]  serve u64[K,W]  own u64[K,W]  P f64[n,3]  position f64[u,3]  smooth i64  rows i64[n]  m i32[n,K]!  "
       "answered u64[n,W]!  empty bool[n]!  counts i64[1]!  S f32[r,L]!"
       ";  1<=K  s=K+1  W=words(L)  0<=ring<K  0<=rows<r;  0<=candidate<u  0<=start<=c  rising(start)")
i64 psi_means(i64 n, i64 s, i64 c, i64 u, i64 W, i64 L, i64 K, i64 r, const i64 *start, const i32 *candidate,
              const u8 *kept, const u8 *uniform, const u64 *values, const u64 *soft, const i64 *ring, const f64 *radius,
              const u64 *serve, const u64 *own, const f64 *P, const f64 *position, i64 smooth, const i64 *rows, i32 *m,
              u64 *answered, u8 *empty, i64 *counts, f32 *S) {
    Near near = {s, W, K, L, start, candidate, m, kept, uniform, values, soft, serve, own, ring, radius, P, position};
    Scratch scratch;
    int room = scratch_for(&scratch, &near, n);
    (void)c, (void)u, (void)r;
    counts[0] = 0;
    for (i64 p = 0; room && p < n; p++) {
        f32 *out = S + rows[p] * L;
        memset(out, 0, (size_t)L * sizeof *out);
        size_of(start + p * s, K, kept, uniform[p], m + p * K);
        for (i64 k = 0; smooth && k < K; k++) smooth_mean(&near, p, k, &scratch, out);
        if (!smooth) mean(&near, p, &scratch, out);
        empty[p] = (u8)answer_of(m + p * K, K, W, soft + p * W, serve, answered + p * W);
        counts[0] += empty[p];
    }
    free(scratch.column), free(scratch.lights), free(scratch.seen), free(scratch.every);
    return !room;
}
