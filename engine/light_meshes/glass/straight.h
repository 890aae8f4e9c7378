/* Kernels of this room that `straight.c` calls, too, for one ray. */
#pragma once
#include "../rays/triangles.h"

enum { STATE = 12 };  /* numbers for each ray; aside.c has what they are */

EXPORT i64 interfaces_factor(i64 T, i64 s, i64 p, i64 x, i64 m, i64 i, i64 j, i64 n, const i32 *source, const i32 *materials,
                             const i32 *piece, const f32 *uvs, const f64 *alpha, const f64 *kt, const i32 *image,
                             const u8 *asked, const i64 *images, const i32 *triangle, const f32 *u, const f32 *v,
                             f32 *factor, u8 *left);
EXPORT i64 aside_cross(i64 T, i64 b, i64 M, i64 n, i64 m, const i32 *of, const u8 *inside_out, const f64 *ior,
                       const f64 *index, const u8 *by_fresnel, const i32 *triangle, const i32 *material, const u8 *front,
                       const f64 *Ns, const f64 *way, const f64 *left, const i64 *row, f64 *state);
EXPORT i64 aside_dim(i64 m, const f64 *state, const f64 *radius, f64 least, f32 *through);
