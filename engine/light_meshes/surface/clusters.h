/* How far the light of lamps that are close together differs at most from that of one lamp in their middle (clusters.py).

   A matt surface returns of a lamp at x, seen from it, f(x) = N·x/|x|³, the slope of 1/|x| along N. Its first derivatives
   are at most 2/|x|³, its second ones at most 6/|x|⁴. With m, q the first and second moments of the lamps around their
   middle, which is at the distance d, and all of them within ρ of it, Taylor's formula says that their sum differs from
   that of all light in the middle by at most 2|m|/d³ + 3q/(d−ρ)⁴, if none of them is below the horizon. A disc that faces
   the receiver returns less than a point, by at most the share (radius/d)².

   Facets: each factor of `facet_power` has a largest value over the directions of a cone around the way to the middle; both
   sums are between 0 and the product of these. */
#pragma once
#include "shading_sums.h"

/* The tree of lamps: leaf j is node leaves + j, the root is 1. */
typedef struct {
    i64 leaves;
    const i32 *order;   /* the lamp of each leaf, −1: none */
    const u8 *together; /* whether one lamp's shadow may stand for all of a node's */
    const u8 *state;    /* EMPTY, ONE or MANY */
    const f64 *middle, *reach, *size; /* of each node: ρ, in which lamps are with all of their size; the largest radius */
    const f64 *power, *first, *second; /* per channel: I, |Σ I·(x − middle)|, Σ I·|x − middle|² */
} Clusters;
#define SMALL 0.4 /* the sine of half that angle */
enum { EMPTY, ONE, MANY }; /* no lamp; lamps for which one may stand; lamps for which none may */

/* A node as it is seen from the receivers of a block: the way to its middle, d, d − ρ, and how high it is over normals. */
typedef struct {
    f64 way[3][SIDE], far[SIDE], near[SIDE], flat[SIDE], up[SIDE], mirrored[SIDE];
} Sight;

static void sight_of(const Clusters *t, i64 node, const Block *b, const Block *shining, const f64 (*side)[SIDE], Sight *s) {
    const f64 *middle = t->middle + 3 * node, reach = t->reach[node];
    for (int k = 0; k < SIDE; k++) {
        f64 x = middle[0] - b->P[0][k], y = middle[1] - b->P[1][k], z = middle[2] - b->P[2][k];
        s->way[0][k] = x, s->way[1][k] = y, s->way[2][k] = z;
        s->far[k] = sqrt(x * x + y * y + z * z), s->near[k] = s->far[k] - reach;
        s->flat[k] = side[0][k] * x + side[1][k] * y + side[2][k] * z;
        s->up[k] = b->Ns[0][k] * x + b->Ns[1][k] * y + b->Ns[2][k] * z;
        s->mirrored[k] = shining->Ns[0][k] * x + shining->Ns[1][k] * y + shining->Ns[2][k] * z;
    }
}

/* most: what a matt surface returns at most of a node's lamps in its brightest channel; wrong: by how much that may be
   wrong. */
static void matt_errors(const Clusters *t, i64 node, const Block *b, const Sight *s, f64 *most, f64 *wrong) {
    const f64 *I = t->power + 3 * node, *m = t->first + 3 * node, *q = t->second + 3 * node;
    f64 reach = t->reach[node], rr = square(t->size[node]);
    for (int k = 0; k < SIDE; k++) {
        f64 near = s->near[k], far = s->far[k], up = s->up[k], highest = up + reach > 0.0 ? up + reach : 0.0;
        f64 near3 = 1.0 / (near * near * near), near4 = near3 / near, far3 = 2.0 / (far * far * far), all = 0.0, off = 0.0;
        highest = highest < near ? highest : near, highest *= near3;
        for (int j = 0; j < 3; j++) {
            f64 x = b->matt[j][k] * I[j] * highest, y = b->matt[j][k] * (m[j] * far3 + (3.0 * q[j] + I[j] * rr) * near4);
            all = x > all ? x : all, off = y > off ? y : off;
        }
        int above = (s->flat[k] >= reach) & (up >= reach) & (off < all);
        most[k] = all, wrong[k] = above ? off : all;
    }
}

