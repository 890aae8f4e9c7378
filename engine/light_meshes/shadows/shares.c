/* Shares of lamps at nodes, and their means at receivers (shares.py). */
#include <stdlib.h>

#include "shapes.h"
#include "targets.h"

enum { EMPTY = 49, STEPS = 8 };  /* a blocker's distance a as 8 bits: EMPTY + STEPS·log2(a/h); 0: there is none */

static u64 mixed_key(u64 x, u64 word) {
    x = (x ^ word) * 0xD6E8FEB86659FD93u;
    return x ^ x >> 32;
}

/* Receivers of one cell and one side of one triangle are a group, which has one set of candidates: those of `place`,
   the middle of the cell put onto the triangle's plane. group: of each receiver; first: its first receiver; lit: what
   lights its receivers ask for. Without triangles each receiver is a group. Returns how many there are. */
KERNEL(shares_groups,
       "h f64  rotation f64[3,3]  origin f64[3]  centre f64[3]  scale f64  vertices f32[v,3]  triangles i32[t,3]  "
       "P f64[n,3]  N f64[n,3]  triangle i32[n]?  soft u64[n,W]  table i32[e]!  cells i64[n,3]!  group i32[n]!  "
       "first i64[n]!  place f64[n,3]!  lit u64[n,W]!"
       ";  0<h<inf  0<=triangle<t;  t=0|power(e)  -1<=table<n  0<=triangles<v")
i64 shares_groups(i64 v, i64 t, i64 n, i64 W, i64 e, f64 h, const f64 *R, const f64 *origin, const f64 *centre,
                  f64 scale, const f32 *vertices, const i32 *triangles, const f64 *P, const f64 *N,
                  const i32 *triangle, const u64 *soft, i32 *table, i64 *cells, i32 *group, i64 *first, f64 *place,
                  u64 *lit) {
    i64 count = 0, last = -1;
    (void)v, (void)t;
    for (i64 p = 0; p < n; p++) {
        const f64 *at = P + 3 * p, *normal = N + 3 * p;
        f64 x[3], q[3];
        for (int j = 0; j < 3; j++) x[j] = (at[j] - origin[j]) / h;
        i64 cell[3], found = -1;
        int far = 0;
        for (int j = 0; j < 3; j++) {
            q[j] = floor(R[j] * x[0] + R[3 + j] * x[1] + R[6 + j] * x[2]);
            far |= !(fabs(q[j]) < 2e9);
            cell[j] = far ? 0 : (i64)q[j];
        }
        i64 slot = 0;
        if (triangle && !far) {
            if (last >= 0 && triangle[first[last]] == triangle[p] && !memcmp(cells + 3 * last, cell, sizeof cell) &&
                !memcmp(N + 3 * first[last], normal, 3 * sizeof *normal))
                found = last;  /* as neighbours often are */
            if (found < 0) {
                u64 key = mixed_key(mixed_key(mixed_key((u64)cell[0], (u64)cell[1]), (u64)cell[2]), (u64)triangle[p]);
                for (slot = (i64)(key & ((u64)e - 1)); table[slot] >= 0; slot = (slot + 1) & (e - 1)) {
                    i64 other = table[slot];
                    if (triangle[first[other]] == triangle[p] && !memcmp(cells + 3 * other, cell, sizeof cell) &&
                        !memcmp(N + 3 * first[other], normal, 3 * sizeof *normal)) {
                        found = other;
                        break;
                    }
                }
            }
        }
        if (found < 0) {
            found = count++;
            first[found] = p;
            memcpy(cells + 3 * found, cell, sizeof cell), memcpy(place + 3 * found, at, 3 * sizeof *at);
            memset(lit + W * found, 0, (size_t)W * sizeof *lit);
            if (triangle && !far) {
                const f32 *corner = vertices + 3 * (i64)triangles[3 * (i64)triangle[p]];
                f64 middle[3], above = 0.0;
                table[slot] = (i32)found;
                for (int j = 0; j < 3; j++) {
                    middle[j] = origin[j];
                    for (int r = 0; r < 3; r++) middle[j] += h * R[3 * j + r] * ((f64)cell[r] + 0.5);
                    above += normal[j] * (middle[j] - (centre[j] + scale * corner[j]));
                }
                for (int j = 0; j < 3; j++) place[3 * found + j] = middle[j] - above * normal[j];
            }
        }
        group[p] = (i32)found, last = triangle && !far ? found : -1;
        for (i64 w = 0; w < W; w++) lit[W * found + w] |= soft[W * p + w];
    }
    return count;
}

