"""The description of a type of light. Each type has a file of its own with its `KIND`; `registry` lists them.

How much light arrives is computed in a C header beside the Python file; `types.h` includes it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..scene.description import RGB, Light


class Shape(NamedTuple):
    """The body of a lamp, on which area sampling chooses points: a face, or a body that looks like a disc from
    everywhere.
    """

    disc: float = 0.0  # radius of a sphere, scene units, as its receivers see it; of a sun at distance 1
    ball: bool = False  # it is a sphere, and no disc that turns: nothing inside of it stands in its light
    face: bool = False  # else the rectangle, or ellipse, with these half-axes
    rectangle: bool = False
    u: RGB = (0.0, 0.0, 0.0)
    v: RGB = (0.0, 0.0, 0.0)


class LightKind(NamedTuple):
    """A type of light."""

    shape: Callable[[Light], Shape]
    extent: Callable[[Light], float]  # ρ: radius of the disc with the variance of the shape, scene units; of a sun at
    #                                   distance 1
    numbers: Callable[[Light], tuple[float, float]] = lambda light: (0.0, 0.0)  # what its header reads: edge and slope
    directional: bool = False  # it has no place: its light comes along one direction
    skewed: bool = False  # its header has a second function, for lamps with axes of their own


def sphere(light: Light) -> Shape:
    """Return the shape of lamps that are spheres."""
    return Shape(disc=light.radius, ball=not light.facing_disc)


def radius(light: Light) -> float:
    """Return the extent of lamps that are spheres."""
    return light.radius
