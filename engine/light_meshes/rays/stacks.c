/* Surfaces that coincide with sheets (stacks.py). */
#include "boxes.h"
#include "triangles.h"

static const f64 NEAR = 64 * 0x1p-23, SAME = 1e-12, STEEP = 0.1;
static const f64 SIDE[3] = {0.5773, 0.3821, 0.7216};
enum { SHEET, OPAQUE, BENDS };

/* The triangles, and the partners of each: partner[first[t]..first[t+1]]. nature is SHEET, OPAQUE or BENDS. */
typedef struct {
    const f32 *vertices;
    const i32 *triangles, *instance;
    const u8 *mirrored;
    const i64 *first;
    const i32 *partner;
    const u8 *nature;
} Stacks;

/* The corners of a triangle relative to a point, and its normal, which is not normalised. */
typedef struct {
    f64 corner[3][3], normal[3];
} Seen;

static Seen seen_from(const f32 *vertices, const i32 *triangle, const f64 *origin) {
    Seen s;
    for (int k = 0; k < 3; k++)
        for (int j = 0; j < 3; j++) s.corner[k][j] = (f64)vertices[3 * (i64)triangle[k] + j] - origin[j];
    for (int j = 0; j < 3; j++) {
        int a = (j + 1) % 3, b = (j + 2) % 3;
        s.normal[j] = (s.corner[1][a] - s.corner[0][a]) * (s.corner[2][b] - s.corner[0][b]) -
                      (s.corner[1][b] - s.corner[0][b]) * (s.corner[2][a] - s.corner[0][a]);
    }
    return s;
}

/* Returns whether all corners of q are on one side of p's plane, farther away than `near`. */
static int apart(const Seen *p, const Seen *q, f64 length, f64 near) {
    f64 low = INFINITY, high = -INFINITY;
    for (int k = 0; k < 3; k++) {
        f64 x = 0.0;
        for (int j = 0; j < 3; j++) x += p->normal[j] / length * (q->corner[k][j] - p->corner[0][j]);
        low = x < low ? x : low, high = x > high ? x : high;
    }
    return low > near || high < -near;
}

/* Returns whether an edge of p separates p and q in the projection along an axis. Triangles that only touch are
   separated. */
static int beside(const Seen *p, const Seen *q, int axis) {
    int a = (axis + 1) % 3, b = (axis + 2) % 3;
    for (int k = 0; k < 3; k++) {
        const f64 *from = p->corner[k], *to = p->corner[(k + 1) % 3], *third = p->corner[(k + 2) % 3];
        f64 x = to[a] - from[a], y = to[b] - from[b], side = x * (third[b] - from[b]) - y * (third[a] - from[a]);
        int over = 0;
        for (int n = 0; n < 3; n++)
            over |= (x * (q->corner[n][b] - from[b]) - y * (q->corner[n][a] - from[a])) / side > 1e-6;
        if (!over) return 1;
    }
    return 0;
}

/* Returns whether triangles t and u are nearly parallel, overlap in the projection along a normal, and nearly touch. */
static int in_one_place(const f32 *vertices, const i32 *triangles, i64 t, i64 u) {
    f64 origin[3], far = 1.0, pp = 0.0, qq = 0.0, pq = 0.0;
    for (int j = 0; j < 3; j++) {
        origin[j] = vertices[3 * (i64)triangles[3 * t] + j];
        far = fabs(origin[j]) > far ? fabs(origin[j]) : far;
    }
    Seen p = seen_from(vertices, triangles + 3 * t, origin), q = seen_from(vertices, triangles + 3 * u, origin);
    for (int j = 0; j < 3; j++) {
        pp = pp + p.normal[j] * p.normal[j], qq = qq + q.normal[j] * q.normal[j];
        pq = pq + p.normal[j] * q.normal[j];
    }
    if (pq * pq < (1.0 - STEEP * STEEP) * pp * qq) return 0;
    if (apart(&p, &q, sqrt(pp), NEAR * far) || apart(&q, &p, sqrt(qq), NEAR * far)) return 0;
    int axis = 0;
    for (int j = 1; j < 3; j++)
        if (fabs(p.normal[j]) > fabs(p.normal[axis])) axis = j;
    return !(beside(&p, &q, axis) || beside(&q, &p, axis));
}

