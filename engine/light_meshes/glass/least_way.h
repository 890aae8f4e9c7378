/* The path through planes alone, by Fermat's principle: of all ways from the light over a point on each plane to x it takes
   the least time. That is convex in the points: there is one answer, and Newton's method finds it from anywhere, also where
   light grazes a plane and a ray says nothing about its neighbours. Where two planes meet the time has a crease, at which
   Newton's method would stop: lengths between planes are rounded off, √(length² + round²), at first much, at last not. */
#pragma once
#include "paths.h"

enum { PLANES = 8, ROUNDS = 30, ROUNDINGS = 4 };  /* most planes; steps of Newton's method for each rounding */
static const f64 ROUND[ROUNDINGS] = {1e-1, 1e-2, 1e-3, 0.0};  /* of the largest patch's radius */

/* The points on the planes, place and coordinates: y = A + q[0]·E1 + q[1]·E2. */
typedef struct {
    i64 k;
    const f64 *plane[PLANES];
    f64 index[PLANES + 1];  /* of the medium before each plane, and behind the last; the first is 1 */
    f64 q[2 * PLANES], round;
} Way;

/* Row j of `out`: the point on plane j. */
static inline void points_of(const Way *way, const f64 *q, f64 out[PLANES][3]) {
    for (i64 j = 0; j < way->k; j++)
        for (int c = 0; c < 3; c++) {
            const f64 *p = way->plane[j];
            out[j][c] = p[A + c] + q[2 * j] * p[E1 + c] + q[2 * j + 1] * p[E2 + c];
        }
}

/* From point j − 1 to point j: the unit vector, and the length, 1 for a sun's first; j = 0 is from the light, j = k to x. */
static inline f64 segment_of(const Path *s, const f64 *x, const Way *way, f64 y[PLANES][3], i64 j, f64 *unit) {
    i64 k = way->k;
    f64 square_of = j && j < k ? way->round * way->round : 0.0;
    const f64 *from = j ? y[j - 1] : s->light, *to = j < k ? y[j] : x;
    for (int c = 0; c < 3; c++) {
        unit[c] = j || !s->sun ? to[c] - from[c] : -s->light[c];
        square_of += unit[c] * unit[c];
    }
    f64 length = sqrt(square_of);
    for (int c = 0; c < 3; c++) unit[c] /= length;
    return length;
}

/* The time that light takes, but for a constant. */
static inline f64 time_of(const Path *s, const f64 *x, const Way *way, const f64 *q) {
    f64 y[PLANES][3], unit[3], sum = 0.0;
    points_of(way, q, y);
    for (i64 j = 0; j <= way->k; j++) {
        f64 length = segment_of(s, x, way, y, j, unit);
        if (!j && s->sun) length = dot(unit, y[0]);
        sum += way->index[j] * length;
    }
    return sum;
}

/* Its gradient by q, and its second derivatives, the lower triangle of H. */
static inline void derivatives_of(const Path *s, const f64 *x, const Way *way, f64 *gradient, f64 H[][2 * PLANES]) {
    f64 y[PLANES][3], unit[3];
    i64 k = way->k;
    points_of(way, way->q, y);
    memset(gradient, 0, sizeof *gradient * 2 * PLANES);
    memset(H, 0, sizeof *H * 2 * PLANES);
    for (i64 j = 0; j <= k; j++) {
        f64 length = segment_of(s, x, way, y, j, unit), bend = j || !s->sun ? way->index[j] / length : 0.0, along[4];
        const f64 *edge[4];  /* the derivatives of the segment's start, then of its end, by their coordinates */
        i64 first = j ? 0 : 2, last = j < k ? 4 : 2;
        for (i64 a = first; a < last; a++) {
            edge[a] = way->plane[a < 2 ? j - 1 : j] + (a & 1 ? E2 : E1);
            along[a] = dot(unit, edge[a]);
            f64 sign_a = a < 2 ? -1.0 : 1.0;
            gradient[2 * j - 2 + a] += sign_a * way->index[j] * along[a];
            for (i64 b = first; b <= a; b++) {
                f64 second = bend * (dot(edge[a], edge[b]) - along[a] * along[b]);
                H[2 * j - 2 + a][2 * j - 2 + b] += b < 2 ? -sign_a * second : sign_a * second;
            }
        }
    }
}