/* What bumps leave of a node's light grows with the cosine to the smooth normal, by the older formula with its ratio to that
   to the bent one (bent.h: left_by_bumps): adds by how much that differs within it to wrong. */
static void bump_errors(const Clusters *t, i64 node, const Block *b, const Sight *s, const f64 (*smooth)[SIDE], const f64 *most,
                        f64 *wrong) {
    f64 reach = t->reach[node];
    for (int k = 0; k < SIDE; k++) {
        f64 over = 0.0, turned = 0.0, apart = 0.0;
        for (int j = 0; j < 3; j++) {
            over += smooth[j][k] * s->way[j][k], turned += smooth[j][k] * b->Ns[j][k];
            apart += fabs(smooth[j][k] - b->Ns[j][k]);
        }
        f64 low = (over - reach) / (s->far[k] + reach), high = (over + reach) / s->near[k], tt = turned * turned;
        int clear = (low > 1e-9) & (turned > 1e-6);
        low = clear ? low : 1.0, high = high < 1.0 ? high : 1.0, high = clear ? high : 1.0, tt = clear ? tt : 1.0;
        f64 slope = 0.125 * (1.0 / tt - 1.0);
        slope = slope < 1.0 ? slope : 1.0, slope = slope > 0.0 ? slope : 0.0;
        f64 least = 2.0 / (1.0 + sqrt(1.0 + slope * (1.0 / (low * low) - 1.0)));
        f64 largest = 2.0 / (1.0 + sqrt(1.0 + slope * (1.0 / (high * high) - 1.0)));
        if (b->facet_bumps[k] == 0.0) {
            f64 lowest = (s->up[k] - reach) / (s->far[k] + reach), highest = (s->up[k] + reach) / s->near[k];
            clear &= lowest > 1e-9, lowest = clear ? lowest : 1.0, highest = clear && highest < 1.0 ? highest : 1.0;
            turned = clear ? turned : 1.0;
            least = left_by_angle(low / (highest * turned)), largest = left_by_angle(high / (lowest * turned));
        }
        f64 more = wrong[k] + most[k] * (largest - least);
        more = (more < most[k]) & clear ? more : most[k];
        wrong[k] = apart > 0.0 ? more : wrong[k];
    }
}

/* Adds what facets return at most of a node's lamps in the brightest channel to wrong. */
static void facet_errors(const Clusters *t, i64 node, const Block *b, const Facets *f, const Sight *s, f64 *wrong) {
    const f64 *I = t->power + 3 * node, reach = t->reach[node];
    for (int k = 0; k < SIDE; k++) {
        f64 inverse = 1.0 / s->far[k], N = s->mirrored[k] * inverse, sine = reach * inverse, aa = f->alpha2[k], sight = f->sight[k];
        f64 E = (b->eye[0][k] * s->way[0][k] + b->eye[1][k] * s->way[1][k] + b->eye[2][k] * s->way[2][k]) * inverse;
        sine = sine < 1.0 ? sine : 1.0;
        f64 cosine = sqrt(1.0 - sine * sine), nn = 1.0 - N * N, ee = 1.0 - E * E;
        f64 aside = sqrt(nn > 0.0 ? nn : 0.0) * sine, across = sqrt(ee > 0.0 ? ee : 0.0) * sine;
        /* The largest and least cosine to the normal, the least one to the eye, over the cone. */
        f64 top = N >= cosine ? 1.0 : N * cosine + aside, low = N * cosine - aside, toward = 1.0 + E * cosine - across;
        toward = E <= -cosine ? 0.0 : toward;
        low = low > 0.0 ? low : 0.0, toward = toward > 1e-9 ? toward : 1e-9, toward = toward < 2.0 ? toward : 2.0;
        f64 c = sqrt(0.5 * toward), half = (top + sight) * (top + sight) / (2.0 * toward), left = 1.0 - c, two = left * left;
        f64 spread = 1.0 - half * (1.0 - aa), shadowed = sqrt(aa + (1.0 - aa) * low * low), all = 0.0;
        spread = spread > aa ? spread : aa;
        f64 one = aa / (spread * spread) * top / (2.0 * (f->masked[k] * top + sight * shadowed) * s->near[k] * s->near[k]);
        f64 fifth = two * two * left, share = fresnel_share(c, f->ior2[k], f->normal[k]);
        for (int j = 0; j < 3; j++) {
            f64 schlick = f->schlick[j][k], edge = f->edge[j][k];
            f64 F = f->plain[j][k] + (schlick > 0.0 ? schlick * fifth : 0.0) + (edge < 0.0 ? -edge : 0.0) + f->fresnel[j][k] * share;
            f64 x = I[j] * F;
            all = x > all ? x : all;
        }
        wrong[k] += top > 0.0 ? all * one : 0.0;
    }
}

