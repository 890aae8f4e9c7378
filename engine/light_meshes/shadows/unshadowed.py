"""No shadows: for local illumination, and for scenes in which no light casts any."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import pairs
from .method import Check, Kind, Method, Receivers


class Unshadowed(Method):
    """S = 1 for every light that is asked for."""

    def __init__(self, lights: int) -> None:
        self._count = lights

    def __call__(self, at: Receivers, check: Check, probe: NDArray | None = None) -> NDArray[np.float32]:
        """Return S, see `Method`."""
        return pairs.seen(at.active, self._count)


KIND = Kind(lambda setup: Unshadowed(len(setup.lights)))
