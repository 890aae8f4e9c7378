/* Grids on triangles: which points of one a place lies between, and the numbers (keys) of points and cells (grids.py).

   A grid has axes U and V and parts each of them, so that cells are about square. Two triangles that make up a
   parallelogram share one: its sides are the axes. The axes of any other triangle are its longest edge and its height;
   points of the grid outside of the triangle stand for the nearest ones on it. */
#pragma once
#include "../rays/triangles.h"

#define PARTS 8191                      /* an axis is divided into up to so many parts */
#define CORNER ((u64)1 << 63)           /* the key of a corner that several triangles share, by the number of its class */
#define INSET 0.012                     /* points are moved by this share of their distance, towards the middle: none
                                           lies in the plane of a wall that stands on its triangle */

static inline u64 key_at(i64 triangle, int front, int level, i64 i, i64 j) {
    return (u64)triangle | (u64)front << 31 | (u64)level << 32 | (u64)i << 36 | (u64)j << 49;
}

typedef struct {
    i64 triangle, i, j;
    int front, level;
} Key;

static inline Key key_of(u64 key) {
    return (Key){(i64)(key & 0x7FFFFFFF), (i64)(key >> 36 & 0x1FFF), (i64)(key >> 49 & 0x1FFF), (int)(key >> 31 & 1),
                 (int)(key >> 32 & 15)};
}

/* The corner of a triangle that is opposite to its longest edge, and the square of the length of that. */
static inline int opposite(const f32 *vertices, const i32 *triangle, f64 *longest) {
    int found = 0;
    *longest = -1.0;
    for (int c = 0; c < 3; c++) {
        const f32 *p = vertices + 3 * (i64)triangle[(c + 1) % 3], *q = vertices + 3 * (i64)triangle[(c + 2) % 3];
        f64 length = square((f64)p[0] - q[0]) + square((f64)p[1] - q[1]) + square((f64)p[2] - q[2]);
        if (length > *longest) *longest = length, found = c;
    }
    return found;
}

/* The axes of a triangle's grid, in the frame of the vertices. */
typedef struct {
    f64 O[3], U[3], V[3], u, v;  /* u, v: lengths of the axes, scene units */
    f64 foot;                    /* of a triangle alone: where on U its height stands */
    int pair, second;            /* of two that share a grid; the second of them: its axes go the other way */
} Axes;

static inline Axes axes_of(const f32 *vertices, const i32 *triangles, const i32 *other, f64 scale, i64 t) {
    Axes s;
    f64 longest;
    const i32 *corners = triangles + 3 * t;
    int c = opposite(vertices, corners, &longest);
    const f32 *o = vertices + 3 * (i64)corners[c], *a = vertices + 3 * (i64)corners[(c + 1) % 3],
              *b = vertices + 3 * (i64)corners[(c + 2) % 3];
    s.pair = other[t] >= 0, s.second = s.pair && other[t] < t, s.foot = 0.0;
    if (s.pair)
        for (int j = 0; j < 3; j++) s.O[j] = o[j], s.U[j] = (f64)a[j] - o[j], s.V[j] = (f64)b[j] - o[j];
    else {
        for (int j = 0; j < 3; j++) s.O[j] = a[j], s.U[j] = (f64)b[j] - a[j], s.V[j] = (f64)o[j] - a[j];
        s.foot = longest > 0.0 ? dot(s.U, s.V) / longest : 0.0;
        for (int j = 0; j < 3; j++) s.V[j] -= s.foot * s.U[j];
    }
    s.u = scale * sqrt(dot(s.U, s.U)), s.v = scale * sqrt(dot(s.V, s.V));
    return s;
}

/* Where a place (in the frame) is on the axes, from 0 to 1. */
static inline void on_axes(const Axes *s, const f64 *place, f64 *xy) {
    f64 q[3], normal[3], a[3], b[3];
    for (int j = 0; j < 3; j++) q[j] = place[j] - s->O[j];
    cross(s->U, s->V, normal), cross(q, s->V, a), cross(s->U, q, b);
    f64 square_of = dot(normal, normal);
    xy[0] = square_of > 0.0 ? dot(a, normal) / square_of : 0.0, xy[1] = square_of > 0.0 ? dot(b, normal) / square_of : 0.0;
    for (int k = 0; k < 2; k++) {
        if (s->second) xy[k] = 1.0 - xy[k];
        xy[k] = xy[k] < 0.0 ? 0.0 : xy[k] > 1.0 ? 1.0 : xy[k];
    }
}

/* The parts of an axis where cells have edges of about `size`. */
static inline i64 parts_of(f64 length, f64 size) {
    f64 parts = ceil(length / size - 1e-3);
    return parts > PARTS ? PARTS : parts > 1.0 ? (i64)parts : 1;
}

typedef struct {
    Axes axes;
    i64 lead, m, n;     /* the triangle that keys name; parts */
    f64 u, v, spacing;  /* lengths of the axes, which both of a pair have; the diagonal of its cells */
} Grid;

