/* Where edges of triangles are, in cells, and how near records are to what rises above their plane (nearness.py). */
#include "../rays/triangles.h"

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

/* The table of cells: keys (0: free), whose edges are in them, boxes around these, and how many entries there are. */
typedef struct {
    u64 *keys;
    i32 *of;
    f32 *boxes;
    i64 m, size;
} Boxes;

/* Makes the box of an instance in cell c hold x. Returns 0 if the table gets too full. */
static int enter_place(Boxes *b, const i64 *c, i32 instance, const f64 *x) {
    u64 key = cell_key(c) + 1, at = entry_of(b->keys, b->of, (u64)b->m - 1, key, instance);
    f32 *box = b->boxes + 6 * at;
    if (!b->keys[at]) {
        if (2 * ++b->size > b->m) return 0;
        b->keys[at] = key, b->of[at] = instance;
        for (int j = 0; j < 3; j++) box[j] = box[3 + j] = (f32)x[j];
    }
    for (int j = 0; j < 3; j++) {
        if ((f32)x[j] < box[j]) box[j] = (f32)x[j];
        if ((f32)x[j] > box[3 + j]) box[3 + j] = (f32)x[j];
    }
    return 1;
}

/* Enters the edge between two places: in each cell that it goes through, both ends of what is in it. A very long one is
   looked at in PIECES places. Returns 0 if the table gets too full. */
static int enter_edge(Boxes *b, f64 cell, i32 instance, const f64 *from, const f64 *to) {
    f64 way[3], next[3], by[3], x[3], s = 0.0, length = sqrt(squared_distance(from, to));
    i64 c[3];
    int whole = length < PIECES * 0.5 * cell;
    for (int j = 0; j < 3; j++) {
        way[j] = to[j] - from[j], c[j] = (i64)floor(from[j] / cell);
        by[j] = way[j] != 0.0 ? fabs(cell / way[j]) : INFINITY;
        next[j] = way[j] != 0.0 ? ((f64)(c[j] + (way[j] > 0.0)) * cell - from[j]) / way[j] : INFINITY;
    }
    for (i64 p = 0; !whole && p < PIECES; p++) {
        for (int j = 0; j < 3; j++) x[j] = from[j] + (f64)p / PIECES * way[j], c[j] = (i64)floor(x[j] / cell);
        if (!enter_place(b, c, instance, x)) return 0;
    }
    while (whole) {
        int first = next[0] < next[1] ? 0 : 1;
        if (next[2] < next[first]) first = 2;
        f64 until = next[first] < 1.0 ? next[first] : 1.0;
        for (int end = 0; end < 2; end++, s = until) {
            for (int j = 0; j < 3; j++) x[j] = from[j] + s * way[j];
            if (!enter_place(b, c, instance, x)) return 0;
        }
        if (until >= 1.0) break;
        c[first] += way[first] > 0.0 ? 1 : -1, next[first] += by[first];
    }
    return 1;
}

/* Enters the edges of triangles in the table of cells. Returns 1 if it gets too full: begin again with a larger one. */
KERNEL(nearness_enter,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  instance i32[T]  there bool[T]  cell f64  "
       "keys u64[m]!  of i32[m]!  boxes f32[m,6]!"
       ";  power(m)  0<cell<inf;  0<=triangles<V")
i64 nearness_enter(i64 V, i64 T, i64 m, const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangles,
                   const i32 *instance, const u8 *there, f64 cell, u64 *keys, i32 *of, f32 *boxes) {
    Boxes table = {keys, of, boxes, m, 0};
    (void)V;
    for (i64 t = 0; t < T; t++) {
        f64 place[3][3];
        if (!there[t]) continue;
        for (int e = 0; e < 3; e++)
            for (int j = 0; j < 3; j++)
                place[e][j] = centre[j] + scale * vertices[3 * (i64)triangles[3 * t + e] + j];
        for (int e = 0; e < 3; e++)
            if (!enter_edge(&table, cell, instance[t], place[e], place[(e + 1) % 3])) return 1;
    }
    return 0;
}

