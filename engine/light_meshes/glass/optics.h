/* A ray of light with its derivatives, and the chain of interfaces that it meets (optics.py).

   A ray is six vectors: the origin P, the unit direction D, and their derivatives by two parameters (Pu, Pv, Du,
   Dv). They are carried along as in Igehy, Tracing Ray Differentials (1999), but without his approximations; normals
   are interpolated ones. The signature of a path is the sequence of its bends. A bend is 2·patch, + 1 if the path
   leaves the body, and η = n before / n behind, or REFLECTED for a total reflection, if the light's paths are
   followed beyond it. */
#pragma once
#include "media.h"

enum { DEPTH = 64, BODIES = 64, ROOM = 6 };  /* bends of a path, bodies around a point, slots hit at the same place */
/* the largest number of reflections of a path; one at a curved surface counts as CURVED */
enum { REFLECTIONS = 8, CURVED = 4 };
enum { SEEDS, UNCONVERGED, NEWTON, RAYS, REJECTED };  /* indices of the counts of work */
#define REFLECTED -1.0
#define FAR 8.0  /* a sun's rays start at this many times the reach of the glass, and at least of the frame's box */

typedef f64 Ray[6][3];

/* The bodies around a point: rows 1..rows[0][0] hold (body, how often). */
typedef struct {
    i64 rows[BODIES + 1][2];
} Medium;

/* What was hit at the ray's origin: the number of slots, the body, owner and facing of the last one, and the slots.
   count −1: the ray was reflected there. */
typedef struct {
    i64 count, body, owner, facing, slot[ROOM];
} Touched;

/* One bend: η, u, v, the length of the ray before it, and `beyond`; its code and slot, and the ray behind it. In the
   entry after the last bend, code is that of the surface that reflects all light, −1: none. */
typedef struct {
    f64 eta, u, v, length, beyond;
    i64 code, slot;
    Ray ray;
} Bend;

/* A light, and one of its paths. */
typedef struct {
    const f64 *light;  /* in the frame; for a sun the unit vector towards it */
    int sun, total;  /* total: paths continue where light is totally reflected */
    f64 far;  /* all glass is nearer; a sun's rays start there */
    const i64 (*around)[2];  /* the bodies around the light, as in Medium */
    i64 *work;
    Ray ray;
    f64 alpha[3];
    Medium medium;
    Touched touched;
    Hit hit;
    i64 slot;  /* of the last bend, and its η */
    f64 eta, normal[3][3];
    Bend bend[DEPTH + 1];
} Path;

#define LIGHT "light f64[3]  sun i64  total i64  far f64  around i64[c,2]  work i64[5]!  "
#define OF_LIGHT const f64 *light, i64 sun, i64 total, f64 far, const i64 *around, i64 *work

/* Writes two unit vectors that are perpendicular to the direction and to each other to rows `row` and row + 1. */
static inline void basis(Ray ray, int row) {
    f64 x = ray[1][0], y = ray[1][1], z = ray[1][2], sign = z >= 0.0 ? 1.0 : -1.0, f = -1.0 / (sign + z), g = x * y * f;
    ray[row][0] = 1.0 + sign * x * x * f, ray[row][1] = sign * g, ray[row][2] = -sign * x;
    ray[row + 1][0] = g, ray[row + 1][1] = sign + y * y * f, ray[row + 1][2] = -y;
}

/* Starts the light's ray through y. The parameters of its derivatives are two angles at the light, or lengths across
   a sun's rays. */
static inline void start_ray(Path *s, const f64 *y) {
    memset(s->ray, 0, sizeof s->ray);
    if (s->sun) {
        f64 away = s->far + fabs(y[0]) + fabs(y[1]) + fabs(y[2]);
        for (int j = 0; j < 3; j++) s->ray[1][j] = -s->light[j], s->ray[0][j] = y[j] + away * s->light[j];
        basis(s->ray, 2);
        return;
    }
    f64 length = 0.0;
    for (int j = 0; j < 3; j++) {
        s->ray[0][j] = s->light[j];
        s->ray[1][j] = y[j] - s->light[j];
        length += s->ray[1][j] * s->ray[1][j];
    }
    length = sqrt(length);
    for (int j = 0; j < 3; j++) s->ray[1][j] /= length;
    basis(s->ray, 4);
}

/* Direction·NG: negative where the ray enters. */
static inline f64 slope_of(const f64 *p, const Ray ray) { return ray[1][0] * p[NG] + ray[1][1] * p[NG + 1] + ray[1][2] * p[NG + 2]; }