/* The grid of a triangle, whose cells have edges of about `size`, when it is divided. Both of a pair have the same. */
static inline Grid undivided(const f32 *vertices, const i32 *triangles, const i32 *other, f64 scale, i64 t) {
    Grid g;
    g.axes = axes_of(vertices, triangles, other, scale, t), g.lead = t, g.u = g.axes.u, g.v = g.axes.v;
    if (g.axes.second) {
        Axes first = axes_of(vertices, triangles, other, scale, other[t]);
        g.lead = other[t], g.u = first.u, g.v = first.v;
    }
    return g;
}

static inline void divide(Grid *g, f64 size) {
    g->m = parts_of(g->u, size), g->n = parts_of(g->v, size);
    g->spacing = sqrt(square(g->u / (f64)g->m) + square(g->v / (f64)g->n));
}

static inline Grid grid_of(const f32 *vertices, const i32 *triangles, const i32 *other, f64 scale, i64 t, f64 size) {
    Grid g = undivided(vertices, triangles, other, scale, t);
    divide(&g, size);
    return g;
}

/* The cell in which a place on the axes lies. */
static inline void cell_of(const Grid *g, const f64 *xy, i64 *i, i64 *j) {
    *i = (i64)(xy[0] * (f64)g->m), *j = (i64)(xy[1] * (f64)g->n);
    if (*i > g->m - 1) *i = g->m - 1;
    if (*j > g->n - 1) *j = g->n - 1;
}

/* Moves x, y (scene units, along the axes) to the nearest place on a triangle that has a grid of its own. */
static inline void into_triangle(const Axes *s, f64 *x, f64 *y) {
    const f64 corner[3][2] = {{0.0, 0.0}, {s->u, 0.0}, {s->foot * s->u, s->v}};
    f64 least = 1e300, px = *x, py = *y;
    int inside = 1;
    for (int e = 0; e < 3; e++) {
        const f64 *a = corner[e], *b = corner[(e + 1) % 3];
        f64 dx = b[0] - a[0], dy = b[1] - a[1], qx = *x - a[0], qy = *y - a[1], length = dx * dx + dy * dy;
        if (dx * qy - dy * qx < 0.0) inside = 0;
        f64 t = length > 0.0 ? (qx * dx + qy * dy) / length : 0.0;
        t = t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t;
        f64 nx = a[0] + t * dx, ny = a[1] + t * dy, away = square(nx - *x) + square(ny - *y);
        if (away < least) least = away, px = nx, py = ny;
    }
    if (!inside) *x = px, *y = py;
}

/* The place (in the frame) at x, y of the axes, from 0 to 1, moved inwards by `inset`, scene units, at the border;
   returns the triangle on which it lies, the first or the second of a pair. */
static inline i64 place_on(const f32 *vertices, const i32 *triangles, const i32 *other, f64 scale, const Grid *g, f64 x,
                           f64 y, f64 inset, f64 *place) {
    Axes s = g->axes;
    i64 t = g->lead;
    if (s.pair) {
        const f64 middle = 0.382;
        f64 du = s.u > 0.0 ? inset / s.u : 0.0, dv = s.v > 0.0 ? inset / s.v : 0.0;
        x += (du < 0.2 ? du : 0.2) * (middle - x) / (1.0 - middle), y += (dv < 0.2 ? dv : 0.2) * (middle - y) / (1.0 - middle);
        if (x + y > 1.0) t = other[g->lead], s = axes_of(vertices, triangles, other, scale, t), x = 1.0 - x, y = 1.0 - y;
    } else {
        f64 X = x * s.u, Y = y * s.v, left = sqrt(square(s.foot * s.u) + s.v * s.v),
            right = sqrt(square(s.u - s.foot * s.u) + s.v * s.v), around = s.u + left + right;
        f64 radius = s.u * s.v / around, by = radius > 0.0 ? inset / radius : 0.0;  /* of the circle inside */
        into_triangle(&s, &X, &Y);
        if (by > 0.3) by = 0.3;
        X += by * ((left + s.foot * s.u) * s.u / around - X), Y += by * (s.u * s.v / around - Y);
        x = s.u > 0.0 ? X / s.u : 0.0, y = s.v > 0.0 ? Y / s.v : 0.0;
    }
    for (int j = 0; j < 3; j++) place[j] = s.O[j] + x * s.U[j] + y * s.V[j];
    return t;
}

/* The edge of cells of this level of the lattice, whose diagonals are coarse/2^level. */
static inline f64 edge(f64 coarse, int level) { return ldexp(coarse * 0.70710678118654752, -level); }

/* The level of the lattice that is `level` times twice as fine as the coarsest grid of a triangle, and the edge of its
   cells; −1: the triangle's corners. */
static inline int lattice(f64 longest, f64 coarse, i64 level, f64 *size) {
    i64 base = 0;
    if (longest <= coarse) {
        if (level == 0) return -1;
        for (f64 s = coarse; base < 15 && 0.5 * s >= longest; base++) s *= 0.5;
    }
    base += level;
    if (base > 15) base = 15;
    *size = edge(coarse, (int)base);
    return (int)base;
}
