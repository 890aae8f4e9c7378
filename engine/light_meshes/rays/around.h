/* Rays around points: directions over a half-space, turned to the normals there. */
#pragma once
#include "triangles.h"

typedef struct {
    f64 t[3], b[3], N[3], c, s;
} Turned;

/* The axes at a point with unit normal M. turn: the cosine and sine of an angle by which all is turned before; 0: none. */
static inline Turned turned_to(const f64 *M, const f64 *turn) {
    Turned a = {.c = turn ? turn[0] : 1.0, .s = turn ? turn[1] : 0.0};
    tangents(M, a.t, a.b);
    memcpy(a.N, M, sizeof a.N);
    return a;
}

static inline void along(const Turned *a, const f64 *local, f64 *direction) {
    f64 p = a->c * local[0] - a->s * local[1], q = a->s * local[0] + a->c * local[1];
    for (int j = 0; j < 3; j++) direction[j] = p * a->t[j] + q * a->b[j] + local[2] * a->N[j];
}
