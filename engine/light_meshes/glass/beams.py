"""Where refracted light goes: the beams of a light behind glass. They give the first guesses for Newton's method.

A beam is the light that passes through a small triangle on the first interface, between two of its bends: three rays
with the same signature. A ray is stored as its point in the plane z = z0 and its slope there, where z is the axis along
which it mostly runs. So the ray of a beam that passes through x follows from two linear equations. Beams are kept in
trees of bounds on place and slope, not in a grid, because they have no far end and points may be anywhere. Coordinates
are those of the tracer's frame.
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

# relative to the body's radius or the light's distance: shorter elements are not split although their samples differ
FINE = 1 / 64
USUAL = 8  # at first light is followed through this many bends, and through twice as many if some of it goes on
DEEPER = 8  # the second time only if it takes at most this many times the rays
BUDGET = 3_000_000, 40  # the largest number of rays, in total and per triangle, for the beams of a light
PLANES = 8  # the largest number of planes of a way through flat glass that is searched; the same in least_way.h
WAYS = 64  # the largest number of ways through flat glass that are searched one by one where light may graze
PAD = 0.3  # barycentric: a search may start for a point that is this far outside a beam


class Beams(NamedTuple):
    """All beams of a light, in the order of their trees."""

    slot: NDArray[np.int32]  # (B,) triangle on the first interface
    uv: NDArray[np.float64]  # (B,3,2) the corners on it
    p: NDArray[np.float64]  # (B,3,2) where the rays of the corners meet z = z0
    d: NDArray[np.float64]  # (B,3,2) their slopes
    z: NDArray[np.float64]  # (B,3) z0, and the smallest and the largest z
    group: NDArray[np.int8]  # (B,) 2·axis, + 1 if the ray runs against it
    k: NDArray[np.int8]  # (B,) number of bends before the beam
    code: NDArray[np.int32]  # (B,most) signature, see `optics`
    eta: NDArray[np.float64]  # (B,most)
    root: NDArray[np.int64]  # (6,) see `beam_tree`
    bounds: NDArray[np.float64]  # (nodes,11)
    child: NDArray[np.int64]  # (nodes,2)
    flat: NDArray[np.int64]  # (s,) one beam of each signature of flat glass alone
    most: int  # the number of bends through which light was followed; less than necessary where many bodies scatter it
    cut: bool  # whether some light went on behind them


def trace_beams(g: Glass, s: Source, h: float) -> Beams:
    """Return the beams of a light. `h` (in the frame): errors below h/4 do not matter."""
    limit, deepest, fine = BUDGET[0] + BUDGET[1] * len(g.triangle), USUAL, FINE
    found = _followed(g, s, h, fine, deepest, limit)
    while found is None:
        # Many bodies scatter the light: the number of different beams has no limit.
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
    """Return one beam of each signature of two to PLANES bends at planes, without reflections. There are at most WAYS.
    """
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
    """Return the beams through up to `deepest` bends, and whether light goes on behind them; None if that takes more
    than `limit` rays.
    """
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
