/* Points on lamps with a size: what they depend on, and what they give (lamp_points.py). */
#pragma once
#include "../rays/triangles.h"

#include "shapes.h"

/* 64 bits to 64 others, and those to a number in [0,1) (SplitMix64's finaliser). */
static inline u64 mixed(u64 x) {
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    return x ^ x >> 31;
}

static inline f64 random_of(u64 x) { return (f64)(mixed(x) >> 11) * 0x1p-53; }

/* Which stratum of 16 point j has. The first four have one of each four that follow each other, the first eight one of
   each two; so do they where the strata change places by ^. */
static inline i64 stratum(i64 j) {
    static const i64 further[4] = {0, 3, 1, 2};
    return further[j >> 2] ^ 5 * (j & 3);
}

static inline i64 reversed(i64 i) { return (i & 1) << 3 | (i & 2) << 1 | (i & 4) >> 1 | i >> 3; }

/* The cosine of k sixteenths of a turn; the sine is that of k + 12. */
#define R8 0.92387953251128674
#define R4 0.70710678118654752
#define R16 0.38268343236508977
static const f64 sixteenth[16] = {1.0,  R8,  R4,  R16,  0.0, -R16, -R4, -R8, -1.0, -R8, -R4, -R16, 0.0, R16, R4, R8};

static inline f64 part(f64 x) { return x - floor(x); }

/* Cosine and sine of x turns, to 1e-7, for x in [0,2): series for at most an eighth of a turn, by quarters. */
static inline void turned_by(f64 x, f64 *cosine, f64 *sine) {
    f64 quarter = floor(4.0 * x + 0.5), a = (x - 0.25 * quarter) * 2.0 * PI, s = a * a;
    f64 c0 = 1.0 - s * (0.5 - s * (1.0 / 24 - s * (1.0 / 720 - s / 40320)));
    f64 s0 = a * (1.0 - s * (1.0 / 6 - s * (1.0 / 120 - s * (1.0 / 5040 - s / 362880))));
    i64 which = (i64)quarter & 3;
    f64 c = which & 1 ? s0 : c0, other = which & 1 ? c0 : s0;
    *cosine = which == 1 || which == 2 ? -c : c, *sine = which >= 2 ? -other : other;
}

/* Which point of a pattern is the j-th of one of `sharers` that have the pattern in common: each round of points has one
   for each of them, and who has which of these changes from round to round, so that also the points of one spread. */
static inline i64 in_pattern(i64 j, i64 share, i64 sharers) {
    int even = (sharers & (sharers - 1)) == 0;
    return sharers * j + (even ? share ^ (j & (sharers - 1)) : (share + j) % sharers);
}

/* The same of one of four pixels that have four samples each, and a pattern of 16 points in common: in each round the four
   have all 16, and in four rounds each has all of them. */
static inline i64 in_common(i64 j, i64 share) { return j >> 2 << 4 | ((share ^ j << 2) & 12) | ((share ^ j) & 3); }

/* Lamps, one row each: shape, size, half-axes u, v: see `shapes.h`. own: by which their patterns differ. */
typedef struct {
    const f64 *position;
    const u8 *directional, *shape;
    const f64 *size, *u, *v;
    const u64 *own;
} Lamps;

/* Who has the points of a pattern in common (by the places from which rays go, or NULL): see `in_pattern` and `in_common`. */
typedef struct {
    const f64 *turn;
    const i64 *share;
    i64 sharers, common;
} Patterns;

/* A lamp as it is seen from one place, and its points from there. Of lamps with a face e and f are its half-axes, else unit
   vectors across the way d to it, which is `far` long, and of a sun 1; cap: 1 − cosine of half the angle that it is wide. */
typedef struct {
    const f64 *from, *centre;
    f64 e[3], f[3], d[3], far, size, cap, shift, turned, cosine, sine;
    i64 shape, sun, inside, set, share, sharers, common;
    u64 key;
} Face;

