"""Lamps with a size, seen: in mirrors, through glass, and by the camera, where the artist lets them be.

A lamp is drawn as what lights surfaces: a sphere or a disc that is turned to the eye (POINT, SPOT), a disc of the sky
(SUN), a rectangle or an ellipse (AREA), with the radiance that its light has. As in Cycles a lamp hides nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..lights import registry
from ..scene.description import Light
from ..support.native import kernel
from .points import CAMERA, REFLECTED, TRANSMITTED

_lamps = kernel("seen_lamps")
_BALL, _TURNED_DISC, _RECTANGLE, _ELLIPSE, _SKY_DISC = range(5)  # as in seen.c
_BOUNDS = {"AREA": 1, "SPOT": 2}


def radiance(light: Light) -> NDArray[np.float64]:
    """The radiance (3,) of a lamp with a size, as it is seen along its axis."""
    intensity = np.array(light.intensity, np.float64)
    if light.type == "SUN":
        return intensity / np.sin(light.angle / 2) ** 2
    if light.type == "AREA":
        area = np.linalg.norm(np.cross(light.area_u, light.area_v)) * (np.pi if light.area_ellipse else 4.0)
        return intensity * np.pi / area
    return intensity / light.radius**2


def _has_size(light: Light) -> bool:
    if light.softness != "SIZE" or not any(light.intensity):
        return False
    return bool(light.angle > 0 if light.type == "SUN" else np.cross(light.area_u, light.area_v).any()
                if light.type == "AREA" else light.radius > 0)


def seen_in_mirrors(light: Light) -> bool:
    """Whether rays that mirrors reflect see the lamp."""
    return light.seen_in_mirrors and _has_size(light)


class SeenLamps:
    """The lamps of a scene that some rays see."""

    def __init__(self, lights: Sequence[Light]) -> None:
        kinds = ((1 << CAMERA, "seen_by_camera"), (1 << REFLECTED, "seen_in_mirrors"),
                 (1 << TRANSMITTED, "seen_in_glass"))
        seen = [(light, sum(bit * getattr(light, name) for bit, name in kinds)) for light in lights if _has_size(light)]
        found = [(light, rays) for light, rays in seen if rays]
        self._rays = np.array([rays for _, rays in found], np.uint8)
        self.by = int(np.bitwise_or.reduce(self._rays)) if found else 0  # the kinds of rays that see any, as bits
        self._shapes = (
            np.array([_shape(light) for light, _ in found], np.int8),
            np.array([_BOUNDS.get(light.type, 0) for light, _ in found], np.int8))
        self._places = (
            _rows([light.position for light, _ in found]),
            _rows([np.array(light.direction) / np.linalg.norm(light.direction) for light, _ in found]),
            np.array([_across(light) for light, _ in found], np.float64).reshape(-1, 2, 3),
            np.array([np.sin(light.angle / 2) ** 2 if light.type == "SUN" else light.radius for light, _ in found]),
            np.array([_limits(light) for light, _ in found], np.float64).reshape(-1, 2),
            _rows([radiance(light) for light, _ in found]))

    def light(self, origin: NDArray[np.float64], direction: NDArray[np.float64], reach: NDArray[np.float64],
              ray: NDArray[np.int8]) -> NDArray[np.float64]:
        """The radiance (n,3) of the lamps that rays meet, from origin (n,3) along unit direction (n,3), before `reach`
        (n,). ray (n,): their kinds, as in `points`.
        """
        light = np.empty((len(origin), 3))
        _lamps(origin, direction, reach, np.left_shift(1, ray).astype(np.uint8), *self._shapes, self._rays,
               *self._places, light)
        return light


def _rows(values: list) -> NDArray[np.float64]:
    return np.array(values, np.float64).reshape(-1, 3)


def _shape(light: Light) -> int:
    if light.type == "AREA":
        return _ELLIPSE if light.area_ellipse else _RECTANGLE
    return _SKY_DISC if light.type == "SUN" else _TURNED_DISC if light.facing_disc else _BALL


def _across(light: Light) -> NDArray[np.float64]:
    """The vectors (2,3) in the plane of a face whose products with a place on it are its two coordinates, −1 … 1."""
    if light.type != "AREA":
        return np.zeros((2, 3))
    return np.linalg.pinv(np.array([light.area_u, light.area_v], np.float64).T)


def _limits(light: Light) -> tuple[float, float]:
    """What bounds the directions in which the lamp shines; without bounds a slope of 0 (AREA) or a wide cone."""
    return registry.KINDS[light.type].numbers(light)
