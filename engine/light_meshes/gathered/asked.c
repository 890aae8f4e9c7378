/* How receivers take light from the records around them (records.py). */
#include "grids.h"
#include "leaning.h"
#include "sectors.h"
#include "table.h"

#define UPPER ((u64)1 << 62)  /* the key of a cell is that of its first point; of its upper half, with this bit */
#define FLATS 16              /* triangles, */
#define CELLS 256             /* and halves of cells, that are kept while receivers near each other ask for them */

/* The records of a scene, how they are asked, and what is known of cells. */
typedef struct {
    const f64 *centre;
    f64 scale, coarse;
    const f32 *vertices, *longest;
    const i32 *triangles, *other, *corner;
    const u8 *flipped;
    const i32 *slots, *cell_slots;
    const u64 *entered, *cell_entered;
    i64 s, q, r, cs, cq, c;
    const f32 *inverse, *nearest, *mean, *open;
    const u8 *done, *clear;
    const u32 *sectors;
    const f64 *M;
    f64 within, strict, fine, end;
    i64 last;
} Records;

/* What a receiver asks for: what a matt surface with the normal N returns, or the mean over a lobe of a surface that is
   seen along `way`, of microfacets with this roughness. */
typedef struct {
    const f64 *N, *way;
    f64 alpha;
    const Middles *middles;
} Lobe;

/* A triangle, and the grids on it. */
typedef struct {
    i64 t, lead, base;             /* t: −1, none yet; base: how fine the coarsest grid is; −1: its corners */
    f64 normal[3], O[3], a[3], b[3], u, v;  /* a place is at (place − O)·a, (place − O)·b of the axes */
    i64 m[16], n[16];              /* parts at a fineness; 0: not known yet */
    f64 spacing[16];
    int second;
} Flat;

/* Half of a cell: the three records at its corners. */
typedef struct {
    u64 name, key[3];              /* name: ~key of the half; 0: none yet */
    i64 number[3];
    f64 spacing, inverse[3], limit;
    int missing, ready, close, clear;  /* clear: 0, not known yet; 1: all that is in it sees all three; 2: perhaps not */
} Half;

typedef struct {
    Flat flat[FLATS];
    Half half[CELLS];
} Kept;

static void enter_flat(const Records *r, i64 t, Flat *out) {
    Grid g = undivided(r->vertices, r->triangles, r->other, r->scale, t);
    f64 size, *N = out->normal;
    cross(g.axes.U, g.axes.V, N);
    f64 by = dot(N, N);
    cross(g.axes.V, N, out->a), cross(N, g.axes.U, out->b);
    for (int j = 0; j < 3; j++) {
        out->O[j] = g.axes.O[j];
        out->a[j] = by > 0.0 ? out->a[j] / by : 0.0, out->b[j] = by > 0.0 ? out->b[j] / by : 0.0;
    }
    out->t = t, out->lead = g.lead, out->u = g.u, out->v = g.v, out->second = g.axes.second;
    out->base = lattice(r->longest[t], r->coarse, 0, &size);
    memset(out->m, 0, sizeof out->m);
}

/* Enters what is known of half a cell whose keys and spacing are there. */
static void enter_half(const Records *r, Half *h) {
    f64 near = 1e30;
    h->limit = h->spacing > 6.0 * r->fine ? r->strict : r->within;
    h->missing = h->close = 0, h->ready = 1, h->clear = -1;
    for (int c = 0; c < 3; c++) {
        i64 of = h->number[c] = known_number(r->slots, r->s, r->entered, r->q, h->key[c]);
        if (of < 0 || of >= r->r) {
            h->missing = 1;
            continue;
        }
        h->ready &= __atomic_load_n(r->done + of, __ATOMIC_ACQUIRE);
        f64 most = 8.0 * h->limit / h->spacing, here = r->inverse[of];  /* one must not spoil all around it */
        h->inverse[c] = here < most ? here : most;
        near = r->nearest[of] < near ? r->nearest[of] : near;
    }
    h->close = near < 1.5 * h->spacing;
}

