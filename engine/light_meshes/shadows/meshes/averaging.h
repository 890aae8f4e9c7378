/* Weights of nodes. */
#pragma once
#include "native.h"

/* Returns the weight (SMOOTH) of a node at |x − P|² = square·r². It falls to 0 at r, but never becomes 0, so that a
   single node still counts. */
static inline f64 falloff(f64 square) { return 1.0 - square > 1e-9 ? 1.0 - square : 1e-9; }
