/* A kernel of geometry.c that other files call, too. */
#pragma once
#include "triangles.h"

EXPORT i64 geometry_surface(i64 V, i64 T, i64 I, i64 s, i64 x, i64 y, i64 z, i64 n, i64 m, const f64 *centre, f64 scale,
                            const f32 *vertices, const i32 *triangles, const i32 *instance, const i32 *source,
                            const f64 *normal_matrix, const u8 *mirrored, const f32 *corner_normals, const f32 *uvs,
                            const i32 *materials, const i32 *piece, const f64 *cut, const i64 *rows, const i32 *triangle,
                            const f32 *u, const f32 *v, const f64 *origin, const f64 *direction, f64 *P, f64 *Ng, f64 *Ns,
                            f32 *uv, i32 *material, i32 *hit, u8 *front);
