/* Lifts receivers on smooth surfaces that are made of facets (terminator.py). */
#include <stdlib.h>

#include "../support/four.h"
#include "lifts.h"
#include "targets.h"

/* Returns N·(a − b). */
static f64 along(const f64 *a, const f64 *b, const f64 *N) {
    return N[0] * (a[0] - b[0]) + N[1] * (a[1] - b[1]) + N[2] * (a[2] - b[2]);
}

static f64 clamped(f64 x, f64 low, f64 high) { return x < low ? low : x > high ? high : x; }

/* Computes the weights of the corners V at q, which lies in their plane. */
static void barycentric(const f64 V[3][3], const f64 *q, f64 *weight) {
    f64 ee = 0, ef = 0, ff = 0, de = 0, df = 0;
    for (int j = 0; j < 3; j++) {
        f64 e = V[1][j] - V[0][j], f = V[2][j] - V[0][j], d = q[j] - V[0][j];
        ee += e * e, ef += e * f, ff += f * f, de += d * e, df += d * f;
    }
    f64 area = ee * ff - ef * ef;
    weight[1] = clamped((ff * de - ef * df) / area, 0.0, 1.0);
    weight[2] = clamped((ee * df - ef * de) / area, 0.0, 1.0 - weight[1]);
    weight[0] = 1.0 - weight[1] - weight[2];
}

/* Returns how high the smooth surface is above q: the larger of two heights. One is that of a parabola through the
   vertices with their normals. The other is that of the lowest of three planes, each perpendicular to a corner's
   normal and raised so that no corner is above it. */
static f64 height_of(const f64 V[3][3], const f64 N[3][3], const f64 *q, const f64 *weight) {
    f64 u = weight[0], v = weight[1], least = INFINITY;
    for (int c = 0; c < 3; c++) {
        f64 height = 0.0;
        for (int d = 0; d < 3; d++) {
            f64 above = along(V[d], V[c], N[c]);
            height = above > height ? above : height;
        }
        f64 plane = height + along(V[c], q, N[c]);
        plane = plane > 0.0 ? plane : 0.0;
        least = plane < least ? plane : least;
    }
    f64 a = along(V[0], V[2], N[2]) - along(V[0], V[2], N[0]);
    f64 b = along(V[1], V[2], N[2]) - along(V[1], V[2], N[1]);
    f64 c = along(V[1], V[0], N[1]) - along(V[1], V[0], N[0]);
    f64 height = 0.5 * (a * u * (u - 1.0) + (a + b + c) * u * v + b * v * (v - 1.0));
    return least > height ? least : height;
}

/* Fills the arrays of Lift; returns how many receivers have one. */
KERNEL(terminator_lift,
       "centre f64[3]  scale f64  vertices f32[v,3]  triangles i32[t,3]  instance i32[t]  source i32[t]  "
       "normal_matrix f64[I,3,3]  corner_normals f32[s,3,3]  piece i32[y]  cut f64[z,3,2]  "
       "smooth bool[s]  owner i32[I]  geometry f64[O]  normal f64[O]  "
       "P f64[n,3]  Ns f64[n,3]  triangle i32[n]  front bool[n]  above f64[n,3]!  side f64[n,3]!  cutoff f64[n]!"
       ";  y=0|y=t  0<=triangle<t;  0<=triangles<v  0<=instance<I  0<=source<s  -1<=piece<z  0<=owner<O")
