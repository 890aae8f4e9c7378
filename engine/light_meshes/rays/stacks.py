"""Sheets that coincide: cut-outs, films and the surfaces on which they lie, nearer to each other than the distance by
which a ray leaves a surface.

Where surfaces coincide, Embree reports only one of them, and a ray that continues leaves all of them behind. So the
triangles that coincide with a sheet are found in advance (its partners), and a ray that hits one of them tests all of
them in float64. If rounded vertices do not tell which one is in front, these rules apply. A sheet lies on an opaque
surface, on both sides of it, and on the outside of a surface that bends light. If two sheets coincide exactly, the
first one in the scene lies on the side of SIDE.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel
from .boxes import box_tree
from .geometry import Surfaces

_pairs, place_of = kernel("stacks_pairs"), kernel("stacks_place_of")
_first_of_all, _also_crossed = kernel("stacks_first_of_all"), kernel("stacks_also_crossed")

NEAR = 64 * 2.0**-23  # relative to the frame's box: four times the distance by which a ray leaves its surface
SHEET, OPAQUE, BENDS = np.uint8(0), np.uint8(1), np.uint8(2)


class Stacks(NamedTuple):
    """The partners of triangle t are partner[first[t]:first[t+1]]."""

    first: NDArray[np.int64]  # (T+1,)
    partner: NDArray[np.int32]
    nature: NDArray[np.uint8]  # (T,) SHEET, OPAQUE or BENDS

    def first_of_all(self, s: Surfaces, seen: NDArray[np.bool_], start: NDArray, direction: NDArray,
                     last: NDArray[np.int32], triangle: NDArray[np.int32], u: NDArray, v: NDArray) -> None:
        """Replace Embree's hits by the first of the surfaces that coincide there, or that coincide with the surface
        that a ray leaves.

        `start`, `direction` (n,3): where the rays began, in the world. `last` (n,): the triangle that each ray hit or
        left last, −1 if none. `seen` (T,): the triangles that the rays may hit. `triangle` (n,), −1 if none, and u, v
        are Embree's result and are changed.
        """
        _first_of_all(s.centre, s.scale, *self._of(s), seen, start, direction, last, triangle, u, v)

    def also_crossed(self, s: Surfaces, seen: NDArray[np.bool_], triangle: NDArray[np.int32], start: NDArray,
                     end: NDArray, leaving: bool, done: NDArray, until: NDArray, *found: NDArray) -> int:
        """Find the partners of `triangle` (n,), −1 if none, that the segments start..end (n,3; in the frame) cross
        between the shares `done` and `until`.

        `leaving`: the segments begin on these triangles, and partners on the side to which they go count. Fills row,
        partner, u, v of `found` as far as there is room. Returns how many partners there are.
        """
        return _also_crossed(*self._of(s), seen, triangle, start, end, leaving, done, until, *found)

    def _of(self, s: Surfaces) -> tuple[NDArray, ...]:
        return s.vertices, s.triangles, s.instance, s.mirrored, self.first, self.partner, self.nature


def stacks(surfaces: Surfaces, passes: NDArray[np.bool_], bends: NDArray[np.bool_]) -> Stacks | None:
    """Return the triangles that coincide with sheets; None if there are none.

    `passes` (T,): triangles that let light through; `bends` (T,): those of them that bend it. Sheets are those that
    pass light without bending it.
    """
    sheets = passes & ~bends
    index = np.flatnonzero(sheets).astype(np.int32)
    if not len(index):
        return None
    corners = surfaces.vertices[surfaces.triangles[index]].astype(np.float64)
    pad = NEAR * np.maximum(1.0, np.abs(corners).max((1, 2)))[:, None]
    order, box, child = box_tree(np.concatenate([corners.min(1) - pad, corners.max(1) + pad], axis=1))
    room = 1024
    while True:
        found = np.empty((room, 2), np.int32)
        count = _pairs(surfaces.vertices, surfaces.triangles, index[order], box, child, found)
        if count <= room:
            break
        room = count
    if not count:
        return None
    found = found[:count]
    found = np.concatenate([found, found[~sheets[found[:, 0]], ::-1]])
    found = found[np.lexsort((found[:, 1], found[:, 0]))]
    first = np.zeros(len(surfaces.triangles) + 1, np.int64)
    np.cumsum(np.bincount(found[:, 0], minlength=len(surfaces.triangles)), out=first[1:])
    nature = np.where(sheets, SHEET, np.where(bends, BENDS, OPAQUE)).astype(np.uint8)
    return Stacks(first, np.ascontiguousarray(found[:, 1]), nature)
