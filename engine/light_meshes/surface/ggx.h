/* Highlights of microfacets: the GGX distribution with Smith's height-correlated masking, as Cycles has them.

   B. Walter et al.: Microfacet models for refraction through rough surfaces, EGSR 2007 (the distribution). E. Heitz:
   Understanding the masking-shadowing function, JCGT 3(2), 2014. C. Kulla, A. Conty: Revisiting physically based shading
   at Imageworks, SIGGRAPH 2017 (what is reflected several times; the mean of Fresnel's equations). L. Belcour et al.:
   Energy conserving and F82 metals (Adobe Standard Material; A. Kutz, N. Hasan, E. Edmondson, 2021).

   A surface has a metal's lobe, with Schlick's Fresnel term, and a dielectric's, with Fresnel's equations; both have one
   roughness. With c the cosine of eye and half vector, both together reflect per channel

       F(c) = plain + schlick·(1−c)⁵ − edge·c·(1−c)⁶ + fresnel·s(c),

   s being Fresnel's equations brought to run from 0 at c = 1 to 1 at c = 0. */
#pragma once
#include "native.h"

/* A material's numbers, a row of shading.py's `ggx_rows`. */
enum { G_ON, G_ROUGHNESS, G_METAL, G_F0, G_F90 = G_F0 + 3, G_F82 = G_F90 + 3, G_DIELECTRIC = G_F82 + 3, G_IOR, G_TINT,
       G_LAYERED = G_TINT + 3, G_COMPENSATION, G_COAT, G_COAT_ROUGHNESS, G_COAT_IOR, G_COAT_TINT,
       G_SIGMA = G_COAT_TINT + 3, G_COUNTS, G_SHEEN, G_SHEEN_ROUGHNESS, G_SHEEN_TINT, G_ON_COAT = G_SHEEN_TINT + 3,
       G_ON_SHEEN, G_MATT_SEVERAL, G_COAT_SEVERAL, G_BUMPS, G_COLUMNS };

/* Tables, one behind the other: E(roughness, cosine of the eye), its mean over cosines, s(ior, roughness, cosine). */
enum { G_FINE = 32, G_COARSE = 16, G_MEAN = G_FINE * G_FINE, G_SHARE = G_MEAN + G_FINE,
       G_TABLES = G_SHARE + G_COARSE * G_COARSE * G_COARSE };

/* Highlights of lamps are not smaller than those of this roughness: a point that shines in a mirror would be a dot that
   few samples find. */
#define SMOOTHEST 0.1
/* The least cosine of the eye, which smooth normals may turn away from. */
#define LEAST_SIGHT 1e-3

/* What one receiver reflects. */
typedef struct {
    f64 alpha2, sight, masked, ior2, normal, plain[3], schlick[3], edge[3], fresnel[3];
} Gloss;

static inline f64 held(f64 x, f64 low, f64 high) { return x < low ? low : x > high ? high : x; }

/* Fresnel's equations for an index of refraction, its square given. */
static inline f64 fresnel_of(f64 c, f64 ior2) {
    f64 gg = ior2 - 1.0 + c * c, g = sqrt(gg > 0.0 ? gg : 0.0), a = g - c, b = g + c;
    f64 p = (c * b - 1.0) / (c * a + 1.0);
    return 0.5 * (a * a) / (b * b) * (1.0 + p * p);
}

/* Those, brought to 0 at normal incidence, where they are `normal`, and 1 at a grazing angle. */
static inline f64 fresnel_share(f64 c, f64 ior2, f64 normal) {
    f64 s = (fresnel_of(c, ior2) - normal) / (1.0 - normal);
    s = s > 0.0 ? s : 0.0;
    return s < 1.0 ? s : 1.0;
}

static inline f64 normal_reflectance(f64 ior) { return square((ior - 1.0) / (ior + 1.0)); }

/* Linear between the n entries of a table that stand `stride` apart; x from 0 to 1. */
static inline void place_in(f64 x, int n, int *at, f64 *t) {
    x = held(x, 0.0, 1.0) * (n - 1);
    *at = (int)x < n - 2 ? (int)x : n - 2;
    *t = x - *at;
}

static inline f64 bilinear(const f64 *table, int n, f64 roughness, f64 cosine) {
    int r, c;
    f64 a, b;
    place_in(roughness, n, &r, &a), place_in(cosine, n, &c, &b);
    const f64 *p = table + r * n + c;
    return (1.0 - a) * ((1.0 - b) * p[0] + b * p[1]) + a * ((1.0 - b) * p[n] + b * p[n + 1]);
}

/* The mean of s over the microfacets that an eye sees. */
static inline f64 mean_share(const f64 *tables, f64 ior, f64 roughness, f64 cosine) {
    int z;
    f64 t;
    place_in(sqrt(fabs((ior - 1.0) / (ior + 1.0))), G_COARSE, &z, &t);
    const f64 *p = tables + G_SHARE + z * G_COARSE * G_COARSE;
    return (1.0 - t) * bilinear(p, G_COARSE, roughness, cosine) +
           t * bilinear(p + G_COARSE * G_COARSE, G_COARSE, roughness, cosine);
}