/* Lamps of `lit` that the plane of a group cuts, or that are so near to it that they may be cut: no node stands for
   what is seen of them. */
KERNEL(shares_grazing,
       "place f64[g,3]  N f64[n,3]  first i64[g]  position f64[L,3]  directional bool[L]  shape u8[L]  size f64[L]  "
       "u f64[L,3]  v f64[L,3]  lit u64[g,W]  out u64[g,W]!"
       ";  W=words(L)  0<=first<n")
i64 shares_grazing(i64 g, i64 n, i64 L, i64 W, const f64 *place, const f64 *N, const i64 *first, const f64 *position,
                   const u8 *directional, const u8 *shape, const f64 *size, const f64 *u, const f64 *v,
                   const u64 *lit, u64 *out) {
    (void)n;
    memset(out, 0, (size_t)(g * W) * sizeof *out);
    for (i64 p = 0; p < g; p++)
        for (i64 i = 0; i < L; i++) {
            if (!has(lit + W * p, i)) continue;
            const f64 *normal = N + 3 * first[p];
            f64 way[3], reach = size[i];
            for (int j = 0; j < 3; j++) way[j] = position[3 * i + j] - (directional[i] ? 0.0 : place[3 * p + j]);
            if (has_face(shape[i])) reach = fabs(dot(u + 3 * i, normal)) + fabs(dot(v + 3 * i, normal));
            if (dot(way, normal) <= reach) out[W * p + (i >> 6)] |= bit(i);
        }
    return 0;
}

/* Fills the lights of `mixed` whose points give receivers of a group very different shares of the light: as wide, seen
   from there, as `share` of the cosine at the receiver, or at the lamp's face if that is less. Of these a count of points
   is no share of the light. */
KERNEL(shares_uneven,
       "share f64  place f64[g,3]  N f64[n,3]  first i64[g]  position f64[L,3]  directional bool[L]  shape u8[L]  "
       "size f64[L]  u f64[L,3]  v f64[L,3]  mixed u64[g,W]  out u64[g,W]!"
       ";  W=words(L)  0<=first<n")
i64 shares_uneven(i64 g, i64 n, i64 L, i64 W, f64 share, const f64 *place, const f64 *N, const i64 *first,
                  const f64 *position, const u8 *directional, const u8 *shape, const f64 *size, const f64 *u, const f64 *v,
                  const u64 *mixed, u64 *out) {
    (void)n;
    memset(out, 0, (size_t)(g * W) * sizeof *out);
    for (i64 p = 0; p < g; p++)
        for (i64 i = 0; i < L; i++) {
            if (directional[i] || !has(mixed + W * p, i)) continue;
            f64 way[3], face[3], radius = size[i];
            for (int j = 0; j < 3; j++) way[j] = position[3 * i + j] - place[3 * p + j];
            f64 far = sqrt(dot(way, way)), cosine = dot(way, N + 3 * first[p]) / far;
            if (has_face(shape[i])) {
                cross(u + 3 * i, v + 3 * i, face);
                f64 other = fabs(dot(way, face)) / (far * sqrt(dot(face, face)) + 1e-300);
                radius = sqrt(dot(u + 3 * i, u + 3 * i) + dot(v + 3 * i, v + 3 * i));
                cosine = other < cosine ? other : cosine;
            }
            if (radius > share * cosine * far) out[W * p + (i >> 6)] |= bit(i);
        }
    return 0;
}

/* What a group's candidates say of the lights it asks for: `seen` by all with all their `points`, or `mixed`; of the
   others by none. points: as bits; seen_points (u,L): which of them each sees, and bits above these where surfaces that
   let light through are in the way: then the light is mixed and in `through`. */
