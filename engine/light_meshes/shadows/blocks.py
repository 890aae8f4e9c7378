"""Blocks of the picture, whose receivers find out together which of many lamps they see in part.

Each receiver of a block, or some of them, sends one ray to a point of the lamp; the points of all these rays are spread
over the lamp. If all rays arrive, the whole block is taken to see the whole lamp; if none arrives, it is taken to see
nothing of it. Otherwise the same question is asked again in blocks of half the size.

Where a block does not agree, each of its receivers sends a ray. If the penumbra is wide there, the rays of a pixel
differ nearly as much as those of a whole neighbourhood. Then S is the mean of the rays of the pixels around, on the
same plane, with the slope of a plane that is fitted to them (`fitted.c`). Elsewhere receivers send all their rays.
This is so only where 4 rays a lamp are near enough; for more nearness the fit is not worth while (measured: at area
sampling's error with 16 rays it saves 10 % of the rays, where it saves half at that with 4).

A block is just large enough to hold as many receivers as are needed. It stands at the same place of the picture,
whatever part of the picture is cropped or drawn at once: tiles are rounded up to whole blocks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel, needs_memory
from . import pairs

RECEIVERS = 64  # about as many are in a small block; a large one is twice as wide
COMMON = 4  # so many samples of a pixel share points on lamps with those of its neighbours
SIDES = 6  # to which surfaces may look
PLACES_ACROSS = 8  # pixels of a small block, at most; the same in blocks.c
PLACES = PLACES_ACROSS**2
Box = tuple[int, int, int, int]  # pixels x0, y0, x1, y1
# Adds what points of light[k] give receiver row[k]. Arguments: row, light, of which pairs k, whether their rays are
# lifted, the first point, how many, and where it is added: what gets through (k,C), and what would if nothing stood
# between (k)
Add = Callable[[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], bool, int, int, NDArray[np.float64],
                NDArray[np.float64]], None]

_planes, _fitted = kernel("blocks_planes"), kernel("blocks_fitted")
_todo, _voted, _agreed, _said = (kernel(f"blocks_{name}") for name in ("todo", "voted", "agreed", "said"))


def edge(samples: int) -> int:
    """How many pixels wide a small block is, where pixels have so many samples: 8, 4, 2 or 1."""
    return max(1, 8 >> (samples.bit_length() - 1) // 2)


def whole(box: Box, width: int, height: int, samples: int) -> Box:
    """Return the pixels of all large blocks of the picture of width × height that `box` has a part of."""
    step = 2 * edge(samples)
    x0, y0, x1, y1 = box
    return x0 - x0 % step, y0 - y0 % step, min(width, x1 + -x1 % step), min(height, y1 + -y1 % step)


def ordered(box: Box, samples: int) -> NDArray[np.int64]:
    """Return the samples of the pixels of `box`, row by row, in the order of the blocks (n,)."""
    number = np.arange((box[2] - box[0]) * (box[3] - box[1]))
    pixel = np.argsort(numbers(number, box, samples), kind="stable")
    return (pixel[:, None] * samples + np.arange(samples)).reshape(-1)


def numbers(pixel: NDArray[np.int64], box: Box, samples: int) -> NDArray[np.int64]:
    """Return the small block (n,) of pixels (n,) of `box`: four of them, from a multiple of four on, are a large one.
    """
    small = edge(samples)
    y, x = np.divmod(pixel, box[2] - box[0])
    x, y = (x + box[0]) // small, (y + box[1]) // small
    return ((y >> 1 << 20 | x >> 1) << 2 | (y & 1) << 1 | x & 1).astype(np.int64)


def places(pixel: NDArray[np.int64], box: Box, samples: int) -> NDArray[np.int64]:
    """Return for pixels (n,) of `box` the number of their small block, times PLACES, and their place in it: (n,)."""
    small = edge(samples)
    y, x = np.divmod(pixel, box[2] - box[0])
    place = (y + box[1]) % small * PLACES_ACROSS + (x + box[0]) % small
    return numbers(pixel, box, samples) * PLACES + place


def quads(block: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return for `places` (n,) which of four pixels in a square they are (n,), 0 to 3, and a number of the square (n,).
    """
    inside = block & (1 + PLACES_ACROSS)
    return (inside & 1) + 2 * (inside > 1), block - inside


