/* Points on lamps with a size (lamp_points.py). */
#include "targets.h"

enum { FREE, RECTANGLE, ELLIPSE };

/* 64 bits to 64 others, and those to a number in [0,1) (SplitMix64's finaliser). */
static u64 mixed(u64 x) {
    x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9u;
    x = (x ^ x >> 27) * 0x94D049BB133111EBu;
    return x ^ x >> 31;
}

static f64 random_of(u64 x) { return (f64)(mixed(x) >> 11) * 0x1p-53; }

/* Which stratum of 16 point j has. The first four have one of each four that follow each other, the first eight one of
   each two; so do they where the strata change places by ^. */
static i64 stratum(i64 j) {
    static const i64 further[4] = {0, 3, 1, 2};
    return further[j >> 2] ^ 5 * (j & 3);
}

static i64 reversed(i64 i) { return (i & 1) << 3 | (i & 2) << 1 | (i & 4) >> 1 | i >> 3; }

/* The cosine of k sixteenths of a turn; the sine is that of k + 12. */
#define R8 0.92387953251128674
#define R4 0.70710678118654752
#define R16 0.38268343236508977
static const f64 sixteenth[16] = {1.0,  R8,  R4,  R16,  0.0, -R16, -R4, -R8, -1.0, -R8, -R4, -R16, 0.0, R16, R4, R8};

static f64 part(f64 x) { return x - floor(x); }

/* Cosine and sine of x turns, to 1e-7, for x in [0,2): series for at most an eighth of a turn, by quarters. */
static void turned_by(f64 x, f64 *cosine, f64 *sine) {
    f64 quarter = floor(4.0 * x + 0.5), a = (x - 0.25 * quarter) * 2.0 * PI, s = a * a;
    f64 c0 = 1.0 - s * (0.5 - s * (1.0 / 24 - s * (1.0 / 720 - s / 40320)));
    f64 s0 = a * (1.0 - s * (1.0 / 6 - s * (1.0 / 120 - s * (1.0 / 5040 - s / 362880))));
    i64 which = (i64)quarter & 3;
    f64 c = which & 1 ? s0 : c0, other = which & 1 ? c0 : s0;
    *cosine = which == 1 || which == 2 ? -c : c, *sine = which >= 2 ? -other : other;
}

/* Which point of a pattern is the j-th of one of `sharers` that have the pattern in common: each round of points has one
   for each of them, and who has which of these changes from round to round, so that also the points of one spread. */
static i64 in_pattern(i64 j, i64 share, i64 sharers) {
    int even = (sharers & (sharers - 1)) == 0;
    return sharers * j + (even ? share ^ (j & (sharers - 1)) : (share + j) % sharers);
}

/* Points first..first+count of the lamp of each pair, as origin[row] has them: its pattern is turned (on the torus) by
   turn[row], and for each lamp in another way, by `own`. share (by origin), sharers: see `in_pattern`. shape: FREE a sphere
   or a sun, of which the origin sees a disc of radius `size`; else half-axes u, v. */
KERNEL(lamp_points,
       "first i64  count i64  origin f64[m,3]  turn f64[m,2]  share i64[m]?  sharers i64  row i32[k]  light i32[k]  position f64[L,3]  "
       "directional bool[L]  shape u8[L]  size f64[L]  u f64[L,3]  v f64[L,3]  own u64[L]  out f64[p,3]!"
       ";  p=k*count  0<=first  0<sharers  0<=row<m  0<=light<L")
i64 lamp_points(i64 m, i64 k, i64 L, i64 p, i64 first, i64 count, const f64 *origin, const f64 *turn, const i64 *share,
                i64 sharers, const i32 *row, const i32 *light, const f64 *position, const u8 *directional, const u8 *shape, const f64 *size,
                const f64 *u, const f64 *v, const u64 *own, f64 *out) {
    (void)m, (void)L, (void)p;
    for (i64 at = 0; at < k; at++) {
        i64 i = light[at];
        const f64 *from = origin + 3 * (i64)row[at], *mine = turn + 2 * (i64)row[at], *c = position + 3 * i;
        f64 e[3], f[3];
        if (shape[i] == FREE) {
            f64 d[3] = {c[0], c[1], c[2]};
            if (!directional[i]) {
                for (int j = 0; j < 3; j++) d[j] = c[j] - from[j];
                f64 length = sqrt(dot(d, d));
                for (int j = 0; j < 3; j++) d[j] /= length;
            }
            f64 sign = d[2] >= 0.0 ? 1.0 : -1.0, g = -1.0 / (sign + d[2]), both = d[0] * d[1] * g;
            e[0] = size[i] * (1.0 + sign * d[0] * d[0] * g), e[1] = size[i] * sign * both, e[2] = -size[i] * sign * d[0];
            f[0] = size[i] * both, f[1] = size[i] * (sign + d[1] * d[1] * g), f[2] = -size[i] * d[1];
        } else {
            memcpy(e, u + 3 * i, sizeof e), memcpy(f, v + 3 * i, sizeof f);
        }
        u64 key;
        memcpy(&key, mine + 1, sizeof key);
        key = mixed(key + own[i]);
        f64 shift = mine[0] + random_of(own[i]), turned = 0.0, cosine = 1.0, sine = 0.0;
        i64 set = -1;
        for (i64 q = 0; q < count; q++) {
            i64 n = share ? in_pattern(first + q, share[row[at]], sharers) : first + q;
            f64 *point = out + 3 * (at * count + q);
            i64 j = stratum(n & 15) ^ (i64)(mixed(key + (u64)(n >> 4)) & 15);
            if (n >> 4 != set) {  /* the next 16 */
                set = n >> 4, turned = shift + 0.5698402909980532 * (f64)set;
                if (shape[i] != RECTANGLE) turned_by(part(turned), &cosine, &sine);
            }
            f64 a = ((f64)j + random_of(key ^ (u64)(256 + n - (n & 15) + j))) / 16.0, x, y;
            i64 k = reversed(j);
            if (shape[i] == RECTANGLE) {
                x = 2.0 * a - 1.0, y = 2.0 * part((f64)k / 16.0 + turned) - 1.0;
            } else {
                f64 c = sixteenth[k], s = sixteenth[(k + 12) & 15], far = sqrt(a);
                x = far * (c * cosine - s * sine), y = far * (s * cosine + c * sine);
            }
            for (int j = 0; j < 3; j++) point[j] = c[j] + x * e[j] + y * f[j];
        }
    }
    return 0;
}

