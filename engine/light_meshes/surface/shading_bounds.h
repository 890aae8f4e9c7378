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

/* A block as a whole: its `Bounds` by geometric and by shading normals, and the bits `returns` that any receiver has, and
   that all have. */
typedef struct {
    Bounds flat, shaded;
    u64 any, common;
} Whole;

static Whole whole_of(const Block *b) {
    Whole w = {bounds_of(b->P, b->Ng), bounds_of(b->P, b->Ns), 0, ~(u64)0};
    for (int k = 0; k < SIDE; k++) w.any |= b->returns[k], w.common &= b->returns[k];
    return w;
}

/* Does what `mark` does (shading.c), but for all receivers of a block in one step, where they are all in front of the light
   or all behind it. Returns 0 where that is not certain, or where more than the side counts: the cone of a spot, or a
   highlight of Phong, which also shines where the shading normal faces away. every: bits of lights that all receivers
   have. */
static int mark_whole(const Source *s, u64 own, u64 colour, i64 unlit, const Whole *w, const Block *b, u64 *every, u64 *bits) {
    const int sun = s->kind == SUN;
    const f64 L[3] = {sun ? -s->u : s->x, sun ? -s->v : s->y, sun ? -s->w : s->z};
    u64 facing = (s->diffuse ? colour : 0) | (s->glossy ? colour << 6 : 0);
    if (!sun && s->kind != POINT && s->kind != SPOT && s->kind != AREA) return 0;
    int above = side_of(&w->flat, L, !sun), front;
    if (above < 0) return 1;
    if (above == 0 || s->kind == SPOT || s->kind == AREA) return 0;
    if (unlit) {
        *every |= own;
        return 1;
    }
    if ((w->any & PHONG && s->glossy) || !(front = side_of(&w->shaded, L, !sun))) return 0;
    if (front > 0 && w->common & facing) *every |= own;
    else
        for (int k = 0; front > 0 && k < SIDE; k++) bits[k] |= b->returns[k] & facing ? own : 0;
    return 1;
}
