/* What a record gathers by direction: the mean light of each of 64 sectors of its half-space, for surfaces that reflect
   some directions more than others. Sectors are parts of rings around the normal, about equally wide and long. */
#pragma once
#include "../rays/triangles.h"

#define SECTORS 64
#define RINGS 6
#define TURN 6.28318530717958648
#define BLUR 0.08   /* how much rougher lobes are taken, as sectors are wide: as α */
#define FACING 0.04f  /* what a facet of plastic (an index of 1.5) reflects that faces the eye: its share grows with the angle */

static const f64 RING_EDGES[RINGS + 1] = {0.0, 0.0585, 0.25, 0.5174, 0.75, 0.9045, 1.0};  /* sin² of 0, 14, 30, 46, 60, 72, 90° */
static const int RING_BEGINS[RINGS + 1] = {0, 1, 7, 17, 31, 47, 64};                      /* their first sectors */

/* The sector of the direction above x, y of the unit disk. */
static inline int sector_of(f64 x, f64 y) {
    f64 rr = x * x + y * y, turn = atan2(y, x) / TURN;
    int ring = 0;
    while (ring < RINGS - 1 && rr >= RING_EDGES[ring + 1]) ring++;
    int count = RING_BEGINS[ring + 1] - RING_BEGINS[ring], i = (int)((turn < 0.0 ? turn + 1.0 : turn) * count);
    return RING_BEGINS[ring] + (i < count ? i : count - 1);
}

/* The middle of a sector, around z; returns how much of the light that a matt surface gets comes through it. */
static inline f64 sector_middle(int k, f64 *out) {
    int ring = 0;
    while (k >= RING_BEGINS[ring + 1]) ring++;
    int count = RING_BEGINS[ring + 1] - RING_BEGINS[ring];
    f64 rr = ring ? 0.5 * (RING_EDGES[ring] + RING_EDGES[ring + 1]) : 0.0;
    f64 r = sqrt(rr), angle = TURN * (k - RING_BEGINS[ring] + 0.5) / count;
    out[0] = r * cos(angle), out[1] = r * sin(angle), out[2] = sqrt(1.0 - rr);
    return (RING_EDGES[ring + 1] - RING_EDGES[ring]) / count;
}

/* Light as three numbers of nine bits and an exponent: relative to the brightest channel it is right to 1/512. */
static inline u32 light_packed(const f64 *L) {
    f64 most = fmax(L[0], fmax(L[1], L[2]));
    int e;
    if (!(most > 0x1p-16)) return 0;
    if (most > 0x1p15) most = 0x1p15;
    frexp(most * (1.0 + 0x1p-9), &e);
    f64 scale = ldexp(1.0, 9 - e);
    u32 out = (u32)(e + 15) << 27;
    for (int j = 0; j < 3; j++) {
        f64 v = floor(fmin(fmax(L[j], 0.0), most) * scale + 0.5);
        out |= (u32)(v > 511.0 ? 511.0 : v) << 9 * j;
    }
    return out;
}

static inline void light_unpacked(u32 of, f32 *L) {
    union { u32 bits; f32 value; } scale = {((of >> 27) + 127 - 15 - 9) << 23};
    for (int j = 0; j < 3; j++) L[j] = (f32)(of >> 9 * j & 511) * scale.value;
}

/* The middles of all sectors. */
typedef struct {
    f32 x[SECTORS], y[SECTORS], z[SECTORS], angle[SECTORS];  /* angle: the solid angle */
} Middles;

static inline void sectors_middles(Middles *out) {
    for (int k = 0; k < SECTORS; k++) {
        f64 d[3];
        f64 share = sector_middle(k, d);
        out->x[k] = (f32)d[0], out->y[k] = (f32)d[1], out->z[k] = (f32)d[2], out->angle[k] = (f32)(share / d[2]);
    }
}

/* The mean light that a record with the normal M has in the lobe of microfacets of roughness alpha (GGX) of a surface with
   the normal N, which is seen along `way`. */
static inline void lobe_mean(const u32 *sectors, const Middles *at, const f64 *M, const f64 *N, const f64 *way,
                             f64 alpha, f64 *out) {
    f64 t[3], b[3];
    tangents(M, t, b);
    f32 n[3] = {(f32)dot(N, t), (f32)dot(N, b), (f32)dot(N, M)};
    f32 v[3] = {(f32)-dot(way, t), (f32)-dot(way, b), (f32)-dot(way, M)};
    f32 facing = n[0] * v[0] + n[1] * v[1] + n[2] * v[2], aa = (f32)(alpha * alpha + BLUR * BLUR), weight[SECTORS];
    for (int k = 0; k < SECTORS; k++) {
        f32 c = n[0] * at->x[k] + n[1] * at->y[k] + n[2] * at->z[k];
        f32 h = v[0] * at->x[k] + v[1] * at->y[k] + v[2] * at->z[k];
        f32 up = c > 0.05f ? c : 0.05f, sum = facing + c;
        f32 half = 2.0f + 2.0f * h, q = half > 1e-6f ? half : 1e-6f, d = q + sum * sum * (aa - 1.0f);
        d = d > 1e-6f ? d : 1e-6f;
        f32 facets = q / d, left = up / (up + sqrtf(aa + (1.0f - aa) * up * up));  /* √D but for a factor; G1 */
        f32 away = 1.0f - sqrtf(0.25f * q), twice = away * away;
        weight[k] = c > 0.0f ? facets * facets * left * at->angle[k] * (FACING + (1.0f - FACING) * twice * twice * away) : 0.0f;
    }
    f32 most = 1e-20f, all = 0.0f, sum[3] = {0};
    for (int k = 0; k < SECTORS; k++) most = weight[k] > most ? weight[k] : most;
    for (int k = 0; k < SECTORS; k++) {
        f32 L[3];
        if (weight[k] < 1e-3f * most) continue;
        light_unpacked(sectors[k], L);
        all += weight[k];
        for (int j = 0; j < 3; j++) sum[j] += weight[k] * L[j];
    }
    for (int j = 0; j < 3; j++) out[j] = all > 0.0f ? (f64)(sum[j] / all) : 0.0;
}
