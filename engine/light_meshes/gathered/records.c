/* Rays of records, what they gather, and how receivers take it from the records around them (records.py). */
#include "grids.h"
#include "table.h"

/* Sums up what the rays of each record found. tilted: by how much more each ray counts for normals that lean to four
   sides. number: of the patch that each met, whose light is a row of `patch`; −1: nothing, where the world has the light
   `sky`; from −2 down: a row, 0 on, of `extra`. mean (r,5,3): of light, for M and for these. inverse: mean of 1/distance, or that weighted by light if it is
   more. nearest: the shortest way; open: share of rays that hit nothing. */
KERNEL(records_sum,
       "distance f32[r,d]  number i32[r,d]  patch f64[m,3]  extra f64[e,3]  sky f64[3]  tilted f64[d,4]  mean f32[r,5,3]!  "
       "inverse f32[r]!  nearest f32[r]!  open f32[r]!")
i64 records_sum(i64 r, i64 d, i64 m, i64 e, const f32 *distance, const i32 *number, const f64 *patch, const f64 *extra,
                const f64 *sky, const f64 *tilted, f32 *mean, f32 *inverse, f32 *nearest, f32 *open) {
    (void)m, (void)e;
    for (i64 k = 0; k < r; k++) {
        f64 sum[5][3] = {{0}}, near = 0.0, bright = 0.0, all = 0.0, least = 1e30;
        i64 free = 0;
        for (i64 i = 0; i < d; i++) {
            i64 of = number[k * d + i];
            const f64 *L = of >= 0 ? patch + 3 * of : of == -1 ? sky : extra + 3 * (-2 - of);
            f64 far = distance[k * d + i], grey = L[0] + L[1] + L[2];
            for (int j = 0; j < 3; j++) {
                sum[0][j] += L[j];
                for (int c = 0; c < 4; c++) sum[1 + c][j] += tilted[4 * i + c] * L[j];
            }
            all += grey;
            if (far > 0.0) near += 1.0 / far, bright += grey / far, least = far < least ? far : least;
            else free++;
        }
        for (int c = 0; c < 5; c++)
            for (int j = 0; j < 3; j++) mean[15 * k + 3 * c + j] = (f32)(sum[c][j] / (f64)d);
        near /= (f64)d, bright = all > 0.0 ? bright / all : 0.0;
        inverse[k] = (f32)(bright > near ? bright : near), nearest[k] = (f32)least, open[k] = (f32)free / (f32)d;
    }
    return 0;
}

/* The light that a record gathers for another unit normal N than its own, M: a square law between the five. */
static void leaning(const f32 *mean, const f64 *M, const f64 *N, f64 *out) {
    f64 t[3], b[3];
    for (int j = 0; j < 3; j++) out[j] = mean[j];
    if (dot(M, N) > 1.0 - 1e-12) return;
    tangents(M, t, b);
    f64 p = dot(N, t), q = dot(N, b), reach = sqrt(p * p + q * q);
    if (dot(M, N) < 0.0 && reach > 0.0) p /= reach, q /= reach;
    for (int j = 0; j < 3; j++) {
        f64 slope_p = mean[3 + j] - mean[6 + j], slope_q = mean[9 + j] - mean[12 + j];
        f64 bend_p = 0.5 * (mean[3 + j] + mean[6 + j]) - mean[j], bend_q = 0.5 * (mean[9 + j] + mean[12 + j]) - mean[j];
        out[j] += p * slope_p + q * slope_q + 4.0 * (p * p * bend_p + q * q * bend_q);
        if (out[j] < 0.0) out[j] = 0.0;
    }
}

/* The records of a scene, and how they are asked. */
typedef struct {
    const f32 *inverse, *nearest, *mean, *open;
    const u8 *done;
    const f64 *M;
    f64 within, strict, fine, end;
    i64 last, count;
} Records;

/* The three records around a receiver at a level. */
typedef struct {
    u64 key[3];
    i64 number[3];
    f64 weight[3], spacing;
} Three;

/* Where a receiver is. */
typedef struct {
    Grid grid;
    f64 place[3], xy[2];
    int front, known;
} Place;

/* The keys of the three grid points around a receiver, and their weights. level: how much finer the grid is than the
   coarsest of its triangle. */