/* Computes the light's ray at the point (u, v) of a triangle. The parameters of its derivatives are u and v. */
static inline void start_at(const Path *s, const f64 *p, f64 u, f64 v, Ray ray) {
    f64 square_of = 0.0, a = 0.0, b = 0.0;
    for (int j = 0; j < 3; j++) {
        ray[0][j] = p[A + j] + u * p[E1 + j] + v * p[E2 + j];
        ray[1][j] = s->sun ? -s->light[j] : ray[0][j] - s->light[j];
        square_of += ray[1][j] * ray[1][j];
    }
    f64 length = sqrt(square_of);
    for (int j = 0; j < 3; j++) {
        ray[1][j] /= length;
        ray[2][j] = p[E1 + j], ray[3][j] = p[E2 + j];
        a += ray[1][j] * ray[2][j];
        b += ray[1][j] * ray[3][j];
    }
    for (int j = 0; j < 3; j++) {
        ray[4][j] = s->sun ? 0.0 : (ray[2][j] - a * ray[1][j]) / length;
        ray[5][j] = s->sun ? 0.0 : (ray[3][j] - b * ray[1][j]) / length;
    }
}

/* Moves the ray by t to a triangle's plane. After that its derivatives are those of its point in that plane. */
static inline void travel(const f64 *p, f64 t, Ray ray) {
    f64 slope = slope_of(p, ray);
    for (int k = 2; k < 4; k++) {
        f64 away = 0.0;
        for (int j = 0; j < 3; j++) {
            ray[k][j] += t * ray[k + 2][j];
            away += ray[k][j] * p[NG + j];
        }
        for (int j = 0; j < 3; j++) ray[k][j] -= away / slope * ray[1][j];
    }
    for (int j = 0; j < 3; j++) ray[0][j] += t * ray[1][j];
}

/* Computes the shading normal n[0] at the point (u, v) of a triangle, turned against the ray, and its derivatives
   n[1], n[2]. */
static inline void normal_at(const f64 *p, int flat, f64 u, f64 v, f64 facing, const Ray ray, f64 n[3][3]) {
    if (flat) {
        for (int j = 0; j < 3; j++) n[0][j] = -facing * p[NG + j], n[1][j] = 0.0, n[2][j] = 0.0;
        return;
    }
    f64 square_of = 0.0;
    for (int j = 0; j < 3; j++) {
        f64 n0 = p[NS + j], n1 = p[NS + 3 + j] - n0, n2 = p[NS + 6 + j] - n0;
        n[0][j] = -facing * (n0 + u * n1 + v * n2);
        square_of += n[0][j] * n[0][j];
    }
    f64 length = sqrt(square_of);
    for (int j = 0; j < 3; j++) n[0][j] /= length;
    for (int k = 0; k < 2; k++) {
        f64 du = 0.0, dv = 0.0, along = 0.0;
        for (int j = 0; j < 3; j++) {
            du += ray[2 + k][j] * p[U + j];
            dv += ray[2 + k][j] * p[V + j];
        }
        for (int j = 0; j < 3; j++) {
            f64 n0 = p[NS + j];
            n[1 + k][j] = -facing / length * (du * (p[NS + 3 + j] - n0) + dv * (p[NS + 6 + j] - n0));
            along += n[1 + k][j] * n[0][j];
        }
        for (int j = 0; j < 3; j++) n[1 + k][j] -= along * n[0][j];
    }
}

/* Applies Snell's law at the ray's point (u, v) of a triangle, with the shading normal n, which it fills; with η
   REFLECTED it applies the law of a mirror. Returns 0 if no light goes there: at total reflection, or if by the
   shading normal the ray would not reach the surface, or would not leave it on the right side. */
static inline int bend_ray(const Glass *g, i64 slot, f64 u, f64 v, f64 eta, Ray ray, f64 n[3][3]) {
    const f64 *p = place_of(g, slot);
    f64 facing = slope_of(p, ray) > 0.0 ? 1.0 : -1.0;
    normal_at(p, link_of(g, slot, FLAT_SHADED) != 0, u, v, facing, ray, n);
    f64 c = -(ray[1][0] * n[0][0] + ray[1][1] * n[0][1] + ray[1][2] * n[0][2]);
    f64 square_of = 1.0 - eta * eta * (1.0 - c * c);
    if (!(c > 0.0 && square_of > 0.0)) return 0;
    f64 mu = 2.0 * c, by_c = 2.0;
    if (eta == REFLECTED) {
        eta = 1.0, facing = -facing;
    } else {
        f64 root = sqrt(square_of);
        mu = eta * c - root, by_c = eta - eta * eta * c / root;
    }
    for (int k = 0; k < 2; k++) {
        f64 dc = 0.0;
        for (int j = 0; j < 3; j++) dc -= ray[4 + k][j] * n[0][j] + ray[1][j] * n[1 + k][j];
        f64 dmu = by_c * dc;
        for (int j = 0; j < 3; j++) ray[4 + k][j] = eta * ray[4 + k][j] + dmu * n[0][j] + mu * n[1 + k][j];
    }
    for (int j = 0; j < 3; j++) ray[1][j] = eta * ray[1][j] + mu * n[0][j];
    return slope_of(p, ray) * facing > 0.0;
}

