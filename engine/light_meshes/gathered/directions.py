"""Directions over the half-space above a surface: fixed, evenly spread, and weighted by their cosine."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_GOLDEN = np.pi * (3 - np.sqrt(5))
LEAN = np.radians(30)  # of the four normals for which a record also gathers


def directions(n: int) -> NDArray[np.float64]:
    """n unit vectors (n,3) around z, a spiral of equal shares of the cosine: their plain mean of a radiance is the
    radiance of a white matt surface, exactly so where all around is alike.
    """
    k = np.arange(n) + 0.5
    sine, angle = np.sqrt(k / n), k * _GOLDEN
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), np.sqrt(1 - k / n)], axis=1)


def tilted(local: NDArray[np.float64]) -> NDArray[np.float64]:
    """By how much (n,4) rays along `local` (n,3) count more or less for normals that lean by LEAN to x, −x, y, −y.

    The sum is right where all around is alike: such a surface sees (1 + cos LEAN)/2 of the half-space.
    """
    c, s = np.cos(LEAN), np.sin(LEAN)
    normals = np.array([(s, 0, c), (-s, 0, c), (0, s, c), (0, -s, c)])
    weight = np.maximum(local @ normals.T, 0) / local[:, 2:]
    return weight * ((1 + c) / 2 / weight.mean(0))
