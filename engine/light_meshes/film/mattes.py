"""Cryptomatte: for each pixel, which objects (or materials, …) are seen there and their coverage, by its specification
(version 1.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

KINDS = ("CryptoObject", "CryptoMaterial", "CryptoAsset")
RANKS = 2  # a pass of four channels holds so many ids with their coverage


class Mattes:
    """Collects what the samples of a tile see, and computes the passes."""

    def __init__(self, names: Sequence[str]) -> None:
        """`names` are the names of all passes; only those of KINDS are used."""
        self.wanted = tuple(kind for kind in KINDS if any(name.startswith(kind) for name in names))
        self._seen: dict[str, list[tuple[NDArray, NDArray, NDArray]]] = {kind: [] for kind in self.wanted}
        self._ranked: dict[str, tuple[NDArray, NDArray, NDArray, NDArray]] = {}

    def add(self, kind: str, sample: NDArray, number: NDArray[np.uint32], coverage: NDArray) -> None:
        """Record that samples (n,) see the object or material `number` with a coverage of 0 … 1."""
        some = coverage > 0
        self._seen[kind].append((sample[some], number[some], coverage[some]))

    def developed(self, name: str, pixels: int, per_pixel: int) -> NDArray:
        """Return the pass `name`, shape (pixels, 4): id, coverage, id, coverage. The largest coverage comes first."""
        kind, first = name[:-2], RANKS * int(name[-2:])
        if kind not in self._ranked:
            self._ranked[kind] = self._rank(kind, per_pixel)
        pixel, rank, number, coverage = self._ranked[kind]
        out = np.zeros((pixels, 2 * RANKS))
        for i in range(RANKS):
            rows = rank == first + i
            out[pixel[rows], 2 * i] = as_floats(number[rows])
            out[pixel[rows], 2 * i + 1] = coverage[rows]
        return out

    def _rank(self, kind: str, per_pixel: int) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Return pixel, rank in the pixel, number and coverage of everything that pixels see."""
        seen = self._seen[kind] or [(np.zeros(0, np.int64), np.zeros(0, np.uint32), np.zeros(0))]
        sample, number, share = (np.concatenate(parts) for parts in zip(*seen, strict=True))
        key = (sample // per_pixel).astype(np.uint64) << np.uint64(32) | number
        order = np.argsort(key, kind="stable")
        key, share = key[order], share[order]
        first = np.flatnonzero(np.append(True, key[1:] != key[:-1])[:len(key)])
        coverage = np.add.reduceat(share, first) / per_pixel if len(first) else share
        pixel, number = (key[first] >> np.uint64(32)).astype(np.int64), key[first].astype(np.uint32)
        order = np.lexsort((number, -coverage, pixel))
        pixel, number, coverage = pixel[order], number[order], coverage[order]
        start = np.flatnonzero(np.append(True, pixel[1:] != pixel[:-1])[:len(pixel)])
        rank = np.arange(len(pixel)) - np.repeat(start, np.diff(np.append(start, len(pixel))))
        return pixel, rank, number, coverage


def as_floats(number: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return floats with the bits of the numbers; the exponents are changed so that all are normal floats."""
    exponent = np.clip(number >> np.uint32(23) & np.uint32(255), 1, 254).astype(np.uint32)
    return (number & np.uint32(0x807FFFFF) | exponent << np.uint32(23)).view(np.float32)
