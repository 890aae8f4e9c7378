"""Trees of boxes, for kernels that need what Embree does not give."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

_build = kernel("boxes_build")
LEAF = 4  # boxes; the same in boxes.h
STACK = 128  # entries that a walk down any tree may need


def box_tree(item: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """A tree over boxes item (n,6: low, high), cut where the surface area heuristic says.

    Returns order (n,); box (nodes,6); child (nodes,2): the first of a node's two children and 0, or of a leaf, where
    its boxes begin in `order` and how many they are. Node 0 is the root.
    """
    order = np.arange(len(item), dtype=np.int64)
    box, child = np.empty((2 * len(item) + 1, 6)), np.zeros((2 * len(item) + 1, 2), np.int64)
    nodes = _build(np.ascontiguousarray(item, np.float64), order, box, child) if len(item) else 0
    return order, box[:nodes], child[:nodes]
