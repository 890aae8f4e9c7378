/* A hash table from 64-bit keys to numbers in the order in which they came (table.py). */
#include "native.h"

static inline u64 spread(u64 key) {
    key = (key ^ key >> 31) * SPREAD;
    return key ^ key >> 29;
}

/* Fills the numbers of keys; new ones are entered. size: how many there are. Returns 1 if there is no room: call it
   again with larger arrays, those before have been entered. */
KERNEL(table_numbers, "keys u64[n]  slots i32[m]!  entered u64[r]!  size i64[1]!  number i32[n]!")
i64 table_numbers(i64 n, i64 m, i64 r, const u64 *keys, i32 *slots, u64 *entered, i64 *size, i32 *number) {
    u64 mask = (u64)m - 1;
    for (i64 k = 0; k < n; k++) {
        u64 at = spread(keys[k]) & mask;
        while (slots[at] >= 0 && entered[slots[at]] != keys[k]) at = (at + 1) & mask;
        if (slots[at] < 0) {
            if (*size == r) return 1;
            entered[*size] = keys[k];
            slots[at] = (i32)(*size)++;
        }
        number[k] = slots[at];
    }
    return 0;
}
