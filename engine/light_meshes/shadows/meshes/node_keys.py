"""Find the row of a node (i,j,k): each node has a key of 8 bytes, and a densely filled hash table has 4 bytes for each
place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...support.native import kernel

FULL, FILLED = 0.88, 0.74  # a table is filled up to FULL; then a new one is made, which is filled up to FILLED
EMPTY = np.uint32(0xFFFFFFFF)
MOST = 0xFFFFFFFE  # the largest number of rows

_unpacked, _fill = kernel("keys_unpacked"), kernel("keys_fill")


class Keys(NamedTuple):
    """The keys of all rows, and the hash table that finds them."""

    base: NDArray[np.int64]  # (3,) coordinates are counted from here
    near: NDArray[np.uint64]  # (rows,) the lower 21 bits of each coordinate
    # (rows,) the upper 11 bits; or (0,) if they are all 0, for nodes within a million steps of the first one
    far: NDArray[np.uint64]
    # a row in the lower bits, above them bits of its hash, so that few keys must be compared; or EMPTY
    table: NDArray[np.uint32]
    bits: np.uint64

    @property
    def bytes(self) -> int:
        """Return the memory of the arrays in bytes."""
        return sum(a.nbytes for a in (self.base, self.near, self.far, self.table))

    def nodes(self, first: int, last: int) -> NDArray[np.int32]:
        """Return the nodes (n,3) of these rows."""
        out = np.empty((last - first, 3), np.int32)
        _unpacked(self.base, self.near[first:last], self.far[first:last], out)
        return out

    @property
    def room(self) -> int:
        """Return for how many rows there is room."""
        return min(len(self.near), int(FULL * len(self.table)))

    def roomier(self, count: int, more: int = 0) -> Keys:
        """Return a copy with room for more than `count` rows. Nobody else may hold these arrays.

        more: so many rows may be needed at once; there is room for an eighth of them, as most nodes are known already.
        """
        rows, bits = len(self.near), self.bits
        if count == rows:
            rows += max(rows >> 4, 1024, more >> 3)
            if rows > MOST:
                raise MemoryError("more than four billion lattice nodes")
            self.near.resize(rows, refcheck=False)  # in place, so that the old and the new array are not both in memory
            if len(self.far):
                self.far.resize(rows, refcheck=False)
            bits = np.uint64((rows + 1).bit_length())
        size = len(self.table)
        if count >= int(FULL * size):
            size = int((count + max(1024, more >> 3)) / FILLED)
        elif bits == self.bits:
            return self
        new = self._replace(table=np.full(size, EMPTY), bits=bits)
        _fill(new.base, new.near, new.far, new.table, int(bits), count)
        return new

    def widened(self) -> Keys:
        """Return a copy that can also hold nodes that are far away."""
        return self._replace(far=np.zeros(len(self.near), np.uint64))


def keys() -> Keys:
    """Return keys without rows."""
    return Keys(np.zeros(3, np.int64), np.zeros(0, np.uint64), np.zeros(0, np.uint64), np.full(1, EMPTY), np.uint64(1))
