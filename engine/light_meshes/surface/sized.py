"""Lamps that light with their whole size (softness SIZE): the arrays that the kernels in `shading.c` need for them.

Ω of such a lamp is the mean of the point lamp's Ω over the lamp: the radiance I/A times an integral over the directions
in which a receiver sees the lamp. For matt surfaces there are closed forms for spheres, discs, ellipses, rectangles and
the sun, above the receiver's horizon; where a spot's cone or a spread gives less to some directions, one further
integral is computed by Gauss's rule. For glossy surfaces one integral is computed by Gauss's rule. From far away all of
these become the point's formulas. There is no noise, and there are no random numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Light

# Types of lamps with a size, as `sized.h` has them: a sphere, a disc that faces each receiver, the sun; spots as the
# first two; a parallelogram, an ellipse.
BALL, FACING, SKY, BALL_SPOT, FACING_SPOT, PLATE, OVAL = range(16, 23)


def kind(light: Light) -> int | None:
    """Return the number of a lamp with a size, one of those above; None: the light is lit as a point.

    Types of light that have no formula for their whole size are points as well.
    """
    if light.softness != "SIZE" or not area(light) > 0:
        return None
    if light.type == "AREA":
        return OVAL if light.area_ellipse else PLATE
    if light.type == "SUN":
        return SKY
    round_lamps = {"POINT": (BALL, FACING), "SPOT": (BALL_SPOT, FACING_SPOT)}
    return round_lamps[light.type][light.facing_disc] if light.type in round_lamps else None


def area(light: Light) -> float:
    """Return the area that a light's I is spread over, from the front; of a sun its projected solid angle."""
    if light.type == "AREA":
        return float(np.linalg.norm(np.cross(light.area_u, light.area_v))) * (np.pi if light.area_ellipse else 4.0)
    return np.pi * size(light) ** 2


def size(light: Light) -> float:
    """Return the radius of a sphere, or the sine of half a sun's angle; 0 for other lights."""
    if light.type == "SUN":
        return float(np.sin(min(light.angle, np.pi) / 2))
    return 0.0 if light.type == "AREA" else light.radius


def extents(lights: tuple[Light, ...]) -> NDArray[np.float64]:
    """Return (L,8): the half-axes u and v, the size and 1/area of lamps with a size; 0 for other lights."""
    out = np.zeros((len(lights), 8))
    for i, light in enumerate(lights):
        if kind(light) is not None:
            out[i] = [*light.area_u, *light.area_v, size(light), 1 / area(light)]
    return out