i64 terminator_lift(i64 nv, i64 t, i64 I, i64 s, i64 y, i64 z, i64 O, i64 n, const f64 *centre, f64 scale, const f32 *vertices,
                    const i32 *triangles, const i32 *instance, const i32 *source, const f64 *normal_matrix,
                    const f32 *corner_normals, const i32 *piece, const f64 *cut, const u8 *smooth, const i32 *owner, const f64 *geometry,
                    const f64 *normal, const f64 *P, const f64 *Ns, const i32 *triangle, const u8 *front, f64 *above,
                    f64 *side, f64 *cutoff) {
    i64 some = 0;
    (void)nv, (void)t, (void)I, (void)s, (void)z, (void)O;
    for (i64 p = 0; p < n; p++) {
        i64 hit = triangle[p], i = instance[hit], k = source[hit], object = owner[i];
        const f64 *m = normal_matrix + 9 * i;
        f64 V[3][3], N[3][3], q[3], weight[3], turn = front[p] ? 1.0 : -1.0;
        int whole = 1;
        if (!smooth[k] || geometry[object] == 0.0) continue;

        /* The corners and their normals in the world */
        for (int c = 0; c < 3; c++) {
            const f32 *normals = corner_normals + 9 * k, *corner = vertices + 3 * (i64)triangles[3 * hit + c];
            f64 length = 0.0, a = c == 1, b = c == 2, local[3];
            if (y && piece[hit] >= 0) a = cut[6 * (i64)piece[hit] + 2 * c], b = cut[6 * (i64)piece[hit] + 2 * c + 1];
            for (int j = 0; j < 3; j++) local[j] = (1.0 - a - b) * normals[j] + a * normals[3 + j] + b * normals[6 + j];
            for (int j = 0; j < 3; j++) {
                V[c][j] = corner[j];
                N[c][j] = m[3 * j] * local[0] + m[3 * j + 1] * local[1] + m[3 * j + 2] * local[2];
                length += N[c][j] * N[c][j];
            }
            length = sqrt(length);
            whole &= length > 0.0 && length < INFINITY;
            for (int j = 0; j < 3; j++) N[c][j] *= turn / length;
        }
        if (!whole) continue;  /* the mesh has no usable normal here */
        /* The point on the smooth surface above P */
        for (int j = 0; j < 3; j++) q[j] = (P[3 * p + j] - centre[j]) / scale;
        barycentric(V, q, weight);
        f64 height = scale * height_of(V, N, q, weight);
        for (int j = 0; j < 3; j++) {
            f64 up = weight[0] * N[0][j] + weight[1] * N[1][j] + weight[2] * N[2][j];
            above[3 * p + j] = height * up + normal[object] * Ns[3 * p + j];
            side[3 * p + j] = Ns[3 * p + j];
        }
        cutoff[p] = geometry[object];
        some++;
    }
    return some;
}

#define LIFT "above f64[n,3]  side f64[n,3]  cutoff f64[n]  P f64[n,3]  N f64[n,3]  position f64[L,3]  directional bool[L]  "

/* Receivers that may be lifted, and the lights. */
typedef struct {
    const f64 *side, *cutoff, *P, *N;
    Targets targets;
} Lifts;

/* Returns how far receiver p is lifted for light i, 0 to 1: fully if its facet turns away from it. */
static f64 amount(const Lifts *l, i64 p, i64 i) {
    f64 way[3];
    if (l->cutoff[p] == 0.0) return 0.0;
    way_to(&l->targets, i, l->P + 3 * p, way);
    return lift_share(l->cutoff[p], way, l->N + 3 * p, l->side + 3 * p);
}

/* The lights' positions, x of all, then y, then z, then 1, or 0 for directional ones: (4, 64·W), the last lights 0; and
   the same in single precision. largest: no coordinate is further from 0. */
typedef struct {
    i64 W;
    f64 *exact, largest;
    f32 *rough;
} Columns;

/* Returns whether there is memory for them. */
static int columns_of(const Targets *t, i64 L, Columns *c) {
    i64 n = 64 * ((L + 63) / 64);
    *c = (Columns){n / 64, calloc((size_t)(6 * n + 1), sizeof *c->exact), 0.0, 0};
    if (!c->exact) return 0;
    c->rough = (f32 *)(c->exact + 4 * n);
    for (i64 i = 0; i < L; i++) {
        for (int j = 0; j < 3; j++) {
            c->exact[j * n + i] = t->position[3 * i + j];
            c->largest = fmax(c->largest, fabs(t->position[3 * i + j]));
        }
        c->exact[3 * n + i] = t->directional[i] ? 0.0 : 1.0;
    }
    for (i64 i = 0; i < 4 * n; i++) c->rough[i] = (f32)c->exact[i];
    return 1;
}

