/* Noise as Blender's texture nodes have it, in single precision: Perlin's gradient noise over lattice cells that are
   chosen by Jenkins' hash (hashes.h), and sums of it over octaves. Patterns must be Blender's own, so the hash and the
   scales are what its documentation and pictures show; all functions are told the number of dimensions d, 1 to 4. */
#pragma once
#include "hashes.h"

typedef struct {
    f32 v[4];
} Place4;

static inline f32 fade(f32 t) { return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f); }
static inline f32 negated(f32 x, u32 condition) { return condition ? -x : x; }

/* The slope that a cell's corner has along the way x from it. */
static inline f32 slope(u32 hash, const f32 *x, int d) {
    u32 h;
    f32 u, v, s;
    switch (d) {
    case 1:
        h = hash & 15;
        return negated((f32)(1 + (h & 7)), h & 8) * x[0];
    case 2:
        h = hash & 7;
        u = h < 4 ? x[0] : x[1];
        v = 2.0f * (h < 4 ? x[1] : x[0]);
        return negated(u, h & 1) + negated(v, h & 2);
    case 3:
        h = hash & 15;
        u = h < 8 ? x[0] : x[1];
        v = h < 4 ? x[1] : h == 12 || h == 14 ? x[0] : x[2];
        return negated(u, h & 1) + negated(v, h & 2);
    default:
        h = hash & 31;
        u = h < 24 ? x[0] : x[1];
        v = h < 16 ? x[1] : x[2];
        s = h < 8 ? x[2] : x[3];
        return negated(u, h & 1) + negated(v, h & 2) + negated(s, h & 4);
    }
}

/* Perlin's noise at p, about −1 to 1. */
static f32 noise_signed(const Place4 *p, int d) {
    static const f32 scale[5] = {0.0f, 0.2500f, 0.6616f, 0.9820f, 0.8344f};
    i32 cell[4];
    f32 in[4], share[4];
    for (int j = 0; j < d; j++) {
        /* Far away numbers are coarse: there the pattern repeats, moved by half a cell. */
        f32 x = p->v[j], moved = fabsf(x) >= 1000000.0f ? 0.5f : 0.0f;
        x = fmodf(x, 100000.0f) + moved;
        if (!isfinite(x)) return 0.0f;
        cell[j] = (i32)floorf(x);
        in[j] = x - (f32)cell[j];
        share[j] = fade(in[j]);
    }
    f32 corners[16];
    for (int corner = 0; corner < 1 << d; corner++) {
        u32 k[4];
        f32 x[4];
        for (int j = 0; j < d; j++) {
            int far = corner >> j & 1;
            k[j] = (u32)(cell[j] + far);
            x[j] = in[j] - (f32)far;
        }
        corners[corner] = slope(hash_words(k, d), x, d);
    }
    for (int j = 0; j < d; j++)
        for (int corner = 0; corner < 1 << (d - j - 1); corner++)
            corners[corner] = (1.0f - share[j]) * corners[2 * corner] + share[j] * corners[2 * corner + 1];
    return corners[0] * scale[d];
}

static inline Place4 place_scaled(const Place4 *p, f32 factor) {
    return (Place4){{p->v[0] * factor, p->v[1] * factor, p->v[2] * factor, p->v[3] * factor}};
}

/* Kinds of sums over octaves, in the order of FRACTALS in programs.py. */
enum { FBM, MULTIFRACTAL, HYBRID, RIDGED, HETERO };

typedef struct {
    int kind, normalize;
    f32 detail, roughness, lacunarity, offset, gain;
} Fractal;