/* Finds every pair (triangle, sheet) that coincides. Writes as many to `found` as there is room for; returns how
   many there are. box, child: a tree over the sheets (boxes.py). */
KERNEL(stacks_pairs, "vertices f32[v,3]  triangles i32[t,3]  sheets i32[s]  box f64[b,6]  child i64[b,2]  found i32[f,2]!"
       ";  1<=b  tree(child,s)  0<=sheets<t  0<=triangles<v")
i64 stacks_pairs(i64 v, i64 t, i64 s, i64 b, i64 f, const f32 *vertices, const i32 *triangles, const i32 *sheets,
                 const f64 *box, const i64 *child, i32 *found) {
    i64 stack[STACK], count = 0;
    (void)v, (void)s, (void)b;
    for (i64 own = 0; own < t; own++) {
        /* The box of the triangle */
        f32 low[3], high[3];
        for (int j = 0; j < 3; j++) {
            low[j] = INFINITY, high[j] = -INFINITY;
            for (int k = 0; k < 3; k++) {
                f32 x = vertices[3 * (i64)triangles[3 * own + k] + j];
                low[j] = x < low[j] ? x : low[j], high[j] = x > high[j] ? x : high[j];
            }
        }
        /* Walk down the tree to the sheets whose boxes overlap it */
        i64 top = 1;
        stack[0] = 0;
        while (top) {
            i64 n = stack[--top], a = child[2 * n];
            const f64 *own_box = box + 6 * n;
            if (!(low[0] <= own_box[3] && high[0] >= own_box[0] && low[1] <= own_box[4] && high[1] >= own_box[1] &&
                  low[2] <= own_box[5] && high[2] >= own_box[2]))
                continue;
            if (!child[2 * n + 1]) {
                stack[top] = a, stack[top + 1] = a + 1;
                top += 2;
                continue;
            }
            for (i64 k = a; k < a + child[2 * n + 1]; k++) {
                if (sheets[k] == own || !in_one_place(vertices, triangles, own, sheets[k])) continue;
                if (count < f) found[2 * count] = (i32)own, found[2 * count + 1] = sheets[k];
                count++;
            }
        }
    }
    return count;
}

/* Computes d·(p × q): the sign says on which side of an edge a ray from the origin passes. The result for (q, p) is
   exactly the negative, and it is never 0. So a ray that meets an edge hits exactly one of its two triangles. */
static f64 edge(const f64 *p, const f64 *q, const f64 *d) {
    f64 x = d[0] * (p[1] * q[2] - p[2] * q[1]) + d[1] * (p[2] * q[0] - p[0] * q[2]) + d[2] * (p[0] * q[1] - p[1] * q[0]);
    if (x != 0.0) return x;
    for (int j = 0; j < 3; j++)
        if (p[j] != q[j]) return p[j] < q[j] ? 1e-300 : -1e-300;
    return 1e-300;
}

/* The intersection of a line with the plane of a triangle: the line's length, u, v; the possible rounding error of
   the length, from this and another triangle; whether it is inside the triangle; and the triangle's normal. */
typedef struct {
    f64 length, u, v, rounded, normal[3];
    int within;
} Meeting;

static Meeting meet(const Stacks *s, i64 t, const f64 *o, const f64 *d) {
    const i32 *triangle = s->triangles + 3 * t;
    Seen p = seen_from(s->vertices, triangle, o);
    f64 a = edge(p.corner[1], p.corner[2], d), b = edge(p.corner[2], p.corner[0], d), c = edge(p.corner[0], p.corner[1], d);
    f64 slope = dot(p.normal, d), rounded = 0.0;
    for (int j = 0; j < 3; j++) {
        f64 most = 0.0;
        for (int k = 0; k < 3; k++) {
            f64 x = fabs((f64)s->vertices[3 * (i64)triangle[k] + j]);
            most = x > most ? x : most;
        }
        rounded += fabs(p.normal[j]) * most;
    }
    Meeting m = {dot(p.normal, p.corner[0]) / slope, b / (a + b + c), c / (a + b + c), 3.0 * 0x1p-24 * rounded / fabs(slope),
                 {p.normal[0], p.normal[1], p.normal[2]}, slope != 0.0 && (a > 0.0) == (b > 0.0) && (b > 0.0) == (c > 0.0)};
    return m;
}