static Half *half_of(Kept *kept, u64 key) { return kept->half + (spread(key) >> 20 & (CELLS - 1)); }

/* The triangle's corners, as a half of a cell, and the weights w of a place (in the frame) there. */
static Half *corners_around(const Records *r, Kept *kept, i64 t, const f64 *place, int front, f64 *w) {
    f64 normal[3], q[3], a[3], b[3];
    Edges s = edges_of(r->vertices, r->triangles + 3 * t);
    for (int j = 0; j < 3; j++) q[j] = place[j] - s.a[j];
    cross(s.e, s.f, normal), cross(q, s.f, a), cross(s.e, q, b);
    f64 square_of = dot(normal, normal), u = dot(a, normal) / square_of, v = dot(b, normal) / square_of;
    u = u < 0.0 ? 0.0 : u > 1.0 ? 1.0 : u, v = v < 0.0 ? 0.0 : v > 1.0 - u ? 1.0 - u : v;
    w[0] = 1.0 - u - v, w[1] = u, w[2] = v;
    u64 key = CORNER | UPPER | (u64)front << 31 | (u64)t;
    Half *h = half_of(kept, key);
    if (h->name == ~key) return h;
    for (int c = 0; c < 3; c++) h->key[c] = CORNER | (u64)front << 31 | (u64)r->corner[3 * t + c];
    h->name = ~key, h->spacing = r->longest[t];
    enter_half(r, h);
    h->clear = 2;
    return h;
}

/* The half of a cell in which a place on the axes, xy, is, and the weights w of its records. depth: how fine the grid is. */
static Half *half_around(const Records *r, Kept *kept, Flat *f, int depth, const f64 *xy, int front, f64 *w) {
    if (!f->m[depth]) {
        f64 size = edge(r->coarse, depth);
        f->m[depth] = parts_of(f->u, size), f->n[depth] = parts_of(f->v, size);
        f->spacing[depth] = sqrt(square(f->u / (f64)f->m[depth]) + square(f->v / (f64)f->n[depth]));
    }
    f64 x = xy[0] * (f64)f->m[depth], y = xy[1] * (f64)f->n[depth];
    i64 i = (i64)x, j = (i64)y;
    if (i > f->m[depth] - 1) i = f->m[depth] - 1;
    if (j > f->n[depth] - 1) j = f->n[depth] - 1;
    x -= (f64)i, y -= (f64)j;
    int upper = x + y > 1.0;
    w[0] = upper ? x + y - 1.0 : 1.0 - x - y, w[1] = upper ? 1.0 - y : x, w[2] = upper ? 1.0 - x : y;
    u64 key = key_at(f->lead, front, depth, i, j) | (upper ? UPPER : 0);
    Half *h = half_of(kept, key);
    if (h->name == ~key) return h;
    h->key[0] = key_at(f->lead, front, depth, i + upper, j + upper);
    h->key[1] = key_at(f->lead, front, depth, i + 1, j), h->key[2] = key_at(f->lead, front, depth, i, j + 1);
    h->name = ~key, h->spacing = f->spacing[depth];
    enter_half(r, h);
    return h;
}

/* How far a receiver trusts three records, from 0 to 1: `limit` is what spacing·inverse may be. */
static f64 trust_of(const Half *h, const f64 *w, f64 fine) {
    if (h->spacing <= fine) return 1.0;
    f64 one = w[0] * h->inverse[0] + w[1] * h->inverse[1] + w[2] * h->inverse[2];
    if (0.75 * h->spacing * one >= h->limit) return 0.0;
    f64 t = (h->limit / (h->spacing * one + 1e-300) - 0.75) / 0.5;
    t = t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t;
    return t * t * (3.0 - 2.0 * t);
}

/* Adds share·trust of what the visible ones of three records say of a lobe to light, and takes it from share.
   Where none is visible nothing is taken, but where `end` is set: then all count. */
