"""SUN: a direction, from which the same light comes everywhere. What arrives of it: `sun.h`."""

from __future__ import annotations

import numpy as np

from ..scene.description import Light
from .kind import LightKind, Shape


def extent(light: Light) -> float:
    """Return tan δ, the radius of the sun's disc at distance 1; δ is half the angle under which it is seen."""
    return float(np.tan(light.angle / 2))


def shape(light: Light) -> Shape:
    """Return a disc in the sky."""
    return Shape(disc=extent(light))


KIND = LightKind(shape, extent, directional=True)
