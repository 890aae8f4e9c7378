/* Finds the nodes near receivers: steps 1 and 2 of Ψ, as described in lattice.py. */
#include <stdlib.h>

#include "../../support/four.h"
#include "averaging.h"

static inline void place_node(f64 h, const f64 *R, const f64 *origin, const i32 *node, f64 *out) {
    f64 a = node[0], b = node[1], c = node[2];
    for (int r = 0; r < 3; r++) out[r] = origin[r] + h * (R[3 * r] * a + R[3 * r + 1] * b + R[3 * r + 2] * c);
}

KERNEL(lattice_positions, "h f64  rotation f64[3,3]  origin f64[3]  nodes i32[n,3]  out f64[n,3]!")
i64 lattice_positions(i64 n, f64 h, const f64 *R, const f64 *origin, const i32 *nodes, f64 *out) {
    for (i64 k = 0; k < n; k++) place_node(h, R, origin, nodes + 3 * k, out + 3 * k);
    return 0;
}

static inline u64 hash(i32 i, i32 j, i32 k) {
    u64 x = (u64)(u32)i * SPREAD;
    x ^= (u64)(u32)j * SPREAD_2;
    x ^= (u64)(u32)k * SPREAD_3;
    x ^= x >> 29;
    x *= MIX;
    return x ^ x >> 32;
}

/* Returns the slot of the hash table that holds node (i,j,k), or the free slot where it belongs. */
static inline i64 find(i64 size, const i32 *table, const i32 *keys, i32 i, i32 j, i32 k) {
    u64 mask = (u64)size - 1, slot = hash(i, j, k) & mask;
    for (;; slot = (slot + 1) & mask) {
        i64 row = table[slot];
        const i32 *key = keys + 3 * row;
        if (row < 0 || (key[0] == i && key[1] == j && key[2] == k)) return (i64)slot;
    }
}

/* Fills a hash table with the first `count` nodes. */
KERNEL(lattice_fill, "table i32[t]!  keys i32[n,3]  count i64"
       ";  power(t)  0<=count<=n  count<t")
i64 lattice_fill(i64 t, i64 n, i32 *table, const i32 *keys, i64 count) {
    (void)n;
    memset(table, 255, (size_t)t * sizeof *table);
    for (i64 row = 0; row < count; row++)
        table[find(t, table, keys, keys[3 * row], keys[3 * row + 1], keys[3 * row + 2])] = (i32)row;
    return 0;
}

/* Sorts a receiver's candidates by ring; within a ring they keep their order. */
static void by_ring(i64 rings, const i64 *start, i64 count, const i32 *ring, i32 *candidate, i32 *unsorted, i64 *place) {
    memcpy(unsorted, candidate, (size_t)count * sizeof *candidate);
    for (i64 g = 0; g < rings; g++) place[g] = start[g] - start[0];
    for (i64 c = 0; c < count; c++) candidate[place[ring[c]]++] = unsorted[c];
}

static const i32 WHICH[16][4] = {{0}, {0}, {1}, {0, 1}, {2}, {0, 2}, {1, 2}, {0, 1, 2},
                                 {3}, {0, 3}, {1, 3}, {0, 1, 3}, {2, 3}, {0, 2, 3}, {1, 2, 3}, {0, 1, 2, 3}};

/* Puts those of four numbers whose bits are set first, and anything behind them. */
static inline void put_first(const i32 *four, u32 bits, i32 *out) {
#ifdef __AVX__
    typedef f32 Floats __attribute__((vector_size(16)));
    typedef i32 Numbers __attribute__((vector_size(16)));
    Floats numbers;
    Numbers which;
    memcpy(&numbers, four, sizeof numbers), memcpy(&which, WHICH[bits], sizeof which);
    numbers = __builtin_ia32_vpermilvarps(numbers, which);
    memcpy(out, &numbers, sizeof numbers);
#else
    for (int k = 0; k < 4; k++) out[k] = four[WHICH[bits][k]];
#endif
}

/* Some of the lattice's offsets: a multiple of 4 of them, the last of which may be at infinity and so in no ball. */
typedef struct {
    i64 n, most;     /* how many there are, and how many of all */
    f64 *xyz;        /* x of all, then y, then z: (3,most) */
    i32 *number;     /* in the lattice's own order */
} Offsets;

