/* Newton's method for one refracted path: it finds the first point of the path that ends at a given point
   (refraction.py). */
#pragma once
#include "optics.h"

/* largest numbers: steps of Newton's method; halvings of one step; triangles that one step may cross */
enum { STEPS = 25, HALVINGS = 6, WALK = 200 };

/* The signature that a path must have: codes and η of its k bends. */
typedef struct {
    i64 k;
    const i32 *code;
    const f64 *eta;
} Signature;

/* A place on a triangle. */
typedef struct {
    i64 slot;
    f64 u, v;
} Place;

/* Returns the distance of x from the last ray of the path that begins at the place `at`; *along: the length from its
   last bend to the point nearest to x, negative if there is no such path. Each further interface is searched only on
   its own patch. */
static inline f64 distance_of(const Glass *g, Path *s, const f64 *x, Place at, Signature want, Ray ray, f64 *along) {
    *along = -1.0;
    start_at(s, place_of(g, at.slot), at.u, at.v, ray);
    if ((slope_of(place_of(g, at.slot), ray) > 0.0) != (want.code[0] & 1)) return INFINITY;
    for (i64 j = 0; bend_ray(g, at.slot, at.u, at.v, want.eta[j], ray, s->normal);) {
        if (++j == want.k) return miss(ray, x, along);
        s->work[RAYS]++;
        i64 patch = want.code[j] >> 1, from = at.slot;
        f64 facing = want.code[j] & 1 ? 1.0 : -1.0;
        Hit hit = {0};
        at.slot = closest(g, ray, 0.0, INFINITY, &from, 1, patch, facing, &hit);
        at.u = hit.u, at.v = hit.v;
        if (at.slot < 0) {
            at.slot = g->planar[patch];
            if (at.slot < 0) break;
            /* A plane is extended beyond its patch, because Newton's method may come back from there. */
            const f64 *p = place_of(g, at.slot);
            f64 away = 0.0, slope = slope_of(p, ray);
            for (int i = 0; i < 3; i++) away += (p[A + i] - ray[0][i]) * p[NG + i];
            hit.t = away / slope, at.u = 0.0, at.v = 0.0;
            if (!(hit.t > 0.0 && slope * facing > 0.0)) break;
        }
        travel(place_of(g, at.slot), hit.t, ray);
    }
    return INFINITY;
}

/* Moves a place by (du, dv) over its patch, straight on across edges. On a plane no walk is necessary. At the end of
   a curved patch the walk stops. */
static inline Place walk(const Glass *g, Place at, f64 du, f64 dv) {
    if (g->planar[link_of(g, at.slot, PATCH)] >= 0) return (Place){at.slot, at.u + du, at.v + dv};
    for (int count = 0; count < WALK; count++) {
        /* Go to the end of the way, or to the edge where it leaves the triangle */
        f64 u = at.u, v = at.v, a = u + du, b = v + dv, step = 1.0;
        int edge = -1;
        if (a >= 0.0 && b >= 0.0 && a + b <= 1.0) return (Place){at.slot, a, b};
        if (b < 0.0 && dv < 0.0 && -v / dv < step) step = -v / dv, edge = 0;
        if (a + b > 1.0 && du + dv > 0.0 && (1.0 - u - v) / (du + dv) < step) step = (1.0 - u - v) / (du + dv), edge = 1;
        if (a < 0.0 && du < 0.0 && -u / du < step) step = -u / du, edge = 2;
        if (edge < 0) break;
        step = step > 0.0 ? step : 0.0;
        at.u = u = u + step * du, at.v = v = v + step * dv;
        du = (1.0 - step) * du, dv = (1.0 - step) * dv;
        /* The triangle across the edge */
        i64 other = link_of(g, at.slot, NEIGHBOUR + edge);
        if (other < 0) break;
        const f64 *p = place_of(g, at.slot), *q = place_of(g, other);
        f64 cosine = 0.0, along = 0.0;
        for (int j = 0; j < 3; j++) {
            cosine += p[NG + j] * q[NG + j];
            along += (du * p[E1 + j] + dv * p[E2 + j]) * q[NG + j];
        }
        if (cosine < -0.99) break;
        /* Turn the rest of the way around the edge into the plane of the next triangle. */
        f64 f = along / (1.0 + cosine), new_u = 0.0, new_v = 0.0, new_du = 0.0, new_dv = 0.0;
        for (int j = 0; j < 3; j++) {
            f64 way = du * p[E1 + j] + dv * p[E2 + j] - f * (p[NG + j] + q[NG + j]);
            f64 here = p[A + j] + u * p[E1 + j] + v * p[E2 + j] - q[A + j];
            new_u += here * q[U + j];
            new_v += here * q[V + j];
            new_du += way * q[U + j];
            new_dv += way * q[V + j];
        }
        at = (Place){other, new_u > 0.0 ? new_u : 0.0, new_v > 0.0 ? new_v : 0.0};
        du = new_du, dv = new_dv;
        f64 sum = at.u + at.v;
        if (sum > 1.0) at.u = at.u / sum, at.v = at.v / sum;
    }
    return at;
}

/* Applies Newton's method to the first place of a path with the signature `want`, until its last ray passes through
   x. Returns the place, with slot −1 if none is found. A step is halved until it brings the ray nearer. The unknown
   is the position on the first surface and not the direction at the light, because at grazing angles a direction is
   not precise enough (method §3). */
static inline Place newton(const Glass *g, Path *s, const f64 *x, Place at, Signature want) {
    static const Place none = {-1, 0.0, 0.0};
    f64 size = g->patch_size[want.code[0] >> 1], distance = INFINITY, along = 0.0, du = 0.0, dv = 0.0, damp = 0.0;
    int left = -1;  /* the first attempt is at the seed itself */
    Ray trial;
    for (int count = 0; count < STEPS; count++) {
        /* Make the step; halve it until the ray passes nearer to x */
        int nearer = 0;
        while (left >= -1) {
            f64 along_trial, off;
            Place there = walk(g, at, damp * du, damp * dv);
            off = distance_of(g, s, x, there, want, trial, &along_trial);
            nearer = along_trial > 0.0 && off < distance;
            if (nearer) at = there, distance = off, along = along_trial;
            if (nearer || left <= 0) break;
            left--;
            damp *= 0.5;
        }
        if (!nearer) return distance > 1e-11 * size ? none : at;  /* otherwise only rounding errors are left */
        /* The next step */
        s->work[NEWTON]++;
        f64 m[3][2], square_of = 0.0;
        cross_section(trial, x, along, m);
        f64 det = m[0][0] * m[1][1] - m[1][0] * m[0][1];
        if (!(fabs(det) > 1e-300)) return none;
        du = (m[2][0] * m[1][1] - m[1][0] * m[2][1]) / det;
        dv = (m[0][0] * m[2][1] - m[2][0] * m[0][1]) / det;
        /* Is it small enough to be the last, or too long? */
        const f64 *p = place_of(g, at.slot);
        for (int j = 0; j < 3; j++) square_of += square(du * p[E1 + j] + dv * p[E2 + j]);
        f64 length = sqrt(square_of);
        if (!(length < INFINITY)) return none;
        if (length <= 1e-9 * size)  /* the next step would be about the square of this one */
            return distance > 1e-8 * size ? none : (Place){at.slot, at.u + du, at.v + dv};
        damp = 0.5 * size / length < 1.0 ? 0.5 * size / length : 1.0, left = HALVINGS;
    }
    return none;
}
