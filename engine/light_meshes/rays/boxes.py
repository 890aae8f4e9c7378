"""Trees of boxes, for kernels that need what Embree does not give."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.compiled import kernel, part

LEAF = 4
BINS = 16
STACK = 128  # entries that a walk down any tree may need
PAD = 1e-9  # boxes are so much larger than what they hold: rounding loses nothing


def box_tree(item: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """A tree over boxes item (n,6: low, high), cut where the surface area heuristic says.

    Returns order (n,); box (nodes,6); child (nodes,2): the first of a node's two children and 0, or of a leaf, where
    its boxes begin in `order` and how many they are. Node 0 is the root.
    """
    order = np.arange(len(item))
    box, child = np.empty((2 * len(item) + 1, 6)), np.zeros((2 * len(item) + 1, 2), np.int64)
    nodes = _build(np.ascontiguousarray(item, np.float64), order, box, child) if len(item) else 0
    return order, box[:nodes], child[:nodes]


@part
def _area(box, i):
    x, y, z = box[i, 3] - box[i, 0], box[i, 4] - box[i, 1], box[i, 5] - box[i, 2]
    return x * y + y * z + z * x


@part
def _empty(box, i):
    for j in range(3):
        box[i, j], box[i, j + 3] = np.inf, -np.inf


@part
def _include(box, i, other, o):
    for j in range(3):
        box[i, j] = min(box[i, j], other[o, j])
        box[i, j + 3] = max(box[i, j + 3], other[o, j + 3])


@part
def _bin(item, o, axis, low, factor):
    return min(int((item[o, axis] + item[o, axis + 3] - low) * factor), BINS - 1)


@kernel
def _build(item, order, box, child):
    stack = np.empty((STACK, 4), np.int64)  # node, first, end, depth
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, len(order), 0
    top, nodes = 1, 1
    bins = np.empty(BINS, np.int64)
    bin_box, side = np.empty((BINS, 6)), np.empty((1, 6))
    left_cost = np.empty(BINS)
    while top:
        top -= 1
        node, first, end, depth = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
        _empty(box, node)
        axis, low, width = 0, 0.0, -1.0
        for i in range(first, end):
            _include(box, node, item, order[i])
        for j in range(3):
            a, b = np.inf, -np.inf  # of the boxes' centres
            for i in range(first, end):
                middle = item[order[i], j] + item[order[i], j + 3]
                a, b = min(a, middle), max(b, middle)
            if b - a > width:
                axis, low, width = j, a, b - a
            box[node, j] -= PAD
            box[node, j + 3] += PAD
        n = end - first
        if n <= LEAF:
            child[node, 0], child[node, 1] = first, n
            continue
        cut = first
        if width > 0.0 and depth < STACK // 2:
            factor = BINS * (1 - 1e-12) / width
            for k in range(BINS):
                bins[k] = 0
                _empty(bin_box, k)
            for i in range(first, end):
                k = _bin(item, order[i], axis, low, factor)
                bins[k] += 1
                _include(bin_box, k, item, order[i])
            total = 0
            _empty(side, 0)
            for k in range(BINS - 1):
                total += bins[k]
                _include(side, 0, bin_box, k)
                left_cost[k] = total * _area(side, 0) if total else 0.0
            total, best, split = 0, np.inf, 0
            _empty(side, 0)
            for k in range(BINS - 1, 0, -1):
                total += bins[k]
                _include(side, 0, bin_box, k)
                cost = left_cost[k - 1] + (total * _area(side, 0) if total else 0.0)
                if total and total < n and cost < best:
                    best, split = cost, k
            e = end
            while cut < e:
                if _bin(item, order[cut], axis, low, factor) < split:
                    cut += 1
                else:
                    e -= 1
                    order[cut], order[e] = order[e], order[cut]
        if cut in (first, end):
            cut = (first + end) // 2  # all in one place, or too deep: halves keep the stack short
        child[node, 0], child[node, 1] = nodes, 0
        for half in range(2):
            stack[top + half, 0], stack[top + half, 3] = nodes + half, depth + 1
            stack[top + half, 1] = cut if half else first
            stack[top + half, 2] = end if half else cut
        top += 2
        nodes += 2
    return nodes
