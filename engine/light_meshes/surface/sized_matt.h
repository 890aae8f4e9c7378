/* E, the integral of max(0, N·ω) over the directions ω in which a receiver sees a lamp: matt surfaces return I/A·E.

   Closed forms: a cone above the horizon is π·sin²·(N·d); one that the horizon cuts, arc and chord; a polygon, Lambert's
   formula; an ellipse, by the one negative eigenvalue of its cone, and where the horizon cuts it by all three. The light
   of a spot and of a spread is one integral more, by Gauss's rule (sized_share.h). */
#pragma once
#include "sized.h"

/* Of a cone of half angle (sine, cosine) around d, with N·d = up. */
static f64 matt_cone(f64 sine, f64 cosine, f64 up) {
    if (up >= sine) return PI * sine * sine * up;
    if (up <= -sine) return 0.0;
    f64 side = safe_root(1.0 - up * up);
    f64 turn = safe_acos(-up * cosine / (side * sine)), reach = sine * sin(turn);
    /* The arc above the horizon, and the chord along it. */
    return sine * sine * up * turn - side * cosine * reach + asin(clamped(reach, -1.0, 1.0));
}

/* Lambert's formula for a polygon of n corners, none below the horizon. */
static f64 matt_polygon(const f64 (*corner)[3], int n, const f64 *N) {
    f64 sum = 0.0;
    for (int i = 0; i < n; i++) {
        const f64 *a = corner[i], *b = corner[(i + 1) % n];
        f64 across[3];
        cross3(a, b, across);
        f64 length = sqrt(dot3(across, across));
        if (length > 0.0) sum += dot3(across, N) * (atan2(length, dot3(a, b)) / length);
    }
    return sum > 0.0 ? 0.5 * sum : 0.0;
}

/* The cone of directions to an ellipse: ω is in it where ω·Cω <= 0, C (xx, yy, zz, xy, xz, yz), and one end of each line.
   least: the root of its one negative eigenvalue, -C's; axis: its unit eigenvector, on the lamp's side; product: of the
   differences of the other two eigenvalues from it. */
typedef struct {
    f64 C[6], least, axis[3], product;
} Ellipse;

/* The root by Newton's method, from an upper bound, from where it falls steadily: five steps. No loop, no branch, so that
   receivers side by side can do it together. */
#define STEP                                                                                                               \
    {                                                                                                                      \
        f64 value = ((root + trace) * root + minors) * root - det, rise = (3.0 * root + 2.0 * trace) * root + minors;      \
        root = rise > 0.0 && value > 0.0 ? root - value / rise : root;                                                     \
    }
#define ELLIPSE(cx, cy, cz, u, v)                                                                                          \
    f64 wx = u[1] * v[2] - u[2] * v[1], wy = u[2] * v[0] - u[0] * v[2], wz = u[0] * v[1] - u[1] * v[0];                    \
    f64 unit = 1.0 / (wx * wx + wy * wy + wz * wz);                                                                        \
    f64 px = v[1] * cz - v[2] * cy, py = v[2] * cx - v[0] * cz, pz = v[0] * cy - v[1] * cx;                                \
    f64 qx = cy * u[2] - cz * u[1], qy = cz * u[0] - cx * u[2], qz = cx * u[1] - cy * u[0];                                \
    f64 xx = (px * px + qx * qx - wx * wx) * unit, yy = (py * py + qy * qy - wy * wy) * unit;                              \
    f64 zz = (pz * pz + qz * qz - wz * wz) * unit, xy = (px * py + qx * qy - wx * wy) * unit;                              \
    f64 xz = (px * pz + qx * qz - wx * wz) * unit, yz = (py * pz + qy * qz - wy * wz) * unit;                              \
    f64 volume = (wx * cx + wy * cy + wz * cz) * unit; /* of u, v and the way to the centre */                             \
    f64 trace = xx + yy + zz, minors = xx * yy + xx * zz + yy * zz - xy * xy - xz * xz - yz * yz;                          \
    f64 det = volume * volume * volume * volume / unit, under = sqrt(minors * minors + 4.0 * fmax(trace, 0.0) * det);      \
    /* Upper bounds: 1; what the trace and the squares' sum allow; the root without the cubic term. */                     \
    f64 spread = trace * trace * (2.0 / 9.0) - minors * (2.0 / 3.0);                                                       \
    f64 root = 2.0 * sqrt(spread > 0.0 ? spread * 0.5 : 0.0) - trace * (1.0 / 3.0);                                        \
    f64 other = minors > 0.0 ? 2.0 * det / (minors + under) : trace > 0.0 ? 0.5 * (under - minors) / trace : 1.0;          \
    root = root < 1.0 ? root : 1.0;                                                                                        \
    root = root < other ? root : other;                                                                                    \
    STEP STEP STEP STEP STEP                                                                                               \
    f64 ax = xx + root, ay = yy + root, az = zz + root;                                                                    \
    f64 kx = ay * az - yz * yz, ky = ax * az - xz * xz, kz = ax * ay - xy * xy; /* cofactors of C + root */                \
    f64 kxy = xz * yz - xy * az, kxz = xy * yz - xz * ay, kyz = xy * xz - ax * yz;                                         \
    f64 product = kx + ky + kz;                                                                                            \
    f64 ex = kx * cx + kxy * cy + kxz * cz, ey = kxy * cx + ky * cy + kyz * cz, ez = kxz * cx + kyz * cy + kz * cz;        \
    f64 stretch = 1.0 / sqrt(ex * ex + ey * ey + ez * ez);                                                                 \
    ex *= stretch, ey *= stretch, ez *= stretch

