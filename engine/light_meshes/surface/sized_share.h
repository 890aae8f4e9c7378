/* E where not all directions to the lamp get the same light: the cone of a spot, the spread of an area lamp.

   A spot's cone is an integral over the angle from its axis; circles around the axis are cut by the lamp and by the
   horizon in closed form. A spread's is one along the lamp's edge, of what lies between the edge and the point of the
   lamp's plane that is nearest to the receiver, in closed form. Both by Gauss's rule. */
#pragma once
#include "sized_around.h"

/* The integral of up + side·cos t over what two arcs share: |t - middle[i]| <= reach[i], the first at most a circle. */
static f64 shared_arc(f64 up, f64 side, f64 middle, f64 reach, f64 other) {
    f64 sum = 0.0;
    /* The horizon's arc is around t = 0. */
    for (int k = -1; k < 2; k++) {
        f64 low = fmax(middle - reach + 2.0 * PI * k, -other), high = fmin(middle + reach + 2.0 * PI * k, other);
        if (high > low) sum += up * (high - low) + side * (sin(high) - sin(low));
    }
    return sum;
}

/* E of what a spot sends, from angles low to high from its axis. d: to its middle; toward: -its axis. */
static f64 matt_rings(const Sized *s, const Cone *cone, const f64 *N, f64 low, f64 high) {
    f64 toward[3] = {-s->axis[0], -s->axis[1], -s->axis[2]}, x[3], y[3], sum = 0.0;
    if (high <= low) return 0.0;
    beside(toward, x, y);
    f64 to = dot3(cone->d, toward), up = dot3(N, toward), aside = safe_root(1.0 - to * to), tilt = safe_root(1.0 - up * up);
    f64 middle = atan2(dot3(cone->d, y), dot3(cone->d, x)) - atan2(dot3(N, y), dot3(N, x));
    middle -= 2.0 * PI * floor(middle / (2.0 * PI) + 0.5);
    for (int panel = 0; panel < 2; panel++)
        for (int i = 0; i < GAUSS; i++) {
            /* Denser at both ends, where arcs begin. */
            f64 at = 0.5 * (panel + gauss_at[i]), angle = low + (high - low) * 0.5 * (1.0 - cos(PI * at));
            f64 weight = 0.5 * gauss_weight[i] * (high - low) * 0.5 * PI * sin(PI * at), S = sin(angle), C = cos(angle);
            f64 t = clamped((C - s->edge) * s->slope, 0.0, 1.0);
            f64 by_lamp = cone->inside ? PI : aside * S > 1e-12 ? safe_acos((cone->cosine - C * to) / (S * aside))
                                                                : C * to >= cone->cosine ? PI : 0.0;
            f64 by_horizon = tilt * S > 1e-12 ? safe_acos(-C * up / (S * tilt)) : up > 0.0 ? PI : 0.0;
            sum += weight * S * t * t * (3.0 - 2.0 * t) * shared_arc(up * C, tilt * S, middle, by_lamp, by_horizon);
        }
    return sum;
}

/* Of a spot whose cone has axes of its own: points of the lamp as the receiver sees it, in rings of equal share. */
static f64 matt_skewed_spot(const Sized *s, const Cone *cone, const f64 *N) {
    enum { AROUND = 32 };
    f64 x[3], y[3], sum = 0.0;
    beside(cone->d, x, y);
    f64 solid = 1.0 - (cone->inside ? -1.0 : cone->cosine);
    for (int i = 0; i < 2 * GAUSS; i++) {
        f64 C = 1.0 - 0.5 * (i / GAUSS + gauss_at[i % GAUSS]) * solid, S = safe_root(1.0 - C * C);
        for (int k = 0; k < AROUND; k++) {
            f64 way[3], a = S * cos(2.0 * PI * (k + 0.5 * (i & 1)) / AROUND), b = S * sin(2.0 * PI * (k + 0.5 * (i & 1)) / AROUND);
            for (int j = 0; j < 3; j++) way[j] = C * cone->d[j] + a * x[j] + b * y[j];
            f64 up = dot3(way, N);
            if (up > 0.0) sum += 0.5 * gauss_weight[i % GAUSS] / AROUND * up * spot_share(s, way);
        }
    }
    return sum * 2.0 * PI * solid;
}