static i64 fours(i64 n) { return (n + 3) / 4 * 4; }

/* Returns whether there is memory for `most` offsets. */
static int room_for(Offsets *o, i64 most) {
    o->n = 0, o->most = fours(most);
    o->xyz = malloc((size_t)(3 * o->most) * sizeof *o->xyz);
    o->number = malloc((size_t)o->most * sizeof *o->number);
    return o->xyz && o->number;
}

static void add_offset(Offsets *o, f64 x, f64 y, f64 z, i32 number) {
    o->xyz[o->n] = x, o->xyz[o->most + o->n] = y, o->xyz[2 * o->most + o->n] = z;
    o->number[o->n++] = number;
}

static void pad(Offsets *o) {
    while (o->n < fours(o->n)) add_offset(o, INFINITY, INFINITY, INFINITY, 0);
}

/* Fills passed with the numbers of the offsets within `largest` (squared) of f and above the plane through f with normal
   m, and what follows with anything; returns how many there are. Without a branch, which no processor could foretell. */
static i64 inside(const Offsets *o, const f64 *f, const f64 *m, f64 largest, f64 tau, i32 *passed) {
    const f64 *x = o->xyz, *y = x + o->most, *z = y + o->most;
    i64 kept = 0;
    for (i64 c = 0; c < o->n; c += 4) {
        Four d0 = four_of(x + c) - f[0], d1 = four_of(y + c) - f[1], d2 = four_of(z + c) - f[2];
        u32 bits = bits_of((d0 * d0 + d1 * d1 + d2 * d2 <= largest) & (d0 * m[0] + d1 * m[1] + d2 * m[2] > tau));
        put_first(o->number + c, bits, passed + kept);
        kept += __builtin_popcount(bits);
    }
    return kept;
}

/* The offsets that may be above planes of one normal. Most receivers have the normal of those before them, and half of all
   offsets need not be tested for them. */
typedef struct {
    Offsets some;
    f64 normal[3], last[3];
    i64 in_a_row;  /* how many receivers had the last normal */
} Above;

static const i64 AGAIN = 3;        /* from so many in a row on it pays to find the offsets */
static const f64 ROUNDING = 1e-9;  /* in steps: more than all rounding of `inside` */

static int same(const f64 *a, const f64 *b) { return a[0] == b[0] && a[1] == b[1] && a[2] == b[2]; }

/* Returns all offsets that can be above a plane with normal m through a point of the cell, and perhaps others. */
static const Offsets *above(Above *a, const Offsets *all, const f64 *m, f64 tau) {
    Offsets *some = &a->some;
    if (same(a->normal, m)) return some;
    a->in_a_row = same(a->last, m) ? a->in_a_row + 1 : 0;
    memcpy(a->last, m, sizeof a->last);
    if (a->in_a_row < AGAIN) return all;
    memcpy(a->normal, m, sizeof a->normal);
    f64 low = tau - ROUNDING, *x = all->xyz, *y = x + all->most, *z = y + all->most;
    for (int r = 0; r < 3; r++) low += m[r] < 0.0 ? m[r] : 0.0;  /* the cell's lowest corner */
    some->n = 0;
    for (i64 c = 0; c < all->n; c++)
        if (x[c] * m[0] + y[c] * m[1] + z[c] * m[2] > low) add_offset(some, x[c], y[c], z[c], all->number[c]);
    pad(some);
    return some;
}

/* A hash table and its keys (…,3), of which there are `count`. */
typedef struct {
    i64 size, count;
    i32 *slots, *keys;
} Table;

/* Returns the row of a key, which is entered if it is not there; *entered says whether it was. */
static i64 row_of(Table *t, i32 i, i32 j, i32 k, int *entered) {
    i64 slot = find(t->size, t->slots, t->keys, i, j, k), row = t->slots[slot];
    *entered = row < 0;
    if (row >= 0) return row;
    row = t->count++;
    t->keys[3 * row] = i, t->keys[3 * row + 1] = j, t->keys[3 * row + 2] = k;
    t->slots[slot] = (i32)row;
    return row;
}

