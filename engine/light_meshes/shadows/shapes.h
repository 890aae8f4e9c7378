/* Shapes of lamps (lamp_points.py): a disc of radius `size` that turns to who looks, or of a sun at distance 1; a rectangle or
   an ellipse with the half-axes u, v; a sphere of radius `size`. */
#pragma once
#include "../support/native.h"

enum { FREE, RECTANGLE, ELLIPSE, BALL };

static inline int has_face(i64 shape) { return shape == RECTANGLE || shape == ELLIPSE; }
