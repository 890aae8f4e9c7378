/* How far bodies of glass would turn a straight ray of light aside, from the normals where it crosses them (aside.py). */
#include "fresnel.h"
#include "straight.h"

/* Columns of a ray's state: the unit direction after the bends so far; that before the body in which the ray is; the
   sum of how far each body behind it makes the ray miss the lamp, as a vector; the longest way from a body to the lamp;
   in how many bodies the ray is; and what is left of the light by Fresnel's equations, 0 after a total reflection. */
enum { BENT, BEFORE = 3, MISS = 6, FAR = 9, DEPTH, LEFT };

/* Turns the direction d at a surface with the unit normal N on its side. Returns 0 at total reflection. */
static int turn(f64 *d, const f64 *N, f64 eta) {
    f64 c = -dot(d, N);
    if (c <= 0.0) return 0;  /* by the shading normal the ray comes from behind: this is the rim of something round */
    f64 square_of = 1.0 - eta * eta * (1.0 - c * c);
    if (square_of <= 0.0) return 0;
    f64 f = eta * c - sqrt(square_of);
    for (int j = 0; j < 3; j++) d[j] = eta * d[j] + f * N[j];
    f64 length = sqrt(dot(d, d));
    for (int j = 0; j < 3; j++) d[j] /= length;
    return 1;
}

/* Takes rays, whose states are rows of `state`, through a crossing each, in their order. way: their unit directions;
   left: how far the lamp is from the crossing, 1 for a sun. of: the body that a triangle bounds, −1 if none. index,
   by_fresnel: of materials. A body that the ray only leaves, because it began there, turns nothing. */
KERNEL(aside_cross,
       "of i32[T]  inside_out bool[b]  ior f64[b]  index f64[M]  by_fresnel bool[M]  triangle i32[n]  "
       "material i32[n]  front bool[n]  Ns f64[n,3]  way f64[n,3]  left f64[n]  row i64[n]  state f64[m,12]!"
       ";  0<=triangle<T  0<=material<M  0<=row<m;  -1<=of<b")
i64 aside_cross(i64 T, i64 b, i64 M, i64 n, i64 m, const i32 *of, const u8 *inside_out, const f64 *ior, const f64 *index,
                const u8 *by_fresnel, const i32 *triangle, const i32 *material, const u8 *front, const f64 *Ns,
                const f64 *way, const f64 *left, const i64 *row, f64 *state) {
    (void)T, (void)b, (void)M, (void)m;
    for (i64 k = 0; k < n; k++) {
        f64 *s = state + STATE * row[k];
        const f64 *N = Ns + 3 * k;
        i32 body = of[triangle[k]];
        if (s[LEFT] < 0.0) {  /* the ray's first crossing */
            for (int j = 0; j < 3; j++) s[BENT + j] = way[3 * k + j], s[MISS + j] = 0.0;
            s[FAR] = s[DEPTH] = 0.0, s[LEFT] = 1.0;
        }
        if (body < 0) {
            f64 cosine = fabs(dot(s + BENT, N));
            if (by_fresnel[material[k]] && index[material[k]] != 1.0)
                s[LEFT] *= 1.0 - fresnel(index[material[k]], cosine < 1.0 ? cosine : 1.0);
            continue;
        }
        int entering = front[k] != inside_out[body];
        if (!entering && s[DEPTH] == 0.0) continue;
        if (entering && s[DEPTH] == 0.0)
            for (int j = 0; j < 3; j++) s[BEFORE + j] = s[BENT + j];
        f64 eta = entering ? 1.0 / ior[body] : ior[body], cosine = fabs(dot(s + BENT, N));
        if (by_fresnel[material[k]]) s[LEFT] *= 1.0 - fresnel(1.0 / eta, cosine < 1.0 ? cosine : 1.0);
        if (!turn(s + BENT, N, eta)) s[LEFT] = 0.0;
        s[DEPTH] += entering ? 1.0 : -1.0;
        if (s[DEPTH] > 0.0) continue;
        if (left[k] > s[FAR]) s[FAR] = left[k];
        for (int j = 0; j < 3; j++) s[MISS + j] += left[k] * (s[BENT + j] - s[BEFORE + j]);
    }
    return 0;
}

/* Multiplies `through` of rays that crossed something by what counts of them: all of a ray that still meets its lamp's
   middle, and nothing of one that misses it by the lamp's width or more. Between these it is the part of the lamp that
   shifted copies of it have in common, about. radius: half of the width of each ray's lamp, for a sun at distance 1. A
   lamp is at least as wide as an angle whose tangent is `least`, seen from the glass. */
KERNEL(aside_dim, "state f64[m,12]  radius f64[m]  least f64  through f32[m,3]!")
i64 aside_dim(i64 m, const f64 *state, const f64 *radius, f64 least, f32 *through) {
    for (i64 k = 0; k < m; k++) {
        const f64 *s = state + STATE * k;
        if (s[LEFT] < 0.0) continue;
        f64 wide = least * s[FAR], share = s[LEFT];
        if (radius[k] > wide) wide = radius[k];
        if (s[FAR] > 0.0) {
            f64 off = sqrt(dot(s + MISS, s + MISS)) / (2.0 * wide);
            share *= off < 1.0 ? 1.0 - off : 0.0;
        }
        for (int c = 0; c < 3; c++) through[3 * k + c] = (f32)(through[3 * k + c] * share);
    }
    return 0;
}
