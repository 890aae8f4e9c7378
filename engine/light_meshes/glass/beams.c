/* Beams of light through glass (beams.py). */
#include <stdlib.h>

#include "optics.h"

static const f64 CUTOFF = 1e-4;  /* beams with less light than this are not followed */
/* corners are sampled this far inside, so that it is certain which triangle the ray meets */
static const f64 SHRINK = 1e-3;
static const f64 COARSE = 1.0 / 8;  /* relative to a curved patch's radius: the longest edge of an element */
static const f64 WIDE = 1.0 / 4;  /* relative to the element's distance from the light: the longest edge on any patch */
/* relative to a beam's width: the largest distance between its own middle ray and the mean of the others */
static const f64 BENT = 0.1;
enum { COARSER = 3, FLAT_LEVELS = 2, PARTS = 4 * 40 };

/* A part of a triangle: u, v of its corners, how often it was split, and the first bend that is still to be done. */
typedef struct {
    f64 uv[3][2];
    i64 level, first;
} Element;

/* The light through one element: its four samples, of which the last is in the middle, and the beam that they make. */
typedef struct {
    /* bends, signatures, code of the surface that reflects all light at the end (−1: none) */
    i64 n[4], code[4][DEPTH], stop[4];
    f64 eta[4][DEPTH], end[4][DEPTH + 1], beyond[4], uv[4][2];
    Ray rays[4][DEPTH];
    f64 p[4][2], d[4][2], z[3];  /* as in Beams */
} Samples;

/* The data of a search for beams. finest: elements are split at least FLAT_LEVELS times. */
typedef struct {
    const Glass *g;
    Path *path;
    Samples *t;
    f64 h, fine;
    i64 deepest, limit, room, used, columns;
    int finest, cut;
    i32 *slot;
    f64 *uv, *p, *d, *z;
    i8 *group, *k;
    i32 *code;
    f64 *eta;
} Search;

static f64 most(f64 a, f64 b) { return b > a ? b : a; }
static f64 least(f64 a, f64 b) { return b < a ? b : a; }

/* Returns whether samples a and b have the same first k bends. */
static int same(const Samples *t, int a, int b, i64 k) {
    for (i64 j = 0; j < k; j++)
        if (t->code[a][j] != t->code[b][j] || t->eta[a][j] != t->eta[b][j]) return 0;
    return 1;
}

/* Returns 2·axis for the axis along which D mostly runs, + 1 if it runs against it. */
static int axis_of(const f64 *D) {
    int a = 0;
    for (int j = 1; j < 3; j++)
        if (fabs(D[j]) > fabs(D[a])) a = j;
    return 2 * a + (D[a] < 0.0);
}

/* Writes a ray as its place p and slope d in the plane z = z0. Returns 0 if it runs along the plane or backwards. */
static int flatten(const f64 *P, const f64 *D, int group, f64 z0, f64 *p, f64 *d) {
    int a = group >> 1, b = (a + 1) % 3, c = (a + 2) % 3;
    f64 sign = group & 1 ? -1.0 : 1.0, slope = sign * D[a];
    if (!(slope > 0.1)) return 0;
    f64 t = (z0 - sign * P[a]) / slope;
    p[0] = P[b] + t * D[b], p[1] = P[c] + t * D[c];
    d[0] = D[b] / slope, d[1] = D[c] / slope;
    return 1;
}

/* Returns the longest side of the triangle of three rays at height z above their plane. */
static f64 width_of(const Samples *t, f64 z) {
    f64 longest = 0.0;
    for (int i = 0; i < 3; i++) {
        int k = (i + 1) % 3;
        f64 x = t->p[i][0] - t->p[k][0] + z * (t->d[i][0] - t->d[k][0]);
        f64 y = t->p[i][1] - t->p[k][1] + z * (t->d[i][1] - t->d[k][1]);
        longest = most(longest, x * x + y * y);
    }
    return sqrt(longest);
}

