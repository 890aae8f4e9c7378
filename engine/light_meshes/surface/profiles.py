"""Profiles of luminaires, looked up by angles: cubic interpolation between the angles of an IES file, as in Cycles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..scene.profile import Profile

NEAR = 1e-6  # radians: angles that are meant to be the same


class Lookup:
    """A profile as arrays. Call it with angles (n,) in radians for the light (n,); 0 outside of the grid."""

    def __init__(self, profile: Profile) -> None:
        self._across, self._up = np.array(profile.horizontal), np.array(profile.vertical)
        values = np.array(profile.values).reshape(len(self._across), len(self._up))
        # With one more row and column around. At the lower pole that is the next column, as Cycles has it; elsewhere,
        # also all around, it takes a value that is there, and so do we.
        values = np.hstack([values[:, 1 if self._up[0] < NEAR else 0, None], values, values[:, -1:]])
        self._values = np.vstack([values[:1], values, values[-2, None]])

    def __call__(self, across: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the light (n,) at horizontal angles `across` and vertical angles `up`, both (n,) in radians."""
        i, x = _place(self._across, across)
        j, y = _place(self._up, up)
        a, b, c, d = (_cubic([self._values[i + row, j + k] for k in range(4)], y) for row in range(4))
        inside = ((across >= self._across[0]) & (across <= self._across[-1] + NEAR)
                  & (up >= self._up[0]) & (up <= self._up[-1] + NEAR))
        return np.where(inside, np.maximum(_cubic([a, b, c, d], x), 0.0), 0.0)


def _place(angles: NDArray[np.float64], at: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the interval (n,) of `angles` in which each angle is, and how far in it, 0 to 1."""
    i = np.clip(np.searchsorted(angles, at, "left") - 1, 0, len(angles) - 2)
    width = angles[i + 1] - angles[i]
    return i, np.clip(np.divide(at - angles[i], width, out=np.zeros(len(at)), where=width > 0), 0.0, 1.0)


def _cubic(values: Sequence[NDArray[np.float64]], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a Catmull-Rom spline through four values, between the second (x = 0) and the third (1)."""
    a, b, c, d = values
    return 0.5 * (((d + 3 * (b - c) - a) * x + (2 * a - 5 * b + 4 * c - d)) * x + (c - a)) * x + b
