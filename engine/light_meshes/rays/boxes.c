/* Builds a tree over boxes, split by the surface area heuristic (boxes.py). A box is low x, y, z, high x, y, z. */
#include "boxes.h"

static const f64 PAD = 1e-9;  /* boxes are enlarged by this much, so that rounding cannot put anything outside */

static f64 area(const f64 *box) {
    f64 x = box[3] - box[0], y = box[4] - box[1], z = box[5] - box[2];
    return x * y + y * z + z * x;
}

static void clear(f64 *box) {
    for (int j = 0; j < 3; j++) box[j] = INFINITY, box[j + 3] = -INFINITY;
}

static void include(f64 *box, const f64 *other) {
    for (int j = 0; j < 3; j++) {
        box[j] = other[j] < box[j] ? other[j] : box[j];
        box[j + 3] = other[j + 3] > box[j + 3] ? other[j + 3] : box[j + 3];
    }
}

/* The axis along which the centres of the boxes order[first..end] are spread out most, and the scale to bins along
   it. */
typedef struct {
    int axis;
    f64 low, factor, width;
} Spread;

static Spread spread_of(const f64 *item, const i64 *order, i64 first, i64 end) {
    Spread s = {0, 0.0, 0.0, -1.0};
    for (int j = 0; j < 3; j++) {
        f64 a = INFINITY, b = -INFINITY;
        for (i64 i = first; i < end; i++) {
            f64 middle = item[6 * order[i] + j] + item[6 * order[i] + j + 3];
            a = middle < a ? middle : a;
            b = middle > b ? middle : b;
        }
        if (b - a > s.width) s.axis = j, s.low = a, s.width = b - a;
    }
    s.factor = BINS * (1 - 1e-12) / s.width;
    return s;
}

static int bin_of(Spread s, const f64 *box) {
    int k = (int)((box[s.axis] + box[s.axis + 3] - s.low) * s.factor);
    return k < BINS - 1 ? k : BINS - 1;
}

/* Returns the first bin of the right half; 0 if every split leaves one half empty. */
static int best_cut(Spread s, const f64 *item, const i64 *order, i64 first, i64 end) {
    i64 count[BINS] = {0}, total = 0, n = end - first;
    f64 bin[BINS][6], side[6], left[BINS], best = INFINITY;
    int cut = 0;
    /* Sort the boxes into bins */
    for (int k = 0; k < BINS; k++) clear(bin[k]);
    for (i64 i = first; i < end; i++) {
        int k = bin_of(s, item + 6 * order[i]);
        count[k]++;
        include(bin[k], item + 6 * order[i]);
    }
    /* From the left: the cost of the boxes left of each split */
    clear(side);
    for (int k = 0; k < BINS - 1; k++) {
        total += count[k];
        include(side, bin[k]);
        left[k] = total ? (f64)total * area(side) : 0.0;
    }
    /* From the right: add the cost of the boxes on the right, and keep the cheapest split */
    total = 0;
    clear(side);
    for (int k = BINS - 1; k > 0; k--) {
        total += count[k];
        include(side, bin[k]);
        f64 cost = left[k - 1] + (total ? (f64)total * area(side) : 0.0);
        if (total && total < n && cost < best) best = cost, cut = k;
    }
    return cut;
}

KERNEL(boxes_build, "item f64[n,6]  order i64[n]!  box f64[m,6]!  child i64[m,2]!"
       ";  1<=m  2*n<=m+1  0<=order<n  -inf<item<inf")
i64 boxes_build(i64 n, i64 m, const f64 *item, i64 *order, f64 *box, i64 *child) {
    struct { i64 node, first, end, depth; } stack[STACK];
    i64 top = 1, nodes = 1;
    (void)m;
    stack[0].node = stack[0].first = stack[0].depth = 0, stack[0].end = n;
    while (top) {
        top--;
        i64 node = stack[top].node, first = stack[top].first, end = stack[top].end, depth = stack[top].depth;
        /* The node's box */
        clear(box + 6 * node);
        for (i64 i = first; i < end; i++) include(box + 6 * node, item + 6 * order[i]);
        for (int j = 0; j < 3; j++) box[6 * node + j] -= PAD, box[6 * node + j + 3] += PAD;
        if (end - first <= LEAF) {
            child[2 * node] = first, child[2 * node + 1] = end - first;
            continue;
        }
        /* Split: reorder `order` so that the left half comes first */
        Spread s = spread_of(item, order, first, end);
        i64 cut = first;
        if (s.width > 0.0 && depth < STACK / 2) {
            int split = best_cut(s, item, order, first, end);
            for (i64 e = end; cut < e;) {
                if (bin_of(s, item + 6 * order[cut]) < split) {
                    cut++;
                } else {
                    i64 other = order[--e];
                    order[e] = order[cut], order[cut] = other;
                }
            }
        }
        /* all boxes coincide, or the tree is too deep: split in halves to keep it short */
        if (cut == first || cut == end) cut = (first + end) / 2;
        /* The two children */
        child[2 * node] = nodes, child[2 * node + 1] = 0;
        stack[top].node = nodes, stack[top].first = first, stack[top].end = cut, stack[top].depth = depth + 1;
        stack[top + 1].node = nodes + 1, stack[top + 1].first = cut, stack[top + 1].end = end;
        stack[top + 1].depth = depth + 1;
        top += 2;
        nodes += 2;
    }
    return nodes;
}
