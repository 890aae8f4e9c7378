"""Sheets in one place: cut-outs, films and what lies on them, nearer to each other than a ray leaves a surface.

Embree gives one surface of those that are in one place, and a ray that goes on leaves all of them behind. So the
triangles that lie in a sheet's place are known beforehand, as its partners, and rays that meet one of them look at all
in float64. Where rounded vertices do not tell which is in front, a sheet lies on an opaque surface, on either side of
it, and on the outside of one that bends light. Of two sheets in exactly one place the first of the scene lies on the
side of SIDE.
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

NEAR = 64 * 2.0**-23  # in the frame's box: four times as far as a ray leaves its surface
SHEET, OPAQUE, BENDS = np.uint8(0), np.uint8(1), np.uint8(2)


class Stacks(NamedTuple):
    """The partners of triangle t are partner[first[t]:first[t+1]]."""

    first: NDArray[np.int64]  # (T+1,)
    partner: NDArray[np.int32]
    nature: NDArray[np.uint8]  # (T,) SHEET, OPAQUE or BENDS

    def first_of_all(self, s: Surfaces, seen: NDArray[np.bool_], start: NDArray, direction: NDArray,
                     last: NDArray[np.int32], triangle: NDArray[np.int32], u: NDArray, v: NDArray) -> None:
        """Put the first surface of those in one place where Embree found one, or where a ray goes on.

        start, direction (n,3): where rays began, world. last (n,): the triangle that they met or left last, −1: none.
        seen (T,): what they may meet. triangle (n,), −1: none, and u, v are Embree's, and changed.
        """
        _first_of_all(s.centre, s.scale, *self._of(s), seen, start, direction, last, triangle, u, v)

    def also_crossed(self, s: Surfaces, seen: NDArray[np.bool_], triangle: NDArray[np.int32], start: NDArray,
                     end: NDArray, leaving: bool, done: NDArray, until: NDArray, *found: NDArray) -> int:
        """The partners of `triangle` (n,), −1: none, that segments start..end (n,3; frame) cross from done to until.

        These are shares of the segments. leaving: the triangles are those that the segments leave, and what lies on
        them counts from there. Fills row, partner, u, v of `found` as far as they have room; returns how many are.
        """
        return _also_crossed(*self._of(s), seen, triangle, start, end, leaving, done, until, *found)

    def _of(self, s: Surfaces) -> tuple[NDArray, ...]:
        return s.vertices, s.triangles, s.instance, s.mirrored, self.first, self.partner, self.nature


def stacks(surfaces: Surfaces, passes: NDArray[np.bool_], bends: NDArray[np.bool_]) -> Stacks | None:
    """What lies in the place of sheets, or a sheet in its; None: nothing does.

    passes (T,): what lets light through; bends (T,): and bends it. Sheets are those that only let it through.
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
