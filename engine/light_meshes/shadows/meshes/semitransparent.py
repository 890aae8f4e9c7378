"""Ψ where surfaces let light through (paper §5): node values are numbers, eq. (6), averaged by eq. (7).

The same interface as `visibility`, but S is (n, L, C): one number a light, or RGB where the scene has coloured glass.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...glass.refraction import RefractedPaths
from ...rays.tracer import Targets, Tracer
from ...scene.description import Light
from ...support.bits import has
from ...support.native import kernel
from ...support.statistics import Statistics
from ..casters import Casters, Group, union
from ..terminator import Lift, starts
from ..visibility import Check, LightMeshes, blocks, set_pairs
from .certificate import Certificate
from .lattice import Lattice
from .node_store import NodeStore

_uniform, _add_paths = kernel("through_uniform"), kernel("through_add_paths")
_mean, _mean_apart = kernel("through_mean"), kernel("through_mean_apart")

Factor = Callable[[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]


class Refraction(NamedTuple):
    """How refracted shadow paths are followed."""

    solvers: dict[int, RefractedPaths]  # of each set of casters whose glass bends shadow rays
    footprint: float | None  # FOCUS: radius within which no more light gathers than came in; None: PAPER, Σ Π t
    leak_free: bool


class Straight:
    """V(i,P) by Π t of the surfaces crossed, and in FULL the refracted paths beside it: v(i,x) of eq. (6)."""

    def __init__(self, lights: tuple[Light, ...], targets: Targets, tracer: Tracer, stats: Statistics,
                 groups: tuple[Group, ...], factor: Factor, channels: int, refraction: Refraction | None) -> None:
        self.count, self.channels = len(lights), channels
        self._targets, self._tracer, self._stats = targets, tracer, stats
        self._factor, self._refraction = factor, refraction
        self._groups, self._casting = groups, union(groups, self.count)

    def __call__(self, P: NDArray, N: NDArray | None, active: NDArray[np.uint64], check: Check,
                 triangle: NDArray[np.int32] | None = None, lift: Lift | None = None) -> NDArray[np.float32]:
        """S (n,L,C) at receivers P with normals N, or at free points (N None)."""
        S = self.straight(P, N, active, check, triangle, lift)
        focus = self._refraction is not None and self._refraction.footprint is not None
        for wanted, light, start, alpha, ends in self.paths(P, N, active, check, lift):
            _add_paths(wanted, start, alpha, ends, light, focus and N is not None, P,
                       P if N is None else N if lift is None else lift.side, *self._targets, S)
        return S

    def straight(self, P: NDArray, N: NDArray | None, active: NDArray[np.uint64], check: Check,
                 triangle: NDArray[np.int32] | None = None, lift: Lift | None = None) -> NDArray[np.float32]:
        """V (n,L,C): Π t of the straight segments, in FULL only where nothing bends them."""
        S = np.zeros((len(P), self.count, self.channels), np.float32)
        set_pairs(active & ~self._casting, self.count, 1.0, S.reshape(len(S), -1))
        for group in self._groups:
            for row, light in blocks(active & group.lights, self.count):
                check()
                origin, normal, of = starts(lift, P, N, self._targets, row, light)
                on = triangle if triangle is None or of is row else triangle[row]
                S[row, light] = self.segments(origin, of, self._targets, light, normal, group.casters, on)
                self._stats.add(**{"shadow_rays" if N is not None else "long_rays": len(row)})
        for i in range(self.count if self._refraction else 0):
            solver = self._solver(i)
            dark = np.flatnonzero(has(active.T, i) & ~S[:, i].any(1))
            if solver is not None and len(dark):
                check()
                origin, normal, of = starts(lift, P, N, self._targets, dark, np.full(len(dark), i, np.int32))
                straight = solver.straight_on(i, origin[of], None if normal is None else normal[of])
                if straight is not None:
                    S[dark, i] = straight[:, :self.channels]
        return S

    def _solver(self, light: int) -> RefractedPaths | None:
        """Of the refracted paths of a light; None: nothing bends them."""
        solvers = self._refraction.solvers if self._refraction else {}
        return next((solvers.get(g.casters) for g in self._groups if has(g.lights, light)), None)

    def paths(self, P: NDArray, N: NDArray | None, active: NDArray[np.uint64], check: Check,
              lift: Lift | None = None) -> Iterator[tuple[NDArray, int, NDArray, NDArray, NDArray]]:
        """The refracted paths of eq. (6), light by light.

        Each is (rows of P, light, start, α, P_j): row k has paths start[k]:start[k+1] with α (c,3), in FOCUS times J,
        and the far end P_j (c,3) of the segment that reaches it.
        """
        if self._refraction is None:
            return
        footprint = self._refraction.footprint
        for i in range(self.count):
            solver = self._solver(i)
            wanted = np.flatnonzero(has(active.T, i))
            if len(wanted) and solver is not None:
                check()
                origin, normal, of = starts(lift, P, N, self._targets, wanted, np.full(len(wanted), i, np.int32))
                found, work = solver.paths(i, origin[of], None if normal is None else normal[of])
                alpha = found.alpha if footprint is None else found.alpha * found.clamped(footprint)[:, None]
                self._stats.add(refracted_paths=len(alpha), path_seeds=work.seeds, path_rays=work.rays,
                                path_seeds_not_converged=work.unconverged, paths_rejected=work.rejected)
                yield wanted, i, found.start, alpha, found.P

    def segments(self, P: NDArray, row: NDArray, targets: Targets, target: NDArray, N: NDArray | None,
                 casters: int, triangle: NDArray[np.int32] | None = None) -> NDArray[np.float32]:
        """Π t (n,C) of straight segments from P[row], on triangle[row], to targets[target]."""
        return self._tracer.transmittance(P, row, targets, target, N, False, self._factor,
                                          unbent=self._refraction is not None, casters=casters,
                                          triangle=triangle)[:, :self.channels]


class SharpThrough(Straight):
    """V_i(P) of receivers, timed as such."""

    def __call__(self, P: NDArray, N: NDArray | None, active: NDArray[np.uint64], check: Check,
                 triangle: NDArray[np.int32] | None = None, lift: Lift | None = None) -> NDArray[np.float32]:
        """S, see the module."""
        with self._stats.stage("sharp shadows"):
            return super().__call__(P, N, active, check, triangle, lift)


class SemitransparentMeshes(LightMeshes):
    """Eq. (7). BOUNDED: glass bounds the neighbourhood like any surface, v(x_l,P) = 1. PAPER: as printed."""

    def __init__(self, lights: tuple[Light, ...], targets: Targets, tracer: Tracer, stats: Statistics,
                 casters: Casters, lattice: Lattice, ring: NDArray[np.intp], smooth: bool, uniform_skip: bool,
                 certificate: Certificate | None, factor: Factor, channels: int, refraction: Refraction | None,
                 bounded: bool, cutouts: bool) -> None:
        super().__init__(lights, targets, tracer, stats, casters, lattice, ring, smooth, uniform_skip,
                         certificate)
        self.channels, self._channels = channels, (channels,)
        self._factor, self._bounded, self._cutouts = factor, bounded, cutouts
        self._dims = casters.dims
        through = factor, channels, refraction
        self._nodes = Straight(lights, targets, tracer, stats, casters.soft, *through)
        self._sharp = SharpThrough(lights, targets, tracer, stats, casters.whole, *through)
        if casters.sharp:
            self._edges = SharpThrough(lights, targets, tracer, stats, casters.sharp, *through)
        # Kept apart: what a path is worth at P depends on P. FOCUS: its cosine there; leak-free: ξ(P_j,P).
        self._focus = refraction is not None and refraction.footprint is not None
        self._apart = PathTable(channels) if refraction and (refraction.leak_free or self._focus) else None
        # With the paths apart a node also has, for each light, the first row of its paths and their number.
        self._stride = channels + (2 if self._apart else 0)
        self.store = NodeStore(max(1, self.count), self._stride, np.float64 if self._apart else np.float32)

    def take(self, old: LightMeshes) -> None:
        """Take the nodes of `old` over, which are all right here, and their paths."""
        assert isinstance(old, SemitransparentMeshes)
        self.store, self._apart = old.store, old._apart

    def _agree(self, start: NDArray, candidate: NDArray, values: NDArray, soft: NDArray, uniform: NDArray) -> None:
        assert not self._apart  # then the plan has no uniform skip: what paths are worth depends on the receiver
        _uniform(start, candidate, values, soft, self._ring, self.channels, uniform)

    def _mean(self, start: NDArray, candidate: NDArray, weight: NDArray, uniform: NDArray, values: NDArray,
              soft: NDArray, P: NDArray, N: NDArray, position: NDArray, m: NDArray, rows: NDArray, S: NDArray) -> None:
        alpha, ends = self._apart.rows if self._apart else PathTable.NONE
        average = _mean_apart if self._apart else _mean
        average(start, candidate, weight, (weight > 0).any(1), uniform, values, soft, self._ring, self._smooth,
                self._radius, P, N, *self._targets, position, alpha, ends, self._focus, m, rows, S)

    def _partial(self, P: NDArray, row: NDArray, target: Targets, node: NDArray, N: NDArray) -> NDArray[np.float32]:
        """v(x_l,P) (n,C): 0 for nodes that step 3 drops."""
        if self._bounded and not self._cutouts:
            clear = ~self._tracer.occluded(P, row, target, node, N, closed=True)
            return np.repeat(clear[:, None], self.channels, axis=1).astype(np.float32)
        dims = 0 if self._bounded else self._dims
        through = self._tracer.transmittance(P, row, target, node, N, True, self._factor, casters=dims)
        if self._bounded:  # what lets all through, as a cut-out does beside its leaf, bounds nothing
            through = np.repeat((through == 1).all(1)[:, None], 3, axis=1).astype(np.float32)
        elif dims:
            through[self._tracer.occluded(P, row, target, node, N, True, kind="opaque")] = 0
        return through[:, :self.channels]

    def _trace(self, nodes: NDArray[np.int32], todo: NDArray[np.uint64], check: Check) -> NDArray:
        """v(i,x) of nodes (n,3) for the lights in todo (n,W), as the store keeps it."""
        found = np.zeros((len(nodes), self.count, self._stride))
        for i in range(0, len(nodes), 4096):
            x, wanted, part = self.lattice.position(nodes[i:i + 4096]), todo[i:i + 4096], found[i:i + 4096]
            if self._apart is None:
                part[:] = self._nodes(x, None, wanted, check)
                continue
            part[..., :self.channels] = self._nodes.straight(x, None, wanted, check)
            for rows, light, start, alpha, ends in self._nodes.paths(x, None, wanted, check):
                first = self._apart.append(alpha, ends)
                part[rows, light, self.channels] = first + start[:-1]
                part[rows, light, self.channels + 1] = np.diff(start)
        return found.reshape(len(nodes), -1)


class PathTable:
    """The refracted paths of all nodes, kept apart (end of paper §5): α_j and P_j. It only grows; threads share it."""

    NONE = np.zeros((0, 3)), np.zeros((0, 3))

    def __init__(self, channels: int) -> None:
        self.rows = self.NONE  # α (c,3), P_j (c,3); replaced, never changed where rows are in use
        self._count = 0
        self._lock = threading.Lock()

    def append(self, alpha: NDArray[np.float64], ends: NDArray[np.float64]) -> int:
        """Add paths; the row of the first."""
        with self._lock:
            first, self._count = self._count, self._count + len(alpha)
            if self._count > len(self.rows[0]):
                room = np.zeros((2 * self._count, 3))
                alphas, all_ends = (np.concatenate([old[:first], room[first:]]) for old in self.rows)
                self.rows = alphas, all_ends
            for array, new in zip(self.rows, (alpha, ends), strict=True):
                array[first:self._count] = new
            return first
