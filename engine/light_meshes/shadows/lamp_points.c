/* Points on lamps with a size (lamp_points.py). */
#include "lamp_points.h"

/* Points first..first+count of the lamp of each pair, as origin[row] has them: its pattern is turned (on the torus) by
   turn[row], and for each lamp in another way, by `own`. share (by origin), sharers, common: see `Patterns`. */
KERNEL(lamp_points,
       "first i64  count i64  origin f64[m,3]  turn f64[m,2]  share i64[m]?  sharers i64  common i64  row i32[k]  light i32[k]  "
       "position f64[L,3]  directional bool[L]  shape u8[L]  size f64[L]  u f64[L,3]  v f64[L,3]  own u64[L]  out f64[p,3]!"
       ";  p=k*count  0<=first  0<sharers  0<=row<m  0<=light<L")
i64 lamp_points(i64 m, i64 k, i64 L, i64 p, i64 first, i64 count, const f64 *origin, const f64 *turn, const i64 *share,
                i64 sharers, i64 common, const i32 *row, const i32 *light, const f64 *position, const u8 *directional,
                const u8 *shape, const f64 *size, const f64 *u, const f64 *v, const u64 *own, f64 *out) {
    Lamps lamps = {position, directional, shape, size, u, v, own};
    Patterns by = {turn, share, sharers, common};
    (void)m, (void)L, (void)p;
    for (i64 at = 0; at < k; at++) {
        Face face = face_of(&lamps, light[at], origin + 3 * (i64)row[at], &by, row[at]);
        for (i64 q = 0; q < count; q++) point_of(&face, first + q, out + 3 * (at * count + q));
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
        for (i64 q = at * count; q < (at + 1) * count; q++) {
            f64 weight = point_gives(point + 3 * q, directional[i], shape[i], facing + 3 * i, P + 3 * (i64)row[at],
                                     N + 3 * (i64)row[at]);
            if (!(weight > 0.0)) continue;
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
