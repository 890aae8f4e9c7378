"""Lamps with a size that rays see: in mirrors, through glass, and from the camera, if the artist allows it.

A lamp is drawn with the shape that lights surfaces: a sphere or a disc that is turned to the eye (POINT, SPOT), a disc
of the sky (SUN), a rectangle or an ellipse (AREA), with the radiance of its light. As in Cycles a lamp hides nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..lights import registry
from ..scene.description import Light
from ..support.native import kernel
from . import sized
from .lamps import Lamps
from .points import CAMERA, REFLECTED, TRANSMITTED

_lamps = kernel("seen_lamps")
_BALL, _TURNED_DISC, _RECTANGLE, _ELLIPSE, _SKY_DISC = range(5)  # as in seen.c
_BOUNDS = {"AREA": 1, "SPOT": 2}


def radiance(light: Light) -> NDArray[np.float64]:
    """Return the radiance (3,) of a lamp with a size, as it is seen along its axis."""
    return np.array(light.intensity, np.float64) * (np.pi / sized.area(light))


def _is_seen(light: Light) -> bool:
    return sized.kind(light) is not None and any(light.intensity)


def seen_in_mirrors(light: Light) -> bool:
    """Return whether rays that mirrors reflect see the lamp."""
    return light.seen_in_mirrors and _is_seen(light)


class SeenLamps:
    """The lamps of a scene that some rays see."""

    def __init__(self, lights: Sequence[Light], programs: Lamps) -> None:
        """programs: of these lights."""
        kinds = ((1 << CAMERA, "seen_by_camera"), (1 << REFLECTED, "seen_in_mirrors"),
                 (1 << TRANSMITTED, "seen_in_glass"))
        seen = [(light, sum(bit * getattr(light, name) for bit, name in kinds), i)
                for i, light in enumerate(lights) if _is_seen(light)]
        found = [one for one in seen if one[1]]
        rays = [bits for _, bits, _ in found]
        self.by = int(np.bitwise_or.reduce(np.array(rays, np.uint8))) if found else 0  # that see any, as bits
        self._plain = _arrays([(light, bits) for light, bits, _ in found if not light.program])
        painted = [one for one in found if one[0].program]
        self._painted = _arrays([(light, bits) for light, bits, _ in painted])
        self._alone = [(i, _arrays([(light, bits)])) for light, bits, i in painted]
        self._programs = programs

    def light(self, origin: NDArray[np.float64], direction: NDArray[np.float64], reach: NDArray[np.float64],
              ray: NDArray[np.int8]) -> NDArray[np.float64]:
        """Return the radiance (n,3) of the lamps that rays meet, from origin (n,3) along unit direction (n,3), before
        `reach` (n,). ray (n,): their kinds, as in `points`.
        """
        light, bits = np.empty((len(origin), 3)), np.left_shift(1, ray).astype(np.uint8)
        _lamps(origin, direction, reach, bits, *self._plain, light)
        if self._alone:
            glow = np.empty_like(light)
            _lamps(origin, direction, reach, bits, *self._painted, glow)
            rows = np.flatnonzero(glow.any(1))
            for i, lamp in self._alone if len(rows) else ():
                one = np.empty((len(rows), 3))
                _lamps(origin[rows], direction[rows], reach[rows], bits[rows], *lamp, one)
                some = np.flatnonzero(one.any(1))
                at = rows[some]
                light[at] += one[some] * self._programs.seen(i, origin[at], direction[at])
        return light


def _arrays(found: Sequence[tuple[Light, int]]) -> tuple[NDArray, ...]:
    """Return what the kernel wants to know of lamps, and of the kinds of rays that see them."""
    lights = [light for light, _ in found]
    return (np.array([_shape(light) for light in lights], np.int8),
            np.array([_BOUNDS.get(light.type, 0) for light in lights], np.int8),
            np.array([rays for _, rays in found], np.uint8),
            _rows([light.position for light in lights]),
            _rows([np.array(light.direction) / np.linalg.norm(light.direction) for light in lights]),
            np.array([_across(light) for light in lights], np.float64).reshape(-1, 2, 3),
            np.array([sized.size(light) ** 2 if light.type == "SUN" else light.radius for light in lights],
                     np.float64),
            np.array([_limits(light) for light in lights], np.float64).reshape(-1, 2),
            _rows([radiance(light) for light in lights]))


def _rows(values: list) -> NDArray[np.float64]:
    return np.array(values, np.float64).reshape(-1, 3)


def _shape(light: Light) -> int:
    if light.type == "AREA":
        return _ELLIPSE if light.area_ellipse else _RECTANGLE
    return _SKY_DISC if light.type == "SUN" else _TURNED_DISC if light.facing_disc else _BALL


def _across(light: Light) -> NDArray[np.float64]:
    """Return the vectors (2,3) in the plane of a face whose products with a place on it are its two coordinates, −1 …
    1.
    """
    if light.type != "AREA":
        return np.zeros((2, 3))
    return np.linalg.pinv(np.array([light.area_u, light.area_v], np.float64).T)


def _limits(light: Light) -> tuple[float, float]:
    """Return what bounds the directions in which the lamp shines; without bounds a slope of 0 (AREA) or a wide cone."""
    return registry.KINDS[light.type].numbers(light)
