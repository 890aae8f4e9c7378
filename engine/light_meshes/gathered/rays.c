/* What rays that gather light meet: how far away, and the keys of patches there (rays.py). */
#include "../glass/fresnel.h"
#include "../rays/around.h"
#include "grids.h"

#define NOTHING (~(u64)0)  /* the key where nothing is met, */
#define CLEAR (NOTHING - 1)   /* and of what lets rays pass */
#define KEPT 64    /* triangles that are kept while rays meet them, */
#define SIZES 16   /* with their grids for so many sizes of patches */

/* What patches are cells of. finest: their sizes are finest·2^i, the largest that is not above `share` of the way, or the
   last. */
typedef struct {
    const f64 *centre;
    f64 scale, finest, share;
    const f32 *vertices;
    const i32 *triangles, *other, *for_small;
    const u8 *flipped;
    i64 T, steps;
} Cells;

/* A triangle, and its grids. */
typedef struct {
    i64 t;                    /* −1: none yet */
    Edges edges;
    f64 normal[3];
    Grid grid;                /* lead: −1, not known yet; how it is divided is below */
    i64 m[SIZES], n[SIZES];   /* 0: not known yet */
} Flat;

static void enter_flat(const Cells *s, i64 t, Flat *out) {
    out->t = t, out->edges = edges_of(s->vertices, s->triangles + 3 * t);
    cross(out->edges.e, out->edges.f, out->normal);
    out->grid.lead = -1;
}

static inline Flat *flat_of(const Cells *s, Flat *kept, i64 t) {
    Flat *flat = kept + (t & (KEPT - 1));
    if (flat->t != t) enter_flat(s, t, flat);
    return flat;
}

static void none_kept(Flat *kept) {
    for (int k = 0; k < KEPT; k++) kept[k].t = -1;
}

/* The key of the patch on triangle t at barycentrics u, v, which a ray from `origin` along `direction` meets; away: how
   far it is. */
static inline u64 key_there(const Cells *s, Flat *kept, i64 t, f64 u, f64 v, const f64 *origin, const f64 *direction,
                            f32 *away) {
    Flat *flat = flat_of(s, kept, t);
    const Edges *e = &flat->edges;
    f64 place[3], sum = 0.0, size = s->finest, xy[2];
    i64 step = 0, i, j;
    for (int c = 0; c < 3; c++) {
        place[c] = e->a[c] + u * e->e[c] + v * e->f[c];
        sum += square(place[c] - (origin[c] - s->centre[c]) / s->scale);
    }
    f64 far = s->scale * sqrt(sum);
    *away = (f32)(far > 1e-30 ? far : 1e-30);
    while (step + 1 < s->steps && 2.0 * size <= s->share * far) size *= 2.0, step++;
    int front = (dot(flat->normal, direction) < 0.0) != s->flipped[t];
    i64 small = s->for_small[step * s->T + t];
    if (small >= 0) return key_at(small, front, 0, step, 0);
    Grid *g = &flat->grid;
    if (g->lead < 0) {
        *g = undivided(s->vertices, s->triangles, s->other, s->scale, t);
        memset(flat->m, 0, sizeof flat->m);
    }
    if (step >= SIZES) divide(g, size);
    else if (flat->m[step]) g->m = flat->m[step], g->n = flat->n[step];
    else divide(g, size), flat->m[step] = g->m, flat->n[step] = g->n;
    on_axes(&g->axes, place, xy), cell_of(g, xy, &i, &j);
    return key_at(g->lead, front, (int)(s->steps - step), i, j);
}

/* Fills how far away is what the rays along `local`, d each, meet (0: nothing), and the key of the patch there. They are
   turned to normals M (see turned_to), from points P. clear: triangles that let rays pass; for_small (s,T): the triangle
   that stands for one smaller than patches of that size, −1: it is not smaller. */
KERNEL(rays_met,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  flipped bool[T]  for_small i32[s,T]  "
       "clear bool[T]?  finest f64  share f64  triangle i32[x]  u f32[x]  v f32[x]  P f64[r,3]  M f64[r,3]  turn f64[r,2]?  "
       "local f64[d,3]  distance f32[x]!  keys u64[x]!"
       ";  1<=s  x=r*d  0<finest<inf  -1<=triangle<T;  0<=triangles<V  -1<=other<T  -1<=for_small<T")
