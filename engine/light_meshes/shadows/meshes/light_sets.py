"""A set of lights for each of many nodes. There are few different sets, so each is stored once, and a node has the
number of its set.

Neighbouring nodes are asked about the same lights. In a picture with 256 lights most nodes share the set of all lights,
and the others share four more sets. A number takes 1 to 4 bytes; a set takes one bit for each light.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...support.native import kernel

_fill, _expanded = kernel("sets_fill"), kernel("sets_expanded")
_mark, _renumber = kernel("sets_mark"), kernel("sets_renumber")

LEAST = 16  # the smallest number of sets for which there is room


class LightSets(NamedTuple):
    """The sets, and the number of the set of each row."""

    words: NDArray[np.uint64]  # (room, W); set 0 is empty
    size: NDArray[np.int64]  # (1,) the number of sets
    table: NDArray[np.int32]  # a hash table of their numbers; −1: free
    number: NDArray[np.uint8]  # (rows, bytes) lowest byte first

    @property
    def bytes(self) -> int:
        """Return the memory of the arrays in bytes."""
        return sum(a.nbytes for a in self)

    def of(self, first: int, last: int) -> NDArray[np.uint64]:
        """Return the sets (n,W) of these rows."""
        out = np.empty((last - first, self.words.shape[1]), np.uint64)
        _expanded(self.words, self.number, first, out)
        return out

    def resize(self, rows: int) -> None:
        """Change the number of rows. New rows have the empty set. Nobody else may hold the array of numbers."""
        self.number.resize((rows, self.number.shape[1]), refcheck=False)

    def renewed(self) -> LightSets:
        """Return a copy with room for new sets, and without the sets that no row has any more."""
        used = np.zeros(self.size[0], np.bool_)
        used[0] = True
        _mark(self.number, used)
        new = light_sets(self.words[:len(used)][used], self.number)
        _renumber(self.number, np.cumsum(used) - 1, new.number)
        return new


def light_sets(sets: NDArray[np.uint64], number: NDArray[np.uint8]) -> LightSets:
    """Return these sets (n,W), of which the first must be empty, with room for more. `number` is used again if it is
    wide enough.
    """
    room = max(LEAST, len(sets) * 3 // 2)
    words = np.zeros((room, sets.shape[1]), np.uint64)
    words[:len(sets)] = sets
    width = ((room - 1).bit_length() + 7) // 8
    if number.shape[1] != width:
        number = np.zeros((len(number), width), np.uint8)
    new = LightSets(words, np.array([len(sets)], np.int64), np.full(1 << (2 * room).bit_length(), -1, np.int32), number)
    _fill(new.words, new.size, new.table)
    return new
