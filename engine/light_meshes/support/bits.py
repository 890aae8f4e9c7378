"""Sets of lights as 64-bit words: light i is bit i & 63 of word i >> 6."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray


def mask_of(lights: Iterable[int], count: int) -> NDArray[np.uint64]:
    """Return the set of these lights, out of `count`, as words of shape (max(1, ceil(count/64)),)."""
    words = np.zeros(max(1, (count + 63) // 64), np.uint64)
    for i in lights:
        words[i >> 6] |= np.uint64(1) << np.uint64(i & 63)
    return words


def has(words: NDArray[np.uint64], light: int) -> Any:
    """Return whether the set contains the light. `words` is one set (W,), or n sets (W,n)."""
    return words[light >> 6] >> np.uint64(light & 63) & np.uint64(1) != 0
