"""Pairs of a receiver and a light, and what is known of them, as sets of bits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

MANY = 256  # lights, from which on those that are asked for are counted first
PAIRS = 1 << 19  # about the largest number of rays that are held at once

_set, _pairs, _drop_dark = kernel("pairs_set"), kernel("pairs_listed"), kernel("pairs_drop_dark")
_rows, _darken, _counted = kernel("pairs_rows"), kernel("pairs_darken"), kernel("pairs_counted")


def blocks(mask: NDArray[np.uint64], lights: int) -> Iterator[tuple[NDArray[np.int32], NDArray[np.int32]]]:
    """Yield the set bits of mask (n,W) as (row, light) arrays of limited length."""
    step = max(1, PAIRS // max(1, len(mask)))
    for first, last in _ranges(mask, lights) if step < lights and lights > MANY else (
            (first, min(first + step, lights)) for first in range(0, lights, step)):
        size = len(mask) * (last - first)
        row, light = np.empty(size, np.int32), np.empty(size, np.int32)
        n = _pairs(mask, first, last, row, light)
        if n:
            yield row[:n], light[:n]


def _ranges(mask: NDArray[np.uint64], lights: int) -> Iterator[tuple[int, int]]:
    """Yield ranges of lights with at most about PAIRS bits of mask (n,W): whole words of it."""
    count = np.empty(mask.shape[1], np.int64)
    _counted(mask, count)
    first, bits = 0, 0
    for word, here in enumerate(count.tolist()):
        if bits and bits + here > PAIRS:
            yield first, 64 * word
            first, bits = 64 * word, 0
        bits += here
    if bits:
        yield first, lights


def rows(mask: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the rows of mask (n,W) in which any bit is set."""
    row = np.empty(len(mask), np.int64)
    return row[:_rows(mask, row)]


def dark(n: int, lights: int, channels: int = 1, but: NDArray[np.uint64] | None = None) -> NDArray[np.float32]:
    """Return S (n,L,C) of 0. Rows that have a bit in `but` (n,W) are not filled, and must be set by the caller.

    It is numpy's zeros, but other threads run while it is filled.
    """
    S = np.empty((n, lights, channels), np.float32)
    _darken(S.reshape(n, lights * channels), but)
    return S


def seen(mask: NDArray[np.uint64], lights: int, channels: int = 1) -> NDArray[np.float32]:
    """Return S (n,L,C): 1 where the bit of mask (n,W) is set, otherwise 0."""
    S = dark(len(mask), lights, channels)
    _set(mask, lights, 1.0, S.reshape(len(S), -1))
    return S


def bright(S: NDArray[np.float32], mask: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return mask (n,W) without the bits of lights with S = 0, because nothing can dim these further."""
    lit = mask.copy()
    _drop_dark(S.reshape(-1, S.shape[1] * S.shape[2]), S.shape[1], lit)
    return lit