/* How high above a plane with normal N, through P, a box begins and ends. */
static inline void heights(const f32 *box, const f64 *P, const f64 *N, f64 *least, f64 *most) {
    *least = *most = 0.0;
    for (int j = 0; j < 3; j++) {
        f64 low = N[j] * (box[j] - P[j]), top = N[j] * (box[3 + j] - P[j]);
        *least += low < top ? low : top, *most += low < top ? top : low;
    }
}

/* Tells (clear) where no edge comes near halves of cells: triangles with corners (n,3,3), made wider by `margin`, up to
   heights (n,) above them, along their normals M. What rises less than a hundredth of a height does not count, nor does
   what lies in the plane, as precisely as boxes tell. */
KERNEL(nearness_clear,
       "cell f64  keys u64[m]  boxes f32[m,6]  corners f64[n,3,3]  M f64[n,3]  margin f64[n]  height f64[n]  clear bool[n]!"
       ";  power(m)  0<cell<inf  -inf<corners<inf  -inf<margin<inf")
i64 nearness_clear(i64 m, i64 n, f64 cell, const u64 *keys, const f32 *boxes, const f64 *corners, const f64 *M,
                   const f64 *margin, const f64 *height, u8 *clear) {
    for (i64 k = 0; k < n; k++) {
        const f64 *A = corners + 9 * k, *N = M + 3 * k;
        f64 out[3][3], middle[3];
        i64 from[3], to[3], c[3];
        for (int j = 0; j < 3; j++) {
            f64 low = fmin(A[j], fmin(A[3 + j], A[6 + j])) - margin[k], top = fmax(A[j], fmax(A[3 + j], A[6 + j])) + margin[k];
            from[j] = (i64)floor(low / cell), to[j] = (i64)floor(top / cell), middle[j] = (A[j] + A[3 + j] + A[6 + j]) / 3.0;
        }
        for (int e = 0; e < 3; e++) {  /* directions out of the triangle */
            f64 side[3], inward[3];
            for (int j = 0; j < 3; j++) side[j] = A[3 * ((e + 1) % 3) + j] - A[3 * e + j], inward[j] = middle[j] - A[3 * e + j];
            cross(side, N, out[e]);
            f64 length = sqrt(dot(out[e], out[e])) * (dot(out[e], inward) > 0.0 ? -1.0 : 1.0);
            for (int j = 0; j < 3; j++) out[e][j] = length != 0.0 ? out[e][j] / length : 0.0;
        }
        clear[k] = 1;
        for (c[0] = from[0]; c[0] <= to[0]; c[0]++)
            for (c[1] = from[1]; c[1] <= to[1]; c[1]++)
                for (c[2] = from[2]; c[2] <= to[2]; c[2]++) {
                    u64 key = cell_key(c) + 1, at = place_of_key(key) & ((u64)m - 1);
                    for (; keys[at]; at = (at + 1) & ((u64)m - 1)) {
                        const f32 *box = boxes + 6 * at;
                        f64 least, most, low, top;
                        if (keys[at] != key) continue;
                        heights(box, A, N, &least, &most);
                        int away = least > height[k] || most < 0.01 * height[k] + 1e-6 * cell;
                        for (int e = 0; e < 3; e++) heights(box, A + 3 * e, out[e], &low, &top), away |= low > margin[k];
                        if (!away) clear[k] = 0;
                    }
                }
    }
    return 0;
}

/* Fills how far (n,) records at P with normals M are from edges in the cells around them that rise more than `rise` of
   their distance above the plane of a record; 1e30: there are none. own (n,): the instance whose edges do not count,
   −1: all do. */
KERNEL(nearness_of,
       "cell f64  keys u64[m]  of i32[m]  boxes f32[m,6]  rise f64  P f64[n,3]  M f64[n,3]  own i32[n]  near f32[n]!"
       ";  power(m)  0<cell<inf")
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