/* Returns d·N for the outward normal of a triangle, which is not normalised. */
static f64 outward(const Stacks *s, i64 t, const f64 *d) {
    const f64 origin[3] = {0};
    Seen p = seen_from(s->vertices, s->triangles + 3 * t, origin);
    f64 along = dot(p.normal, d);
    return s->mirrored[s->instance[t]] ? -along : along;
}

static f64 same_place(f64 t) { return SAME * (fabs(t) > 1.0 ? fabs(t) : 1.0); }

/* Returns whether a ray along d hits triangle i at ti before k at tk; m belongs to one of them. */
static int before(const Stacks *s, i64 i, f64 ti, i64 k, f64 tk, const Meeting *m, const f64 *d) {
    const u8 *nature = s->nature;
    /* sheets need a strict order, because rays go from one to the next */
    int sheets = nature[i] == SHEET && nature[k] == SHEET;
    if (fabs(ti - tk) > same_place(tk) + (sheets ? 0.0 : m->rounded)) return ti < tk;
    if (nature[i] == SHEET && nature[k] != SHEET) return nature[k] == OPAQUE || outward(s, k, d) < 0.0;
    if (nature[k] == SHEET && nature[i] != SHEET) return nature[i] == BENDS && outward(s, i, d) > 0.0;
    f64 along = dot(m->normal, d), side = dot(m->normal, SIDE);
    return (i < k) == (along * side < 0.0);
}

/* Returns whether a ray that hit or leaves triangle k at tk hits i at ti after it. */
static int behind(const Stacks *s, i64 i, f64 ti, i64 k, f64 tk, const Meeting *m, const f64 *d) {
    if (s->nature[k] == OPAQUE && fabs(ti - tk) <= same_place(tk) + m->rounded)
        return s->nature[i] == SHEET;  /* the ray comes back from k */
    return before(s, k, tk, i, ti, m, d);
}

#define STACKS                                                                                                      \
    "vertices f32[v,3]  triangles i32[t,3]  instance i32[t]  mirrored bool[I]  first i64[e]  partner i32[p]  "     \
    "nature u8[t]  seen bool[t]  "
#define OF_STACKS                                                                                                   \
    const f32 *vertices, const i32 *triangles, const i32 *instance, const u8 *mirrored, const i64 *first,          \
        const i32 *partner, const u8 *nature, const u8 *seen

/* Replaces Embree's hits (triangle, −1: none) by the first of the triangles that coincide there, or that coincide
   with the triangle that the ray left. start, direction: where the rays began, in the world; last: the triangle that
   they hit or left last, −1 if none. seen: the triangles that they may hit. */
KERNEL(stacks_first_of_all,
       "centre f64[3]  scale f64  " STACKS
       "start f64[n,3]  direction f64[n,3]  last i32[n]  triangle i32[n]!  u f32[n]!  v_of f32[n]!"
       ";  e=t+1  -1<=triangle<t  -1<=last<t;  0<=triangles<v  0<=instance<I  0<=first<=p  rising(first)  "
       "0<=partner<t")
