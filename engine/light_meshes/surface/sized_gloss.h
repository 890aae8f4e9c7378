/* The integral of max(0, ω·M)^n over the directions ω in which a receiver sees a lamp, M being where the eye's ray is
   mirrored to: Phong's highlight of a lamp with a size.

   Around M the lobe is the same all round, so that what lies within a distance in one direction has a closed form,
   1 - cos^(n+1) over n + 1. One integral is left: around M, of what lies between the lamp's two ends in that direction
   (an ellipse, a cone), or along the lamp's edges (a polygon); by Gauss's rule. Where a spot or a spread gives less to
   some directions a second integral goes along each direction. */
#pragma once
#include "sized_share.h"

/* 1 - cos^(n+1) at the tangent τ from M. */
static inline f64 share_within(f64 tt, f64 n) { return -expm1(-0.5 * (n + 1.0) * log1p(tt)); }

/* One edge of a polygon, from p to q in the plane in front of M: the integral of share_within along the angle. */
static f64 gloss_edge(const f64 *p, const f64 *q, f64 n) {
    f64 step[2] = {q[0] - p[0], q[1] - p[1]}, length = hypot(step[0], step[1]);
    if (length <= 0.0) return 0.0;
    f64 off = (p[0] * q[1] - p[1] * q[0]) / length, near = fabs(off), sum = 0.0;
    if (near < 1e-12 * length) return 0.0;
    f64 a = atan((p[0] * step[0] + p[1] * step[1]) / length / near), b = atan((q[0] * step[0] + q[1] * step[1]) / length / near);
    f64 ends[3] = {a, a < 0.0 && b > 0.0 ? 0.0 : b, b};
    for (int piece = 0; piece < 2; piece++) {
        f64 size = ends[piece + 1] - ends[piece];
        for (int i = 0; size > 0.0 && i < GAUSS; i++) {
            f64 c = near / cos(ends[piece] + size * gauss_at[i]);
            sum += size * gauss_weight[i] * share_within(c * c, n);
        }
    }
    return off > 0.0 ? sum : -sum;
}

static f64 gloss_plate(const Sized *s, const f64 *P, const f64 *M, const f64 *Ng, f64 n) {
    f64 corner[MOST][3], above[MOST][3], flat[MOST][2], x[3], y[3], sum = 0.0, far = 0.0;
    corners_of(s, P, corner);
    int left = cut(corner, 4, Ng, above);
    left = cut(above, left, M, corner);
    beside(M, x, y);
    /* Corners at a right angle to M are taken just in front of it. */
    for (int i = 0; i < left; i++) far = fmax(far, dot3(corner[i], corner[i]));
    for (int i = 0; i < left; i++) {
        f64 ahead = fmax(dot3(corner[i], M), 1e-6 * sqrt(far));
        flat[i][0] = dot3(corner[i], x) / ahead, flat[i][1] = dot3(corner[i], y) / ahead;
    }
    for (int i = 0; i < left; i++) sum += gloss_edge(flat[i], flat[(i + 1) % left], n);
    return fabs(sum) / (n + 1.0);
}

/* Of one direction around M. */
static f64 gloss_ray(const Sized *s, const Around *r, f64 turn, f64 n) {
    static const f64 at[4] = {0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970262};
    static const f64 weight[4] = {0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693};
    f64 w[3], low, high, sum = 0.0;
    turned(r, turn, w);
    ends_of(r, w, &low, &high);
    if (high <= low) return 0.0;
    f64 from = share_within(low * low, n), size = share_within(high * high, n) - from;
    if (!r->shared) return size;
    for (int i = 0; i < 4; i++) {
        f64 cosine = exp(log1p(-(from + at[i] * size)) / (n + 1.0)), sine = safe_root(1.0 - cosine * cosine), way[3];
        for (int j = 0; j < 3; j++) way[j] = cosine * r->M[j] + sine * w[j];
        sum += weight[i] * (s->kind >= PLATE ? spread_share(s, way) : spot_share(s, way));
    }
    return sum * size;
}

/* All round M. */
static f64 gloss_around(const Sized *s, const Around *r, f64 n) {
    f64 breaks[BREAKS], angle, sum = 0.0;
    int all = corners_around(r, breaks);
    for (int piece = 0; piece + 1 < all; piece++)
        for (int i = 0; i < GAUSS; i++) {
            f64 weight = node_around(breaks, piece, i, &angle);
            sum += weight * gloss_ray(s, r, angle, n);
        }
    return sum / (n + 1.0);
}
