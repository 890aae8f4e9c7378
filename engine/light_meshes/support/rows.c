/* Rows of arrays (rows.py). */
#include "native.h"

KERNEL(rows_taken, "from f64[n,3]  rows i64[m]  out f64[m,3]!"
       ";  0<=rows<n")
i64 rows_taken(i64 n, i64 m, const f64 *from, const i64 *rows, f64 *out) {
    (void)n;
    for (i64 k = 0; k < m; k++) memcpy(out + 3 * k, from + 3 * rows[k], 3 * sizeof *out);
    return 0;
}

/* Lists the rows that are set, or those that are not; returns how many. */
KERNEL(rows_where, "mask bool[n]  set i64  rows i64[n]!")
i64 rows_where(i64 n, const u8 *mask, i64 set, i64 *rows) {
    i64 count = 0;
    for (i64 k = 0; k < n; k++) rows[count] = k, count += (mask[k] != 0) == (set != 0);
    return count;
}

KERNEL(rows_put, "words u64[n,W]!  rows i64[m]  values u64[m,W]"
       ";  0<=rows<n")
i64 rows_put(i64 n, i64 W, i64 m, u64 *words, const i64 *rows, const u64 *values) {
    (void)n;
    for (i64 k = 0; k < m; k++) memcpy(words + W * rows[k], values + W * k, (size_t)W * sizeof *words);
    return 0;
}