i64 stacks_first_of_all(i64 v, i64 t, i64 I, i64 e, i64 p, i64 n, const f64 *centre, f64 scale, OF_STACKS,
                        const f64 *start, const f64 *direction, const i32 *last, i32 *triangle, f32 *u, f32 *v_of) {
    Stacks s = {vertices, triangles, instance, mirrored, first, partner, nature};
    (void)v, (void)t, (void)I, (void)e, (void)p;
    for (i64 k = 0; k < n; k++) {
        i64 found = triangle[k], passed = last[k], both[2] = {found, passed};
        if (!((found >= 0 && first[found + 1] > first[found]) || (passed >= 0 && first[passed + 1] > first[passed])))
            continue;
        const f64 *d = direction + 3 * k;
        /* Where the ray meets the triangle that Embree found and the one that it left */
        f64 o[3], at = INFINITY, left = 0.0;
        for (int j = 0; j < 3; j++) o[j] = (start[3 * k + j] - centre[j]) / scale;
        i64 best = found;
        if (best >= 0) at = meet(&s, best, o, d).length;
        if (passed >= 0) left = meet(&s, passed, o, d).length;
        /* The partners of both: the first one that comes next replaces Embree's hit */
        for (int which = 0; which < 2; which++) {
            if (both[which] < 0) continue;
            for (i64 c = first[both[which]]; c < first[both[which] + 1]; c++) {
                i64 other = partner[c];
                if (!seen[other] || other == best || other == passed) continue;
                Meeting m = meet(&s, other, o, d);
                if (!m.within) continue;
                int new = m.length > 0.0;
                if (passed >= 0) {
                    new = behind(&s, other, m.length, passed, left, &m, d);
                    /* the ray began on it */
                    if (nature[other] == OPAQUE && fabs(m.length) <= SAME + m.rounded) new = 0;
                }
                if (!new || (best >= 0 && !before(&s, other, m.length, best, at, &m, d))) continue;
                best = other, at = m.length;
                triangle[k] = (i32)other, u[k] = (f32)m.u, v_of[k] = (f32)m.v;
            }
        }
    }
    return 0;
}

/* Finds the partners of `triangle` (−1: none) that the segments start..end (in the frame) cross between the shares
   done and until. leaving: the segments begin on these triangles, and partners on the side to which they go count.
   Fills row, other, u, v_of as far as there is room; returns how many partners there are. */
KERNEL(stacks_also_crossed,
       STACKS "triangle i32[n]  start f64[n,3]  end f64[n,3]  leaving i64  done f64[n]  until f64[n]  row i32[r]!  "
              "other i32[r]!  u f32[r]!  v_of f32[r]!"
       ";  e=t+1  -1<=triangle<t;  0<=triangles<v  0<=instance<I  0<=first<=p  rising(first)  0<=partner<t")
i64 stacks_also_crossed(i64 v, i64 t, i64 I, i64 e, i64 p, i64 n, i64 r, OF_STACKS, const i32 *triangle,
                        const f64 *start, const f64 *end, i64 leaving, const f64 *done, const f64 *until, i32 *row,
                        i32 *other, f32 *u, f32 *v_of) {
    Stacks s = {vertices, triangles, instance, mirrored, first, partner, nature};
    i64 count = 0;
    (void)v, (void)t, (void)I, (void)e, (void)p;
    for (i64 k = 0; k < n; k++) {
        i64 own = triangle[k];
        if (own < 0 || first[own] == first[own + 1]) continue;
        f64 d[3];
        for (int j = 0; j < 3; j++) d[j] = end[3 * k + j] - start[3 * k + j];
        f64 at = meet(&s, own, start + 3 * k, d).length;
        for (i64 c = first[own]; c < first[own + 1]; c++) {
            i64 next = partner[c];
            if (!seen[next]) continue;
            Meeting m = meet(&s, next, start + 3 * k, d);
            if (!m.within || m.length > (until[k] < 1.0 ? until[k] : 1.0)) continue;
            if (!(leaving ? behind(&s, next, m.length, own, at, &m, d) : m.length > done[k])) continue;
            if (count < r) row[count] = (i32)k, other[count] = (i32)next, u[count] = (f32)m.u, v_of[count] = (f32)m.v;
            count++;
        }
    }
    return count;
}

/* Computes the shares of the segments start..end (in the frame) at which they cross the planes of triangles. */
KERNEL(stacks_place_of, "vertices f32[v,3]  triangles i32[t,3]  triangle i32[n]  start f64[n,3]  end f64[n,3]  out f64[n]!"
       ";  0<=triangle<t;  0<=triangles<v")
i64 stacks_place_of(i64 v, i64 t, i64 n, const f32 *vertices, const i32 *triangles, const i32 *triangle,
                    const f64 *start, const f64 *end, f64 *out) {
    Stacks s = {.vertices = vertices, .triangles = triangles};
    (void)v, (void)t;
    for (i64 k = 0; k < n; k++) {
        f64 d[3];
        for (int j = 0; j < 3; j++) d[j] = end[3 * k + j] - start[3 * k + j];
        out[k] = meet(&s, triangle[k], start + 3 * k, d).length;
    }
    return 0;
}
