"""The rays of a wave: those of one kind that a tile traces at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.rows import taken, where

CELLS = 1 << 12  # along an edge of the cube in which points are put in order


class Rays(NamedTuple):
    """Rays as arrays with one row for each ray. An array that the scene does not need is None, in all waves of a tile.
    """

    pixel: NDArray[np.int64]  # (n,) the sample of the tile that each belongs to
    weight: NDArray[np.float64]  # (n,3) what of the light that it finds counts there
    origin: NDArray[np.float64]  # (n,3) world
    direction: NDArray[np.float64]  # (n,3) unit
    depth: NDArray[np.int16]  # (n,) bends so far
    normal: NDArray[np.float64] | None = None  # (n,3) of the surface that it leaves; None: rays from the camera
    # Where something is transparent:
    clear: NDArray[np.bool_] | None = None  # (n,) straight through all surfaces so far
    media: NDArray[np.int32] | None = None  # (n,m) the bodies that it is in, −1: none
    mirrored: NDArray[np.int16] | None = None  # (n,) of its bends those at mirrors
    # Where surfaces have lobes of microfacets (`blurred`):
    fan: NDArray[np.int32] | None = None  # (n,) −1 − the sample of its pixel; its number ≥ 0 after it was spread out
    blur: NDArray[np.float64] | None = None  # (n,) the largest roughness of these surfaces so far, 0 where smooth
    # Where surfaces lie in one place:
    start: NDArray[np.float64] | None = None  # (n,3) where it began to go straight on
    last: NDArray[np.int32] | None = None  # (n,) the triangle that it met last, −1: none
    # (n,) whether what it met is behind the place from which it came, by rounding; None: of no ray
    behind: NDArray[np.bool_] | None = None
    # Where a pass asks:
    part: NDArray[np.int8] | None = None  # (n,) how the camera sees what it meets: passes.DIRECT, …
    left: NDArray[np.float64] | None = None  # (n,) of the sample, after what it saw so far and saw through

    def at(self, rows: NDArray) -> Rays:
        """Return the rays of these rows, or those where a mask (n,) is set."""
        index = where(rows) if rows.dtype == np.bool_ else rows
        return Rays._make(a if a is None else taken(a, index) for a in self)

    def met(self, rows: NDArray[np.int64] | None, P: NDArray[np.float64]) -> Rays:
        """Return the rays of these rows, or all, where they have met something: they are at P, and leave no surface."""
        rays = self._replace(origin=P, normal=None)
        if rows is None:
            return rays
        return Rays._make(a if a is None or a is P else taken(a, rows) for a in rays)

    def not_back(self, origin: NDArray[np.float64]) -> Rays:
        """Return rays that met something. Those that came from `origin` (n,3) and met what is behind it stay there.

        Rays leave a surface along its normal, by a little (`tracer.h`). Where two surfaces cross, this may be on the
        wrong side of the other one, and straight rays would meet both again and again.
        """
        behind = np.einsum("ni,ni->n", self.origin - origin, self.direction) <= 0
        if not behind.any():
            return self
        return self._replace(origin=np.where(behind[:, None], origin, self.origin), behind=behind)

    def pieces(self, most: int) -> list[Rays]:
        """Return these rays, about `most` of them at a time, but all of a sample at once: what they find is added up in
        one order, wherever the others are.
        """
        if len(self.pixel) <= most:
            return [self]
        order = np.argsort(self.pixel, kind="stable")
        first = np.flatnonzero(np.diff(self.pixel[order], prepend=-1))  # row of each sample
        cuts = np.unique(first[np.searchsorted(first, np.arange(0, len(order), most), "right") - 1])
        return [self.at(order[i:j]) for i, j in zip(cuts, [*cuts[1:], len(order)], strict=True)]

    def seen_as(self, part: int) -> Rays:
        """Return rays that go on as `part`, if they have not been one yet."""
        return self if self.part is None else self._replace(part=np.where(self.part == 0, np.int8(part), self.part))


def joined(children: list[Rays]) -> Rays:
    """Return all these rays, in their order; what one of them lacks all lack."""
    if len(children) == 1:
        return children[0]
    return Rays._make(None if a[0] is None else np.concatenate(a) for a in zip(*children, strict=True))


def brightest(weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest of the three channels of weights (n,3)."""
    red, green, blue = weight.T
    return np.maximum(np.maximum(red, green), blue)


def beside_each_other(P: NDArray[np.float64], centre: NDArray[np.float64], scale: float) -> NDArray[np.int64]:
    """Return an order of points (n,3) in which most neighbours are close to each other: that of Morton's curve through
    cells of the cube of half the edge `scale` around `centre` (3,). Points of one cell stay in their order, so the
    order of some points does not depend on what other points there are.
    """
    cell = np.clip((P - centre) * (0.5 * CELLS / scale) + 0.5 * CELLS, 0, CELLS - 1).astype(np.uint64)
    for shift, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
                        (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):
        cell = (cell | cell << np.uint64(shift)) & np.uint64(mask)
    return np.argsort(cell @ np.array([1, 2, 4], np.uint64), kind="stable")
