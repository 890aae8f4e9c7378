/* The semitransparent triangles in the order of their tree, "slots", and the bodies that they bound (media.py: Glass). */
#pragma once
#include "../rays/boxes.h"
#include "../rays/triangles.h"

static const f64 TOUCHING = 1e-9;  /* surfaces that are nearer than this along a ray are at the same place */
/* barycentric coordinates this far beyond [0, 1] still count as hits, so that no ray slips through */
static const f64 INSIDE = 1e-10;

/* Columns of `place`: the first vertex, edges from it, their duals (u = (P − A)·U), unit normal out of the body,
   three corner normals, t. Columns of `link`: body (−1: a sheet), instance, patch, whether the normal is NG, slots
   across the edges. */
enum { A = 0, E1 = 3, E2 = 6, U = 9, V = 12, NG = 15, NS = 18, KT = 27, PLACE = 30 };
enum { BODY, OWNER, PATCH, FLAT_SHADED, NEIGHBOUR, LINK = 7 };

typedef struct {
    i64 slots, bodies;
    const f64 *place;
    const i64 *link, *planar;
    const f64 *patch_size, *ior;
    const i64 *rank;
    const f64 *ball, *box;
    const i64 *child;
} Glass;

#define GLASS                                                                                                     \
    "place f64[m,30]  link i64[m,7]  planar i64[y]  patch_size f64[y]  ior f64[b]  rank i64[b]  ball f64[b,4]  "  \
    "box f64[d,6]  child i64[d,2]  "
#define OF_GLASS                                                                                                  \
    const f64 *place, const i64 *link, const i64 *planar, const f64 *patch_size, const f64 *ior, const i64 *rank, \
        const f64 *ball, const f64 *box, const i64 *child

static inline const f64 *place_of(const Glass *g, i64 slot) { return g->place + PLACE * slot; }
static inline i64 link_of(const Glass *g, i64 slot, int column) { return g->link[LINK * slot + column]; }

typedef struct {
    f64 t, u, v;
} Hit;

/* Returns where a ray enters a box; infinity if it does not. */
static inline f64 enter_box(const f64 *box, const f64 *P, const f64 *inverse, f64 t0, f64 t1) {
    for (int j = 0; j < 3; j++) {
        f64 a = (box[j] - P[j]) * inverse[j], b = (box[j + 3] - P[j]) * inverse[j];
        f64 low = b < a ? b : a, high = b > a ? b : a;
        t0 = low > t0 ? low : t0, t1 = high < t1 ? high : t1;
    }
    return t0 <= t1 ? t0 : INFINITY;
}

/* Returns the first slot that the ray (origin ray[0], direction ray[1]) hits with t0 < t < t1, −1 if there is none.
   Slots in `skip` are ignored. patch ≥ 0: only that patch counts, and only faces for which the product of outer
   normal and direction has the sign of `facing`. Of faces at the same place those through which the ray enters come
   first, so that bodies that touch leave no gap. */
static inline i64 closest(const Glass *g, const f64 ray[][3], f64 t0, f64 t1, const i64 *skip, i64 skips, i64 patch, f64 facing,
                   Hit *out) {
    i64 found = -1, top = 1, stack[STACK];
    f64 best = INFINITY, inverse[3];
    const f64 *P = ray[0], *d = ray[1];
    if (!g->slots) return -1;
    for (int j = 0; j < 3; j++) inverse[j] = d[j] != 0.0 ? 1.0 / d[j] : 1e300;
    stack[0] = 0;
    while (top) {
        i64 n = stack[--top], a = g->child[2 * n], count = g->child[2 * n + 1];

        /* A leaf: test its slots */
        for (i64 s = a; s < a + count; s++) {
            const f64 *p = place_of(g, s);
            f64 slope = d[0] * p[NG] + d[1] * p[NG + 1] + d[2] * p[NG + 2], x[3];
            if (slope == 0.0 || (patch >= 0 && (link_of(g, s, PATCH) != patch || slope * facing < 0.0))) continue;
            for (int j = 0; j < 3; j++) x[j] = P[j] - p[A + j];
            f64 t = -(x[0] * p[NG] + x[1] * p[NG + 1] + x[2] * p[NG + 2]) / slope;
            f64 order = slope > 0.0 ? t : t - TOUCHING;
            if (!(t > t0 && t < t1 && order < best)) continue;
            for (int j = 0; j < 3; j++) x[j] = x[j] + t * d[j];
            f64 u = x[0] * p[U] + x[1] * p[U + 1] + x[2] * p[U + 2], v = x[0] * p[V] + x[1] * p[V + 1] + x[2] * p[V + 2];
            if (u < -INSIDE || v < -INSIDE || u + v > 1.0 + INSIDE) continue;
            int known = 0;
            for (i64 k = 0; k < skips; k++) known |= skip[k] == s;
            if (!known) found = s, best = order, *out = (Hit){t, u, v};
        }
        if (count) continue;
        /* Two children: the nearer one first */
        f64 limit = best + TOUCHING < t1 ? best + TOUCHING : t1;
        f64 near_a = enter_box(g->box + 6 * a, P, inverse, t0, limit);
        f64 near_b = enter_box(g->box + 6 * (a + 1), P, inverse, t0, limit);
        if (near_a <= near_b) {
            if (near_b < INFINITY) stack[top++] = a + 1;
            if (near_a < INFINITY) stack[top++] = a;
        } else {
            if (near_a < INFINITY) stack[top++] = a;
            stack[top++] = a + 1;
        }
    }
    return found;
}