/* Returns whether some body on the way is so small that all of the beam's few rays may miss it. */
static int split_for_bodies(const Glass *g, const f64 *P, const f64 *D, f64 end, f64 width, i64 own) {
    for (i64 b = 0; b < g->bodies; b++) {
        const f64 *ball = g->ball + 4 * b;
        f64 along = 0.0, square_of = 0.0;
        if (b == own || 2.0 * width < ball[3]) continue;
        for (int j = 0; j < 3; j++) along += (ball[j] - P[j]) * D[j];
        along = least(most(along, 0.0), end);
        for (int j = 0; j < 3; j++) square_of += square(ball[j] - P[j] - along * D[j]);
        if (square_of < square(ball[3] + width)) return 1;
    }
    return 0;
}

/* Returns the longest edge of an element; *distance: the distance of its middle from the light (infinite for a sun). */
static f64 extent_of(const f64 *p, const Element *e, const Path *s, f64 *distance) {
    f64 edge = 0.0, square_of = 0.0;
    for (int i = 0; i < 3; i++) {
        int k = (i + 1) % 3;
        f64 length = 0.0, du = e->uv[i][0] - e->uv[k][0], dv = e->uv[i][1] - e->uv[k][1];
        for (int j = 0; j < 3; j++) length += square(du * p[E1 + j] + dv * p[E2 + j]);
        edge = most(edge, length);
    }
    for (int j = 0; j < 3; j++) {
        f64 middle = p[A + j] - s->light[j];
        for (int i = 0; i < 3; i++) middle += (e->uv[i][0] * p[E1 + j] + e->uv[i][1] * p[E2 + j]) / 3.0;
        square_of += middle * middle;
    }
    *distance = s->sun ? INFINITY : sqrt(square_of);
    return sqrt(edge);
}

/* Returns whether the light reaches the slot from its own side: from outside of the body, or from inside. */
static int seen_first(const Glass *g, const Path *s, i64 slot) {
    const f64 *p = place_of(g, slot);
    i64 body = link_of(g, slot, BODY);
    int inside = 0;
    f64 slope = 0.0;
    if (body < 0) return 0;
    for (i64 i = 1; i <= s->around[0][0]; i++) inside |= s->around[i][0] == body;
    for (int j = 0; j < 3; j++) slope += p[NG + j] * (s->sun ? -s->light[j] : p[A + j] - s->light[j]);
    return (slope > 0.0) == inside && slope != 0.0;
}

/* Stores the bends of the path as sample i. */
static void keep(const Path *s, Samples *t, int i) {
    i64 n = t->n[i];
    for (i64 k = 0; k <= n; k++) t->end[i][k] = s->bend[k].length;
    for (i64 k = 0; k < n; k++) {
        t->code[i][k] = s->bend[k].code, t->eta[i][k] = s->bend[k].eta;
        memcpy(t->rays[i][k], s->bend[k].ray, sizeof(Ray));
    }
    t->stop[i] = s->bend[n].code, t->beyond[i] = s->bend[n].beyond;
}

/* Follows the light through the element's middle and, unless `alone`, through three points near its corners. Returns
   the largest number of bends; *cut: whether a ray that was bent `deepest` times would bend again. */
static i64 sample(Search *search, i64 slot, const Element *e, int alone, int *cut) {
    const Glass *g = search->g;
    const f64 *p = place_of(g, slot);
    Path *s = search->path;
    Samples *t = search->t;
    i64 bends = 0;
    f64 mu = (e->uv[0][0] + e->uv[1][0] + e->uv[2][0]) / 3.0, mv = (e->uv[0][1] + e->uv[1][1] + e->uv[2][1]) / 3.0;
    *cut = 0;
    for (int i = 0; i < 4; i++) {
        /* The sample's place on the element */
        f64 y[3];
        t->uv[i][0] = i == 3 ? mu : (1.0 - SHRINK) * e->uv[i][0] + SHRINK * mu;
        t->uv[i][1] = i == 3 ? mv : (1.0 - SHRINK) * e->uv[i][1] + SHRINK * mv;
        t->n[i] = 0;
        if (alone && i < 3) continue;
        /* The light's path through it */
        for (int j = 0; j < 3; j++) y[j] = p[A + j] + t->uv[i][0] * p[E1 + j] + t->uv[i][1] * p[E2 + j];
        t->n[i] = chain(g, s, y, search->deepest, CUTOFF);
        /* something stands in front of it */
        if (t->n[i] && s->bend[0].slot != slot) t->n[i] = 0, s->bend[0].code = -1;
        keep(s, t, i);
        bends = t->n[i] > bends ? t->n[i] : bends;
        if (t->n[i] == search->deepest) *cut = *cut || next_bend(g, s, INFINITY) == BENDS;
    }
    return bends;
}

