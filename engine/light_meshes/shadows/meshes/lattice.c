/* Finds the nodes near receivers: steps 1 and 2 of Ψ, as described in lattice.py. */
#include <stdlib.h>

#include "../../support/four.h"

KERNEL(lattice_positions, "h f64  rotation f64[3,3]  origin f64[3]  nodes i32[n,3]  out f64[n,3]!")
i64 lattice_positions(i64 n, f64 h, const f64 *R, const f64 *origin, const i32 *nodes, f64 *out) {
    for (i64 k = 0; k < n; k++) {
        f64 a = nodes[3 * k], b = nodes[3 * k + 1], c = nodes[3 * k + 2];
        for (int r = 0; r < 3; r++)
            out[3 * k + r] = origin[r] + h * (R[3 * r] * a + R[3 * r + 1] * b + R[3 * r + 2] * c);
    }
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

KERNEL(lattice_fill, "table i32[t]!  keys i32[n,3]  count i64")
i64 lattice_fill(i64 t, i64 n, i32 *table, const i32 *keys, i64 count) {
    (void)n;
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

/* Finds the candidates of receivers from state[0] on, until all are done or an array may be too short. state: the
   next receiver, and the numbers of cells, nodes and candidates. rows (cells, offsets): which node is at an offset
   from the cell; −1: not looked up yet. Returns 1 if there is not enough memory. */
KERNEL(lattice_candidates,
       "h f64  reach f64[K]  rotation f64[3,3]  origin f64[3]  offsets f64[3,c]  tau f64  P f64[n,3]  N f64[n,3]  "
       "state i64[4]!  start i64[n,s]!  candidate i32[a]!  nodes i32[u,3]!  table i32[t]!  cells i32[n,3]!  "
       "rows i32[n,c]!  cell_table i32[e]!")
i64 lattice_candidates(i64 K, i64 most, i64 n, i64 stride, i64 a, i64 u, i64 t, i64 e, f64 h, const f64 *reach,
                       const f64 *R, const f64 *origin, const f64 *offsets, f64 tau, const f64 *P, const f64 *N,
                       i64 *state, i64 *start, i32 *candidate, i32 *nodes, i32 *table, i32 *cells, i32 *rows,
                       i32 *cell_table) {
    const f64 *off0 = offsets, *off1 = offsets + most, *off2 = offsets + 2 * most;
    i64 p = state[0], cell_count = state[1], count = state[2], total = state[3];
    f64 largest = reach[K - 1] * reach[K - 1];
    Offsets all;
    Above apart = {0};
    int room = room_for(&all, most) & room_for(&apart.some, most);
    i32 *passed = malloc((size_t)(fours(most) + 4) * sizeof *passed), *ring = malloc((size_t)most * sizeof *ring);
    i32 *unsorted = malloc((size_t)most * sizeof *unsorted);
    i64 *place = malloc((size_t)K * sizeof *place);
    room = room && passed && ring && unsorted && place;
    if (!room) goto end;
    for (i64 c = 0; c < most; c++) add_offset(&all, off0[c], off1[c], off2[c], (i32)c);
    pad(&all);
    for (; p < n && total + most <= a && count + most <= u; p++) {
        const f64 *normal = N + 3 * p;
        f64 x = (P[3 * p] - origin[0]) / h, y = (P[3 * p + 1] - origin[1]) / h, z = (P[3 * p + 2] - origin[2]) / h;
        /* The receiver and its normal in lattice coordinates, and its cell */
        f64 q[3], m[3], base[3];
        for (int r = 0; r < 3; r++) {
            q[r] = R[r] * x + R[3 + r] * y + R[6 + r] * z;
            m[r] = R[r] * normal[0] + R[3 + r] * normal[1] + R[6 + r] * normal[2];
            base[r] = floor(q[r]);
        }
        i64 *begin = start + stride * p;
        begin[0] = total;
        /* There are no nodes beyond 32 bits: such a receiver gets an empty set, and so a sharp shadow. */
        if (fabs(base[0]) < 2e9 && fabs(base[1]) < 2e9 && fabs(base[2]) < 2e9) {
            f64 f0 = q[0] - base[0], f1 = q[1] - base[1], f2 = q[2] - base[2];
            i32 i0 = (i32)base[0], i1 = (i32)base[1], i2 = (i32)base[2];
            /* The cell's row: receivers of one cell share the nodes that were looked up */
            i64 slot = find(e, cell_table, cells, i0, i1, i2);
            i64 cell = cell_table[slot];
            if (cell < 0) {
                cell = cell_count++;
                cells[3 * cell] = i0, cells[3 * cell + 1] = i1, cells[3 * cell + 2] = i2;
                cell_table[slot] = (i32)cell;
                for (i64 c = 0; c < most; c++) rows[cell * most + c] = -1;
            }
            /* Steps 1 and 2: which offsets are in the ball and above the plane? */
            i32 *row_at = rows + cell * most;
            const Offsets *tried = above(&apart, &all, m, tau);
            i64 kept = inside(tried, (f64[3]){f0, f1, f2}, m, largest, tau, passed);
            /* The node at each of them; mostly all have been looked up for another receiver of the cell */
            i32 unknown = 0;
            for (i64 w = 0; w < kept; w++) unknown |= candidate[total + w] = row_at[passed[w]];
            for (i64 w = 0; unknown < 0 && w < kept; w++) {
                i64 c = passed[w], row = row_at[c];
                if (row < 0) {
                    i32 i = i0 + (i32)off0[c], j = i1 + (i32)off1[c], k = i2 + (i32)off2[c];
                    i64 at = find(t, table, nodes, i, j, k);
                    row = table[at];
                    if (row < 0) {
                        row = count++;
                        nodes[3 * row] = i, nodes[3 * row + 1] = j, nodes[3 * row + 2] = k;
                        table[at] = (i32)row;
                    }
                    row_at[c] = (i32)row;
                }
                candidate[total + w] = (i32)row;
            }
            for (i64 w = 0; K > 1 && w < kept; w++) {  /* its ring */
                f64 d0 = off0[passed[w]] - f0, d1 = off1[passed[w]] - f1, d2 = off2[passed[w]] - f2;
                f64 d = d0 * d0 + d1 * d1 + d2 * d2;
                i64 g = 0;
                while (d > reach[g] * reach[g]) g++;
                ring[w] = (i32)g;
                begin[g + 1]++;
            }
            if (K == 1) begin[1] = kept;
            total += kept;
        }
        for (i64 g = 0; g < K; g++) begin[g + 1] += begin[g];
        if (K > 1) by_ring(K, begin, total - begin[0], ring, candidate + begin[0], unsorted, place);
    }
    state[0] = p, state[1] = cell_count, state[2] = count, state[3] = total;
end:
    free(all.xyz), free(all.number), free(apart.some.xyz), free(apart.some.number);
    free(passed), free(ring), free(unsorted), free(place);
    return !room;
}