static void blend(const Records *r, const Half *h, const f64 *weight, const u8 *visible, f64 trust, int end,
                  const Lobe *lobe, f64 *share, f64 *light, f64 *sky) {
    f64 w[3], sum = 0.0, found[3] = {0}, part = *share * trust, free = 0.0;
    for (int c = 0; c < 3; c++) {
        w[c] = visible && !visible[c] ? 0.0 : weight[c];
        sum += w[c];
    }
    if (sum < 0.02) {
        if (!end) return;
        sum = 1.0;
        for (int c = 0; c < 3; c++) w[c] = weight[c];
    }
    for (int c = 0; c < 3; c++) {
        f64 one[3], by = part * w[c] / sum;
        i64 of = h->number[c];
        if (by == 0.0) continue;
        if (lobe->way)
            lobe_mean(r->sectors + SECTORS * of, lobe->middles, r->M + 3 * of, lobe->N, lobe->way, lobe->alpha, one);
        else leaning(r->mean + 15 * of, r->M + 3 * of, lobe->N, one);
        for (int j = 0; j < 3; j++) found[j] += by * one[j];
        free += by * r->open[of];
    }
    for (int j = 0; j < 3; j++) light[j] += found[j];
    *sky += free, *share -= part;
}

/* Where P is in the frame, and on the axes of a triangle's grids. */
static void on_grids(const Flat *flat, const f64 *P, const f64 *centre, f64 scale, f64 *place, f64 *xy) {
    xy[0] = xy[1] = 0.0;
    for (int j = 0; j < 3; j++) {
        place[j] = (P[j] - centre[j]) / scale;
        xy[0] += (place[j] - flat->O[j]) * flat->a[j], xy[1] += (place[j] - flat->O[j]) * flat->b[j];
    }
    for (int j = 0; j < 2; j++) {
        if (flat->second) xy[j] = 1.0 - xy[j];
        xy[j] = xy[j] < 0.0 ? 0.0 : xy[j] > 1.0 ? 1.0 : xy[j];
    }
}

/* Whether all that is in half a cell sees all three records: 1; 2: perhaps not; 0: it is not known yet. */
static int clear_of(const Records *r, Half *h) {
    if (h->clear < 0) {
        i64 of = known_number(r->cell_slots, r->cs, r->cell_entered, r->cq, ~h->name);
        h->clear = of < 0 || of >= r->c ? 0 : __atomic_load_n(r->clear + of, __ATOMIC_ACQUIRE);
    }
    return h->clear;
}

/* What a receiver waits for: records that are not in the table; that are not computed; whether anything stands in half a
   cell; whether it sees the records. */
enum { NEW = 1, WANTED, CELL, SIGHT };

/* Lets receivers take light from the records around them, from the coarse to the fine, until no more than `enough` of
   their share is left, or they have to wait. way, alpha: None, or the lobes that they ask for (sectors.h). todo: receivers,
   state[0] of them; those that wait are put at its begin, and state[1] counts them; `why` says for what: then keys, or
   number, tell for which records, and `half` which half of a cell it is. level: of each receiver, 0 at first. seen: the
   level + 1 for which `visible` is known. Reads tables and records to which other threads add. */
KERNEL(records_asked,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  flipped bool[T]  longest f32[T]  "
       "corner i32[T,3]  coarse f64  slots i32[s]  entered u64[q]  inverse f32[r]  nearest f32[r]  done bool[r]  M f64[r,3]  "
       "mean f32[r,5,3]  open f32[r]  sectors u32[r,64]?  cell_slots i32[e]  cell_entered u64[f]  clear u8[c]  within f64  "
       "strict f64  fine f64  end f64  last i64  enough f64  triangle i32[n]  P f64[n,3]  Ng f64[n,3]  Ns f64[n,3]  way f64[n,3]?  alpha f64[n]?  "
       "level i32[n]!  share f64[n]!  light f64[n,3]!  sky f64[n]!  keys u64[n,3]!  "
       "number i32[n,3]!  weight f64[n,3]!  visible bool[n,3]  seen i32[n]  why u8[n]!  half u64[n]!  todo i32[n]!  "
       "state i64[2]!"
       ";  power(s)  power(e)  0<coarse<inf  0<=level  0<=triangle<T  0<=state;  0<=triangles<V  -1<=other<T  "
       "-1<=corner")
