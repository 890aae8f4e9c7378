"""Numbers for 64-bit keys, in the order in which these come."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

_numbers = kernel("table_numbers")


class Table:
    """Gives each key a number from 0 on. It is not for several threads at once."""

    def __init__(self) -> None:
        self._size = np.zeros(1, np.int64)
        self._entered = np.empty(1024, np.uint64)
        self._slots = np.full(4096, -1, np.int32)

    def __len__(self) -> int:
        return int(self._size[0])

    @property
    def keys(self) -> NDArray[np.uint64]:
        """Return the keys, in the order of their numbers."""
        return self._entered[:len(self)]

    def numbers(self, keys: NDArray[np.uint64]) -> NDArray[np.int32]:
        """Return the numbers (n,) of keys (n,). New keys get new numbers."""
        number = np.empty(len(keys), np.int32)
        while _numbers(keys, *self.arrays, number):
            self.grow()
        return number

    @property
    def arrays(self) -> tuple[NDArray, ...]:
        """Return the arrays that kernels need to enter keys (table.h); the kernels change them."""
        return self._slots, self._entered, self._size

    def grow(self) -> None:
        """Make room for more keys."""
        known = self.keys.copy()
        self._entered = np.empty(4 * len(known), np.uint64)
        self._slots = np.full(16 * len(known), -1, np.int32)
        self._size[0] = 0
        _numbers(known, *self.arrays, np.empty(len(known), np.int32))