/* Solves H·step = −gradient by Cholesky's decomposition, in place; 0: H is singular. */
static inline int solve_step(i64 n, f64 H[][2 * PLANES], const f64 *gradient, f64 *step) {
    for (i64 a = 0; a < n; a++) {
        for (i64 b = 0; b <= a; b++) {
            f64 sum = H[a][b];
            for (i64 c = 0; c < b; c++) sum -= H[a][c] * H[b][c];
            if (a == b && !(sum > 0.0)) return 0;
            H[a][b] = a == b ? sqrt(sum) : sum / H[b][b];
        }
        step[a] = -gradient[a];
        for (i64 c = 0; c < a; c++) step[a] -= H[a][c] * step[c];
        step[a] /= H[a][a];
    }
    for (i64 a = n - 1; a >= 0; a--) {
        for (i64 c = a + 1; c < n; c++) step[a] -= H[c][a] * step[c];
        step[a] /= H[a][a];
    }
    return 1;
}

/* Newton's method for one rounding; 0: there is no answer. */
static inline int descend(const Path *s, const f64 *x, Way *way) {
    f64 H[2 * PLANES][2 * PLANES], gradient[2 * PLANES], step[2 * PLANES], trial[2 * PLANES];
    f64 now = time_of(s, x, way, way->q);
    i64 n = 2 * way->k;
    for (int count = 0; count < ROUNDS; count++) {
        derivatives_of(s, x, way, gradient, H);
        if (!solve_step(n, H, gradient, step)) return 0;
        f64 slope = 0.0, part = 1.0, then = now;
        for (i64 a = 0; a < n; a++) slope += gradient[a] * step[a];
        for (; part > 1e-6; part *= 0.5) {
            for (i64 a = 0; a < n; a++) trial[a] = way->q[a] + part * step[a];
            then = time_of(s, x, way, trial);
            if (then <= now + 1e-4 * part * slope) break;
        }
        if (!(then < now)) return 1;  /* nothing is left but rounding */
        memcpy(way->q, trial, sizeof trial);
        now = then;
        if (-slope < 1e-3 * way->round) return 1;  /* near enough for the next rounding */
    }
    return 1;
}

/* Where the path of a signature of planes to x meets the first plane; slot −1: nowhere, or far outside of the glass. */
static inline Place least_way(const Glass *g, const Path *s, const f64 *x, Signature want) {
    static const Place none = {-1, 0.0, 0.0};
    Way way = {.k = want.k, .index = {1.0}};
    f64 size = 0.0;
    for (i64 j = 0; j < want.k; j++) {
        i64 patch = want.code[j] >> 1;
        way.plane[j] = place_of(g, g->planar[patch]);
        way.index[j + 1] = want.eta[j] == REFLECTED ? way.index[j] : way.index[j] / want.eta[j];
        way.q[2 * j] = way.q[2 * j + 1] = 1.0 / 3.0;
        size = g->patch_size[patch] > size ? g->patch_size[patch] : size;
    }
    for (int i = 0; i < ROUNDINGS; i++) {
        f64 y[PLANES][3];
        way.round = size * ROUND[i];
        if (!descend(s, x, &way)) return none;
        points_of(&way, way.q, y);
        for (i64 j = 0; j < want.k; j++)  /* so far outside of its patch it does not come back */
            if (!(squared_distance(y[j], way.plane[j] + A) < square(3.0 * g->patch_size[want.code[j] >> 1]))) return none;
    }
    return (Place){g->planar[want.code[0] >> 1], way.q[0], way.q[1]};
}