i64 records_asked(i64 V, i64 T, i64 s, i64 q, i64 r, i64 e, i64 f, i64 c, i64 n, const f64 *centre, f64 scale,
                  const f32 *vertices, const i32 *triangles, const i32 *other, const u8 *flipped, const f32 *longest,
                  const i32 *corner, f64 coarse, const i32 *slots, const u64 *entered, const f32 *inverse,
                  const f32 *nearest, const u8 *done, const f64 *M, const f32 *mean, const f32 *open,
                  const u32 *sectors, const i32 *cell_slots, const u64 *cell_entered, const u8 *clear, f64 within,
                  f64 strict, f64 fine, f64 end, i64 last, f64 enough, const i32 *triangle, const f64 *P, const f64 *Ng, const f64 *Ns,
                  const f64 *way, const f64 *alpha, i32 *level, f64 *share, f64 *light, f64 *sky, u64 *keys, i32 *number,
                  f64 *weight, const u8 *visible, const i32 *seen, u8 *why, u64 *half, i32 *todo, i64 *state) {
    Records of = {centre, scale, coarse, vertices, longest, triangles, other, corner, flipped, slots, cell_slots, entered,
                  cell_entered, s, q, r, e, f, c, inverse, nearest, mean, open, done, clear, sectors, M, within,
                  strict, fine, end, last};
    Kept kept;
    Middles middles;
    (void)V, (void)T;
    if (state[0] > n || (way && !(sectors && alpha))) return OUTSIDE;
    if (way) sectors_middles(&middles);
    state[1] = 0;
    for (int k = 0; k < FLATS; k++) kept.flat[k].t = -1;
    for (int k = 0; k < CELLS; k++) kept.half[k].name = 0;
    for (i64 at = 0; at < state[0]; at++) {
        i64 k = todo[at];
        if (k < 0 || k >= n) return OUTSIDE;
        i64 t = triangle[k];
        Flat *flat = kept.flat + (t & (FLATS - 1));
        f64 place[3], xy[2];
        if (flat->t != t) enter_flat(&of, t, flat);
        on_grids(flat, P + 3 * k, centre, scale, place, xy);
        int front = (dot(flat->normal, Ng + 3 * k) > 0.0) != flipped[t];
        Lobe lobe = {Ns + 3 * k, way ? way + 3 * k : 0, way ? alpha[k] : 0.0, &middles};
        for (why[k] = 0; share[k] > enough && !why[k];) {
            f64 size, w[3];
            int depth = lattice(longest[t], coarse, level[k], &size);
            Half *h = depth < 0 ? corners_around(&of, &kept, t, place, front, w)
                                : half_around(&of, &kept, flat, depth, xy, front, w);
            f64 trust = h->missing ? 0.0 : trust_of(h, w, level[k] >= last ? INFINITY : fine);
            if (h->missing) why[k] = NEW;
            else if (trust > 0.0 && !h->ready) why[k] = WANTED;
            else if (trust > 0.0 && h->close && seen[k] != level[k] + 1) {
                int clear = clear_of(&of, h);
                why[k] = clear == 0 ? CELL : clear == 2 ? SIGHT : 0;
            }
            if (why[k]) {
                memcpy(keys + 3 * k, h->key, sizeof h->key), half[k] = ~h->name;
                for (int j = 0; j < 3; j++) number[3 * k + j] = (i32)h->number[j], weight[3 * k + j] = w[j];
                break;
            }
            if (trust > 0.0)
                blend(&of, h, w, h->close && h->clear != 1 ? visible + 3 * k : 0, trust,
                      h->spacing <= end || level[k] >= last, &lobe, share + k, light + 3 * k, sky + k);
            level[k]++;
        }
        if (why[k]) todo[state[1]++] = (i32)k;
    }
    return 0;
}
