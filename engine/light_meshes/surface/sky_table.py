"""Radiance by direction as a table: averaged exactly when it is made, looked up fast for rays of any width.

The sphere is unfolded onto a square so that equal areas are equal solid angles (Clarberg, "Fast equal-area mapping of
the (hemi)sphere using SIMD", 2008; octahedral at the seams). So a table's mean is the mean over all directions, and a
table of half the size is made by averaging four texels.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ..support import processors
from ..support.native import kernel

_look = kernel("sky_table_look")
Radiance = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # of unit directions (n,3): (n,3)
BATCH = 1 << 16  # directions that are asked for at once
FINE = 8  # samples along each side of a texel in which the radiance changes much
CHANGES = 1 / 64  # how many texels are sampled so finely at most, as a share


def directions(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit directions (n,3) of places on the square (n,), each 0 to 1."""
    px, py = 2 * x - 1, 2 * y - 1
    u, v = np.abs(px), np.abs(py)
    signed = 1 - (u + v)  # positive in the upper half
    r = 1 - np.abs(signed)
    turn = np.where(r > 0, (v - u) / np.where(r > 0, r, 1.0) + 1, 1.0) * (np.pi / 4)
    across = r * np.sqrt(2 - r * r)
    return np.stack([np.copysign(np.cos(turn) * across, px), np.copysign(np.sin(turn) * across, py),
                     np.copysign(1 - r * r, signed)], axis=1)


def inside(texels: NDArray[np.int64], size: int, count: int) -> NDArray[np.float64]:
    """Return the unit directions (n, count², 3) of a grid of count² places in each of these texels (n,)."""
    step = (np.arange(count) + 0.5) / count
    x = (texels % size)[:, None, None] + step[None, None, :]
    y = (texels // size)[:, None, None] + step[None, :, None]
    x, y = np.broadcast_arrays(x / size, y / size)
    return directions(x.ravel(), y.ravel()).reshape(len(texels), count * count, 3)


class Table:
    """The radiance from all directions."""

    def __init__(self, finest: NDArray[np.float64]) -> None:
        """finest (size²,3): the mean radiance in each texel, rows one after the other; size is a power of two."""
        self.size = round(len(finest) ** 0.5)
        levels, part = [finest], finest
        while len(part) > 1:
            side = round(len(part) ** 0.5)
            part = part.reshape(side // 2, 2, side // 2, 2, 3).mean((1, 3)).reshape(-1, 3)
            levels.append(part)
        self.mean = part[0]  # (3,) over all directions
        self._texels = np.ascontiguousarray(np.concatenate(levels), np.float32)

    def look(self, direction: NDArray[np.float64], width: float | NDArray[np.float64] | None) -> NDArray[np.float64]:
        """Return the radiance (n,3) that comes from unit `direction` (n,3) in a cone of the solid angle `width`,
        steradians.

        width: one for all, or (n,); None: as fine as the table is.
        """
        level = np.zeros(1)
        if width is not None:
            share = np.maximum(np.asarray(width, np.float64) / (4 * np.pi / self.size**2), 1.0)
            level = np.ascontiguousarray(np.log2(share).reshape(-1) / 2)
        out = np.empty((len(direction), 3))
        _look(self._texels, self.size, np.ascontiguousarray(direction, np.float64), level, out)
        return out


def tabulated(radiance: Radiance, size: int, samples: int, check: Callable[[], None]) -> NDArray[np.float64]:
    """Return the mean radiance (size²,3) in each texel, by samples² directions in it; more where it changes much."""
    found = _means(radiance, np.arange(size * size), size, samples, check)
    steep = _steepness(found.reshape(size, size, 3)).ravel()
    most = max(1, int(size * size * CHANGES))
    rows = np.argpartition(steep, -most)[-most:] if most < len(steep) else np.arange(len(steep))
    rows = np.sort(rows[steep[rows] > 1e-3 * found.mean()])
    if len(rows):
        found[rows] = _means(radiance, rows, size, FINE, check)
    return found


def _means(radiance: Radiance, texels: NDArray[np.int64], size: int, samples: int,
           check: Callable[[], None]) -> NDArray[np.float64]:
    found = np.empty((len(texels), 3))
    step = max(1, BATCH // samples**2)

    def part(first: int) -> None:
        check()
        some = texels[first:first + step]
        asked = inside(some, size, samples).reshape(-1, 3)
        found[first:first + step] = radiance(asked).reshape(len(some), -1, 3).mean(1)

    with ThreadPoolExecutor(processors.count()) as pool:
        list(pool.map(part, range(0, len(texels), step)))
    return found


def _steepness(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how much each texel differs from those beside it, in the largest channel. Nothing is compared across the
    edges of the square.
    """
    steep = np.zeros(table.shape[:2])
    for axis in (0, 1):
        change = np.abs(np.diff(table, axis=axis)).max(2)
        first, second = [slice(None)] * 2, [slice(None)] * 2
        first[axis], second[axis] = slice(None, -1), slice(1, None)
        for side in (first, second):
            np.maximum(steep[tuple(side)], change, out=steep[tuple(side)])
    return steep
