/* Data from which the tracer's frame is computed (frame.py). */
#include "native.h"

static const f64 FAR = 0x1p38;  /* the farthest that triangles may be in the frame */
enum { CORNERS = 9 };

/* Clips a polygon of `count` corners at a plane, and writes the part on one side to `out`. Returns its number of
   corners. */
static int clip(f64 polygon[][3], int count, const f64 *side, f64 out[][3]) {
    int n = 0;
    for (int k = 0; k < count; k++) {
        const f64 *p = polygon[k], *q = polygon[(k + 1) % count];
        f64 a = side[0] * p[0] + side[1] * p[1] + side[2] * p[2] + side[3];
        f64 b = side[0] * q[0] + side[1] * q[1] + side[2] * q[2] + side[3];
        if (a >= 0.0) memcpy(out[n++], p, 3 * sizeof *p);
        if ((a >= 0.0) == (b >= 0.0)) continue;
        for (int j = 0; j < 3; j++) out[n][j] = p[j] + a / (a - b) * (q[j] - p[j]);
        n++;
    }
    return n;
}

/* Computes the depth at which the view begins: the smallest depth of the visible part of any triangle. Infinity if
   no triangle is in view. */
KERNEL(frame_first,
       "world f64[v,3]  triangles i32[t,3]  seen bool[t]  matrix f64[4,4]  window f64[4]  perspective i64  near f64  "
       "first f64[1]!"
       ";  0<=triangles<v")
i64 frame_first(i64 v, i64 t, const f64 *world, const i32 *triangles, const u8 *seen, const f64 *matrix,
                const f64 *window, i64 perspective, f64 near, f64 *first) {
    /* the products of these with (x, y, depth, 1) are at least 0 inside the view */
    /* The planes of the view */
    f64 side[5][4] = {{0}}, best = INFINITY;
    (void)v;
    for (int k = 0; k < 4; k++) {
        f64 sign = k % 2 ? -1.0 : 1.0;
        side[k][k / 2] = sign, side[k][perspective ? 2 : 3] = -sign * window[k];
    }
    side[4][2] = 1.0, side[4][3] = -near;
    for (i64 own = 0; own < t; own++) {
        /* The triangle in the camera's space */
        f64 a[CORNERS][3], b[CORNERS][3], nearest = INFINITY;
        int finite = 1, count = 3;
        if (!seen[own]) continue;
        for (int k = 0; k < 3; k++) {
            f64 x = 0.0, y = 0.0, z = 0.0;
            for (int r = 0; r < 3; r++) {
                f64 away = world[3 * (i64)triangles[3 * own + k] + r] - matrix[4 * r + 3];
                x = x + matrix[4 * r] * away, y = y + matrix[4 * r + 1] * away, z = z - matrix[4 * r + 2] * away;
            }
            a[k][0] = x, a[k][1] = y, a[k][2] = z;
            nearest = z < nearest ? z : nearest;
            finite &= z == z;
        }
        /* Its part within the view */
        if (!finite || !(nearest < best)) continue;
        for (int k = 0; k < 5 && count; k++) {
            count = clip(k % 2 ? b : a, count, side[k], k % 2 ? a : b);
        }
        for (int k = 0; k < count; k++) best = b[k][2] < best ? b[k][2] : best;
    }
    *first = best;
    return 0;
}

/* Returns whether an edge is longer than 1 and longer than its distance from the centre. The result is the same for
   (b, a). */
static int long_edge(const f64 *a, const f64 *b) {
    int swap = a[0] > b[0] || (a[0] == b[0] && (a[1] > b[1] || (a[1] == b[1] && a[2] > b[2])));
    const f64 *begin = swap ? b : a, *end = swap ? a : b;
    f64 along = 0.0, length = 0.0, distance = 0.0;
    for (int j = 0; j < 3; j++) {
        along -= begin[j] * (end[j] - begin[j]);
        length += square(end[j] - begin[j]);
    }
    if (!(length > 1.0)) return 0;
    along = along / length;
    along = along < 0.0 ? 0.0 : along > 1.0 ? 1.0 : along;
    for (int j = 0; j < 3; j++) distance += square(begin[j] + along * (end[j] - begin[j]));
    return length > distance;
}

/* Marks triangles that have an edge that must be halved. */
KERNEL(frame_too_large, "local f64[v,3]  triangles i32[t,3]  out bool[t]!"
       ";  0<=triangles<v")
i64 frame_too_large(i64 v, i64 t, const f64 *local, const i32 *triangles, u8 *out) {
    (void)v;
    for (i64 k = 0; k < t; k++) {
        const f64 *a = local + 3 * (i64)triangles[3 * k], *b = local + 3 * (i64)triangles[3 * k + 1];
        const f64 *c = local + 3 * (i64)triangles[3 * k + 2];
        f64 farthest = 0.0;
        for (int j = 0; j < 3; j++) farthest = fmax(farthest, fmax(fabs(a[j]), fmax(fabs(b[j]), fabs(c[j]))));
        out[k] = farthest > 1.0 && (farthest > FAR || long_edge(a, b) || long_edge(b, c) || long_edge(c, a));
    }
    return 0;
}

/* Marks the edges to halve, from corner k to k + 1. A corner of a triangle has five numbers; the first three are its
   place. */
KERNEL(frame_long_edges, "todo f64[n,3,5]  out bool[n,3]!")
i64 frame_long_edges(i64 n, const f64 *todo, u8 *out) {
    for (i64 t = 0; t < n; t++)
        for (int k = 0; k < 3; k++) out[3 * t + k] = (u8)long_edge(todo + 15 * t + 5 * k, todo + 15 * t + 5 * ((k + 1) % 3));
    return 0;
}