i64 rays_met(i64 V, i64 T, i64 s, i64 x, i64 r, i64 d, const f64 *centre, f64 scale, const f32 *vertices,
             const i32 *triangles, const i32 *other, const u8 *flipped, const i32 *for_small, const u8 *clear, f64 finest,
             f64 share, const i32 *triangle, const f32 *u, const f32 *v, const f64 *P, const f64 *M, const f64 *turn,
             const f64 *local, f32 *distance, u64 *keys) {
    Cells cells = {centre, scale, finest, share, vertices, triangles, other, for_small, flipped, T, s};
    Flat kept[KEPT];
    none_kept(kept);
    (void)V, (void)x;
    for (i64 k = 0; k < r; k++) {
        Turned axes = turned_to(M + 3 * k, turn ? turn + 2 * k : 0);
        for (i64 i = 0; i < d; i++) {
            i64 at = k * d + i, t = triangle[at];
            f64 direction[3];
            if (t < 0) {
                distance[at] = 0, keys[at] = NOTHING;
                continue;
            }
            along(&axes, local + 3 * i, direction);
            keys[at] = key_there(&cells, kept, t, u[at], v[at], P + 3 * k, direction, distance + at);
            if (clear && clear[t]) keys[at] = CLEAR;
        }
    }
    return 0;
}

/* Lets rays pass what they met: those that go on are put at the begin of the arrays (row, weight, origin, direction), which
   say then where they begin, with N, the normal there; `clear` tells which triangles let them pass, `factor` how much of
   the light, and `dims` by which index Fresnel's equations dim it; see `Interfaces.dims`. What does not pass is a layer: which row it is of, the key of the patch, where on it, and how much it counts.
   Rays that met nothing are `out`: rows, directions and weights. state: how many rays, layers, and rays that are out; of
   these there may be some before. `over`: rays go on no more. */
KERNEL(rays_passed,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  flipped bool[T]  for_small i32[s,T]  "
       "finest f64  share f64  clear bool[T]  dims f32[T]  least f64  over i64  factor f32[n,3]  triangle i32[n]  u f32[n]  v f32[n]  "
       "row i64[x]!  weight f64[x,3]!  origin f64[x,3]!  direction f64[x,3]!  N f64[x,3]!  "
       "keys u64[n]!  at i64[n]!  count f64[n,3]!  out i64[x]!  way f64[x,3]!  left f64[x,3]!  state i64[3]!"
       ";  1<=s  n<=x  0<finest<inf  0<=state  -1<=triangle<T;  0<=triangles<V  -1<=other<T  -1<=for_small<T")
