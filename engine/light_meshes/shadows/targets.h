/* Where shadow rays go (rays/tracer.py: Targets): position (m,3) is a point, or for a sun the unit vector towards
   it. */
#pragma once
#include "../rays/triangles.h"

typedef struct {
    const f64 *position;
    const u8 *directional;
} Targets;

/* Computes the vector from P to target i, which is not normalised. */
static inline void way_to(const Targets *t, i64 i, const f64 *P, f64 *way) {
    for (int j = 0; j < 3; j++) way[j] = t->position[3 * i + j] - (t->directional[i] ? 0.0 : P[j]);
}

/* Returns N·ω for the unit vector ω from x towards `end`. */
static inline f64 cosine_towards(const f64 *end, const f64 *x, const f64 *N) {
    f64 d[3] = {end[0] - x[0], end[1] - x[1], end[2] - x[2]};
    return dot(d, N) / sqrt(dot(d, d));
}

/* Returns N·L_i at P. */
static inline f64 cosine_to(const Targets *t, i64 i, const f64 *P, const f64 *N) {
    return t->directional[i] ? dot(t->position + 3 * i, N) : cosine_towards(t->position + 3 * i, P, N);
}
