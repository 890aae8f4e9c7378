/* Numbers for 64-bit keys (table.py). */
#include "table.h"

/* Fills the numbers of keys; new ones are entered. size: how many there are. Returns 1 if there is no room: call it
   again with larger arrays, those before have been entered. */
KERNEL(table_numbers, "keys u64[n]  slots i32[m]!  entered u64[r]!  size i64[1]!  number i32[n]!"
       ";  power(m)  r<m  0<=size<=r")
i64 table_numbers(i64 n, i64 m, i64 r, const u64 *keys, i32 *slots, u64 *entered, i64 *size, i32 *number) {
    Slots table = {slots, entered, size, m, r};
    for (i64 k = 0; k < n; k++) {
        i64 of = number_of(&table, keys[k]);
        if (of < 0) return 1;
        number[k] = (i32)of;
    }
    return 0;
}
