"""Pairs of a receiver and a light, and what is known of them, as sets of bits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

PAIRS = 1 << 19  # about the largest number of rays that are held at once

_set, _pairs, _drop_dark = kernel("pairs_set"), kernel("pairs_listed"), kernel("pairs_drop_dark")
_rows, _darken = kernel("pairs_rows"), kernel("pairs_darken")


def blocks(mask: NDArray[np.uint64], lights: int) -> Iterator[tuple[NDArray[np.int32], NDArray[np.int32]]]:
    """Yield the set bits of mask (n,W) as (row, light) arrays of limited length."""
    step = max(1, PAIRS // max(1, len(mask)))
    for first in range(0, lights, step):
        last = min(first + step, lights)
        size = len(mask) * (last - first)
        row, light = np.empty(size, np.int32), np.empty(size, np.int32)
        n = _pairs(mask, first, last, row, light)
        if n:
            yield row[:n], light[:n]


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
