"""Dense meshes: few of the corners of tiny triangles gather light, and the others take theirs from those near them.

Where triangles are much smaller than the finest distance of records, a record at each corner would cost rays for
nothing. So space is divided into cells; in each, one corner of each instance and of each of six sides that normals may
face is a source. What sources have found is blended by distance, smoothly, as far as they can be seen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel
from .grids import Grids
from .table import Table

_cells, _around, mean = kernel("thinned_cells"), kernel("thinned_around"), kernel("thinned_mean")
SMALL = 0.25  # corners between triangles of up to this size take light from sources, in finest distances
EDGE = 0.5  # of cells,
REACH = 1.25 * EDGE  # and how far away sources count
SOURCES = 24  # of a corner, at most


class Sources(NamedTuple):
    """The sources of n corners."""

    corner: NDArray[np.int32]  # (n,s) the numbers of their corners, −1: none
    weight: NDArray[np.float64]  # (n,s)


class Thinned:
    """The sources of a scene: corners that gather light for others around them."""

    def __init__(self, grids: Grids, fine: float) -> None:
        """fine: the finest distance of records, scene units."""
        self.reach, self._edge = REACH * fine, EDGE * fine
        P, N, spacing, own = grids.corners
        self._P, self._N, self._own = P, N, own
        self.small = spacing <= SMALL * fine
        rows = np.flatnonzero(self.small).astype(np.int32)
        cell = np.empty(len(rows), np.uint64)
        _cells(self._edge, np.ascontiguousarray(P[rows]), cell)
        away = (P[rows] / self._edge) % 1 - 0.5
        side = np.abs(N[rows]).argmax(1)
        side = 2 * side + (N[rows, side] > 0)
        order = np.lexsort(((away**2).sum(1), side, own[rows], cell))  # the first is nearest to the middle of its cell
        new = np.ones(len(rows), np.bool_)
        for values in (cell[order], side[order], own[rows][order]):
            new[1:] &= values[1:] == values[:-1]
        new[1:] = ~new[1:]
        first = order[new]
        self._corner, cells = rows[first], cell[first]
        self._Q, self._M, self._of = (np.ascontiguousarray(a[self._corner]) for a in (P, N, own))
        found, begin = np.unique(cells, return_index=True)
        self._table, self._begin = Table(), np.append(begin, len(cells)).astype(np.int32)
        self._table.numbers(found)

    def around(self, corner: NDArray[np.int64]) -> Sources:
        """Return the sources of small corners (n,)."""
        n = len(corner)
        source, weight = np.empty((n, SOURCES), np.int32), np.empty((n, SOURCES))
        slots, entered, _ = self._table.arrays
        _around(slots, entered, self._begin, self._edge, self.reach, self._Q, self._M, self._of, self._P[corner],
                self._N[corner], self._own[corner], source, weight)
        return Sources(np.where(source >= 0, np.append(self._corner, np.int32(-1))[source], np.int32(-1)), weight)