KERNEL(shares_sorted,
       "start i64[g,s]  candidate i32[c]  points i64  seen_points u8[u,L]  lit u64[g,W]  seen u64[g,W]!  mixed u64[g,W]!  "
       "through u64[g,W]!"
       ";  1<=s  W=words(L);  0<=candidate<u  0<=start<=c  rising(start)")
i64 shares_sorted(i64 g, i64 s, i64 c, i64 u, i64 L, i64 W, const i64 *start, const i32 *candidate, i64 points,
                  const u8 *seen_points, const u64 *lit, u64 *seen, u64 *mixed, u64 *through) {
    u8 *every = malloc((size_t)(2 * L)), *some = every + L;
    (void)c, (void)u;
    if (!every) return 1;
    for (i64 p = 0; p < g; p++) {
        i64 begin = start[p * s], end = start[p * s + s - 1];
        memset(every, 255, (size_t)L), memset(some, 0, (size_t)L);
        for (i64 at = begin; at < end; at++) {
            const u8 *row = seen_points + (i64)candidate[at] * L;
            for (i64 i = 0; i < L; i++) every[i] &= row[i], some[i] |= row[i];
        }
        for (i64 w = 0; w < W; w++) seen[W * p + w] = mixed[W * p + w] = through[W * p + w] = 0;
        for (i64 i = 0; i < L; i++) {
            if (!has(lit + W * p, i)) continue;
            if (some[i] > points) through[W * p + (i >> 6)] |= bit(i);
            if (begin == end || some[i] > points || (some[i] && every[i] != points))
                mixed[W * p + (i >> 6)] |= bit(i);
            else if (some[i])
                seen[W * p + (i >> 6)] |= bit(i);
        }
    }
    free(every);
    return 0;
}

/* Nodes near a receiver, in arrays of their own for vectors: the ways to them, their squares, and how far nodes are above
   the receiver's plane; slid: see slide_all. */
typedef struct {
    f32 *x, *y, *z, *square, *above, *slid;
    i32 *node;
    i64 count;
} Near;

/* Lists the candidates that are nearer to P than `far`. */
static void nodes_near(const f64 *P, const f64 *N, const i64 *range, i64 s, const i32 *candidate, const f64 *position, f64 far,
                       Near *near) {
    i64 count = 0;
    for (i64 q = range[0]; q < range[s - 1]; q++) {
        const f64 *at = position + 3 * (i64)candidate[q];
        f64 d[3] = {at[0] - P[0], at[1] - P[1], at[2] - P[2]};
        f64 above = dot(d, N), square_of = dot(d, d);
        near->x[count] = (f32)d[0], near->y[count] = (f32)d[1], near->z[count] = (f32)d[2];
        near->square[count] = (f32)square_of, near->above[count] = (f32)above, near->node[count] = candidate[q];
        count += (above > 0.0) & (square_of < far * far);
    }
    near->count = count;
}

/* The square of how far nodes are from P once they are slid along the way to a light onto P's plane. turns: 1, of a light
   that all see in one direction 0. */
static void slide_all(const Near *near, const f64 *N, const f64 *way, f32 turns) {
    f32 x = (f32)way[0], y = (f32)way[1], z = (f32)way[2], toward = (f32)dot(way, N), whole = (f32)dot(way, way);
    for (i64 k = 0; k < near->count; k++) {
        f32 rise = toward - turns * near->above[k], share = near->above[k] / rise, more = 1.0f + turns * share;
        f32 along = near->x[k] * x + near->y[k] * y + near->z[k] * z;
        f32 slid = more * more * near->square[k] - 2.0f * share * more * along + share * share * whole;
        near->slid[k] = rise > 0.0f ? slid : 1e30f;
    }
}

/* 1 or 0 if all nodes that slid to less than the root of `least` from P see all points of a light, or none; −1 if they
   disagree, or are fewer than `enough`. */
