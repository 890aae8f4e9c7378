"""Points and cells on triangles that do not depend on the camera: grids, each twice as fine as the one before.

Two triangles that make up a parallelogram share a grid along its sides; any other has one along its longest edge and
its height. Points and cells are numbered by keys of 64 bits: the triangle, its side, the level of the grid, and two
numbers of the point. Corners of small triangles are shared: where several triangles meet with the same normal, one key
stands for all. `grids.h` has the layout of keys.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Surfaces
from ..support.native import kernel

_places, _inside = kernel("grids_places"), kernel("grids_inside")
_wider = kernel("grids_wider")
_longest, _pairs, _corners = kernel("grids_longest"), kernel("grids_pairs"), kernel("grids_corners")
CORNER = np.uint64(1 << 63)  # the bit of keys of shared corners, as in grids.h
INSET = 0.012  # as in grids.h
NORMALS = 64.0  # steps of the coordinates of normals, within which the corners of triangles are one
LAST = 15  # the finest level of a grid
FLAT = 1e-5  # how much two triangles may differ from a parallelogram, as a share of the edge that they share


class Places(NamedTuple):
    """Where grid points are."""

    P: NDArray[np.float64]  # (n,3) world
    N: NDArray[np.float64]  # (n,3) unit normal, to the side of the key
    spacing: NDArray[np.float64]  # (n,) how far apart they are
    own: NDArray[np.int32]  # (n,) the instance of a shared corner, −1 for others


class Grids:
    """The grids of all triangles of a scene."""

    def __init__(self, surfaces: Surfaces, coarse: float, top: float) -> None:
        """coarse: the largest distance between points; top: the size of the largest cells; scene units."""
        s = self.surfaces = surfaces
        self.coarse, self.top = coarse, top
        self.flipped = np.ascontiguousarray(s.mirrored[s.instance])
        self.longest, ends = np.empty(len(s.triangles), np.float32), np.empty((len(s.triangles), 2), np.int32)
        _longest(s.scale, s.vertices, s.triangles, self.longest, ends)
        self.shape = s.centre, s.scale, s.vertices, s.triangles
        self.other = self._pair(ends)
        self._share_corners()

    def _pair(self, ends: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return for each of the triangles (T,) the one with which it makes up a parallelogram; −1: none. ends (T,2):
        the vertices of their longest edges.
        """
        s = self.surfaces
        order = np.lexsort((ends[:, 1], ends[:, 0])).astype(np.int32)
        same = (ends[order[1:]] == ends[order[:-1]]).all(1)
        alone = ~np.append(False, same[:-1]) & ~np.append(same[1:], False)  # three at an edge are no pair
        at = np.flatnonzero(same & alone) if len(same) else np.zeros(0, np.int64)
        pair = np.sort(np.stack([order[at], order[at + 1]], 1), axis=1)
        first, second = np.ascontiguousarray(pair[:, 0]), np.ascontiguousarray(pair[:, 1])
        ok = np.empty(len(first), np.bool_)
        _pairs(s.vertices, s.triangles, FLAT, first, second, ok)
        ok &= (s.instance[first] == s.instance[second]) & (
            s.materials[s.source[first]] == s.materials[s.source[second]])
        other = np.full(len(ends), -1, np.int32)
        other[first[ok]], other[second[ok]] = second[ok], first[ok]
        return other

    def _share_corners(self) -> None:
        """Give the corners of small triangles numbers by vertex and normal."""
        s = self.surfaces
        self.corner = np.full((len(s.triangles), 3), -1, np.int32)
        small = np.flatnonzero(self.longest <= self.coarse).astype(np.int32)
        self._class_P = self._class_N = np.zeros((0, 3))
        self._class_spacing, self._class_own = np.zeros(0), np.zeros(0, np.int32)
        if not len(small):
            return
        most = 3 * len(small)
        slots, vertex, turn = np.full(1 << (2 * most).bit_length(), -1, np.int32), *np.empty((2, most), np.int32)
        number = np.empty((len(small), 3), np.int32)
        P, N, spacing, own = np.empty((most, 3)), np.empty((most, 3)), np.empty(most), np.empty(most, np.int32)
        n = _corners(*self.shape, self.flipped, self.longest, s.instance, s.normal_matrix,
                     s.at_corners(s.corner_normals, small), small, NORMALS, INSET, slots, vertex, turn,
                     np.empty((most, 4)), np.empty(most, np.bool_), number, P, N, spacing, own)
        self.corner[small] = number
        self._class_P, self._class_N = P[:n].copy(), N[:n].copy()
        self._class_spacing, self._class_own = spacing[:n].copy(), own[:n].copy()

    @property
    def corners(self) -> Places:
        """Return where the shared corners of small triangles are, by their numbers."""
        return Places(self._class_P, self._class_N, self._class_spacing, self._class_own)

    def normals(self, triangle: NDArray) -> NDArray[np.float64]:
        """Return the unit normals (n,3) of triangles (n,), on the side given by their winding."""
        s = self.surfaces
        a, b, c = np.moveaxis(s.vertices[s.triangles[triangle]].astype(np.float64), 1, 0)
        normal = np.cross(b - a, c - a)
        normal *= np.where(self.flipped[triangle], -1, 1)[:, None]
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def places(self, keys: NDArray[np.uint64], inset: float = INSET) -> Places:
        """Return where the grid points with these keys (n,) are. inset: the share of a cell's edge by which those at a
        border are moved inwards.
        """
        n = len(keys)
        P, N, spacing, instance = np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.full(n, -1, np.int32)
        shared = (keys & CORNER) != 0
        of = (keys[shared] & np.uint64((1 << 31) - 1)).astype(np.int64)
        front = (keys[shared] >> np.uint64(31) & np.uint64(1)).astype(np.int8)
        P[shared], spacing[shared], instance[shared] = self._class_P[of], self._class_spacing[of], self._class_own[of]
        N[shared] = self._class_N[of] * (2 * front - 1)[:, None]
        own = np.flatnonzero(~shared)
        found = np.empty((len(own), 3)), np.empty((len(own), 3)), np.empty(len(own))
        _places(*self.shape, self.other, self.flipped, self.coarse, inset, keys[own], *found)
        P[own], N[own], spacing[own] = found
        return Places(P, N, spacing, instance)

    def inside(self, keys: NDArray[np.uint64],
               outer: bool = False) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
        """Return the triangles (4n,), places and normals (4n,3) of four points that stand for each of the cells with
        these keys (n,). outer: of points near its corners instead.
        """
        n = len(keys)
        triangle, P, N = np.empty((n, 4), np.int32), np.empty((n, 4, 3)), np.empty((n, 4, 3))
        _inside(*self.shape, self.other, self.flipped, self.top, outer, keys, triangle, P, N)
        return triangle.reshape(-1), P.reshape(-1, 3), N.reshape(-1, 3)

    def wider(self, keys: NDArray[np.uint64], by: int, for_small: NDArray[np.int32]) -> NDArray[np.uint64]:
        """Return the keys (n,) of the cells around those with these keys, whose edges are 2^by times as long. for_small
        (s,T): the triangles that stand for smaller ones; see `Gatherer`.
        """
        s, found = self.surfaces, np.empty(len(keys), np.uint64)
        _wider(s.scale, s.vertices, s.triangles, self.other, self.top, for_small, by, keys, found)
        return found

    def sizes(self, keys: NDArray[np.uint64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the edges (n,) of the cells with these keys (n,), scene units, and their levels: 0 is a whole
        triangle.
        """
        level = (keys >> np.uint64(32) & np.uint64(15)).astype(np.int64)
        triangle = (keys & np.uint64((1 << 31) - 1)).astype(np.int64)
        return np.where(level == 0, self.longest[triangle], np.ldexp(2 * self.top, -level)), level
