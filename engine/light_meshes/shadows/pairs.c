/* Pairs of receiver and light, and what is known of them, as sets of bits. */
#include "native.h"

/* Sets S to `value` for each set bit among the first `lights` lights; S (n, L·C). */
KERNEL(pairs_set, "mask u64[n,W]  lights i64  value f64  S f32[n,s]!"
       ";  0<=lights")
i64 pairs_set(i64 n, i64 W, i64 s, const u64 *mask, i64 lights, f64 value, f32 *S) {
    i64 C = lights ? s / lights : 0;
    for (i64 p = 0; p < n; p++)
        for (i64 w = 0; w < W; w++)
            for (u64 rest = mask[p * W + w]; rest; rest &= rest - 1) {
                i64 i = 64 * w + lowest(rest);
                for (i64 k = 0; k < C && i < lights; k++) S[p * s + i * C + k] = (f32)value;
            }
    return 0;
}

/* Sets S to 0 for the receivers that have no set bit, or without a mask for all. */
KERNEL(pairs_darken, "S f32[n,s]!  mask u64[n,W]?")
i64 pairs_darken(i64 n, i64 s, i64 W, f32 *S, const u64 *mask) {
    for (i64 p = 0; p < n; p++) {
        u64 any = 0;
        for (i64 w = 0; mask && w < W; w++) any |= mask[p * W + w];
        if (!any) memset(S + p * s, 0, (size_t)s * sizeof *S);
    }
    return 0;
}

enum { ROWS = 1024 }; /* receivers that are listed together, of which few have bits in one word */

/* Lists (row, light) of each set bit, light by light, so that neighbouring rays have similar directions; returns how
   many. */
KERNEL(pairs_listed, "mask u64[n,W]  first i64  last i64  row i32[r]!  light i32[r]!"
       ";  0<=first  last<=64*W")
i64 pairs_listed(i64 n, i64 W, i64 r, const u64 *mask, i64 first, i64 last, i32 *row, i32 *light) {
    i64 count = 0;
    i32 some[ROWS];
    for (i64 w = first >> 6; 64 * w < last; w++) {
        i64 found = 0;
        u64 every = 0, wanted = ~(u64)0;
        if (64 * w < first) wanted &= ~(u64)0 << (first & 63);
        if (64 * w + 64 > last) wanted &= ~(u64)0 >> (64 * w + 64 - last);
        for (i64 p = 0; p < n; p++) {
            u64 word = mask[p * W + w] & wanted;
            every |= word;
            if (found < ROWS) some[found] = (i32)p;
            found += word != 0;
        }
        for (; every; every &= every - 1) {
            i64 i = 64 * w + lowest(every);
            for (i64 j = 0; found <= ROWS && j < found && count < r; j++)
                if (has(mask + (i64)some[j] * W, i)) row[count] = some[j], light[count++] = (i32)i;
            for (i64 p = 0; found > ROWS && p < n && count < r; p++)
                if (has(mask + p * W, i)) row[count] = (i32)p, light[count++] = (i32)i;
        }
    }
    return count;
}

/* Clears the bits of lights with S = 0, because nothing can dim these further. S (n, L·C). */
KERNEL(pairs_drop_dark, "S f32[n,s]  lights i64  mask u64[n,W]!"
       ";  W=words(lights)")
i64 pairs_drop_dark(i64 n, i64 s, i64 W, const f32 *S, i64 lights, u64 *mask) {
    i64 C = lights ? s / lights : 0;
    for (i64 p = 0; p < n; p++)
        for (i64 i = 0; i < lights; i++) {
            int dark = 1;
            for (i64 k = i * C; k < (i + 1) * C; k++) dark &= S[p * s + k] == 0;
            if (dark) clear_bit(mask + p * W, i);
        }
    return 0;
}

/* Counts the bits of each word of the mask. */
KERNEL(pairs_counted, "mask u64[n,W]  count i64[W]!")
i64 pairs_counted(i64 n, i64 W, const u64 *mask, i64 *count) {
    memset(count, 0, (size_t)W * sizeof *count);
    for (i64 p = 0; p < n; p++)
        for (i64 w = 0; w < W; w++) count[w] += __builtin_popcountll(mask[p * W + w]);
    return 0;
}

/* Lists the rows that have any bit; returns how many. */
KERNEL(pairs_rows, "mask u64[n,W]  row i64[n]!")
i64 pairs_rows(i64 n, i64 W, const u64 *mask, i64 *row) {
    i64 count = 0;
    for (i64 p = 0; p < n; p++) {
        u64 any = 0;
        for (i64 w = 0; w < W; w++) any |= mask[p * W + w];
        row[count] = p, count += any != 0;
    }
    return count;
}
