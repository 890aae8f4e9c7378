"""SPOT: a cone of light with a soft edge. What arrives of it: `spot.h`."""

from __future__ import annotations

import numpy as np

from ..scene.description import Light
from .kind import LightKind, radius, sphere


def numbers(light: Light) -> tuple[float, float]:
    """Return the cosine of half the cone, and 1/width of the blend in cosines."""
    edge = np.cos(light.spot_angle / 2)
    return edge, 1 / max((1 - edge) * light.spot_blend, 1e-9)


KIND = LightKind(sphere, radius, numbers, skewed=True)