i64 rays_passed(i64 V, i64 T, i64 s, i64 n, i64 x, const f64 *centre, f64 scale, const f32 *vertices,
                const i32 *triangles, const i32 *other, const u8 *flipped, const i32 *for_small, f64 finest, f64 share,
                const u8 *clear, const f32 *dims, f64 least, i64 over, const f32 *factor, const i32 *triangle, const f32 *u, const f32 *v,
                i64 *row, f64 *weight, f64 *origin, f64 *direction, f64 *N, u64 *keys, i64 *at, f64 *count, i64 *out,
                f64 *way, f64 *left, i64 *state) {
    Cells cells = {centre, scale, finest, share, vertices, triangles, other, for_small, flipped, T, s};
    Flat kept[KEPT];
    none_kept(kept);
    f32 away;
    (void)V;
    state[0] = state[1] = 0;
    for (i64 k = 0; k < n; k++) {
        i64 t = triangle[k], next = state[0], met = state[1];
        f64 stops[3], goes[3], *d = direction + 3 * k, *w = weight + 3 * k, normal[3], most = 0.0, any = 0.0, dimmed = 1.0;
        if (t < 0) {
            if (state[2] >= x) return OUTSIDE;
            out[state[2]] = row[k], memcpy(way + 3 * state[2], d, 3 * sizeof *d);
            memcpy(left + 3 * state[2]++, w, 3 * sizeof *w);
            continue;
        }
        if (over) continue;
        Edges e = edges_of(vertices, triangles + 3 * t);
        cross(e.e, e.f, normal);
        f64 length = sqrt(dot(normal, normal)), cosine = dot(normal, d) / length;
        if (dims[t] != 0.0f) {
            f64 back = fresnel(fabs(dims[t]), fabs(cosine) < 1.0 ? fabs(cosine) : 1.0);
            dimmed = dims[t] > 0.0f ? 1.0 - back : sqrt((1.0 - back) / (1.0 + back));
        }
        for (int c = 0; c < 3; c++) {
            f64 passed = clear[t] ? factor[3 * k + c] : 0.0;
            stops[c] = w[c] * (1.0 - passed), goes[c] = w[c] * passed * dimmed;
            any = stops[c] != 0.0 ? 1.0 : any, most = goes[c] > most ? goes[c] : most;
        }
        if (any != 0.0) {
            keys[met] = key_there(&cells, kept, t, u[k], v[k], origin + 3 * k, d, &away);
            at[met] = k, memcpy(count + 3 * met, stops, sizeof stops), state[1]++;
        }
        if (most <= least) continue;
        if (cosine < 0.0) length = -length;
        for (int j = 0; j < 3; j++) {
            N[3 * next + j] = normal[j] / length;
            origin[3 * next + j] = centre[j] + scale * (e.a[j] + u[k] * e.e[j] + v[k] * e.f[j]);
        }
        row[next] = row[k], memmove(direction + 3 * next, d, 3 * sizeof *d);
        memcpy(weight + 3 * next, goes, sizeof goes), state[0]++;
    }
    return 0;
}

/* The cell of edge `size` in which the middle of triangle t is, and the axis that its normal is nearest to. */
static void cell_around(const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangle, f64 size, i64 *cell) {
    Edges e = edges_of(vertices, triangle);
    f64 normal[3];
    int axis = 0;
    cross(e.e, e.f, normal);
    for (int j = 0; j < 3; j++) {
        cell[j] = (i64)floor((centre[j] + scale * (e.a[j] + (e.e[j] + e.f[j]) / 3.0)) / size);
        if (fabs(normal[j]) > fabs(normal[axis])) axis = j;
    }
    cell[3] = 2 * axis + (normal[axis] > 0.0);
}

/* Fills, for triangles that are not larger than `size`, the first of those that are near (in the same cell of this edge),
   look the same way, and have the same material and instance; −1 for larger ones. slots: room for a table, more than there are small
   triangles, of a power of two; −1. */
KERNEL(rays_stand_ins,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  flipped bool[T]  longest f32[T]  material i32[T]  "
       "instance i32[T]  size f64  slots i32[m]!  for_small i32[T]!"
       ";  power(m)  0<size<inf;  0<=triangles<V  -1<=slots<T")
i64 rays_stand_ins(i64 V, i64 T, i64 m, const f64 *centre, f64 scale, const f32 *vertices, const i32 *triangles,
                   const u8 *flipped, const f32 *longest, const i32 *material, const i32 *instance, f64 size, i32 *slots,
                   i32 *for_small) {
    i64 entered = 0;
    (void)V;
    for (i64 t = 0; t < T; t++) {
        i64 cell[4], there[4];
        for_small[t] = -1;
        if (longest[t] > size) continue;
        cell_around(centre, scale, vertices, triangles + 3 * t, size, cell);
        cell[3] ^= flipped[t];
        u64 at = (u64)cell[3] + SPREAD_3 * (u64)material[t] + SPREAD_2 * (u64)instance[t];
        for (int j = 0; j < 3; j++) at = (at ^ (u64)cell[j]) * SPREAD, at ^= at >> 29;
        for (at &= (u64)m - 1;; at = (at + 1) & ((u64)m - 1)) {
            i64 first = slots[at];
            if (first < 0) {
                if (++entered == m) return OUTSIDE;  /* a search would not end */
                slots[at] = (i32)t;
            }
            else {
                if (material[first] != material[t] || instance[first] != instance[t]) continue;
                cell_around(centre, scale, vertices, triangles + 3 * first, size, there);
                there[3] ^= flipped[first];
                if (memcmp(cell, there, sizeof cell)) continue;
            }
            for_small[t] = slots[at];
            break;
        }
    }
    return 0;
}