static inline Face face_of(const Lamps *l, i64 i, const f64 *from, const Patterns *by, i64 row) {
    const f64 *c = l->position + 3 * i, *mine = by->turn + 2 * row;
    Face t = {.from = from, .centre = c, .size = l->size[i], .cosine = 1.0, .shape = l->shape[i], .sun = l->directional[i],
              .set = -1, .share = by->share ? by->share[row] : -1, .sharers = by->sharers, .common = by->common};
    if (has_face(t.shape)) {
        memcpy(t.e, l->u + 3 * i, sizeof t.e), memcpy(t.f, l->v + 3 * i, sizeof t.f);
    } else {
        for (int j = 0; j < 3; j++) t.d[j] = c[j] - (t.sun ? 0.0 : from[j]);
        f64 square_of = dot(t.d, t.d), wide = t.size * t.size;
        t.far = sqrt(square_of);
        for (int j = 0; j < 3; j++) t.d[j] = t.far > 0.0 ? t.d[j] / t.far : j == 2;
        t.inside = t.shape == BALL && square_of <= wide;
        f64 sines = wide / (t.shape == BALL ? square_of : square_of + wide);
        t.cap = t.inside ? 2.0 : sines / (1.0 + sqrt(1.0 - sines));
        f64 *d = t.d, sign = d[2] >= 0.0 ? 1.0 : -1.0, g = -1.0 / (sign + d[2]), both = d[0] * d[1] * g;
        t.e[0] = 1.0 + sign * d[0] * d[0] * g, t.e[1] = sign * both, t.e[2] = -sign * d[0];
        t.f[0] = both, t.f[1] = sign + d[1] * d[1] * g, t.f[2] = -d[1];
    }
    memcpy(&t.key, mine + 1, sizeof t.key);
    t.key = mixed(t.key + l->own[i]);
    t.shift = mine[0] + random_of(l->own[i]);
    return t;
}

/* The point of a lamp without a face in the direction that is x, y across the way to it; cosine: along that. */
static inline void point_along(const Face *t, f64 x, f64 y, f64 cosine, f64 *point) {
    f64 across = t->far * t->far * (x * x + y * y), length = t->sun ? 1.0 : t->far / cosine;
    if (t->shape == BALL) {
        f64 rest = t->size * t->size - across, half = rest > 0.0 ? sqrt(rest) : 0.0;
        length = t->far * cosine + (t->inside ? half : -half);
    }
    for (int i = 0; i < 3; i++)
        point[i] = (t->sun ? 0.0 : t->from[i]) + length * (cosine * t->d[i] + x * t->e[i] + y * t->f[i]);
}

/* Finds point q of the lamp. They are as many in each part of a face, or of the directions of other lamps. */
static inline void point_of(Face *t, i64 q, f64 *point) {
    i64 n = q, round = 0;
    if (t->share >= 0 && t->common)
        n = in_common(q, t->share), round = q & 3;
    else if (t->share >= 0)
        n = in_pattern(q, t->share, t->sharers);
    i64 j = stratum(n & 15) ^ (i64)(mixed(t->key + (u64)(n >> 4)) & 15);
    if (n >> 4 != t->set) {  /* another 16 */
        t->set = n >> 4, t->turned = t->shift + 0.5698402909980532 * (f64)t->set;
        if (t->shape != RECTANGLE) turned_by(part(t->turned), &t->cosine, &t->sine);
    }
    f64 a = ((f64)j + random_of(t->key ^ (u64)(256 + n - (n & 15) + j + (round << 32)))) / 16.0, x, y;
    i64 k = reversed(j);
    if (t->shape == RECTANGLE) {
        x = 2.0 * a - 1.0, y = 2.0 * part((f64)k / 16.0 + t->turned) - 1.0;
    } else {
        f64 c = sixteenth[k], s = sixteenth[(k + 12) & 15], lower = a * t->cap;
        f64 far = t->shape == ELLIPSE ? sqrt(a) : sqrt(lower * (2.0 - lower));
        x = far * (c * t->cosine - s * t->sine), y = far * (s * t->cosine + c * t->sine);
        if (t->shape != ELLIPSE) {
            point_along(t, x, y, 1.0 - lower, point);
            return;
        }
    }
    for (int i = 0; i < 3; i++) point[i] = t->centre[i] + x * t->e[i] + y * t->f[i];
}

/* What a point of a lamp gives a matt surface of `normal` at `from`, up to a constant of both; facing: the lamp's normal. */
static inline f64 point_gives(const f64 *point, int directional, i64 shape, const f64 *facing, const f64 *from,
                              const f64 *normal) {
    f64 way[3];
    for (int j = 0; j < 3; j++) way[j] = point[j] - (directional ? 0.0 : from[j]);
    f64 square = dot(way, way), length = sqrt(square), weight = dot(way, normal) / length;
    if (!(weight > 0.0)) return 0.0;
    return !has_face(shape) ? weight : weight * (fabs(dot(way, facing)) / (square * length));
}