static Ellipse ellipse_of(const f64 *centre, const f64 *u, const f64 *v) {
    ELLIPSE(centre[0], centre[1], centre[2], u, v);
    return (Ellipse){{xx, yy, zz, xy, xz, yz}, root, {ex, ey, ez}, product};
}

static f64 quadratic(const f64 *C, const f64 *a, const f64 *b) {
    return C[0] * a[0] * b[0] + C[1] * a[1] * b[1] + C[2] * a[2] * b[2] + C[3] * (a[0] * b[1] + a[1] * b[0]) +
           C[4] * (a[0] * b[2] + a[2] * b[0]) + C[5] * (a[1] * b[2] + a[2] * b[1]);
}

/* The integrals of cos t, sin t and 1, over 1 + a²cos²t + b²sin²t, from 0 to t; a >= b. */
static void arcs(f64 a, f64 b, f64 t, f64 *out) {
    f64 s = sin(t), c = cos(t), qq = 1.0 + a * a, pp = 1.0 + b * b, kk = a * a - b * b;
    f64 q = sqrt(qq), p = sqrt(pp), k = sqrt(kk);
    if (kk > 1e-6 * pp) {
        out[0] = atanh(k * s / q) / (q * k);
        out[1] = (atan(k / p) - atan(k * c / p)) / (p * k);
    } else {
        out[0] = s / qq * (1.0 + kk * s * s / (3.0 * qq));
        out[1] = (1.0 - c) / pp - kk * (1.0 - c * c * c) / (3.0 * pp * pp);
    }
    out[2] = (t + atan2((p - q) * s * c, q * c * c + p * s * s)) / (p * q);
}

/* Of an ellipse that the horizon cuts, in the frame of its cone's axes. */
static f64 matt_cut_ellipse(const Ellipse *e, const f64 *N) {
    f64 x[3], y[3], X[3], Y[3];
    beside(e->axis, x, y);
    f64 A = quadratic(e->C, x, x), B = quadratic(e->C, y, y), H = quadratic(e->C, x, y);
    f64 turn = 0.5 * atan2(2.0 * H, A - B), c = cos(turn), s = sin(turn);
    f64 mean = 0.5 * (A + B), half = hypot(0.5 * (A - B), H);
    f64 small = mean - half, large = mean + half;  /* eigenvalues; the small one's direction is the longer axis */
    if (small < 1e-12 * large) small = 1e-12 * large;
    for (int j = 0; j < 3; j++) Y[j] = c * x[j] + s * y[j], X[j] = -s * x[j] + c * y[j];
    f64 a = sqrt(e->least / small), b = sqrt(e->least / large);
    f64 nx = dot3(N, X), ny = dot3(N, Y), nz = dot3(N, e->axis), across = hypot(nx * a, ny * b);
    if (across <= fabs(nz)) return nz > 0.0 ? PI * a * b * nz / sqrt((1.0 + a * a) * (1.0 + b * b)) : 0.0;
    f64 middle = atan2(ny * b, nx * a), reach = safe_acos(-nz / across), from[3], to[3], ends[2][3];
    arcs(a, b, middle - reach, from), arcs(a, b, middle + reach, to);
    f64 sum = -b * nx * (to[0] - from[0]) - a * ny * (to[1] - from[1]) + a * b * nz * (to[2] - from[2]);
    for (int i = 0; i < 2; i++) {
        f64 t = middle + (i ? -reach : reach);
        ends[i][0] = a * cos(t), ends[i][1] = b * sin(t), ends[i][2] = 1.0;
    }
    f64 chord[3];
    cross3(ends[0], ends[1], chord);
    sum += atan2(sqrt(dot3(chord, chord)), dot3(ends[0], ends[1]));
    return sum > 0.0 ? 0.5 * sum : 0.0;
}

/* Of an ellipse around `centre`, as the receiver sees it. */
static f64 matt_ellipse(const Sized *s, const f64 *centre, const f64 *N) {
    f64 up = dot3(N, centre), most = hypot(dot3(N, s->u), dot3(N, s->v));
    if (up + most <= 0.0) return 0.0;
    Ellipse e = ellipse_of(centre, s->u, s->v);
    if (up < most) return matt_cut_ellipse(&e, N);
    f64 all = PI * e.least / sqrt(e.product) * dot3(N, e.axis);
    return all > 0.0 ? all : 0.0;
}
