/* AREA: a face that shines to one side (area.py). edge: tangent of half the spread; slope: keeps its power, 0: no spread.
*/
#pragma once
#include "way.h"

/* Dims the way by the spread, at this cosine from the axis. */
INLINE void in_spread(const Source *s, f64 axis, Way *way) {
    f64 sine = 1.0 - axis * axis;
    f64 spread = (s->edge - sqrt(sine > 0.0 ? sine : 0.0) / axis) * s->slope;
    spread = s->slope > 0.0 ? spread : 1.0;
    way->lit &= (axis > 0.0) & (spread > 0.0);  /* else behind the lamp, or beside its spread */
    way->power *= spread > 0.0 ? spread : 0.0;
}

INLINE Way area_way(const Source *s, f64 px, f64 py, f64 pz) {
    Way way = from_place(s, px, py, pz);
    f64 axis = cosine_of_axis(s, &way);
    way.power *= axis > 0.0 ? axis : 0.0;
    in_spread(s, axis, &way);
    return way;
}

/* With axes of its own. Cycles samples a rectangle as if its axes were perpendicular: the light comes from another
   direction. */
INLINE Way skewed_area_way(const Source *s, f64 px, f64 py, f64 pz) {
    Way way = from_place(s, px, py, pz);
    f64 p, q, r, turned = by_axes(s, &way, &p, &q, &r);
    const f64 *a = s->axes, *c = s->axes + 3, *e = s->axes + 6;
    way.lit &= cosine_of_axis(s, &way) > 0.0;
    way.x = p * a[0] + q * c[0] + r * e[0];
    way.y = p * a[1] + q * c[1] + r * e[1];
    way.z = p * a[2] + q * c[2] + r * e[2];
    way.inverse = 1.0 / sqrt(way.x * way.x + way.y * way.y + way.z * way.z);
    way.power = turned * turned * turned * fabs(r);
    way.lit &= way.power > 0.0;
    in_spread(s, cosine_of_axis(s, &way), &way);
    return way;
}
