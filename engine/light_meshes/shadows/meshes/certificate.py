"""The certificate: receivers for which every candidate is visible without tracing a ray (method §5).

Nothing can be between P and a node above its surface if everything within r of P belongs to P's own *body*. A body is
an instance with no part above the planes of its own triangles (a convex one), or the triangles of one plane. A grid of
cells as large as r stores which body is in each cell; a receiver checks its own cell and the 26 around it.

The result is exactly Embree's. A ray starts ULPS away from P, and bodies and planes are right within a few ulps. Nodes
less than MARGIN above P's plane are left to Embree. (An ulp is that of 1 in the tracer's frame. Points outside of [−1,
1]³ are left to Embree, too.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...rays.geometry import Surfaces
from ...rays.tracer import ULPS
from ...support import processors
from ...support.native import kernel, needs_memory

_convex, _keys, _planes = kernel("certificate_convex"), kernel("certificate_keys"), kernel("certificate_planes")
_sorted, _boxes = kernel("certificate_sorted"), kernel("certificate_boxes")
_about, _fill, _grown = kernel("certificate_about"), kernel("certificate_fill"), kernel("certificate_grown")
_holds = kernel("certificate_holds")

MARGIN = 2 * ULPS
CELLS = 1 << 19  # about the largest number of cells; if there would be more, the cells are made larger
GROUP = 8
UNKNOWN = -3  # certificate.h has the same


class Convex(NamedTuple):
    """The vertices of instances that seem convex, sorted so that neighbours are adjacent, with two levels of boxes
    around them.
    """

    vertices: NDArray[np.float64]  # (3,n) in the frame
    boxes: NDArray[np.float64]  # (b,2,3) centre and half the size of a box around GROUP vertices
    larger: NDArray[np.float64]  # (g,2,3) the same around GROUP boxes
    first: NDArray[np.int64]  # (I+1,) the larger boxes of instance i are first[i]:first[i+1]


class Certificate(NamedTuple):
    """The bodies, and the grid of those that shadow rays can hit."""

    surfaces: Surfaces
    casts: NDArray[np.bool_]  # (T,) triangles that shadow rays can hit
    r: float  # world
    cell: float  # edge of a cell in the frame, a little more than r
    body: NDArray[np.int32]  # (T,) number of the body; −1 if it belongs to none
    # (T,) ABOVE, BELOW: the sides on which no part of the same body is; UNSURE: not tested yet
    clear: NDArray[np.uint8]
    convex: Convex
    keys: NDArray[np.int64]  # hash table of cells; −1: free
    only: NDArray[np.int32]  # the only body in the cell, or SEVERAL
    around: NDArray[np.int32]  # the only body in the cell and the 26 around it; SEVERAL; or UNKNOWN: not computed yet

    def holds(self, P: NDArray[np.float64], N: NDArray[np.float64], triangle: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Return which receivers (n,), on the side N of `triangle` (n,), see all nodes that are more than MARGIN above
        it within r.
        """
        out = np.empty(len(P), np.bool_)
        self.asked()(P, N, triangle, out)
        return out

    def asked(self) -> Callable[..., int]:
        """Return a kernel (P, N, triangle, out) for many batches, which sets out (n,) to what `holds` returns.

        The arrays of the certificate are checked once, here.
        """
        s = self.surfaces
        known: Callable[..., int] = _holds.of(
            s.centre, s.scale, s.reach, s.vertices, s.triangles, s.instance, self.cell, self.body, self.clear,
            *self.convex, self.keys, self.only, self.around)
        return known