/* Adds up, at `to`, what `count` points of the lamp of each pair give a matt surface at P[row], and what of it gets
   through to there: `visible` of each point. Up to a constant of the pair; facing: the normals of lamps that have a face. */
KERNEL(lamp_sums,
       "count i64  P f64[n,3]  N f64[n,3]  row i32[k]  light i32[k]  directional bool[L]  shape u8[L]  facing f64[L,3]  "
       "point f64[p,3]  visible f32[p,C]  to i32[k]  clear f64[t,C]!  whole f64[t]!"
       ";  p=k*count  0<=row<n  0<=light<L  0<=to<t")
i64 lamp_sums(i64 n, i64 k, i64 L, i64 p, i64 C, i64 t, i64 count, const f64 *P, const f64 *N, const i32 *row,
              const i32 *light, const u8 *directional, const u8 *shape, const f64 *facing, const f64 *point,
              const f32 *visible, const i32 *to, f64 *clear, f64 *whole) {
    (void)n, (void)L, (void)t, (void)p;
    for (i64 at = 0; at < k; at++) {
        i64 i = light[at];
        const f64 *from = P + 3 * (i64)row[at], *normal = N + 3 * (i64)row[at];
        for (i64 q = at * count; q < (at + 1) * count; q++) {
            f64 way[3];
            for (int j = 0; j < 3; j++) way[j] = point[3 * q + j] - (directional[i] ? 0.0 : from[j]);
            f64 square = dot(way, way), length = sqrt(square), weight = dot(way, normal) / length;
            if (!(weight > 0.0)) continue;
            if (shape[i] != FREE) weight *= fabs(dot(way, facing + 3 * i)) / (square * length);
            for (i64 c = 0; c < C; c++) clear[C * to[at] + c] += weight * visible[C * q + c];
            whole[to[at]] += weight;
        }
    }
    return 0;
}

/* The turns of nodes: a Kronecker sequence, so that neighbours' points stand between each other. */
KERNEL(lamp_turns_of_nodes, "nodes i32[n,3]  out f64[n,2]!")
i64 lamp_turns_of_nodes(i64 n, const i32 *nodes, f64 *out) {
    static const f64 step[2][3] = {{0.8191725133961645, 0.6710436067037893, 0.5497004779019703},
                                   {0.2207440846057596, 0.3247179572447460, 0.8812714616335696}};
    for (i64 k = 0; k < n; k++)
        for (int j = 0; j < 2; j++)
            out[2 * k + j] = part(step[j][0] * nodes[3 * k] + part(step[j][1] * nodes[3 * k + 1]) +
                                  part(step[j][2] * nodes[3 * k + 2]));
    return 0;
}

/* The turns of receivers: at random, from their pixels, or their own positions; the same for any tiles, threads and order. */
KERNEL(lamp_turns_of_points, "P f64[n,3]  sample i64[n,2]?  out f64[n,2]!")
i64 lamp_turns_of_points(i64 n, const f64 *P, const i64 *sample, f64 *out) {
    for (i64 k = 0; k < n; k++) {
        u64 key = 0x9E3779B97F4A7C15u, bits;
        if (sample) key = mixed(key + (u64)sample[2 * k]);
        for (int j = 0; !sample && j < 3; j++) {
            memcpy(&bits, P + 3 * k + j, sizeof bits);
            key = (key ^ bits) * 0xD6E8FEB86659FD93u;
            key ^= key >> 32;
        }
        for (int j = 0; j < 2; j++) out[2 * k + j] = random_of(key + (u64)j * 0x9E3779B97F4A7C15u);
    }
    return 0;
}