/* Computes `amount` at receiver p for four lights from `first` on, with the same bits. */
static Four amounts(const Lifts *l, const Columns *c, i64 p, i64 first) {
    const f64 *P = l->P + 3 * p, *N = l->N + 3 * p, *side = l->side + 3 * p, cutoff = l->cutoff[p];
    const f64 *x = c->exact + first, *y = x + 64 * c->W, *z = y + 64 * c->W;
    Four here = four_of(z + 64 * c->W), one = {1.0, 1.0, 1.0, 1.0};
    Four d0 = four_of(x) - here * P[0], d1 = four_of(y) - here * P[1], d2 = four_of(z) - here * P[2];
    Four square_of = d0 * d0 + d1 * d1 + d2 * d2, length = four_roots(square_of);
    Four toward = d0 * N[0] + d1 * N[1] + d2 * N[2], over = d0 * side[0] + d1 * side[1] + d2 * side[2];
    Four beyond = cutoff * cutoff * square_of * 1.000001, facet = toward / length, smooth = over / length;
    Four most = four_where(smooth < cutoff, 2.0 - (facet + smooth) / cutoff, 1.0 - facet / cutoff);
    FourTests clear = (toward > 0.0) & (over > 0.0) & (toward * toward > beyond) & (over * over > beyond);
    most = four_where(most > 1.0, one, four_where(most < 0.0, 0.0 * one, most));
    return four_where(clear, 0.0 * one, four_where(toward < 0.0, one, most));
}

/* Returns the lights of word w for which `amount` at receiver p may be above 0. For all others both cosines are certainly
   above the cutoff, although the way d to a light is known in single precision only: `off` is more than the errors of
   d and of the products with it, so |d|² is at most 1.001·d² + 1001·off². */
static u64 grazed(const Lifts *l, const Columns *c, i64 p, i64 w) {
    const f64 *at = l->P + 3 * p, *n = l->N + 3 * p, *s = l->side + 3 * p;
    const f32 *x = c->rough + 64 * w, *y = x + 64 * c->W, *z = y + 64 * c->W, *place = z + 64 * c->W;
    const f32 P[3] = {(f32)at[0], (f32)at[1], (f32)at[2]}, N[3] = {(f32)n[0], (f32)n[1], (f32)n[2]};
    const f32 side[3] = {(f32)s[0], (f32)s[1], (f32)s[2]};
    const f32 off = (f32)(0x1p-20 * (c->largest + fabs(at[0]) + fabs(at[1]) + fabs(at[2])));
    const f32 beyond = (f32)(l->cutoff[p] * l->cutoff[p] * 1.0011), added = 1001.0f * beyond * off * off;
    u64 clear = 0;
    for (int i = 0; i < 64; i += 8) {
        Eight here = eight_of(place + i);
        Eight d0 = eight_of(x + i) - here * P[0], d1 = eight_of(y + i) - here * P[1], d2 = eight_of(z + i) - here * P[2];
        Eight most = beyond * (d0 * d0 + d1 * d1 + d2 * d2) + added;
        Eight toward = d0 * N[0] + d1 * N[1] + d2 * N[2] - off, over = d0 * side[0] + d1 * side[1] + d2 * side[2] - off;
        clear |= (u64)eight_bits((toward > 0.0f) & (over > 0.0f) & (toward * toward > most) & (over * over > most)) << i;
    }
    return ~clear;
}

/* Returns whether receiver p may be lifted for some point of light i, none of which is further than `size` from its
   middle. */
static int may_lift(const Lifts *l, i64 p, i64 i, f64 size) {
    f64 cutoff = l->cutoff[p], way[3];
    if (!(size > 0.0)) return amount(l, p, i) > 0.0;
    if (cutoff == 0.0) return 0;
    way_to(&l->targets, i, l->P + 3 * p, way);
    f64 toward = dot(way, l->N + 3 * p), over = dot(way, l->side + 3 * p);
    return (toward < over ? toward : over) - size < cutoff * (sqrt(dot(way, way)) + size);
}

