"""Patches of surfaces: how much light they return to rays that gather, after a number of bounces.

A patch is a small triangle of a triangle's grid, or stands for tiny triangles that are close together. Its light is the
mean of four of its points (of one point if there are many lamps): emission, the lamps' direct light, and the light that
its own rays gather from other patches (radiosity). It is computed when a ray first hits the patch, and kept.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import points
from ..support.native import kernel
from .directions import directions
from .grids import LAST
from .growing import Growing
from .rays import LAST_KEY, Check, Field, Gatherer, Met, joined
from .table import Table

RAYS = 64  # of a patch
WIDER = 3  # what a patch gathers is that of a patch whose edges are 2^WIDER times as long
BATCH = 4096  # patches at once
FEW = 4  # lamps whose light is the mean of four points of a patch; more light it at one
FEWER = 1.5  # how much larger the patches are for their rays, of which there are fewer than of records
SHAPED, LOOKED, LIT = 1, 2, 3  # what is computed of a patch: its shape, then its colours, then the light of lamps on it
IN_CORNER = 16  # the bit of a patch whose points are those in a corner; the others are its free points
_ARRAYS = ("_emission", "_albedo", "_direct", "_white", "_sky", "_shaped", "_looked", "_lit", "_claimed", "_traced",
           "_covered", "_free", "_widened", "_widened_lit", "_divided", "_seen", "_begin", "_count")

_gather, _met, _missing = kernel("patches_gather"), kernel("patches_met"), kernel("patches_missing")

# What a surface is at some points: emission (n,3), the share of light it returns in all directions (n,3), and the
# lamps' light (n,3) that a white surface would return there; seen along directions (n,3).
Lit = Callable[[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64], bool],
               tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]


class SharedRecordsError(RuntimeError):
    """Another thread failed or was cancelled while it computed light for which this thread waits."""


class Patches:
    """All patches of a scene, shared by threads.

    A thread that asks holds a lock, and gives it away while it computes. It first claims what it computes, and other
    threads that need this wait. To avoid a deadlock, a thread waits only after it has computed what it has claimed, or
    for light that has come from fewer surfaces.
    """

    def __init__(self, field: Field, gather: Gatherer, look: Lit, lamps: int, emits: bool, finest: float) -> None:
        """look: tells what surfaces are. lamps: the number of lamps. emits: surfaces give light of their own. finest:
        the size to which patches are divided, scene units.
        """
        self.dark = not emits
        self._many = lamps > FEW
        self._field, self._gather, self._look = field, gather, look
        self._gathers = emits or field.sky is not None  # else only lamps have light for the first bounce
        self._finest = finest
        self._table = Table()
        self._local = directions(RAYS)
        self._emission, self._albedo, self._direct, self._sky = (np.empty((0, 3)) for _ in range(4))
        self._white = np.empty((0, 3))  # direct light, as a white surface would return it
        self._shaped, self._looked, self._lit, self._traced, self._covered, self._divided, self._seen = (
            np.empty(0, np.bool_) for _ in range(7))
        self._free = np.empty(0, np.uint8)  # the points that count, a bit each, and IN_CORNER
        self._claimed = np.empty(0, np.int8)  # a thread computes so much of it, or has done so
        # emission and albedo, or the lamps' light, are those of a wider patch where it is covered
        self._widened, self._widened_lit = np.empty(0, np.bool_), np.empty(0, np.bool_)
        self._bounced: list[tuple[NDArray, ...]] = []  # light and whether it is known, by bounces
        self._arrived: list[tuple[NDArray, ...]] = []  # what is gathered, whether it is known, and claimed
        self._lock, self._broken = threading.Condition(threading.Lock()), False
        # what their rays meet: links begin..begin+count of each patch to others, with weights where some let light pass
        self._begin, self._count = np.empty(0, np.int64), np.empty(0, np.int64)
        self._other = Growing(np.empty(0, np.int32))
        self._weight = Growing(np.empty((0, 3), np.float32)) if field.glass.transparent else None

    def __len__(self) -> int:
        return len(self._table)

    def again(self) -> None:
        """Get ready for another picture; the one before may have been cancelled."""
        self._claimed = self._shaped.astype(np.int8) + self._looked + self._lit
        self._arrived = [(light, known, known.copy()) for light, known, _ in self._arrived]
        self._broken = False

    def arriving(self, met: Met, bounces: int,
                 check: Check) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return two radiances (n,3) that white surfaces would return where rays met patches: from the light of lamps;
        and from the sky, from emitters, and from light that has come `bounces` times, or less, from a surface.
        """
        number = self.met(met, check)
        self._know(number, True, check)
        around = self._incoming(number, bounces, check) if self._gathers or bounces else np.zeros((len(number), 3))
        return self._white[number], around

    @contextmanager
    def asked(self) -> Iterator[None]:
        """Hold the lock, which is needed to ask. If this thread fails, the threads that wait for it fail too."""
        with self._lock:
            try:
                yield
            except BaseException:
                self._broken = True
                self._lock.notify_all()
                raise

    @contextmanager
    def _computing(self) -> Iterator[None]:
        """Give the lock away, so that other threads can ask meanwhile."""
        self._lock.release()
        try:
            yield
        finally:
            self._lock.acquire()

    def _wait(self, known: Callable[[], NDArray[np.bool_]], number: NDArray[np.int32]) -> None:
        """Wait until other threads have computed what they have claimed of patches (n,)."""
        self._lock.notify_all()
        while not known()[number].all():
            if self._broken:
                raise SharedRecordsError("another thread failed while it computed light that this one needs")
            self._lock.wait()

    def met(self, met: Met, check: Check) -> NDArray[np.int32]:
        """Return the patches (n,) that rays met; −1 and less: none. A patch that is divided, because something stands
        on it, is replaced by a smaller one.
        """
        g, n = self._field.grids, len(met.keys)
        number, todo, left = np.empty(n, np.int32), np.arange(n, dtype=np.int32), n
        while left:
            state = np.array([0, 0, left])
            while _met(*g.shape[1:], g.other, g.top, int(LAST_KEY), self._shaped, self._divided, *self._table.arrays,
                       *met, todo, state, number):
                self._table.grow()
            left = int(state[1])
            self._grow()
            self._shape(number[todo[:left]], check)
        return number

    def _wider(self, number: NDArray[np.int32], by: int) -> NDArray[np.uint64]:
        """Return the keys (n,) of the cells around these patches, whose edges are 2^by times as long."""
        return self._field.grids.wider(self._table.keys[number], by, self._gather.for_small)

    def _missing(self, number: NDArray[np.int32], known: NDArray[np.bool_]) -> NDArray[np.int32]:
        """Return each of these numbers once whose patch is not known yet."""
        out = np.empty(len(number), np.int32)
        return out[:_missing(number, known, self._seen, out)]

    def _grow(self) -> None:
        """Make room for the patches in the table."""
        n, had = len(self._table), len(self._looked)
        if n <= had:
            return
        more = max(n, 2 * had) - had

        def longer(a: NDArray) -> NDArray:
            return np.concatenate([a, np.zeros((more, *a.shape[1:]), a.dtype)])

        for name in _ARRAYS:
            setattr(self, name, longer(getattr(self, name)))
        self._bounced = [tuple(map(longer, of)) for of in self._bounced]
        self._arrived = [tuple(map(longer, of)) for of in self._arrived]

    def radiance(self, number: NDArray[np.int32], bounces: int, check: Check) -> NDArray[np.float64]:
        """Return the radiance of all patches: emission, and light that has come `bounces` times, or less, from a
        surface. It is valid for patches (n,) only.
        """
        if bounces == 0:
            self._know(number, False, check)
            return self._emission
        while len(self._bounced) < bounces:
            self._bounced.append((np.zeros((len(self._looked), 3)), np.zeros(len(self._looked), np.bool_)))
        new = self._missing(number, self._bounced[bounces - 1][1])
        self._know(new, True, check)
        for i in range(0, len(new), BATCH):
            some = new[i:i + BATCH]
            light = self._emission[some] + self._direct[some]
            if self._gathers or bounces > 1:
                light += self._albedo[some] * self._incoming(some, bounces - 1, check)
            values, known = self._bounced[bounces - 1]  # they may have grown
            values[some], known[some] = light, True
        return self._bounced[bounces - 1][0]

    def _incoming(self, number: NDArray[np.int32], bounces: int, check: Check) -> NDArray[np.float64]:
        """Return the radiance (n,3) that white patches (n,) would return of the sky and of other patches, after so many
        bounces. This light changes slowly in space, so one wider patch gathers for many.
        """
        wider, left = number.copy(), np.arange(len(number))
        for by in range(WIDER, 0, -1):
            wider[left] = self._table.numbers(self._wider(number[left], by))
            self._grow()
            self._shape(wider[left], check)
            # it is for both sides of something, or inside of it
            left = left[self._divided[wider[left]] | self._covered[wider[left]]]
            wider[left] = number[left]
        while len(self._arrived) <= bounces:
            n = len(self._looked)
            self._arrived.append((np.zeros((n, 3)), np.zeros(n, np.bool_), np.zeros(n, np.bool_)))
        mine = self._missing(wider, self._arrived[bounces][2])
        self._arrived[bounces][2][mine] = True
        for i in range(0, len(mine), BATCH):
            some = mine[i:i + BATCH]
            self._trace(some[~self._traced[some]], bounces == 0 and self.dark, check)
            light = self._sky[some]
            if bounces > 0 or not self.dark:
                light += self._from_others(some, bounces, check)
            values, known, _ = self._arrived[bounces]  # they may have grown
            values[some], known[some] = light, True
        self._wait(lambda: self._arrived[bounces][1], wider)
        out: NDArray[np.float64] = self._arrived[bounces][0][wider]
        return out

    def _know(self, number: NDArray[np.int32], lit: bool, check: Check) -> None:
        """Make sure that the data of patches (n,) is known, with their direct light if `lit`."""
        self._see(number, lit, check)
        covered = self._missing(number, self._widened_lit if lit else self._widened)
        self._uncover(covered, lit, check)
        (self._widened_lit if lit else self._widened)[covered] = True

    def _shape(self, number: NDArray[np.int32], check: Check) -> None:
        """Find out whether patches (n,) are divided or covered, and which of their points count."""
        new = self._missing(number, self._shaped)
        mine = self._claim(new, SHAPED)
        for i in range(0, len(mine), BATCH):
            check()
            some = mine[i:i + BATCH]
            keys = self._table.keys[some]
            with self._computing():
                free, covered, divided = self._shape_of(keys)
            self._free[some], self._covered[some], self._divided[some] = free, covered, divided
            self._shaped[some] = True
        if len(new):
            self._wait(lambda: self._shaped, new)

    def _see(self, number: NDArray[np.int32], lit: bool, check: Check) -> None:
        """Compute the data of patches (n,), with their direct light if `lit`."""
        self._shape(number, check)
        new = self._missing(number, self._lit if lit else self._looked)
        mine = self._claim(new, LIT if lit else LOOKED)
        for i in range(0, len(mine), BATCH):
            check()
            some = mine[i:i + BATCH]
            keys, free, covered = self._table.keys[some], self._free[some], self._covered[some]
            with self._computing():
                emission, albedo, direct, white = self._look_at(keys, free, lit)
            fresh = ~self._looked[some]  # what another thread has found is the same, and it may have widened it
            at = some[fresh]
            self._emission[at], self._albedo[at], self._widened[at] = emission[fresh], albedo[fresh], ~covered[fresh]
            self._looked[at] = True
            if lit:
                self._direct[some], self._white[some] = direct, white
                self._widened_lit[some], self._lit[some] = ~covered, True
        if len(new):
            self._wait(lambda: self._lit if lit else self._looked, new)

    def _claim(self, new: NDArray[np.int32], level: int) -> NDArray[np.int32]:
        """Return those of patches (n,) of which no other thread computes so much, and let this thread do it."""
        mine = new[self._claimed[new] < level]
        self._claimed[mine] = level
        return mine

    def _shape_of(self, keys: NDArray[np.uint64]) -> tuple[NDArray[np.uint8], NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which points of patches with these keys (n,) count, and whether they are covered, and divided."""
        _, P, N = self._field.grids.inside(keys)
        free, covered = self._uncovered(P, N)
        divided = self._is_divided(keys, P, N)
        hidden = np.flatnonzero(covered)  # but a corner may look out, as rays that met the patch have come to it
        if len(hidden):
            free[hidden], covered[hidden] = self._uncovered(*self._field.grids.inside(keys[hidden], True)[1:])
            free[hidden] |= IN_CORNER
        return free, covered, divided

    def _look_at(self, keys: NDArray[np.uint64], free: NDArray[np.uint8], lit: bool) -> tuple[NDArray, ...]:
        """Return the data of patches with these keys (n,) and free points: emission, albedo, the light of lamps that
        they return and that a white patch would return, each (n,3).
        """
        triangle, P, N = self._field.grids.inside(keys)
        corner = np.flatnonzero(free & IN_CORNER)
        if len(corner):
            at = (4 * corner[:, None] + np.arange(4)).ravel()
            triangle[at], P[at], N[at] = self._field.grids.inside(keys[corner], True)
        counts = free[:, None] >> np.arange(4, dtype=np.uint8) & 1
        weight = (counts / counts.sum(1, keepdims=True))[:, :, None]
        emission, albedo, direct = self._look(triangle, P, N, lit and not self._many)
        if lit and self._many:
            one = 4 * np.arange(len(keys)) + counts.argmax(1)
            direct = np.repeat(self._look(triangle[one], P[one], N[one], True)[2], 4, axis=0)
        return tuple((values.reshape(-1, 4, 3) * weight).sum(1) for values in (
            emission, albedo, albedo * direct, direct))

    def _uncover(self, number: NDArray[np.int32], lit: bool, check: Check) -> None:
        """Let patches that are covered, except for a corner, take the data of the wider patches around them, unless
        these are covered too.
        """
        for by in (1, 2, 4):
            keys = self._table.keys[number]
            around = self._wider(number, by)
            differs = (around != keys) & (self._field.grids.sizes(keys)[1] > 0)
            number, wider = number[differs], self._table.numbers(around[differs])
            if not len(number):
                return
            self._grow()
            self._see(wider, lit, check)
            free = ~self._covered[wider]
            for kept in (self._emission, self._albedo, *((self._direct, self._white) if lit else ())):
                kept[number[free]] = kept[wider[free]]
            number = number[~free]

    def _uncovered(self, P: NDArray, N: NDArray) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Return which of the four points of each patch count, a bit each, and whether all are covered (n,). A point
        inside of something that stands there counts only if all points are covered.
        """
        f = self._field
        triangle, *_ = f.tracer.closest("diffuse", P, N, N)
        covered = np.zeros(len(P), np.bool_)
        hit = np.flatnonzero((triangle >= 0) & self._gather.solid[triangle])
        covered[hit] = (f.grids.normals(triangle[hit]) * N[hit]).sum(1) > 0
        f.stats.add(gathered_rays=len(P))
        free = ~covered.reshape(-1, 4)
        none = ~free.any(1)
        return np.packbits(free | none[:, None], axis=1, bitorder="little")[:, 0], none

    def _is_divided(self, keys: NDArray[np.uint64], P: NDArray, N: NDArray) -> NDArray[np.bool_]:
        """Return whether something stands between the points of patches (n,), if these can be made smaller."""
        f = self._field
        size, level = f.grids.sizes(keys)
        can = np.flatnonzero((size > self._finest / 15.9) & (level > 0) & (level < LAST))
        found = np.zeros(len(keys), np.bool_)
        lift = 0.02 * size
        up = P + np.repeat(lift, 4)[:, None] * N
        ends = np.repeat(4 * can, 3) + np.tile([1, 2, 3], len(can))
        blocked = f.tracer.occluded(up, np.repeat(4 * can, 3).astype(np.int32), points(up), ends.astype(np.int32), None,
                                    False, kind="diffuse")
        found[can] = blocked.reshape(-1, 3).any(1)
        f.stats.add(gathered_short_rays=len(ends))
        return found

    def _trace(self, new: NDArray[np.int32], sky_only: bool, check: Check) -> None:
        """Trace the rays of these patches, and store the sky's light and, unless `sky_only`, the patches that they see.
        """
        if not len(new):
            return
        check()
        keys = self._table.keys[new]
        _, P, N = self._field.grids.inside(keys)
        # each patch turns its rays by an angle of its own, so that what all miss differs
        angle = (keys * np.uint64(0x9E3779B185EBCA87) >> np.uint64(40)).astype(np.float64) / 2**24 * 2 * np.pi
        turn = np.stack([np.cos(angle), np.sin(angle)], 1)
        with self._computing():
            sky, rows, several, weights = self._gathered(P, N, turn, sky_only)
        self._sky[new] = sky / RAYS
        if sky_only:  # they are asked again where others have light
            return
        number = self.met(joined(several), check)
        there = np.flatnonzero(number >= 0)
        row = np.concatenate(rows)[there]
        there = there[np.argsort(row, kind="stable")]
        count = np.bincount(row, minlength=len(new))
        self._begin[new], self._count[new] = len(self._other) + np.cumsum(count) - count, count
        self._other = self._other.with_more(number[there])
        if self._weight is not None:
            self._weight = self._weight.with_more(np.concatenate(weights)[there].astype(np.float32))
        self._traced[new] = True

    def _gathered(self, P: NDArray, N: NDArray, turn: NDArray, sky_only: bool) -> tuple[NDArray, list, list, list]:
        """Return the sum of the sky's light (n,3) that patches gather at their points (4n,3), and lists of the other
        hits of their rays: the patches' rows, the patches that are hit, and their weights.
        """
        n = len(turn)
        sky, rows, several, weights = np.zeros((n, 3)), [], [], []
        for q in range(4):
            local = np.ascontiguousarray(self._local[q::4])
            d = len(local)
            seen = self._gather(np.ascontiguousarray(P[q::4]), np.ascontiguousarray(N[q::4]), local, turn, FEWER,
                                sky_only)
            sky += np.count_nonzero(seen.distance.reshape(-1, d) == 0, axis=1)[:, None] * seen.sky
            for c in range(3):
                sky[:, c] += np.bincount(seen.row // d, seen.light[:, c], n)
            for row, met, weight in ((np.arange(len(seen.distance)), seen.met, None),
                                     *((seen.row[at], met, weight) for at, met, weight in seen.layers)):
                rows.append(row // d)
                several.append(met)
                weights.append(np.ones((len(row), 3)) if weight is None else weight)
        return sky, rows, several, weights

    def _from_others(self, number: NDArray[np.int32], bounces: int, check: Check) -> NDArray[np.float64]:
        """Return the radiance (n,3) that white patches return of the light of other patches, after so many bounces."""
        begin, count = self._begin[number], self._count[number]
        at = np.repeat(begin - np.cumsum(count) + count, count) + np.arange(count.sum())
        light = self.radiance(self._other.values[at], bounces, check)
        out = np.empty((len(number), 3))
        weight = None if self._weight is None else self._weight.values
        _gather(begin, count, self._other.values, weight, 1 / RAYS, light, out)
        return out
