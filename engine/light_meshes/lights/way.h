/* A light, and the way to it from a receiver: what the headers of the types take and give. */
#pragma once
#include "native.h"

#define INLINE static inline __attribute__((always_inline))

/* One light. */
typedef struct {
    int kind, diffuse, glossy;
    f64 x, y, z, u, v, w, edge, slope, colour[3];  /* position; direction, unit, the way the light travels */
    const f64 *axes;
} Source;

/* What comes along the way (x, y, z) towards the light: whether any, f_att, and 1/|way|. `lit` is as wide as the
   numbers: vectors of both have the same length. */
typedef struct {
    i64 lit;
    f64 power, inverse, x, y, z;
} Way;

/* From a place: 1/d². */
INLINE Way from_place(const Source *s, f64 px, f64 py, f64 pz) {
    Way way = {1, 1.0, 1.0, s->x - px, s->y - py, s->z - pz};
    f64 square = way.x * way.x + way.y * way.y + way.z * way.z;
    way.inverse = 1.0 / sqrt(square);
    way.power = way.inverse * way.inverse;
    way.lit = square > 0.0;  /* else the light is on the very point */
    return way;
}

/* The cosine between the light's axis and the way back from it. */
INLINE f64 cosine_of_axis(const Source *s, const Way *way) {
    return -(way->x * s->u + way->y * s->v + way->z * s->w) * way->inverse;
}

/* The way back, by the axes of a light that is scaled unevenly or sheared, along the third of which it looks. Returns
   1/its length. */
INLINE f64 by_axes(const Source *s, const Way *way, f64 *p, f64 *q, f64 *r) {
    const f64 *a = s->axes, *c = s->axes + 3, *e = s->axes + 6;
    *p = way->x * a[0] + way->y * a[1] + way->z * a[2];
    *q = way->x * c[0] + way->y * c[1] + way->z * c[2];
    *r = way->x * e[0] + way->y * e[1] + way->z * e[2];
    return 1.0 / sqrt(*p * *p + *q * *q + *r * *r);
}
