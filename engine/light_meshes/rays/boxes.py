"""Trees of boxes, for kernels that need more than Embree offers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

_build = kernel("boxes_build")
LEAF = 4  # boxes in a leaf; boxes.h has the same number
STACK = 128  # the largest number of entries on the stack of a tree walk


def box_tree(item: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Build a tree over boxes item (n,6: low, high). It is split by the surface area heuristic.

    Returns order (n,), box (nodes,6) and child (nodes,2). Node 0 is the root. For an inner node, `child` holds its
    first child (the second one follows it) and 0. For a leaf, it holds where its boxes begin in `order`, and how many
    there are.
    """
    order = np.arange(len(item), dtype=np.int64)
    box, child = np.empty((2 * len(item) + 1, 6)), np.zeros((2 * len(item) + 1, 2), np.int64)
    nodes = _build(np.ascontiguousarray(item, np.float64), order, box, child) if len(item) else 0
    return order, box[:nodes], child[:nodes]
