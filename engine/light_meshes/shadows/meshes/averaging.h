/* Weights of nodes, and the lights for which their values are needed. */
#pragma once
#include "native.h"

/* Returns the weight (SMOOTH) of a node at |x − P|² = square·r². It falls to 0 at r, but never becomes 0, so that a
   single node still counts. */
static inline f64 falloff(f64 square) { return 1.0 - square > 1e-9 ? 1.0 - square : 1e-9; }

/* Adds the lights of a receiver, `soft`, to what is needed of its candidates, ring by ring. start: its row. */
static inline void ask_for(const i64 *start, const i32 *candidate, const u64 *soft, const u64 *serve, i64 K, i64 W, u64 *need) {
    for (i64 w = 0; w < W; w++)
        for (i64 g = 0; g < K; g++) {
            u64 lights = soft[w] & serve[g * W + w];
            if (!lights) continue;
            for (i64 at = start[g]; at < start[g + 1]; at++) need[candidate[at] * W + w] |= lights;
        }
}