/* Lists the receivers that some active light lifts, or some point of it; returns how many, −1 if there is not enough
   memory. size: see `may_lift`. */
KERNEL(terminator_grazing, LIFT "size f64[L]  active u64[n,W]  rows i64[n]!"
       ";  W=words(L)")
i64 terminator_grazing(i64 n, i64 L, i64 W, const f64 *above, const f64 *side, const f64 *cutoff, const f64 *P,
                       const f64 *N, const f64 *position, const u8 *directional, const f64 *size, const u64 *active,
                       i64 *rows) {
    Lifts lifts = {side, cutoff, P, N, {position, directional}};
    Columns columns;
    i64 count = 0, sized = 0;
    (void)above;
    if (!columns_of(&lifts.targets, L, &columns)) return -1;
    for (i64 i = 0; i < L; i++) sized += size[i] > 0.0;
    for (i64 p = 0; p < n; p++) {
        int some = 0;
        for (i64 w = 0; cutoff[p] > 0.0 && w < W && !some; w++) {
            u64 left = active[p * W + w];
            if (left && !sized) left &= grazed(&lifts, &columns, p, w);
            for (; left && !some; left &= left - 1)
                some = may_lift(&lifts, p, 64 * w + lowest(left), size[64 * w + lowest(left)]);
        }
        if (some) rows[count++] = p;
    }
    free(columns.exact);
    return count;
}

/* Computes where the rays of pairs (row, light) start. */
KERNEL(terminator_starts, LIFT "row i32[k]  light i32[k]  origin f64[k,3]!"
       ";  0<=row<n  0<=light<L")
i64 terminator_starts(i64 n, i64 L, i64 k, const f64 *above, const f64 *side, const f64 *cutoff, const f64 *P,
                      const f64 *N, const f64 *position, const u8 *directional, const i32 *row, const i32 *light,
                      f64 *origin) {
    Lifts lifts = {side, cutoff, P, N, {position, directional}};
    (void)n, (void)L;
    for (i64 at = 0; at < k; at++) {
        i64 p = row[at];
        f64 share = amount(&lifts, p, light[at]);
        for (int j = 0; j < 3; j++)
            origin[3 * at + j] = share > 0.0 ? P[3 * p + j] + share * above[3 * p + j] : P[3 * p + j];
    }
    return 0;
}

/* Sets in lifted the lights of soft for which P may be lifted for some of their points. size: see `may_lift`. */
KERNEL(terminator_touched, LIFT "size f64[L]  soft u64[n,W]  lifted u64[n,W]!"
       ";  W=words(L)")
i64 terminator_touched(i64 n, i64 L, i64 W, const f64 *above, const f64 *side, const f64 *cutoff, const f64 *P,
                       const f64 *N, const f64 *position, const u8 *directional, const f64 *size, const u64 *soft,
                       u64 *lifted) {
    Lifts lifts = {side, cutoff, P, N, {position, directional}};
    (void)above, (void)L;
    for (i64 p = 0; p < n; p++)
        for (i64 w = 0; cutoff[p] > 0.0 && w < W; w++)
            for (u64 left = soft[p * W + w]; left; left &= left - 1) {
                i64 i = 64 * w + lowest(left);
                if (may_lift(&lifts, p, i, size[i])) set_bit(lifted + p * W, i);
            }
    return 0;
}

/* Moves lights from soft to lifted where P is fully lifted. Where P is partly lifted they are in both. Returns 1 if
   there is not enough memory. */
KERNEL(terminator_split, LIFT "soft u64[n,W]!  lifted u64[n,W]!"
       ";  W=words(L)")
