"""Where refracted light goes: beams that leave one light through glass, as first guesses for Newton's method.

A beam is what the light sends through a small triangle on the first interface, between two of its bends: three rays
and the signature that they share. A ray is written as where it meets the plane z = z0 and its slope there, z being
the axis that it is most along; so the point of a beam that is at x follows from two linear equations. Beams stand in
trees of bounds on place and slope: they have no far end to put in a grid, and points may be anywhere.
Coordinates are the tracer's frame.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel, needs_memory
from .beam_tree import beam_tree
from .media import Glass
from .optics import DEPTH, RAYS, Source

_trace = kernel("beams_trace")

FINE = 1 / 64  # of a body's radius, or the light's distance: shorter elements are not split because they differ
USUAL = 8  # bends that light is followed through at first, and twice as often where some of it goes on
DEEPER = 8  # if that takes no more than so many times the rays
BUDGET = 3_000_000, 40  # rays, and rays a triangle, that the beams of a light may take
PLANES = 8  # the same in least_way.h
WAYS = 64  # through flat glass: so many are tried one by one where light may graze
PAD = 0.3  # barycentric: how far outside a beam a point may be and still start a search


class Beams(NamedTuple):
    """All beams of a light, in the order of their trees."""

    slot: NDArray[np.int32]  # (B,) triangle of the first interface
    uv: NDArray[np.float64]  # (B,3,2) corners on it
    p: NDArray[np.float64]  # (B,3,2) where the corners' rays meet z = z0
    d: NDArray[np.float64]  # (B,3,2) their slopes
    z: NDArray[np.float64]  # (B,3) z0, and the least and greatest z
    group: NDArray[np.int8]  # (B,) 2·axis, + 1 where z runs against it
    k: NDArray[np.int8]  # (B,) bends before the beam
    code: NDArray[np.int32]  # (B,most) signature, see `optics`
    eta: NDArray[np.float64]  # (B,most)
    root: NDArray[np.int64]  # (6,) see `beam_tree`
    bounds: NDArray[np.float64]  # (nodes,11)
    child: NDArray[np.int64]  # (nodes,2)
    flat: NDArray[np.int64]  # (s,) one beam of each signature of flat glass alone
    most: int  # bends that light was followed through: as many as it takes, or less where many bodies scatter it
    cut: bool  # whether some of it went on behind them


def trace_beams(g: Glass, s: Source, h: float) -> Beams:
    """The beams of a light; h (frame): a miss below h/4 does not matter."""
    limit, deepest, fine = BUDGET[0] + BUDGET[1] * len(g.triangle), USUAL, FINE
    found = _followed(g, s, h, fine, deepest, limit)
    while found is None:
        # Light scattered by many bodies: there is no end to what could be told apart.
        fine, deepest = 2.0 * fine, deepest - 2
        found = _followed(g, s, h, fine, deepest, limit if deepest > 2 else 1 << 60)
    while found[1] and fine == FINE and deepest < DEPTH:
        deeper = _followed(g, s, h, fine, 2 * deepest, min(limit, DEEPER * int(s.work[RAYS])))
        if deeper is None:
            break
        found, deepest = deeper, 2 * deepest
    arrays, cut = found
    order, root, bounds, child = beam_tree(arrays[2], arrays[3], arrays[4], arrays[5], PAD)
    arrays = tuple(np.ascontiguousarray(a[order]) for a in arrays)
    columns: Any = (*arrays, root, bounds, child, _flat(g, *arrays[6:]), deepest, cut)
    return Beams(*columns)


def _flat(g: Glass, k: NDArray[np.int8], code: NDArray[np.int32], eta: NDArray[np.float64]) -> NDArray[np.int64]:
    """One beam of each signature of two to PLANES bends at planes, without reflections; none of more than WAYS."""
    used = np.arange(code.shape[1]) < k[:, None]
    bends = (g.planar[code >> 1] >= 0) & (eta > 0)
    planar = np.flatnonzero((bends | ~used).all(1) & (k > 1) & (k <= PLANES)).astype(np.int64)
    if not len(planar):
        return planar
    signature = np.concatenate([np.where(used, code, -1), np.where(used, eta, 0)], 1)[planar]
    first = np.sort(np.unique(signature, axis=0, return_index=True)[1])
    return planar[first if len(first) <= WAYS else first[:0]]


def _followed(g: Glass, s: Source, h: float, fine: float, deepest: int,
              limit: int) -> tuple[tuple[NDArray, ...], bool] | None:
    """The beams through up to `deepest` bends, and whether light goes on behind them; None: more than `limit` rays."""
    size, state = 4096, np.zeros(3, np.int64)
    arrays = _room(size, deepest)
    s.work[RAYS] = 0
    while state[0] < len(g.triangle):
        needs_memory(_trace(*g[1:], *s, h, fine, fine == FINE, deepest, limit, state, *arrays))
        if state[0] < len(g.triangle):
            if s.work[RAYS] > limit:
                return None
            arrays = tuple(np.concatenate([a, b]) for a, b in zip(arrays, _room(size, deepest), strict=True))
            size *= 2
    return tuple(a[:state[1]] for a in arrays), bool(state[2])


def _room(n: int, deepest: int) -> tuple[NDArray, ...]:
    return (np.empty(n, np.int32), np.empty((n, 3, 2)), np.empty((n, 3, 2)), np.empty((n, 3, 2)), np.empty((n, 3)),
            np.empty(n, np.int8), np.empty(n, np.int8), np.zeros((n, deepest), np.int32), np.zeros((n, deepest)))