def slices(block: NDArray[np.int64], most: int) -> list[slice]:
    """Return parts of receivers at `places` block (n,), of about `most`, so that no large block is cut."""
    n = len(block)
    if n <= most:
        return [slice(0, n)] if n else []
    first = np.flatnonzero(np.diff(block // (4 * PLACES), prepend=-1))  # of each large block
    cuts = np.unique(first[np.searchsorted(first, np.arange(0, n, most), "right") - 1])
    return [slice(int(i), int(j)) for i, j in zip(cuts, [*cuts[1:], n], strict=True)]


class Stage(NamedTuple):
    """How a block is asked."""

    large: bool
    part: int  # of receivers: QUARTER, HALF or ALL
    rays: int  # from each, with those that it has sent before


QUARTER, HALF, ALL = 255, 0, -1  # as `few` of the kernel blocks_todo


class Rules(NamedTuple):
    """How blocks are asked, one stage after the other, and windows of pixels (`fitted.c` says how they are used)."""

    stages: tuple[Stage, ...]
    windows: tuple[tuple[int, int, float], ...]  # look and reach in pixels, and the least share of the variance
    fewest: int = 32  # receivers that can agree


# As near as 4 and as 16 rays to each lamp
BALANCED = Rules((Stage(True, QUARTER, 1), Stage(False, ALL, 1)),
                 ((4, 2, 1.15), (3, 1, 0.95)))
BEST = Rules((Stage(True, ALL, 1), Stage(False, ALL, 1)), ())
SINGLE = Rules((Stage(True, HALF, 1), Stage(False, ALL, 1)), (), 8)  # BALANCED where a pixel has few samples
SURPRISE = 1.2  # fewer pixels must not be farther from more of them than by so many times n^-3/4 of n rays


class Found(NamedTuple):
    """What is known of pairs of a receiver and a lamp."""

    row: NDArray[np.int32]  # (k,)
    light: NDArray[np.int32]
    lifted: NDArray[np.uint64]  # (n,W) lights whose rays are lifted, by receivers
    lifts: bool  # whether there are any
    counts: NDArray[np.uint8]  # (n,L) how many rays they get at last
    have: NDArray[np.uint8]  # (k,) rays that were traced
    clear: NDArray[np.float64]  # (k,C) what they brought,
    whole: NDArray[np.float64]  # (k,) and what they would have if nothing stood between

    def trace(self, left: NDArray[np.int32], rays: int, add: Add, few: int = 0,
              chosen: NDArray[np.uint8] | None = None) -> None:
        """Trace so many rays of pairs `left` in all, where they are not yet.

        chosen (n,): only of receivers with 0, and of those with 1 where the lamp gets more than `few` rays at last.
        Without it, but with `few`: only of pairs with so many rays at last.
        """
        todo = np.empty(len(left), np.int32)
        for first in np.flatnonzero(np.bincount(self.have[left], minlength=1)[:rays]).tolist():
            for lifts in (False, True) if self.lifts else (False,):
                count = _todo(first, rays, few, lifts, self.row, self.light, left, self.lifted, chosen, self.counts,
                              self.have, todo)
                if count:
                    add(self.row, self.light, todo[:count], lifts, first, rays - first, self.clear, self.whole)


class Where(NamedTuple):
    """Where receivers are, in the scene and in the picture."""

    P: NDArray[np.float64]  # (n,3)
    N: NDArray[np.float64]  # (n,3) their normals
    place: NDArray[np.int64]  # (n,) `places`, ascending
    sample: NDArray[np.int64]  # (n,2) see `Hits`
    edge: int  # of small blocks, in pixels


def ask(asked: NDArray[np.uint64], at: Where, lifted: NDArray[np.uint64], rules: Rules, counts: NDArray[np.uint8],
        steps: tuple[int, ...], add: Add, S: NDArray[np.float32]) -> NDArray[np.uint64]:
    """Set S (n,L,C) of lights asked for (n,W), and return those of which blocks do not agree (n,W).

    lifted (n,W): lights whose rays are lifted; counts (n,L): how many rays are traced at last, one of `steps`.
    """
    lifts = bool(lifted.any())
    partly, lights, channels = np.zeros_like(asked), S.shape[1], S.shape[2]
    P, N, block, sample, edge = at
    side = np.abs(N).argmax(1).astype(np.int32)  # where surfaces meet, each speaks for itself
    side = 2 * side + (N[np.arange(len(N)), side] < 0)
    small = block // PLACES
    of = {large: SIDES * _counted(small >> 2 * large) + side for large in (False, True)}
    turned = (sample[:, 0].astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15) >> np.uint64(63)).astype(np.int64)
    chosen = ((turned ^ sample[:, 1]) & 1) * 2 + (turned ^ sample[:, 1]) // 2 % 2
    chosen = np.minimum(chosen, 2).astype(np.uint8)
    plane, fits = np.empty(len(N), np.uint8), channels == 1 and len(rules.windows) > 0
    windows = np.array(rules.windows, np.float64).reshape(-1, 3)
    if fits:
        _planes(block, P, N, plane)
    for row, light in pairs.blocks(asked, lights):
        k = len(row)
        pair = Found(row, light, lifted, lifts, counts, np.zeros(k, np.uint8), np.zeros((k, channels)), np.zeros(k))
        left = np.arange(k, dtype=np.int32)
        for stage in rules.stages:
            pair.trace(left, stage.rays, add, *((stage.part, chosen) if stage.part != ALL else ()))
            mine, votes = of[stage.large], np.zeros((int(of[stage.large][-1]) + SIDES, lights), np.uint16)
            _voted(mine, row, light, left, pair.have, pair.clear, pair.whole, votes)
            left = left[:_agreed(rules.fewest, mine, row, light, votes, left, S)].copy()
        if fits:
            count = _fitted(edge, float(rules.stages[-1].rays), SURPRISE, windows, block, plane, row, light, pair.have,
                            pair.clear, pair.whole, left, S, partly)
            needs_memory(int(count < 0))
            left = left[:count].copy()
        for n in steps:
            pair.trace(left, n, add, n)
        _said(row, light, left, pair.clear, pair.whole, S, partly)
    return partly


def _counted(block: NDArray[np.int64]) -> NDArray[np.int32]:
    """How many other blocks come before each (n,)."""
    return np.cumsum(np.diff(block, prepend=block[:1]) != 0, dtype=np.int32)