/* How much more the lobe gets by light that microfacets reflect several times: 1 + Fms·(1 − E)/E. F: its mean. */
static inline f64 with_several(f64 F, f64 E_mean, f64 lost) { return 1.0 + F * E_mean / (1.0 - F * (1.0 - E_mean)) * lost; }

/* Kulla and Conty's fit to the mean of Fresnel's equations over all angles. */
static inline f64 mean_fresnel(f64 ior) {
    return ior < 1.0 ? 0.997118 + ior * (0.1014 - ior * (0.965241 + ior * 0.130607)) : (ior - 1.0) / (4.08567 + 1.00071 * ior);
}

/* E, lost = (1 − E)/E where that counts, and the mean of E. */
static inline f64 lost_of(const f64 *m, const f64 *tables, f64 roughness, f64 sight, f64 *E_mean) {
    int r;
    f64 t, E = bilinear(tables, G_FINE, roughness, sight);
    place_in(roughness, G_FINE, &r, &t);
    *E_mean = (1.0 - t) * tables[G_MEAN + r] + t * tables[G_MEAN + r + 1];
    return m[G_COMPENSATION] * (1.0 - E) / E;
}

/* The dielectric's reflectance at normal incidence in channel j, and its mean. */
static inline f64 dielectric_mean(const f64 *m, int j, f64 normal, f64 *f0) {
    *f0 = held(normal * m[G_TINT + j], 0.0, 1.0);
    f64 s = held((mean_fresnel(m[G_IOR]) - normal) / (1.0 - normal), 0.0, 1.0);
    return *f0 + (1.0 - *f0) * s;
}

/* Which share of the light gets past the dielectric, for what is below it; as Cycles of the brightest channel. */
static inline f64 below(const f64 *m, const f64 *tables, f64 facing) {
    if (m[G_LAYERED] <= 0.0) return 1.0;
    f64 roughness = held(m[G_ROUGHNESS], 0.0, 1.0), E_mean, most = 0.0;
    f64 sight = held(facing, LEAST_SIGHT, 1.0), normal = normal_reflectance(m[G_IOR]);
    f64 lost = lost_of(m, tables, roughness, sight, &E_mean), s = mean_share(tables, m[G_IOR], roughness, sight);
    for (int j = 0; j < 3; j++) {
        f64 f0, mean = dielectric_mean(m, j, normal, &f0);
        f64 all = (f0 + (1.0 - f0) * s) * with_several(mean, E_mean, lost) / (1.0 + lost);
        most = all > most ? all : most;
    }
    return 1.0 - m[G_LAYERED] * held(most, 0.0, 1.0);
}

/* Whether a material of the row m reflects anything in channel j. */
static inline int facets_shine(const f64 *m, int j) {
    return m[G_COAT] > 0.0 || (m[G_METAL] > 0.0 && (m[G_F0 + j] > 0.0 || m[G_F90 + j] > 0.0)) || (m[G_DIELECTRIC] > 0.0 && m[G_IOR] != 1.0);
}

/* What a material of the row m would reflect to an eye at the cosine `facing` if it had this roughness. */
static inline Gloss gloss_at(const f64 *m, const f64 *tables, f64 facing, f64 roughness) {
    f64 alpha = square(roughness), E_mean;
    Gloss g = {.alpha2 = square(alpha), .sight = held(facing, LEAST_SIGHT, 1.0), .ior2 = square(m[G_IOR])};
    g.masked = sqrt(g.alpha2 + (1.0 - g.alpha2) * square(g.sight));
    g.normal = normal_reflectance(m[G_IOR]);
    f64 lost = lost_of(m, tables, roughness, g.sight, &E_mean);
    const f64 f = 6.0 / 7.0, f5 = f * f * f * f * f;  /* 1 − cos 82° is 6/7 */
    for (int j = 0; j < 3; j++) {
        f64 F0 = m[G_F0 + j], F90 = m[G_F90 + j], f0;
        f64 edge = (F0 + (F90 - F0) * f5) * (1.0 - m[G_F82 + j]) * 7.0 / (f5 * f);
        f64 F = held(F0 + (F90 - F0) / 21.0 - edge / 126.0, 0.0, 1.0);
        f64 metal = m[G_METAL] * with_several(F, E_mean, lost);
        f64 mean = dielectric_mean(m, j, g.normal, &f0);
        f64 dielectric = m[G_DIELECTRIC] * with_several(mean, E_mean, lost);
        g.plain[j] = metal * F0 + dielectric * f0;
        g.schlick[j] = metal * (F90 - F0);
        g.edge[j] = metal * edge;
        g.fresnel[j] = dielectric * (1.0 - f0);
    }
    return g;
}

/* What it reflects of lamps. */
static inline Gloss gloss_row(const f64 *m, const f64 *tables, f64 facing) {
    return gloss_at(m, tables, facing, held(m[G_ROUGHNESS], SMOOTHEST, 1.0));
}