static void three_around(const f32 *vertices, const i32 *triangles, const i32 *other, f64 scale, const u8 *flipped,
                         const f32 *longest, const i32 *corner, f64 coarse, i64 level, i64 t, const f64 *Ng, Place *at,
                         Three *out) {
    f64 normal[3], size, *w = out->weight;
    u64 *key = out->key;
    int depth = lattice(longest[t], coarse, level, &size);
    if (depth < 0) {
        Edges s = edges_of(vertices, triangles + 3 * t);
        f64 q[3], a[3], b[3];
        for (int j = 0; j < 3; j++) q[j] = at->place[j] - s.a[j];
        cross(s.e, s.f, normal), cross(q, s.f, a), cross(s.e, q, b);
        f64 square_of = dot(normal, normal), u = dot(a, normal) / square_of, v = dot(b, normal) / square_of;
        int front = (dot(normal, Ng) > 0.0) != flipped[t];
        u = u < 0.0 ? 0.0 : u > 1.0 ? 1.0 : u, v = v < 0.0 ? 0.0 : v > 1.0 - u ? 1.0 - u : v;
        for (int c = 0; c < 3; c++) key[c] = CORNER | (u64)front << 31 | (u64)corner[3 * t + c];
        w[0] = 1.0 - u - v, w[1] = u, w[2] = v, out->spacing = longest[t];
        return;
    }
    Grid *g = &at->grid;
    i64 i, j;
    if (!at->known) {
        *g = undivided(vertices, triangles, other, scale, t);
        on_axes(&g->axes, at->place, at->xy), cross(g->axes.U, g->axes.V, normal);
        at->front = (dot(normal, Ng) > 0.0) != flipped[t], at->known = 1;
    }
    divide(g, size), cell_of(g, at->xy, &i, &j);
    f64 x = at->xy[0] * (f64)g->m - (f64)i, y = at->xy[1] * (f64)g->n - (f64)j;
    out->spacing = g->spacing;
    key[1] = key_at(g->lead, at->front, depth, i + 1, j), key[2] = key_at(g->lead, at->front, depth, i, j + 1);
    if (x + y > 1.0) {
        key[0] = key_at(g->lead, at->front, depth, i + 1, j + 1);
        w[0] = x + y - 1.0, w[1] = 1.0 - y, w[2] = 1.0 - x;
    } else {
        key[0] = key_at(g->lead, at->front, depth, i, j);
        w[0] = 1.0 - x - y, w[1] = x, w[2] = y;
    }
}

/* How far a receiver trusts three records, from 0 to 1, and whether something is so near that it may stand between them
   (close): `within` of spacing·inverse, or `strict` where records are far apart, so that many pixels hang on each. */
static f64 trust_of(const Records *r, const Three *a, f64 fine, int *close) {
    f64 one = 0.0, near = 1e30, limit = a->spacing > 6.0 * fine ? r->strict : r->within;
    for (int c = 0; c < 3; c++) {
        f64 most = 8.0 * limit / a->spacing, here = r->inverse[a->number[c]];  /* one must not spoil all around it */
        one += a->weight[c] * (here < most ? here : most);
        near = r->nearest[a->number[c]] < near ? r->nearest[a->number[c]] : near;
    }
    f64 x = limit / (a->spacing * one + 1e-300), t = (x - 0.75) / 0.5;
    t = t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t;
    *close = near < 1.5 * a->spacing;
    return a->spacing <= fine ? 1.0 : t * t * (3.0 - 2.0 * t);
}

/* Adds share·trust of what the visible ones of three records say for the normal N to light, and takes it from share.
   Where none is visible nothing is taken, but where `end` is set: then all count. */
static void blend(const Records *r, const Three *a, const u8 *visible, f64 trust, int end, const f64 *N, f64 *share,
                  f64 *light, f64 *sky) {
    f64 w[3], sum = 0.0, found[3] = {0}, part = *share * trust, free = 0.0;
    for (int c = 0; c < 3; c++) {
        w[c] = visible && !visible[c] ? 0.0 : a->weight[c];
        sum += w[c];
    }
    if (sum < 0.02) {
        if (!end) return;
        sum = 1.0;
        for (int c = 0; c < 3; c++) w[c] = a->weight[c];
    }
    for (int c = 0; c < 3; c++) {
        f64 one[3], by = part * w[c] / sum;
        i64 of = a->number[c];
        if (by == 0.0) continue;
        leaning(r->mean + 15 * of, r->M + 3 * of, N, one);
        for (int j = 0; j < 3; j++) found[j] += by * one[j];
        free += by * r->open[of];
    }
    for (int j = 0; j < 3; j++) light[j] += found[j];
    *sky += free, *share -= part;
}

