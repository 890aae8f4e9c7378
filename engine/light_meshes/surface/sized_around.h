/* A lamp as it is looked at around a direction M: in each direction around M one piece of it, from one end to the other.

   What is the same all round M (Phong's lobe around where the eye's ray is mirrored to, the spread around a lamp's normal)
   has a closed form along such a piece; what is left is an integral around M, by Gauss's rule between the directions at
   which the ends have corners. */
#pragma once
#include "sized_matt.h"

/* A quadratic cone as it is looked at around M: ω is in it where ω·Cω <= 0 and ω·side >= 0. */
typedef struct {
    f64 C[6], side[3];
} Round;

/* What is looked at around M: the lamp's cone, or the polygon that lies in it; the cone that a spot or a spread sends light
   into, where there is one; the horizon of Ng. x, y: axes around M. */
typedef struct {
    Round lamp, sent;
    f64 x[3], y[3], corner[MOST][3];
    const f64 *M, *Ng;
    int corners, shared, clear;  /* clear: all above the horizon; shared: 1 by the cone `sent`, 2 by one with axes of its own */
} Around;

/* Of half angle (sine, cosine) around the unit vector d. */
static Round round_of(const f64 *d, f64 cosine) {
    Round r;
    for (int j = 0; j < 3; j++) r.side[j] = d[j], r.C[j] = cosine * cosine - d[j] * d[j];
    r.C[3] = -d[0] * d[1], r.C[4] = -d[0] * d[2], r.C[5] = -d[1] * d[2];
    return r;
}

/* low and high: the tangents from M between which direction w meets what lies where normal·(M + τ·w) >= 0. */
static void bound(const f64 *normal, const f64 *M, const f64 *w, f64 *low, f64 *high) {
    f64 a = dot3(normal, M), b = dot3(normal, w);
    if (b == 0.0 && a < 0.0) *high = -1.0;
    if (b > 0.0) *low = fmax(*low, -a / b);
    if (b < 0.0) *high = fmin(*high, -a / b);
}

/* The same for a cone. */
static void bound_round(const Round *r, const f64 *M, const f64 *w, f64 *low, f64 *high) {
    f64 a = quadratic(r->C, w, w), b = quadratic(r->C, M, w), c = quadratic(r->C, M, M), before = dot3(r->side, M);
    f64 D = b * b - a * c, root = safe_root(D);
    if (D < 0.0) {
        *high = -1.0;
    } else if (c <= 0.0 && before >= 0.0) {  /* M is in it */
        if (b + root > 0.0) *high = fmin(*high, -c / (b + root));
    } else if (c <= 0.0) {  /* M is in what lies opposite */
        if (a < 0.0 && b > 0.0) *low = fmax(*low, (b + root) / -a);
        else *high = -1.0;
    } else {
        f64 in = root - b > 0.0 ? c / (root - b) : 1e9, behind = before + in * dot3(r->side, w);
        if (behind < 0.0) *high = -1.0;
        *low = fmax(*low, in);
        if (-b - root > 0.0) *high = fmin(*high, c / (-b - root));
    }
}

static void ends_of(const Around *r, const f64 *w, f64 *low, f64 *high) {
    *low = 0.0, *high = 1e9;
    for (int i = 0; i < r->corners; i++) {
        f64 normal[3];
        cross3(r->corner[i], r->corner[(i + 1) % r->corners], normal);
        bound(normal, r->M, w, low, high);
    }
    if (!r->corners) bound_round(&r->lamp, r->M, w, low, high);
    if (r->shared == 1) bound_round(&r->sent, r->M, w, low, high);
    if (!r->clear) bound(r->Ng, r->M, w, low, high);
}

/* Directions around M that meet a cone, from low to high. Returns 0 for none, 2 where M is in it, and all do. */
static int turns_of(const Around *r, const Round *cone, f64 *low, f64 *high) {
    f64 c = quadratic(cone->C, r->M, r->M), bx = quadratic(cone->C, r->M, r->x), by = quadratic(cone->C, r->M, r->y);
    f64 A = -quadratic(cone->C, r->x, r->x), B = -quadratic(cone->C, r->y, r->y), H = -quadratic(cone->C, r->x, r->y);
    if (c <= 0.0 && dot3(cone->side, r->M) >= 0.0) {
        *low = atan2(by, bx) - 0.5 * PI, *high = *low + 2.0 * PI;  /* halves towards the nearest end, and away from it */
        return 2;
    }
    if (c > 0.0) A = bx * bx + c * A, B = by * by + c * B, H = bx * by + c * H;
    f64 half = hypot(0.5 * (A - B), H), mean = 0.5 * (A + B);
    if (mean + half <= 0.0) return 0;
    f64 middle = 0.5 * atan2(2.0 * H, A - B), reach = mean >= half ? 0.5 * PI : atan(sqrt((mean + half) / (half - mean)));
    if (dot3(cone->side, r->x) * cos(middle) + dot3(cone->side, r->y) * sin(middle) < 0.0) middle += PI;
    *low = middle - reach, *high = middle + reach;
    return 1;
}

