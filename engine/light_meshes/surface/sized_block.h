/* matt_of and may_reach for receivers side by side, in loops without a branch; what these leave is done one by one. */
#pragma once
#include "sized_light.h"

enum { SIDE = 32 };  /* receivers that are lit side by side */
typedef const f64 (*Side)[SIDE];

/* θ/sin θ for d = cos θ. */
static inline f64 angle_over_sine(f64 d) {
    f64 e = fabs(d), under = sqrt(1.0 + e), g = acos_over(e) / under;
    f64 left = sqrt(1.0 - e > 1e-30 ? 1.0 - e : 1e-30);
    return d >= 0.0 ? g : PI / (under * left) - g;
}

/* light: E/A; left: 1 where the horizon cuts the lamp, or the receiver is in it. */
static void cone_block(const Sized *s, Side P, Side N, f64 *light, u8 *left) {
    f64 rr = s->radius * s->radius, disc = s->kind == FACING ? rr : 0.0;
    if (s->kind == SKY) {
        for (int k = 0; k < SIDE; k++) {
            f64 up = s->c[0] * N[0][k] + s->c[1] * N[1][k] + s->c[2] * N[2][k];
            light[k] = up > 0.0 ? up : 0.0, left[k] = up < s->radius && up > -s->radius;
        }
        return;
    }
    for (int k = 0; k < SIDE; k++) {
        f64 x = s->c[0] - P[0][k], y = s->c[1] - P[1][k], z = s->c[2] - P[2][k], far = x * x + y * y + z * z;
        f64 up = x * N[0][k] + y * N[1][k] + z * N[2][k], all = far + disc;
        light[k] = up > 0.0 ? up / (sqrt(far) * all) : 0.0;
        left[k] = up * up * all < rr * far || (disc == 0.0 && far <= rr);
    }
}

static void plate_block(const Sized *s, Side P, Side N, f64 *light, u8 *left) {
    f64 corner[4][3];
    const f64 here[3] = {0.0, 0.0, 0.0};
    corners_of(s, here, corner);
    f64 unit = s->per_area, reach = dot3(s->u, s->u) > dot3(s->v, s->v) ? dot3(s->u, s->u) : dot3(s->v, s->v);
    f64 near = FAR * FAR * 2.0 * reach;
    for (int k = 0; k < SIDE; k++) {
        f64 a[4][3], up[4], sum = 0.0;
        f64 x = s->c[0] - P[0][k], y = s->c[1] - P[1][k], z = s->c[2] - P[2][k], far = x * x + y * y + z * z;
        f64 height = -(x * s->axis[0] + y * s->axis[1] + z * s->axis[2]), most = -1.0, least = 1.0;
        for (int i = 0; i < 4; i++) {
            f64 p = corner[i][0] - P[0][k], q = corner[i][1] - P[1][k], r = corner[i][2] - P[2][k];
            f64 inverse = 1.0 / sqrt(p * p + q * q + r * r);
            a[i][0] = p * inverse, a[i][1] = q * inverse, a[i][2] = r * inverse;
            up[i] = a[i][0] * N[0][k] + a[i][1] * N[1][k] + a[i][2] * N[2][k];
            most = up[i] > most ? up[i] : most, least = up[i] < least ? up[i] : least;
        }
        for (int i = 0; i < 4; i++) {
            const f64 *b = a[i], *c = a[(i + 1) & 3];
            f64 across = (b[1] * c[2] - b[2] * c[1]) * N[0][k] + (b[2] * c[0] - b[0] * c[2]) * N[1][k] +
                         (b[0] * c[1] - b[1] * c[0]) * N[2][k];
            sum += across * angle_over_sine(b[0] * c[0] + b[1] * c[1] + b[2] * c[2]);
        }
        f64 point = (x * N[0][k] + y * N[1][k] + z * N[2][k]) * height / (far * far);
        sum = far > near ? point : 0.5 * sum * unit;
        int lit = height > 0.0 && most > 0.0 && sum > 0.0;
        light[k] = lit ? sum : 0.0, left[k] = height > 0.0 && least < 0.0 && most > 0.0;
    }
}

