/* On which side of the surfaces of a whole block of receivers a light is, without a look at each of them (shading.c). */
#pragma once
#include "shading_block.h"

/* Normals N of a block and the planes through its receivers P that they are normal to: the range of N in each axis, that
   of N·P, and the largest |N| and |P| in each axis. known: whether all of these are numbers. */
typedef struct {
    f64 low[3], high[3], nearest, farthest, steepest[3], outermost[3];
    int known;
} Bounds;

static Bounds bounds_of(const f64 (*P)[SIDE], const f64 (*N)[SIDE]) {
    Bounds b = {.nearest = INFINITY, .farthest = -INFINITY};
    f64 sum = 0.0;
    for (int j = 0; j < 3; j++) {
        f64 low = INFINITY, high = -INFINITY, outermost = 0.0;
        for (int k = 0; k < SIDE; k++) {
            f64 n = N[j][k], away = fabs(P[j][k]);
            low = n < low ? n : low, high = n > high ? n : high;
            outermost = away > outermost ? away : outermost;
        }
        b.low[j] = low, b.high[j] = high, b.outermost[j] = outermost;
        b.steepest[j] = fabs(low) > fabs(high) ? fabs(low) : fabs(high);
    }
    for (int k = 0; k < SIDE; k++) {
        f64 d = N[0][k] * P[0][k] + N[1][k] * P[1][k] + N[2][k] * P[2][k];
        b.nearest = d < b.nearest ? d : b.nearest, b.farthest = d > b.farthest ? d : b.farthest;
        sum += d;
    }
    b.known = fabs(sum) < INFINITY;
    return b;
}

/* Returns 1 if N·way > 0 for the whole block, −1 if for none of it, 0 if that is not certain. way: L − P for a light at
   the place L, and L itself where it is a direction. What is left out for rounding is some hundred times as much. */
static int side_of(const Bounds *b, const f64 *L, int place) {
    f64 low = place ? -b->farthest : 0.0, high = place ? -b->nearest : 0.0, rounding = 0.0;
    for (int j = 0; j < 3; j++) {
        f64 x = b->low[j] * L[j], y = b->high[j] * L[j];
        low += x < y ? x : y, high += x < y ? y : x;
        rounding += 1e-13 * b->steepest[j] * (fabs(L[j]) + b->outermost[j]);
    }
    return !b->known ? 0 : low > rounding ? 1 : high < -rounding ? -1 : 0;
}

/* What is known of a light and a whole block. NONE_LIT: it is behind all surfaces. ALL_FACING: it is in front of all of
   them, and nothing dims it to 0. NONE_FACING: likewise, but the shading normals turn away from it. */
enum { UNSURE_LIT, NONE_LIT, ALL_FACING, NONE_FACING };

/* Says so. flat, shaded: `Bounds` of the geometric and of the shading normals. */
static int lit_of(const Source *s, const Bounds *flat, const Bounds *shaded) {
    const int sun = s->kind == SUN;
    const f64 L[3] = {sun ? -s->u : s->x, sun ? -s->v : s->y, sun ? -s->w : s->z};
    if (!sun && s->kind != POINT && s->kind != SPOT && s->kind != AREA) return UNSURE_LIT;
    int above = side_of(flat, L, !sun);
    if (above < 0) return NONE_LIT;
    if (above == 0 || s->kind == SPOT || s->kind == AREA) return UNSURE_LIT;
    int facing = side_of(shaded, L, !sun);
    return facing > 0 ? ALL_FACING : facing < 0 ? NONE_FACING : UNSURE_LIT;
}
