/* The distance by which rays start away from their surfaces, in the tracer's frame (tracer.py). */
#pragma once
#include "native.h"

/* this distance, and how far beyond a closed end rays go, for a place of size 1 in the frame */
static const f64 ULPS = 16 * 0x1p-23;

static inline f64 most(f64 a, f64 b) { return b > a ? b : a; }

/* Returns the distance by which a ray at this place of the frame starts from its surface: 16 ulps of the largest
   coordinate, or of 1 if that is larger. */
static inline f64 clearance(f64 x, f64 y, f64 z) { return ULPS * most(most(1.0, fabs(x)), most(fabs(y), fabs(z))); }

/* Kernels of tracer.c that embree.c calls, too. */
i64 tracer_rays(i64 n, const f64 *centre, f64 scale, f64 reach, const f64 *origin, const f64 *direction,
                const f64 *normal, const f64 *length, f32 *o, f32 *d, f32 *t);
i64 tracer_segments(i64 m, i64 n, i64 q, const f64 *centre, f64 scale, f64 reach, const f64 *origin, const f64 *normal,
                    const i32 *origin_of, const f64 *position, const u8 *directional, const i32 *target_of, i64 closed,
                    f32 *o, f32 *d, f32 *t);