/* Returns whether light may pass between samples although none of them passes: the surfaces that reflect them are
   different, or the reflection is hardly total. */
static int passes_between(const Samples *t, i64 bends) {
    f64 low = INFINITY, high = -INFINITY;
    int stopped = 0;
    for (int i = 0; i < 4; i++) {
        if (t->n[i] < bends) continue;
        if (t->stop[i] >= 0) low = least(low, t->beyond[i]), high = most(high, t->beyond[i]), stopped = 1;
        for (int j = 0; j < i; j++)
            if (t->n[j] == bends && t->stop[j] != t->stop[i]) return 1;
    }
    return stopped && low < high - low;
}

/* Returns whether the samples' rays behind bend k make one beam, and writes it to t's p, d, z. *split: whether the
   element must be split; *group: the beam's group. body: the body that the light has not left yet, −1: another. */
static int bundle(const Search *search, i64 k, int differ, i64 body, int *split, int *group) {
    Samples *t = search->t;
    const f64 *P = t->rays[3][k - 1][0], *D = t->rays[3][k - 1][1];
    f64 h = search->h, reach = search->path->far / FAR;
    *group = axis_of(D);
    *split = 0;
    int a = *group >> 1;
    f64 sign = *group & 1 ? -1.0 : 1.0, z0 = sign * P[a];
    /* The rays as places and slopes */
    for (int i = 0; i < 4; i++)
        if (!flatten(t->rays[i][k - 1][0], t->rays[i][k - 1][1], *group, z0, t->p[i], t->d[i])) {
            *split = differ;
            return 0;
        }
    f64(*p)[2] = t->p, (*d)[2] = t->d;
    /* At its beginning and its end: does the middle ray agree with the others, and may a body be missed? */
    f64 length = least(most(least(sign * P[a] + t->end[3][k] * sign * D[a], reach + 4.0 * h) - z0, 0.0), 4.0 * reach);
    for (int far = 0; far < 2; far++) {
        f64 at = far * length, width = width_of(t, at);
        f64 x = p[3][0] + at * d[3][0], w = p[3][1] + at * d[3][1];
        x -= (p[0][0] + p[1][0] + p[2][0] + at * (d[0][0] + d[1][0] + d[2][0])) / 3.0;
        w -= (p[0][1] + p[1][1] + p[2][1] + at * (d[0][1] + d[1][1] + d[2][1])) / 3.0;
        if (sqrt(x * x + w * w) > most(BENT * width, 0.25 * h)) *split |= differ;
        if (search->g->bodies > 1 && !*split && differ)
            *split = split_for_bodies(search->g, P, D, t->end[3][k], width, body);
    }
    /* The range of z that the beam covers */
    f64 low = INFINITY, high = -INFINITY, extent = width_of(t, 0.0);
    for (int i = 0; i < 4; i++) {
        f64 at = sign * t->rays[i][k - 1][0][a];
        low = least(low, at);
        high = most(high, at + t->end[i][k] * sign * t->rays[i][k - 1][1][a]);
    }
    t->z[0] = z0, t->z[1] = low - 0.5 * extent, t->z[2] = high + 0.5 * extent;
    return 1;
}

/* Makes a beam over the element from sample i alone: the rays of the corners follow from its derivatives. Returns
   the beam's group, −1: none. */
