/* SUN: the same light comes everywhere from one direction (sun.py). */
#pragma once
#include "way.h"

INLINE Way sun_way(const Source *s, f64 px, f64 py, f64 pz) {
    (void)px, (void)py, (void)pz;
    return (Way){1, 1.0, 1.0, -s->u, -s->v, -s->w};
}
