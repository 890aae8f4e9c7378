/* Lamps with a size, as rays see them (seen.py). */
#include <stdlib.h>

#include "native.h"

enum { BALL, TURNED_DISC, RECTANGLE, ELLIPSE, SKY_DISC };
enum { NO_BOUND, IN_SPREAD, IN_CONE };  /* what bounds the directions in which a lamp shines */

static inline f64 dot(const f64 *a, const f64 *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The distance along a ray, from o along the unit vector d, at which it enters a ball, or meets the disc of the same
   centre and radius that is turned to o; INFINITY: it does not. A ball is not seen from inside. */
static f64 round_at(const f64 *o, const f64 *d, const f64 *centre, f64 radius, int turned) {
    f64 to[3] = {centre[0] - o[0], centre[1] - o[1], centre[2] - o[2]}, along = dot(to, d), square = dot(to, to);
    if (along <= 0.0) return INFINITY;
    f64 aside = square - along * along;
    if (turned) {  /* the disc is square to the way to its centre */
        f64 t = square / along, off = t * t - square;
        return off <= radius * radius ? t : INFINITY;
    }
    if (aside > radius * radius || square <= radius * radius) return INFINITY;
    return along - sqrt(radius * radius - aside);
}

/* The same for the front of a face, by the half-axes u and v; their reciprocal vectors are p and q. */
static f64 face_at(const f64 *o, const f64 *d, const f64 *centre, const f64 *normal, const f64 *p, const f64 *q,
                   int ellipse) {
    f64 to[3] = {centre[0] - o[0], centre[1] - o[1], centre[2] - o[2]}, facing = dot(normal, d);
    if (facing >= 0.0) return INFINITY;
    f64 t = dot(to, normal) / facing;
    if (!(t > 0.0)) return INFINITY;
    f64 on[3] = {t * d[0] - to[0], t * d[1] - to[1], t * d[2] - to[2]}, a = dot(on, p), b = dot(on, q);
    return (ellipse ? a * a + b * b <= 1.0 : fabs(a) <= 1.0 && fabs(b) <= 1.0) ? t : INFINITY;
}

/* How much of its radiance a lamp sends to where the ray comes from, at this cosine from its axis. */
static f64 bounded(int bound, f64 axis, f64 edge, f64 slope) {
    if (bound == NO_BOUND || (bound == IN_SPREAD && slope <= 0.0)) return 1.0;
    if (axis <= 0.0 && bound == IN_SPREAD) return 0.0;
    f64 sine2 = 1.0 - axis * axis;
    f64 t = bound == IN_SPREAD ? (edge - sqrt(sine2 > 0.0 ? sine2 : 0.0) / axis) * slope : (axis - edge) * slope;
    if (t <= 0.0) return 0.0;
    if (bound == IN_SPREAD) return t;
    t = t < 1.0 ? t : 1.0;
    return t * t * (3.0 - 2.0 * t);
}

enum { TOGETHER = 16 }; /* lamps of a block */

/* Sets the bits of the lamps of all blocks whose balls (middle, radius) a ray meets. */
static void near_ray(const f64 *o, const f64 *d, i64 B, const i32 *block, const f64 *ball, i64 W, u64 *bits) {
    memset(bits, 0, (size_t)W * sizeof *bits);
    for (i64 q = 0; q < B; q++) {
        const f64 *c = ball + 4 * q, to[3] = {c[0] - o[0], c[1] - o[1], c[2] - o[2]}, along = dot(to, d);
        f64 aside = dot(to, to) - along * along, radius = c[3];
        if (along < -radius || aside > radius * radius) continue;
        for (int i = 0; i < TOGETHER; i++)
            if (block[TOGETHER * q + i] >= 0) set_bit(bits, block[TOGETHER * q + i]);
    }
}

/* Fills light with the radiance of all lamps that lie on each ray before `reach`. Lamps hide nothing, also not each
   other. by: the kind of each ray, a bit of `rays` of the lamps that it sees. block: lamps that are close together, −1
   where there are fewer; ball: their middle, and a radius that has all. Returns 1 without memory. */
KERNEL(seen_lamps, "origin f64[n,3]  direction f64[n,3]  reach f64[n]  by u8[n]  shape i8[L]  bound i8[L]  rays u8[L]  "
       "centre f64[L,3]  axis f64[L,3]  across f64[L,2,3]  size f64[L]  limits f64[L,2]  radiance f64[L,3]  "
       "block i32[B,16]  ball f64[B,4]  light f64[n,3]!"
       ";  -1<=block<L")
i64 seen_lamps(i64 n, i64 L, i64 B, const f64 *origin, const f64 *direction, const f64 *reach, const u8 *by, const i8 *shape,
               const i8 *bound, const u8 *rays, const f64 *centre, const f64 *axis, const f64 *across, const f64 *size,
               const f64 *limits, const f64 *radiance, const i32 *block, const f64 *ball,
               f64 *light) {
    i64 W = (L + 63) / 64;
    u64 *bits = malloc((size_t)(W + 1) * sizeof *bits);
    if (!bits) return 1;
    for (i64 k = 0; k < n; k++) {
        const f64 *o = origin + 3 * k, *d = direction + 3 * k;
        f64 *out = light + 3 * k;
        out[0] = out[1] = out[2] = 0.0;
        near_ray(o, d, B, block, ball, W, bits);
        for (i64 w = 0; w < W; w++) for (u64 rest = bits[w]; rest; rest &= rest - 1) {
            i64 i = 64 * w + lowest(rest);
            if (!(rays[i] & by[k])) continue;
            const f64 *c = centre + 3 * i, *a = axis + 3 * i, *pq = across + 6 * i;
            f64 t = shape[i] == SKY_DISC ? (dot(a, d) < 0.0 && 1.0 - dot(a, d) * dot(a, d) <= size[i] ? 1e300 : INFINITY)
                  : shape[i] <= TURNED_DISC ? round_at(o, d, c, size[i], shape[i] == TURNED_DISC)
                  : face_at(o, d, c, a, pq, pq + 3, shape[i] == ELLIPSE);
            if (!(t < reach[k])) continue;
            f64 share = bounded(bound[i], -dot(a, d), limits[2 * i], limits[2 * i + 1]);
            for (int j = 0; j < 3; j++) out[j] += share * radiance[3 * i + j];
        }
    }
    free(bits);
    return 0;
}