static int beam_of_ray(const Search *search, i64 slot, int i, i64 k) {
    Samples *t = search->t;
    const f64 *own = place_of(search->g, slot), *P = t->rays[i][k - 1][0], *D = t->rays[i][k - 1][1];
    f64 m00 = 0.0, m01 = 0.0, m10 = 0.0, m11 = 0.0;
    for (int j = 0; j < 3; j++) {
        m00 += t->rays[i][0][2][j] * own[U + j];
        m01 += t->rays[i][0][3][j] * own[U + j];
        m10 += t->rays[i][0][2][j] * own[V + j];
        m11 += t->rays[i][0][3][j] * own[V + j];
    }
    f64 det = m00 * m11 - m01 * m10;
    if (det == 0.0) return -1;

    /* The plane of its places */
    int group = axis_of(D), axis = group >> 1;
    f64 sign = group & 1 ? -1.0 : 1.0;
    t->z[0] = sign * P[axis];
    f64 last = t->z[0] + t->end[i][k] * sign * D[axis];
    /* The rays through the corners */
    for (int c = 0; c < 3; c++) {
        f64 du = t->uv[c][0] - t->uv[i][0], dv = t->uv[c][1] - t->uv[i][1], from[3], way[3];
        f64 a = (m11 * du - m01 * dv) / det, b = (m00 * dv - m10 * du) / det;
        for (int j = 0; j < 3; j++) {
            from[j] = P[j] + (a * t->rays[i][k - 1][2][j] + b * t->rays[i][k - 1][3][j]);
            way[j] = D[j] + (a * t->rays[i][k - 1][4][j] + b * t->rays[i][k - 1][5][j]);
        }
        if (!flatten(from, way, group, t->z[0], t->p[c], t->d[c])) return -1;
    }
    f64 extent = width_of(t, 0.0);
    t->z[1] = t->z[0] - extent, t->z[2] = last + extent;
    return group;
}

/* Writes a beam, with the signature of sample i. */
static void emit(Search *search, i64 slot, int group, i64 k, int i) {
    const Samples *t = search->t;
    i64 b = search->used++;
    search->slot[b] = (i32)slot, search->group[b] = (i8)group, search->k[b] = (i8)k;
    for (int c = 0; c < 3; c++) {
        search->z[3 * b + c] = t->z[c];
        for (int j = 0; j < 2; j++) {
            i64 at = 6 * b + 2 * c + j;
            search->uv[at] = t->uv[c][j], search->p[at] = t->p[c][j], search->d[at] = t->d[c][j];
        }
    }
    for (i64 j = 0; j < k; j++) {
        search->code[b * search->columns + j] = (i32)t->code[i][j];
        search->eta[b * search->columns + j] = t->eta[i][j];
    }
}

/* Finds the beams of an element from its first bend on. Returns the bend at which the element must be split, 0 if it
   is done, or −1 if the arrays are full. room: whether its parts would fit on the stack. */
static i64 element_beams(Search *search, i64 slot, const Element *e, int room) {
    const Glass *g = search->g;
    Samples *t = search->t;
    i64 body = link_of(g, slot, BODY), patch = link_of(g, slot, PATCH);
    f64 distance, edge = extent_of(place_of(g, slot), e, search->path, &distance), size = least(g->ball[4 * body + 3], distance);
    /* A small triangle of a smooth mesh needs only one ray: its derivatives give the others. */
    int alone = e->level == 0 && edge < 0.5 * search->fine * size && !link_of(g, slot, FLAT_SHADED), cut;
    i64 bends = sample(search, slot, e, alone, &cut);
    int splittable = room && !alone;
    int coarse = splittable && (edge > WIDE * distance || (edge > COARSE * g->patch_size[patch] && g->planar[patch] < 0));
    search->cut |= cut;
    /* If no light passes at the samples (total reflection), it may still pass between them. */
    i64 last = coarse && e->first > bends ? e->first : bends;
    if (splittable && bends + 1 >= e->first && passes_between(t, bends)) last = bends + 1;
    for (i64 k = e->first; k <= last; k++) {
        /* Must the element be split at this bend? */
        i64 finer = (k - 1) >> 1 < COARSER ? (k - 1) >> 1 : COARSER;
        f64 smallest = search->fine * size * (f64)((i64)1 << finer);
        int differ = splittable && (edge > smallest || (e->level < FLAT_LEVELS && search->finest)), agree = 1, group = 0;
        for (int i = 0; i < 4; i++) agree = agree && t->n[i] >= k && same(t, i, 0, k);
        int split = coarse || (!agree && differ), wider = 0;
        if (agree) {
            agree = bundle(search, k, differ && !split, k == 1 ? body : -1, &wider, &group);
            split |= wider;
        }
        if (split) return k;
        /* One beam, if the samples agree */
        if (search->used + 4 > search->room) return -1;
        if (agree) {
            emit(search, slot, group, k, 3);
            continue;
        }
        /* It is too small to split: each sample with a signature of its own makes a beam from its derivatives. */
        for (int i = 0; i < 4; i++) {
            int own = t->n[i] >= k;
            for (int other = 0; other < i; other++) own = own && !(t->n[other] >= k && same(t, i, other, k));
            if (!own) continue;
            group = beam_of_ray(search, slot, i, k);
            if (group >= 0) emit(search, slot, group, k, i);
        }
    }
    return 0;
}

