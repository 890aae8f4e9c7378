/* Lamps that light with their whole size: what shading.c's two sums over such lamps share (sized.py, docs/method.md §1).

   A lamp is a cone of directions as a receiver sees it (a sphere, a disc that faces the receiver, the sun), an ellipse or
   a parallelogram. Its light is the radiance I/A, A being the area that I is spread over, times an integral over these
   directions: of N·ω for matt surfaces (sized_matt.h), of (R·V)^n for glossy ones (sized_gloss.h). */
#pragma once
#include "fast.h"

/* What sized.py calls the types of these lamps; they follow those of shading.c. */
enum { BALL = 16, FACING, SKY, BALL_SPOT, FACING_SPOT, PLATE, OVAL };

typedef struct {
    int kind, spread;           /* spread: of a PLATE or OVAL, not all directions get light */
    f64 c[3], axis[3];          /* the centre, of SKY the unit vector to it; the way the light travels */
    f64 u[3], v[3], radius;     /* half-axes; of SKY radius is the sine of half its angle */
    f64 edge, slope;            /* as for points: cosine of the cone or tangent of the spread; slope */
    f64 per_area;               /* 1/A */
    const f64 *own;             /* axes of a skewed spot, or NULL */
} Sized;

static inline f64 dot3(const f64 *a, const f64 *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static inline void cross3(const f64 *a, const f64 *b, f64 *out) {
    f64 x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    out[0] = x, out[1] = y, out[2] = z;
}
static inline f64 clamped(f64 x, f64 low, f64 high) { return x < low ? low : x > high ? high : x; }
static inline f64 safe_acos(f64 x) { return acos(clamped(x, -1.0, 1.0)); }
static inline f64 safe_root(f64 x) { return x > 0.0 ? sqrt(x) : 0.0; }

/* Numbers of a light with a size, as sized.py packs them in `extent`: half-axes u and v, radius, and 1/A. */
static inline Sized sized_of(int kind, const f64 *c, const f64 *axis, f64 edge, f64 slope, const f64 *own, const f64 *extent) {
    Sized s = {.kind = kind, .edge = edge, .slope = slope, .radius = extent[6], .per_area = extent[7], .own = own};
    for (int j = 0; j < 3; j++)
        s.c[j] = kind == SKY ? -axis[j] : c[j], s.axis[j] = axis[j], s.u[j] = extent[j], s.v[j] = extent[3 + j];
    s.spread = kind >= PLATE && slope > 0.0;
    if (dot3(own, own) == 0.0 || (kind != BALL_SPOT && kind != FACING_SPOT)) s.own = NULL;
    return s;
}

/* Two unit vectors (a, b) perpendicular to the unit vector d and to one another. */
static inline void beside(const f64 *d, f64 *a, f64 *b) {
    f64 sign = d[2] >= 0.0 ? 1.0 : -1.0, f = -1.0 / (sign + d[2]), g = d[0] * d[1] * f;
    a[0] = 1.0 + sign * d[0] * d[0] * f, a[1] = sign * g, a[2] = -sign * d[0];
    b[0] = g, b[1] = sign + d[1] * d[1] * f, b[2] = -d[1];
}

/* How a lamp is seen from P: the cone's unit axis d, the sine and cosine of its half angle; inside: of a sphere that P is
   in, which shines from everywhere. */
typedef struct {
    f64 d[3], sine, cosine;
    int inside;
} Cone;

static inline Cone cone_of(const Sized *s, const f64 *P) {
    Cone cone = {{s->c[0], s->c[1], s->c[2]}, s->radius, 0.0, 0};
    if (s->kind != SKY) {
        for (int j = 0; j < 3; j++) cone.d[j] -= P[j];
        f64 square = dot3(cone.d, cone.d), inverse = square > 0.0 ? 1.0 / sqrt(square) : 0.0;
        int flat = s->kind == FACING || s->kind == FACING_SPOT;
        for (int j = 0; j < 3; j++) cone.d[j] *= inverse;
        cone.sine = flat ? s->radius / sqrt(square + s->radius * s->radius) : s->radius * inverse;
        cone.inside = !flat && square <= s->radius * s->radius;
        if (cone.inside) cone.sine = 1.0;
    }
    cone.cosine = safe_root(1.0 - cone.sine * cone.sine);
    return cone;
}

/* What a spot sends along -ω, ω being the unit vector from the receiver: its cone, blended. */
static inline f64 spot_share(const Sized *s, const f64 *way) {
    f64 axis = -dot3(way, s->axis);
    if (s->own) {
        f64 q[3] = {dot3(way, s->own), dot3(way, s->own + 3), dot3(way, s->own + 6)};
        axis = -q[2] / sqrt(dot3(q, q));
    }
    f64 t = clamped((axis - s->edge) * s->slope, 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

/* What an area lamp of a spread sends along -ω, as Cycles has it. */
static inline f64 spread_share(const Sized *s, const f64 *way) {
    f64 axis = -dot3(way, s->axis);
    if (axis <= 0.0) return 0.0;
    f64 share = (s->edge - safe_root(1.0 - axis * axis) / axis) * s->slope;
    return share > 0.0 ? share : 0.0;
}

/* Gauss-Legendre nodes and weights on [0,1]. */
enum { GAUSS = 8 };
static const f64 gauss_at[GAUSS] = {0.019855071751231884, 0.10166676129318664, 0.2372337950418355, 0.4082826787521751,
                                    0.5917173212478249,   0.7627662049581645,  0.8983332387068134, 0.9801449282487681};
static const f64 gauss_weight[GAUSS] = {0.05061426814518813, 0.11119051722668724, 0.15685332293894363, 0.18134189168918100,
                                        0.18134189168918100, 0.15685332293894363, 0.11119051722668724, 0.05061426814518813};

/* A polygon of at most MOST corners, cut to what lies where normal·x >= 0; returns the corners left. */
enum { MOST = 8 };
static inline int cut(const f64 (*from)[3], int n, const f64 *normal, f64 (*to)[3]) {
    int left = 0;
    for (int i = 0; i < n; i++) {
        const f64 *a = from[i], *b = from[(i + 1) % n];
        f64 x = dot3(a, normal), y = dot3(b, normal);
        if (x >= 0.0) memcpy(to[left++], a, sizeof to[0]);
        if ((x >= 0.0) != (y >= 0.0)) {
            f64 t = x / (x - y);
            for (int j = 0; j < 3; j++) to[left][j] = a[j] + t * (b[j] - a[j]);
            left++;
        }
    }
    return left;
}

/* The corners of a PLATE as P sees them, counter-clockwise from there. */
static inline void corners_of(const Sized *s, const f64 *P, f64 (*out)[3]) {
    f64 normal[3];
    cross3(s->u, s->v, normal);
    f64 turn = dot3(normal, s->axis) > 0.0 ? -1.0 : 1.0;
    for (int i = 0; i < 4; i++) {
        f64 x = i == 0 || i == 3 ? -1.0 : 1.0, y = (i < 2 ? -1.0 : 1.0) * turn;
        for (int j = 0; j < 3; j++) out[i][j] = s->c[j] - P[j] + x * s->u[j] + y * s->v[j];
    }
}
