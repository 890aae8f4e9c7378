"""Ψ where surfaces let light through (paper §5): node values are numbers, eq. (6), averaged by eq. (7).

The same interface as `visibility`, but S is (n, L, C): one number a light, or RGB where the scene has coloured glass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiled import kernel
from .lattice import Lattice, NodeStore, candidates
from .refraction import RefractedPaths
from .scene import Light
from .statistics import Statistics
from .tracing import Targets, Tracer, points
from .visibility import CANDIDATES, PAIRS, Check, blocks, listed, mask_of, need_of

Factor = Callable[[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]


class Refraction(NamedTuple):
    """How refracted shadow paths are followed."""

    solver: RefractedPaths
    footprint: float | None  # FOCUS: radius within which no more light gathers than came in; None: Σ Π t
    leak_free: bool


class Straight:
    """V(i,P) by Π t of the surfaces crossed, and in FULL the refracted paths beside it: v(i,x) of eq. (6)."""

    def __init__(self, lights: tuple[Light, ...], targets: Targets, tracer: Tracer, stats: Statistics,
                 factor: Factor, channels: int, refraction: Refraction | None) -> None:
        self.count, self.channels = len(lights), channels
        self._targets, self._tracer, self._stats = targets, tracer, stats
        self._factor, self._refraction = factor, refraction
        self._casting = mask_of([light.cast_shadow for light in lights])

    def __call__(self, P: NDArray, N: NDArray | None, active: NDArray[np.uint64], check: Check) -> NDArray[np.float32]:
        """S (n,L,C) at receivers P with normals N, or at free points (N None)."""
        S = np.zeros((len(P), self.count, self.channels), np.float32)
        _set_one(active & ~self._casting, self.count, S)
        for row, light in blocks(active & self._casting, self.count):
            check()
            S[row, light] = self.segments(P, row, self._targets, light, N)
            self._stats.add(**{"shadow_rays" if N is not None else "long_rays": len(row)})
        for wanted, light, start, alpha, _ in self.paths(P, N, active, check):
            _add_paths(wanted, start, alpha, light, S)
        return S

    def paths(self, P: NDArray, N: NDArray | None, active: NDArray[np.uint64], check: Check) -> Iterator[
            tuple[NDArray, int, NDArray, NDArray, NDArray]]:
        """The refracted paths of eq. (6), light by light.

        Each is (rows of P, light, start, α, P_j): row k has paths start[k]:start[k+1] with α (c,3), in FOCUS times J,
        and the far end P_j (c,3) of the segment that reaches it.
        """
        if self._refraction is None:
            return
        solver, footprint, _ = self._refraction
        for i in range(self.count):
            wanted = np.flatnonzero((active & self._casting)[:, i >> 6] >> np.uint64(i & 63) & np.uint64(1))
            if len(wanted):
                check()
                found, work = solver.paths(i, P[wanted], None if N is None else N[wanted])
                alpha = found.alpha if footprint is None else found.alpha * found.clamped(footprint)[:, None]
                self._stats.add(refracted_paths=len(alpha), path_seeds=work.seeds, path_rays=work.rays,
                                path_seeds_not_converged=work.unconverged, paths_rejected=work.rejected)
                yield wanted, i, found.start, alpha, found.P

    def segments(self, P: NDArray, row: NDArray, targets: Targets, target: NDArray,
                 N: NDArray | None) -> NDArray[np.float32]:
        """Π t (n,C) of straight segments from P[row] to targets[target]."""
        return self._tracer.transmittance(P, row, targets, target, N, False, self._factor,
                                          unbent=self._refraction is not None)[:, :self.channels]


class SharpThrough(Straight):
    """V_i(P) of receivers, timed as such."""

    def __call__(self, P: NDArray, N: NDArray | None, active: NDArray[np.uint64], check: Check) -> NDArray[np.float32]:
        """S, see the module."""
        with self._stats.stage("sharp shadows"):
            return super().__call__(P, N, active, check)


class SemitransparentMeshes:
    """Eq. (7). BOUNDED: glass bounds the neighbourhood like any surface, v(x_l,P) = 1. PAPER: as printed."""

    def __init__(self, lights: tuple[Light, ...], targets: Targets, tracer: Tracer, stats: Statistics,
                 lattice: Lattice, uniform_skip: bool, factor: Factor, channels: int, refraction: Refraction | None,
                 bounded: bool, cutouts: bool) -> None:
        self.lattice, self._tracer, self._stats, self._factor = lattice, tracer, stats, factor
        self._bounded, self._cutouts = bounded, cutouts
        self._uniform_skip = uniform_skip and bounded
        self.count, self.channels = len(lights), channels
        self._nodes = Straight(lights, targets, tracer, stats, factor, channels, refraction)
        self._sharp = SharpThrough(lights, targets, tracer, stats, factor, channels, refraction)
        self._soft = mask_of([light.soft_shadows and light.cast_shadow for light in lights])
        self.store = NodeStore(max(1, self.count), channels)
        self._batch = int(np.clip(CANDIDATES // (2.1 * lattice.kI**3 + 4), 64, 16384))

    def __call__(self, P: NDArray, N: NDArray, active: NDArray[np.uint64], check: Check) -> NDArray[np.float32]:
        """S, see the module."""
        S = np.zeros((len(P), self.count, self.channels), np.float32)
        soft, left = active & self._soft, active.copy()
        for i in range(0, len(P), self._batch):
            check()
            part = slice(i, i + self._batch)
            m = self._average(P[part], N[part], soft[part], S[part], check)
            left[part][m > 0] &= ~self._soft
        self._stats.add(receivers=len(P))
        if left.any():
            S += self._sharp(P, N, left, check)
        return S

    def _average(self, P: NDArray, N: NDArray, soft: NDArray[np.uint64], S: NDArray[np.float32],
                 check: Check) -> NDArray[np.int32]:
        """Steps 1 to 5; returns m (n,)."""
        stats = self._stats
        with stats.stage("candidates"):
            start, candidate, nodes = candidates(self.lattice, P, N)
            need = np.zeros((len(nodes), soft.shape[1]), np.uint64)
            need_of(start, candidate, soft, need)
            position = self.lattice.position(nodes)
        with stats.stage("nodes"):
            values = self.store.values(nodes, need, lambda n, todo: self._trace(n, todo, check))
        target = points(position)
        weight = np.zeros((len(candidate), self.channels), np.float32)  # v(x_l, P)
        uniform = np.zeros(len(P), np.bool_)
        if self._uniform_skip:
            with stats.stage("uniform skip"):
                _uniform_values(start, candidate, values, soft, self.channels, uniform)
                witness = np.flatnonzero(uniform).astype(np.int32)
                seen = self._partial(P, witness, target, candidate[start[witness]], N).all(1)
                uniform[witness[~seen]] = False
                stats.add(short_rays=len(witness), uniform_skips=int(seen.sum()))
        with stats.stage("short rays"):
            row, index = listed(start, soft, uniform)
            for i in range(0, len(row), PAIRS):
                check()
                k = slice(i, i + PAIRS)
                weight[index[k]] = self._partial(P, row[k], target, candidate[index[k]], N)
            stats.add(short_rays=len(row))
        m = np.zeros(len(P), np.int32)
        with stats.stage("average"):
            _mean(start, candidate, weight, uniform, values, soft, self.channels, m, S)
        stats.add(candidates=len(candidate), empty_sets=int((soft.any(1) & (m == 0)).sum()))
        return m

    def _partial(self, P: NDArray, row: NDArray, target: Targets, node: NDArray, N: NDArray) -> NDArray[np.float32]:
        """v(x_l,P) (n,C): 0 for nodes that step 3 drops."""
        if self._bounded and not self._cutouts:
            clear = ~self._tracer.occluded(P, row, target, node, N, closed=True)
            return np.repeat(clear[:, None], self.channels, axis=1).astype(np.float32)
        through = self._tracer.transmittance(P, row, target, node, N, True, self._factor)
        if self._bounded:  # what lets all through, as a cut-out does beside its leaf, bounds nothing
            through = np.repeat((through == 1).all(1)[:, None], 3, axis=1).astype(np.float32)
        return through[:, :self.channels]

    def _trace(self, nodes: NDArray[np.int32], todo: NDArray[np.uint64], check: Check) -> NDArray[np.float32]:
        return np.concatenate([
            self._nodes(self.lattice.position(nodes[i:i + 4096]), None, todo[i:i + 4096], check).reshape(
                -1, self.count * self.channels)
            for i in range(0, len(nodes), 4096)
        ])


@kernel
def _set_one(mask, lights, S):
    for p in range(len(mask)):
        for i in range(lights):
            if mask[p, i >> 6] >> np.uint64(i & 63) & np.uint64(1):
                S[p, i, :] = 1.0


@kernel
def _add_paths(rows, start, alpha, i, S):
    for n in range(len(rows)):
        for c in range(S.shape[2]):
            total = 0.0
            for j in range(start[n], start[n + 1]):
                total += alpha[j, c]
            S[rows[n], i, c] += total


@kernel
def _uniform_values(start, candidate, values, soft, channels, uniform):
    for p in range(len(soft)):
        agree, any_soft = start[p + 1] > start[p], False
        for i in range(values.shape[1] // channels):
            if not soft[p, i >> 6] >> np.uint64(i & 63) & np.uint64(1):
                continue
            any_soft = True
            for k in range(i * channels, (i + 1) * channels):
                first = values[candidate[start[p]], k] if agree else np.float32(0)
                c = start[p] + 1
                while agree and c < start[p + 1]:
                    agree = values[candidate[c], k] == first
                    c += 1
        uniform[p] = agree and any_soft


@kernel
def _mean(start, candidate, weight, uniform, values, soft, channels, m, S):
    """Eq. (7) without Ω: S = (1/m) Σ_l v(x_l,P)·v(i,x_l) over the m nodes with v(x_l,P) > 0."""
    for p in range(len(soft)):
        first, last = start[p], start[p + 1]
        if uniform[p]:
            m[p], last = 1, start[p] + 1  # all have the value of the first
        else:
            for c in range(first, last):
                for k in range(channels):
                    if weight[c, k] > 0.0:
                        m[p] += 1
                        break
        if m[p] == 0:
            continue
        for i in range(S.shape[1]):
            if not soft[p, i >> 6] >> np.uint64(i & 63) & np.uint64(1):
                continue
            for k in range(channels):
                total = 0.0
                for c in range(first, last):
                    w = 1.0 if uniform[p] else np.float64(weight[c, k])
                    total += w * values[candidate[c], i * channels + k]
                S[p, i, k] = np.float32(total / m[p])