i64 terminator_split(i64 n, i64 L, i64 W, const f64 *above, const f64 *side, const f64 *cutoff, const f64 *P,
                     const f64 *N, const f64 *position, const u8 *directional, u64 *soft, u64 *lifted) {
    Lifts lifts = {side, cutoff, P, N, {position, directional}};
    Columns columns;
    (void)above;
    if (!columns_of(&lifts.targets, L, &columns)) return 1;
    for (i64 p = 0; p < n; p++)
        for (i64 w = 0; cutoff[p] > 0.0 && w < W; w++) {
            u64 left = soft[p * W + w];
            if (left) left &= grazed(&lifts, &columns, p, w);
            for (int at = 0; at < 64; at += 4) {
                u64 wanted = left >> at & 15;
                if (!wanted) continue;
                Four share = amounts(&lifts, &columns, p, 64 * w + at);
                lifted[p * W + w] |= (bits_of(share > 0.0) & wanted) << at;
                soft[p * W + w] &= ~((bits_of(share == 1.0) & wanted) << at);
            }
        }
    free(columns.exact);
    return 0;
}

/* Combines the S at P and the S at the lifted P, for the lights in lifted of the receivers `rows`. answered: where
   S_lifted is known. soft: where S is known; updated for the result. Returns 1 if there is not enough memory. */
KERNEL(terminator_merge,
       LIFT "rows i64[m]  lifted u64[m,W]  answered u64[m,W]  S_lifted f32[m,L,C]  soft u64[n,W]!  S f32[n,L,C]!"
       ";  W=words(L)  0<=rows<n")
i64 terminator_merge(i64 n, i64 L, i64 m, i64 W, i64 C, const f64 *above, const f64 *side, const f64 *cutoff,
                     const f64 *P, const f64 *N, const f64 *position, const u8 *directional, const i64 *rows,
                     const u64 *lifted, const u64 *answered, const f32 *S_lifted, u64 *soft, f32 *S) {
    Lifts lifts = {side, cutoff, P, N, {position, directional}};
    Columns columns;
    (void)n, (void)above;
    if (!columns_of(&lifts.targets, L, &columns)) return 1;
    for (i64 at = 0; at < m; at++) {
        i64 p = rows[at];
        u64 *own = soft + p * W;
        for (i64 w = 0; w < W; w++) {
            Four shares = {0.0};
            int from = -1;  /* of which lights these are */
            for (u64 left = lifted[at * W + w]; left; left &= left - 1) {
                i64 i = 64 * w + lowest(left);
                if (from != lowest(left) / 4) from = lowest(left) / 4, shares = amounts(&lifts, &columns, p, i & ~(i64)3);
                f64 share = shares[i & 3];
                int known = has(answered + at * W, i) && (share == 1.0 || has(own, i));
                for (i64 c = 0; c < C; c++) {
                    f32 *value = S + (p * L + i) * C + c;
                    *value = known ? (f32)((1.0 - share) * *value + share * S_lifted[(at * L + i) * C + c]) : 0;
                }
                if (known) own[w] |= bit(i);
                else own[w] &= ~bit(i);
            }
        }
    }
    free(columns.exact);
    return 0;
}

/* Multiplies S by cos(faster·angle)/cos(angle), with the angle between N and a light. */
KERNEL(terminator_fade, "faster f64[n]  P f64[n,3]  N f64[n,3]  position f64[L,3]  directional bool[L]  S f32[n,L,C]!")
i64 terminator_fade(i64 n, i64 L, i64 C, const f64 *faster, const f64 *P, const f64 *N, const f64 *position,
                    const u8 *directional, f32 *S) {
    Targets targets = {position, directional};
    for (i64 p = 0; p < n; p++)
        for (i64 i = 0; faster[p] > 1.0 && i < L; i++) {
            f64 way[3], share = 0.0;
            way_to(&targets, i, P + 3 * p, way);
            f64 cosine = dot(way, N + 3 * p) / sqrt(dot(way, way));
            cosine = cosine < 1.0 ? cosine : 1.0;
            if (cosine > 0.0) {
                f64 faded = cos(acos(cosine) * faster[p]);
                share = (faded > 0.0 ? faded : 0.0) / cosine;
            }
            for (i64 c = 0; c < C; c++) S[(p * L + i) * C + c] = (f32)(S[(p * L + i) * C + c] * share);
        }
    return 0;
}