/* A receiver in lattice coordinates: its cell, where it is in it, and its normal. There are no nodes beyond 32 bits (there:
   0): such a receiver gets an empty set, and so a sharp shadow. */
typedef struct {
    f64 f[3], m[3];
    i32 cell[3];
    int there;
} Spot;

static Spot spot_of(f64 h, const f64 *R, const f64 *origin, const f64 *P, const f64 *normal) {
    Spot s = {.there = 1};
    f64 x = (P[0] - origin[0]) / h, y = (P[1] - origin[1]) / h, z = (P[2] - origin[2]) / h;
    for (int r = 0; r < 3; r++) {
        f64 q = R[r] * x + R[3 + r] * y + R[6 + r] * z, base = floor(q);
        s.m[r] = R[r] * normal[0] + R[3 + r] * normal[1] + R[6 + r] * normal[2];
        s.f[r] = q - base;
        s.there &= fabs(base) < 2e9;
        s.cell[r] = fabs(base) < 2e9 ? (i32)base : 0;
    }
    return s;
}

/* The memory that the receivers of a call use one after the other. */
typedef struct {
    Offsets all;
    Above apart;
    i32 *passed, *ring, *unsorted;
    i64 *place;
} Scratch;

/* Returns whether there is memory for it. */
static int scratch_for(Scratch *s, const f64 *offsets, i64 most, i64 K) {
    int room = room_for(&s->all, most) & room_for(&s->apart.some, most);
    s->passed = malloc((size_t)(fours(most) + 4) * sizeof *s->passed), s->ring = malloc((size_t)most * sizeof *s->ring);
    s->unsorted = malloc((size_t)most * sizeof *s->unsorted), s->place = malloc((size_t)K * sizeof *s->place);
    if (!room || !s->passed || !s->ring || !s->unsorted || !s->place) return 0;
    for (i64 c = 0; c < most; c++) add_offset(&s->all, offsets[c], offsets[most + c], offsets[2 * most + c], (i32)c);
    pad(&s->all);
    return 1;
}

static void free_scratch(Scratch *s) {
    free(s->all.xyz), free(s->all.number), free(s->apart.some.xyz), free(s->apart.some.number);
    free(s->passed), free(s->ring), free(s->unsorted), free(s->place);
}

/* Fills candidate with the nodes at the offsets `passed` from a cell. at: the cell's row of `rows`. Mostly all have been looked
   up for another receiver of the cell. */
static void look_up(Table *nodes, const f64 *offsets, i64 most, const i32 *cell, const i32 *passed, i64 kept, i32 *at,
                    i32 *candidate) {
    i32 unknown = 0;
    for (i64 w = 0; w < kept; w++) unknown |= candidate[w] = at[passed[w]];
    for (i64 w = 0; unknown < 0 && w < kept; w++) {
        i64 c = passed[w];
        int entered;
        if (at[c] < 0)
            at[c] = (i32)row_of(nodes, cell[0] + (i32)offsets[c], cell[1] + (i32)offsets[most + c],
                                cell[2] + (i32)offsets[2 * most + c], &entered);
        candidate[w] = at[c];
    }
}

/* Fills ring with that of each of the offsets `passed`, and adds to size how many each ring has. */
static void find_rings(const f64 *offsets, i64 most, const f64 *f, const f64 *reach, const i32 *passed, i64 kept, i32 *ring,
                       i64 *size) {
    for (i64 w = 0; w < kept; w++) {
        i64 c = passed[w], g = 0;
        f64 d0 = offsets[c] - f[0], d1 = offsets[most + c] - f[1], d2 = offsets[2 * most + c] - f[2];
        f64 d = d0 * d0 + d1 * d1 + d2 * d2;
        while (d > reach[g] * reach[g]) g++;
        ring[w] = (i32)g;
        size[g]++;
    }
}

/* The cells in which receivers are, and for each which node is at each offset from it; −1: not looked up yet. */
typedef struct {
    Table cells;
    i64 room, most;
    i32 *rows;  /* (room,most) */
} Places;

