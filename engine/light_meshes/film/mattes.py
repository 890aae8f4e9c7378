"""Cryptomatte: for each pixel, which objects (or materials, …) are seen there and their coverage, by its specification
(version 1.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.camera import Taps

KINDS = ("CryptoObject", "CryptoMaterial", "CryptoAsset")
RANKS = 2  # a pass of four channels holds so many ids with their coverage


class Ranked(NamedTuple):
    """All that pixels see, ordered by pixel and coverage: arrays (n,)."""

    pixel: NDArray[np.int64]
    rank: NDArray[np.int64]  # in the pixel; 0 is the largest coverage
    number: NDArray[np.uint32]
    coverage: NDArray[np.float64]

    def values(self, name: str, pixels: int) -> NDArray[np.float64]:
        """Return the pass `name`, shape (pixels, 4): id, coverage, id, coverage."""
        first = RANKS * int(name[-2:])
        out = np.zeros((pixels, 2 * RANKS))
        for i in range(RANKS):
            rows = self.rank == first + i
            out[self.pixel[rows], 2 * i] = as_floats(self.number[rows])
            out[self.pixel[rows], 2 * i + 1] = self.coverage[rows]
        return out


class Seen(NamedTuple):
    """What samples see: arrays (n,). The samples of a tile's first pixel come first, then those of the next."""

    sample: NDArray[np.int64]
    number: NDArray[np.uint32]
    coverage: NDArray[np.float64]

    @classmethod
    def together(cls, parts: Sequence[Seen]) -> Seen:
        """Return all parts as one."""
        if not parts:
            return cls(np.zeros(0, np.int64), np.zeros(0, np.uint32), np.zeros(0))
        return cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def moved(self, box: tuple[int, int, int, int], to: tuple[int, int, int, int], per_pixel: int) -> Seen:
        """Return what the samples of the pixels `to` see, counted there; here they are counted in the pixels `box`."""
        pixel, sample = np.divmod(self.sample, per_pixel)
        y, x = np.divmod(pixel, box[2] - box[0])
        y, x = y + box[1] - to[1], x + box[0] - to[0]
        width = to[2] - to[0]
        there = (x >= 0) & (x < width) & (y >= 0) & (y < to[3] - to[1])
        return Seen(((y * width + x) * per_pixel + sample)[there], self.number[there], self.coverage[there])

    def own(self, per_pixel: int) -> Ranked:
        """Return what pixels see by their own samples."""
        return _ranked(self.sample // per_pixel, self.number, self.coverage, float(per_pixel))

    def shared(self, taps: Taps, width: int, inside: tuple[int, int, int, int], per_pixel: int,
               weights: NDArray[np.float64]) -> Ranked:
        """Return what the pixels `inside` (x0, y0, x1, y1) see by the samples of their taps (`film/shared.py`). Here
        samples are counted in rows of `width` pixels. weights (height, width, 1): the sums of the taps' weights.
        """
        order = np.argsort(self.sample, kind="stable")  # in which tiles have met it makes no difference
        pixel, sample = np.divmod(self.sample[order], per_pixel)
        y, x = np.divmod(pixel, width)
        of_sample = [np.flatnonzero(sample == s) for s in range(per_pixel)]
        x0, y0, x1, y1 = inside
        found = []
        for up, right, s, weight in zip(*taps, strict=True):
            v, u, rows = y[of_sample[s]] - up - y0, x[of_sample[s]] - right - x0, order[of_sample[s]]
            takes = (v >= 0) & (v < y1 - y0) & (u >= 0) & (u < x1 - x0)
            rows = rows[takes]
            found.append(((v * (x1 - x0) + u)[takes], self.number[rows], weight * self.coverage[rows]))
        target, number, share = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return _ranked(target, number, share, weights.reshape(-1))


class Mattes:
    """Collects what the samples of a tile see."""

    def __init__(self, names: Sequence[str]) -> None:
        """`names` are the names of all passes; only those of KINDS are used."""
        self.wanted = tuple(kind for kind in KINDS if any(name.startswith(kind) for name in names))
        self._seen: dict[str, list[Seen]] = {kind: [] for kind in self.wanted}

    def add(self, kind: str, sample: NDArray, number: NDArray[np.uint32], coverage: NDArray) -> None:
        """Record that samples (n,) see the object or material `number` with a coverage of 0 … 1."""
        some = coverage > 0
        self._seen[kind].append(Seen(sample[some], number[some], coverage[some]))

    def seen(self, kind: str) -> Seen:
        """Return all that was added."""
        return Seen.together(self._seen[kind])


def _ranked(pixel: NDArray[np.int64], number: NDArray[np.uint32], share: NDArray[np.float64],
            whole: float | NDArray[np.float64]) -> Ranked:
    """Return all that pixels see. share (n,): of `number` (n,) in `pixel` (n,), added in order. whole: what shares of a
    coverage of 1 add up to, in all pixels, or (pixels,) in each.
    """
    key = pixel.astype(np.uint64) << np.uint64(32) | number
    order = np.argsort(key, kind="stable")
    key, share = key[order], share[order]
    first = np.flatnonzero(np.append(True, key[1:] != key[:-1])[:len(key)])
    coverage = np.add.reduceat(share, first) if len(first) else share
    pixel, number = (key[first] >> np.uint64(32)).astype(np.int64), key[first].astype(np.uint32)
    coverage = coverage / (whole if isinstance(whole, float) else whole[pixel])
    order = np.lexsort((number, -coverage, pixel))
    pixel, number, coverage = pixel[order], number[order], coverage[order]
    start = np.flatnonzero(np.append(True, pixel[1:] != pixel[:-1])[:len(pixel)])
    rank = np.arange(len(pixel)) - np.repeat(start, np.diff(np.append(start, len(pixel))))
    return Ranked(pixel, rank, number, coverage)


def as_floats(number: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return floats with the bits of the numbers; the exponents are changed so that all are normal floats."""
    exponent = np.clip(number >> np.uint32(23) & np.uint32(255), 1, 254).astype(np.uint32)
    return (number & np.uint32(0x807FFFFF) | exponent << np.uint32(23)).view(np.float32)
