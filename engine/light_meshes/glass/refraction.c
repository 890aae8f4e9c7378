/* Finds refracted paths to points (refraction.py). */
#include "least_way.h"

enum { MOST = 64 };  /* the largest number of paths from a light to a point */
/* relative to the first patch's radius: two paths are the same if their first points are nearer than this */
static const f64 SAME = 1e-6;
static const f64 MISS = 1e-8;  /* relative to the same: how far from the point a path may end */
static const f64 PAD = 0.3;  /* barycentric: a search may start for a point that is this far outside a beam */
static const f64 GRAZING = 0.35;  /* cosine at the exit of flat glass below which each way through it is searched */

/* The beams of a light, and the trees over them (beams.py: Beams). */
typedef struct {
    i64 columns;
    const i32 *slot;
    const f64 *uv, *p, *d, *z;
    const i8 *k;
    const i32 *code;
    const f64 *eta;
    const i64 *root;
    const f64 *bounds;
    const i64 *child, *flat;
    i64 flats;
} Beams;

/* Fills out: Π t of everything that the straight way from the light to points crosses, 0 if it would bend; but not 0
   if it would bend `beyond` times or more. */
KERNEL(refraction_straight, GLASS LIGHT "x f64[n,3]  beyond i64  out f64[n,3]!"
       ";  c=65;  -1<=planar<m  tree(child,m)")
i64 refraction_straight(i64 m, i64 y, i64 b, i64 d, i64 c, i64 n, OF_GLASS, OF_LIGHT, const f64 *x, i64 beyond_bends,
                        f64 *out) {
    Glass g = {m, b, place, link, planar, patch_size, ior, rank, ball, box, child};
    Path s = path_of(light, sun, total, far, around, work);
    (void)y, (void)d, (void)c;
    for (i64 p = 0; p < n; p++) {
        f64 end;
        set_out(&s, x + 3 * p);
        miss(s.ray, x + 3 * p, &end);
        i64 bends = 0, met = next_bend(&g, &s, end);
        while (met == BENDS && beyond_bends < (i64)1 << 30) {
            for (int j = 0; j < 3; j++) s.ray[0][j] += s.hit.t * s.ray[1][j];
            end -= s.hit.t;
            bends++, met = next_bend(&g, &s, end);
        }
        if (met == ENDS && (bends == 0 || bends >= beyond_bends)) memcpy(out + 3 * p, s.alpha, sizeof s.alpha);
    }
    return 0;
}

/* Returns whether (a, b) at height z is in beam i; *at: the place on the first triangle of the ray that passes
   there. */
static int inside(const Beams *beams, i64 i, f64 z, f64 a, f64 b, Place *at) {
    const f64 *p = beams->p + 6 * i, *d = beams->d + 6 * i, *uv = beams->uv + 6 * i, *range = beams->z + 3 * i;
    if (!(z >= range[1] && z <= range[2])) return 0;
    f64 w = z - range[0], x0 = p[0] + w * d[0], y0 = p[1] + w * d[1];
    f64 x1 = p[2] + w * d[2] - x0, y1 = p[3] + w * d[3] - y0, x2 = p[4] + w * d[4] - x0, y2 = p[5] + w * d[5] - y0;
    f64 det = x1 * y2 - x2 * y1, l1 = ((a - x0) * y2 - x2 * (b - y0)) / det, l2 = (x1 * (b - y0) - (a - x0) * y1) / det;
    if (!(l1 >= -PAD && l2 >= -PAD && l1 + l2 <= 1.0 + PAD)) return 0;
    f64 u = uv[0] + l1 * (uv[2] - uv[0]) + l2 * (uv[4] - uv[0]), v = uv[1] + l1 * (uv[3] - uv[1]) + l2 * (uv[5] - uv[1]);
    u = u > 0.0 ? u : 0.0, v = v > 0.0 ? v : 0.0;
    f64 sum = u + v;
    *at = sum > 1.0 ? (Place){beams->slot[i], u / sum, v / sum} : (Place){beams->slot[i], u, v};
    return 1;
}

/* The paths to one point that were found: their first points, and the beams with their signatures. */
typedef struct {
    i64 count, beam[MOST];
    f64 first[MOST][3];
} Known;

static Signature signature_of(const Beams *beams, i64 i) {
    return (Signature){beams->k[i], beams->code + i * beams->columns, beams->eta + i * beams->columns};
}

/* The middle of beam i on its first triangle: there light passes. */
static Place middle_of(const Beams *beams, i64 i) {
    const f64 *uv = beams->uv + 6 * i;
    return (Place){beams->slot[i], (uv[0] + uv[2] + uv[4]) / 3.0, (uv[1] + uv[3] + uv[5]) / 3.0};
}

/* Whether x is so low above the plane where the light of beam i leaves flat glass that beams do not tell whether it is in
   them: the way out changes as the root of the way to total reflection. Not where such a path is known. */
