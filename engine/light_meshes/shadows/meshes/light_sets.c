/* Sets of lights: their hash table, the sets of rows, and new numbers after unused sets are removed. */
#include "light_sets.h"

KERNEL(sets_fill, "words u64[r,W]  size i64[1]  table i32[t]!"
       ";  power(t)  0<=size<=r  size<t")
i64 sets_fill(i64 r, i64 W, i64 t, u64 *words, i64 *size, i32 *table) {
    LightSets sets = {words, size, table, 0, r, W, t, 0};
    for (i64 number = 0; number < *size; number++) table[search_set(&sets, words + number * W)] = (i32)number;
    return 0;
}

KERNEL(sets_expanded, "words u64[r,W]  number u8[n,b]  first i64  out u64[m,W]!"
       ";  b<=8  0<=first  first+m<=n")
i64 sets_expanded(i64 r, i64 W, i64 n, i64 b, i64 m, u64 *words, u8 *number, i64 first, u64 *out) {
    LightSets sets = {words, 0, 0, number, r, W, 0, b};
    (void)n;
    for (i64 k = 0; k < m; k++) {
        i64 of = number_of(&sets, first + k);
        if (of < 0 || of >= r) return OUTSIDE;
        memcpy(out + k * W, words + of * W, (size_t)W * sizeof *out);
    }
    return 0;
}

KERNEL(sets_mark, "number u8[n,b]  used bool[s]!"
       ";  b<=8")
i64 sets_mark(i64 n, i64 b, i64 s, u8 *number, u8 *used) {
    LightSets sets = {0, 0, 0, number, 0, 0, 0, b};
    for (i64 row = 0; row < n; row++) {
        i64 of = number_of(&sets, row);
        if (of < 0 || of >= s) return OUTSIDE;
        used[of] = 1;
    }
    return 0;
}

KERNEL(sets_renumber, "old u8[n,b]  new_number i64[s]  new u8[n,c]!"
       ";  b<=8  c<=8")
i64 sets_renumber(i64 n, i64 b, i64 s, i64 c, u8 *old, const i64 *new_number, u8 *new) {
    LightSets before = {0, 0, 0, old, 0, 0, 0, b}, after = {0, 0, 0, new, 0, 0, 0, c};
    for (i64 row = 0; row < n; row++) {
        i64 of = number_of(&before, row);
        if (of < 0 || of >= s) return OUTSIDE;
        give_number(&after, row, new_number[of]);
    }
    return 0;
}
