/* What the receivers of blocks of the picture say of lamps (blocks.py). */
#include "native.h"

enum { LIT = 1, DIM = 2, VOTER = 4, MOST = 1 << 12 };

/* Adds the votes of pairs `left` of receiver row and light to those of the receiver's block: whether some light arrives,
   whether some does not, and how many receivers say so. Those that have traced no rays, or only to points below the
   horizon, do not vote. */
KERNEL(blocks_voted,
       "block i32[n]  row i32[k]  light i32[k]  left i64[m]  have i64[k]  clear f64[k,C]  whole f64[k]  votes u16[b,L]!")
i64 blocks_voted(i64 n, i64 k, i64 m, i64 C, i64 b, i64 L, const i32 *block, const i32 *row, const i32 *light, const i64 *left,
                 const i64 *have, const f64 *clear, const f64 *whole, u16 *votes) {
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

/* out (m,): 2 where the block of pair left[q] sees all of the light, 1 where it sees none of it, 0 where its receivers
   disagree or fewer than `fewest` vote. */
KERNEL(blocks_agreed,
       "fewest i64  block i32[n]  row i32[k]  light i32[k]  left i64[m]  votes u16[b,L]  out u8[m]!")
i64 blocks_agreed(i64 n, i64 k, i64 m, i64 b, i64 L, i64 fewest, const i32 *block, const i32 *row, const i32 *light,
                  const i64 *left, const u16 *votes, u8 *out) {
    (void)n, (void)k, (void)b;
    for (i64 q = 0; q < m; q++) {
        i64 at = left[q];
        u16 vote = votes[L * block[row[at]] + light[at]];
        int lit = vote & LIT, dim = vote & DIM;
        out[q] = vote / VOTER < fewest || (lit && dim) ? 0 : lit ? 2 : 1;
    }
    return 0;
}
