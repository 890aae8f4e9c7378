"""Records: the light from everywhere at points of surfaces, and its interpolation.

Records are at points of the grids of triangles, so they are fixed in the world. Each is computed when a receiver first
asks, from fixed rays, and its value depends on nothing else: not on the camera, on order or on threads. A receiver asks
the three points of its triangle's coarsest grid around it, then of finer ones, until it trusts them: they must be
closer together than a share of the mean distance of what they see (Ward, Rubinstein and Clear 1988), and of the
distance of edges near them. Between levels it blends.
"""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits
from ..rays.tracer import points
from ..support.native import kernel
from ..support.statistics import Statistics
from .directions import directions, tilted
from .grids import LAST, Places
from .nearness import Nearness
from .patches import Patches, add
from .rays import Check, Field, Gatherer
from .table import Table

_sum, _trust, _blend = kernel("records_sum"), kernel("records_trust"), kernel("records_blend")
# Rays of a record, by how far apart records are, in finest distances: each record of a coarse grid counts for a large
# part of a surface, and there are few.
RAYS = ((6.0, 1024), (3.0, 512), (0.0, 256))
BATCH = 1 << 18  # rays at once
WITHIN = 0.35  # records are trusted up to this share of the mean distance of what they see,
STRICT = 0.2  # or up to this where they are far apart
APART = 1.0  # and up to this multiple of the distance of edges
BEYOND = 3  # levels finer than the finest, where no record can be seen from a receiver
LIFT = 1e-3  # how far above their surface records are looked at, as a share of the distance between them
KEPT = 2_000_000  # more records or patches are not kept for the next picture
_ARRAYS = ("_done", "_P", "_M", "_mean", "_inverse", "_nearest", "_open")
ENOUGH = 1e-3  # so little is not asked for at the next level


class Gathered(NamedTuple):
    """The light from everywhere at n receivers."""

    light: NDArray[np.float64]  # (n,3) the radiance of a white matt surface there
    sky: NDArray[np.float64]  # (n,) share of the half-space from which nothing is in the way


class SharedRecordsError(RuntimeError):
    """Another thread failed or was cancelled while it computed records for which this thread waits."""