static int may_graze(const Glass *g, const Beams *beams, i64 i, const Known *known, const f64 *x) {
    i64 k = beams->k[i];
    const i32 *code = beams->code + i * beams->columns;
    i64 patch = code[k - 1] >> 1;
    const f64 *p = place_of(g, g->planar[patch]);
    f64 height = 0.0;
    for (int j = 0; j < 3; j++) height += (x[j] - p[A + j]) * p[NG + j];
    if (!(height > 0.0 && height < GRAZING * (sqrt(squared_distance(x, p + A)) + 2.0 * g->patch_size[patch]))) return 0;
    for (i64 other = 0; other < known->count; other++) {
        const i32 *has = beams->code + known->beam[other] * beams->columns;
        int equal = k == beams->k[known->beam[other]];
        for (i64 j = 0; j < k && equal; j++) equal = code[j] == has[j];
        if (equal) return 0;
    }
    return 1;
}

enum { FOUND, NOWHERE, TWICE, UNREAL };

/* Finds the path to which a seed leads, with its first point and its length after the last bend. middle: of the beam. */
static int search_path(const Glass *g, Path *s, const f64 *x, Place at, Place middle, Signature want, const Beams *beams,
                       const Known *known, f64 *first, f64 *along) {
    f64 size = g->patch_size[want.code[0] >> 1];
    for (int attempt = 0; attempt < 2; attempt++) {
        Place seed = at;
        at = newton(g, s, x, seed, want);
        if (at.slot < 0) at = newton(g, s, x, middle, want);
        if (at.slot < 0) return NOWHERE;
        /* Was the path found before? */
        const f64 *p = place_of(g, at.slot);
        for (int j = 0; j < 3; j++) first[j] = p[A + j] + at.u * p[E1 + j] + at.v * p[E2 + j];
        for (i64 i = 0; i < known->count; i++) {
            const i32 *code = beams->code + known->beam[i] * beams->columns;
            int equal = squared_distance(first, known->first[i]) < square(SAME * size) && want.k == beams->k[known->beam[i]];
            for (i64 j = 0; j < want.k && equal; j++) equal = want.code[j] == code[j];
            if (equal) return TWICE;
        }
        /* Does a ray from the light follow it and end at x? */
        if (chain(g, s, first, want.k, 0.0) < want.k) return UNREAL;
        for (i64 j = 0; j < want.k; j++)
            if (s->bend[j].code != want.code[j] || s->bend[j].eta != want.eta[j]) return UNREAL;
        f64 off = miss(s->ray, x, along);
        if (!(*along > 0.0)) return UNREAL;
        if (off <= MISS * size) return next_bend(g, s, *along) == ENDS ? FOUND : UNREAL;
        /* The planes of one patch can differ by rounding: try again from the triangles that are really hit. */
        at = (Place){s->bend[0].slot, s->bend[0].u, s->bend[0].v};
    }
    return UNREAL;
}

/* Computes the spread of a path's light: σ₁ ≥ σ₂ relative to the distance of the light, and how far the light of its
   first patch reaches; in the frame. */
static void spread_of(const Glass *g, const Path *s, const f64 *x, f64 along, f64 *spread, f64 *reach) {
    f64 m[3][2], distance = 1.0, off = 1.0;
    cross_section(s->ray, x, along, m);
    f64 total = square(m[0][0]) + square(m[0][1]) + square(m[1][0]) + square(m[1][1]);
    f64 skew = sqrt(square(square(m[0][0]) + square(m[1][0]) - square(m[0][1]) - square(m[1][1])) +
                    4.0 * square(m[0][0] * m[0][1] + m[1][0] * m[1][1]));
    f64 large = sqrt(0.5 * (total + skew)), small = large > 0.0 ? fabs(m[0][0] * m[1][1] - m[0][1] * m[1][0]) / large : 0.0;
    const f64 *ball = g->ball + 4 * link_of(g, s->bend[0].slot, BODY);
    if (!s->sun) {
        distance = sqrt(squared_distance(x, s->light));
        off = sqrt(squared_distance(ball, s->light));
        off = off > ball[3] ? off : ball[3];
    }
    spread[0] = large / distance, spread[1] = small / distance;
    *reach = distance * ball[3] / off;
}

/* Rows of the paths that are found, as in refraction_solve. */
typedef struct {
    f64 *alpha, *bends;
    i64 *k;
    f64 *arrival, *spread, *reach;
} Found;

