"""Trees of boxes, for kernels that need what Embree does not give."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .compiled import kernel

LEAF = 4
BINS = 16
STACK = 128  # entries that a walk down any tree may need
PAD = 1e-9  # boxes are so much larger than what they hold: rounding loses nothing


def box_tree(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64],
                                                                            NDArray[np.float64], NDArray[np.int32],
                                                                            NDArray[np.int32]]:
    """A tree over boxes low, high (n,3), cut where the surface area heuristic says.

    Returns order (n,), and per node: low, high (·,3), child: the first of its two children, or where its boxes
    order[child : child + count] begin; count: 0 for an inner node. Node 0 is the root.
    """
    n = len(low)
    order = np.arange(n)
    size = max(1, 2 * n)
    box_low, box_high = np.empty((size, 3)), np.empty((size, 3))
    child, count = np.zeros(size, np.int32), np.zeros(size, np.int32)
    nodes = _build(low, high, order, box_low, box_high, child, count) if n else 0
    return order, box_low[:nodes], box_high[:nodes], child[:nodes], count[:nodes]


@kernel
def _area(low, high):
    x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    return x * y + y * z + z * x


@kernel
def _build(low, high, order, box_low, box_high, child, count):
    stack = np.empty((STACK, 4), np.int64)  # node, first, end, depth
    stack[0] = 0, 0, len(order), 0
    top, nodes = 1, 1
    bins = np.empty(BINS, np.int64)
    bin_low, bin_high = np.empty((BINS, 3)), np.empty((BINS, 3))
    left_cost = np.empty(BINS)
    a, b = np.empty(3), np.empty(3)
    while top:
        top -= 1
        node, first, end, depth = stack[top]
        box_low[node], box_high[node] = np.inf, -np.inf
        a[:], b[:] = np.inf, -np.inf  # of the boxes' centres
        for i in range(first, end):
            o = order[i]
            for j in range(3):
                box_low[node, j] = min(box_low[node, j], low[o, j] - PAD)
                box_high[node, j] = max(box_high[node, j], high[o, j] + PAD)
                a[j] = min(a[j], low[o, j] + high[o, j])
                b[j] = max(b[j], low[o, j] + high[o, j])
        n = end - first
        if n <= LEAF:
            child[node], count[node] = first, n
            continue
        axis = 0
        for j in range(1, 3):
            if b[j] - a[j] > b[axis] - a[axis]:
                axis = j
        cut = first
        width = b[axis] - a[axis]
        if width > 0.0 and depth < STACK // 2:
            factor = BINS * (1 - 1e-12) / width
            bins[:] = 0
            bin_low[:], bin_high[:] = np.inf, -np.inf
            for i in range(first, end):
                o = order[i]
                k = min(int((low[o, axis] + high[o, axis] - a[axis]) * factor), BINS - 1)
                bins[k] += 1
                for j in range(3):
                    bin_low[k, j] = min(bin_low[k, j], low[o, j])
                    bin_high[k, j] = max(bin_high[k, j], high[o, j])
            total = 0
            lo, hi = np.full(3, np.inf), np.full(3, -np.inf)
            for k in range(BINS - 1):
                total += bins[k]
                if bins[k]:
                    lo, hi = np.minimum(lo, bin_low[k]), np.maximum(hi, bin_high[k])
                left_cost[k] = total * _area(lo, hi) if total else 0.0
            total = 0
            lo, hi = np.full(3, np.inf), np.full(3, -np.inf)
            best, split = np.inf, 0
            for k in range(BINS - 1, 0, -1):
                total += bins[k]
                if bins[k]:
                    lo, hi = np.minimum(lo, bin_low[k]), np.maximum(hi, bin_high[k])
                cost = left_cost[k - 1] + (total * _area(lo, hi) if total else 0.0)
                if total and total < n and cost < best:
                    best, split = cost, k
            i, e = first, end
            while i < e:
                o = order[i]
                if min(int((low[o, axis] + high[o, axis] - a[axis]) * factor), BINS - 1) < split:
                    i += 1
                else:
                    e -= 1
                    order[i], order[e] = order[e], order[i]
            cut = i
        if cut == first or cut == end:
            cut = (first + end) // 2  # all in one place, or too deep: halves keep the stack short
        child[node], count[node] = nodes, 0
        stack[top] = nodes, first, cut, depth + 1
        stack[top + 1] = nodes + 1, cut, end, depth + 1
        top += 2
        nodes += 2
    return nodes
