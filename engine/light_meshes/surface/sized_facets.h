/* Directions to a lamp with a size, and how much of it each stands for, by which the highlight of microfacets is summed.

   The microfacets that send light from ω to the eye V have the half vector h = ω + V for their normal. Over the slopes
   m = h's part along the surface / (α·N·h) the distribution of GGX is as 1/(1 + m²)². So along a line of directions, where
   m is nearest to 0 at b0, and grows away from there by 1/w, it is as 1/(1 + y²)², y = (b - b0)/w. With x = y/√(1 + y²)
   it is √(1 - x²), on which Gauss's rule takes a few points, however small the highlight is. The same is done across the
   lines, with 1/(1 + y²)^1.5, which is 1 in x. Nothing is tabulated, and a small lamp far away has one direction.

   A line has one angle a around the axis x, from z; b is the angle along it, towards x: ω = cos b·(sin a·y + cos a·z) +
   sin b·x, and a solid angle is cos b·da·db. */
#pragma once
#include "sized_gloss.h"

typedef struct {
    f64 way[3], weight;  /* unit, from the receiver; the solid angle, times what the lamp sends that way, over A */
} Ray;
enum { LINE = 8, RAYS = LINE * LINE };

/* The lamp as a flat face before the receiver, in the frame above: its middle is at (cx, cy, far); it reaches ±half along x,
   and ±tall along y, where its middle is moved by lean. round: an ellipse. */
typedef struct {
    f64 x[3], y[3], z[3], cx, cy, far, half, tall, lean;
    int round;
} Face;

/* Whose highlight: the unit normal, the unit vector to the eye, the distribution's α. */
typedef struct {
    f64 N[3], V[3], alpha;
} Seen;

/* sin x for |x| <= pi/2. */
static inline f64 fast_sin(f64 x) {
    f64 t = x * x;
    return x * (1.0 + t * (-1.0 / 6 + t * (1.0 / 120 + t * (-1.0 / 5040 + t * (1.0 / 362880 + t * (-1.0 / 39916800 + t * (1.0 / 6227020800.0)))))));
}

/* m at a direction, and its change with a and with b. */
typedef struct {
    f64 m[3], a[3], b[3];
} Slope;

static inline void slope_at(const Face *f, const Seen *e, f64 a, f64 b, Slope *out) {
    f64 sa = fast_sin(a), ca = fast_cos(a), sb = fast_sin(b), cb = fast_cos(b), over = 0.0, up_a = 0.0, up_b = 0.0, way[3], da[3], db[3];
    for (int j = 0; j < 3; j++) {
        f64 along = sa * f->y[j] + ca * f->z[j];
        way[j] = cb * along + sb * f->x[j], db[j] = cb * f->x[j] - sb * along, da[j] = cb * (ca * f->y[j] - sa * f->z[j]);
        over += (way[j] + e->V[j]) * e->N[j], up_a += da[j] * e->N[j], up_b += db[j] * e->N[j];
    }
    f64 scale = 1.0 / (e->alpha * (over > 1e-3 ? over : 1e-3));
    for (int j = 0; j < 3; j++) {
        out->m[j] = (way[j] + e->V[j] - over * e->N[j]) * scale;
        f64 fall = e->N[j] + e->alpha * out->m[j];
        out->a[j] = scale * (da[j] - up_a * fall), out->b[j] = scale * (db[j] - up_b * fall);
    }
}

/* Turns the half-axes of an ellipse, n its normal, c its middle, so that u goes to where the mirrored ray R meets it. */
static void turn_axes(const f64 *c, const f64 *n, const f64 *R, f64 *u, f64 *v) {
    f64 toward = dot3(n, R), ahead = dot3(n, c), q[3];
    for (int j = 0; j < 3; j++) q[j] = toward * ahead > 0.0 ? ahead / toward * R[j] - c[j] : R[j];
    f64 uu = dot3(u, u), vv = dot3(v, v), uv = dot3(u, v), a = dot3(q, u), b = dot3(q, v);
    f64 s = a * vv - b * uv, t = b * uu - a * uv, size = sqrt(s * s + t * t);
    if (!(size > 1e-12 * uu * vv)) return;
    s /= size, t /= size;
    for (int j = 0; j < 3; j++) {
        f64 along = u[j], across = v[j];
        u[j] = s * along + t * across, v[j] = s * across - t * along;
    }
}

/* The face that a lamp is from P; of one that is round x is towards the mirrored ray R, so that the lines meet the edge
   that is nearest to it, and none ends within the highlight. */
