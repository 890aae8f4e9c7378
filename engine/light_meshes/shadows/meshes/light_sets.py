"""A set of lights for each of many nodes: few sets differ, so each is kept once, and a node has its number.

Neighbours look at the same lights: in a whole picture under 256 lights most nodes share the set of all of them, and the
others have it in common with four more. A number takes 1 to 4 bytes, where a set takes a bit a light.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...support.compiled import kernel, part

LEAST = 16  # sets that there is room for


class LightSets(NamedTuple):
    """The sets, and which of them each row has."""

    words: NDArray[np.uint64]  # (room, W); set 0 is empty
    size: NDArray[np.int64]  # (1,) how many sets there are
    table: NDArray[np.int32]  # a hash table of their numbers, or −1
    number: NDArray[np.uint8]  # (rows, bytes) lowest byte first

    @property
    def bytes(self) -> int:
        """Memory of the arrays."""
        return sum(a.nbytes for a in self)

    def of(self, first: int, last: int) -> NDArray[np.uint64]:
        """The sets (n,W) of these rows."""
        out = np.empty((last - first, self.words.shape[1]), np.uint64)
        _expanded(self, first, out)
        return out

    def resize(self, rows: int) -> None:
        """New rows have the empty set. Nobody else may hold the numbers."""
        self.number.resize((rows, self.number.shape[1]), refcheck=False)

    def renewed(self) -> LightSets:
        """With room for new sets, and without those that no row has any more."""
        used = np.zeros(self.size[0], np.bool_)
        used[0] = True
        _mark(self, used)
        new = light_sets(self.words[:len(used)][used], self.number)
        _renumber(self.number, np.cumsum(used) - 1, new.number)
        return new


def light_sets(sets: NDArray[np.uint64], number: NDArray[np.uint8]) -> LightSets:
    """These sets (n,W), the first of them empty, and room for more; `number` is used on if it can number them."""
    room = max(LEAST, len(sets) * 3 // 2)
    words = np.zeros((room, sets.shape[1]), np.uint64)
    words[:len(sets)] = sets
    width = ((room - 1).bit_length() + 7) // 8
    if number.shape[1] != width:
        number = np.zeros((len(number), width), np.uint8)
    new = LightSets(words, np.array([len(sets)]), np.full(1 << (2 * room).bit_length(), -1, np.int32), number)
    _fill(new)
    return new


@part
def number_of(sets, row):
    """Which set a row has."""
    number = np.int64(0)
    for b in range(sets.number.shape[1]):
        number |= np.int64(sets.number[row, b]) << np.int64(8 * b)
    return number


@part
def give(sets, row, number):
    """Let a row have another set."""
    for b in range(sets.number.shape[1]):
        sets.number[row, b] = np.uint8(number >> np.int64(8 * b) & np.int64(0xFF))


@part
def number_for(sets, lights):
    """The number of the set with these words (W,), a new one if need be: then there must be room."""
    place = _search(sets, lights)
    number = np.int64(sets.table[place])
    if number < 0:
        number = sets.size[0]
        sets.words[number] = lights
        sets.table[place] = number
        sets.size[0] += 1
    return number


@part
def _search(sets, lights):
    """The place of a set in the table, or the empty one where it belongs."""
    x = np.uint64(0)
    for w in range(len(lights)):
        x = (x ^ lights[w]) * np.uint64(0x9E3779B185EBCA87)
        x ^= x >> np.uint64(29)
    mask = np.uint64(len(sets.table) - 1)
    place = (x ^ x >> np.uint64(32)) & mask
    while True:
        number = sets.table[place]
        same = number >= 0
        for w in range(len(lights)):
            same = same and sets.words[number, w] == lights[w]
        if number < 0 or same:
            return place
        place = (place + np.uint64(1)) & mask


@kernel
def _fill(sets):
    for number in range(sets.size[0]):
        sets.table[_search(sets, sets.words[number])] = number


@kernel
def _expanded(sets, first, out):
    for n in range(len(out)):
        out[n] = sets.words[number_of(sets, first + n)]


@kernel
def _mark(sets, used):
    for row in range(len(sets.number)):
        used[number_of(sets, row)] = True


@kernel
def _renumber(old, new_number, new):
    for row in range(len(old)):
        number = np.int64(0)
        for b in range(old.shape[1]):
            number |= np.int64(old[row, b]) << np.int64(8 * b)
        number = new_number[number]
        for b in range(new.shape[1]):
            new[row, b] = np.uint8(number >> np.int64(8 * b) & np.int64(0xFF))
