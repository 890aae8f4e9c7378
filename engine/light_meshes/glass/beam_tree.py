"""Trees of beams: which beams may pass through a point, wherever it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

_tree = kernel("beams_tree")


def beam_tree(p: NDArray[np.float64], d: NDArray[np.float64], z: NDArray[np.float64], group: NDArray[np.int8],
              pad: float) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Trees over beams, one a group; p, d, z, group as in `beams.Beams`. pad: barycentric, around each beam.

    Returns order (B,); root (6,): node of each group, −1: none; bounds (nodes,11): z0, least and greatest z, place 1,
    place 2 (at z0), slope 1, slope 2; child (nodes,2): the first of two children and 0, or of a leaf, its first beam
    in `order` and their number. A beam that passes through (a, b, z) has place + (z − z0)·slope around a and b.
    """
    order = np.argsort(group, kind="stable").astype(np.int64, copy=False)
    bounds, child = np.empty((2 * len(p) + 6, 11)), np.zeros((2 * len(p) + 6, 2), np.int64)
    root = np.full(6, -1, np.int64)
    nodes = _tree(order, p, d, z, group, pad, root, bounds, child)
    if nodes < 0:
        raise MemoryError("out of memory in a kernel")
    return order, root, bounds[:nodes], child[:nodes]