static f64 matt_spot(const Sized *s, const Cone *cone, const f64 *N) {
    if (s->own) return matt_skewed_spot(s, cone, N);
    f64 whole = cone->inside ? PI : matt_cone(cone->sine, cone->cosine, dot3(N, cone->d));
    f64 angle = safe_acos(-dot3(cone->d, s->axis)), half = asin(clamped(cone->sine, 0.0, 1.0));
    f64 most = safe_acos(s->edge), full = safe_acos(s->edge + 1.0 / s->slope);
    if (cone->inside) return matt_rings(s, cone, N, 0.0, most);
    if (angle + half <= full) return whole;
    if (angle - half >= most || whole <= 0.0) return 0.0;
    f64 near = fabs(angle - half), far = angle + half, sum = 0.0;
    if (angle < half) sum = matt_rings(s, cone, N, 0.0, fmin(near, most));
    return sum + matt_rings(s, cone, N, near, fmin(far, most));
}

/* What lies within u of the foot of the lamp's plane, in the direction t: the integrals over w from 0 to u of
   (T - w)·w/(1 + w²)², for up, and of (T - w)·w²/(1 + w²)², for side; over u² both. */
static void within(f64 T, f64 u, f64 *up, f64 *side) {
    if (u > T) {  /* nothing is beyond T */
        within(T, T, up, side);
        f64 share = square(T / u);
        *up *= share, *side *= share;
        return;
    }
    f64 uu = u * u, part = uu / (1.0 + uu);
    if (u < 0.05) {
        *up = 0.5 * T - u / 3.0 - 0.5 * T * uu + 0.4 * u * uu;
        *side = T * u / 3.0 - uu / 4.0 - 0.4 * T * u * uu + uu * uu / 3.0;
        return;
    }
    f64 bend = 0.5 * (atan(u) - u / (1.0 + uu));
    *up = (0.5 * T * part - bend) / uu;
    *side = (T * bend - 0.5 * (log1p(uu) - part)) / uu;
}

/* The receiver over the lamp's plane: coordinates there are in units of its height, x in the direction of N's part. */
typedef struct {
    f64 T, up, side, x[3], y[3], foot[3], inverse;
} Over;

static void place(const Over *o, const f64 *corner, f64 *out) {
    f64 d[3] = {corner[0] - o->foot[0], corner[1] - o->foot[1], corner[2] - o->foot[2]};
    out[0] = dot3(d, o->x) * o->inverse, out[1] = dot3(d, o->y) * o->inverse;
}

/* From p along step: at p + t·step the boundary's part. */
static f64 along(const Over *o, const f64 *p, const f64 *step) {
    f64 uu = p[0] * p[0] + p[1] * p[1], u = sqrt(uu), up, side;
    within(o->T, u, &up, &side);
    f64 turned = p[0] * step[1] - p[1] * step[0];
    return turned * (o->up * up + (u > 0.0 ? o->side * p[0] / u * side : 0.0));
}

