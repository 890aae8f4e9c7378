"""S_i(P): how much of light i a receiver sees. Three ways, one interface.

`visibility(P, N, active) -> S` takes receivers P (n,3), world, with unit geometric normals N (n,3) on their viewed
side, and active (n,W) uint64: bit i of a receiver says that ξ_i·Ω_i ≠ 0. S is (n,L) float32, 0 where not active.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .compiled import kernel
from .lattice import Lattice, NodeStore, candidates
from .scene import Light
from .statistics import Statistics
from .tracing import Targets, Tracer, points

Check = Callable[[], None]  # raises where the render was cancelled
CANDIDATES = 1 << 20  # about so many candidates are held at once
PAIRS = 1 << 19  # and so many rays


def mask_of(flags: list[bool]) -> NDArray[np.uint64]:
    """Flags of L lights as words of 64 bits, (max(1, ceil(L/64)),)."""
    words = np.zeros(max(1, (len(flags) + 63) // 64), np.uint64)
    for i, flag in enumerate(flags):
        if flag:
            words[i >> 6] |= np.uint64(1) << np.uint64(i & 63)
    return words


@kernel
def _set_bits(mask, first, last, value, S):
    """S = value for each set bit among lights first..last."""
    for p in range(len(mask)):
        for i in range(first, last):
            if mask[p, i >> 6] >> np.uint64(i & 63) & np.uint64(1):
                S[p, i] = value


@kernel
def _pairs(mask, first, last, row, light):
    """(row, light) of each set bit, light by light so that neighbouring rays go the same way; returns how many."""
    count = 0
    for i in range(first, last):
        for p in range(len(mask)):
            if mask[p, i >> 6] >> np.uint64(i & 63) & np.uint64(1):
                row[count], light[count] = p, i
                count += 1
    return count


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

    def __call__(self, P: NDArray, N: NDArray, active: NDArray[np.uint64], check: Check) -> NDArray[np.float32]:
        """S, see the module."""
        S = np.zeros((len(P), self.count), np.float32)
        _set_bits(active, 0, self.count, 1.0, S)
        return S


class Sharp:
    """V_i(P): one ray to each light."""

    def __init__(self, lights: tuple[Light, ...], targets: Targets, tracer: Tracer, stats: Statistics) -> None:
        self.count, self._targets, self._tracer, self._stats = len(lights), targets, tracer, stats
        self._casting = mask_of([light.cast_shadow for light in lights])

    def __call__(self, P: NDArray, N: NDArray, active: NDArray[np.uint64], check: Check) -> NDArray[np.float32]:
        """S, see the module."""
        S = np.zeros((len(P), self.count), np.float32)
        _set_bits(active & ~self._casting, 0, self.count, 1.0, S)
        with self._stats.stage("sharp shadows"):
            for row, light in blocks(active & self._casting, self.count):
                check()
                S[row, light] = self.segments(P, row, self._targets, light, N)
                self._stats.add(shadow_rays=len(row))
        return S


    def segments(self, P: NDArray, row: NDArray, targets: Targets, target: NDArray, N: NDArray) -> NDArray:
        """1 for each clear segment (n,) from P[row] to targets[target], else 0."""
        return ~self._tracer.occluded(P, row, targets, target, N, closed=False)


class LightMeshes:
    """Algorithm Ψ (paper §3): the average of what the nodes around P see."""

    def __init__(self, lights: tuple[Light, ...], targets: Targets, tracer: Tracer, stats: Statistics,
                 lattice: Lattice, uniform_skip: bool) -> None:
        self.lattice, self._tracer, self._stats, self._targets = lattice, tracer, stats, targets
        self._uniform_skip = uniform_skip
        self.count = len(lights)
        self._soft = mask_of([light.soft_shadows and light.cast_shadow for light in lights])
        self._sharp: Any = Sharp(lights, targets, tracer, stats)
        self._channels: tuple[int, ...] = ()  # of S and of v(x_l,P), behind their other axes
        self.store = NodeStore(max(1, self.count))
        self._batch = int(np.clip(CANDIDATES // (2.1 * lattice.kI**3 + 4), 64, 16384))

    def __call__(self, P: NDArray, N: NDArray, active: NDArray[np.uint64], check: Check) -> NDArray[np.float32]:
        """S, see the module."""
        S = np.zeros((len(P), self.count, *self._channels), np.float32)
        soft = active & self._soft
        left = active.copy()  # what Ψ has no answer for goes to sharp shadows
        lit = np.flatnonzero(soft.any(1))
        for i in range(0, len(lit), self._batch):
            check()
            row = lit[i:i + self._batch]
            some = np.zeros((len(row), *S.shape[1:]), np.float32)
            m = self._average(P[row], N[row], soft[row], some, check)
            S[row] = some
            left[row[m > 0]] &= ~self._soft
        self._stats.add(receivers=len(P))
        if left.any():
            S += self._sharp(P, N, left, check)  # disjoint bits: the sum is a choice
        return S

    def _average(self, P: NDArray, N: NDArray, soft: NDArray[np.uint64], S: NDArray[np.float32],
                 check: Check) -> NDArray[np.int32]:
        """Steps 1 to 5 for receivers with soft lights: S is filled; returns m (n,), 0 where the set is empty."""
        stats = self._stats
        with stats.stage("candidates"):
            start, candidate, nodes = candidates(self.lattice, P, N)
            need = np.zeros((len(nodes), soft.shape[1]), np.uint64)
            _need(start, candidate, soft, need)
            position = self.lattice.position(nodes)
        with stats.stage("nodes"):
            values = self.store.values(nodes, need, lambda n, todo: self._trace(n, todo, check))
        target = points(position)
        weight = np.zeros((len(candidate), *self._channels), np.float32 if self._channels else np.bool_)  # v(x_l, P)
        m = np.zeros(len(P), np.int32)
        uniform = np.zeros(len(P), np.bool_)
        if self._uniform_skip:
            with stats.stage("uniform skip"):
                self._agree(start, candidate, values, soft, uniform)
                witness = np.flatnonzero(uniform).astype(np.int32)
                seen = _any(self._partial(P, witness, target, candidate[start[witness]], N))
                uniform[witness[~seen]] = False  # whether m > 0 is not certain: the long way
                stats.add(short_rays=len(witness), uniform_skips=int(seen.sum()))
        with stats.stage("short rays"):
            row, index = _listed(start, soft, uniform)
            for i in range(0, len(row), PAIRS):
                check()
                k = slice(i, i + PAIRS)
                weight[index[k]] = self._partial(P, row[k], target, candidate[index[k]], N)
            stats.add(short_rays=len(row))
        with stats.stage("average"):
            self._mean(start, candidate, weight, uniform, values, soft, P, N, position, m, S)
        stats.add(candidates=len(candidate), empty_sets=int((soft.any(1) & (m == 0)).sum()))
        return m

    def _partial(self, P: NDArray, row: NDArray, target: Targets, node: NDArray, N: NDArray) -> NDArray:
        """v(x_l,P) of P[row] and nodes target[node]: 0 for nodes that step 3 drops."""
        return ~self._tracer.occluded(P, row, target, node, N, closed=True)

    def _agree(self, start: NDArray, candidate: NDArray, values: NDArray, soft: NDArray, uniform: NDArray) -> None:
        """Mark receivers all of whose candidates have the same values."""
        _uniform(start, candidate, values, soft, uniform)

    def _mean(self, start: NDArray, candidate: NDArray, weight: NDArray, uniform: NDArray, values: NDArray,
              soft: NDArray, P: NDArray, N: NDArray, position: NDArray, m: NDArray, S: NDArray) -> None:
        """Step 5: fill m and S."""
        _count(start, candidate, weight, uniform, values, soft, m, S)

    def _trace(self, nodes: NDArray[np.int32], todo: NDArray[np.uint64], check: Check) -> NDArray:
        """V(i, x) of nodes (n,3) for the lights in todo (n,W), as bits."""
        found = np.zeros_like(todo)
        position = self.lattice.position(nodes)
        for i in range(0, len(nodes), 16384):
            part = slice(i, i + 16384)
            for row, light in blocks(todo[part], self.count):
                check()
                blocked = self._tracer.occluded(position[part], row, self._targets, light, None, closed=False)
                _collect(row, light, blocked, found[part])
                self._stats.add(long_rays=len(row))
        return found

    def take(self, old: LightMeshes) -> None:
        """Take the nodes of `old` over, which are all right here."""
        self.store = old.store

    def interpolation_set(self, P: NDArray[np.float64], N: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """DLM(P) (steps 1 to 4): start (n+1,) and nodes (c,3); receiver p keeps nodes[start[p]:start[p+1]]."""
        start, candidate, nodes = candidates(self.lattice, P, N)
        row = np.repeat(np.arange(len(P), dtype=np.int32), np.diff(start))
        seen = _any(self._partial(P, row, points(self.lattice.position(nodes)), candidate, N))
        kept = np.concatenate([[0], np.cumsum(np.bincount(row[seen], minlength=len(P)))])
        return kept.astype(np.int64), nodes[candidate[seen]]


def _any(v: NDArray) -> NDArray[np.bool_]:
    """Which v(x_l,P), (n,) or (n,C), are not 0."""
    return v if v.ndim == 1 else (v > 0).any(1)


@kernel
def _need(start, candidate, soft, need):
    """The lights (u,W) that each node is asked for: those of all receivers whose candidate it is."""
    for p in range(len(soft)):
        for w in range(soft.shape[1]):
            s = soft[p, w]
            if s:
                for c in range(start[p], start[p + 1]):
                    need[candidate[c], w] |= s


@kernel
def _uniform(start, candidate, values, soft, uniform):
    """Marks receivers all of whose candidates agree on every soft light."""
    for p in range(len(soft)):
        agree, any_soft = start[p + 1] > start[p], False
        for w in range(soft.shape[1]):
            s = soft[p, w]
            if s == 0 or not agree:
                continue
            any_soft = True
            first = values[candidate[start[p]], w] & s
            for c in range(start[p] + 1, start[p + 1]):
                if values[candidate[c], w] & s != first:
                    agree = False
                    break
        uniform[p] = agree and any_soft


@kernel
def _listed(start, soft, uniform):
    """(receiver, index into candidate) of every short ray that is needed."""
    total = 0
    need = np.zeros(len(soft), np.bool_)
    for p in range(len(soft)):
        if not uniform[p]:
            for w in range(soft.shape[1]):
                if soft[p, w]:
                    need[p] = True
            if need[p]:
                total += start[p + 1] - start[p]
    row, index = np.empty(total, np.int32), np.empty(total, np.int64)
    n = 0
    for p in range(len(soft)):
        if need[p]:
            for c in range(start[p], start[p + 1]):
                row[n], index[n] = p, c
                n += 1
    return row, index


@kernel
def _count(start, candidate, weight, uniform, values, soft, m, S):
    """m and S = (number of kept nodes that see the light)/m, eq. (4).

    The numbers of 64 lights are counted at once: plane b holds bit b of each light's number.
    """
    plane = np.zeros(32, np.uint64)
    for p in range(len(soft)):
        if uniform[p]:
            m[p] = 1  # all agree, and one is seen: any m gives the same quotients
        else:
            for c in range(start[p], start[p + 1]):
                m[p] += weight[c]
        if m[p] == 0:
            continue
        for w in range(soft.shape[1]):
            s = soft[p, w]
            if s == 0:
                continue
            planes = 0
            if uniform[p]:
                plane[0] = values[candidate[start[p]], w] & s
                planes = 1
            else:
                for c in range(start[p], start[p + 1]):
                    if not weight[c]:
                        continue
                    carry = values[candidate[c], w] & s
                    b = 0
                    while carry:
                        if b == planes:
                            plane[b] = 0
                            planes += 1
                        carry, plane[b] = carry & plane[b], carry ^ plane[b]
                        b += 1
            for i in range(64 * w, min(64 * w + 64, S.shape[1])):
                bit = np.uint64(i & 63)
                if s >> bit & np.uint64(1):
                    number = np.uint64(0)
                    for b in range(planes):
                        number |= (plane[b] >> bit & np.uint64(1)) << np.uint64(b)
                    S[p, i] = np.float32(np.float64(number) / m[p])


@kernel
def _collect(row, light, blocked, found):
    for n in range(len(row)):
        if not blocked[n]:
            i = light[n]
            found[row[n], i >> 6] |= np.uint64(1) << np.uint64(i & 63)