static f32 sum_fbm(Place4 p, int d, const Fractal *f) {
    f32 scale = 1.0f, amplitude = 1.0f, most = 0.0f, sum = 0.0f;
    int whole = (int)f->detail;
    for (int i = 0; i <= whole; i++) {
        Place4 q = place_scaled(&p, scale);
        sum += noise_signed(&q, d) * amplitude;
        most += amplitude;
        amplitude *= f->roughness;
        scale *= f->lacunarity;
    }
    f32 rest = f->detail - floorf(f->detail);
    if (rest == 0.0f) return f->normalize ? 0.5f * sum / most + 0.5f : sum;
    Place4 q = place_scaled(&p, scale);
    f32 longer = sum + noise_signed(&q, d) * amplitude;
    if (!f->normalize) return (1.0f - rest) * sum + rest * longer;
    return (1.0f - rest) * (0.5f * sum / most + 0.5f) + rest * (0.5f * longer / (most + amplitude) + 0.5f);
}

static f32 sum_multifractal(Place4 p, int d, const Fractal *f) {
    f32 value = 1.0f, power = 1.0f, rest = f->detail - floorf(f->detail);
    for (int i = 0; i <= (int)f->detail; i++) {
        value *= power * noise_signed(&p, d) + 1.0f;
        power *= f->roughness;
        p = place_scaled(&p, f->lacunarity);
    }
    return rest == 0.0f ? value : value * (rest * power * noise_signed(&p, d) + 1.0f);
}

static f32 sum_hetero(Place4 p, int d, const Fractal *f) {
    f32 power = f->roughness, value = f->offset + noise_signed(&p, d), rest = f->detail - floorf(f->detail);
    p = place_scaled(&p, f->lacunarity);
    for (int i = 1; i <= (int)f->detail; i++) {
        value += (noise_signed(&p, d) + f->offset) * power * value;
        power *= f->roughness;
        p = place_scaled(&p, f->lacunarity);
    }
    return rest == 0.0f ? value : value + rest * ((noise_signed(&p, d) + f->offset) * power * value);
}

static f32 sum_hybrid(Place4 p, int d, const Fractal *f) {
    f32 power = 1.0f, value = 0.0f, weight = 1.0f, rest = f->detail - floorf(f->detail);
    for (int i = 0; weight > 0.001f && i <= (int)f->detail; i++) {
        if (weight > 1.0f) weight = 1.0f;
        f32 signal = (noise_signed(&p, d) + f->offset) * power;
        power *= f->roughness;
        value += weight * signal;
        weight *= f->gain * signal;
        p = place_scaled(&p, f->lacunarity);
    }
    if (rest == 0.0f || !(weight > 0.001f)) return value;
    if (weight > 1.0f) weight = 1.0f;
    return value + rest * weight * ((noise_signed(&p, d) + f->offset) * power);
}

static f32 sum_ridged(Place4 p, int d, const Fractal *f) {
    f32 power = f->roughness, signal = f->offset - fabsf(noise_signed(&p, d));
    signal *= signal;
    f32 value = signal;
    for (int i = 1; i <= (int)f->detail; i++) {
        p = place_scaled(&p, f->lacunarity);
        f32 weight = signal * f->gain;
        weight = weight < 0.0f ? 0.0f : weight > 1.0f ? 1.0f : weight;
        signal = f->offset - fabsf(noise_signed(&p, d));
        signal *= signal * weight;
        value += signal * power;
        power *= f->roughness;
    }
    return value;
}

static f32 fractal(const Place4 *p, int d, const Fractal *f) {
    switch (f->kind) {
    case MULTIFRACTAL: return sum_multifractal(*p, d, f);
    case HYBRID: return sum_hybrid(*p, d, f);
    case RIDGED: return sum_ridged(*p, d, f);
    case HETERO: return sum_hetero(*p, d, f);
    default: return sum_fbm(*p, d, f);
    }
}

/* A place far from p, another one for each seed, so that noises there have nothing to do with one another. */
static Place4 elsewhere(const Place4 *p, int d, int seed) {
    Place4 q = *p;
    for (int j = 0; j < d; j++) {
        f32 k[2] = {(f32)seed, (f32)j};
        q.v[j] += 100.0f + (d == 1 ? hash_numbers(k, 1) : hash_numbers(k, 2)) * 100.0f;
    }
    return q;
}
