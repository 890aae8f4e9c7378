"""AREA: a rectangle or an ellipse that shines to one side, most along its axis. What arrives of it: `area.h`."""

from __future__ import annotations

import numpy as np

from ..scene.description import Light
from .kind import LightKind, Shape


def shape(light: Light) -> Shape:
    """Return the face of the lamp."""
    return Shape(face=True, rectangle=not light.area_ellipse, u=light.area_u, v=light.area_v)


def extent(light: Light) -> float:
    """Return the radius of the disc whose mean variance along both axes is that of the face, scene units. Variances
    along the half-axes are a quarter of their squares (a third for a rectangle); that of a disc is ρ²/4.
    """
    square = float(np.square(light.area_u).sum() + np.square(light.area_v).sum())
    return float(np.sqrt(square / 2)) if light.area_ellipse else 2 * float(np.sqrt(square / 6))


def numbers(light: Light) -> tuple[float, float]:
    """Return the tangent of half the spread, and the factor that keeps the power; both are 0 where light leaves to all
    of the front side. As in Cycles, light is weighted by tan(spread/2) − tan(angle).
    """
    if light.spread >= np.pi - 1e-4:
        return 0.0, 0.0
    half = max(light.spread / 2, 1e-4)
    return np.tan(half), 1 / (np.tan(half) - half)


KIND = LightKind(shape, extent, numbers, skewed=True)
