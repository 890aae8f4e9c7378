/* The distance by which rays start away from their surfaces, in the tracer's frame (tracer.py). */
#pragma once
#include "native.h"

/* this distance, and how far beyond a closed end rays go, for a place of size 1 in the frame */
static const f64 ULPS = 16 * 0x1p-23;

static inline f64 most(f64 a, f64 b) { return b > a ? b : a; }

/* Returns the distance by which a ray at this place of the frame starts from its surface: 16 ulps of the largest
   coordinate, or of 1 if that is larger. */
static inline f64 clearance(f64 x, f64 y, f64 z) { return ULPS * most(most(1.0, fabs(x)), most(fabs(y), fabs(z))); }
