/* Where edges of triangles are, in cells, and how near records are to what rises above their plane (nearness.py). */
#include "native.h"

#define PIECES 65536  /* an edge is looked at in up to so many places */

static inline u64 cell_key(const i64 *c) {
    u64 key = 0;
    for (int j = 0; j < 3; j++) key = key << 21 | (u64)(c[j] & 0x1FFFFF);
    return key;
}

static inline u64 place_of_key(u64 key) {
    key = (key ^ key >> 30) * SPREAD;
    return key ^ key >> 28;
}

/* The entry of a cell and an instance: cells have an entry for each, up to ENTRIES; the last stands for all others. */
#define ENTRIES 6
static u64 entry_of(const u64 *keys, const i32 *of, u64 mask, u64 key, i32 instance) {
    int found = 0;
    u64 at = place_of_key(key) & mask;
    for (; keys[at]; at = (at + 1) & mask)
        if (keys[at] == key && (of[at] == instance || ++found == ENTRIES)) return at;
    return at;
}

/* Enters the edges of triangles in the table of cells: keys (0: free), whose they are, and boxes around what is in each.
   Returns 1 if the table gets too full: begin again with a larger one. */
KERNEL(nearness_enter,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  instance i32[T]  there bool[T]  cell f64  "
       "keys u64[m]!  of i32[m]!  boxes f32[m,6]!")
i64 nearness_enter(i64 V, i64 T, i64 m, const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangles,
                   const i32 *instance, const u8 *there, f64 cell, u64 *keys, i32 *of, f32 *boxes) {
    i64 size = 0;
    (void)V;
    for (i64 t = 0; t < T; t++) {
        if (!there[t]) continue;
        for (int e = 0; e < 3; e++) {
            const f32 *from = vertices + 3 * (i64)triangles[3 * t + e], *to = vertices + 3 * (i64)triangles[3 * t + (e + 1) % 3];
            f64 length = 0.0;
            for (int j = 0; j < 3; j++) length += square((f64)to[j] - from[j]);
            length = scale * sqrt(length);
            i64 pieces = length < PIECES * 0.5 * cell ? (i64)ceil(2.0 * length / cell) : PIECES;
            for (i64 p = 0; p < pieces; p++) {
                f64 x[3], s = (f64)p / (f64)pieces;
                i64 c[3];
                for (int j = 0; j < 3; j++) {
                    x[j] = centre[j] + scale * (from[j] + s * ((f64)to[j] - from[j]));
                    c[j] = (i64)floor(x[j] / cell);
                }
                u64 key = cell_key(c) + 1, at = entry_of(keys, of, (u64)m - 1, key, instance[t]);
                f32 *box = boxes + 6 * at;
                if (!keys[at]) {
                    if (2 * ++size > m) return 1;
                    keys[at] = key, of[at] = instance[t];
                    for (int j = 0; j < 3; j++) box[j] = box[3 + j] = (f32)x[j];
                }
                for (int j = 0; j < 3; j++) {
                    if ((f32)x[j] < box[j]) box[j] = (f32)x[j];
                    if ((f32)x[j] > box[3 + j]) box[3 + j] = (f32)x[j];
                }
            }
        }
    }
    return 0;
}

/* Fills how far (n,) records at P with normals M are from edges in the cells around them that rise more than `rise` of
   their distance above the plane of a record; 1e30: there are none. own (n,): the instance whose edges do not count,
   −1: all do. */
KERNEL(nearness_of,
       "cell f64  keys u64[m]  of i32[m]  boxes f32[m,6]  rise f64  P f64[n,3]  M f64[n,3]  own i32[n]  near f32[n]!")
i64 nearness_of(i64 m, i64 n, f64 cell, const u64 *keys, const i32 *of, const f32 *boxes, f64 rise, const f64 *P,
                const f64 *M, const i32 *own, f32 *near) {
    for (i64 k = 0; k < n; k++) {
        f64 least = 1e60;
        i64 middle[3];
        for (int j = 0; j < 3; j++) middle[j] = (i64)floor(P[3 * k + j] / cell);
        for (int q = 0; q < 27; q++) {
            i64 c[3] = {middle[0] + q / 9 - 1, middle[1] + q / 3 % 3 - 1, middle[2] + q % 3 - 1};
            u64 key = cell_key(c) + 1, at = place_of_key(key) & ((u64)m - 1);
            for (; keys[at]; at = (at + 1) & ((u64)m - 1)) {
                if (keys[at] != key || (of[at] == own[k] && own[k] >= 0)) continue;
                const f32 *box = boxes + 6 * at;
                f64 away = 0.0, high = 0.0;
                for (int j = 0; j < 3; j++) {
                    f64 x = P[3 * k + j], low = box[j] - x, top = box[3 + j] - x, N = M[3 * k + j];
                    away += low > 0.0 ? low * low : top < 0.0 ? top * top : 0.0;
                    high += N > 0.0 ? N * top : N * low;
                }
                if (high > rise * sqrt(away) + 1e-4 * cell && away < least) least = away;
            }
        }
        near[k] = (f32)(least < 1e60 ? sqrt(least) : 1e30);
    }
    return 0;
}
