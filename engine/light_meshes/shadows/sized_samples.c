/* Points on lamps that light with their whole size, each with how much light comes from there (area_sampling.py). */
#include "../surface/sized.h"

/* A uniform number in [0,1) from 64 bits (SplitMix64's finaliser). */
static f64 random_of(u64 x) {
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    x ^= x >> 31;
    return (f64)(x >> 11) * 0x1p-53;
}

/* Point (a, b) of the unit square on the lamp as P sees it: the way from P, unit, its length, and what the lamp sends from
   there per unit of the square, up to a constant of the pair. A sun's length is 1. */
static f64 point_on(const Sized *s, const f64 *P, f64 a, f64 b, f64 *way, f64 *length) {
    f64 x[3], y[3], sent = 1.0;
    *length = 1.0;
    if (s->kind >= PLATE) {
        f64 across = s->kind == PLATE ? 2.0 * a - 1.0 : sqrt(a) * cos(2 * PI * b);
        f64 along = s->kind == PLATE ? 2.0 * b - 1.0 : sqrt(a) * sin(2 * PI * b);
        for (int j = 0; j < 3; j++) way[j] = s->c[j] - P[j] + across * s->u[j] + along * s->v[j];
        *length = sqrt(dot3(way, way));
        for (int j = 0; j < 3; j++) way[j] /= *length;
        f64 cosine = -dot3(way, s->axis);
        if (cosine <= 0.0) return 0.0;
        return cosine / square(*length) * (s->spread ? spread_share(s, way) : 1.0);
    }
    Cone cone = cone_of(s, P);
    beside(cone.d, x, y);
    /* Uniform in the solid angle: 1 - cosine is 2·sin² of half the angle. */
    f64 solid = cone.inside ? 2.0 : square(cone.sine) / (1.0 + cone.cosine), C = 1.0 - a * solid;
    f64 S = safe_root(a * solid * (2.0 - a * solid));
    for (int j = 0; j < 3; j++) way[j] = C * cone.d[j] + S * (cos(2 * PI * b) * x[j] + sin(2 * PI * b) * y[j]);
    if (s->kind == BALL_SPOT || s->kind == FACING_SPOT) sent = spot_share(s, way);
    if (s->kind == SKY) return sent;
    f64 far = sqrt(squared_distance(s->c, P));
    if (s->kind == FACING || s->kind == FACING_SPOT) {
        *length = far / C;
    } else {
        f64 root = safe_root(square(s->radius) - square(far) * (1.0 - C * C));
        *length = far * C + (cone.inside ? root : -root);
    }
    return sent;
}

/* Point s of `samples` on each pair's lamp, in the pattern of area_sample, and how much a surface of normal N gets from
   there; lights that are not sized must not be asked for. */
KERNEL(sized_sample,
       "s i64  samples i64  seed u64  P f64[n,3]  N f64[n,3]  row i32[k]  type i8[L]  position f64[L,3]  "
       "direction f64[L,3]  edge f64[L]  slope f64[L]  axes f64[L,3,3]  extent f64[L,8]  light i32[k]  out f64[k,3]!  "
       "weight f64[k]!"
       ";  0<=s  0<samples  0<=row<n  0<=light<L")
i64 sized_sample(i64 n, i64 k, i64 L, i64 s, i64 samples, u64 seed, const f64 *P, const f64 *N, const i32 *row,
                 const i8 *type, const f64 *position, const f64 *direction, const f64 *edge, const f64 *slope,
                 const f64 *axes, const f64 *extent, const i32 *light, f64 *out, f64 *weight) {
    f64 inverse = 0.0, digit = 0.5;
    (void)n, (void)L;
    for (i64 rest = s; rest; rest >>= 1, digit *= 0.5) inverse += digit * (f64)(rest & 1);
    for (i64 at = 0; at < k; at++) {
        i64 i = light[at];
        const f64 *from = P + 3 * (i64)row[at];
        const Sized lamp = sized_of(type[i], position + 3 * i, direction + 3 * i, edge[i], slope[i], axes + 9 * i,
                                    extent + 8 * i);
        f64 way[3], length;
        u64 key = seed + (u64)i * 0x9E3779B97F4A7C15u, bits;
        for (int j = 0; j < 3; j++) {
            memcpy(&bits, from + j, sizeof bits);
            key = (key ^ bits) * 0xD6E8FEB86659FD93u;
            key ^= key >> 32;
        }
        f64 a = ((f64)s + random_of(key + (u64)s * 2)) / (f64)samples;
        f64 b = fmod(inverse + random_of(key ^ 0xA0761D6478BD642Fu), 1.0);
        f64 sent = point_on(&lamp, from, a, b, way, &length), up = dot3(way, N + 3 * (i64)row[at]);
        weight[at] = up > 0.0 ? sent * up : 0.0;
        for (int j = 0; j < 3; j++) out[3 * at + j] = lamp.kind == SKY ? way[j] : from[j] + length * way[j];
    }
    return 0;
}
