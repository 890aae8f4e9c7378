/* Blender's Voronoi texture (procedural.py), in single precision and in Blender's order, so that the pattern is its own.
   A cell of the unit lattice has one point in it, which its hash places; see Worley, "A cellular texture basis function"
   (1996). Releases up to 4.x hash the cell's numbers as Jenkins (lookup3), later ones as Jarzynski and Olano, "Hash
   functions for GPU rendering" (2020, pcg2d, pcg3d, pcg4d). */
#include <float.h>

#include "hashes.h"

enum { F1, F2, SMOOTH_F1, TO_EDGE, SPHERE_RADIUS };         /* in the order of VORONOI_FEATURES in node_textures.py */
enum { EUCLIDEAN, MANHATTAN, CHEBYCHEV, MINKOWSKI };        /* and VORONOI_DISTANCES */
enum { JENKINS, PCG };                                      /* and voronoi_hash there */

typedef struct {
    int d, feature, metric, normalize, hash;
    f32 detail, roughness, lacunarity, smoothness, exponent, randomness;
} Voronoi;

typedef struct {
    f32 distance, color[3], at[4];
} Found;

static inline f32 between(f32 a, f32 b, f32 share) { return a + share * (b - a); }

/* v from whole numbers v: the words of pcg2d, pcg3d and pcg4d, on signed numbers as Blender has them. */
static inline void pcg(i32 *signed_words, int d) {
    u32 v[4];
    for (int j = 0; j < d; j++) v[j] = (u32)signed_words[j] * 1664525u + 1013904223u;
    for (int round = 0; round < 2; round++) {
        if (d == 2) {
            v[0] += v[1] * 1664525u, v[1] += v[0] * 1664525u;
        } else if (d == 3) {
            v[0] += v[1] * v[2], v[1] += v[2] * v[0], v[2] += v[0] * v[1];
        } else {
            v[0] += v[1] * v[3], v[1] += v[2] * v[0], v[2] += v[0] * v[1], v[3] += v[1] * v[2];
        }
        if (round == 0)
            for (int j = 0; j < d; j++) v[j] ^= (u32)((i32)v[j] >> 16);
    }
    for (int j = 0; j < d; j++) signed_words[j] = (i32)v[j];
}

static inline f32 unit(i32 word) { return (f32)(word & 0x7fffffff) * (1.0f / (f32)0x7fffffff); }

/* Where in its cell the point is, from 0 to 1. */
static inline void place_in_cell(const Voronoi *o, const f32 *cell, f32 *in) {
    if (o->d > 1 && o->hash == PCG) {
        i32 k[4];
        for (int j = 0; j < o->d; j++) k[j] = (i32)cell[j];
        pcg(k, o->d);
        for (int j = 0; j < o->d; j++) in[j] = unit(k[j]);
        return;
    }
    if (o->d == 4) {
        for (int j = 0; j < 4; j++) {
            f32 k[4];
            for (int i = 0; i < 4; i++) k[i] = cell[(i + 4 - j) & 3];
            in[j] = hash_numbers(k, 4);
        }
        return;
    }
    f32 k[4] = {cell[0], cell[1], cell[2], 0.0f};
    in[0] = hash_numbers(k, o->d);
    for (int j = 1; j < o->d; j++) k[o->d] = (f32)j, in[j] = hash_numbers(k, o->d + 1);
}

static inline void color_of_cell(const Voronoi *o, const f32 *cell, f32 *color) {
    if (o->d > 1 && o->hash == PCG) {
        i32 k[4] = {0, 0, 0, 0};
        for (int j = 0; j < o->d; j++) k[j] = (i32)cell[j];
        pcg(k, o->d < 4 ? 3 : 4);
        for (int j = 0; j < 3; j++) color[j] = unit(k[j]);
        return;
    }
    f32 k[4] = {cell[0], cell[1], cell[2], cell[3]};
    color[0] = hash_numbers(k, o->d);
    if (o->d < 4) {
        for (int j = 1; j < 3; j++) k[o->d] = (f32)j, color[j] = hash_numbers(k, o->d + 1);
    } else {
        f32 green[4] = {k[2], k[0], k[3], k[1]}, blue[4] = {k[3], k[2], k[1], k[0]};
        color[1] = hash_numbers(green, 4), color[2] = hash_numbers(blue, 4);
    }
}

