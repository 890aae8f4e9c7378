"""Points on lamps with a size: what nodes and receivers aim at, when they ask how much of a lamp they see.

A lamp is a sphere (point, spot), a disc of the sky (sun), or a rectangle or ellipse (area). The points are those of
Sobol's sequence in the unit square, turned on the torus by whoever asks, so that neighbours complement each other, and
mapped onto the lamp with equal areas. They depend on nothing else: the same for any tiles, threads and order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import Targets
from ..scene.description import Light
from ..support.native import kernel

_points = kernel("lamp_points")
_turns_of_nodes, _turns_of_points = kernel("lamp_turns_of_nodes"), kernel("lamp_turns_of_points")
FREE, RECTANGLE, ELLIPSE = 0, 1, 2  # the same in lamp_points.c


class Shapes(NamedTuple):
    """The lamps' shapes."""

    shape: NDArray[np.uint8]  # (L,) FREE turns to who looks: a sphere, or the sun; RECTANGLE, ELLIPSE
    size: NDArray[np.float64]  # (L,) FREE: the radius, of a sun that at distance 1
    u: NDArray[np.float64]  # (L,3) half-axes of the others, world
    v: NDArray[np.float64]  # (L,3)


def shapes(lights: tuple[Light, ...]) -> Shapes:
    """The shapes of `lights`."""
    kinds = [FREE if light.type != "AREA" else ELLIPSE if light.area_ellipse else RECTANGLE for light in lights]
    size = [np.tan(light.angle / 2) if light.type == "SUN" else light.radius for light in lights]
    return Shapes(np.array(kinds, np.uint8), np.array(size, np.float64),
                  np.array([light.area_u for light in lights], np.float64).reshape(-1, 3),
                  np.array([light.area_v for light in lights], np.float64).reshape(-1, 3))


def narrowest(light: Light) -> float:
    """Half of the lamp's least width, by which its narrowest penumbra goes: scene units; of a SUN at distance 1."""
    if light.type == "SUN":
        return float(np.tan(light.angle / 2))
    if light.type != "AREA":
        return light.radius
    return min(float(np.linalg.norm(light.area_u)), float(np.linalg.norm(light.area_v)))


def points(shapes: Shapes, targets: Targets, origin: NDArray[np.float64], turn: NDArray[np.float64],
           row: NDArray[np.int32], light: NDArray[np.int32], first: int, count: int) -> Targets:
    """Points first..first+count (k·count,3) of light[k] as origin[row[k]] has them, pair after pair.

    origin (m,3): who looks, world; turn (m,2): how its pattern is turned.
    """
    out = np.empty((len(row) * count, 3))
    _points(first, count, origin, turn, row, light, *targets, *shapes, out)
    return Targets(out, np.repeat(targets.directional[light], count))


def turns_of_nodes(nodes: NDArray[np.int32]) -> NDArray[np.float64]:
    """How the patterns (n,2) of nodes (n,3) are turned."""
    out = np.empty((len(nodes), 2))
    _turns_of_nodes(nodes, out)
    return out


def turns_of_points(P: NDArray[np.float64]) -> NDArray[np.float64]:
    """How the patterns (n,2) of receivers (n,3) are turned."""
    out = np.empty((len(P), 2))
    _turns_of_points(P, out)
    return out