static int agreed(const Near *near, f32 least, i64 enough, i64 points, const u8 *seen_points, i64 L) {
    u8 every = 255, some = 0;
    i64 count = 0;
    for (i64 k = 0; k < near->count; k++) {
        if (!(near->slid[k] < least)) continue;
        u8 sees = seen_points[near->node[k] * L];
        every &= sees, some |= sees, count++;
        if (some > points || (some && every != points)) return -1;
    }
    return count >= enough ? some != 0 : -1;
}

/* Adds to S[to[p]] what the nodes near receivers p say of the lights in `asked`, by how much that counts, `rest`; sets the
   lights in known. They do where all that are nearer to a receiver than `far`, and than `slid` once they are slid along the
   light's way onto its plane, see it, or none; and where these are `enough`. points, seen_points: see shares_sorted. */
KERNEL(shares_agreed,
       "P f64[n,3]  N f64[n,3]  group i32[n]  start i64[g,s]  candidate i32[c]  position f64[u,3]  points i64  "
       "seen_points u8[u,L]  light_position f64[L,3]  directional bool[L]  far f64  slid f64  enough i64  asked u64[n,W]  "
       "to i64[n]  rest f32[m,L]  S f32[m,L,C]!  known u64[n,W]!"
       ";  1<=s  W=words(L)  0<=group<g  0<=to<m;  0<=candidate<u  0<=start<=c  rising(start)")
i64 shares_agreed(i64 n, i64 g, i64 s, i64 c, i64 u, i64 L, i64 W, i64 m, i64 C, const f64 *P, const f64 *N,
                  const i32 *group, const i64 *start, const i32 *candidate, const f64 *position, i64 points,
                  const u8 *seen_points, const f64 *light_position, const u8 *directional, f64 far, f64 slid,
                  i64 enough, const u64 *asked, const i64 *to, const f32 *rest, f32 *S, u64 *known) {
    i64 most = 0;
    f32 least = (f32)(slid * slid);
    (void)c, (void)u, (void)m;
    for (i64 k = 0; k < g; k++) most = start[k * s + s - 1] - start[k * s] > most ? start[k * s + s - 1] - start[k * s] : most;
    most = (most + 16) / 16 * 16;
    f32 *room = malloc((size_t)(6 * most) * sizeof *room);
    Near near = {room, room + most, room + 2 * most, room + 3 * most, room + 4 * most, room + 5 * most, 0, 0};
    near.node = malloc((size_t)most * sizeof *near.node);
    if (!room || !near.node) {
        free(room), free(near.node);
        return 1;
    }
    memset(known, 0, (size_t)(n * W) * sizeof *known);
    for (i64 p = 0; p < n; p++) {
        near.count = -1;
        for (i64 w = 0; w < W; w++)
            for (u64 left = asked[W * p + w]; left; left &= left - 1) {
                i64 i = 64 * w + lowest(left), at = to[p] * L + i;
                f64 way[3];
                if (near.count < 0) nodes_near(P + 3 * p, N + 3 * p, start + s * (i64)group[p], s, candidate, position, far, &near);
                for (int j = 0; j < 3; j++) way[j] = light_position[3 * i + j] - (directional[i] ? 0.0 : P[3 * p + j]);
                slide_all(&near, N + 3 * p, way, directional[i] ? 0.0f : 1.0f);
                int state = agreed(&near, least, enough, points, seen_points + i, L);
                if (state >= 0) known[W * p + w] |= bit(i);
                for (i64 channel = 0; state > 0 && channel < C; channel++) S[C * at + channel] += rest[at];
            }
    }
    free(room), free(near.node);
    return 0;
}

/* Adds to S[to[p]] of the lights in seen (n,W) all that counts, `rest`. */
KERNEL(shares_add, "seen u64[n,W]  to i64[n]  rest f32[m,L]  S f32[m,L,C]!"
       ";  W=words(L)  0<=to<m")