/* What a receiver waits for: records that are not in the table; that are not computed; whether it sees them. */
enum { NEW = 1, WANTED, SIGHT };

/* Lets receivers take light from the records around them, from the coarse to the fine, until no more than `enough` of
   their share is left, or they have to wait. todo: receivers, state[0] of them; those that wait are put at its begin, and
   state[1] counts them; `why` says for what: then keys, or number, tell for which records. level: of each receiver, 0 at
   first. seen: the level + 1 for which `visible` is known. Reads a table and records to which other threads add. */
KERNEL(records_asked,
       "centre f64[3]  scale f64  vertices f32[V,3]  triangles i32[T,3]  other i32[T]  flipped bool[T]  longest f32[T]  "
       "corner i32[T,3]  coarse f64  slots i32[s]  entered u64[q]  inverse f32[r]  nearest f32[r]  done bool[r]  M f64[r,3]  "
       "mean f32[r,5,3]  open f32[r]  within f64  strict f64  fine f64  end f64  last i64  enough f64  triangle i32[n]  "
       "P f64[n,3]  Ng f64[n,3]  Ns f64[n,3]  level i32[n]!  share f64[n]!  light f64[n,3]!  sky f64[n]!  keys u64[n,3]!  "
       "number i32[n,3]!  weight f64[n,3]!  visible bool[n,3]  seen i32[n]  why u8[n]!  todo i32[n]!  state i64[2]!")
i64 records_asked(i64 V, i64 T, i64 s, i64 q, i64 r, i64 n, const f64 *centre, f64 scale, const f32 *vertices,
                  const i32 *triangles, const i32 *other, const u8 *flipped, const f32 *longest, const i32 *corner,
                  f64 coarse, const i32 *slots, const u64 *entered, const f32 *inverse, const f32 *nearest,
                  const u8 *done, const f64 *M, const f32 *mean, const f32 *open, f64 within, f64 strict, f64 fine,
                  f64 end, i64 last, f64 enough, const i32 *triangle, const f64 *P, const f64 *Ng, const f64 *Ns,
                  i32 *level, f64 *share, f64 *light, f64 *sky, u64 *keys, i32 *number, f64 *weight, const u8 *visible,
                  const i32 *seen, u8 *why, i32 *todo, i64 *state) {
    Records records = {inverse, nearest, mean, open, done, M, within, strict, fine, end, last, r};
    (void)V, (void)T, (void)n;
    state[1] = 0;
    for (i64 at = 0; at < state[0]; at++) {
        i64 k = todo[at], t = triangle[k];
        Place place = {.known = 0};
        for (int j = 0; j < 3; j++) place.place[j] = (P[3 * k + j] - centre[j]) / scale;
        for (why[k] = 0; share[k] > enough && !why[k];) {
            Three a;
            i64 depth = level[k];
            int close = 0, ready = 1;
            three_around(vertices, triangles, other, scale, flipped, longest, corner, coarse, depth, t, Ng + 3 * k,
                         &place, &a);
            for (int c = 0; c < 3; c++) {
                a.number[c] = known_number(slots, s, entered, q, a.key[c]);
                if (a.number[c] < 0 || a.number[c] >= r) why[k] = NEW;
                else ready &= __atomic_load_n(done + a.number[c], __ATOMIC_ACQUIRE);
            }
            if (why[k]) {
                memcpy(keys + 3 * k, a.key, sizeof a.key);
                break;
            }
            f64 trust = trust_of(&records, &a, depth >= last ? INFINITY : fine, &close);
            if (trust > 0.0 && !ready) why[k] = WANTED;
            if (trust > 0.0 && ready && close && seen[k] != depth + 1) why[k] = SIGHT;
            if (why[k]) {
                for (int c = 0; c < 3; c++)
                    number[3 * k + c] = (i32)a.number[c], weight[3 * k + c] = a.weight[c];
                break;
            }
            if (trust > 0.0)
                blend(&records, &a, close ? visible + 3 * k : 0, trust, a.spacing <= end || depth >= last, Ns + 3 * k,
                      share + k, light + 3 * k, sky + k);
            level[k]++;
        }
        if (why[k]) todo[state[1]++] = (i32)k;
    }
    return 0;
}
