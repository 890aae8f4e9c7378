"""Trees of beams: which beams may pass through a point, wherever it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rays.boxes import LEAF, STACK
from ..support.compiled import kernel, part


def beam_tree(p: NDArray[np.float64], d: NDArray[np.float64], z: NDArray[np.float64], group: NDArray[np.int8],
              pad: float) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Trees over beams, one a group; p, d, z, group as in `beams.Beams`. pad: barycentric, around each beam.

    Returns order (B,); root (6,): node of each group, −1: none; bounds (nodes,11): z0, least and greatest z, place 1,
    place 2 (at z0), slope 1, slope 2; child (nodes,2): the first of two children and 0, or of a leaf, its first beam
    in `order` and their number. A beam that passes through (a, b, z) has place + (z − z0)·slope around a and b.
    """
    order = np.argsort(group, kind="stable")
    bounds, child = np.empty((2 * len(p) + 6, 11)), np.zeros((2 * len(p) + 6, 2), np.int64)
    root = np.full(6, -1, np.int64)
    nodes = _tree(order, p, d, z, group, pad, root, bounds, child)
    return order, root, bounds[:nodes], child[:nodes]


@part
def _bound(order, first, end, p, d, z, pad, node, out):
    """Bounds of beams order[first:end], padded by `pad`."""
    low = np.inf
    for i in range(first, end):
        low = min(low, z[order[i], 1])
    out[node, 0] = low
    for j in range(1, 11, 2):
        out[node, j], out[node, j + 1] = np.inf, -np.inf
    for i in range(first, end):
        b = order[i]
        _widen(out, node, 1, z[b, 1], z[b, 2])
        for j in range(2):
            for c in range(3):
                e, f = (c + 1) % 3, (c + 2) % 3
                slope = d[b, c, j] + pad * (2.0 * d[b, c, j] - d[b, e, j] - d[b, f, j])
                place = p[b, c, j] + pad * (2.0 * p[b, c, j] - p[b, e, j] - p[b, f, j]) + (low - z[b, 0]) * slope
                _widen(out, node, 3 + 2 * j, place, place)
                _widen(out, node, 7 + 2 * j, slope, slope)


@part
def _widen(out, node, j, low, high):
    out[node, j] = min(out[node, j], low)
    out[node, j + 1] = max(out[node, j + 1], high)


@part
def _halve(order, key, first, end, middle):
    """Put those of order[first:end] with the least keys before `middle` (quickselect; equal keys go by number)."""
    low, high = first, end - 1
    while low < high:
        pivot = order[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while key[order[i]] < key[pivot] or (key[order[i]] == key[pivot] and order[i] < pivot):
                i += 1
            while key[order[j]] > key[pivot] or (key[order[j]] == key[pivot] and order[j] > pivot):
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def _tree(order, p, d, z, group, pad, root, bounds, child):
    stack = np.empty((STACK, 3), np.int64)
    key = np.empty(len(order))
    nodes, top = 0, 0
    i = 0
    while i < len(order):
        last = i
        while last < len(order) and group[order[last]] == group[order[i]]:
            last += 1
        root[group[order[i]]] = nodes
        stack[0, 0], stack[0, 1], stack[0, 2] = nodes, i, last
        top = 1
        nodes += 1
        while top:
            top -= 1
            node, first, end = stack[top]
            _bound(order, first, end, p, d, z, pad, node, bounds)
            if end - first <= LEAF:
                child[node, 0], child[node, 1] = first, end - first
                continue
            # Slopes weigh by the length over which they matter, about one unit of the frame.
            widest = 3
            for k in range(5, 11, 2):
                if bounds[node, k + 1] - bounds[node, k] > bounds[node, widest + 1] - bounds[node, widest]:
                    widest = k
            j = (widest - 3) // 2
            for k in range(first, end):
                b = order[k]
                if j < 2:
                    key[b] = p[b, 0, j] + (bounds[node, 0] - z[b, 0]) * d[b, 0, j]
                else:
                    key[b] = d[b, 0, j - 2]
            middle = (first + end) // 2
            _halve(order, key, first, end, middle)
            child[node, 0], child[node, 1] = nodes, 0
            for half in range(2):
                stack[top + half, 0] = nodes + half
                stack[top + half, 1] = middle if half else first
                stack[top + half, 2] = end if half else middle
            top += 2
            nodes += 2
        i = last
    return nodes
