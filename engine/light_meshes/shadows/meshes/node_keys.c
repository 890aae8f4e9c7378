/* Converts keys back to nodes, and fills a new hash table. */
#include "node_keys.h"

KERNEL(keys_unpacked, "base i64[3]  near u64[n]  far u64[f]  out i32[n,3]!"
       ";  f=0|f=n")
i64 keys_unpacked(i64 n, i64 f, const i64 *base, const u64 *near, const u64 *far, i32 *out) {
    for (i64 k = 0; k < n; k++)
        for (int axis = 0; axis < 3; axis++) {
            u64 x = near[k] >> (21 * axis) & LOW;
            if (f) x |= (far[k] >> (11 * axis) & HIGH) << 21;
            out[3 * k + axis] = (i32)(u32)(x + (u64)base[axis]);  /* modulo 2³², as in key_of */
        }
    return 0;
}

/* Enters the first `count` rows into an empty table. */
KERNEL(keys_fill, "base i64[3]  near u64[n]!  far u64[f]!  table u32[t]!  bits u64  count i64"
       ";  f=0|f=n  bits<=32  0<=count<=n  count<t")
i64 keys_fill(i64 n, i64 f, i64 t, const i64 *base, u64 *near, u64 *far, u32 *table, u64 bits, i64 count) {
    Keys keys = {base, near, far, f > 0, t, table, bits};
    (void)n;
    for (i64 row = 0; row < count; row++) {
        Key key = {near[row], f ? far[row] : 0};
        u64 place;
        find_key(&keys, key, &place);
        enter_key(&keys, place, key, row);
    }
    return 0;
}
