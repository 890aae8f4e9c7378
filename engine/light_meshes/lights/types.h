/* All types of light: a header and a row of TYPES each, in the order of registry.py, those with axes of their own last.
   X(NAME, function, …) is expanded for each of them. */
#pragma once
#include "area.h"
#include "point.h"
#include "spot.h"
#include "sun.h"

#define TYPES(X, ...)                            \
    X(POINT, point_way, __VA_ARGS__)             \
    X(SUN, sun_way, __VA_ARGS__)                 \
    X(SPOT, spot_way, __VA_ARGS__)               \
    X(AREA, area_way, __VA_ARGS__)               \
    X(SKEWED_SPOT, skewed_spot_way, __VA_ARGS__) \
    X(SKEWED_AREA, skewed_area_way, __VA_ARGS__)

#define TYPE_NAME(name, way, ...) name,
enum { TYPES(TYPE_NAME, ) NO_TYPE };

/* `what` for the light's type, which thereby is a constant in it. */
#define OF_TYPE(name, way, what, ...) case name: what(name, __VA_ARGS__); break;
#define FOR_KIND(what, kind, ...) switch (kind) { TYPES(OF_TYPE, what, __VA_ARGS__) }

/* The way from a receiver to a light of this kind. */
#define WAY_CASE(name, way, ...) case name: return way(s, px, py, pz);
INLINE Way way_to_light(int kind, const Source *s, f64 px, f64 py, f64 pz) {
    switch (kind) { TYPES(WAY_CASE, ) }
    return (Way){0, 0.0, 0.0, 0.0, 0.0, 0.0};
}