/* Returns the rank of the medium that the bodies make, −1 for air; *n is its index. */
static inline i64 medium_rank(const Glass *g, const Medium *medium, f64 *n) {
    i64 rank = -1;
    *n = 1.0;
    for (i64 i = 1; i <= medium->rows[0][0]; i++) {
        i64 body = medium->rows[i][0];
        if (g->rank[body] > rank) rank = g->rank[body], *n = g->ior[body];
    }
    return rank;
}

/* Enters or leaves a body; returns 0 if that is impossible. */
static inline int cross_body(Medium *medium, i64 body, int entering) {
    i64(*rows)[2] = medium->rows, last = rows[0][0];
    for (i64 i = 1; i <= last; i++) {
        if (rows[i][0] != body) continue;
        rows[i][1] += entering ? 1 : -1;
        if (rows[i][1] == 0) {
            rows[i][0] = rows[last][0], rows[i][1] = rows[last][1];
            rows[0][0] = last - 1;
        }
        return 1;
    }
    if (!entering || last == BODIES) return 0;
    rows[0][0] = last + 1;
    rows[last + 1][0] = body, rows[last + 1][1] = 1;
    return 1;
}

enum { BENDS, ENDS, BROKEN };

/* Follows the path's ray to the first surface that bends it, or to `end`. Returns BENDS, ENDS or BROKEN (surfaces that
   are not closed).

   After BENDS, hit, slot and eta describe the bend. alpha is multiplied by t of each surface on the way, including
   the last one; a surface inside a medium of higher priority is ignored. A second triangle of the same surface at
   the same place means an edge and is not counted again. */
static inline int next_bend(const Glass *g, Path *s, f64 end) {
    Touched *touched = &s->touched;
    f64 t0 = 0.0, last = -1.0;
    /* after a reflection, other surfaces at this place are behind the ray */
    if (touched->count < 0) t0 = 2.0 * TOUCHING, touched->count = 0;
    else if (touched->count) t0 = -2.0 * TOUCHING, last = 0.0;
    for (;;) {
        s->work[RAYS]++;
        i64 slot = closest(g, s->ray, t0, end, touched->slot, touched->count, -1, 0.0, &s->hit);
        if (slot < 0) return ENDS;
        /* Is it the second triangle at an edge? */
        f64 t = s->hit.t, least = s->hit.u < s->hit.v ? s->hit.u : s->hit.v, third = 1.0 - s->hit.u - s->hit.v;
        const f64 *p = place_of(g, slot);
        i64 facing = slope_of(p, s->ray) > 0.0 ? 1 : -1, body = link_of(g, slot, BODY), owner = link_of(g, slot, OWNER);
        int edge = fabs(t - last) < TOUCHING && body == touched->body && owner == touched->owner &&
                   (body >= 0 ? facing == touched->facing : (third < least ? third : least) < TOUCHING);
        /* Remember the slots at this place, so that the next search skips them */
        if (t - last > 2.0 * TOUCHING) touched->count = 0;
        f64 from = t;
        if (touched->count < ROOM) touched->slot[touched->count++] = slot, from = t - 2.0 * TOUCHING;
        t0 = from > t0 ? from : t0;
        last = t;
        touched->body = body, touched->owner = owner, touched->facing = facing;
        if (edge) continue;

        /* The media before and behind the surface */
        f64 before = 1.0, behind = 1.0;
        if (body >= 0) {
            i64 rank = medium_rank(g, &s->medium, &before);
            if (!cross_body(&s->medium, body, facing < 0)) return BROKEN;
            if (medium_rank(g, &s->medium, &behind) == rank) continue;  /* hidden in a medium of higher priority */
        }
        for (int j = 0; j < 3; j++) s->alpha[j] *= p[KT + j];
        if (before != behind) {
            s->slot = slot, s->eta = before / behind;
            return BENDS;
        }
    }
}

/* Starts a new path: the light's ray through y. */
static inline void set_out(Path *s, const f64 *y) {
    start_ray(s, y);
    s->touched.count = 0;
    memcpy(s->medium.rows, s->around, sizeof s->medium.rows);
    for (int j = 0; j < 3; j++) s->alpha[j] = 1.0;
}

