/* How far receivers on smooth surfaces are lifted above their facets (terminator.py). */
#pragma once
#include "../rays/triangles.h"

/* Returns how far a receiver is lifted for the light that is at `way` from it, 0 to 1: fully if its facet, with the normal
   N, turns away from it. side: the normal of the smooth surface. */
static inline f64 lift_share(f64 cutoff, const f64 *way, const f64 *N, const f64 *side) {
    f64 square_of = dot(way, way), toward = dot(way, N), over = dot(way, side);
    f64 beyond = cutoff * cutoff * square_of * 1.000001;  /* both cosines are above the cutoff, as mostly: no root is needed */
    if ((toward > 0.0) & (over > 0.0) & (toward * toward > beyond) & (over * over > beyond)) return 0.0;
    if (toward < 0.0) return 1.0;  /* in both of the cases below */
    f64 length = sqrt(square_of), facet = toward / length, smooth = over / length;
    f64 most = smooth < cutoff ? 2.0 - (facet + smooth) / cutoff : 1.0 - facet / cutoff;
    return most < 0.0 ? 0.0 : most > 1.0 ? 1.0 : most;
}
