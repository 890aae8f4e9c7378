/* The points and cells of triangles' grids (grids.py). */
#include "grids.h"

/* Fills the longest edge of each triangle, scene units, and the numbers of its ends, the smaller one first. */
KERNEL(grids_longest, "scale f64  vertices f32[V,3]  triangles i32[T,3]  longest f32[T]!  ends i32[T,2]!"
       ";  0<=triangles<V")
i64 grids_longest(i64 V, i64 T, f64 scale, const f32 *vertices, const i32 *triangles, f32 *longest, i32 *ends) {
    (void)V;
    for (i64 t = 0; t < T; t++) {
        f64 length;
        const i32 *corner = triangles + 3 * t;
        int c = opposite(vertices, corner, &length);
        i32 a = corner[(c + 1) % 3], b = corner[(c + 2) % 3];
        longest[t] = (f32)(scale * sqrt(length));
        ends[2 * t] = a < b ? a : b, ends[2 * t + 1] = a < b ? b : a;
    }
    return 0;
}

/* Tells (ok) which pairs of triangles (first, second), which share their longest edge, make up a parallelogram: they
   go around it the same way, and their corners differ from one by less than `share` of that edge. */
KERNEL(grids_pairs,
       "vertices f32[V,3]  triangles i32[T,3]  share f64  first i32[n]  second i32[n]  ok bool[n]!"
       ";  0<=first<T  0<=second<T;  0<=triangles<V")
i64 grids_pairs(i64 V, i64 T, i64 n, const f32 *vertices, const i32 *triangles, f64 share, const i32 *first,
                const i32 *second, u8 *ok) {
    (void)V, (void)T;
    for (i64 k = 0; k < n; k++) {
        const i32 *s = triangles + 3 * (i64)first[k], *t = triangles + 3 * (i64)second[k];
        f64 longest, other, away = 0.0;
        int c = opposite(vertices, s, &longest), d = opposite(vertices, t, &other);
        const i32 a = s[(c + 1) % 3], b = s[(c + 2) % 3];
        for (int j = 0; j < 3; j++) {
            f64 O = vertices[3 * (i64)s[c] + j], A = vertices[3 * (i64)a + j], B = vertices[3 * (i64)b + j];
            away += square(A + B - O - vertices[3 * (i64)t[d] + j]);
        }
        ok[k] = t[(d + 1) % 3] == b && t[(d + 2) % 3] == a && away < square(share) * longest && longest > 0.0;
    }
    return 0;
}

/* The unit normal, in the world, of a triangle's axes. */
static void unit_normal(const Axes *s, int flipped, f64 *N) {
    cross(s->U, s->V, N);
    f64 length = sqrt(dot(N, N)) * (flipped ? -1.0 : 1.0);
    for (int j = 0; j < 3; j++) N[j] /= length;
}

/* Fills where the grid points with these keys are, their normals and how far apart they are. Points at a border are moved
   inwards by `inset` of a cell's edge. */
KERNEL(grids_places,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  flipped bool[T]  coarse f64  "
       "inset f64  keys u64[n]  P f64[n,3]!  N f64[n,3]!  spacing f64[n]!"
       ";  0<coarse<inf;  0<=triangles<V  -1<=other<T")
i64 grids_places(i64 V, i64 T, i64 n, const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangles,
                 const i32 *other, const u8 *flipped, f64 coarse, f64 inset, const u64 *keys, f64 *P, f64 *N,
                 f64 *spacing) {
    (void)V;
    for (i64 k = 0; k < n; k++) {
        Key key = key_of(keys[k]);
        if (key.triangle >= T) return OUTSIDE;
        f64 size = edge(coarse, key.level), place[3];
        Grid g = grid_of(vertices, triangles, other, scale, key.triangle, size);
        i64 t = place_on(vertices, triangles, other, scale, &g, (f64)key.i / (f64)g.m, (f64)key.j / (f64)g.n,
                         inset * size, place);
        Axes s = axes_of(vertices, triangles, other, scale, t);
        unit_normal(&s, (int)flipped[t] == key.front, N + 3 * k);
        for (int j = 0; j < 3; j++) P[3 * k + j] = centre[j] + scale * place[j];
        spacing[k] = g.spacing;
    }
    return 0;
}