def certificate(surfaces: Surfaces, casts: NDArray[np.bool_], r: float) -> Certificate | None:
    """Return the certificate for balls of radius r (world) if shadow rays can hit the triangles in casts (T,); None if
    there are no bodies.
    """
    reach = r / surfaces.scale
    body, clear = np.full(len(surfaces.triangles), -1, np.int32), np.zeros(len(surfaces.triangles), np.uint8)
    convex = _bodies(surfaces, reach, body, clear)
    if convex is None:
        return None
    cell = max(1.001 * reach + 4 * ULPS, 2.0**-19)
    wanted, limit = np.flatnonzero(casts), np.inf
    if surfaces.reach > 1:  # only what may be within r of a point in the frame's box
        limit = 1 + 2 * cell
        corners = surfaces.vertices[surfaces.triangles[wanted]]
        wanted = wanted[(corners.min(1) <= limit).all(1) & (corners.max(1) >= -limit).all(1)]
    filled = np.zeros(1)
    _about(surfaces.vertices, surfaces.triangles, wanted, cell, filled)
    while filled[0] > CELLS:
        cell *= 1.5
        _about(surfaces.vertices, surfaces.triangles, wanted, cell, filled)
    keys, only = _grid(surfaces, wanted, body, cell, limit)
    around = np.full(len(keys), UNKNOWN, np.int32)
    return Certificate(surfaces, casts, r, cell, body, clear, convex, keys, only, around)


def _bodies(s: Surfaces, reach: float, body: NDArray[np.int32], clear: NDArray[np.uint8]) -> Convex | None:
    """Fill body and clear (T,): find the instances that seem convex, and the planes of the others. Returns None if
    there are none.
    """
    ends = np.searchsorted(s.instance, np.arange(s.instance.max(initial=-1) + 2)).astype(np.int64)
    count, parts = len(body), processors.count()
    low, high, own = (np.zeros(len(ends) - 1, np.int64) for _ in range(3))
    cuts = np.searchsorted(ends, np.arange(parts + 1) * count // parts)  # of the instances, about equal in triangles
    cuts[0], cuts[-1] = 0, len(own)

    def find_convex(part: int) -> None:
        first, last = cuts[part], cuts[part + 1]
        _convex(s.vertices, s.triangles, ends[first:last + 1], first, body, clear, low[first:last], high[first:last],
                own[first:last])

    processors.each(find_convex, parts)
    _find_planes(s, reach, len(ends), body, clear)
    if not (body >= 0).any():
        return None
    first = np.concatenate([[0], np.cumsum(own)])
    vertices = np.empty((3, first[-1] * GROUP * GROUP))
    processors.each(lambda part: needs_memory(_sorted(
        s.vertices, low[cuts[part]:cuts[part + 1]], high[cuts[part]:cuts[part + 1]],
        first[cuts[part]:cuts[part + 1] + 1], vertices)), parts)
    boxes, larger = (np.empty((first[-1] * n, 2, 3)) for n in (GROUP, 1))
    _boxes(vertices, GROUP, boxes)
    _boxes(vertices, GROUP * GROUP, larger)
    return Convex(vertices, boxes, larger, first)


def _find_planes(s: Surfaces, reach: float, first: int, body: NDArray[np.int32], clear: NDArray[np.uint8]) -> None:
    """Fill body, from number `first` on, and clear of triangles that lie in one plane and are of no body yet."""
    count, parts = len(body), processors.count()
    keys = np.empty(count, np.int64)

    def name(part: int) -> None:
        _keys(s.vertices, s.triangles, part * count // parts, (part + 1) * count // parts, body, keys)

    def find(part: int) -> None:
        needs_memory(_planes(s.vertices, s.triangles, keys, part, parts, reach, first, body, clear))

    processors.each(name, parts)
    processors.each(find, parts)


def _grid(s: Surfaces, wanted: NDArray[np.int64], body: NDArray[np.int32], cell: float,
          limit: float) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return the cells within ±limit that the triangles `wanted` are in: their keys, and the only body in each or
    SEVERAL.
    """
    keys, only, state = np.full(4096, -1, np.int64), np.empty(4096, np.int32), np.zeros(2, np.int64)
    while True:
        _fill(s.vertices, s.triangles, wanted, body, cell, limit, state, keys, only)
        if state[0] == len(wanted):
            return keys, only
        more, moved = np.full(2 * len(keys), -1, np.int64), np.empty(2 * len(keys), np.int32)
        _grown(keys, only, more, moved)
        keys, only = more, moved
