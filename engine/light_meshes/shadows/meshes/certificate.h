/* What the kernels of the certificate share: planes of triangles, and a hash table (certificate.py). Coordinates are those of
   the tracer's frame. */
#pragma once
#include "../../rays/triangles.h"

#define ULP 0x1p-23
#define FLAT ULP  /* how far a triangle's vertices may be from its plane, because they are rounded */
/* the ratio of a triangle's height to its length; for thinner ones Embree's plane may be a different one */
#define NEEDLE 1e-4
enum { GROUP = 8, MOST = 512 };
enum { ABOVE = 1, BELOW = 2, UNSURE = 255 };
enum { SEVERAL = -2, UNKNOWN = -3, NONE = -4 };

#define SURFACES "vertices f32[v,3]  triangles i32[t,3]  "

static inline f64 least(f64 a, f64 b) { return b < a ? b : a; }
static inline f64 most(f64 a, f64 b) { return b > a ? b : a; }

/* The unit normal and the offset of a triangle's plane, and the ratio of its height to its length. */
typedef struct {
    f64 n[3], d, height;
} Plane;

static inline Plane plane_of(const f32 *vertices, const i32 *triangle) {
    Edges s = edges_of(vertices, triangle);
    f64 g[3] = {s.e[0] - s.f[0], s.e[1] - s.f[1], s.e[2] - s.f[2]};
    Plane p;
    cross(s.e, s.f, p.n);
    f64 length = sqrt(dot(p.n, p.n));
    for (int j = 0; j < 3; j++) p.n[j] /= length;
    p.d = dot(p.n, s.a);
    p.height = length / most(most(dot(s.e, s.e), dot(s.f, s.f)), dot(g, g));
    return p;
}

static inline f64 height_above(const Plane *p, const f32 *vertex) {
    return p->n[0] * vertex[0] + p->n[1] * vertex[1] + p->n[2] * vertex[2] - p->d;
}

/* Returns the slot of a key in a hash table of cells or planes; −1 marks a free slot. */
static inline i64 slot_of(i64 size, const i64 *keys, i64 key) {
    u64 mask = (u64)size - 1, x = (u64)key * SPREAD, slot = (x ^ x >> 32) & mask;
    while (keys[slot] != key && keys[slot] >= 0) slot = (slot + 1) & mask;
    return (i64)slot;
}

/* Enters all keys of a table, with their values, into a larger one that is empty. */
EXPORT i64 certificate_grown(i64 n, i64 m, const i64 *keys, const i32 *values, i64 *more, i32 *moved);
