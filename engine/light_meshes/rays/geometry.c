/* Triangles in the world, and the surface at a hit (geometry.py). */
#include "geometry.h"

KERNEL(geometry_place, "vertices f32[n,3]  matrix f64[4,4]  out f64[n,3]!")
i64 geometry_place(i64 n, const f32 *vertices, const f64 *matrix, f64 *out) {
    for (i64 k = 0; k < n; k++)
        for (int r = 0; r < 3; r++) {
            const f64 *m = matrix + 4 * r;
            const f32 *v = vertices + 3 * k;
            out[3 * k + r] = m[0] * v[0] + m[1] * v[1] + m[2] * v[2] + m[3];
        }
    return 0;
}

/* Marks triangles that have an area. The comparison is also false if a vertex is not finite. */
KERNEL(geometry_usable, "vertices f32[v,3]  triangles i32[t,3]  out bool[t]!"
       ";  0<=triangles<v")
i64 geometry_usable(i64 v, i64 t, const f32 *vertices, const i32 *triangles, u8 *out) {
    (void)v;
    for (i64 k = 0; k < t; k++) {
        Edges s = edges_of(vertices, triangles + 3 * k);
        f64 n[3];
        cross(s.e, s.f, n);
        f64 size = dot(n, n);
        out[k] = size > 0.0 && size < INFINITY;
    }
    return 0;
}

/* Fills P … front for the triangles that rays hit, those of some rows or, if there are no rows, of all; u, v are Embree's,
   in float32. The intersection is computed again
   in float64 (Möller and Trumbore, 1997) and clamped to the triangle, so that P lies in its plane and on the ray. */
KERNEL(geometry_surface,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  instance i32[T]  source i32[T]  "
       "normal_matrix f64[I,3,3]  mirrored bool[I]  corner_normals f32[s,3,3]  uvs f32[x,3,2]  materials i32[s]  "
       "piece i32[y]  cut f64[z,3,2]  rows i64[n]?  triangle i32[m]  u f32[m]  v f32[m]  origin f64[m,3]  direction f64[m,3]  "
       "P f64[n,3]!  Ng f64[n,3]!  Ns f64[n,3]!  uv f32[n,2]!  material i32[n]!  hit i32[n]!  front bool[n]!"
       ";  x=0|x=s  y=0|y=T  0<=rows<m;  0<=triangles<V  0<=instance<I  0<=source<s  -1<=piece<z")
i64 geometry_surface(i64 V, i64 T, i64 I, i64 s, i64 x, i64 y, i64 z, i64 n, i64 m, const f64 *centre,
                     f64 scale, const f32 *vertices, const i32 *triangles, const i32 *instance, const i32 *source,
                     const f64 *normal_matrix, const u8 *mirrored, const f32 *corner_normals, const f32 *uvs,
                     const i32 *materials, const i32 *piece, const f64 *cut, const i64 *rows, const i32 *triangle,
                     const f32 *u, const f32 *v, const f64 *origin, const f64 *direction, f64 *P, f64 *Ng, f64 *Ns, f32 *uv,
                     i32 *material, i32 *hit, u8 *front) {
    (void)V, (void)I, (void)s, (void)z;
    if (!rows && m != n) return OUTSIDE;
    for (i64 k = 0; k < n; k++) {
        i64 ray = rows ? rows[k] : k, t = triangle[ray];
        if (t < 0 || t >= T) return OUTSIDE;
        i64 i = instance[t], of = source[t];
        const f64 *d = direction + 3 * ray;
        Edges edge = edges_of(vertices, triangles + 3 * t);
        f64 q[3], p[3], r[3], normal[3], shading[3], local[3];

        /* The intersection, again in float64 */
        for (int j = 0; j < 3; j++) q[j] = (origin[3 * ray + j] - centre[j]) / scale - edge.a[j];
        cross(d, edge.f, p), cross(q, edge.e, r);
        f64 determinant = dot(edge.e, p), ui = dot(q, p) / determinant, vi = dot(d, r) / determinant;
        /* the ray lies in the plane of the triangle */
        if (!(fabs(ui) <= 2.0 && fabs(vi) <= 2.0)) ui = u[ray], vi = v[ray];
        ui = ui < 0.0 ? 0.0 : ui > 1.0 ? 1.0 : ui;
        vi = vi < 0.0 ? 0.0 : vi > 1.0 ? 1.0 : vi;
        f64 sum = ui + vi;
        if (sum > 1.0) ui = ui / sum, vi = vi / sum;
        f64 wi = 1.0 - ui - vi;
        /* The point and the geometric normal */
        for (int j = 0; j < 3; j++) P[3 * k + j] = centre[j] + scale * (edge.a[j] + ui * edge.e[j] + vi * edge.f[j]);
        cross(edge.e, edge.f, normal);
        f64 length = sqrt(dot(normal, normal)), sign = mirrored[i] ? -1.0 : 1.0;
        f64 turn = sign * dot(normal, d) > 0.0 ? -1.0 : 1.0;  /* seen from behind, both normals are turned around */
        for (int j = 0; j < 3; j++) Ng[3 * k + j] = sign * turn * normal[j] / length;
        /* The shading normal and the UVs */
        if (y && piece[t] >= 0) {  /* convert to coordinates on the scene's whole triangle */
            const f64 *b = cut + 6 * (i64)piece[t];
            f64 whole_u = wi * b[0] + ui * b[2] + vi * b[4];
            vi = wi * b[1] + ui * b[3] + vi * b[5], ui = whole_u;
            wi = 1.0 - ui - vi;
        }
        const f32 *c = corner_normals + 9 * of;
        for (int j = 0; j < 3; j++) local[j] = wi * c[j] + ui * c[3 + j] + vi * c[6 + j];
        for (int j = 0; j < 3; j++) shading[j] = dot(normal_matrix + 9 * i + 3 * j, local);
        length = sqrt(dot(shading, shading));
        int usable = length > 0.0 && length < INFINITY;  /* otherwise the mesh has no usable normal here */
        for (int j = 0; j < 3; j++) Ns[3 * k + j] = usable ? turn * shading[j] / length : Ng[3 * k + j];
        for (int j = 0; j < 2 && x; j++) {
            const f32 *corner = uvs + 6 * of;
            uv[2 * k + j] = (f32)(wi * corner[j] + ui * corner[2 + j] + vi * corner[4 + j]);
        }
        material[k] = materials[of];
        hit[k] = (i32)t;
        front[k] = turn > 0.0;
    }
    return 0;
}
