/* Points on lamps in the directions of a highlight's lobe (lobe_points.py). */
#include "shapes.h"
#include "targets.h"

static f64 part(f64 x) { return x - floor(x); }

/* Where the ray from P in the unit direction `way` passes lamp i: how far, or 0 where it does not. Of a sun 1. */
static f64 met(const f64 *P, const f64 *way, const f64 *c, int directional, int shape, f64 size, const f64 *u, const f64 *v) {
    f64 d[3], w[3], q[3];
    for (int j = 0; j < 3; j++) d[j] = c[j] - (directional ? 0.0 : P[j]);
    if (!has_face(shape)) {
        f64 ahead = dot(way, d), square_of = dot(d, d), rest = size * size - (square_of - ahead * ahead);
        if (shape == BALL) {  /* its front; from within what is ahead */
            f64 half = rest > 0.0 ? sqrt(rest) : 0.0;
            if (square_of <= size * size) return ahead + half;
            return ahead > 0.0 && rest >= 0.0 ? ahead - half : 0.0;
        }
        f64 far = ahead > 0.0 ? square_of / ahead : 0.0;
        return far * far - square_of <= size * size ? directional && ahead > 0.0 ? 1.0 : far : 0.0;
    }
    cross(u, v, w);
    f64 toward = dot(way, w), far = toward != 0.0 ? dot(d, w) / toward : 0.0;
    if (!(far > 0.0)) return 0.0;
    for (int j = 0; j < 3; j++) q[j] = far * way[j] - d[j];
    f64 uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), det = uu * vv - uv * uv, qu = dot(q, u), qv = dot(q, v);
    if (!(det > 0.0)) return 0.0;
    f64 a = (vv * qu - uv * qv) / det, b = (uu * qv - uv * qu) / det;
    return (shape == RECTANGLE ? fabs(a) <= 1.0 && fabs(b) <= 1.0 : a * a + b * b <= 1.0) ? far : 0.0;
}

/* For each pair of a receiver and a lamp `count` directions of the lobe of facets (GGX) around what is mirrored: the place
   on the lamp that each meets, and how much it counts; 0: it passes the lamp by. way (n,3): of the eye's ray; alpha (n,):
   the square of the roughness; turn (n,2): how the pattern of a receiver is turned. */
KERNEL(lobe_points,
       "count i64  P f64[n,3]  N f64[n,3]  way f64[n,3]  alpha f64[n]  turn f64[n,2]  row i32[k]  light i32[k]  "
       "position f64[L,3]  directional bool[L]  shape u8[L]  size f64[L]  u f64[L,3]  v f64[L,3]  out f64[p,3]!  "
       "weight f64[p]!"
       ";  p=k*count  0<=row<n  0<=light<L")
i64 lobe_points(i64 n, i64 k, i64 L, i64 p, i64 count, const f64 *P, const f64 *N, const f64 *way, const f64 *alpha,
                const f64 *turn, const i32 *row, const i32 *light, const f64 *position, const u8 *directional,
                const u8 *shape, const f64 *size, const f64 *u, const f64 *v, f64 *out, f64 *weight) {
    (void)n, (void)L, (void)p;
    for (i64 at = 0; at < k; at++) {
        i64 r = row[at], i = light[at];
        const f64 *normal = N + 3 * r, *eye = way + 3 * r, *from = P + 3 * r;
        f64 sign = normal[2] >= 0.0 ? 1.0 : -1.0, g = -1.0 / (sign + normal[2]), both = normal[0] * normal[1] * g;
        f64 e[3] = {1.0 + sign * normal[0] * normal[0] * g, sign * both, -sign * normal[0]};
        f64 f[3] = {both, sign + normal[1] * normal[1] * g, -normal[1]};
        for (i64 s = 0; s < count; s++) {
            f64 inverse = 0.0, digit = 0.5, h[3], to[3];
            for (i64 rest = s; rest; rest >>= 1, digit *= 0.5) inverse += digit * (f64)(rest & 1);
            f64 a = part(((f64)s + 0.5) / (f64)count + turn[2 * r]), b = 2 * PI * part(inverse + turn[2 * r + 1]);
            f64 tangent = alpha[r] * sqrt(a / (1.0 - a)), up = 1.0 / sqrt(1.0 + tangent * tangent);
            f64 x = up * tangent * cos(b), y = up * tangent * sin(b), seen = 0.0, rise = 0.0;
            weight[at * count + s] = 0.0;
            for (int j = 0; j < 3; j++) h[j] = x * e[j] + y * f[j] + up * normal[j], seen -= h[j] * eye[j];
            if (seen <= 0.0) continue;
            for (int j = 0; j < 3; j++) to[j] = 2.0 * seen * h[j] + eye[j], rise += to[j] * normal[j];
            f64 far = rise > 0.0 ? met(from, to, position + 3 * i, directional[i], shape[i], size[i], u + 3 * i, v + 3 * i) : 0.0;
            if (!(far > 0.0)) continue;
            weight[at * count + s] = seen / up;
            for (int j = 0; j < 3; j++) out[3 * (at * count + s) + j] = directional[i] ? to[j] : from[j] + far * to[j];
        }
    }
    return 0;
}