/* Four places in a cell that stand for it, turned against its sides. */
static const f64 FOUR[4][2] = {{0.3, 0.2}, {0.8, 0.3}, {0.2, 0.7}, {0.7, 0.8}};
/* And in a triangle as a whole. */
static const f64 WHOLE[4][2] = {{1.0 / 3, 1.0 / 3}, {1.0 / 6, 1.0 / 6}, {2.0 / 3, 1.0 / 6}, {1.0 / 6, 2.0 / 3}};
/* The same near their corners. */
static const f64 OUTER_FOUR[4][2] = {{0.02, 0.02}, {0.98, 0.02}, {0.02, 0.98}, {0.98, 0.98}};
static const f64 OUTER_WHOLE[4][2] = {{0.02, 0.02}, {0.96, 0.02}, {0.02, 0.96}, {0.49, 0.49}};

/* Fills four points that stand for each of the cells with these keys: their triangles, places and normals. top: the
   size of cells of level 1; level 0 is a triangle as a whole. outer: of points near the corners, instead. */
KERNEL(grids_inside,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  flipped bool[T]  top f64  "
       "outer i64  keys u64[n]  triangle i32[n,4]!  P f64[n,4,3]!  N f64[n,4,3]!"
       ";  0<top<inf;  0<=triangles<V  -1<=other<T")
i64 grids_inside(i64 V, i64 T, i64 n, const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangles,
                 const i32 *other, const u8 *flipped, f64 top, i64 outer, const u64 *keys, i32 *triangle, f64 *P, f64 *N) {
    const f64 (*four)[2] = outer ? OUTER_FOUR : FOUR, (*whole)[2] = outer ? OUTER_WHOLE : WHOLE;
    (void)V;
    for (i64 k = 0; k < n; k++) {
        Key key = key_of(keys[k]);
        if (key.triangle >= T) return OUTSIDE;
        f64 size = ldexp(top, 1 - key.level), place[3];
        Grid g = {0};
        if (key.level) g = grid_of(vertices, triangles, other, scale, key.triangle, size);
        for (int c = 0; c < 4; c++) {
            i64 t = key.triangle, at = 4 * k + c;
            if (key.level)
                t = place_on(vertices, triangles, other, scale, &g, ((f64)key.i + four[c][0]) / (f64)g.m,
                             ((f64)key.j + four[c][1]) / (f64)g.n, INSET * size, place);
            else {
                Edges s = edges_of(vertices, triangles + 3 * t);
                for (int j = 0; j < 3; j++) place[j] = s.a[j] + whole[c][0] * s.e[j] + whole[c][1] * s.f[j];
            }
            Axes s = axes_of(vertices, triangles, other, scale, t);
            unit_normal(&s, (int)flipped[t] == key.front, N + 3 * at);
            for (int j = 0; j < 3; j++) P[3 * at + j] = centre[j] + scale * place[j];
            triangle[at] = (i32)t;
        }
    }
    return 0;
}

/* Fills the keys of cells around those with these keys, whose edges are 2^by times as long. for_small: the triangles that
   stand for others, by step of size (rays.c). */
KERNEL(grids_wider,
       "scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  top f64  for_small i32[s,T]  by i64  keys u64[n]  "
       "wider u64[n]!"
       ";  0<top<inf  1<=s  0<=by;  0<=triangles<V  -1<=other<T")
i64 grids_wider(i64 V, i64 T, i64 s, i64 n, f64 scale, const f32 *vertices, const i32 *triangles, const i32 *other,
                f64 top, const i32 *for_small, i64 by, const u64 *keys, u64 *wider) {
    (void)V;
    for (i64 k = 0; k < n; k++) {
        Key key = key_of(keys[k]);
        if (key.triangle >= T) return OUTSIDE;
        int level = key.level - (int)by < 1 ? 1 : key.level - (int)by;
        i64 i, j;
        if (key.level == 0) {
            i64 step = key.i + by < s ? key.i + by : s - 1;
            wider[k] = key_at(for_small[step * T + key.triangle], key.front, 0, step, 0);
            continue;
        }
        if (key.level == 1) {
            wider[k] = keys[k];
            continue;
        }
        Grid g = grid_of(vertices, triangles, other, scale, key.triangle, ldexp(top, 1 - key.level));
        f64 xy[2] = {((f64)key.i + 0.5) / (f64)g.m, ((f64)key.j + 0.5) / (f64)g.n};
        g = grid_of(vertices, triangles, other, scale, key.triangle, ldexp(top, 1 - level));
        cell_of(&g, xy, &i, &j);
        wider[k] = key_at(key.triangle, key.front, level, i, j);
    }
    return 0;
}
