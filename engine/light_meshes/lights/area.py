"""AREA: a rectangle or an ellipse that shines to one side, most along its axis. What arrives of it: `area.h`."""

from __future__ import annotations

import numpy as np

from ..scene.description import Light
from .kind import LightKind, Shape


def shape(light: Light) -> Shape:
    """Return the face of the lamp."""
    return Shape(0.0, True, not light.area_ellipse, light.area_u, light.area_v)


def extent(light: Light) -> float:
    """Of the disc with the mean variance along both axes.

    Variances along the half-axes are a quarter of their squares, of a rectangle a third; of a disc ρ²/4.
    """
    square = float(np.square(light.area_u).sum() + np.square(light.area_v).sum())
    return float(np.sqrt(square / 2)) if light.area_ellipse else 2 * float(np.sqrt(square / 6))


def numbers(light: Light) -> tuple[float, float]:
    """Return the tangent of half the spread, and what keeps its power; 0 and 0 where light leaves to all of its side.

    As Cycles: what leaves is weighted by tan(spread/2) − tan(angle).
    """
    if light.spread >= np.pi - 1e-4:
        return 0.0, 0.0
    half = max(light.spread / 2, 1e-4)
    return np.tan(half), 1 / (np.tan(half) - half)


KIND = LightKind(shape, extent, numbers, skewed=True)
