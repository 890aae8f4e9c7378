/* The light of lamps with a size at one receiver, and at receivers side by side. */
#pragma once
#include "sized_gloss.h"

/* A lamp that is so much farther away than large is lit as a point: 1/FAR² of the light is lost by that. */
#define FAR 3000.0

/* The way from P to the lamp's centre, and how far the lamp reaches from there at most. */
static f64 way_and_reach(const Sized *s, const f64 *P, f64 *way) {
    for (int j = 0; j < 3; j++) way[j] = s->kind == SKY ? s->c[j] : s->c[j] - P[j];
    if (s->kind < PLATE) return s->radius;
    return sqrt(s->kind == PLATE ? 2.0 * fmax(dot3(s->u, s->u), dot3(s->v, s->v)) : fmax(dot3(s->u, s->u), dot3(s->v, s->v)));
}

/* Whether a receiver at the squared distance `far` from the lamp's centre, `height` above its plane, is out of its spread. */
static int beside_spread(const Sized *s, f64 far, f64 height, f64 reach) {
    return s->spread && safe_root(far - height * height) > reach + s->edge * height;
}

/* Whether any of the lamp may light P over the horizon of N; never no where some does. */
static int may_reach(const Sized *s, const f64 *P, const f64 *N) {
    f64 way[3], up, reach = way_and_reach(s, P, way), length = sqrt(dot3(way, way));
    up = dot3(way, N);
    if (s->kind < PLATE) {
        if (up + reach <= 0.0) return 0;
        if (s->kind != BALL_SPOT && s->kind != FACING_SPOT) return 1;
        if (s->own) return 1;
        f64 angle = safe_acos(-dot3(way, s->axis) / length) - (length > reach ? asin(reach / length) : PI);
        return angle < safe_acos(s->edge);
    }
    f64 height = -dot3(way, s->axis), most = s->kind == PLATE ? fabs(dot3(N, s->u)) + fabs(dot3(N, s->v))
                                                              : hypot(dot3(N, s->u), dot3(N, s->v));
    if (height <= 0.0 || up + most <= 0.0) return 0;
    return !beside_spread(s, length * length, height, reach);
}

/* What a matt white surface of normal N gets, over I: E/A. */
static f64 matt_of(const Sized *s, const f64 *P, const f64 *N) {
    f64 way[3], reach = way_and_reach(s, P, way);
    if (s->kind < PLATE) {
        Cone cone = cone_of(s, P);
        if (s->kind == BALL_SPOT || s->kind == FACING_SPOT) return matt_spot(s, &cone, N) * s->per_area;
        return (cone.inside ? PI : matt_cone(cone.sine, cone.cosine, dot3(N, cone.d))) * s->per_area;
    }
    f64 height = -dot3(way, s->axis), far = dot3(way, way);
    if (height <= 0.0 || beside_spread(s, far, height, reach)) return 0.0;
    if (far > FAR * FAR * reach * reach && (!s->spread || height * s->edge > FAR * reach)) {
        f64 up = dot3(way, N), length = sqrt(far);
        for (int j = 0; j < 3; j++) way[j] /= length;
        return up > 0.0 ? up * height / (far * far) * (s->spread ? spread_share(s, way) : 1.0) : 0.0;
    }
    if (s->spread) return matt_spread(s, P, way, N) * s->per_area;
    if (s->kind == OVAL) return matt_ellipse(s, way, N) * s->per_area;
    f64 corner[MOST][3], above[MOST][3];
    corners_of(s, P, corner);
    return matt_polygon(above, cut(corner, 4, N, above), N) * s->per_area;
}

/* The lamp as it is looked at around M. */
static void look(const Sized *s, const f64 *P, const f64 *way, Around *r) {
    f64 toward[3] = {-s->axis[0], -s->axis[1], -s->axis[2]};
    beside(r->M, r->x, r->y);
    r->corners = 0;
    if (s->kind < PLATE) {
        Cone cone = cone_of(s, P);
        if (cone.inside) memset(&r->lamp, 0, sizeof r->lamp);
        else r->lamp = round_of(cone.d, cone.cosine);
        if (s->own) r->shared = 2;
        else if (r->shared) r->sent = round_of(toward, s->edge);
        return;
    }
    f64 grow = s->kind == PLATE ? sqrt(2.0) : 1.0, u[3], v[3];
    for (int j = 0; j < 3; j++) u[j] = grow * s->u[j], v[j] = grow * s->v[j];
    Ellipse e = ellipse_of(way, u, v);
    memcpy(r->lamp.C, e.C, sizeof e.C);
    memcpy(r->lamp.side, e.axis, sizeof e.axis);
    if (s->kind == PLATE) corners_of(s, P, r->corner), r->corners = 4;
    if (r->shared) r->sent = round_of(toward, 1.0 / sqrt(1.0 + s->edge * s->edge));
}

/* Whether the lobe, cos^n, is below exp(-DIM) of its peak on all of the lamp. */
#define DIM 20.0
static int dimmer_than_seen(const f64 *way, f64 reach, f64 far, const f64 *M, f64 n) {
    if (far <= reach * reach) return 0;
    f64 length = sqrt(far), to = dot3(way, M) / length, sine = reach / length, cosine = safe_root(1.0 - sine * sine);
    if (to >= cosine) return 0;
    f64 nearest = to * cosine + safe_root(1.0 - to * to) * sine;
    return nearest <= 0.0 || n * fast_log(nearest < 1e-300 ? 1e-300 : nearest) < -DIM;
}

/* The highlight that a surface sends to where M, unit, is mirrored from, over I; above the horizon of Ng. */
static f64 gloss_of(const Sized *s, const f64 *P, const f64 *M, const f64 *Ng, f64 n) {
    f64 way[3], reach = way_and_reach(s, P, way), far = dot3(way, way), height = -dot3(way, s->axis);
    int shared = s->spread || s->kind == BALL_SPOT || s->kind == FACING_SPOT;
    if (s->kind >= PLATE && (height <= 0.0 || beside_spread(s, far, height, reach))) return 0.0;
    if (far > FAR * reach * reach * (n + FAR)) {
        f64 length = s->kind == SKY ? 1.0 : sqrt(far), lobe = dot3(way, M) / length, share = 1.0;
        if (lobe <= 0.0 || dot3(way, Ng) <= 0.0) return 0.0;
        for (int j = 0; j < 3; j++) way[j] /= length;
        if (s->kind >= PLATE) share = height / length * (s->spread ? spread_share(s, way) : 1.0);
        else if (shared) share = spot_share(s, way);
        return share * pow(fmin(lobe, 1.0), n) / far;
    }
    if (dimmer_than_seen(way, reach, far, M, n)) return 0.0;
    if (s->kind == PLATE && !shared) return gloss_plate(s, P, M, Ng, n) * s->per_area;
    int clear = dot3(way, Ng) >= reach;  /* all of it above the horizon */
    if (s->kind < PLATE && !shared && clear) {
        Cone cone = cone_of(s, P);
        f64 all = cone.inside ? -1.0 : gloss_cone(dot3(cone.d, M), cone.sine, cone.cosine, n);
        if (all >= 0.0) return all * s->per_area;
    }
    Around r = {.M = M, .Ng = Ng, .shared = shared, .clear = clear};
    look(s, P, way, &r);
    return gloss_around(s, &r, n) * s->per_area;
}