static inline f32 length_of(const f32 *a, int d) {
    f32 sum = 0.0f;
    for (int j = 0; j < d; j++) sum += a[j] * a[j];
    return sqrtf(sum);
}

static inline f32 distance(const Voronoi *o, const f32 *a, const f32 *b) {
    f32 far[4], sum = 0.0f;
    for (int j = 0; j < o->d; j++) far[j] = fabsf(a[j] - b[j]);
    if (o->d == 1) return far[0];
    switch (o->metric) {
    case MANHATTAN:
        for (int j = 0; j < o->d; j++) sum += far[j];
        return sum;
    case CHEBYCHEV:
        for (int j = 0; j < o->d; j++) sum = fmaxf(sum, far[j]);
        return sum;
    case MINKOWSKI:
        for (int j = 0; j < o->d; j++) sum += powf(far[j], o->exponent);
        return powf(sum, 1.0f / o->exponent);
    default: return length_of(far, o->d);
    }
}

/* A walk over the cells around one: `offset` of the cell, x fastest, and its point's place `at` (from the middle cell's
   corner). */
typedef struct {
    int reach, step;
    f32 offset[4], at[4];
} Walk;

static inline int next_cell(const Voronoi *o, const f32 *cell, Walk *w) {
    int side = 2 * w->reach + 1, rest = w->step++;
    f32 there[4] = {0}, in[4] = {0};
    for (int j = 0; j < o->d; j++, rest /= side) {
        w->offset[j] = (f32)(rest % side - w->reach);
        there[j] = cell[j] + w->offset[j];
    }
    if (rest) return 0;
    place_in_cell(o, there, in);
    for (int j = 0; j < o->d; j++) w->at[j] = w->offset[j] + in[j] * o->randomness;
    return 1;
}

static void set_found(const Voronoi *o, const f32 *cell, f32 distance, const f32 *offset, const f32 *at, Found *out) {
    f32 there[4] = {0};
    out->distance = distance;
    for (int j = 0; j < o->d; j++) there[j] = cell[j] + offset[j], out->at[j] = cell[j] + at[j];
    color_of_cell(o, there, out->color);
}

/* The nearest point, or the second one. */
static void nearest(const Voronoi *o, const f32 *cell, const f32 *in, Found *out) {
    f32 first = FLT_MAX, second = FLT_MAX;
    f32 offset[4] = {0}, at[4] = {0}, offset2[4] = {0}, at2[4] = {0};
    Walk w = {.reach = 1};
    while (next_cell(o, cell, &w)) {
        f32 far = distance(o, w.at, in);
        if (far < first) {
            second = first, first = far;
            memcpy(offset2, offset, sizeof offset), memcpy(at2, at, sizeof at);
            memcpy(offset, w.offset, sizeof offset), memcpy(at, w.at, sizeof at);
        } else if (far < second) {
            second = far;
            memcpy(offset2, w.offset, sizeof offset), memcpy(at2, w.at, sizeof at);
        }
    }
    if (o->feature == F2) set_found(o, cell, second, offset2, at2, out);
    else set_found(o, cell, first, offset, at, out);
}

static void nearest_smoothed(const Voronoi *o, const f32 *cell, const f32 *in, Found *out) {
    f32 far = 0.0f, color[3] = {0}, at[4] = {0};
    Walk w = {.reach = 2};
    for (int begun = 0; next_cell(o, cell, &w); begun = 1) {
        f32 here = distance(o, w.at, in), h = 1.0f;
        if (begun) {
            f32 t = 0.5f + 0.5f * (far - here) / o->smoothness;
            h = t <= 0.0f ? 0.0f : t >= 1.0f ? 1.0f : (3.0f - 2.0f * t) * (t * t);
        }
        f32 less = o->smoothness * h * (1.0f - h), there[4] = {0}, its[3];
        far = between(far, here, h) - less;
        less /= 1.0f + 3.0f * o->smoothness;
        for (int j = 0; j < o->d; j++) there[j] = cell[j] + w.offset[j], at[j] = between(at[j], w.at[j], h) - less;
        color_of_cell(o, there, its);
        for (int j = 0; j < 3; j++) color[j] = between(color[j], its[j], h) - less;
    }
    out->distance = far;
    memcpy(out->color, color, sizeof color);
    for (int j = 0; j < o->d; j++) out->at[j] = cell[j] + at[j];
}

