/* What the kernels of shading.c take, and blocks of receivers, into which they load it: a vector's width of them. */
#pragma once
#include "../lights/types.h"
#include "layers.h"
#include "rough_matt.h"
#include "sized_block.h"
#include "sized_facets.h"

_Static_assert((int)NO_TYPE <= (int)BALL, "numbers of types of light and of lamps with a size must differ");

/* The `Gloss` of each receiver of a block. */
typedef struct {
    f64 alpha2[SIDE], sight[SIDE], masked[SIDE], ior2[SIDE], normal[SIDE];
    f64 plain[3][SIDE], schlick[3][SIDE], edge[3][SIDE], fresnel[3][SIDE];
} Facets;

/* A block of receivers. Bits 0..2 of `returns`: channels in which matt, or what fibres return, is not 0; bits 3..5: the same for Phong's gloss;
   bits 6..8: for that of GGX; bit 9: whether it has a coat; bit 10: whether its matt part is rough; bit 11:
   whether it has fibres. `facets` and `coat` are filled if any material has GGX. */
typedef struct {
    f64 P[3][SIDE], Ng[3][SIDE], Ns[3][SIDE], eye[3][SIDE], matt[3][SIDE], gloss[3][SIDE], facing[SIDE];
    u64 returns[SIDE];
    f64 facet_bumps[SIDE];  /* 1: bumps soften light as facets would, 0: by the light's angle alone (bent.h) */
    Facets facets, coat;
    RoughMatt rough[SIDE];  /* filled where bit 10 is set */
    Fibres fibres[SIDE];  /* filled where bit 11 is set */
    f64 middle[3], around;  /* `enclose`: a ball that has all receivers */
} Block;
enum { MATT = 7, PHONG = 7 << 3, GGX = 7 << 6, COAT = 1 << 9, ROUGH_MATT = 1 << 10, SHEEN = 1 << 11 };

/* All lights and materials, and the hits of rays with `direction`, as in shading.py. */
typedef struct {
    const i8 *type;
    const f64 *position, *direction, *intensity, *edge, *slope, *axes, *extent;
    const u8 *diffuse, *glossy;
} Lights;

typedef struct {
    const f64 *kd, *ks, *Os, *nShiny, *ggx, *tables;  /* ggx: NULL if no material has it */
} Materials;

typedef struct {
    i64 n;
    const f64 *P, *Ng, *Ns, *direction, *Od;
    const i32 *material;
    const f64 *smooth;  /* the normals before nodes bent them; NULL: they are Ns */
} Receivers;

#define LIGHTS "type i8[L]  position f64[L,3]  direction f64[L,3]  intensity f64[L,3]  edge f64[L]  slope f64[L]  "  \
               "axes f64[L,3,3]  extent f64[L,8]  diffuse bool[L]  glossy bool[L]  "
#define MATERIALS "kd f64[M]  ks f64[M]  Os f64[M,3]  nShiny f64[M]  ggx f64[M,37]?  tables f64[T]?  "
#define HITS "P f64[n,3]  Ng f64[n,3]  Ns f64[n,3]  way f64[n,3]  Od f64[n,3]  material i32[n]  smooth f64[n,3]?  "
#define TAKEN                                                                                                      \
    const i8 *type, const f64 *position, const f64 *direction, const f64 *intensity, const f64 *edge,            \
        const f64 *slope, const f64 *axes, const f64 *extent, const u8 *diffuse, const u8 *glossy, const f64 *kd, \
        const f64 *ks, const f64 *Os, const f64 *nShiny, const f64 *ggx, const f64 *tables, const f64 *P, const f64 *Ng,        \
        const f64 *Ns, const f64 *way, const f64 *Od, const i32 *material, const f64 *smooth
#define GATHERED                                                              \
    Lights lights = {type, position, direction, intensity, edge, slope, axes, extent, diffuse, glossy}; \
    Materials materials = {kd, ks, Os, nShiny, ggx, tables};                 \
    Receivers hits = {n, P, Ng, Ns, way, Od, material, smooth};              \
    (void)M, (void)T;                                                        \
    if (ggx && !tables) return OUTSIDE