static void oval_block(const Sized *s, Side P, Side N, f64 *light, u8 *left) {
    const f64 *u = s->u, *v = s->v;
    f64 uu = dot3(u, u), vv = dot3(v, v), near = FAR * FAR * (uu > vv ? uu : vv), unit_area = PI * s->per_area;
    for (int k = 0; k < SIDE; k++) {
        f64 x = s->c[0] - P[0][k], y = s->c[1] - P[1][k], z = s->c[2] - P[2][k], far = x * x + y * y + z * z;
        f64 height = -(x * s->axis[0] + y * s->axis[1] + z * s->axis[2]);
        f64 up = x * N[0][k] + y * N[1][k] + z * N[2][k];
        f64 b = u[0] * N[0][k] + u[1] * N[1][k] + u[2] * N[2][k], c = v[0] * N[0][k] + v[1] * N[1][k] + v[2] * N[2][k];
        ELLIPSE(x, y, z, u, v);
        f64 all = unit_area * root / sqrt(product) * (ex * N[0][k] + ey * N[1][k] + ez * N[2][k]);
        all = far > near ? up * height / (far * far) : all;
        light[k] = height > 0.0 && up > 0.0 && all > 0.0 ? all : 0.0;
        left[k] = height > 0.0 && up * up < b * b + c * c;
    }
}

/* matt_of where `wanted` is not 0. */
static void matt_block(const Sized *s, Side P, Side N, const u8 *wanted, f64 *light) {
    u8 left[SIDE];
    if (s->kind == BALL || s->kind == FACING || s->kind == SKY) cone_block(s, P, N, light, left);
    else if (s->kind == PLATE && !s->spread) plate_block(s, P, N, light, left);
    else if (s->kind == OVAL && !s->spread) oval_block(s, P, N, light, left);
    else memset(left, 1, sizeof left);
    for (int k = 0; k < SIDE; k++) {
        if (!left[k] || !wanted[k]) continue;
        const f64 from[3] = {P[0][k], P[1][k], P[2][k]}, normal[3] = {N[0][k], N[1][k], N[2][k]};
        light[k] = matt_of(s, from, normal);
    }
}

/* Clears `out` of receivers that lie clearly beside a spot's cone, by the cosine of its half angle and the lamp's. */
static void beside_cone(const Sized *s, Side P, u8 *out) {
    f64 sine = safe_root(1.0 - s->edge * s->edge);
    for (int k = 0; k < SIDE; k++) {
        f64 x = s->c[0] - P[0][k], y = s->c[1] - P[1][k], z = s->c[2] - P[2][k], far = sqrt(x * x + y * y + z * z);
        f64 t = s->radius < far ? s->radius / far : 1.0, axis = -(x * s->axis[0] + y * s->axis[1] + z * s->axis[2]);
        out[k] &= (s->radius >= far) | (axis >= far * (s->edge * sqrt(1.0 - t * t) - sine * t - 1e-9));
    }
}

/* may_reach, as 0 and 1. */
static void reach_block(const Sized *s, Side P, Side N, u8 *out) {
    const f64 *u = s->u, *v = s->v;
    f64 near = s->kind == SKY ? 0.0 : 1.0, one_sided = s->kind >= PLATE ? 0.0 : -INFINITY, radius = s->kind < PLATE ? s->radius : 0.0;
    f64 plate = s->kind == PLATE ? 2.0 : 1.0;  /* (a + b)² <= 2·(a² + b²) */
    for (int k = 0; k < SIDE; k++) {
        f64 x = s->c[0] - near * P[0][k], y = s->c[1] - near * P[1][k], z = s->c[2] - near * P[2][k];
        f64 up = x * N[0][k] + y * N[1][k] + z * N[2][k], height = -(x * s->axis[0] + y * s->axis[1] + z * s->axis[2]);
        f64 b = u[0] * N[0][k] + u[1] * N[1][k] + u[2] * N[2][k], c = v[0] * N[0][k] + v[1] * N[1][k] + v[2] * N[2][k];
        out[k] = up + radius + sqrt(plate * (b * b + c * c)) > 0.0 && height > one_sided;
    }
    int spot = s->kind == BALL_SPOT || s->kind == FACING_SPOT;
    if (!s->spread && !spot) return;
    if (spot && !s->own && s->edge >= 0.0) beside_cone(s, P, out);
    for (int k = 0; k < SIDE; k++) {
        if (!out[k]) continue;
        const f64 from[3] = {P[0][k], P[1][k], P[2][k]}, normal[3] = {N[0][k], N[1][k], N[2][k]};
        out[k] = (u8)may_reach(s, from, normal);
    }
}
