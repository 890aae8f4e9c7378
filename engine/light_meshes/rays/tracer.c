/* Builds rays for Embree in float64 and rounds them last; decides which of its hits are crossings (tracer.py). */
#include "tracer.h"
#include "around.h"

/* Moves points x in the frame away from their surface. */
KERNEL(tracer_leave, "x f64[n,3]!  normal f64[n,3]")
i64 tracer_leave(i64 n, f64 *x, const f64 *normal) {
    for (i64 k = 0; k < n; k++) {
        f64 *at = x + 3 * k, off = clearance(at[0], at[1], at[2]);
        for (int j = 0; j < 3; j++) at[j] += off * normal[3 * k + j];
    }
    return 0;
}

/* Builds rays without an end, or with an end at `length` (in the world): origins, directions and ends for Embree.
   reach: of the frame. */
KERNEL(tracer_rays,
       "centre f64[3]  scale f64  reach f64  origin f64[n,3]  direction f64[n,3]  normal f64[n,3]?  length f64[n]?  "
       "o f32[n,3]!  d f32[n,3]!  t f32[n]!")
i64 tracer_rays(i64 n, const f64 *centre, f64 scale, f64 reach, const f64 *origin, const f64 *direction,
                const f64 *normal, const f64 *length, f32 *o, f32 *d, f32 *t) {
    for (i64 k = 0; k < n; k++) {
        const f64 *from = origin + 3 * k, *way = direction + 3 * k;
        f64 x[3], start = 0.0;
        for (int j = 0; j < 3; j++) x[j] = (from[j] - centre[j]) / scale;
        if (normal) {
            f64 off = reach > 1.0 ? clearance(x[0], x[1], x[2]) : ULPS;
            for (int j = 0; j < 3; j++) x[j] += normal[3 * k + j] * off;
        }
        /* float32 is not precise at a far origin, so start where the ray comes near the scene. */
        if (x[0] * x[0] + x[1] * x[1] + x[2] * x[2] > 16.0 * reach * reach) {
            start = most(0.0, -(x[0] * way[0] + x[1] * way[1] + x[2] * way[2]) - 2.0 * reach);
            for (int j = 0; j < 3; j++) x[j] = x[j] + start * way[j];
        }
        for (int j = 0; j < 3; j++) o[3 * k + j] = (f32)x[j], d[3 * k + j] = (f32)way[j];
        f64 end = length ? most(length[k] / scale - start, 0.0) : 1e30;
        t[k] = (f32)(end < 1e30 ? end : 1e30);
    }
    return 0;
}

/* Fills the directions of rays `row` of those along `local`, d each, that are turned to normals M. turn: see turned_to. */
KERNEL(tracer_directions, "M f64[r,3]  turn f64[r,2]?  local f64[d,3]  row i64[n]  direction f64[n,3]!"
       ";  0<=row<r*d")
i64 tracer_directions(i64 r, i64 d, i64 n, const f64 *M, const f64 *turn, const f64 *local, const i64 *row,
                      f64 *direction) {
    Turned axes = {0};
    i64 last = -1;
    (void)r;
    for (i64 k = 0; k < n; k++) {
        i64 of = row[k] / d;
        if (of != last) axes = turned_to(M + 3 * of, turn ? turn + 2 * of : 0), last = of;
        along(&axes, local + 3 * (row[k] % d), direction + 3 * k);
    }
    return 0;
}

/* Builds rays from origin[origin_of] to position[target_of], or towards a directional target. closed: a surface that
   touches the target counts too. */
KERNEL(tracer_segments,
       "centre f64[3]  scale f64  reach f64  origin f64[m,3]  normal f64[m,3]?  origin_of i32[n]  position f64[q,3]  "
       "directional bool[q]  target_of i32[n]  closed i64  o f32[n,3]!  d f32[n,3]!  t f32[n]!"
       ";  0<=origin_of<m  0<=target_of<q")
