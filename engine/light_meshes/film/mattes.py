"""Cryptomatte: of each pixel, what is seen there and how much of it, as its specification (version 1.2) has it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

KINDS = ("CryptoObject", "CryptoMaterial", "CryptoAsset")
RANKS = 2  # ids with their coverage that one pass of four channels holds


class Mattes:
    """What the samples of a tile see, collected, and its passes."""

    def __init__(self, names: Sequence[str]) -> None:
        """names: of all passes; those of KINDS count."""
        self.wanted = tuple(kind for kind in KINDS if any(name.startswith(kind) for name in names))
        self._seen: dict[str, list[tuple[NDArray, NDArray, NDArray]]] = {kind: [] for kind in self.wanted}
        self._ranked: dict[str, tuple[NDArray, NDArray, NDArray, NDArray]] = {}

    def add(self, kind: str, sample: NDArray, number: NDArray[np.uint32], coverage: NDArray) -> None:
        """Samples (n,) see what has this number by their coverage, 0 … 1."""
        some = coverage > 0
        self._seen[kind].append((sample[some], number[some], coverage[some]))

    def developed(self, name: str, pixels: int, per_pixel: int) -> NDArray:
        """(pixels, 4): the pass `name`: id, coverage, id, coverage; what covers most comes first."""
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
        """Pixel, rank there, number and coverage of all that pixels see."""
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
    """The numbers' bits as floats, with an exponent that is of a normal one."""
    exponent = np.clip(number >> np.uint32(23) & np.uint32(255), 1, 254).astype(np.uint32)
    return (number & np.uint32(0x807FFFFF) | exponent << np.uint32(23)).view(np.float32)
