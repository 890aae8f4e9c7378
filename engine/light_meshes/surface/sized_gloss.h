/* The integral of max(0, ω·M)^n over the directions ω in which a receiver sees a lamp, M being where the eye's ray is
   mirrored to: Phong's highlight of a lamp with a size.

   Around M the lobe is the same all round, so that what lies within a distance in one direction has a closed form,
   1 - cos^(n+1) over n + 1. One integral is left: around M, of what lies between the lamp's two ends in that direction
   (an ellipse, a cone), or along the lamp's edges (a polygon); by Gauss's rule. Where a spot or a spread gives less to
   some directions a second integral goes along each direction. */
#pragma once
#include "sized_share.h"

/* 1 - cos^(n+1) at the tangent τ from M. */
static inline f64 share_within(f64 tt, f64 n) { return 1.0 - fast_exp_minus(0.5 * (n + 1.0) * fast_log(1.0 + tt)); }

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
        f64 part[GAUSS];
        if (size <= 0.0) continue;
        for (int i = 0; i < GAUSS; i++) {
            f64 c = near / fast_cos(ends[piece] + size * gauss_at[i]);
            part[i] = gauss_weight[i] * share_within(c * c < 1e30 ? c * c : 1e30, n);
        }
        for (int i = 0; i < GAUSS; i++) sum += size * part[i];
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

/* Of a cone above the horizon, whose axis is at the cosine `to` from M: one half of it, as the other is the same. */
static f64 gloss_cone(f64 to, f64 sine, f64 cosine, f64 n) {
    f64 aside = safe_root(1.0 - to * to), CC = cosine * cosine, c = CC - to * to, sum = 0.0;
    int inside = to >= cosine;
    if (!inside && c <= 0.0) return -1.0;  /* M is in what lies opposite: not by this rule */
    /* Directions at a from the axis: all, or up to the tangent. */
    f64 most = inside ? PI : asin(clamped(sine / aside, -1.0, 1.0));
    for (int piece = 0; piece < (inside ? 2 : 1); piece++) {
        f64 from = inside ? 0.5 * PI * piece : 0.0, size = inside ? 0.5 * PI : most, part[GAUSS];
        for (int i = 0; i < GAUSS; i++) {
            f64 t = gauss_at[i], at = inside ? t * t * (3.0 - 2.0 * t) : 1.0 - (1.0 - t) * (1.0 - t);
            f64 rate = inside ? 6.0 * t * (1.0 - t) : 2.0 * (1.0 - t), C = fast_cos(from + size * at) * aside;
            f64 a = CC - C * C, b = -to * C, D = b * b - a * c, root = sqrt(D > 0.0 ? D : 0.0);
            f64 low = inside ? 0.0 : c / (root - b), out = inside ? b + root : -b - root;
            f64 high = fabs(c) / (out > 1e-15 ? out : 1e-15);
            low = low > 0.0 && low < 1e9 ? low : low > 0.0 ? 1e9 : 0.0, high = high < 1e9 ? high : 1e9;
            part[i] = gauss_weight[i] * rate * (share_within(high * high, n) - share_within(low * low, n));
        }
        for (int i = 0; i < GAUSS; i++) sum += size * part[i];
    }
    return 2.0 * sum / (n + 1.0);
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