static Source source_of(const Lights *l, i64 i) {
    const f64 *a = l->position + 3 * i, *d = l->direction + 3 * i, *c = l->intensity + 3 * i;
    return (Source){l->type[i], l->diffuse[i], l->glossy[i], a[0], a[1], a[2], d[0], d[1], d[2], l->edge[i], l->slope[i],
                    {c[0], c[1], c[2]}, l->axes + 9 * i, l->extent + 8 * i};
}

/* Puts a receiver's `Gloss`, as much of it as gets through to it and back, at place k. */
static void put(Facets *f, int k, const Gloss *g, const f64 *through) {
    f->alpha2[k] = g->alpha2, f->sight[k] = g->sight, f->masked[k] = g->masked;
    f->ior2[k] = g->ior2, f->normal[k] = g->normal;
    for (int j = 0; j < 3; j++) {
        f->plain[j][k] = through[j] * g->plain[j], f->schlick[j][k] = through[j] * g->schlick[j];
        f->edge[j][k] = through[j] * g->edge[j], f->fresnel[j][k] = through[j] * g->fresnel[j];
    }
}

/* Loads what receiver k reflects by its facets; m: the row of its material, NULL if it has none; tables: NULL if only
   `returns` is wanted; on_coat: the cosine of the eye to a coat's normal. */
static void fill_facets(Block *b, int k, const f64 *m, const f64 *tables, f64 on_coat) {
    for (int j = 0; m && j < 3; j++) {
        b->gloss[j][k] = 1.0;  /* their colour is in the facets */
        b->returns[k] &= ~((u64)1 << (3 + j));
        b->returns[k] |= (u64)facets_shine(m, j) << (6 + j) | (u64)(m[G_SHEEN] > 0.0 && m[G_SHEEN_TINT + j] > 0.0) << j;
    }
    if (!tables) return;
    static const Gloss none = {.alpha2 = 1.0, .sight = 1.0, .masked = 1.0, .ior2 = 1.0};
    f64 coat[G_COLUMNS], through[3] = {1.0, 1.0, 1.0};
    Gloss base = none, above = none;
    if (m && m[G_COAT] > 0.0 && m[G_COAT_ROUGHNESS] >= 0.0) {  /* below 0: `shading.rough_only` took its highlight */
        coat_row(m, coat);
        to_coat(m, b->facing[k], through);
        above = gloss_row(coat, tables, b->facing[k]);
        b->returns[k] |= COAT;
    }
    put(&b->coat, k, &above, through);
    if (m) base = gloss_row(m, tables, b->facing[k]), to_base(m, tables, b->facing[k], on_coat, through);
    put(&b->facets, k, &base, through);
    if (m && m[G_SHEEN] > 0.0) {
        b->fibres[k] = fibres_of(m, b->facing[k]);
        b->returns[k] |= SHEEN;
    }
}

/* Loads the receivers from `first` on; the last receiver also fills places that are left over. Ns: the normal of the first
   one, and of those behind it. Returns the bits `returns` of all. */
