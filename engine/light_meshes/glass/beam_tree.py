"""Trees of beams: they find the beams that may pass through a given point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

_tree = kernel("beams_tree")


def beam_tree(p: NDArray[np.float64], d: NDArray[np.float64], z: NDArray[np.float64], group: NDArray[np.int8],
              pad: float) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Build trees over beams, one for each group. p, d, z, group are as in `beams.Beams`; `pad` is the margin around
    each beam in barycentric units.

    Returns order (B,); root (6,), the root node of each group, −1 if it is empty; bounds (nodes,11); and child
    (nodes,2). A row of `bounds` is z0, the smallest and the largest z, and the intervals (low, high) of place 1, place
    2 (both at z0), slope 1 and slope 2. A row of `child` is the first of two children and 0; for a leaf, its first beam
    in `order` and the number of its beams. A beam that passes through (a, b, z) has a place and a slope such that place
    + (z − z0)·slope is near a and b.
    """
    order = np.argsort(group, kind="stable").astype(np.int64, copy=False)
    bounds, child = np.empty((2 * len(p) + 6, 11)), np.zeros((2 * len(p) + 6, 2), np.int64)
    root = np.full(6, -1, np.int64)
    nodes = _tree(order, p, d, z, group, pad, root, bounds, child)
    if nodes < 0:
        raise MemoryError("out of memory in a kernel")
    return order, root, bounds[:nodes], child[:nodes]
