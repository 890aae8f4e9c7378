/* Builds trees over beams, one for each group (beam_tree.py). p (B,3,2), d (B,3,2), z (B,3): corners and slopes of
   each beam's rays. */
#include <stdlib.h>

#include "../rays/boxes.h"

enum { BOUNDS = 11 };

static void widen(f64 *out, f64 low, f64 high) {
    out[0] = low < out[0] ? low : out[0];
    out[1] = high > out[1] ? high : out[1];
}

/* Computes the bounds of the beams order[first..end], with a margin. */
static void bound(const i64 *order, i64 first, i64 end, const f64 *p, const f64 *d, const f64 *z, f64 pad, f64 *out) {
    f64 low = INFINITY;
    for (i64 i = first; i < end; i++) {
        f64 least = z[3 * order[i] + 1];
        low = least < low ? least : low;
    }
    out[0] = low;
    for (int j = 1; j < BOUNDS; j += 2) out[j] = INFINITY, out[j + 1] = -INFINITY;
    for (i64 i = first; i < end; i++) {
        i64 b = order[i];
        const f64 *P = p + 6 * b, *D = d + 6 * b, *Z = z + 3 * b;
        widen(out + 1, Z[1], Z[2]);
        for (int j = 0; j < 2; j++)
            for (int c = 0; c < 3; c++) {
                int e = (c + 1) % 3, f = (c + 2) % 3;
                f64 slope = D[2 * c + j] + pad * (2.0 * D[2 * c + j] - D[2 * e + j] - D[2 * f + j]);
                f64 place = P[2 * c + j] + pad * (2.0 * P[2 * c + j] - P[2 * e + j] - P[2 * f + j]) + (low - Z[0]) * slope;
                widen(out + 3 + 2 * j, place, place);
                widen(out + 7 + 2 * j, slope, slope);
            }
    }
}

static int before(const f64 *key, i64 a, i64 b) { return key[a] < key[b] || (key[a] == key[b] && a < b); }

/* Moves those of order[first..end] with the smallest keys before `middle` (quickselect; equal keys are sorted by
   number). */
static void halve(i64 *order, const f64 *key, i64 first, i64 end, i64 middle) {
    i64 low = first, high = end - 1;
    while (low < high) {
        i64 pivot = order[(low + high) / 2], i = low, j = high;
        while (i <= j) {
            while (before(key, order[i], pivot)) i++;
            while (before(key, pivot, order[j])) j--;
            if (i <= j) {
                i64 other = order[i];
                order[i++] = order[j], order[j--] = other;
            }
        }
        if (middle <= j) high = j;
        else if (middle >= i) low = i;
        else return;
    }
}

/* Chooses the quantity by which the beams of a node are sorted. Slopes are weighted by the length over which they
   act, about one unit of the frame. */
static int widest(const f64 *bounds) {
    int best = 3;
    for (int k = 5; k < BOUNDS; k += 2)
        if (bounds[k + 1] - bounds[k] > bounds[best + 1] - bounds[best]) best = k;
    return (best - 3) / 2;
}

/* Returns how many nodes there are, −1 if there is not enough memory. */
KERNEL(beams_tree,
       "order i64[n]!  p f64[n,3,2]  d f64[n,3,2]  z f64[n,3]  group i8[n]  pad f64  root i64[6]!  bounds f64[m,11]!  "
       "child i64[m,2]!"
       ";  0<=order<n  0<=group<6  2*n<=m+1")
i64 beams_tree(i64 n, i64 m, i64 *order, const f64 *p, const f64 *d, const f64 *z, const i8 *group, f64 pad,
               i64 *root, f64 *bounds, i64 *child) {
    struct { i64 node, first, end; } stack[STACK];
    f64 *key = malloc((size_t)(n ? n : 1) * sizeof *key);
    i64 nodes = 0;
    (void)m;
    if (!key) return -1;
    for (i64 i = 0, last; i < n; i = last) {
        for (last = i; last < n && group[order[last]] == group[order[i]];) last++;
        i64 top = 1;
        root[group[order[i]]] = nodes;
        stack[0].node = nodes++, stack[0].first = i, stack[0].end = last;
        while (top) {
            top--;
            i64 node = stack[top].node, first = stack[top].first, end = stack[top].end;
            f64 *own = bounds + BOUNDS * node;
            bound(order, first, end, p, d, z, pad, own);
            if (end - first <= LEAF) {
                child[2 * node] = first, child[2 * node + 1] = end - first;
                continue;
            }
            int j = widest(own);
            for (i64 k = first; k < end; k++) {
                i64 b = order[k];
                key[b] = j < 2 ? p[6 * b + j] + (own[0] - z[3 * b]) * d[6 * b + j] : d[6 * b + j - 2];
            }
            i64 middle = (first + end) / 2;
            halve(order, key, first, end, middle);
            child[2 * node] = nodes, child[2 * node + 1] = 0;
            stack[top].node = nodes, stack[top].first = first, stack[top].end = middle;
            stack[top + 1].node = nodes + 1, stack[top + 1].first = middle, stack[top + 1].end = end;
            top += 2;
            nodes += 2;
        }
    }
    free(key);
    return nodes;
}
