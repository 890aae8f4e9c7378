"""How near records are to edges that rise above their surface, which a record's own rays may miss if they are small.

For each size of cells, a table has a box around the edges in each cell where there are some.
"""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel
from .grids import Grids

_enter, _of, _clear = kernel("nearness_enter"), kernel("nearness_of"), kernel("nearness_clear")
RISE = 0.08  # what rises less, as a share of its distance, does not count: it takes hardly any light


class Nearness:
    """The edges of the triangles that gathered light may meet. Threads share it."""

    def __init__(self, grids: Grids, there: NDArray[np.bool_], fine: float) -> None:
        """there (T,): the triangles that gathered light may meet. fine: the edge of the smallest cells, scene units."""
        self._grids, self._there, self._least = grids, there, int(np.ceil(np.log2(fine) - 1e-3))
        self._making = threading.Lock()
        self._tables: dict[int, tuple[NDArray[np.uint64], NDArray[np.int32], NDArray[np.float32]]] = {}

    def __call__(self, P: NDArray[np.float64], M: NDArray[np.float64], spacing: NDArray[np.float64],
                 own: NDArray[np.int32]) -> NDArray[np.float32]:
        """Return how far (n,) records at P (n,3) with normals M (n,3) are from edges, where that is not much more than
        the spacing (n,) of their grid; otherwise 1e30. own (n,): an instance whose edges do not count, −1: none.
        """
        near = np.full(len(P), 1e30, np.float32)
        size = self._sizes(spacing)
        for one in np.unique(size):
            rows = np.flatnonzero(size == one)
            found = np.empty(len(rows), np.float32)
            _of(2.0**one, *self._table(int(one)), RISE, np.ascontiguousarray(P[rows]), np.ascontiguousarray(M[rows]),
                own[rows], found)
            near[rows] = found
        return near

    def clear(self, corners: NDArray[np.float64], M: NDArray[np.float64], spacing: NDArray[np.float64], margin: float,
              height: float) -> NDArray[np.bool_]:
        """Return where no edge comes near triangles (n,3,3) with normals M (n,3), of grids with this spacing (n,):
        nearer to their sides than `margin`, and lower above them than `height`, as shares of the spacing.
        """
        clear, size = np.empty(len(M), np.bool_), self._sizes(spacing)
        for one in np.unique(size):
            rows = np.flatnonzero(size == one)
            found = np.empty(len(rows), np.bool_)
            keys, _, boxes = self._table(int(one))
            _clear(2.0**one, keys, boxes, np.ascontiguousarray(corners[rows]), np.ascontiguousarray(M[rows]),
                   margin * spacing[rows], height * spacing[rows], found)
            clear[rows] = found
        return clear

    def _sizes(self, spacing: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the size (n,) of cells where grids have this spacing (n,), as a power of two."""
        return np.maximum(np.ceil(np.log2(spacing) - 1e-3), self._least).astype(np.int64)

    def _table(self, size: int) -> tuple[NDArray[np.uint64], NDArray[np.int32], NDArray[np.float32]]:
        """Return the table of cells with edges of 2^size."""
        with self._making:
            if size not in self._tables:
                room = 1 << 14
                while True:
                    table = np.zeros(room, np.uint64), np.empty(room, np.int32), np.empty((room, 6), np.float32)
                    if not _enter(*self._grids.shape, self._grids.surfaces.instance, self._there, 2.0**size, *table):
                        break
                    room *= 4
                self._tables[size] = table
            return self._tables[size]
