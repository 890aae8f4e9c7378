/* Weights of nodes. */
#pragma once
#include "native.h"

/* SMOOTH: the weight of a node at |x − P|² = square·r²; 0 at r, but never 0: a node that counts alone counts. */
static inline f64 falloff(f64 square) { return 1.0 - square > 1e-9 ? 1.0 - square : 1e-9; }
