/* How curved surfaces are, by the normals at the corners of triangles (curvature.py). */
#include "../rays/triangles.h"

/* Fills by how much the shading normal of each triangle turns on the way along an edge, at most: radians a scene unit,
   0 where its corners have no normals. */
KERNEL(curvature_of,
       "scale f64  vertices f32[V,3]  triangles i32[T,3]  instance i32[T]  source i32[T]  normals f32[S,3,3]  "
       "matrix f64[I,3,3]  curvature f32[T]!"
       ";  0<=triangles<V  0<=instance<I  0<=source<S")
i64 curvature_of(i64 V, i64 T, i64 S, i64 I, f64 scale, const f32 *vertices, const i32 *triangles, const i32 *instance,
                 const i32 *source, const f32 *normals, const f64 *matrix, f32 *curvature) {
    (void)V, (void)S, (void)I;
    for (i64 t = 0; t < T; t++) {
        const f64 *to_world = matrix + 9 * (i64)instance[t];
        f64 N[3][3], most = 0.0;
        for (int c = 0; c < 3; c++) {
            const f32 *local = normals + 9 * (i64)source[t] + 3 * c;
            f64 length = 0.0;
            for (int j = 0; j < 3; j++) {
                N[c][j] = to_world[3 * j] * local[0] + to_world[3 * j + 1] * local[1] + to_world[3 * j + 2] * local[2];
                length += square(N[c][j]);
            }
            for (int j = 0; j < 3; j++) N[c][j] /= sqrt(length);  /* without a normal: not a number, which is no more */
        }
        for (int c = 0; c < 3; c++) {
            const f32 *p = vertices + 3 * (i64)triangles[3 * t + c], *q = vertices + 3 * (i64)triangles[3 * t + (c + 1) % 3];
            f64 way = square((f64)p[0] - q[0]) + square((f64)p[1] - q[1]) + square((f64)p[2] - q[2]);
            f64 turn = squared_distance(N[c], N[(c + 1) % 3]) / way;
            if (turn > most) most = turn;
        }
        f64 found = sqrt(most) / scale;
        curvature[t] = (f32)(found < 1e30 ? found : 1e30);
    }
    return 0;
}