/* Divides an element into four parts: three at the corners, one between the middles of the edges. */
static void quarters(const Element *e, i64 k, Element *out) {
    for (int i = 0; i < 4; i++) {
        for (int c = 0; c < 3; c++) {
            int j = i < 3 ? i : (c + 1) % 3;
            for (int axis = 0; axis < 2; axis++) out[i].uv[c][axis] = 0.5 * (e->uv[c][axis] + e->uv[j][axis]);
        }
        out[i].level = e->level + 1, out[i].first = k;
    }
}

/* Finds the beams of the triangles from state[0] on, until all are done, the arrays are full, or the limit of rays
   is reached. state: the next triangle, the number of beams, and whether light went on behind `deepest` bends. fine:
   elements whose samples differ are not split if their edges are shorter than this, relative to the body's radius or
   to the light's distance. finest: split them FLAT_LEVELS times in any case. Returns 1 if there is not enough
   memory. */
KERNEL(beams_trace,
       GLASS LIGHT "h f64  fine f64  finest i64  deepest i64  limit i64  state i64[3]!  slot i32[n]!  uv f64[n,3,2]!  "
                   "p f64[n,3,2]!  d f64[n,3,2]!  z f64[n,3]!  group i8[n]!  k i8[n]!  code i32[n,q]!  eta f64[n,q]!"
       ";  c=65  0<deepest<=64  deepest<=q  0<=state;  -1<=planar<m  tree(child,m)")
i64 beams_trace(i64 m, i64 y, i64 b, i64 d_nodes, i64 c, i64 n, i64 q, OF_GLASS, OF_LIGHT, f64 h, f64 fine, i64 finest,
                i64 deepest, i64 limit, i64 *state, i32 *slot, f64 *uv, f64 *p, f64 *d, f64 *z, i8 *group, i8 *k,
                i32 *code, f64 *eta) {
    Glass g = {m, b, place, link, planar, patch_size, ior, rank, ball, box, child};
    Path path = path_of(light, sun, total, far, around, work);
    Search search = {&g, &path, malloc(sizeof(Samples)), h, fine, deepest, limit, n, state[1], q, finest != 0, state[2] != 0,
                     slot, uv, p, d, z, group, k, code, eta};
    Element stack[PARTS];
    i64 own = state[0], before = search.used;
    (void)y, (void)d_nodes, (void)c;
    if (!search.t) return 1;
    for (; own < m; own++) {
        i64 top = 0;
        before = search.used;
        if (seen_first(&g, &path, own)) stack[top++] = (Element){{{0, 0}, {1, 0}, {0, 1}}, 0, 1};
        while (top) {
            Element e = stack[--top];
            i64 split = element_beams(&search, own, &e, top + 4 < PARTS);
            if (split < 0 || work[RAYS] > limit) goto end;
            if (split) quarters(&e, split, stack + top), top += 4;
        }
        before = search.used;
    }
end:
    state[0] = own, state[1] = before, state[2] = search.cut;
    free(search.t);
    return 0;
}
