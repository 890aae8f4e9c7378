/* The points of triangles' grids around receivers (grids.py). */
#include "grids.h"

/* Fills the keys of the three grid points around each receiver, their weights, and how far apart they are.
   level: how much finer the grids are than the coarsest. front: whether the receiver is on the side that the normal of
   its triangle looks to. */
KERNEL(grids_around,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  flipped bool[T]  longest f32[T]  corner i32[T,3]  "
       "coarse f64  level i64  triangle i32[n]  P f64[n,3]  Ng f64[n,3]  keys u64[n,3]!  weight f64[n,3]!  spacing f64[n]!")
i64 grids_around(i64 V, i64 T, i64 n, const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangles,
                 const u8 *flipped, const f32 *longest, const i32 *corner, f64 coarse, i64 level, const i32 *triangle,
                 const f64 *P, const f64 *Ng, u64 *keys, f64 *weight, f64 *spacing) {
    (void)V, (void)T;
    for (i64 k = 0; k < n; k++) {
        i64 t = triangle[k];
        Edges s = edges_of(vertices, triangles + 3 * t);
        f64 q[3], normal[3], a[3], b[3];
        for (int j = 0; j < 3; j++) q[j] = (P[3 * k + j] - centre[j]) / scale - s.a[j];
        cross(s.e, s.f, normal), cross(q, s.f, a), cross(s.e, q, b);
        f64 square_of = dot(normal, normal), u = dot(a, normal) / square_of, v = dot(b, normal) / square_of;
        int front = (dot(normal, Ng + 3 * k) > 0.0) != flipped[t];
        int depth = halvings(longest[t], coarse) + (int)level;
        if (depth > FINEST) depth = FINEST;
        Small at = small_at(u, v, depth);
        i64 i = at.i, j = at.j;
        u64 *key = keys + 3 * k;
        f64 *w = weight + 3 * k;
        spacing[k] = ldexp(longest[t], -depth);
        if (depth == 0) {
            for (int c = 0; c < 3; c++) {
                i64 of = corner[3 * t + c];
                key[c] = of >= 0 ? CORNER | (u64)front << 31 | (u64)of : key_at(t, front, 0, c == 1, c == 2);
            }
        } else if (at.upper) {
            key[0] = key_at(t, front, depth, i + 1, j + 1);
            key[1] = key_at(t, front, depth, i, j + 1), key[2] = key_at(t, front, depth, i + 1, j);
        } else {
            key[0] = key_at(t, front, depth, i, j);
            key[1] = key_at(t, front, depth, i + 1, j), key[2] = key_at(t, front, depth, i, j + 1);
        }
        if (at.upper) w[0] = at.x + at.y - 1.0, w[1] = 1.0 - at.x, w[2] = 1.0 - at.y;
        else w[0] = 1.0 - at.x - at.y, w[1] = at.x, w[2] = at.y;
    }
    return 0;
}
