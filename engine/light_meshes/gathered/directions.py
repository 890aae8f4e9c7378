"""Directions over the half-space above a surface: fixed, evenly spread, and weighted by their cosine."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

_sectors = kernel("sectors_of")
_GOLDEN = np.pi * (3 - np.sqrt(5))
# The turn from one ray to the next where a part of the rays is asked first. It was found by a search: all rays, every
# second and every fourth are about as evenly spread as by the golden angle, with which every fourth is not.
NESTED = 2 * np.pi * 0.405014
FAR = 100  # places on in the list of rays; neighbours are nearer
LEAN = np.radians(30)  # of the four normals for which a record also gathers


class Rays(NamedTuple):
    """Directions around z, and what is needed to sum up what rays along them find."""

    local: NDArray[np.float64]  # (n,3) unit
    tilts: NDArray[np.float64]  # (n,4) see `tilted`
    within: NDArray[np.uint8]  # (n,) see `sectors`
    beside: tuple[int, int]  # the rays so many places on go about the same way as a ray


def rays(local: NDArray[np.float64]) -> Rays:
    """Return `Rays` along `local` (n,3), evenly spread around z."""
    return Rays(local, tilted(local), sectors(local), _beside(local))


class Nested(NamedTuple):
    """Rays of which some are asked first, and others where these are too few."""

    first: Rays  # n
    more: dict[int, NDArray[np.float64]]  # by 2 and 4: the rays that make the first so many times as many,
    all: dict[int, Rays]  # and both of them together


@cache
def nested(n: int) -> Nested:
    """Return rays for surfaces that send n, 2n or 4n of them. Each set is evenly spread. They are made once a process.
    """
    full = directions(4 * n, NESTED)
    first, second, others = (np.ascontiguousarray(a) for a in (full[2::4], full[::4], full[1::2]))
    more = {2: second, 4: np.concatenate([second, others])}
    return Nested(rays(first), more, {times: rays(np.concatenate([first, rest])) for times, rest in more.items()})


def directions(n: int, turn: float = _GOLDEN) -> NDArray[np.float64]:
    """Return n unit vectors (n,3) around z, on a spiral of equal shares of the cosine. The plain mean of a radiance in
    these directions is the radiance of a white matt surface; it is exact if the radiance is the same in all directions.
    turn: the angle from one to the next, radians.
    """
    k = np.arange(n) + 0.5
    sine, angle = np.sqrt(k / n), k * turn
    return np.stack([sine * np.cos(angle), sine * np.sin(angle), np.sqrt(1 - k / n)], axis=1)


def tilted(local: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights (n,4) of rays along `local` (n,3) for four normals, which lean by LEAN to x, −x, y, −y.

    The weighted sum is exact if the radiance is the same in all directions: such a surface sees (1 + cos LEAN)/2 of the
    half-space.
    """
    c, s = np.cos(LEAN), np.sin(LEAN)
    normals = np.array([(s, 0, c), (-s, 0, c), (0, s, c), (0, -s, c)])
    weight = np.maximum(local @ normals.T, 0) / local[:, 2:]
    return weight * ((1 + c) / 2 / weight.mean(0))


def sectors(local: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return in which of the 64 sectors of a half-space (sectors.h) these unit vectors (n,3) around z are."""
    found = np.empty(len(local), np.uint8)
    _sectors(local, found)
    return found


def _beside(local: NDArray[np.float64]) -> tuple[int, int]:
    """Return the two distances in the list at which directions (n,3) are closest to each other, on two sides."""
    far = [np.inf] + [float(np.square(local[j:, :2] - local[:-j, :2]).sum(1).mean())
                      for j in range(1, min(FAR, len(local)))]
    one, *others = np.argsort(far)
    return int(one), next(int(j) for j in others if j % one and one % j)