static Face face_of(const Sized *s, const f64 *P, const f64 *R) {
    Face f = {.round = s->kind != PLATE};
    if (s->kind >= PLATE) {
        f64 c[3], n[3], u[3], v[3];
        for (int j = 0; j < 3; j++) c[j] = s->c[j] - P[j], u[j] = s->u[j], v[j] = s->v[j];
        cross3(u, v, n);
        if (f.round) turn_axes(c, n, R, u, v);
        f64 size = sqrt(dot3(n, n)) * (dot3(n, c) < 0.0 ? -1.0 : 1.0), along = sqrt(dot3(u, u));
        for (int j = 0; j < 3; j++) f.z[j] = n[j] / size, f.x[j] = u[j] / along;
        cross3(f.z, f.x, f.y);
        f.cx = dot3(c, f.x), f.cy = dot3(c, f.y), f.far = dot3(c, f.z), f.half = along;
        f.tall = dot3(v, f.y), f.lean = dot3(v, f.x);
        if (f.tall < 0.0) f.tall = -f.tall, f.lean = -f.lean;
        return f;
    }
    Cone cone = cone_of(s, P);
    if (cone.inside) memcpy(cone.d, R, sizeof cone.d);
    f64 tangent = cone.cosine > 0.02 ? cone.sine / cone.cosine : 50.0, along = dot3(R, cone.d), size;
    for (int j = 0; j < 3; j++) f.x[j] = R[j] - along * cone.d[j];
    size = sqrt(dot3(f.x, f.x));
    if (size > 1e-6) {
        for (int j = 0; j < 3; j++) f.x[j] /= size;
        cross3(cone.d, f.x, f.y);
    } else {
        beside(cone.d, f.x, f.y);
    }
    memcpy(f.z, cone.d, sizeof f.z);
    f.far = 1.0, f.half = f.tall = tangent;
    return f;
}

/* The part of low..high where A·cos b + B·sin b >= least. */
static inline void within_cone(f64 A, f64 B, f64 least, f64 *low, f64 *high) {
    f64 size = sqrt(A * A + B * B);
    if (size <= fabs(least)) {
        if (least > 0.0) *high = *low;
        return;
    }
    f64 middle = atan2(B, A), reach = acos(least / size);
    *low = fmax(*low, middle - reach), *high = fmin(*high, middle + reach);
}

/* Where the line at a meets the lamp above the horizon, within its spread or the cone of a spot. */
static void line_of(const Face *f, const Sized *s, const Seen *e, f64 a, f64 *low, f64 *high) {
    f64 sa = fast_sin(a), ca = fast_cos(a), y = f->far * sa / ca, t = (y - f->cy) / f->tall, length, middle, along[3];
    length = f->half * (f->round ? safe_root(1.0 - t * t) : 1.0), middle = f->cx + f->lean * t;
    f64 from = middle - length, to = middle + length, per = ca / f->far;
    if (s->spread) {
        f64 most = safe_root(square(s->edge * f->far) - y * y);
        from = fmax(from, -most), to = fmin(to, most);
    }
    *low = atan(from * per), *high = atan(to * per);
    for (int j = 0; j < 3; j++) along[j] = sa * f->y[j] + ca * f->z[j];
    within_cone(dot3(along, e->N), dot3(f->x, e->N), 0.0, low, high);
    if ((s->kind == BALL_SPOT || s->kind == FACING_SPOT) && !s->own)
        within_cone(-dot3(along, s->axis), -dot3(f->x, s->axis), s->edge, low, high);
}

/* The lines that meet it, from low to high; returns whether they get shorter towards both ends. */
static int lines_of(const Face *f, const Sized *s, f64 *low, f64 *high) {
    f64 from = f->cy - f->tall, to = f->cy + f->tall;
    int round = f->round;
    if (s->spread) {
        f64 most = s->edge * f->far;
        round |= from < -most || to > most;
        from = fmax(from, -most), to = fmin(to, most);
    }
    *low = atan(from / f->far), *high = atan(to / f->far);
    if ((s->kind == BALL_SPOT || s->kind == FACING_SPOT) && !s->own) {
        f64 aside = -dot3(s->axis, f->x), flat = safe_root(1.0 - aside * aside), sine = safe_root(1.0 - s->edge * s->edge);
        if (s->edge > 0.0 && sine < flat) {
            f64 middle = atan2(-dot3(s->axis, f->y), -dot3(s->axis, f->z)), reach = asin(sine / flat);
            *low = fmax(*low, middle - reach), *high = fmin(*high, middle + reach);
        }
    }
    return round;
}

/* Where between `in`, a line above the horizon, and `out`, one that is not, lines end. */
static f64 last_line(const Face *f, const Sized *s, const Seen *e, f64 in, f64 out) {
    for (int step = 0; step < 10; step++) {
        f64 middle = 0.5 * (in + out), from, to;
        line_of(f, s, e, middle, &from, &to);
        if (to > from) in = middle;
        else out = middle;
    }
    return out;
}

