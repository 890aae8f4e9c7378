/* Where rays leave their surfaces, in the tracer's frame (tracer.py). */
#pragma once
#include "native.h"

static const f64 ULPS = 16 * 0x1p-23;  /* how far, and how far a closed end reaches, where the frame is 1 */

static inline f64 most(f64 a, f64 b) { return b > a ? b : a; }

/* How far a ray at this place of the frame leaves its surface: as many ulps of the place, and at least of 1. */
static inline f64 clearance(f64 x, f64 y, f64 z) { return ULPS * most(most(1.0, fabs(x)), most(fabs(y), fabs(z))); }
