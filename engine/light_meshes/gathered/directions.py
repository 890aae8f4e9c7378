"""Directions over the half-space above a surface: fixed, evenly spread, and weighted by their cosine."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

_sectors = kernel("sectors_of")
_GOLDEN = np.pi * (3 - np.sqrt(5))
LEAN = np.radians(30)  # of the four normals for which a record also gathers


def directions(n: int) -> NDArray[np.float64]:
    """Return n unit vectors (n,3) around z, on a spiral of equal shares of the cosine. The plain mean of a radiance in
    these directions is the radiance of a white matt surface; it is exact if the radiance is the same in all directions.
    """
    k = np.arange(n) + 0.5
    sine, angle = np.sqrt(k / n), k * _GOLDEN
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), np.sqrt(1 - k / n)], axis=1)


def tilted(local: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights (n,4) of rays along `local` (n,3) for four normals, which lean by LEAN to x, −x, y, −y.

    The weighted sum is exact if the radiance is the same in all directions: such a surface sees (1 + cos LEAN)/2 of the
    half-space.
    """
    c, s = np.cos(LEAN), np.sin(LEAN)
    normals = np.array([(s, 0, c), (-s, 0, c), (0, s, c), (0, -s, c)])
    weight = np.maximum(local @ normals.T, 0) / local[:, 2:]
    return weight * ((1 + c) / 2 / weight.mean(0))


def sectors(local: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return in which of the 64 sectors of a half-space (sectors.h) these unit vectors (n,3) around z are."""
    found = np.empty(len(local), np.uint8)
    _sectors(local, found)
    return found
