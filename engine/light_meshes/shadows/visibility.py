"""S_i(P): how much of light i a receiver sees. Three ways, one interface.

`visibility(P, N, active, check, triangle, lift) -> S` takes receivers P (n,3), world, with unit geometric normals N
(n,3) on their viewed side, and active (n,W) uint64: bit i of a receiver says that ξ_i·Ω_i ≠ 0. S is (n,L) float32, 0
where not active. triangle (n,): that receivers are on; None: on surfaces that soft shadows fall on. lift: where light
grazes smooth surfaces, what is seen is asked above their facets (`terminator`); None: nowhere.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import Targets, Tracer, points
from ..scene.description import Light
from ..support.bits import mask_of
from ..support.native import kernel
from ..support.statistics import Statistics
from .casters import Casters, Group, union
from .meshes.averaging import agreement, ask, certify, listed, mean, sizes, smooth_mean
from .meshes.certificate import MARGIN, Certificate
from .meshes.lattice import Lattice, candidates
from .meshes.node_store import NodeStore
from .terminator import Lift, merge, split, starts

Check = Callable[[], None]  # raises where the render was cancelled
CANDIDATES = 1 << 20  # about so many candidates are held at once
PAIRS = 1 << 19  # and so many rays

set_pairs, _pairs = kernel("pairs_set"), kernel("pairs_listed")
_drop_dark, _collect = kernel("pairs_drop_dark"), kernel("pairs_collect")


def blocks(mask: NDArray[np.uint64], lights: int):
    """The set bits of mask (n,W) as (row, light) arrays of bounded length."""
    step = max(1, PAIRS // max(1, len(mask)))
    for first in range(0, lights, step):
        last = min(first + step, lights)
        size = len(mask) * (last - first)
        row, light = np.empty(size, np.int32), np.empty(size, np.int32)
        n = _pairs(mask, first, last, row, light)
        if n:
            yield row[:n], light[:n]


class Unshadowed:
    """Local illumination, and lights that cast no shadow: S = 1."""

    def __init__(self, lights: tuple[Light, ...]) -> None:
        self.count = len(lights)

    def __call__(self, P: NDArray, N: NDArray, active: NDArray[np.uint64], check: Check,
                 triangle: NDArray[np.int32] | None = None, lift: Lift | None = None) -> NDArray[np.float32]:
        """S, see the module."""
        S = np.zeros((len(P), self.count), np.float32)
        set_pairs(active, self.count, 1.0, S)
        return S


class Sharp:
    """V_i(P): one ray to each light, past what shadows it in its group; 1 for lights in no group."""

    def __init__(self, lights: tuple[Light, ...], targets: Targets, tracer: Tracer, stats: Statistics,
                 groups: tuple[Group, ...]) -> None:
        self.count, self._targets, self._tracer, self._stats = len(lights), targets, tracer, stats
        self._groups, self._casting = groups, union(groups, len(lights))

    def __call__(self, P: NDArray, N: NDArray, active: NDArray[np.uint64], check: Check,
                 triangle: NDArray[np.int32] | None = None, lift: Lift | None = None) -> NDArray[np.float32]:
        """S, see the module."""
        S = np.zeros((len(P), self.count), np.float32)
        set_pairs(active & ~self._casting, self.count, 1.0, S)
        with self._stats.stage("sharp shadows"):
            for group in self._groups:
                for row, light in blocks(active & group.lights, self.count):
                    check()
                    origin, normal, of = starts(lift, P, N, self._targets, row, light)
                    S[row, light] = self.segments(origin, of, self._targets, light, normal, group.casters)
                    self._stats.add(shadow_rays=len(row))
        return S

    def segments(self, P: NDArray, row: NDArray, targets: Targets, target: NDArray, N: NDArray,
                 casters: int) -> NDArray:
        """1 for each clear segment (n,) from P[row] to targets[target], else 0."""
        return ~self._tracer.occluded(P, row, targets, target, N, closed=False, kind="opaque", casters=casters)


class LightMeshes:
    """Algorithm Ψ (paper §3): the average of what the nodes around P see."""

    def __init__(self, lights: tuple[Light, ...], targets: Targets, tracer: Tracer, stats: Statistics,
                 casters: Casters, lattice: Lattice, ring: NDArray[np.intp], smooth: bool, uniform_skip: bool,
                 certificate: Certificate | None) -> None:
        """ring (L,): which of the lattice's radii each soft light has. smooth: nodes weigh by their distance."""
        self.lattice, self._tracer, self._stats, self._targets = lattice, tracer, stats, targets
        self._uniform_skip, self._smooth, self._certificate = uniform_skip, smooth, certificate
        self._margin = MARGIN * tracer.scale
        self._receives = casters.receives
        self.count = len(lights)
        self._groups, self._soft = casters.soft, union(casters.soft, self.count)
        self._ring = ring
        self._serve = np.stack([self._soft & mask_of(np.flatnonzero(ring >= g), self.count)
                                for g in range(len(lattice.reach))])
        self._sharp: Any = Sharp(lights, targets, tracer, stats, casters.whole)
        self._edges: Any = Sharp(lights, targets, tracer, stats, casters.sharp) if casters.sharp else None
        self._channels: tuple[int, ...] = ()  # of S and of v(x_l,P), behind their other axes
        self.store = NodeStore(max(1, self.count))
        self._batch = int(np.clip(CANDIDATES // (2.1 * lattice.reach[-1]**3 + 4), 64, 16384))

    def __call__(self, P: NDArray, N: NDArray, active: NDArray[np.uint64], check: Check,
                 triangle: NDArray[np.int32] | None = None, lift: Lift | None = None,
                 probe: NDArray | None = None) -> NDArray[np.float32]:
        """S, see the module. probe (n,4): filled with what the debug passes show, in the order of passes.DEBUG."""
        S = np.zeros((len(P), self.count, *self._channels), np.float32)
        soft = active & self._soft
        if triangle is not None and self._receives is not None:
            soft[~self._receives[triangle]] = 0
        lifted = np.zeros_like(soft)
        if lift is not None:
            split(*lift, P, N, *self._targets, soft, lifted)
        self._ask(P, N, triangle, soft, S, check, probe)
        if lift is not None and lifted.any():
            self._ask_above(lift, P, N, lifted, soft, S, check, probe)
        self._stats.add(receivers=len(P))
        dim(S, soft, self._edges, P, N, check, lift)
        left = active & ~soft  # what Ψ has no answer for goes to sharp shadows
        if left.any():
            S += self._sharp(P, N, left, check, triangle, lift)  # disjoint bits: the sum is a choice
        return S

    def _ask(self, P: NDArray, N: NDArray, triangle: NDArray[np.int32] | None, soft: NDArray[np.uint64],
             S: NDArray[np.float32], check: Check, probe: NDArray | None) -> None:
        """Fill S of the lights in soft (n,W), which keeps those that Ψ has an answer for."""
        lit = np.flatnonzero(soft.any(1))
        for i in range(0, len(lit), self._batch):
            check()
            row = lit[i:i + self._batch]
            work = None if probe is None else np.empty((len(row), probe.shape[1]))
            on = None if triangle is None else triangle[row]
            soft[row] = self._average(P[row], N[row], on, soft[row], row, S, check, work)
            if probe is not None:
                probe[row] = work

    def _ask_above(self, lift: Lift, P: NDArray, N: NDArray, lifted: NDArray[np.uint64], soft: NDArray[np.uint64],
                   S: NDArray[np.float32], check: Check, probe: NDArray | None) -> None:
        """The same for the lights in lifted (n,W), above the facets; in part where S has what is seen on them, too.

        There the nodes are those above the smooth surface, and rays say which of them are seen.
        """
        rows = np.flatnonzero(lifted.any(1))
        lifted = lifted[rows]
        answered, above = lifted.copy(), np.zeros((len(rows), *S.shape[1:]), np.float32)
        work = None if probe is None else np.zeros((len(rows), probe.shape[1]))
        only = ~soft[rows].any(1)
        self._ask(P[rows] + lift.above[rows], lift.side[rows], None, answered, above, check, work)
        merge(*lift, P, N, *self._targets, rows, lifted, answered, above.reshape(len(rows), self.count, -1), soft,
              S.reshape(len(S), self.count, -1))
        if probe is not None and work is not None:
            probe[rows[only]] = work[only]

    def _average(self, P: NDArray, N: NDArray, triangle: NDArray[np.int32] | None, soft: NDArray[np.uint64],
                 rows: NDArray[np.intp], S: NDArray[np.float32], check: Check,
                 probe: NDArray | None) -> NDArray[np.uint64]:
        """Steps 1 to 5 for receivers' soft lights: S[rows] is filled; returns those (n,W) whose set is not empty."""
        stats = self._stats
        with stats.stage("candidates"):
            start, candidate, nodes = candidates(self.lattice, P, N)
            need = np.zeros((len(nodes), soft.shape[1]), np.uint64)
            ask(start, candidate, soft, self._serve, need)
            position = self.lattice.position(nodes)
        with stats.stage("nodes"):
            values = self.store.values(nodes, need, lambda n, todo: self._trace(n, todo, check))
        target = points(position)
        seen = np.zeros(len(candidate), np.bool_)  # without a ray
        uniform = np.zeros(len(P), np.bool_)
        if self._uniform_skip:
            with stats.stage("uniform skip"):
                self._agree(start, candidate, values, soft, uniform)
        if self._certificate is not None and triangle is not None:
            with stats.stage("certificate"):
                holds = self._certificate.holds(P, N, triangle)
                spared = certify(start, candidate, holds, uniform, P, N, position, self._margin, seen)
                stats.add(certified=int(holds.sum()), spared_rays=spared)
        weight: NDArray = seen  # v(x_l, P)
        if self._channels:
            weight = np.repeat(seen[:, None], self._channels[0], axis=1).astype(np.float32)
        if self._uniform_skip:
            with stats.stage("uniform skip"):
                witness = np.flatnonzero(uniform).astype(np.int32)
                witness = witness[~seen[start[witness, 0]]]
                clear = _any(self._partial(P, witness, target, candidate[start[witness, 0]], N))
                uniform[witness[~clear]] = False  # whether m > 0 is not certain: the long way
                stats.add(short_rays=len(witness), uniform_skips=int(uniform.sum()))
        with stats.stage("short rays"):
            row, index = listed(start, soft, self._serve, uniform, seen)
            for i in range(0, len(row), PAIRS):
                check()
                k = slice(i, i + PAIRS)
                weight[index[k]] = self._partial(P, row[k], target, candidate[index[k]], N)
            stats.add(short_rays=len(row))
        with stats.stage("average"):
            m = np.zeros((len(P), len(self._serve)), np.int32)
            sizes(start, _any(weight), uniform, m)
            self._mean(start, candidate, weight, uniform, values, soft, P, N, position, m, rows, S)
        # Of the classes with a set the one with the smallest ball serves them all.
        answered = soft & np.where(m[:, -1:] > 0, self._serve[(m > 0).argmax(1)], np.uint64(0))
        empty = (soft & ~answered).any(1)
        stats.add(candidates=len(candidate), empty_sets=int(empty.sum()))
        if probe is not None:  # of the largest ball
            probe[:] = np.stack([start[:, -1] - start[:, 0], np.where(uniform, 0, m[:, -1]), empty, uniform], axis=1)
        return answered

    def _partial(self, P: NDArray, row: NDArray, target: Targets, node: NDArray, N: NDArray) -> NDArray:
        """v(x_l,P) of P[row] and nodes target[node]: 0 for nodes that step 3 drops."""
        return ~self._tracer.occluded(P, row, target, node, N, closed=True)

    def _agree(self, start: NDArray, candidate: NDArray, values: NDArray, soft: NDArray, uniform: NDArray) -> None:
        """Mark receivers all of whose candidates have the same values."""
        agreement(start, candidate, values, soft, self._serve, uniform)

    def _mean(self, start: NDArray, candidate: NDArray, weight: NDArray, uniform: NDArray, values: NDArray,
              soft: NDArray, P: NDArray, N: NDArray, position: NDArray, m: NDArray, rows: NDArray, S: NDArray) -> None:
        """Step 5: fill S[rows]."""
        if self._smooth:
            smooth_mean(start, candidate, weight, uniform, values, soft, self._ring, self._radius, P, position, m, rows,
                        S)
        else:
            mean(start, candidate, weight, uniform, values, soft, self._serve, self._ring, m, rows, S)

    @property
    def _radius(self) -> NDArray[np.float64]:
        """r (K,) of the classes, world."""
        return self.lattice.h * self.lattice.reach

    def _trace(self, nodes: NDArray[np.int32], todo: NDArray[np.uint64], check: Check) -> NDArray:
        """V(i, x) of nodes (n,3) for the lights in todo (n,W), as bits."""
        found = np.zeros_like(todo)
        position = self.lattice.position(nodes)
        for i in range(0, len(nodes), 16384):
            part = slice(i, i + 16384)
            for group in self._groups:
                for row, light in blocks(todo[part] & group.lights, self.count):
                    check()
                    blocked = self._tracer.occluded(position[part], row, self._targets, light, None, closed=False,
                                                    kind="opaque", casters=group.casters)
                    _collect(row, light, blocked, found[part])
                    self._stats.add(long_rays=len(row))
        return found

    def take(self, old: LightMeshes) -> None:
        """Take the nodes of `old` over, which are all right here."""
        self.store = old.store

    def interpolation_set(self, P: NDArray[np.float64], N: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """DLM(P) (steps 1 to 4) of the largest radius: receiver p keeps nodes[start[p]:start[p+1]], start (n+1,)."""
        start, candidate, nodes = candidates(self.lattice, P, N)
        row = np.repeat(np.arange(len(P), dtype=np.int32), start[:, -1] - start[:, 0])
        seen = _any(self._partial(P, row, points(self.lattice.position(nodes)), candidate, N))
        kept = np.concatenate([[0], np.cumsum(np.bincount(row[seen], minlength=len(P)))])
        return kept.astype(np.int64), nodes[candidate[seen]]


def dim(S: NDArray[np.float32], soft: NDArray[np.uint64], edges: Any, P: NDArray, N: NDArray, check: Check,
        lift: Lift | None) -> None:
    """S of the lights in `soft`, all others 0, times V(P) past the sharp casters by `edges`; None: there are none."""
    if edges is not None:
        lit = soft.copy()
        _drop_dark(S.reshape(-1, int(np.prod(S.shape[1:]))), S.shape[1], lit)
        S *= edges(P, N, lit, check, None, lift)


def _any(v: NDArray) -> NDArray[np.bool_]:
    """Which v(x_l,P), (n,) or (n,C), are not 0."""
    return v if v.ndim == 1 else (v > 0).any(1)