i64 tracer_segments(i64 m, i64 n, i64 q, const f64 *centre, f64 scale, f64 reach, const f64 *origin, const f64 *normal,
                    const i32 *origin_of, const f64 *position, const u8 *directional, const i32 *target_of, i64 closed,
                    f32 *o, f32 *d, f32 *t) {
    (void)m, (void)q;
    for (i64 k = 0; k < n; k++) {
        i64 from = 3 * (i64)origin_of[k], to = target_of[k];
        f64 end[3];
        start_of(centre, scale, reach, origin + from, normal ? normal + from : 0, o + 3 * k);
        end_of(centre, scale, position + 3 * to, directional[to], end);
        t[k] = way_to(o + 3 * k, end, directional[to], reach, closed, d + 3 * k);
    }
    return 0;
}

/* Returns whether direction d runs along the normal of triangle k. */
static int facing(const f32 *vertices, const i32 *triangle, const f32 *d) {
    Edges s = edges_of(vertices, triangle);
    f64 normal[3];
    cross(s.e, s.f, normal);
    return normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2] > 0.0;
}

/* Decides which hits are new crossings and not the second triangle at an edge, and moves the rays behind their hits
   (t = 0: the segment ends). A ray that runs inside a surface hits it again and again, so after some such hits its
   steps grow. until: the share of the segment behind which the ray then is, plus a little, because the starts of
   rays are rounded. */
KERNEL(tracer_cross,
       "vertices f32[v,3]  triangles i32[t,3]  instance i32[t]  triangle i32[n]  start f64[n,3]  end f64[n,3]  o f32[n,3]!  "
       "d f32[n,3]!  length f32[n]!  passed f64[n]!  last i32[n]!  near i32[n]!  new bool[n]!  until f64[n]!"
       ";  0<=triangle<t  -1<=last<t;  0<=triangles<v")
i64 tracer_cross(i64 v, i64 t, i64 n, const f32 *vertices, const i32 *triangles, const i32 *instance,
                 const i32 *triangle, const f64 *start, const f64 *end, f32 *o, f32 *d, f32 *length, f64 *passed,
                 i32 *last, i32 *near, u8 *new, f64 *until) {
    (void)v, (void)t;
    for (i64 k = 0; k < n; k++) {
        i64 hit = triangle[k], before = last[k];
        const f64 *from = start + 3 * k, *to = end + 3 * k;
        f32 *here = o + 3 * k, *way = d + 3 * k;
        /* How far the hit is from the start of the segment */
        f64 distance = 0.0, whole = 0.0;
        for (int j = 0; j < 3; j++) {
            f64 x = (f64)here[j] + (f64)way[j] * length[k] - from[j];
            distance += x * x;
            whole += square(to[j] - from[j]);
        }
        distance = sqrt(distance), whole = sqrt(whole);
        /* Is it a new crossing? */
        f64 off = clearance(here[0], here[1], here[2]);
        int close = before >= 0 && distance - passed[k] < 16 * off;
        new[k] = 1;
        if (before >= 0 && instance[before] == instance[hit])
            new[k] = before != hit && !(close && facing(vertices, triangles + 3 * hit, way) ==
                                                     facing(vertices, triangles + 3 * before, way));
        /* Move the ray behind the hit */
        near[k] = close ? near[k] + 1 : 0;
        passed[k] = most(passed[k], distance);
        last[k] = (i32)hit;
        f64 step = ldexp(off, near[k] > 8 ? near[k] - 8 : 0), ahead = (passed[k] + step) / whole;
        until[k] = ahead + 0.25 * off / whole;
        if (!(ahead < 1.0)) {
            length[k] = 0;
            continue;
        }
        for (int j = 0; j < 3; j++) {
            here[j] = (f32)(from[j] + ahead * (to[j] - from[j]));
            way[j] = (f32)(to[j] - (f64)here[j]);
        }
        passed[k] += step;
        length[k] = 1;
    }
    return 0;
}