/* Makes room for more cells, or for the first ones; returns whether there is memory. */
static int grow_places(Places *c) {
    i64 room = c->room ? 2 * c->room : 256, size = 4 * room;
    i32 *keys = realloc(c->cells.keys, (size_t)(3 * room) * sizeof *keys), *rows, *slots;
    if (keys) c->cells.keys = keys;
    rows = realloc(c->rows, (size_t)(room * c->most) * sizeof *rows);
    if (rows) c->rows = rows;
    slots = realloc(c->cells.slots, (size_t)size * sizeof *slots);
    if (slots) c->cells.slots = slots;
    if (!keys || !rows || !slots) return 0;
    c->room = room, c->cells.size = size;
    lattice_fill(size, room, slots, keys, c->cells.count);
    return 1;
}

/* Returns the row of a cell; NULL if there is not enough memory. */
static i32 *place_of(Places *c, const i32 *cell) {
    int entered;
    if (c->cells.count == c->room && !grow_places(c)) return 0;
    i32 *row = c->rows + c->most * row_of(&c->cells, cell[0], cell[1], cell[2], &entered);
    if (entered) memset(row, 255, (size_t)c->most * sizeof *row);
    return row;
}

/* Finds the candidates of receivers from state[0] on, until all are done or an array may be too short. state: the
   next receiver, and the numbers of nodes and candidates. Fills the positions of nodes, and `need` with the lights that
   receivers ask for there, of those in active; serve: of each ring. Returns 1 if there is not enough memory. */
KERNEL(lattice_candidates,
       "h f64  reach f64[K]  rotation f64[3,3]  origin f64[3]  offsets f64[3,c]  tau f64  P f64[n,3]  N f64[n,3]  "
       "active u64[n,W]  serve u64[K,W]  state i64[3]!  start i64[n,s]!  candidate i32[a]!  nodes i32[u,3]!  "
       "position f64[u,3]!  need u64[u,W]!  table i32[t]!"
       ";  1<=K  s=K+1  power(t)  u<t  0<h<inf  0<=state")
i64 lattice_candidates(i64 K, i64 most, i64 n, i64 W, i64 stride, i64 a, i64 u, i64 t, f64 h, const f64 *reach,
                       const f64 *R, const f64 *origin, const f64 *offsets, f64 tau, const f64 *P, const f64 *N,
                       const u64 *active, const u64 *serve, i64 *state, i64 *start, i32 *candidate, i32 *nodes,
                       f64 *position, u64 *need, i32 *table) {
    Table node_of = {t, state[1], table, nodes};
    Places places = {.most = most};
    i64 p = state[0], total = state[2];
    Scratch s = {0};
    int room = scratch_for(&s, offsets, most, K);
    if (p == 0) memset(table, 255, (size_t)t * sizeof *table);
    for (; room && p < n && total + most <= a && node_of.count + most <= u; p++) {
        Spot spot = spot_of(h, R, origin, P + 3 * p, N + 3 * p);
        i64 *begin = start + stride * p, known = node_of.count;
        memset(begin, 0, (size_t)stride * sizeof *begin);
        begin[0] = total;
        if (spot.there) {
            i32 *at = place_of(&places, spot.cell);
            if (!at) {
                room = 0;
                break;
            }
            /* Steps 1 and 2: which offsets are in the ball and above the plane? */
            const Offsets *tried = above(&s.apart, &s.all, spot.m, tau);
            i64 kept = inside(tried, spot.f, spot.m, reach[K - 1] * reach[K - 1], tau, s.passed);
            look_up(&node_of, offsets, most, spot.cell, s.passed, kept, at, candidate + total);
            if (K == 1) begin[1] = kept;
            else find_rings(offsets, most, spot.f, reach, s.passed, kept, s.ring, begin + 1);
            total += kept;
        }
        for (i64 g = 0; g < K; g++) begin[g + 1] += begin[g];
        if (K > 1) by_ring(K, begin, total - begin[0], s.ring, candidate + begin[0], s.unsorted, s.place);
        for (; known < node_of.count; known++) {
            place_node(h, R, origin, nodes + 3 * known, position + 3 * known);
            memset(need + W * known, 0, (size_t)W * sizeof *need);
        }
        ask_for(begin, candidate, active + p * W, serve, K, W, need);
    }
    state[0] = p, state[1] = node_of.count, state[2] = total;
    free_scratch(&s), free(places.cells.keys), free(places.cells.slots), free(places.rows);
    return !room;
}
