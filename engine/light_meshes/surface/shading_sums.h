/* What receivers of a block return of a light, added up: part of shading.c and clusters.c. */
#pragma once
#include "bent.h"

/* add and add_gloss for lamps with a size; FOR_KIND calls them by these names. */
static void add_sized(const Source *source, const f64 (*S)[SIDE], const int *channel, const Block *b, f64 (*total)[SIDE]) {
    const Sized s = size_of(source);
    const f64 *red = S[channel[0]], *green = S[channel[1]], *blue = S[channel[2]];
    f64 power[SIDE];
    u8 wanted[SIDE];
    for (int k = 0; k < SIDE; k++) wanted[k] = red[k] != 0.0 || green[k] != 0.0 || blue[k] != 0.0, power[k] = 0.0;
    matt_block(&s, b->P, b->Ns, wanted, power);
    for (int k = 0; k < SIDE; k++) {
        f64 light = wanted[k] ? power[k] : 0.0;
        total[0][k] += red[k] * (light * source->colour[0]);
        total[1][k] += green[k] * (light * source->colour[1]);
        total[2][k] += blue[k] * (light * source->colour[2]);
    }
}

/* Returns the highlight of receiver k: the lamp's mean of f_att·(R·V)^nShiny. */
static f64 gloss_sized(const Sized *s, const Block *b, int k, f64 nShiny) {
    f64 P[3], Ng[3], M[3];
    taken(b->P, k, P), taken(b->Ng, k, Ng);
    for (int j = 0; j < 3; j++) M[j] = 2.0 * b->facing[k] * b->Ns[j][k] - b->eye[j][k];
    return gloss_of(s, P, M, Ng, nShiny);
}

static void add_gloss_sized(const Source *source, const f64 (*S)[SIDE], const int *channel, const Block *b, int count,
                            const f64 *nShiny, f64 (*total)[SIDE]) {
    const Sized s = size_of(source);
    for (int k = 0; k < count; k++) {
        const f64 share[3] = {S[channel[0]][k], S[channel[1]][k], S[channel[2]][k]};
        if (!(b->returns[k] & PHONG) || (share[0] == 0.0 && share[1] == 0.0 && share[2] == 0.0)) continue;
        f64 power = gloss_sized(&s, b, k, nShiny[k]);
        for (int j = 0; j < 3; j++) total[j][k] += share[j] * (power * source->colour[j]);
    }
}

/* total += S·f_att·I·(N·L); S is 0 where ξ is. */
INLINE void add(int kind, const Source *s, const f64 (*S)[SIDE], const int *channel, const Block *b, f64 (*total)[SIDE]) {
    const f64 *red = S[channel[0]], *green = S[channel[1]], *blue = S[channel[2]];
    for (int k = 0; k < SIDE; k++) {
        Arriving a = arriving(kind, s, b, k);
        f64 power = a.power * (a.cosine * a.inverse);
        power = a.cosine > 0.0 ? power : 0.0;
        total[0][k] += red[k] * (power * s->colour[0]);
        total[1][k] += green[k] * (power * s->colour[1]);
        total[2][k] += blue[k] * (power * s->colour[2]);
    }
}

/* total += S·f_att·I·(N·L) times by how much a rough matt surface returns more than a smooth one. */
INLINE void add_rough(int kind, const Source *s, const f64 (*S)[SIDE], const int *channel, const Block *b, int count,
                      f64 (*total)[SIDE]) {
    for (int k = 0; k < count; k++) {
        if (!(b->returns[k] & ROUGH_MATT)) continue;
        Arriving a = arriving(kind, s, b, k);
        f64 more[3], nl = a.cosine * a.inverse;
        if (nl <= 0.0) continue;
        rough_more(&b->rough[k], nl, (2.0 * a.cosine * b->facing[k] - a.lobe) * a.inverse, more);
        for (int j = 0; j < 3; j++) total[j][k] += S[channel[j]][k] * (a.power * nl * more[j] * s->colour[j]);
    }
}

/* The same for a lamp with a size: as much more as of light from its middle. */
static void add_rough_sized(const Source *source, const f64 (*S)[SIDE], const int *channel, const Block *b, int count,
                            f64 (*total)[SIDE]) {
    const Sized s = size_of(source);
    const Source middle = middle_of(source);
    for (int k = 0; k < count; k++) {
        if (!(b->returns[k] & ROUGH_MATT)) continue;
        f64 P[3], N[3], more[3];
        taken(b->P, k, P), taken(b->Ns, k, N);
        Arriving a = arriving(middle.kind, &middle, b, k);
        f64 power = matt_of(&s, P, N), nl = a.cosine * a.inverse;
        rough_more(&b->rough[k], nl > 0.0 ? nl : 0.0, (2.0 * a.cosine * b->facing[k] - a.lobe) * a.inverse, more);
        for (int j = 0; j < 3; j++) total[j][k] += S[channel[j]][k] * (power * more[j] * source->colour[j]);
    }
}

static f64 lobe_power(Arriving a, f64 nShiny) {
    f64 base = a.lobe * a.inverse;
    return pow(base < 1.0 ? base : 1.0, nShiny);
}

/* total += S·f_att·I·(R·V)^nShiny. */
INLINE void add_gloss(int kind, const Source *s, const f64 (*S)[SIDE], const int *channel, const Block *b, int count,
                      const f64 *nShiny, f64 (*total)[SIDE]) {
    const f64 *red = S[channel[0]], *green = S[channel[1]], *blue = S[channel[2]];
    for (int k = 0; k < count; k++) {
        Arriving a = arriving(kind, s, b, k);
        if (!(b->returns[k] & PHONG) || a.lobe <= 0.0 || (red[k] == 0.0 && green[k] == 0.0 && blue[k] == 0.0)) continue;
        f64 power = a.power * lobe_power(a, nShiny[k]);
        total[0][k] += red[k] * (power * s->colour[0]);
        total[1][k] += green[k] * (power * s->colour[1]);
        total[2][k] += blue[k] * (power * s->colour[2]);
    }
}

/* What receivers of a block get of a light, added up: what they scatter, mirror, and what their fibres return. */
typedef struct {
    f64 matt[3][SIDE], shine[3][SIDE], cloth[3][SIDE];
} Sums;

/* sums += what the `count` receivers of a block get of a light. returns: all that they return. shining: the block as
   facets have it. S: shares of the light; matt_S: of what matt surfaces and fibres get. */
static void add_all(const Source *s, const f64 (*S)[SIDE], const f64 (*matt_S)[SIDE], const int *channel, const Block *b,
                    const Block *shining, u64 returns, int count, const f64 *nShiny, Sums *sums) {
    if (s->diffuse) FOR_KIND(add, s->kind, s, matt_S, channel, b, sums->matt)
    if (returns & ROUGH_MATT && s->diffuse) FOR_KIND(add_rough, s->kind, s, matt_S, channel, b, count, sums->matt)
    if (returns & PHONG && s->glossy) FOR_KIND(add_gloss, s->kind, s, S, channel, b, count, nShiny, sums->shine)
    if (returns & GGX && s->glossy) FOR_KIND(add_facets, s->kind, s, S, channel, shining, &shining->facets, sums->shine)
    if (returns & COAT && s->glossy) FOR_KIND(add_facets, s->kind, s, S, channel, shining, &shining->coat, sums->shine)
    if (returns & SHEEN && s->diffuse) FOR_KIND(add_fibres, s->kind, s, matt_S, channel, b, sums->cloth)
}