i64 shares_add(i64 n, i64 W, i64 m, i64 L, i64 C, const u64 *seen, const i64 *to, const f32 *rest, f32 *S) {
    (void)m;
    for (i64 p = 0; p < n; p++)
        for (i64 w = 0; w < W; w++)
            for (u64 left = seen[W * p + w]; left; left &= left - 1) {
                i64 at = to[p] * L + 64 * w + lowest(left);
                for (i64 channel = 0; channel < C; channel++) S[C * at + channel] += rest[at];
            }
    return 0;
}

/* How far each ray from origin[row] has come to the place (u, v) of a triangle (−1: none), as 8 bits; 0: none. */
KERNEL(shares_distances,
       "centre f64[3]  scale f64  vertices f32[v,3]  triangles i32[t,3]  h f64  origin f64[n,3]  triangle i32[n]  "
       "a f32[n]  b f32[n]  out u8[n]!"
       ";  0<h<inf  -1<=triangle<t;  0<=triangles<v")
i64 shares_distances(i64 v, i64 t, i64 n, const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangles,
                     f64 h, const f64 *origin, const i32 *triangle, const f32 *a, const f32 *b, u8 *out) {
    (void)v, (void)t;
    for (i64 k = 0; k < n; k++) {
        out[k] = 0;
        if (triangle[k] < 0) continue;
        Edges s = edges_of(vertices, triangles + 3 * (i64)triangle[k]);
        f64 square_of = 0.0;
        for (int j = 0; j < 3; j++)
            square_of += square(centre[j] + scale * (s.a[j] + a[k] * s.e[j] + b[k] * s.f[j]) - origin[3 * k + j]);
        f64 code = EMPTY + STEPS * 0.5 * log2(square_of / (h * h) + 1e-300);
        out[k] = (u8)(code < 1.0 ? 1.0 : code > 255.0 ? 255.0 : code);
    }
    return 0;
}

/* Two unit vectors across a unit normal. */
static void across(const f64 *n, f64 *e, f64 *f) {
    f64 sign = n[2] >= 0.0 ? 1.0 : -1.0, a = -1.0 / (sign + n[2]), b = n[0] * n[1] * a;
    e[0] = 1.0 + sign * n[0] * n[0] * a, e[1] = sign * b, e[2] = -sign * n[0];
    f[0] = b, f[1] = sign + n[1] * n[1] * a, f[2] = -n[1];
}

#define RIDGE 0.02  /* of the variance along the plane that is added, in r² */
#define CORE 2.0    /* steps: nodes that slide to less than these from a receiver speak alone where it sees nearly all or nothing, */
#define BENDS 0.12  /* from so much on, and half as much: a penumbra is no plane near its borders */

/* What the nodes next to a receiver say of it, `core`, the more, the nearer the plane's value is to none or all of the lamp. */
static f64 bent(f64 value, f64 core) {
    f64 rest = value < 1.0 - value ? value : 1.0 - value, x = (BENDS - rest) / (0.5 * BENDS);
    x = x < 0.0 ? 0.0 : x > 1.0 ? 1.0 : x;
    return value + x * x * (3.0 - 2.0 * x) * (core - value);
}

/* S of pairs of receiver P[row] and light: the mean of its group's candidates' shares, each slid along the light's way
   onto the receiver's plane and weighed by how far it lies there from P. shares (u,2L): of each light how many of
   `points` points the node sees, and the distance of what is nearest in the way. narrow (L,): `narrowest`. width: the
   narrowest penumbra that was met, over r; 0: too few candidates to say. */
KERNEL(shares_mean,
       "P f64[n,3]  N f64[n,3]  row i32[k]  light i32[k]  group i32[n]  start i64[g,s]  candidate i32[c]  "
       "position f64[u,3]  shares u8[u,l]  points i64  h f64  r f64  light_position f64[L,3]  "
       "directional bool[L]  narrow f64[L]  facing f64[L,3]  S f32[k]!  width f32[k]!"
       ";  1<=s  l=2*L  0<=row<n  0<=light<L  0<=group<g;  0<=candidate<u  0<=start<=c  rising(start)")
