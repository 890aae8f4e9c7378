"""Light meshes where surfaces let light through (paper §5): node values are numbers, eq. (6), averaged by eq. (7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import points
from ..support.native import Call, kernel
from ..support.rows import put
from .meshes.averaging import Neighbourhood, answered, any_channel, listed, sizes
from .meshes.node_store import NodeStore
from .meshes.path_table import PathTable
from .method import Check, LatticeSetup, Receivers, Setup
from .pairs import PAIRS, dark
from .psi import CANDIDATES, Answer, LightMeshes
from .through import Straight

_uniform = kernel("semitransparent_uniform")
_mean, _mean_apart = kernel("semitransparent_mean"), kernel("semitransparent_mean_apart")


class SemitransparentMeshes(LightMeshes):
    """Eq. (7). BOUNDED: the neighbourhood ends at glass as at any surface, v(x_l,P) = 1. PAPER: as printed in the
    paper.
    """

    most = CANDIDATES // 8, 1 << 14  # a candidate takes four times the memory, because rays to it are listed

    def __init__(self, setup: Setup, nodes: LatticeSetup) -> None:
        through = setup.through
        # Paths are stored separately if their weight at P depends on P: with FOCUS by the cosine at P, without leaks by
        # ξ(P_j,P).
        self._focus = through.refraction is not None and through.refraction.footprint is not None
        self._apart = through.refraction is not None and (through.refraction.leak_free or self._focus)
        # If paths are stored separately, a node also has, for each light, the first row of its paths and their number.
        self._stride = through.channels + (2 if self._apart else 0)
        super().__init__(setup, nodes)
        self._passing, self._cutouts = through.passing, through.cutouts
        self._bounded, self._dims = setup.settings.glass == "BOUNDED", setup.casters.dims
        self._long_rays = Straight(setup, setup.casters.soft)

    def _store(self) -> tuple[NodeStore, PathTable | None]:
        kind = np.float64 if self._apart else np.float32
        return NodeStore(max(1, self.count), self._stride, kind), PathTable() if self._apart else None

    def _dark(self, asked: NDArray[np.uint64]) -> NDArray[np.float32]:
        return dark(len(asked), self.count, self.channels)  # to which `_mean` adds

    def _weights(self, seen: NDArray[np.bool_]) -> NDArray:
        return np.repeat(seen[:, None], self.channels, axis=1).astype(np.float32)

    def _agreeing(self, at: Receivers, near: Neighbourhood) -> None:
        # the plan switches the uniform skip off then, because the weight of a path depends on the receiver
        assert not (self._uniform_skip and self._apart)
        if self._uniform_skip:
            _uniform(near.start, near.candidate, near.values, at.active, self.classes.ring, self.channels, near.uniform)

    def _mean(self, at: Receivers, near: Neighbourhood, answer: Answer) -> tuple[NDArray[np.bool_], int]:
        alpha, ends = self.paths.rows if self.paths else PathTable.NONE
        average = _mean_apart if self._apart else _mean
        sizes(near)
        average(near.start, near.candidate, near.weight, near.kept(), near.uniform, near.values, at.active,
                self.classes.ring, self._smooth, self.classes.radius, at.P, at.N, *self._targets, near.position, alpha,
                ends, self._focus, near.m, answer.rows, answer.S)
        found, empty, count = answered(near, at.active, self.classes)
        put(answer.active, answer.rows, found)
        return empty, count

    def _first_rays(self, *_: object) -> tuple[Call, ...]:
        return ()  # rays to candidates are listed

    def _short_rays(self, at: Receivers, near: Neighbourhood, end: NDArray[np.int64], state: NDArray[np.int64],
                    check: Check) -> None:
        stats = self._stats
        if self._uniform_skip:
            with stats.stage("uniform skip"):
                witness = np.flatnonzero(near.uniform).astype(np.int32)
                witness = witness[~near.seen[near.start[witness, 0]]]
                clear = any_channel(self._partial(at, near, witness, near.start[witness, 0]))
                near.uniform[witness[~clear]] = False
                stats.add(short_rays=len(witness), uniform_skips=int(near.uniform.sum()))
        with stats.stage("short rays"):
            row, index = listed(near, at.active, self.classes)
            for i in range(0, len(row), PAIRS):
                check()
                k = slice(i, i + PAIRS)
                near.weight[index[k]] = self._partial(at, near, row[k], index[k])
            stats.add(short_rays=len(row))

    def _partial(self, at: Receivers, near: Neighbourhood, row: NDArray, index: NDArray) -> NDArray[np.float32]:
        """Return v(x_l,P) (k,C); 0 for nodes that step 3 drops."""
        segment = at.P, row, points(near.position), near.candidate[index], at.N, True
        if self._bounded and not self._cutouts:
            clear = ~self._tracer.occluded(*segment)
            return np.repeat(clear[:, None], self.channels, axis=1).astype(np.float32)
        dims = 0 if self._bounded else self._dims
        through = self._tracer.transmittance(*segment, self._passing, casters=dims)
        # a surface that lets all light through, such as a cut-out beside its leaf, does not end the neighbourhood
        if self._bounded:
            through = np.repeat((through == 1).all(1)[:, None], 3, axis=1).astype(np.float32)
        elif dims:
            through[self._tracer.occluded(*segment, kind="opaque")] = 0
        return through[:, :self.channels]

    def _trace(self, nodes: NDArray[np.int32], todo: NDArray[np.uint64], check: Check) -> NDArray:
        """Return v(i,x) of nodes (n,3) for the lights in todo (n,W), in the form of the store."""
        found = np.zeros((len(nodes), self.count, self._stride))
        for i in range(0, len(nodes), 4096):
            part = found[i:i + 4096]
            at = Receivers(self.lattice.position(nodes[i:i + 4096]), None, todo[i:i + 4096])
            if self.paths is None:
                part[:] = self._long_rays.whole(at, check)
                continue
            part[..., :self.channels] = self._long_rays.straight(at, check)
            for of in self._long_rays.paths(at, check):
                first = self.paths.append(of.alpha, of.ends)
                part[of.row, of.light, self.channels] = first + of.start[:-1]
                part[of.row, of.light, self.channels + 1] = np.diff(of.start)
        return found.reshape(len(nodes), -1)