/* Returns by how much the cosine at the normal is smaller than at the critical angle, for a place where bend_ray let
   no light pass. Negative: it was not total reflection. */
static inline f64 beyond(const Path *s) {
    f64 cosine = 0.0;
    for (int j = 0; j < 3; j++) cosine -= s->ray[1][j] * s->normal[0][j];
    if (s->eta <= 1.0 || cosine <= 0.0) return -1.0;
    f64 square_of = 1.0 - 1.0 / (s->eta * s->eta);
    return sqrt(square_of > 0.0 ? square_of : 0.0) - cosine;
}

/* Follows the light's ray through y for up to `most` bends; returns how many there are. Afterwards the path holds
   each bend, and the ray, alpha and medium at its end. If it ends at a surface that reflects all light, bend[n] says
   which, and by how much it is beyond the critical angle. The length after the last bend is infinite if there is no
   further bend, or if none was looked for. */
static inline i64 chain(const Glass *g, Path *s, const f64 *y, i64 most, f64 cutoff) {
    i64 n = 0, reflections = 0;
    set_out(s, y);
    for (; n < most; n++) {
        Bend *b = s->bend + n;
        b->length = INFINITY, b->code = -1;
        if (next_bend(g, s, INFINITY) != BENDS) return n;
        i64 slot = s->slot;

        /* Bend the ray, or reflect it */
        b->eta = s->eta, b->u = s->hit.u, b->v = s->hit.v, b->length = s->hit.t;
        travel(place_of(g, slot), s->hit.t, s->ray);
        int bends = bend_ray(g, slot, b->u, b->v, s->eta, s->ray, s->normal);
        if (!bends && s->total && reflections < REFLECTIONS && beyond(s) >= 0.0) {
            bends = bend_ray(g, slot, b->u, b->v, REFLECTED, s->ray, s->normal);
            b->eta = REFLECTED;
            reflections += g->planar[link_of(g, slot, PATCH)] >= 0 ? 1 : CURVED;
            s->touched.count = -1;
            cross_body(&s->medium, link_of(g, slot, BODY), s->touched.facing > 0);  /* it stays in the body */
        }
        /* Store the bend, unless the ray ends here */
        f64 brightest = s->alpha[0] > s->alpha[1] ? s->alpha[0] : s->alpha[1];
        if (bends && (brightest > s->alpha[2] ? brightest : s->alpha[2]) <= cutoff) return n;
        b->beyond = beyond(s);
        if (bends || b->beyond >= 0.0) b->code = 2 * link_of(g, slot, PATCH) + (s->touched.facing > 0), b->slot = slot;
        if (!bends) return n;
        memcpy(b->ray, s->ray, sizeof b->ray);
    }
    s->bend[n].length = INFINITY, s->bend[n].code = -1;
    return n;
}

/* Returns the distance of x from the ray; *along: the length along the ray to the nearest point. */
static inline f64 miss(const Ray ray, const f64 *x, f64 *along) {
    f64 square_of = 0.0, length = 0.0;
    for (int j = 0; j < 3; j++) length += (x[j] - ray[0][j]) * ray[1][j];
    for (int j = 0; j < 3; j++) {
        f64 away = x[j] - ray[0][j] - length * ray[1][j];
        square_of += away * away;
    }
    *along = length;
    return sqrt(square_of);
}

/* Computes the derivatives of the ray's point at length `along`, across the ray (rows 0 and 1 of out), and x
   relative to it, across the ray (row 2). */
static inline void cross_section(const Ray ray, const f64 *x, f64 along, f64 out[3][2]) {
    f64 d0 = ray[1][0], d1 = ray[1][1], d2 = ray[1][2], sign = d2 >= 0.0 ? 1.0 : -1.0, f = -1.0 / (sign + d2), h = d0 * d1 * f;
    f64 a[3] = {1.0 + sign * d0 * d0 * f, sign * h, -sign * d0}, b[3] = {h, sign + d1 * d1 * f, -d1};
    for (int k = 0; k < 3; k++) {
        f64 q[3];
        for (int j = 0; j < 3; j++) q[j] = k < 2 ? ray[2 + k][j] + along * ray[4 + k][j] : x[j] - ray[0][j];
        out[k][0] = a[0] * q[0] + a[1] * q[1] + a[2] * q[2];
        out[k][1] = b[0] * q[0] + b[1] * q[1] + b[2] * q[2];
    }
}

static inline Path path_of(const f64 *light, i64 sun, i64 total, f64 far, const i64 *around, i64 *work) {
    Path s = {.light = light, .sun = sun != 0, .total = total != 0, .far = far, .around = (const i64(*)[2])around, .work = work};
    return s;
}