/* Gauss's rules of 2, 3, 4, 6 and 8 points on [0,1], for a range of x and of an angle. */
static int rule_for(f64 size, const f64 **at, const f64 **weight) {
    static const f64 at2[] = {0.21132486540518713, 0.7886751345948129}, two[] = {0.5, 0.5};
    static const f64 at3[] = {0.1127016653792583, 0.5, 0.8872983346207417}, three[] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    static const f64 at4[] = {0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970262};
    static const f64 four[] = {0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693};
    static const f64 at6[] = {0.033765242898423975, 0.16939530676686776, 0.3806904069584015,
                              0.6193095930415985, 0.8306046932331322, 0.966234757101576};
    static const f64 six[] = {0.08566224618958517, 0.1803807865240693, 0.23395696728634552,
                              0.23395696728634552, 0.1803807865240693, 0.08566224618958517};
    static const f64 *places[] = {at2, at3, at4, at6, gauss_at}, *weights[] = {two, three, four, six, gauss_weight};
    static const int counts[] = {2, 3, 4, 6, 8};
    int which = size < 0.4 ? 0 : size < 0.9 ? 1 : size < 1.4 ? 2 : size < 2.5 ? 3 : 4;
    *at = places[which], *weight = weights[which];
    return counts[which];
}

static inline f64 squeezed(f64 y) { return y / sqrt(1.0 + y * y); }

/* The centre and width along `step` of the bump that m is at. */
static inline void bump(const f64 *m, const f64 *step, f64 *centre, f64 *width) {
    f64 rate = dot3(step, step) + 1e-300, off = dot3(m, step) / rate, left = 1.0 + dot3(m, m) - off * off * rate;
    *centre -= off, *width = sqrt((left > 1.0 ? left : 1.0) / rate);
}

/* One ray to the middle of a lamp that is small beside its highlight and its distance; returns whether it is. */
static int one_ray(const Sized *s, const Face *f, const Seen *e, Ray *ray) {
    f64 far = f->cx * f->cx + f->cy * f->cy + f->far * f->far, length = sqrt(far), size = fmax(f->half, f->tall + fabs(f->lean)) / length;
    int shared = s->spread || s->kind == BALL_SPOT || s->kind == FACING_SPOT;
    if (size > (shared ? 1e-3 : 0.1)) return 0;
    Slope slope;
    slope_at(f, e, atan2(f->cy, f->far), asin(clamped(f->cx / length, -1.0, 1.0)), &slope);
    f64 rate = fmax(dot3(slope.a, slope.a), dot3(slope.b, slope.b));
    if (size * size * rate > 0.01 * (1.0 + dot3(slope.m, slope.m))) return 0;
    for (int j = 0; j < 3; j++) ray->way[j] = (f->cx * f->x[j] + f->cy * f->y[j] + f->far * f->z[j]) / length;
    ray->weight = s->per_area * (f->round ? PI : 4.0) * f->half * f->tall * f->far / (far * length);
    if (shared) ray->weight *= s->spread ? spread_share(s, ray->way) : spot_share(s, ray->way);
    return 1;
}

/* Returns whether the lamp's power changes with the direction as that of a spot's cone does. */
static int has_cone(const Sized *lamp) { return lamp->kind == BALL_SPOT || lamp->kind == FACING_SPOT; }

/* Fills rays of the line `a` of a lamp's face, from `from` to `to`, where the highlight has its peak and its own width;
   step: the share of the line. least: `rule_for`'s size, at least. Returns how many. */
static int rays_of_line(const Sized *lamp, const Face *f, f64 a, f64 from, f64 to, f64 peak, f64 own, f64 step, f64 least,
                        Ray *rays) {
    const f64 *at, *share;
    f64 y0 = squeezed((from - peak) / own), y1 = squeezed((to - peak) / own), sa = fast_sin(a), ca = fast_cos(a);
    int places = rule_for(fmax(fmax(y1 - y0, 0.8 * (to - from)), least), &at, &share), count = 0;
    for (int k = 0; k < places; k++) {
        f64 y = y0 + (y1 - y0) * at[k], left = sqrt(1.0 - y * y), on = peak + own * y / left;
        f64 sb = fast_sin(on), cb = fast_cos(on), weight = step * (y1 - y0) * share[k] * own / (left * left * left) * cb;
        Ray *ray = rays + count;
        for (int j = 0; j < 3; j++) ray->way[j] = cb * (sa * f->y[j] + ca * f->z[j]) + sb * f->x[j];
        if (lamp->spread) weight *= spread_share(lamp, ray->way);
        else if (has_cone(lamp)) weight *= spot_share(lamp, ray->way);
        ray->weight = weight * lamp->per_area;
        count += weight > 0.0;
    }
    return count;
}

