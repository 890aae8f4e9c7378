/* The distance by which rays start away from their surfaces, in the tracer's frame (tracer.py). */
#pragma once
#include "native.h"

/* this distance, and how far beyond a closed end rays go, for a place of size 1 in the frame */
static const f64 ULPS = 16 * 0x1p-23;

static inline f64 most(f64 a, f64 b) { return b > a ? b : a; }

/* Returns the distance by which a ray at this place of the frame starts from its surface: 16 ulps of the largest
   coordinate, or of 1 if that is larger. */
static inline f64 clearance(f64 x, f64 y, f64 z) { return ULPS * most(most(1.0, fabs(x)), most(fabs(y), fabs(z))); }

/* a ray to a light ends a little before it, so that a light on a surface is not shadowed by it */
static const f64 LIGHT_END = 1 - 1e-5;

/* Finds where a ray from the place `from` starts: away from its surface along `normal`, NULL: there is none. */
static inline void start_of(const f64 *centre, f64 scale, f64 reach, const f64 *from, const f64 *normal, f32 *start) {
    f64 x[3], off = ULPS;
    for (int j = 0; j < 3; j++) x[j] = (from[j] - centre[j]) / scale;
    if (reach > 1.0) off = clearance(x[0], x[1], x[2]);
    for (int j = 0; j < 3; j++) {
        if (normal) x[j] += normal[j] * off;
        start[j] = (f32)x[j];
    }
}

/* Finds where rays to a target end: a place in the frame, or the direction of a sun. */
static inline void end_of(const f64 *centre, f64 scale, const f64 *target, int directional, f64 *end) {
    for (int j = 0; j < 3; j++) end[j] = directional ? target[j] : (target[j] - centre[j]) / scale;
}

/* Finds the way of a ray from `start` to `end`; returns how many times as far it goes. closed: a surface that touches the
   target counts too. */
static inline f32 way_to(const f32 *start, const f64 *end, int directional, f64 reach, i64 closed, f32 *way) {
    if (directional) {
        /* Everything lies in [−reach, reach]³, so a ray of this length passes all of it, wherever it starts. */
        f64 length = 4.0 * reach + fabs((f64)start[0]) + fabs((f64)start[1]) + fabs((f64)start[2]);
        f32 t = 1.0f;
        /* with long directions products would exceed the range of float32 */
        if (reach > 1.0) t = (f32)length, length = 1.0;
        for (int j = 0; j < 3; j++) way[j] = (f32)(length * end[j]);
        return t;
    }
    for (int j = 0; j < 3; j++) way[j] = (f32)(end[j] - (f64)start[j]);
    if (!closed) return (f32)LIGHT_END;
    f64 square_of = 0.0, at = 1.0;
    for (int j = 0; j < 3; j++) {
        if (reach > 1.0) at = most(at, fabs(end[j]));
        square_of += (f64)way[j] * way[j];
    }
    return (f32)(square_of > 0.0 ? 1.0 + ULPS * at / sqrt(square_of) : 1.0);
}

/* Kernels of tracer.c that other files call, too. */
EXPORT i64 tracer_rays(i64 n, const f64 *centre, f64 scale, f64 reach, const f64 *origin, const f64 *direction,
                       const f64 *normal, const f64 *length, f32 *o, f32 *d, f32 *t);
EXPORT i64 tracer_segments(i64 m, i64 n, i64 q, const f64 *centre, f64 scale, f64 reach, const f64 *origin,
                           const f64 *normal, const i32 *origin_of, const f64 *position, const u8 *directional,
                           const i32 *target_of, i64 closed, f32 *o, f32 *d, f32 *t);
EXPORT i64 tracer_cross(i64 v, i64 t, i64 n, const f32 *vertices, const i32 *triangles, const i32 *instance,
                        const i32 *triangle, const f64 *start, const f64 *end, f32 *o, f32 *d, f32 *length, f64 *passed,
                        i32 *last, i32 *near, u8 *new, f64 *until);
