"""Points on triangles that do not depend on the camera: barycentric grids, each twice as fine as the one before.

The edges of a triangle are divided into 2^k parts. The points of this grid are numbered by keys of 64 bits: the
triangle, its side, k, and two numbers of the point. Corners of small triangles are shared: where several triangles meet
with the same normal, one key stands for all. `grids.h` has the layout of keys.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Surfaces
from ..support.native import kernel

_around = kernel("grids_around")
_CORNER, _UPPER = np.uint64(1 << 63), np.uint64(1 << 62)
# Points are moved by this share of the distance between them, towards the middle of their triangle: none lies in the
# plane of a wall that stands on its triangle.
INSET = 0.012
FINEST = 13  # edges are divided into up to 2^FINEST parts, as in grids.h


class Around(NamedTuple):
    """The three grid points around each of n receivers."""

    keys: NDArray[np.uint64]  # (n,3)
    weight: NDArray[np.float64]  # (n,3)
    spacing: NDArray[np.float64]  # (n,) how far apart they are, scene units


class Places(NamedTuple):
    """Where grid points are."""

    P: NDArray[np.float64]  # (n,3) world
    N: NDArray[np.float64]  # (n,3) unit normal, to the side of the key
    spacing: NDArray[np.float64]  # (n,) how far apart they are
    own: NDArray[np.int32]  # (n,) the instance of a shared corner, −1 for others


class Grids:
    """The grids of all triangles of a scene."""

    def __init__(self, surfaces: Surfaces, coarse: float) -> None:
        """coarse: the largest distance between points, scene units."""
        s = self.surfaces = surfaces
        self.coarse = coarse
        self.flipped = np.ascontiguousarray(s.mirrored[s.instance])
        corners = s.vertices[s.triangles]
        edges = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2) * s.scale
        self.longest = edges.max(1, initial=0).astype(np.float32)
        self.shape = s.centre, s.scale, s.vertices, s.triangles
        self._share_corners()

    def _share_corners(self) -> None:
        """Give the corners of small triangles numbers by vertex and normal."""
        s = self.surfaces
        self.corner = np.full((len(s.triangles), 3), -1, np.int32)
        small = np.flatnonzero(self.longest <= self.coarse).astype(np.int32)
        self._class_P = self._class_N = np.zeros((0, 3))
        self._class_spacing, self._class_own = np.zeros(0), np.zeros(0, np.int32)
        if not len(small):
            return
        normal = self.corner_normals(small)
        vertex = s.triangles[small].astype(np.int64)
        steps = np.rint(normal * 64).astype(np.int64) + 64
        key = ((vertex * 129 + steps[..., 0]) * 129 + steps[..., 1]) * 129 + steps[..., 2]
        _, first, number = np.unique(key.ravel(), return_index=True, return_inverse=True)
        number = number.reshape(-1)
        self.corner[small] = number.reshape(-1, 3)
        place = s.vertices[s.triangles[small]].astype(np.float64) * s.scale + s.centre
        inward = (place.mean(1, keepdims=True) - place).reshape(-1, 3)
        count = np.bincount(number, minlength=len(first))[:, None]
        mean = np.stack([np.bincount(number, inward[:, j], len(first)) for j in range(3)], 1) / count
        self._class_N = normal.reshape(-1, 3)[first]
        self._class_own = s.instance[small[first // 3]]
        # only corners within a plane move: elsewhere they would move into the surface
        slope = np.abs(np.repeat(self.normals(small), 3, axis=0) - self._class_N[number]).max(1)
        flat = np.bincount(number, slope > 1e-3, len(first)) == 0
        self._class_P = place.reshape(-1, 3)[first]
        self._class_P[flat] += INSET * mean[flat] + INSET / 3 * inward[first][flat]
        self._class_spacing = np.zeros(len(first))
        np.maximum.at(self._class_spacing, number, np.repeat(self.longest[small], 3))

    def normals(self, triangle: NDArray) -> NDArray[np.float64]:
        """The unit normals (n,3) of triangles (n,), as their winding says."""
        s = self.surfaces
        a, b, c = np.moveaxis(s.vertices[s.triangles[triangle]].astype(np.float64), 1, 0)
        normal = np.cross(b - a, c - a)
        normal *= np.where(self.flipped[triangle], -1, 1)[:, None]
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def corner_normals(self, triangle: NDArray) -> NDArray[np.float64]:
        """The unit shading normals (n,3,3) at the corners of triangles (n,); those of the triangle where these are of
        no use.
        """
        s = self.surfaces
        local = s.at_corners(s.corner_normals, triangle)
        normal = np.einsum("nij,nkj->nki", s.normal_matrix[s.instance[triangle]], local)
        own = np.broadcast_to(self.normals(triangle)[:, None], normal.shape)
        length = np.linalg.norm(normal, axis=2, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            normal = normal / length
        good = np.isfinite(normal).all(2, keepdims=True) & ((normal * own).sum(2, keepdims=True) > 0.3)
        return np.where(good, normal, own)

    def around(self, triangle: NDArray[np.int32], P: NDArray[np.float64], Ng: NDArray[np.float64],
               level: int) -> Around:
        """The grid points around receivers P (n,3) on triangles (n,), seen from the side of Ng (n,3).

        level: 0 is the coarsest grid of each triangle; each level is twice as fine.
        """
        n = len(P)
        found = Around(np.empty((n, 3), np.uint64), np.empty((n, 3)), np.empty(n))
        _around(*self.shape, self.flipped, self.longest, self.corner, self.coarse, level, triangle, P, Ng, *found)
        return found

    def places(self, keys: NDArray[np.uint64]) -> Places:
        """Where the grid points with these keys (n,) are."""
        n = len(keys)
        number, front, depth, i, j = parts(keys)
        P, N, spacing, instance = np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.full(n, -1, np.int32)
        shared = (keys & _CORNER) != 0
        of = number[shared]
        P[shared], N[shared], spacing[shared] = self._class_P[of], self._class_N[of], self._class_spacing[of]
        instance[shared] = self._class_own[of]
        own = ~shared
        step = np.ldexp(1.0, -depth[own])
        third = 1 / 3
        u, v = i[own] * step, j[own] * step
        u, v = u + INSET * step * (third - u) * 2, v + INSET * step * (third - v) * 2
        P[own] = self.points(number[own], u, v)
        N[own] = self.normals(number[own])
        spacing[own] = self.longest[number[own]] * step
        N[~front] *= -1
        return Places(P, N, spacing, instance)

    def points(self, triangle: NDArray, u: NDArray, v: NDArray) -> NDArray[np.float64]:
        """The points (n,3) at barycentrics u, v (n,) of triangles (n,)."""
        s = self.surfaces
        a, b, c = np.moveaxis(s.vertices[s.triangles[triangle]].astype(np.float64), 1, 0)
        return s.centre + s.scale * (a + u[:, None] * (b - a) + v[:, None] * (c - a))

    def inside(self, keys: NDArray[np.uint64]) -> tuple[NDArray[np.int32], NDArray[np.bool_], NDArray, NDArray]:
        """The triangles (n,), whether it is their front (n,), and barycentrics u, v (n,4) of four points that stand
        for the small triangles with these keys (n,) as a whole.
        """
        number, front, depth, i, j = parts(keys)
        upper, step = (keys & _UPPER) != 0, np.ldexp(1.0, -depth)
        third = 1 / 3
        x = np.array([third, third / 2, third * 2, third / 2])
        y = np.array([third, third / 2, third / 2, third * 2])
        x, y = np.where(upper[:, None], 1 - x, x), np.where(upper[:, None], 1 - y, y)
        return number.astype(np.int32), front, (i[:, None] + x) * step[:, None], (j[:, None] + y) * step[:, None]

    def wider(self, keys: NDArray[np.uint64], by: int) -> NDArray[np.uint64]:
        """The keys (n,) of small triangles around those with these keys, whose edges are 2^by times as long."""
        number, front, depth, i, j = parts(keys)
        third = np.where((keys & _UPPER) != 0, 2 / 3, 1 / 3)
        new = np.maximum(depth - by, 0)
        step = np.ldexp(1.0, new - depth)
        u, v = (i + third) * step, (j + third) * step
        i, j = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
        upper = (u - i) + (v - j) > 1
        return _key(number, front, new, i, j, upper)

    def finer(self, keys: NDArray[np.uint64], u: NDArray, v: NDArray) -> NDArray[np.uint64]:
        """The keys (n,) of the small triangles at u, v (n,) in grids that are twice as fine as those of these keys."""
        number, front, depth, _, _ = parts(keys)
        new = depth + 1
        parts_ = np.ldexp(1.0, new)
        u, v = np.clip(u.astype(np.float64), 0, 1), np.clip(v.astype(np.float64), 0, 1)
        v = np.minimum(v, 1 - u)
        i = np.minimum(u * parts_, parts_ - 1).astype(np.int64)
        j = np.minimum(v * parts_, parts_ - 1 - i).astype(np.int64)
        upper = ((u * parts_ - i) + (v * parts_ - j) > 1) & (i + j + 2 <= parts_)
        return _key(number, front, new, i, j, upper)


def _key(number: NDArray, front: NDArray, depth: NDArray, i: NDArray, j: NDArray,
         upper: NDArray) -> NDArray[np.uint64]:
    """The keys (n,) of small triangles."""
    found: NDArray[np.uint64] = np.bitwise_or.reduce([
        number, front.astype(np.int64) << 31, depth << 32, i << 36, j << 49, upper.astype(np.int64) << 62]).astype(
            np.uint64)
    return found


def parts(keys: NDArray[np.uint64]) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Triangle or class, front, depth, i and j of keys (n,)."""
    def bits(first: int, count: int) -> NDArray[np.int64]:
        return ((keys >> np.uint64(first)) & np.uint64((1 << count) - 1)).astype(np.int64)

    return bits(0, 31), bits(31, 1) > 0, bits(32, 4), bits(36, 13), bits(49, 13)