/* Angles around M at which what is seen has a corner; inserted in order between first and last. */
enum { BREAKS = 16 };
static void insert(f64 *breaks, int *n, f64 angle) {
    f64 first = breaks[0], turned = first + (angle - first) - 2.0 * PI * floor((angle - first) / (2.0 * PI));
    int i = *n;
    if (*n >= BREAKS || turned <= first || turned >= breaks[*n - 1]) return;
    for (; breaks[i - 1] > turned; i--) breaks[i] = breaks[i - 1];
    breaks[i] = turned, ++*n;
}

static f64 angle_of(const Around *r, const f64 *way) { return atan2(dot3(way, r->y), dot3(way, r->x)); }

/* Where the horizon cuts the cone, and where it passes M. */
static void insert_horizon(const Around *r, const Round *cone, f64 *breaks, int *n) {
    f64 x[3], y[3];
    if (r->clear) return;
    beside(r->Ng, x, y);
    f64 A = quadratic(cone->C, x, x), B = quadratic(cone->C, y, y), H = quadratic(cone->C, x, y);
    f64 half = hypot(0.5 * (A - B), H), mean = 0.5 * (A + B);
    if (fabs(mean) >= half) return;
    f64 middle = 0.5 * (atan2(2.0 * H, A - B) + PI), reach = atan(sqrt((half - mean) / (half + mean)));
    for (int i = -1; i < 2; i += 2) {
        f64 c = cos(middle + i * reach), b = sin(middle + i * reach), way[3];
        for (int j = 0; j < 3; j++) way[j] = c * x[j] + b * y[j];
        f64 sign = dot3(way, cone->side) < 0.0 ? -1.0 : 1.0;
        for (int j = 0; j < 3; j++) way[j] *= sign;
        insert(breaks, n, angle_of(r, way));
    }
    f64 across = angle_of(r, r->Ng);
    insert(breaks, n, across + 0.5 * PI), insert(breaks, n, across - 0.5 * PI);
}

/* The angles around M between which what is seen has no corner, in order; returns how many, 0 where nothing is seen. */
static int corners_around(const Around *r, f64 *breaks) {
    f64 low, high;
    int seen = turns_of(r, &r->lamp, &low, &high), n = 2;
    if (!seen) return 0;
    breaks[0] = low, breaks[1] = high;
    insert(breaks, &n, 0.5 * (low + high));
    insert_horizon(r, &r->lamp, breaks, &n);
    if (r->shared == 1 && turns_of(r, &r->sent, &low, &high)) {
        insert(breaks, &n, low), insert(breaks, &n, high);
        insert_horizon(r, &r->sent, breaks, &n);
    }
    if (seen == 2) {  /* the ends of a long lamp */
        f64 A = quadratic(r->lamp.C, r->x, r->x), B = quadratic(r->lamp.C, r->y, r->y), H = quadratic(r->lamp.C, r->x, r->y);
        f64 lengthwise = 0.5 * (atan2(2.0 * H, A - B) + PI);
        if (hypot(A - B, 2.0 * H) > 0.5 * fabs(A + B)) insert(breaks, &n, lengthwise), insert(breaks, &n, lengthwise + PI);
    }
    for (int i = 0; i < r->corners; i++) insert(breaks, &n, angle_of(r, r->corner[i]));
    return n;
}

/* The i-th of Gauss's nodes between corners, denser at both ends, where most happens. Returns its weight. */
static f64 node_around(const f64 *breaks, int piece, int i, f64 *angle) {
    f64 size = breaks[piece + 1] - breaks[piece], t = gauss_at[i];
    *angle = breaks[piece] + size * t * t * (3.0 - 2.0 * t);
    return size * gauss_weight[i] * 6.0 * t * (1.0 - t);
}

/* The unit vector around M at that angle. */
static void turned(const Around *r, f64 angle, f64 *w) {
    f64 c = cos(angle), s = sin(angle);
    for (int j = 0; j < 3; j++) w[j] = c * r->x[j] + s * r->y[j];
}