class Records:
    """Threads share it. A thread that needs records that another one is computing waits for it."""

    def __init__(self, field: Field, gather: Gatherer, patches: Patches, nearness: Nearness, fine: float,
                 bounces: int) -> None:
        """fine: how far apart records are at the finest level, scene units."""
        self._field, self._gather, self._patches, self._nearness = field, gather, patches, nearness
        self._fine, self._bounces = fine, bounces
        self._kinds = [(at_least * fine, local, tilted(local)) for at_least, n in RAYS for local in [directions(n)]]
        self._table = Table()
        self._lock, self._light = threading.Condition(), threading.Lock()
        self._broken = False
        self._done = np.zeros(0, np.bool_)
        self._P, self._M = np.zeros((0, 3)), np.zeros((0, 3))
        self._mean = np.zeros((0, 5, 3), np.float32)
        self._inverse, self._nearest, self._open = (np.zeros(0, np.float32) for _ in range(3))

    def __len__(self) -> int:
        return len(self._table)

    def kept(self, stats: Statistics) -> bool:
        """Get ready for another picture, whose work is counted in `stats`; whether this is worth its memory."""
        self._field.stats = stats
        done = self._done[:len(self._table)]
        if not done.all():  # the picture before was given up
            keys, count = self._table.keys[done], np.count_nonzero(done)
            self._table = Table()
            self._table.numbers(keys)
            for name in _ARRAYS:
                setattr(self, name, getattr(self, name)[:len(done)][done])
            assert len(self._table) == count
        self._broken = False
        return len(self._table) < KEPT and len(self._patches) < KEPT

    def __call__(self, hits: Hits, check: Check) -> Gathered:
        """The light from everywhere at hits, for their shading normals Ns."""
        n = len(hits.P)
        light, sky, share = np.zeros((n, 3)), np.zeros(n), np.ones(n)
        alive, level = np.arange(n), 0
        while len(alive):
            check()
            some = hits if len(alive) == n else hits.at(alive)
            with self._field.stats.stage("gathered light: asked"):
                around = self._field.grids.around(some.triangle, some.P, some.Ng, level)
            number, known = self._numbers(around.keys, check)
            trust, close = np.empty(len(alive)), np.empty(len(alive), np.bool_)
            with self._field.stats.stage("gathered light: asked"):
                fine = np.inf if level >= LAST else self._fine  # there is no finer grid
                _trust(number, around.weight, around.spacing, known.inverse, known.nearest, WITHIN, STRICT, fine, trust,
                       close)
                visible = self._visible(some, number, known, around.weight, np.flatnonzero(close & (trust > 0)))
                end = around.spacing <= self._fine / 2**BEYOND
                end |= level >= LAST
                left, found, free = share[alive], np.zeros((len(alive), 3)), np.zeros(len(alive))
                _blend(number, around.weight, visible, trust, end, some.Ns, known.M, known.mean, known.open, left,
                       found, free)
                light[alive] += found
                sky[alive] += free
                share[alive] = left
                alive = alive[left > ENOUGH]
            level += 1
        whole = 1 - share  # what is left out counts as the rest does
        return Gathered(light / whole[:, None], sky / whole)

    def nearly(self, hits: Hits, direction: NDArray[np.float64], size: NDArray[np.float64],
               check: Check) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the light (n,3) of lamps that arrives where rays along `direction` (n,3) hit, and that from
        everywhere, each as the radiance of a white matt surface: means over patches of about size (n,), scene units.
        """
        with self._field.stats.stage("gathered light: patches"), self._light:
            layer = self._gather.at(hits.triangle, hits.P, direction, size)
            return self._patches.arriving(layer, self._bounces, check)

    def _visible(self, hits: Hits, number: NDArray, known: Any, weight: NDArray,
                 rows: NDArray) -> NDArray[np.bool_] | None:
        """Which records (n,3) the receivers of these rows see; None: all."""
        if not len(rows):
            return None
        visible = np.ones((len(hits.P), 3), np.bool_)
        row, corner = np.nonzero(weight[rows] > 1e-9)
        row = rows[row]
        # both ends stand a little above the surface
        ends = number[row, corner]
        blocked = self._field.tracer.occluded(hits.P, row.astype(np.int32), points(known.P), ends, hits.Ng, False,
                                              kind="diffuse")
        visible[row, corner] = ~blocked
        self._field.stats.add(gathered_short_rays=len(row))
        return visible

    def _numbers(self, keys: NDArray[np.uint64], check: Check) -> tuple[NDArray[np.int32], Any]:
        """The numbers (n,3) of records with these keys (n,3), and the arrays in which they are, ready."""
        with self._lock:
            before = len(self._table)
            number = self._table.numbers(keys.ravel())
            new = np.arange(before, len(self._table))
            self._grow()
            mine = self._table.keys[new]
        if len(new):
            try:
                self._compute_all(new, mine, check)
            except BaseException:
                with self._lock:
                    self._broken = True
                    self._lock.notify_all()
                raise
        with self._lock:
            if not len(new):
                pass
            else:
                self._lock.notify_all()
            while not self._done[number].all():
                if self._broken:
                    raise SharedRecordsError("another thread failed while it computed light that this one needs")
                self._lock.wait()
            known = _Known(self._P, self._M, self._mean, self._inverse, self._nearest, self._open)
        return number.reshape(keys.shape), known

    def _grow(self) -> None:
        n, had = len(self._table), len(self._done)
        if n <= had:
            return
        more = max(n, 2 * had, 4096) - had
        for name in _ARRAYS:
            a = getattr(self, name)
            setattr(self, name, np.concatenate([a, np.zeros((more, *a.shape[1:]), a.dtype)]))

    def _compute_all(self, new: NDArray[np.int64], keys: NDArray[np.uint64], check: Check) -> None:
        """Compute records (n,) with these keys."""
        places = self._field.grids.places(keys)
        left = np.ones(len(new), np.bool_)
        for at_least, local, more in self._kinds:
            rows = np.flatnonzero(left & (places.spacing >= at_least))
            left[rows] = False
            step = BATCH // len(local)
            for i in range(0, len(rows), step):
                check()
                some = rows[i:i + step]
                self._compute(new[some], Places._make(a[some] for a in places), local, more, check)

    def _compute(self, new: NDArray[np.int64], places: Places, local: NDArray, more: NDArray, check: Check) -> None:
        """Compute records by rays along `local` (d,3), which count as `more` (d,4) for leaning normals."""
        stats = self._field.stats
        with stats.stage("gathered light: rays"):
            seen = self._gather(places.P, places.N, local)
        with stats.stage("gathered light: nearness"), self._light:
            near = self._nearness(places.P, places.N, places.spacing, places.own)
        with stats.stage("gathered light: patches"), self._light:
            light = add(seen, self._patches, self._bounces, check)
        r = len(new)
        mean, inverse = np.empty((r, 5, 3), np.float32), np.empty(r, np.float32)
        nearest, free = np.empty(r, np.float32), np.empty(r, np.float32)
        _sum(seen.distance.reshape(r, -1), light.reshape(r, -1, 3), more, mean, inverse, nearest, free)
        inverse = np.maximum(inverse, WITHIN / (APART * np.maximum(near, 1e-30)))
        with self._lock:
            self._P[new] = places.P + LIFT * places.spacing[:, None] * places.N
            self._M[new], self._mean[new] = places.N, mean
            self._inverse[new], self._nearest[new], self._open[new] = inverse, np.minimum(nearest, near), free
            self._done[new] = True
            stats.add(records=r)


class _Known(NamedTuple):
    """The arrays of records."""

    P: NDArray[np.float64]
    M: NDArray[np.float64]
    mean: NDArray[np.float32]
    inverse: NDArray[np.float32]
    nearest: NDArray[np.float32]
    open: NDArray[np.float32]
