/* What the receivers of blocks of the picture say of lamps (blocks.py). Everywhere `left` (m,) are pairs k of row and light. */
#include "native.h"

enum { LIT = 1, DIM = 2, VOTER = 4, MOST = 1 << 12 };

/* Lists in out those of the pairs left that have `first` rays, and sets that they have `rays`: lifted ones or not (lifts).
   chosen: of receivers with 0, and for lamps of which `counts` is more than `few`, of those with 1; without it only where
   counts is `rays`, unless this is 0: then everywhere. Returns how many. */
KERNEL(blocks_todo,
       "first i64  rays i64  few i64  lifts i64  row i32[k]  light i32[k]  left i32[m]  lifted u64[n,W]  chosen u8[n]?  "
       "counts u8[n,L]  have u8[k]!  out i32[m]!"
       ";  W=words(L)  0<=left<k  0<=row<n  0<=light<L")
i64 blocks_todo(i64 k, i64 m, i64 n, i64 W, i64 L, i64 first, i64 rays, i64 few, i64 lifts, const i32 *row, const i32 *light,
                const i32 *left, const u64 *lifted, const u8 *chosen, const u8 *counts, u8 *have, i32 *out) {
    i64 count = 0;
    (void)k, (void)n;
    for (i64 q = 0; q < m; q++) {
        i64 at = left[q], p = row[at], i = light[at];
        if (have[at] != first) continue;
        if (chosen ? chosen[p] > (counts[L * p + i] > few) : few && counts[L * p + i] != rays) continue;
        if (has(lifted + W * p, i) != (lifts != 0)) continue;
        have[at] = (u8)rays, out[count++] = (i32)at;
    }
    return count;
}

/* Adds the votes of the pairs left to those of the receivers' blocks: whether some light arrives, whether some does not, and
   how many receivers say so. Those that have no rays, or only to points below the horizon, do not vote. */
KERNEL(blocks_voted,
       "block i32[n]  row i32[k]  light i32[k]  left i32[m]  have u8[k]  clear f64[k,C]  whole f64[k]  votes u16[b,L]!"
       ";  0<=left<k  0<=block<b  0<=row<n  0<=light<L")
i64 blocks_voted(i64 n, i64 k, i64 m, i64 C, i64 b, i64 L, const i32 *block, const i32 *row, const i32 *light, const i32 *left,
                 const u8 *have, const f64 *clear, const f64 *whole, u16 *votes) {
    (void)n, (void)k, (void)b;
    for (i64 q = 0; q < m; q++) {
        i64 at = left[q];
        if (!have[at] || !(whole[at] > 0.0)) continue;
        u16 *vote = votes + L * block[row[at]] + light[at];
        for (i64 c = 0; c < C; c++) {
            if (clear[C * at + c] > 0.0) *vote |= LIT;
            if (clear[C * at + c] < whole[at]) *vote |= DIM;
        }
        if (*vote < MOST) *vote = (u16)(*vote + VOTER);
    }
    return 0;
}

/* Sets S of the pairs left to 1 where their block sees all of the light, leaves it where it sees none, and moves to the
   front of `left` those whose block disagrees, or of which fewer than `fewest` receivers vote. Returns how many these are.
   */
KERNEL(blocks_agreed,
       "fewest i64  block i32[n]  row i32[k]  light i32[k]  votes u16[b,L]  left i32[m]!  S f32[n,L,C]!"
       ";  0<=left<k  0<=block<b  0<=row<n  0<=light<L")
i64 blocks_agreed(i64 n, i64 k, i64 b, i64 L, i64 m, i64 C, i64 fewest, const i32 *block, const i32 *row, const i32 *light,
                  const u16 *votes, i32 *left, f32 *S) {
    i64 count = 0;
    (void)n, (void)k, (void)b;
    for (i64 q = 0; q < m; q++) {
        i64 at = left[q], p = row[at], i = light[at];
        u16 vote = votes[L * block[p] + i];
        if (vote / VOTER < fewest || (vote & (LIT | DIM)) == (LIT | DIM))
            left[count++] = (i32)at;
        else if (vote & LIT)
            for (i64 c = 0; c < C; c++) S[C * (L * p + i) + c] = 1.0f;
    }
    return count;
}

/* Sets S of the pairs left to what their rays say, and their lights' bits in partly. */
KERNEL(blocks_said,
       "row i32[k]  light i32[k]  left i32[m]  clear f64[k,C]  whole f64[k]  S f32[n,L,C]!  partly u64[n,W]!"
       ";  W=words(L)  0<=left<k  0<=row<n  0<=light<L")
i64 blocks_said(i64 k, i64 m, i64 C, i64 n, i64 L, i64 W, const i32 *row, const i32 *light, const i32 *left, const f64 *clear,
                const f64 *whole, f32 *S, u64 *partly) {
    (void)k, (void)n;
    for (i64 q = 0; q < m; q++) {
        i64 at = left[q], p = row[at], i = light[at];
        for (i64 c = 0; c < C; c++)
            S[C * (L * p + i) + c] = (f32)(clear[C * at + c] / (whole[at] > 1e-300 ? whole[at] : 1e-300));
        partly[W * p + (i >> 6)] |= bit(i);
    }
    return 0;
}