static f32 to_edge(const Voronoi *o, const f32 *cell, const f32 *in) {
    f32 closest[4] = {0}, least = FLT_MAX;
    Walk w = {.reach = 1};
    if (o->d == 1) {
        f32 at[3];
        for (int i = 0; next_cell(o, cell, &w); i++) at[i] = w.at[0];
        return fminf(fabsf((at[1] + at[0]) / 2.0f - in[0]), fabsf((at[1] + at[2]) / 2.0f - in[0]));
    }
    while (next_cell(o, cell, &w)) {
        f32 sum = 0.0f;
        for (int j = 0; j < o->d; j++) sum += (w.at[j] - in[j]) * (w.at[j] - in[j]);
        if (sum < least) {
            least = sum;
            for (int j = 0; j < o->d; j++) closest[j] = w.at[j] - in[j];
        }
    }
    least = FLT_MAX, w = (Walk){.reach = 1};
    while (next_cell(o, cell, &w)) {
        f32 across[4], sum = 0.0f, half = 0.0f;
        for (int j = 0; j < o->d; j++) across[j] = w.at[j] - in[j] - closest[j], sum += across[j] * across[j];
        if (!(sum > 0.0001f)) continue;
        for (int j = 0; j < o->d; j++) half += (closest[j] + (w.at[j] - in[j])) / 2.0f * across[j];
        least = fminf(least, half / sqrtf(sum));
    }
    return least;
}

/* Half the way from the nearest point to the one nearest to it. */
static f32 sphere_radius(const Voronoi *o, const f32 *cell, const f32 *in) {
    f32 closest[4] = {0}, offset[4] = {0}, there[4], least = FLT_MAX;
    Walk w = {.reach = 1};
    while (next_cell(o, cell, &w)) {
        f32 away[4];
        for (int j = 0; j < o->d; j++) away[j] = w.at[j] - in[j];
        f32 far = length_of(away, o->d);
        if (far < least) least = far, memcpy(closest, w.at, sizeof closest), memcpy(offset, w.offset, sizeof offset);
    }
    for (int j = 0; j < o->d; j++) there[j] = cell[j] + offset[j];
    least = FLT_MAX, w = (Walk){.reach = 1};
    while (next_cell(o, there, &w)) {
        f32 away[4];
        int same = 1;
        for (int j = 0; j < o->d; j++) same &= w.offset[j] == 0.0f, away[j] = closest[j] - (w.at[j] + offset[j]);
        if (!same) least = fminf(least, length_of(away, o->d));
    }
    return least / 2.0f;
}

/* The cell that p·scale lies in, and where in it; 0 where that is no number, or no whole number finds it. */
static int cell_at(const Voronoi *o, const f32 *p, f32 scale, f32 *cell, f32 *in) {
    for (int j = 0; j < o->d; j++) {
        f32 x = p[j] * scale;
        if (!(fabsf(x) < 2147483520.0f)) return 0;
        cell[j] = floorf(x), in[j] = x - cell[j];
    }
    return 1;
}

