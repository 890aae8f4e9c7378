/* Triangles of `Surfaces` (geometry.py): vertices (V,3) float32 in the frame, triangles (T,3). */
#pragma once
#include "native.h"

/* A corner and the two edges from it, in float64. */
typedef struct {
    f64 a[3], e[3], f[3];
} Edges;

static inline Edges edges_of(const f32 *vertices, const i32 *triangle) {
    Edges s;
    for (int j = 0; j < 3; j++) {
        s.a[j] = vertices[3 * (i64)triangle[0] + j];
        s.e[j] = (f64)vertices[3 * (i64)triangle[1] + j] - s.a[j];
        s.f[j] = (f64)vertices[3 * (i64)triangle[2] + j] - s.a[j];
    }
    return s;
}

static inline f64 dot(const f64 *a, const f64 *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void cross(const f64 *a, const f64 *b, f64 *out) {
    out[0] = a[1] * b[2] - a[2] * b[1], out[1] = a[2] * b[0] - a[0] * b[2], out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Two unit vectors square to the unit normal, which depend on nothing else. */
static inline void tangents(const f64 *M, f64 *t, f64 *b) {
    const f64 up[3] = {0, 0, 1}, side[3] = {1, 0, 0};
    cross(fabs(M[2]) < 0.9 ? up : side, M, t);
    f64 length = sqrt(dot(t, t));
    for (int j = 0; j < 3; j++) t[j] /= length;
    cross(M, t, b);
}
