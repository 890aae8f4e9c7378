/* Reads S, in which a receiver has its lights side by side, for blocks that have their receivers side by side (shading.c). */
#pragma once
#include "shading_block.h"

enum { FETCHED = 16 };  /* numbers of S that come from memory together */
enum { AHEAD = 64 };  /* lights whose S is read together: a receiver has them side by side, in a few lines of memory */

typedef f32 FourFloats __attribute__((vector_size(16)));

/* Copies four numbers of each of four rows as columns. */
static void four_columns(const f32 *const *row, i64 at, f32 (*out)[SIDE], int k) {
    FourFloats a, b, c, d;
    memcpy(&a, row[0] + at, sizeof a), memcpy(&b, row[1] + at, sizeof b);
    memcpy(&c, row[2] + at, sizeof c), memcpy(&d, row[3] + at, sizeof d);
    FourFloats ab = __builtin_shufflevector(a, b, 0, 4, 1, 5), cd = __builtin_shufflevector(c, d, 0, 4, 1, 5);
    FourFloats ef = __builtin_shufflevector(a, b, 2, 6, 3, 7), gh = __builtin_shufflevector(c, d, 2, 6, 3, 7);
    a = __builtin_shufflevector(ab, cd, 0, 1, 4, 5), b = __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
    c = __builtin_shufflevector(ef, gh, 0, 1, 4, 5), d = __builtin_shufflevector(ef, gh, 2, 3, 6, 7);
    memcpy(&out[at][k], &a, sizeof a), memcpy(&out[at + 1][k], &b, sizeof b);
    memcpy(&out[at + 2][k], &c, sizeof c), memcpy(&out[at + 3][k], &d, sizeof d);
}

/* Loads S (n,L,C) of `count` receivers for AHEAD lights from `first` on, as far as there are any: channel c of light i at
   C·i + c. The last receiver also fills places that are left over. Returns the bits of the lights of which some S is
   not 0. */
static u64 shares_of(const f32 *S, int count, i64 L, i64 first, i64 C, f32 (*out)[SIDE]) {
    i64 width = C * (L - first < AHEAD ? L - first : AHEAD);
    u64 some = 0;
    if (count == SIDE)  /* what the next block reads comes from memory meanwhile; S may end before it, which harms nothing */
        for (int k = 0; k < SIDE; k++)
            for (i64 j = 0; j < width; j += FETCHED) __builtin_prefetch((const char *)S + 4 * (((SIDE + k) * L + first) * C + j));
    for (int k = 0; k < SIDE; k += 4) {
        const f32 *row[4];
        i64 j = 0;
        for (int r = 0; r < 4; r++) row[r] = S + ((k + r < count ? k + r : count - 1) * L + first) * C;
        for (; j + 4 <= width; j += 4) four_columns(row, j, out, k);
        for (; j < width; j++)
            for (int r = 0; r < 4; r++) out[j][k + r] = row[r][j];
    }
    for (i64 j = 0; j < width; j++) {
        u32 any = 0;  /* −0 and 0 are none */
        for (int k = 0; k < SIDE; k++) any |= out[j][k] != 0.0f;
        some |= (u64)any << (j / C);
    }
    return some;
}