/* Fills rays of the lamp for a highlight; returns how many. */
static int rays_to(const Sized *lamp, const Seen *e, const f64 *P, Ray *rays) {
    f64 R[3], up = 2.0 * dot3(e->N, e->V), low, high, from, to, width, a0, b0;
    for (int j = 0; j < 3; j++) R[j] = up * e->N[j] - e->V[j];
    if (lamp->kind >= PLATE) {
        const f64 way[3] = {lamp->c[0] - P[0], lamp->c[1] - P[1], lamp->c[2] - P[2]};
        if (dot3(way, lamp->axis) >= 0.0) return 0;  /* behind it */
    }
    Face f = face_of(lamp, P, R);
    if (one_ray(lamp, &f, e, rays)) return rays->weight > 0.0;
    int tapered = lines_of(&f, lamp, &low, &high), count = 0;
    if (high <= low) return 0;

    /* Where the highlight is, among the lines */
    Slope least;
    b0 = asin(clamped(dot3(R, f.x), -1.0, 1.0)), a0 = atan2(dot3(R, f.y), dot3(R, f.z));
    if (f.round) {  /* onto the edge towards the middle, not down to the end of all lines */
        line_of(&f, lamp, e, 0.5 * (low + high), &from, &to);
        f64 p = (2.0 * a0 - low - high) / (high - low), q = to > from ? (2.0 * b0 - from - to) / (to - from) : 0.0, far = hypot(p, q);
        if (far > 1.0) a0 = 0.5 * (low + high + (high - low) * p / far);
    }
    a0 = clamped(a0, low, high);
    line_of(&f, lamp, e, a0, &from, &to);
    f64 above = dot3(f.z, e->N) * f.far + dot3(f.x, e->N) * f.cx + dot3(f.y, e->N) * f.cy;
    if (to > from && above < f.half + f.tall + fabs(f.lean)) {  /* the horizon may cut it */
        f64 a, b, near = 0.001 * (high - low);
        line_of(&f, lamp, e, low + near, &a, &b);
        if (b <= a) low = last_line(&f, lamp, e, a0, low), tapered = 1;
        line_of(&f, lamp, e, high - near, &a, &b);
        if (b <= a) high = last_line(&f, lamp, e, a0, high), tapered = 1;
    }
    f64 b = to > from ? clamped(b0, from, to) : 0.5 * (from + to), middle = a0, across[3];
    slope_at(&f, e, a0, b, &least);
    f64 slant = dot3(least.a, least.b) / (dot3(least.b, least.b) + 1e-300);
    for (int j = 0; j < 3; j++) across[j] = least.a[j] - (b == b0 ? slant : 0.0) * least.b[j];
    bump(least.m, across, &middle, &width);

    const f64 *at, *share;
    f64 half = 0.5 * (high - low), centre = 0.5 * (high + low), start = low, end = high, size = high - low;
    if (tapered) {  /* a = centre + half·sin φ */
        f64 place = clamped((middle - centre) / half, -1.0, 1.0), taper = sqrt(1.0 - place * place + fmin(width / half, 1.0));
        start = -0.5 * PI, end = 0.5 * PI, middle = asin(place), width /= half * taper;
    }
    f64 x0 = squeezed((start - middle) / width), x1 = squeezed((end - middle) / width);
    /* What a spread and the blend of a spot's cone give is as if bent within them. */
    f64 least_size = lamp->spread || (has_cone(lamp) && lamp->own) ? 3.0 : has_cone(lamp) ? 2.0 : 0.0;
    int lines = rule_for(fmax(fmax(x1 - x0, 0.8 * size), fmax(least_size, tapered ? 1.0 : 0.0)), &at, &share);
    for (int i = 0; i < lines; i++) {
        f64 x = x0 + (x1 - x0) * at[i], root = sqrt(1.0 - x * x), a = middle + width * x / root;
        f64 step = (x1 - x0) * share[i] * width / (root * root * root), own;
        if (tapered) step *= half * cos(a), a = centre + half * sin(a);
        line_of(&f, lamp, e, a, &from, &to);
        if (to <= from) continue;
        Slope line;
        f64 peak = clamped(b - slant * (a - a0), from, to);
        slope_at(&f, e, a, peak, &line);
        bump(line.m, line.b, &peak, &own);
        count += rays_of_line(lamp, &f, a, from, to, peak, own, step, least_size, rays + count);
    }
    return count;
}
