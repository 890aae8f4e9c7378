/* Sets of lights: their hash table, the sets of rows, and new numbers after unused sets are removed. */
#include "light_sets.h"

KERNEL(sets_fill, "words u64[r,W]  size i64[1]  table i32[t]!")
i64 sets_fill(i64 r, i64 W, i64 t, u64 *words, i64 *size, i32 *table) {
    LightSets sets = {words, size, table, 0, r, W, t, 0};
    for (i64 number = 0; number < *size; number++) table[search_set(&sets, words + number * W)] = (i32)number;
    return 0;
}

KERNEL(sets_expanded, "words u64[r,W]  number u8[n,b]  first i64  out u64[m,W]!")
i64 sets_expanded(i64 r, i64 W, i64 n, i64 b, i64 m, u64 *words, u8 *number, i64 first, u64 *out) {
    LightSets sets = {words, 0, 0, number, r, W, 0, b};
    (void)n;
    for (i64 k = 0; k < m; k++) memcpy(out + k * W, words + number_of(&sets, first + k) * W, (size_t)W * sizeof *out);
    return 0;
}

KERNEL(sets_mark, "number u8[n,b]  used bool[s]!")
i64 sets_mark(i64 n, i64 b, i64 s, u8 *number, u8 *used) {
    LightSets sets = {0, 0, 0, number, 0, 0, 0, b};
    (void)s;
    for (i64 row = 0; row < n; row++) used[number_of(&sets, row)] = 1;
    return 0;
}

KERNEL(sets_renumber, "old u8[n,b]  new_number i64[s]  new u8[n,c]!")
i64 sets_renumber(i64 n, i64 b, i64 s, i64 c, u8 *old, const i64 *new_number, u8 *new) {
    LightSets before = {0, 0, 0, old, 0, 0, 0, b}, after = {0, 0, 0, new, 0, 0, 0, c};
    (void)s;
    for (i64 row = 0; row < n; row++) give_number(&after, row, new_number[number_of(&before, row)]);
    return 0;
}