static u64 fill(Block *b, i64 first, const Materials *materials, const Receivers *hits, const f64 *Ns) {
    u64 all = 0;
    for (int k = 0; k < SIDE; k++) {
        i64 p = first + k < hits->n - 1 ? first + k : hits->n - 1, m = hits->material[p];
        const f64 *N = Ns + 3 * (p - first);
        b->facing[k] = 0.0, b->returns[k] = 0, b->facet_bumps[k] = 1.0;
        for (int j = 0; j < 3; j++) {
            f64 way = hits->direction[3 * p + j];
            b->P[j][k] = hits->P[3 * p + j], b->Ng[j][k] = hits->Ng[3 * p + j], b->Ns[j][k] = N[j];
            b->eye[j][k] = -way;
            b->facing[k] -= N[j] * way;
            b->matt[j][k] = materials->kd[m] * hits->Od[3 * p + j];
            b->gloss[j][k] = materials->ks[m] * materials->Os[3 * m + j];
            b->returns[k] |= (u64)(b->matt[j][k] != 0.0) << j | (u64)(b->gloss[j][k] != 0.0) << (3 + j);
        }
        if (materials->ggx) {
            const f64 *row = materials->ggx + G_COLUMNS * m;
            f64 on_coat = b->facing[k];
            b->facet_bumps[k] = row[G_BUMPS];
            if (hits->smooth) on_coat = -dot3(hits->smooth + 3 * p, hits->direction + 3 * p);
            fill_facets(b, k, row[G_ON] != 0.0 ? row : 0, materials->tables, on_coat);
            if (row[G_SIGMA] > 0.0) {
                f64 own[3] = {hits->Od[3 * p], hits->Od[3 * p + 1], hits->Od[3 * p + 2]};
                if (row[G_ON] != 0.0 && materials->tables) undimmed(row, materials->tables, b->facing[k], on_coat, own);
                b->returns[k] |= ROUGH_MATT;
                b->rough[k] = rough_matt(row[G_SIGMA], b->facing[k], own, row[G_MATT_SEVERAL]);
            }
        }
        all |= b->returns[k];
    }
    return all;
}

/* What arrives from a light at a receiver: whether ξ·f_att ≠ 0, f_att, 1/|L − P|, and N·L and R·V, both multiplied
   by |L − P|. `lit` has the width of the numbers, so that the compiler need not convert vectors. */
typedef struct {
    i64 lit;
    f64 power, inverse, cosine, lobe;
} Arriving;

INLINE Arriving arriving(int kind, const Source *s, const Block *b, int k) {
    Way way = way_to_light(kind, s, b->P[0][k], b->P[1][k], b->P[2][k]);
    way.lit &= b->Ng[0][k] * way.x + b->Ng[1][k] * way.y + b->Ng[2][k] * way.z > 0.0;
    f64 cosine = b->Ns[0][k] * way.x + b->Ns[1][k] * way.y + b->Ns[2][k] * way.z;
    /* R·V with R = 2(N·L)N − L */
    f64 lobe = 2.0 * cosine * b->facing[k] - (way.x * b->eye[0][k] + way.y * b->eye[1][k] + way.z * b->eye[2][k]);
    return (Arriving){way.lit, way.power, way.inverse, cosine, lobe};
}

static Sized size_of(const Source *s) {
    return sized_of(s->kind, (f64[3]){s->x, s->y, s->z}, (f64[3]){s->u, s->v, s->w}, s->edge, s->slope, s->axes, s->extent);
}

/* Finds a ball that all receivers of a block are in. */
static void enclose(Block *b) {
    f64 most = 0.0;
    for (int j = 0; j < 3; j++) {
        f64 low = b->P[j][0], high = low;
        for (int k = 1; k < SIDE; k++) low = b->P[j][k] < low ? b->P[j][k] : low, high = b->P[j][k] > high ? b->P[j][k] : high;
        b->middle[j] = 0.5 * (low + high), most += square(high - low);
    }
    b->around = 0.5 * sqrt(most) * (1.0 + 1e-9);
}

/* Whether the cone of a spot with a size passes all receivers of an enclosed block by. Then `may_reach` is no for each:
   what they are and the lamp's radius around them lies within asin((around + radius)/far) of the way to their middle. */
static int passes_by(const Sized *s, const Block *b) {
    f64 way[3] = {s->c[0] - b->middle[0], s->c[1] - b->middle[1], s->c[2] - b->middle[2]};
    f64 far = sqrt(dot3(way, way)), reach = b->around + s->radius;
    if (s->own || !(far > reach)) return 0;
    return safe_acos(-dot3(way, s->axis) / far) - asin(reach / far) > safe_acos(s->edge) + 1e-6;
}

/* Copies receiver k's vector out of a block. */
static inline void taken(const f64 (*from)[SIDE], int k, f64 *out) {
    for (int j = 0; j < 3; j++) out[j] = from[j][k];
}
