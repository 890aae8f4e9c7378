/* SPOT: a cone with a soft edge (spot.py). edge: cosine of half the cone; slope: 1/width of the blend in cosines. */
#pragma once
#include "way.h"

/* Dims the way by the cone, at this cosine from its axis. */
INLINE void in_cone(const Source *s, f64 axis, Way *way) {
    f64 t = (axis - s->edge) * s->slope;
    t = t > 0.0 ? t : 0.0;
    t = t < 1.0 ? t : 1.0;
    way->lit &= t > 0.0;
    way->power *= t * t * (3.0 - 2.0 * t);
}

INLINE Way spot_way(const Source *s, f64 px, f64 py, f64 pz) {
    Way way = from_place(s, px, py, pz);
    in_cone(s, cosine_of_axis(s, &way), &way);
    return way;
}

/* With axes of its own: the cone is that of a plain one along (ω·a₁, ω·a₂, ω·a₃). */
INLINE Way skewed_spot_way(const Source *s, f64 px, f64 py, f64 pz) {
    Way way = from_place(s, px, py, pz);
    f64 p, q, r, turned = by_axes(s, &way, &p, &q, &r);
    in_cone(s, -r * turned, &way);
    return way;
}