/* From p to q, straight: by Gauss's rule within T, in closed form beyond it. */
static f64 along_edge(const Over *o, const f64 *p, const f64 *q) {
    f64 step[2] = {q[0] - p[0], q[1] - p[1]}, length = step[0] * step[0] + step[1] * step[1];
    if (length <= 0.0) return 0.0;
    f64 middle = -(p[0] * step[0] + p[1] * step[1]) / length, off = (p[0] * step[1] - p[1] * step[0]) / length;
    f64 reach = safe_root(o->T * o->T / length - off * off), up, side, sum = 0.0;
    f64 low = clamped(middle - reach, 0.0, 1.0), high = clamped(middle + reach, 0.0, 1.0);
    within(o->T, o->T, &up, &side);
    for (int part = 0; part < 2; part++) {
        f64 from = part ? high : 0.0, to = part ? 1.0 : low;
        if (to <= from) continue;
        f64 a[2] = {p[0] + from * step[0], p[1] + from * step[1]}, b[2] = {p[0] + to * step[0], p[1] + to * step[1]};
        f64 turn = atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]);
        f64 sines = b[1] / hypot(b[0], b[1]) - a[1] / hypot(a[0], a[1]);
        sum += o->T * o->T * (o->up * up * turn + o->side * side * sines);
    }
    for (int i = 0; high > low && i < GAUSS; i++) {
        f64 t = low + (high - low) * gauss_at[i], at[2] = {p[0] + t * step[0], p[1] + t * step[1]};
        sum += (high - low) * gauss_weight[i] * along(o, at, step);
    }
    return sum;
}

/* Of a PLATE: along its edges. */
static f64 spread_plate(const Sized *s, const f64 *P, const Over *o, const f64 *N) {
    f64 corner[MOST][3], above[MOST][3], flat[MOST][2], sum = 0.0;
    corners_of(s, P, corner);
    int n = cut(corner, 4, N, above);
    for (int i = 0; i < n; i++) place(o, above[i], flat[i]);
    for (int i = 0; i < n; i++) sum += along_edge(o, flat[i], flat[(i + 1) % n]);
    return sum;
}

/* Of an OVAL: around its normal. */
static f64 spread_oval(const Sized *s, const f64 *centre, const Over *o, const f64 *N) {
    f64 toward[3] = {-s->axis[0], -s->axis[1], -s->axis[2]}, breaks[BREAKS], sum = 0.0;
    Around r = {.M = toward, .Ng = N, .shared = 1, .sent = round_of(toward, 1.0 / sqrt(1.0 + s->edge * s->edge))};
    memcpy(r.x, o->x, sizeof r.x), memcpy(r.y, o->y, sizeof r.y);
    Ellipse e = ellipse_of(centre, s->u, s->v);
    memcpy(r.lamp.C, e.C, sizeof e.C), memcpy(r.lamp.side, e.axis, sizeof e.axis);
    int n = corners_around(&r, breaks);
    for (int piece = 0; piece + 1 < n; piece++)
        for (int i = 0; i < GAUSS; i++) {
            f64 angle, weight = node_around(breaks, piece, i, &angle), w[3], ends[2], up, side;
            turned(&r, angle, w);
            ends_of(&r, w, ends, ends + 1);
            for (int k = 0; k < 2 && ends[1] > ends[0]; k++) {
                within(o->T, ends[k], &up, &side);
                f64 part = square(ends[k]) * (o->up * up + o->side * cos(angle) * side);
                sum += weight * (k ? part : -part);
            }
        }
    return sum;
}

/* E of an area lamp of a spread; centre: of the lamp, from the receiver. */
static f64 matt_spread(const Sized *s, const f64 *P, const f64 *centre, const f64 *N) {
    f64 height = -dot3(centre, s->axis), toward[3], z = -dot3(N, s->axis);
    Over o = {.T = s->edge, .up = z, .inverse = 1.0 / height};
    for (int j = 0; j < 3; j++) toward[j] = -s->axis[j], o.foot[j] = toward[j] * height, o.x[j] = N[j] - z * toward[j];
    o.side = sqrt(dot3(o.x, o.x));
    if (o.side > 1e-9) {
        for (int j = 0; j < 3; j++) o.x[j] /= o.side;
        cross3(toward, o.x, o.y);
    } else {
        beside(toward, o.x, o.y);  /* N is up or down: which way x points does not matter */
    }
    f64 sum = s->kind == PLATE ? spread_plate(s, P, &o, N) : spread_oval(s, centre, &o, N);
    return sum > 0.0 ? sum * s->slope : 0.0;
}
