"""Patches of surfaces: what light they return to rays that gather, after so many bounces.

A patch is a small triangle of a triangle's grid, or stands for tiny triangles that are close together. Its light is
the mean of four of its points (of one, for the light of many lamps): emission, the lamps' direct light, and what its
own rays gather from other patches (radiosity). It is computed for patches that rays hit, and kept.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import points
from ..support.native import kernel
from .directions import directions
from .grids import LAST
from .rays import Check, Field, Gatherer, Layer, Seen
from .table import Table

RAYS = 64  # of a patch
WIDER = 3  # what a patch gathers is that of a patch whose edges are 2^WIDER times as long
BATCH = 4096  # patches at once
FEW = 4  # lamps whose light is the mean of four points of a patch; more light it at one
FEWER = 1.5  # how much larger the patches are for their rays, of which there are fewer than of records

_gather = kernel("patches_gather")

# What a surface is at some points: emission (n,3), the share of light it returns in all directions (n,3), and the
# lamps' light (n,3) that a white surface would return there; seen along directions (n,3).
Lit = Callable[[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64], bool],
               tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]


class Patches:
    """Not for several threads at once."""

    def __init__(self, field: Field, gather: Gatherer, look: Lit, lamps: int, emits: bool, finest: float) -> None:
        """look: what surfaces are. lamps: how many there are. emits: whether surfaces give light of their own. finest:
        patches are divided to this size, scene units.
        """
        self.dark = not emits
        self._many = lamps > FEW
        self._field, self._gather, self._look = field, gather, look
        self._gathers = emits or field.sky is not None  # else only lamps have light for the first bounce
        self._finest = finest
        self._table = Table()
        self._local = directions(RAYS)
        self._emission = np.empty((0, 3))
        self._albedo, self._direct, self._sky = np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3))
        self._white = np.empty((0, 3))  # direct light, as a white surface would return it
        self._looked, self._lit, self._traced, self._covered, self._widened, self._divided = (
            np.empty(0, np.bool_) for _ in range(6))
        self._bounced: list[tuple[NDArray[np.float64], NDArray[np.bool_]]] = []
        self._arrived: list[tuple[NDArray[np.float64], NDArray[np.bool_]]] = []
        # what their rays meet: links begin..begin+count of each patch to others, with weights where some let light pass
        self._begin, self._count = np.empty(0, np.int64), np.empty(0, np.int64)
        self._other = _Growing(np.empty(0, np.int32))
        self._weight = _Growing(np.empty((0, 3), np.float32)) if field.glass.transparent else None

    def __len__(self) -> int:
        return len(self._table)

    def radiance(self, layer: Layer, bounces: int, check: Check) -> NDArray[np.float64]:
        """The radiance (n,3) of what rays met: emission, and light that has come `bounces` times, or less, from a
        surface.
        """
        number = self._numbers(layer, bounces > 0, check)
        light: NDArray[np.float64] = self._after(number, bounces, check)[number]
        return light

    def arriving(self, layer: Layer, bounces: int,
                 check: Check) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The radiance (n,3) that white surfaces would return where rays met patches: of lamps; and of the sky, of what
        gives light, and of light that has come `bounces` times, or less, from a surface.
        """
        number = self._numbers(layer, True, check)
        self._know(number, True, check)
        if self._gathers or bounces > 0:
            around = self._incoming(number, bounces, check)
        else:
            around = np.zeros((len(number), 3))
        return self._white[number], around

    def _numbers(self, layer: Layer, lit: bool, check: Check) -> NDArray[np.int32]:
        """The patches (n,) that rays met. Where something stands on one and divides it, it is a smaller one."""
        grids, keys = self._field.grids, layer.keys
        number = self._table.numbers(keys)
        left = np.arange(len(keys))
        while len(left):
            self._grow()
            self._see(_missing(number[left], self._lit if lit else self._looked), lit, check)
            left = left[self._divided[number[left]]]
            keys = self._table.keys[number[left]]
            whole = grids.sizes(keys)[1] == 0  # it may stand for others
            left, keys = left[~whole], keys[~whole]
            number[left] = self._table.numbers(grids.finer(keys, layer.on[left]))
        return number

    def _grow(self) -> None:
        """Make room for the patches in the table."""
        n, had = len(self._table), len(self._looked)
        if n <= had:
            return
        more = max(n, 2 * had) - had

        def longer(a: NDArray) -> NDArray:
            return np.concatenate([a, np.zeros((more, *a.shape[1:]), a.dtype)])

        for name in ("_emission", "_albedo", "_direct", "_white", "_sky", "_looked", "_lit", "_traced", "_covered",
                     "_widened", "_divided", "_begin", "_count"):
            setattr(self, name, longer(getattr(self, name)))
        self._bounced = [(longer(light), longer(known)) for light, known in self._bounced]
        self._arrived = [(longer(light), longer(known)) for light, known in self._arrived]

    def _after(self, number: NDArray[np.int32], bounces: int, check: Check) -> NDArray[np.float64]:
        """The radiance of all patches, of which that of patches (n,) is known."""
        if bounces == 0:
            self._know(number, False, check)
            return self._emission
        while len(self._bounced) < bounces:
            self._bounced.append((np.zeros((len(self._looked), 3)), np.zeros(len(self._looked), np.bool_)))
        new = _missing(number, self._bounced[bounces - 1][1])
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
        """The radiance (n,3) that white patches (n,) would return of the sky and of other patches, after so many
        bounces. It changes slowly, so one wider patch gathers for many.
        """
        wider, left = number.copy(), np.arange(len(number))
        for by in range(WIDER, 0, -1):
            wider[left] = self._table.numbers(self._field.grids.wider(self._table.keys[number[left]], by))
            self._grow()
            self._see(_missing(wider[left], self._looked), False, check)
            left = left[self._divided[wider[left]]]  # it is for both sides of something
            wider[left] = number[left]
        while len(self._arrived) <= bounces:
            self._arrived.append((np.zeros((len(self._looked), 3)), np.zeros(len(self._looked), np.bool_)))
        new = _missing(wider, self._arrived[bounces][1])
        for i in range(0, len(new), BATCH):
            some = new[i:i + BATCH]
            self._trace(some[~self._traced[some]], bounces == 0 and self.dark, check)
            light = self._sky[some] + self._from_others(some, bounces, check)
            values, known = self._arrived[bounces]
            values[some], known[some] = light, True
        return self._arrived[bounces][0][wider]

    def _know(self, number: NDArray[np.int32], lit: bool, check: Check) -> None:
        """See that it is known what patches (n,) are, and their direct light if `lit`."""
        self._see(_missing(number, self._lit if lit else self._looked), lit, check)
        covered = _missing(number, self._widened)
        of_lit = self._lit[covered]
        self._uncover(covered[of_lit], True, check)
        self._uncover(covered[~of_lit], False, check)
        self._widened[covered] = True

    def _see(self, new: NDArray[np.int32], lit: bool, check: Check) -> None:
        """Find out what patches are, and their direct light if `lit`."""
        for i in range(0, len(new), BATCH):
            check()
            some = new[i:i + BATCH]
            triangle, P, N = self._field.grids.inside(self._table.keys[some])
            there, covered = self._there(P, N)
            emission, albedo, direct = self._look(triangle, P, N, lit and not self._many)
            if lit and self._many:
                one = 4 * np.arange(len(some)) + (there[:, :, 0] > 0).argmax(1)
                direct = np.repeat(self._look(triangle[one], P[one], N[one], True)[2], 4, axis=0)
            for kept, values in ((self._emission, emission), (self._albedo, albedo), (self._direct, albedo * direct),
                                 (self._white, direct)):
                kept[some] = (values.reshape(-1, 4, 3) * there).sum(1)
            self._looked[some] = True
            self._lit[some] = lit
            self._covered[some], self._widened[some] = covered, ~covered
            self._divided[some] = self._is_divided(self._table.keys[some], P, N)

    def _uncover(self, number: NDArray[np.int32], lit: bool, check: Check) -> None:
        """Let patches that are covered but for a corner be as the wider ones around them, unless these are covered."""
        for by in (1, 2, 4):
            keys = self._table.keys[number]
            around = self._field.grids.wider(keys, by)
            differs = around != keys
            number, wider = number[differs], self._table.numbers(around[differs])
            if not len(number):
                return
            self._grow()
            new = np.unique(wider)
            self._see(new[~(self._lit if lit else self._looked)[new]], lit, check)
            free = ~self._covered[wider]
            for kept in (self._emission, self._albedo, self._direct, self._white):
                kept[number[free]] = kept[wider[free]]
            number = number[~free]

    def _there(self, P: NDArray, N: NDArray) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """The weights (n,4,1) of the points of patches: those inside of something that stands there count only where
        all are. And whether all are (n,).
        """
        f = self._field
        triangle, *_ = f.tracer.closest("diffuse", P, N, N)
        covered = np.zeros(len(P), np.bool_)
        hit = np.flatnonzero((triangle >= 0) & self._gather.solid[triangle])
        covered[hit] = (f.grids.normals(triangle[hit]) * N[hit]).sum(1) > 0
        f.stats.add(gathered_rays=len(P))
        free = ~covered.reshape(-1, 4)
        none = ~free.any(1)
        free |= none[:, None]
        weight: NDArray[np.float64] = (free / free.sum(1, keepdims=True))[:, :, None]
        return weight, none

    def _is_divided(self, keys: NDArray[np.uint64], P: NDArray, N: NDArray) -> NDArray[np.bool_]:
        """Whether something stands between the points of patches (n,) that can be made smaller."""
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
        """Find the patches that those of these patches see, unless `sky_only`, and the sky that they see."""
        if not len(new):
            return
        check()
        keys = self._table.keys[new]
        _, P, N = self._field.grids.inside(keys)
        # each patch turns its rays by an angle of its own, so that what all miss differs
        angle = (keys * np.uint64(0x9E3779B185EBCA87) >> np.uint64(40)).astype(np.float64) / 2**24 * 2 * np.pi
        turn = np.stack([np.cos(angle), np.sin(angle)], 1)
        sky = np.zeros((len(new), 3))
        rows, others, weights = [], [], []
        for q in range(4):
            local = np.ascontiguousarray(self._local[q::4])
            seen = self._gather(np.ascontiguousarray(P[q::4]), np.ascontiguousarray(N[q::4]), local, turn, FEWER)
            sky += seen.light.reshape(len(new), len(local), 3).sum(1)
            for layer in () if sky_only else seen.layers:
                rows.append(layer.row // len(local))
                others.append(self._numbers(layer, False, check))
                weights.append(np.ones((len(layer.keys), 3)) if layer.weight is None else layer.weight)
        self._grow()
        if sky_only:  # they are asked again where others have light
            self._sky[new], self._count[new] = sky / RAYS, 0
            return
        row = np.concatenate(rows)
        order = np.argsort(row, kind="stable")
        self._sky[new] = sky / RAYS
        start = np.searchsorted(row[order], np.arange(len(new) + 1))
        had = len(self._other)
        self._begin[new], self._count[new] = had + start[:-1], np.diff(start)
        self._other = self._other.with_more(np.concatenate(others)[order])
        if self._weight is not None:
            self._weight = self._weight.with_more(np.concatenate(weights)[order].astype(np.float32))
        self._traced[new] = True

    def _from_others(self, number: NDArray[np.int32], bounces: int, check: Check) -> NDArray[np.float64]:
        """The radiance (n,3) that white patches return of the light of other patches, after so many bounces."""
        begin, count = self._begin[number], self._count[number]
        at = np.repeat(begin - np.cumsum(count) + count, count) + np.arange(count.sum())
        light = self._after(self._other.values[at], bounces, check)
        out = np.empty((len(number), 3))
        weight = None if self._weight is None else self._weight.values
        _gather(begin, count, self._other.values, weight, 1 / RAYS, light, out)
        return out


class _Growing:
    """An array that gets longer."""

    def __init__(self, empty: NDArray, n: int = 0) -> None:
        self._room, self._n = empty, n

    def __len__(self) -> int:
        return self._n

    @property
    def values(self) -> NDArray:
        """What it holds."""
        return self._room[:self._n]

    def with_more(self, more: NDArray) -> _Growing:
        """The array with `more` at its end."""
        n = self._n + len(more)
        if n > len(self._room):
            room = np.empty((2 * n, *self._room.shape[1:]), self._room.dtype)
            room[:self._n] = self.values
            self._room = room
        self._room[self._n:n] = more
        return _Growing(self._room, n)


def _missing(number: NDArray[np.int32], known: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Each of these numbers once that is not known."""
    new: NDArray[np.int32] = np.unique(number[~known[number]])
    return new


def add(seen: Seen, patches: Patches, bounces: int, check: Check) -> NDArray[np.float64]:
    """The radiance (x,3) that rays find: sky and patches."""
    light = seen.light
    for layer in () if bounces == 0 and patches.dark else seen.layers:
        found = patches.radiance(layer, bounces, check)
        light[layer.row] += found if layer.weight is None else layer.weight * found
    return light

