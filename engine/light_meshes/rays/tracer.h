/* Where rays leave their surfaces, in the tracer's frame (tracer.py). */
#pragma once
#include "native.h"

static const f64 ULPS = 16 * 0x1p-23;  /* how far, and how far a closed end reaches, where the frame is 1 */

static inline f64 most(f64 a, f64 b) { return b > a ? b : a; }

/* How far a ray at this place of the frame leaves its surface: as many ulps of the place, and at least of 1. */
static inline f64 clearance(f64 x, f64 y, f64 z) { return ULPS * most(most(1.0, fabs(x)), most(fabs(y), fabs(z))); }

/* Kernels of tracer.c that embree.c calls, too. */
i64 tracer_rays(i64 n, const f64 *centre, f64 scale, f64 reach, const f64 *origin, const f64 *direction,
                const f64 *normal, const f64 *length, f32 *o, f32 *d, f32 *t);
i64 tracer_segments(i64 m, i64 n, i64 q, const f64 *centre, f64 scale, f64 reach, const f64 *origin, const f64 *normal,
                    const i32 *origin_of, const f64 *position, const u8 *directional, const i32 *target_of, i64 closed,
                    f32 *o, f32 *d, f32 *t);
