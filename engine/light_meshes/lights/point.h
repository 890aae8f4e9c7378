/* POINT: shines alike in all directions (point.py). */
#pragma once
#include "way.h"

INLINE Way point_way(const Source *s, f64 px, f64 py, f64 pz) { return from_place(s, px, py, pz); }
