"""Lamps that light with their whole size (`Light.sized`): what the kernels in `shading.c` take of them.

Ω of such a lamp is that of a point, as a mean over the lamp: the radiance I/A times an integral over directions in
which a receiver sees it. Matt surfaces: closed forms for spheres, discs, ellipses, rectangles and the sun, above the
receiver's horizon; one further integral by Gauss's rule where a spot's cone or a spread gives less to some directions.
Glossy ones: one integral by Gauss's rule. From far away all are the point's formulas. No noise, no random numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Light

# Types of lamps with a size, as `sized.h` has them: a sphere, a disc that faces each receiver, the sun; spots as the
# first two; a parallelogram, an ellipse.
BALL, FACING, SKY, BALL_SPOT, FACING_SPOT, PLATE, OVAL = range(16, 23)


def kind(light: Light) -> int | None:
    """Which of the types above a light is; None: it lights as a point."""
    if not light.sized or not area(light) > 0:
        return None
    if light.type == "AREA":
        return OVAL if light.area_ellipse else PLATE
    if light.type == "SUN":
        return SKY
    return {"POINT": (BALL, FACING), "SPOT": (BALL_SPOT, FACING_SPOT)}[light.type][light.facing_disc]


def area(light: Light) -> float:
    """What a light's I is spread over: an area as seen from in front; of a sun the projected solid angle."""
    if light.type == "AREA":
        return float(np.linalg.norm(np.cross(light.area_u, light.area_v))) * (np.pi if light.area_ellipse else 4.0)
    return np.pi * size(light) ** 2


def size(light: Light) -> float:
    """Radius of a sphere, sine of half a sun's angle; 0 for others."""
    if light.type == "SUN":
        return float(np.sin(min(light.angle, np.pi) / 2))
    return 0.0 if light.type == "AREA" else light.radius


def extents(lights: tuple[Light, ...]) -> NDArray[np.float64]:
    """(L,8): half-axes u and v, size and 1/area of the lights with a size; 0 for others."""
    out = np.zeros((len(lights), 8))
    for i, light in enumerate(lights):
        if kind(light) is not None:
            out[i] = [*light.area_u, *light.area_v, size(light), 1 / area(light)]
    return out