/* Looks for a path to x of a beam's signature; returns 1 and fills the row where there is one that is not known. */
static i64 search_from(const Glass *g, Path *s, const f64 *x, Place seed, i64 beam, const Beams *beams, Known *known,
                       const Found *out, i64 row) {
    i64 q = beams->columns;
    f64 start[3], along;
    Signature want = signature_of(beams, beam);
    s->work[SEEDS]++;
    int found = search_path(g, s, x, seed, middle_of(beams, beam), want, beams, known, start, &along);
    if (found == NOWHERE) s->work[UNCONVERGED]++;
    if (found == UNREAL) s->work[REJECTED]++;
    if (found != FOUND) return 0;
    out->k[row] = want.k;
    for (int j = 0; j < 3; j++) {
        out->alpha[3 * row + j] = s->alpha[j], out->arrival[3 * row + j] = s->ray[1][j];
        for (i64 i = 0; i < q; i++) out->bends[(row * q + i) * 3 + j] = i < want.k ? s->bend[i].ray[0][j] : 0.0;
        known->first[known->count][j] = start[j];
    }
    spread_of(g, s, x, along, out->spread + 2 * row, out->reach + row);
    known->beam[known->count++] = beam;
    return 1;
}

/* Finds the paths to points from state[0] on, until all are done or the arrays are full. state: the next point, and
   the number of rows that are filled. */
KERNEL(refraction_solve,
       GLASS LIGHT
       "slot i32[B]  uv f64[B,3,2]  p f64[B,3,2]  d_of f64[B,3,2]  z f64[B,3]  k i8[B]  code i32[B,q]  eta f64[B,q]  "
       "root i64[6]  bounds f64[o,11]  beam_child i64[o,2]  flat i64[e]  x f64[n,3]  state i64[2]!  count i64[n]!  alpha f64[r,3]!  "
       "bends f64[r,q,3]!  k_out i64[r]!  arrival f64[r,3]!  spread f64[r,2]!  reach f64[r]!"
       ";  c=65  q<=64  0<=state;  -1<=planar<m  tree(child,m)  0<=slot<m  1<=k  k<=q  0<=code  -1<=root<o  "
       "tree(beam_child,B)  0<=flat<B")
i64 refraction_solve(i64 m, i64 y, i64 b, i64 d, i64 c, i64 B, i64 q, i64 o_count, i64 flats, i64 n, i64 r, OF_GLASS, OF_LIGHT,
                     const i32 *slot, const f64 *uv, const f64 *p_of, const f64 *d_of, const f64 *z_of, const i8 *k_of,
                     const i32 *code, const f64 *eta, const i64 *root, const f64 *bounds, const i64 *beam_child,
                     const i64 *flat, const f64 *x, i64 *state, i64 *count, f64 *alpha, f64 *bends, i64 *k_out, f64 *arrival,
                     f64 *spread, f64 *reach) {
    Glass g = {m, b, place, link, planar, patch_size, ior, rank, ball, box, child};
    Path s = path_of(light, sun, total, far, around, work);
    Beams beams = {q, slot, uv, p_of, d_of, z_of, k_of, code, eta, root, bounds, beam_child, flat, flats};
    const Found out = {alpha, bends, k_out, arrival, spread, reach};
    i64 p = state[0], rows = 0, stack[STACK];
    (void)y, (void)d, (void)c, (void)B, (void)o_count;
    for (; p < n && rows + MOST <= r; p++) {
        const f64 *at = x + 3 * p;
        i64 first_row = rows;
        Known known = {0};
        for (int group = 0; group < 6; group++) {
            i64 top = 0;
            int axis = group >> 1;
            f64 z = group & 1 ? -at[axis] : at[axis], a = at[(axis + 1) % 3], e = at[(axis + 2) % 3];
            if (root[group] >= 0) stack[top++] = root[group];

            /* Walk down the group's tree to the beams that may contain the point */
            while (top) {
                i64 node = stack[--top], first = beam_child[2 * node], last = first + beam_child[2 * node + 1];
                const f64 *o = bounds + 11 * node;
                f64 w = z - o[0];
                if (!(z >= o[1] && z <= o[2] && a >= o[3] + w * o[7] && a <= o[4] + w * o[8] && e >= o[5] + w * o[9] &&
                      e <= o[6] + w * o[10]))
                    continue;
                if (first == last) {
                    stack[top] = first + 1, stack[top + 1] = first;
                    top += 2;
                    continue;
                }
                /* A leaf: search a path from each beam around the point */
                for (i64 beam = first; beam < last; beam++) {
                    Place seed;
                    if (!inside(&beams, beam, z, a, e, &seed) || known.count == MOST) continue;
                    rows += search_from(&g, &s, at, seed, beam, &beams, &known, &out, rows);
                }
            }
        }
        for (i64 i = 0; i < flats && known.count < MOST; i++) {
            if (!may_graze(&g, &beams, flat[i], &known, at)) continue;
            Place seed = least_way(&g, &s, at, signature_of(&beams, flat[i]));
            if (seed.slot >= 0) rows += search_from(&g, &s, at, seed, flat[i], &beams, &known, &out, rows);
        }
        count[p] = rows - first_row;
    }
    state[0] = p, state[1] = rows;
    return 0;
}
