/* Grids on triangles: which points of one a place lies between, and the numbers (keys) of these points (grids.py). */
#pragma once
#include "../rays/triangles.h"

#define FINEST 13                       /* an edge is divided into up to 2^13 parts */
#define CORNER ((u64)1 << 63)           /* the key of a corner that several triangles share, by the number of its class */
#define UPPER ((u64)1 << 62)            /* of patches: the small triangle that points the other way */

static inline u64 key_at(i64 triangle, int front, int depth, i64 i, i64 j) {
    return (u64)triangle | (u64)front << 31 | (u64)depth << 32 | (u64)i << 36 | (u64)j << 49;
}

/* How often edges are halved until none is longer than `size`. */
static inline int halvings(f64 longest, f64 size) {
    int depth = 0;
    while (longest > size && depth < FINEST) longest *= 0.5, depth++;
    return depth;
}

/* The small triangle of a grid with 2^depth parts at each edge in which the barycentrics u, v lie. */
typedef struct {
    i64 i, j;
    int upper;
    f64 x, y;  /* within the square of the grid */
} Small;

static inline Small small_at(f64 u, f64 v, int depth) {
    i64 parts = (i64)1 << depth;
    u = u < 0.0 ? 0.0 : u > 1.0 ? 1.0 : u, v = v < 0.0 ? 0.0 : v > 1.0 - u ? 1.0 - u : v;
    f64 x = u * (f64)parts, y = v * (f64)parts;
    i64 i = (i64)x, j = (i64)y;
    if (i > parts - 1) i = parts - 1;
    if (j > parts - 1 - i) j = parts - 1 - i;
    x -= (f64)i, y -= (f64)j;
    int upper = x + y > 1.0 && i + j + 2 <= parts;
    if (!upper && x + y > 1.0) {  /* rounding, at the long edge */
        f64 sum = x + y;
        x /= sum, y /= sum;
    }
    return (Small){i, j, upper, x, y};
}
