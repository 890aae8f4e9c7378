"""An array that grows without a copy at each addition."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Growing:
    """An array that grows at its end; there is room for more than it holds."""

    def __init__(self, empty: NDArray, n: int = 0) -> None:
        self._room, self._n = empty, n

    def __len__(self) -> int:
        return self._n

    @property
    def values(self) -> NDArray:
        """Return the values that it holds."""
        return self._room[:self._n]

    def with_more(self, more: NDArray) -> Growing:
        """Return the array with `more` at its end."""
        n = self._n + len(more)
        if n > len(self._room):
            room = np.empty((2 * n, *self._room.shape[1:]), self._room.dtype)
            room[:self._n] = self.values
            self._room = room
        self._room[self._n:n] = more
        return Growing(self._room, n)
