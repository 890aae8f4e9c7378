"""Points of lamps, as programs of lamps ask about them: one for each receiver that a lamp lights.

A lamp's nodes get the same inputs as in Cycles: its point, the way from there to the receiver as normal and as
Incoming, a place on its face or in its cone as UV and Parametric, and the distance of the receiver. The point is the
lamp's centre; on a face, `faces` chooses it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Camera, Light
from .profiles import Lookup

NOTHING = -1  # the kind of ray that comes to a lamp: none of those in `points`
MEAN = 2 / 3  # of a ball's radius: how much nearer than its centre the points are that one sees, in the mean
ENDLESS = 3.4e38  # how far a sun is
CELLS = 5  # along each side of what is seen of a lamp


class Cells:
    """Cells of a square with sides of 1. Along each side their widths are the weights of Gauss's rule."""

    def __init__(self, count: int) -> None:
        at, wide = np.polynomial.legendre.leggauss(count)
        self.at, self.wide = (at + 1) / 2, wide / 2  # (count,) a point of each, and its width
        self.edges = np.concatenate([[0.0], np.cumsum(self.wide)])
        self.area = np.outer(self.wide, self.wide)


FEW = Cells(CELLS)


def _disc() -> NDArray[np.float64]:
    """Return the points (5,5,2) of cells on the unit disc: Shirley and Chiu's map, which keeps areas."""
    x, y = np.meshgrid(2 * FEW.at - 1, 2 * FEW.at - 1, indexing="ij")
    flat = np.abs(x) > np.abs(y)
    r = np.where(flat, x, y)
    angle = np.where(flat, y / np.where(x != 0, x, 1.0), 2 - x / np.where(y != 0, y, 1.0)) * (np.pi / 4)
    return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=2)


DISC = _disc()


class Spaces:
    """The data that is the same for all points of a lamp: its own space, and what else programs may ask for."""

    def __init__(self, lights: Sequence[Light], camera: Camera, profiles: Sequence[Lookup]) -> None:
        matrix = np.array([light.matrix or np.eye(4)[:3] for light in lights], np.float64).reshape(-1, 3, 4)
        self.to_world = matrix[:, :, :3]  # (L,3,3)
        back = np.linalg.pinv(self.to_world)
        self.to_object = np.concatenate([back, -back @ matrix[:, :, 3:]], axis=2)  # (L,3,4)
        self.to_generated = self.to_object
        self.camera, self.to_camera = camera, np.linalg.inv(camera.matrix)[:3]
        self.eye = np.zeros(3)  # as in `Around`
        self.profiles = profiles
        self.centre = np.array([light.position for light in lights], np.float64).reshape(-1, 3)
        self.radius = np.array([light.radius for light in lights])
        self.disc = np.array([light.facing_disc for light in lights], np.bool_)
        self.spot = np.array([light.type == "SPOT" for light in lights], np.bool_)
        half = np.array([min(max(light.spot_angle, 1e-6), 3.14159) / 2 for light in lights])
        self.narrow = 0.5 / np.tan(half)

    @cached_property
    def from_object(self) -> NDArray[np.float64]:
        """Return the ways back from lamps' own spaces (L,3,3), made when a program first asks for them."""
        return np.linalg.pinv(self.to_object[:, :, :3])