/* Finds which receivers of a block, of `mask`, may take a node as one lamp in its middle: those for which it is wrong by at
   most `allowed`, by how much is put into error. dark: those to which no lamp of it gives anything. shining: as facets
   have the block; side: the normals of the surfaces' visible sides; smooth: those before nodes bent them, or NULL; returns:
   what any receiver of the block returns. */
static u32 may_be_one(const Clusters *t, i64 node, const Source *s, const Block *b, const Block *shining, const f64 (*side)[SIDE],
                      const f64 (*smooth)[SIDE], u64 returns, const f64 *allowed, u32 mask, u32 *dark, f32 *error) {
    f64 reach = t->reach[node], most[SIDE], wrong[SIDE] = {0};
    u32 yes = 0, none = 0, near = 0;
    Sight at;
    sight_of(t, node, b, shining, side, &at);
    for (int k = 0; k < SIDE; k++) {
        int behind = (at.up[k] + reach <= 0.0) & (at.mirrored[k] + reach <= 0.0) & !(b->returns[k] & PHONG);
        none |= (u32)((at.flat[k] + reach <= 0.0) | behind) << k;
        near |= (u32)(!(at.near[k] > 0.25 * reach) | ((b->returns[k] & (PHONG | ROUGH_MATT | SHEEN)) != 0)) << k;
    }
    *dark = mask & none, mask &= ~(none | near);
    if (!mask) return 0;
    if (s->diffuse && returns & MATT) {
        matt_errors(t, node, b, &at, most, wrong);
        if (smooth) bump_errors(t, node, b, &at, smooth, most, wrong);
    }
    if (s->glossy && returns & GGX) facet_errors(t, node, shining, &shining->facets, &at, wrong);
    if (s->glossy && returns & COAT) facet_errors(t, node, shining, &shining->coat, &at, wrong);
    for (int k = 0; k < SIDE; k++) yes |= (u32)(wrong[k] <= allowed[k]) << k;
    yes &= mask;
    for (u32 rest = yes; rest; rest &= rest - 1) error[__builtin_ctz(rest)] = (f32)(wrong[__builtin_ctz(rest)] * (1.0 + 1e-6));
    return yes;
}

/* Finds which receivers of a block, of `mask`, see a node within a small angle. */
static u32 is_small(const Clusters *t, i64 node, const Block *b, u32 mask) {
    u32 yes = 0;
    for (int k = 0; k < SIDE; k++) {
        f64 x = t->middle[3 * node] - b->P[0][k], y = t->middle[3 * node + 1] - b->P[1][k], z = t->middle[3 * node + 2] - b->P[2][k];
        yes |= (u32)(t->reach[node] * t->reach[node] < SMALL * SMALL * (x * x + y * y + z * z)) << k;
    }
    return yes & mask;
}
