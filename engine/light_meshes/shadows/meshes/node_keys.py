"""Which row a node (i,j,k) has: its key of 8 bytes, and a hash table with 4 bytes a place, densely filled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...support.compiled import kernel, part

FULL, FILLED = 0.88, 0.74  # a table is filled up to FULL, and then made anew, FILLED
EMPTY = np.uint32(0xFFFFFFFF)
MOST = 0xFFFFFFFE  # rows
_BITS = np.uint64(21)  # of a coordinate that are in the key
_LOW = np.uint64((1 << 21) - 1)
_HIGH = np.uint64(11)  # bits of it that are left


class Keys(NamedTuple):
    """The keys of all rows, and the table that finds them."""

    base: NDArray[np.int64]  # (3,) coordinates count from here
    near: NDArray[np.uint64]  # (rows,) the lower 21 bits of each coordinate
    far: NDArray[np.uint64]  # (rows,) the upper 11, or (0,): they are all 0, within a million steps of the first node
    table: NDArray[np.uint32]  # a row in so many bits, above them bits of its hash, that few keys are looked at; EMPTY
    bits: np.uint64

    @property
    def bytes(self) -> int:
        """Memory of the arrays."""
        return sum(a.nbytes for a in (self.base, self.near, self.far, self.table))

    def nodes(self, first: int, last: int) -> NDArray[np.int32]:
        """The nodes (n,3) of these rows."""
        out = np.empty((last - first, 3), np.int32)
        _unpacked(self.base, self.near[first:last], self.far[first:last], out)
        return out

    @property
    def room(self) -> int:
        """So many rows fit."""
        return min(len(self.near), int(FULL * len(self.table)))

    def roomier(self, count: int) -> Keys:
        """With room for more than `count` rows. Nobody else may hold these arrays."""
        rows, bits = len(self.near), self.bits
        if count == rows:
            rows += max(rows >> 4, 1024)
            if rows > MOST:
                raise MemoryError("more than four billion lattice nodes")
            self.near.resize(rows, refcheck=False)  # in place: old and new need not both be in memory
            if len(self.far):
                self.far.resize(rows, refcheck=False)
            bits = np.uint64((rows + 1).bit_length())
        size = len(self.table)
        if count >= int(FULL * size):
            size = int((count + 1024) / FILLED)
        elif bits == self.bits:
            return self
        new = self._replace(table=np.full(size, EMPTY), bits=bits)
        _fill(new, count)
        return new

    def widened(self) -> Keys:
        """With room for nodes that are far away."""
        return self._replace(far=np.zeros(len(self.near), np.uint64))


def keys() -> Keys:
    """Without rows."""
    return Keys(np.zeros(3, np.int64), np.zeros(0, np.uint64), np.zeros(0, np.uint64), np.full(1, EMPTY), np.uint64(1))


@part
def key_of(base, i, j, k):
    """The node's (near, far)."""
    every = np.uint64(0xFFFFFFFF)
    a = np.uint64(np.int64(i) - base[0]) & every
    b = np.uint64(np.int64(j) - base[1]) & every
    c = np.uint64(np.int64(k) - base[2]) & every
    near = a & _LOW | (b & _LOW) << _BITS | (c & _LOW) << (_BITS + _BITS)
    far = a >> _BITS | b >> _BITS << _HIGH | c >> _BITS << (_HIGH + _HIGH)
    return near, far


@kernel
def _unpacked(base, near, far, out):
    for n in range(len(near)):
        for axis in range(3):
            x = near[n] >> (_BITS * np.uint64(axis)) & _LOW
            if len(far):
                x |= (far[n] >> (_HIGH * np.uint64(axis)) & np.uint64((1 << 11) - 1)) << _BITS
            out[n, axis] = np.int32(np.int64(x) + base[axis])  # modulo 2³², as key_of


@part
def _place(near, far, size):
    """Where a search begins, and the bits of the hash that the table keeps beside a row."""
    x = (near ^ far * np.uint64(0xC2B2AE3D27D4EB4F)) * np.uint64(0x9E3779B185EBCA87)
    x ^= x >> np.uint64(32)
    x *= np.uint64(0xBF58476D1CE4E5B9)
    x ^= x >> np.uint64(29)
    return (x >> np.uint64(32)) * np.uint64(size) >> np.uint64(32), x & np.uint64(0xFFFFFFFF)


@part
def find(keys, near, far):
    """(place, row) of a node; row −1: it has none, and place is where it belongs."""
    size = np.uint64(len(keys.table))
    place, mark = _place(near, far, size)
    mark = mark << keys.bits & np.uint64(0xFFFFFFFF)
    below = np.uint64(1) << keys.bits
    while True:
        entry = keys.table[place]
        row = np.uint64(entry) ^ mark  # the row, where the bits of the hash are equal
        if entry == EMPTY:
            return place, np.int64(-1)
        if row < below and keys.near[row] == near and (len(keys.far) == 0 or keys.far[row] == far):
            return place, np.int64(row)
        place += np.uint64(1)
        if place == size:
            place = np.uint64(0)


@part
def enter(keys, place, near, far, row):
    """Give the node that belongs in `place` a row."""
    _, mark = _place(near, far, len(keys.table))
    keys.near[row] = near
    if len(keys.far):
        keys.far[row] = far
    keys.table[place] = np.uint32((mark << keys.bits | np.uint64(row)) & np.uint64(0xFFFFFFFF))


@kernel
def _fill(keys, count):
    """Enter the first `count` rows into an empty table."""
    for row in range(count):
        near, far = keys.near[row], keys.far[row] if len(keys.far) else np.uint64(0)
        place, _ = find(keys, near, far)
        enter(keys, place, near, far, row)
