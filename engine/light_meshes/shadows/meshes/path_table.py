"""The refracted paths of all lattice nodes, stored separately from the values (end of paper §5)."""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray


class PathTable:
    """α_j and P_j of the paths of all nodes. It only grows; threads share it."""

    NONE = np.zeros((0, 3)), np.zeros((0, 3))

    def __init__(self) -> None:
        self.rows = self.NONE  # α (c,3), P_j (c,3); the array may be replaced, but rows that are in use never change
        self._count = 0
        self._lock = threading.Lock()

    def append(self, alpha: NDArray[np.float64], ends: NDArray[np.float64]) -> int:
        """Add paths, alpha and ends (k,3); return the row of the first one."""
        with self._lock:
            first, self._count = self._count, self._count + len(alpha)
            if self._count > len(self.rows[0]):
                room = np.zeros((2 * self._count, 3))
                old_alpha, old_ends = self.rows
                self.rows = (np.concatenate([old_alpha[:first], room[first:]]),
                             np.concatenate([old_ends[:first], room[first:]]))
            for array, new in zip(self.rows, (alpha, ends), strict=True):
                array[first:self._count] = new
            return first