i64 shares_mean(i64 n, i64 k, i64 g, i64 s, i64 c, i64 u, i64 l, i64 L, const f64 *P, const f64 *N, const i32 *row,
                const i32 *light, const i32 *group, const i64 *start, const i32 *candidate, const f64 *position,
                const u8 *shares, i64 points, f64 h, f64 r, const f64 *light_position,
                const u8 *directional, const f64 *narrow, const f64 *facing, f32 *S, f32 *width) {
    f64 distance[256];
    (void)n, (void)g, (void)c, (void)u, (void)L;
    for (int code = 0; code < 256; code++) distance[code] = h * exp2((f64)(code - EMPTY) / STEPS);
    for (i64 at = 0; at < k; at++) {
        i64 p = row[at], i = light[at];
        const f64 *o = P + 3 * p, *normal = N + 3 * p, *lamp = light_position + 3 * i, *axis = facing + 3 * i;
        const i64 *range = start + s * (i64)group[p];
        f64 total = 0.0, seen = 0.0, inner = 0.0, core = 0.0, least = 1e30, e[3], f[3], m[2] = {0}, mm[3] = {0}, sm[2] = {0};
        across(normal, e, f);
        for (i64 q = range[0]; q < range[s - 1]; q++) {
            i64 node = candidate[q];
            const f64 *x = position + 3 * node;
            f64 d[3] = {x[0] - o[0], x[1] - o[1], x[2] - o[2]}, way[3];
            f64 above = dot(d, normal), near = dot(d, d) / (r * r);
            for (int j = 0; j < 3; j++) way[j] = lamp[j] - (directional[i] ? 0.0 : x[j]);
            f64 rise = dot(way, normal);
            if (near >= 1.0 || above <= 0.0 || rise <= 0.0) continue;
            f64 slide = above / rise, off = 0.0;
            for (int j = 0; j < 3; j++) d[j] = (d[j] - slide * way[j]) / r;
            off = dot(d, d);
            if (off >= 1.0) continue;
            f64 weight = (1.0 - off) * (1.0 - near), share = weight * shares[node * l + 2 * i];
            f64 a0 = dot(d, e), b0 = dot(d, f);
            total += weight, seen += share;
            f64 close = 1.0 - off * square(r / (CORE * h));
            if (close > 0.0) close *= close * (1.0 - near), inner += close, core += close * shares[node * l + 2 * i];
            m[0] += weight * a0, m[1] += weight * b0, sm[0] += share * a0, sm[1] += share * b0;
            mm[0] += weight * a0 * a0, mm[1] += weight * a0 * b0, mm[2] += weight * b0 * b0;
            u8 code = shares[node * l + 2 * i + 1];
            if (code) {
                f64 length = sqrt(dot(way, way)), a = distance[code] + slide * length, size = narrow[i];
                if (axis[0] != 0.0 || axis[1] != 0.0 || axis[2] != 0.0) size *= fabs(dot(axis, way)) / length;
                f64 rest = directional[i] ? 1.0 : length * (1.0 + slide) - a;
                f64 w = rest > 0.0 ? size * a / rest : 1e30;
                least = w < least ? w : least;
            }
        }
        S[at] = 0.0f;
        if (total > 0.0) {
            /* The plane through them that fits best, at P; pulled towards the mean where they tell little of it. */
            f64 ridge = RIDGE;
            m[0] /= total, m[1] /= total, seen /= total;
            f64 c0 = mm[0] / total - m[0] * m[0] + ridge, c1 = mm[1] / total - m[0] * m[1];
            f64 c2 = mm[2] / total - m[1] * m[1] + ridge, det = c0 * c2 - c1 * c1;
            f64 s0 = sm[0] / total - seen * m[0], s1 = sm[1] / total - seen * m[1];
            f64 value = (seen - ((c2 * s0 - c1 * s1) * m[0] + (c0 * s1 - c1 * s0) * m[1]) / det) / points;
            value = value < 0.0 ? 0.0 : value > 1.0 ? 1.0 : value;
            S[at] = (f32)(inner > 0.8 ? bent(value, core / inner / points) : value);
        }
        width[at] = (f32)(total < 0.8 ? 0.0 : least / r);
    }
    return 0;
}