class Sources:
    """Points (n,) of lamps with a place, and the receivers that they light."""

    def __init__(self, spaces: Spaces, instance: NDArray[np.int64], P: NDArray[np.float64], normal: NDArray[np.float64],
                 incoming: NDArray[np.float64], length: NDArray[np.float64],
                 uv: NDArray[np.float64] | None = None) -> None:
        """instance (n,): whose points they are; P, normal, incoming (n,3), unit; length (n,): of the way to the
        receiver; uv (n,2): where on a face, None: by the direction.
        """
        self.around, self.instance, self.P, self.Ns, self.Ng = spaces, instance, P, normal, normal
        self.incoming, self.length, self._uv = incoming, length, uv
        self.front = np.ones(len(P), np.bool_)
        self.ray = np.full(len(P), NOTHING, np.int8)

    @cached_property
    def uv(self) -> NDArray[np.float64]:
        """Return the place (n,2) on a lamp, 0 to 1: on its face, in its cone, or on a sphere around it."""
        if self._uv is not None:
            return self._uv
        s = self.around
        spot = s.spot[self.instance]
        from_it = np.where(spot[:, None], self.incoming, self.Ns)
        x, y, z = np.einsum("nij,nj->ni", s.to_object[self.instance, :, :3], from_it).T
        with np.errstate(all="ignore"):
            factor = s.narrow[self.instance] / -z
            u = np.where((x == 0) & (y == 0), 0.0, 0.5 * (1 - np.arctan2(x, y) / np.pi))
            up = 1 - np.arccos(np.clip(z / np.sqrt(x * x + y * y + z * z), -1, 1)) / np.pi
        found = np.stack([np.where(spot, 0.5 + x * factor, u), np.where(spot, 0.5 + y * factor, up)], axis=1)
        return np.nan_to_num(found, nan=0.0, posinf=1e30, neginf=-1e30)

    @property
    def parametric(self) -> NDArray[np.float64]:
        """Return the same, as Cycles has it."""
        return self.uv

    def shifted(self, direction: int, width: float) -> Sources:
        """Return these points: programs of lamps never ask for points beside them."""
        return self


def toward(spaces: Spaces, instance: NDArray[np.int64], P: NDArray[np.float64]) -> Sources:
    """Return the points of lamps that are asked at their centre, for receivers at P (n,3). instance (n,): which lamps.
    """
    way = P - spaces.centre[instance]
    far = np.sqrt(np.einsum("ni,ni->n", way, way))
    way /= np.maximum(far, 1e-300)[:, None]
    radius, disc = spaces.radius[instance], spaces.disc[instance]
    before = np.where(disc, 0.0, np.minimum(MEAN * radius, far))
    length = np.where(disc, np.sqrt(far * far + 0.5 * radius * radius), far - before)
    return Sources(spaces, instance, spaces.centre[instance] + before[:, None] * way, way, way, length)


def met(spaces: Spaces, instance: NDArray[np.int64], origin: NDArray[np.float64],
        direction: NDArray[np.float64]) -> Sources:
    """Return the points of spheres and of discs turned to the eye that rays see, from origin along unit direction,
    (n,3).
    """
    to, radius = spaces.centre[instance] - origin, spaces.radius[instance]
    along, square = np.einsum("ni,ni->n", to, direction), np.einsum("ni,ni->n", to, to)
    disc = spaces.disc[instance]
    far = np.where(disc, square / np.maximum(along, 1e-300),
                   along - np.sqrt(np.maximum(radius * radius - (square - along * along), 0)))
    place = origin + far[:, None] * direction
    outward = (place - spaces.centre[instance]) / np.maximum(radius, 1e-300)[:, None]
    return Sources(spaces, instance, place, np.where(disc[:, None], -direction, outward), -direction, far)


def balls(spaces: Spaces, instance: NDArray[np.int64], P: NDArray[np.float64]) -> Sources:
    """Return points on spherical lamps: CELLS² for each of `instance` (n,), over the part that a receiver at P (n,3)
    sees.
    """
    way = P - spaces.centre[instance]
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    side = np.cross(way, np.where(np.abs(way[:, :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    x, y = DISC.reshape(-1, 2).T
    normal = (np.sqrt(np.maximum(1 - x * x - y * y, 0))[:, None] * way[:, None] + x[:, None] * side[:, None]
              + y[:, None] * np.cross(way, side)[:, None]).reshape(-1, 3)
    each = np.repeat(instance, len(x))
    place = spaces.centre[each] + spaces.radius[each, None] * normal
    back = np.repeat(P, len(x), axis=0) - place
    far = np.linalg.norm(back, axis=1)
    return Sources(spaces, each, place, normal, back / np.maximum(far, 1e-300)[:, None], far)


def suns(spaces: Spaces, instance: NDArray[np.int64], travels: NDArray[np.float64]) -> Sources:
    """Return the points of suns whose light travels along `travels` (n,3): the same for all receivers."""
    n = len(instance)
    return Sources(spaces, instance, travels, travels, travels, np.full(n, ENDLESS), np.full((n, 2), 0.5))
