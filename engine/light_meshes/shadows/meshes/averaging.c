/* Steps 4 and 5 of Ψ for a batch of receivers (averaging.py explains start, serve, ring and m). */
#include <stdlib.h>

#include "averaging.h"

KERNEL(psi_ask, "start i64[n,s]  candidate i32[c]  soft u64[n,W]  serve u64[K,W]  need u64[u,W]!")
i64 psi_ask(i64 n, i64 s, i64 c, i64 W, i64 K, i64 u, const i64 *start, const i32 *candidate, const u64 *soft,
            const u64 *serve, u64 *need) {
    (void)c, (void)u;
    for (i64 p = 0; p < n; p++)
        for (i64 w = 0; w < W; w++)
            for (i64 g = 0; g < K; g++) {
                u64 lights = soft[p * W + w] & serve[g * W + w];
                if (!lights) continue;
                for (i64 at = start[p * s + g]; at < start[p * s + g + 1]; at++) need[candidate[at] * W + w] |= lights;
            }
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

KERNEL(psi_agreement, "start i64[n,s]  candidate i32[c]  values u64[u,W]  soft u64[n,W]  serve u64[K,W]  uniform bool[n]!")
i64 psi_agreement(i64 n, i64 s, i64 c, i64 u, i64 W, i64 K, const i64 *start, const i32 *candidate, const u64 *values,
                  const u64 *soft, const u64 *serve, u8 *uniform) {
    (void)c, (void)u;
    for (i64 p = 0; p < n; p++)
        uniform[p] = (u8)agree(start + p * s, candidate, values, soft + p * W, serve, K, W);
    return 0;
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

/* Marks candidates of receivers with a certificate as seen: those more than `margin` above P's plane. Returns how
   many. For a uniform receiver only the first is marked, because no more are needed. */
KERNEL(psi_certify,
       "start i64[n,s]  candidate i32[c]  holds bool[n]  uniform bool[n]  P f64[n,3]  N f64[n,3]  position f64[u,3]  "
       "margin f64  seen bool[c]!")
i64 psi_certify(i64 n, i64 s, i64 c, i64 u, const i64 *start, const i32 *candidate, const u8 *holds, const u8 *uniform,
                const f64 *P, const f64 *N, const f64 *position, f64 margin, u8 *seen) {
    i64 count = 0;
    (void)c, (void)u;
    for (i64 p = 0; p < n; p++) {
        if (!holds[p]) continue;
        i64 first = start[p * s], last = uniform[p] ? first + 1 : start[p * s + s - 1];
        for (i64 at = first; at < last; at++) {
            const f64 *x = position + 3 * (i64)candidate[at], *o = P + 3 * p, *normal = N + 3 * p;
            f64 above = (x[0] - o[0]) * normal[0] + (x[1] - o[1]) * normal[1] + (x[2] - o[2]) * normal[2];
            seen[at] = above > margin;
            count += seen[at];
        }
    }
    return count;
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
       "start i64[n,s]  soft u64[n,W]  serve u64[K,W]  uniform bool[n]  seen bool[c]  row i32[r]?!  index i64[r]?!")
i64 psi_listed(i64 n, i64 s, i64 W, i64 K, i64 c, i64 r, const i64 *start, const u64 *soft, const u64 *serve,
               const u8 *uniform, const u8 *seen, i32 *row, i64 *index) {
    i64 count = 0;
    (void)c, (void)r;
    for (i64 p = 0; p < n; p++) {
        if (uniform[p]) continue;
        i64 last = end_of(start + p * s, soft + p * W, serve, K, W);
        for (i64 at = start[p * s]; at < last; at++) {
            if (seen[at]) continue;
            if (row) row[count] = (i32)p, index[count] = at;
            count++;
        }
    }
    return count;
}

/* Fills end with that of the candidates that need a short ray first: of uniform receivers one, of others none. */
KERNEL(psi_witnesses, "start i64[n,s]  uniform bool[n]  end i64[n]!")
i64 psi_witnesses(i64 n, i64 s, const i64 *start, const u8 *uniform, i64 *end) {
    for (i64 p = 0; p < n; p++) end[p] = start[p * s] + uniform[p];
    return 0;
}

/* Keeps the mark `uniform` only where the first candidate is seen. Fills end with that of the candidates that need a short
   ray then; returns how many receivers are uniform. */
KERNEL(psi_ends, "start i64[n,s]  soft u64[n,W]  serve u64[K,W]  seen bool[c]  uniform bool[n]!  end i64[n]!")
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

/* Fills answered with the soft lights whose set is not empty: if the smallest ball that has a node belongs to class k, the
   lights of all classes from k on have a set. empty: whether a soft light has none; returns how many receivers have one. */
KERNEL(psi_answered, "m i32[n,K]  soft u64[n,W]  serve u64[K,W]  answered u64[n,W]!  empty bool[n]!")
i64 psi_answered(i64 n, i64 K, i64 W, const i32 *m, const u64 *soft, const u64 *serve, u64 *answered, u8 *empty) {
    i64 count = 0;
    for (i64 p = 0; p < n; p++) {
        i64 k = 0;
        u64 left = 0;
        while (k < K && m[p * K + k] <= 0) k++;
        for (i64 w = 0; w < W; w++) {
            answered[p * W + w] = k < K ? soft[p * W + w] & serve[k * W + w] : 0;
            left |= soft[p * W + w] & ~answered[p * W + w];
        }
        empty[p] = left != 0;
        count += empty[p];
    }
    return count;
}

/* Fills m: how many nodes step 3 keeps in the ball of each class. */
KERNEL(psi_sizes, "start i64[n,s]  kept bool[c]  uniform bool[n]  m i32[n,K]!")
i64 psi_sizes(i64 n, i64 s, i64 c, i64 K, const i64 *start, const u8 *kept, const u8 *uniform, i32 *m) {
    (void)c;
    for (i64 p = 0; p < n; p++) {
        const i64 *begin = start + p * s;
        i64 total = 0;
        for (i64 g = 0; g < K; g++) {
            if (uniform[p])  /* all agree, and the first is seen: every m gives the same quotients */
                total = begin[g + 1] > begin[0];
            else
                for (i64 at = begin[g]; at < begin[g + 1]; at++) total += kept[at];
            m[p * K + g] = (i32)total;
        }
    }
    return 0;
}

/* Adds 1 to S (L) for each light of word w that is in `lights`, without a branch. */
static void spread(u64 lights, i64 w, i64 L, f32 *S) {
    i64 count = L - 64 * w < 64 ? L - 64 * w : 64;
    for (i64 i = 0; i < count; i++) S[64 * w + i] += (f32)(lights >> i & 1);
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

/* Computes S[rows] = (number of kept nodes that see the light)/m, eq. (4). Returns 1 if there is not enough memory. */
KERNEL(psi_mean,
       "start i64[n,s]  candidate i32[c]  kept bool[c]  uniform bool[n]  values u64[u,W]  soft u64[n,W]  "
       "serve u64[K,W]  ring i64[L]  m i32[n,K]  rows i64[n]  S f32[r,L]!")
i64 psi_mean(i64 n, i64 s, i64 c, i64 u, i64 W, i64 K, i64 L, i64 r, const i64 *start, const i32 *candidate,
             const u8 *kept, const u8 *uniform, const u64 *values, const u64 *soft, const u64 *serve, const i64 *ring,
             const i32 *m, const i64 *rows, f32 *S) {
    i64 most = 1;
    (void)c, (void)u, (void)r;
    for (i64 p = 0; p < n; p++) {
        i64 all = start[p * s + K] - start[p * s];
        most = all > most ? all : most;
    }
    u64 *column = malloc((size_t)most * sizeof *column);
    if (!column) return 1;
    f32 quotient[QUOTIENTS][QUOTIENTS];
    for (int of = 1; of < QUOTIENTS; of++)
        for (int number = 0; number <= of; number++) quotient[of][number] = (f32)((f64)number / of);
    for (i64 p = 0; p < n; p++) {
        const i64 *begin = start + p * s;
        const i32 *size = m + p * K;
        f32 *out = S + rows[p] * L;
        if (!size[K - 1]) continue;
        i64 inner = 0;  /* the innermost ring with a kept node; lights whose ball ends before it have no set */
        while (!size[inner]) inner++;
        for (i64 w = 0; w < W; w++) {
            u64 lit = soft[p * W + w] & serve[inner * W + w], every = lit, some = 0;
            i64 count = 0;
            if (!lit) continue;
            if (uniform[p]) {
                every &= values[candidate[begin[0]] * W + w];
                some = every;
            } else {
                for (i64 g = 0; g < K; g++) {
                    u64 lights = lit & serve[g * W + w];
                    if (!lights) break;
                    for (i64 at = begin[g]; at < begin[g + 1]; at++) {
                        if (!kept[at]) continue;
                        u64 seen = values[candidate[at] * W + w];
                        column[count++] = seen;
                        every &= seen | ~lights;
                        some |= seen & lights;
                    }
                }
            }
            u64 differing = some & ~every;
            if (K == 1 && count < QUOTIENTS && __builtin_popcountll(differing) >= MANY) {
                add_shares(column, count, lit, L - 64 * w, quotient[count], out + 64 * w);
                continue;
            }
            spread(every, w, L, out);
            /* for all other lights the nodes agree, which is the most frequent case */
            for (u64 mixed = differing; mixed; mixed &= mixed - 1) {
                int at = lowest(mixed);
                i64 i = 64 * w + at, of = size[ring[i]];
                u64 number = 0;
                for (i64 k = 0; k < of; k++) number += column[k] >> at & 1;
                out[i] = (f32)((f64)number / of);
            }
        }
    }
    free(column);
    return 0;
}

/* Computes S[rows] = Σ w·v / Σ w over the kept nodes, w = falloff(|x − P|²/r²). radius: of the classes, world. own:
   the lights of each class. Returns 1 if there is not enough memory. */
KERNEL(psi_smooth_mean,
       "start i64[n,s]  candidate i32[c]  kept bool[c]  uniform bool[n]  values u64[u,W]  soft u64[n,W]  own u64[K,W]  "
       "radius f64[K]  P f64[n,3]  position f64[u,3]  m i32[n,K]  rows i64[n]  S f32[r,L]!")
i64 psi_smooth_mean(i64 n, i64 s, i64 c, i64 u, i64 W, i64 K, i64 r, i64 L, const i64 *start, const i32 *candidate,
                    const u8 *kept, const u8 *uniform, const u64 *values, const u64 *soft, const u64 *own,
                    const f64 *radius, const f64 *P, const f64 *position, const i32 *m, const i64 *rows, f32 *S) {
    /* the lights whose sums are needed; those of word w end at ends[w+1] */
    i64 *lights = malloc((size_t)(L + W + 1) * sizeof *lights);
    f64 *seen = malloc((size_t)L * sizeof *seen);
    u64 *every = malloc((size_t)(2 * W) * sizeof *every);
    if (!lights || !seen || !every) {
        free(lights), free(seen), free(every);
        return 1;
    }
    i64 *ends = lights + L;
    u64 *some = every + W;
    (void)c, (void)u, (void)r;
    ends[0] = 0;
    for (i64 p = 0; p < n; p++)
        for (i64 k = 0; k < K; k++) {
            f32 *out = S + rows[p] * L;
            i64 first = start[p * s], last = uniform[p] ? first + 1 : start[p * s + k + 1], count = 0;
            if (!m[p * K + k]) continue;
            /* Which lights do all, and which do some, of the kept nodes see? */
            for (i64 w = 0; w < W; w++) every[w] = soft[p * W + w] & own[k * W + w], some[w] = 0;
            for (i64 at = first; at < last; at++) {
                if (!uniform[p] && !kept[at]) continue;
                for (i64 w = 0; w < W; w++) {
                    every[w] &= values[candidate[at] * W + w];
                    some[w] |= values[candidate[at] * W + w];
                }
            }
            for (i64 w = 0; w < W; w++) {
                /* lights that no kept node sees have S = 0; sums are needed only for the others */
                spread(every[w], w, L, out);
                u64 mixed = some[w] & ~every[w] & soft[p * W + w] & own[k * W + w];
                for (; mixed; mixed &= mixed - 1) {
                    lights[count] = 64 * w + lowest(mixed);
                    seen[count++] = 0.0;
                }
                ends[w + 1] = count;
            }
            if (!count) continue;

            /* The weighted sums of the lights that only some of them see */
            f64 total = 0.0;
            for (i64 at = first; at < last; at++) {
                if (!uniform[p] && !kept[at]) continue;
                i64 node = candidate[at];
                f64 weight = falloff(squared_distance(position + 3 * node, P + 3 * p) / (radius[k] * radius[k]));
                total += weight;
                for (i64 w = 0; w < W; w++) {
                    u64 v = values[node * W + w];
                    for (i64 j = ends[w]; j < ends[w + 1]; j++) seen[j] += weight * (f64)(v >> (lights[j] & 63) & 1);
                }
            }
            for (i64 j = 0; j < count; j++) out[lights[j]] = (f32)(seen[j] / total);
        }
    free(lights), free(seen), free(every);
    return 0;
}