static Found octaves(const Voronoi *o, const f32 *p, f32 most_distance) {
    Found sum = {0};
    f32 amplitude = 1.0f, most = 0.0f, scale = 1.0f, rest = o->detail - floorf(o->detail);
    int single = o->detail == 0.0f || o->roughness == 0.0f;
    for (int i = 0; i <= (int)ceilf(o->detail); i++) {
        Found one = {0};
        f32 cell[4] = {0}, in[4] = {0};
        if (!cell_at(o, p, scale, cell, in)) break;
        if (o->feature == SMOOTH_F1 && o->smoothness != 0.0f) nearest_smoothed(o, cell, in, &one);
        else nearest(o, cell, in, &one);
        if (single) {
            most = 1.0f, sum = one;
            break;
        }
        f32 share = (f32)i <= o->detail ? 1.0f : rest;
        most += share * amplitude;
        sum.distance += share * (one.distance * amplitude);
        for (int j = 0; j < 3; j++) sum.color[j] += share * (one.color[j] * amplitude);
        for (int j = 0; j < 4; j++) sum.at[j] = between(sum.at[j], between(sum.at[j], one.at[j] / scale, amplitude), share);
        scale *= o->lacunarity, amplitude *= o->roughness;
    }
    if (o->normalize && most > 0.0f) {
        sum.distance /= most * most_distance;
        for (int j = 0; j < 3; j++) sum.color[j] /= most;
    }
    return sum;
}

static f32 octaves_to_edge(const Voronoi *o, const f32 *p, f32 most_distance) {
    f32 amplitude = 1.0f, most = most_distance, scale = 1.0f, sum = 8.0f, rest = o->detail - floorf(o->detail);
    int single = o->detail == 0.0f || o->roughness == 0.0f;
    for (int i = 0; i <= (int)ceilf(o->detail); i++) {
        f32 cell[4] = {0}, in[4] = {0};
        if (!cell_at(o, p, scale, cell, in)) return 0.0f;
        f32 one = to_edge(o, cell, in);
        if (single) {
            sum = one;
            break;
        }
        f32 share = (f32)i <= o->detail ? 1.0f : rest;
        most = between(most, between(most, most_distance / scale, amplitude), share);
        sum = between(sum, fminf(sum, between(sum, fminf(sum, one / scale), amplitude)), share);
        scale *= o->lacunarity, amplitude *= o->roughness;
    }
    return o->normalize ? sum / most : sum;
}

static f32 held(f64 x, f32 low, f32 high) { return x > low ? x < high ? (f32)x : high : low; }

/* out: distance (or radius), colour, position, which is to be divided by the texture's scale. place: (n,4), already
   scaled; how: (n,6) detail, roughness, lacunarity, smoothness, exponent, randomness. */
KERNEL(procedural_voronoi, "place f64[n,4]  how f64[n,6]  dimensions i64  feature i64  metric i64  normalize i64  hash i64  out f64[n,8]!"
       ";  1<=dimensions<=4")
i64 procedural_voronoi(i64 n, const f64 *place, const f64 *how, i64 dimensions, i64 feature, i64 metric, i64 normalize,
                       i64 hash, f64 *out) {
    for (i64 k = 0; k < n; k++) {
        const f64 *h = how + 6 * k;
        Voronoi o = {(int)dimensions, (int)feature, (int)metric, (int)normalize, (int)hash, held(h[0], 0.0f, 15.0f),
                     held(h[1], 0.0f, 1.0f), (f32)h[2], held(h[3] / 2.0, 0.0f, 0.5f), (f32)h[4],
                     held(h[5], 0.0f, 1.0f)};
        f32 p[4], nowhere[4] = {0}, reach[4];
        for (int j = 0; j < 4; j++) p[j] = (f32)place[4 * k + j], reach[j] = 0.5f + 0.5f * o.randomness;
        f64 *x = out + 8 * k;
        memset(x, 0, 8 * sizeof *x);
        if (o.feature == TO_EDGE) {
            x[0] = octaves_to_edge(&o, p, reach[0]);
        } else if (o.feature == SPHERE_RADIUS) {
            f32 cell[4] = {0}, in[4] = {0};
            if (cell_at(&o, p, 1.0f, cell, in)) x[0] = sphere_radius(&o, cell, in);
        } else {
            Found found = octaves(&o, p, distance(&o, nowhere, reach) * (o.feature == F2 ? 2.0f : 1.0f));
            x[0] = found.distance;
            for (int j = 0; j < 3; j++) x[1 + j] = found.color[j];
            for (int j = 0; j < 4; j++) x[4 + j] = found.at[j];
        }
    }
    return 0;
}
