/* Rough matt surfaces: Y. Fujii's form of Oren and Nayar's model (A tiny improvement of Oren-Nayar reflectance model, 2012),
   and what it loses by light that is scattered several times, as OpenPBR has it (Kulla and Conty); releases of Cycles before
   4.3 have only the first. */
#pragma once
#include "native.h"

/* What is the same for all lights: f = (a + b·t)/π + several·(1 − E(N·L))/π, all times π. */
typedef struct {
    f64 a, b, sight, several[3];
} RoughMatt;

/* The integral of the second term over all directions of light, over π·b. */
static inline f64 rough_tail(f64 cosine) {
    if (cosine < 1e-6) return PI / 2.0 - 2.0 / 3.0 - cosine;
    f64 sine = sqrt(1.0 - cosine < 0.0 ? 0.0 : 1.0 - cosine * cosine);
    return sine * (acos(cosine < 1.0 ? cosine : 1.0) - 2.0 / 3.0 - sine * cosine) +
           2.0 / 3.0 * (sine / cosine) * (1.0 - sine * sine * sine);
}

/* Which share of light from everywhere comes back at once, to an eye (or from a light) at this cosine. */
static inline f64 rough_once(const RoughMatt *m, f64 cosine) { return m->a + m->b * rough_tail(cosine) / PI; }

/* A surface of this roughness (0 … 1) and colour, for an eye at the cosine `facing`; several: the share of light scattered
   several times that counts. */
static inline RoughMatt rough_matt(f64 roughness, f64 facing, const f64 *colour, f64 several) {
    f64 a = PI / (PI + roughness * (PI / 2.0 - 2.0 / 3.0)), mean = a + (2.0 * PI - 5.6) / (3.0 * PI) * roughness * a;
    RoughMatt m = {a, roughness * a, facing > 0.0 ? facing : 0.0, {0.0}};
    f64 lost = several * (1.0 - rough_once(&m, m.sight));
    for (int j = 0; j < 3; j++) {
        f64 albedo = colour[j] < 0.0 ? 0.0 : colour[j] < 1.0 ? colour[j] : 1.0;
        m.several[j] = albedo * albedo * mean / (1.0 - mean) / (1.0 - albedo * (1.0 - mean)) * lost;
    }
    return m;
}

/* How much more than a smooth surface it returns of light at the cosine nl, in each channel; together: the cosine between
   light and eye. */
static inline void rough_more(const RoughMatt *m, f64 nl, f64 together, f64 *more) {
    f64 t = together - nl * m->sight, larger = nl > m->sight ? nl : m->sight;
    if (t > 0.0) t /= larger > 1e-30 ? larger : 1e-30;
    for (int j = 0; j < 3; j++) more[j] = m->a + m->b * t + m->several[j] * (1.0 - rough_once(m, nl)) - 1.0;
}
