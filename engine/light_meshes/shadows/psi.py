"""Light meshes: algorithm Ψ (paper §3), the mean over the lattice nodes around a receiver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import points
from . import pairs
from .casters import union
from .lamp_points import Shapes
from .meshes import averaging
from .meshes.averaging import Neighbourhood
from .meshes.certificate import MARGIN
from .meshes.lattice import candidates
from .meshes.node_store import NodeStore
from .meshes.path_table import PathTable
from .method import Check, LatticeSetup, Method, Nodes, Receivers, Setup
from .pairs import PAIRS
from .sharp import dim, sharp
from .terminator import merge, split

CANDIDATES = 1 << 20  # about the largest number of candidates that are held at once



class Answer(NamedTuple):
    """Where the means of some receivers are written: the rows (n,) of S (…,L,C), and of the probe (…,4) if there is
    one.
    """

    rows: NDArray[np.intp]
    S: NDArray[np.float32]
    probe: NDArray[np.float64] | None


class LightMeshes(Method):
    """Ψ if all surfaces are opaque: the value of a node for a light is one bit."""

    nodes: tuple[Nodes, ...]
    points = 0  # nodes know what they see of lamps' centres
    lamps: Shapes | None = None

    def __init__(self, setup: Setup, nodes: LatticeSetup) -> None:
        casters = setup.casters
        self.lattice, self.classes, self.certificate = nodes.lattice, nodes.classes, nodes.certificate
        self.nodes = (self,)
        self._tracer, self._stats, self._targets = setup.tracer, setup.stats, setup.targets
        self._uniform_skip, self._smooth = nodes.uniform_skip, setup.settings.weights == "SMOOTH"
        self._margin = MARGIN * setup.tracer.scale
        self._receives = casters.receives
        self.count, self.channels = len(setup.lights), max(1, setup.through.channels)
        self._groups, self._soft = casters.soft, union(casters.soft, self.count)
        self._sharp = sharp(setup, casters.whole)
        self._edges = sharp(setup, casters.sharp) if casters.sharp else None
        self.store, self.paths = self._store()
        self._batch = int(np.clip(CANDIDATES // (2.1 * self.lattice.reach[-1]**3 + 4), 64, 16384))

    def _store(self) -> tuple[NodeStore, PathTable | None]:
        """Return an empty store for the nodes' values, and one for refracted paths if these are stored separately."""
        return NodeStore(max(1, self.count)), None

    def __call__(self, at: Receivers, check: Check, probe: NDArray | None = None) -> NDArray[np.float32]:
        """Return S, see `Method`."""
        S = np.zeros((len(at.P), self.count, self.channels), np.float32)
        soft = at.active & self._soft
        if at.triangle is not None and self._receives is not None:
            soft[~self._receives[at.triangle]] = 0
        lifted = np.zeros_like(soft)
        if at.lift is not None:
            split(*at.lift, at.P, at.N, *self._targets, soft, lifted)
        self._ask(at._replace(active=soft), S, check, probe)
        if lifted.any():
            self._ask_above(at, lifted, soft, S, check, probe)
        self._stats.add(receivers=len(at.P))
        dim(S, self._edges, at._replace(active=soft), check)
        left = at.active & ~soft  # lights for which Ψ has no answer get sharp shadows
        if left.any():
            S += self._sharp(at._replace(active=left), check)  # S is still 0 there
        return S

    def _ask(self, at: Receivers, S: NDArray[np.float32], check: Check, probe: NDArray | None) -> None:
        """Fill S for the lights in at.active (n,W). The bits of lights for which Ψ has no answer are cleared."""
        lit = np.flatnonzero(at.active.any(1))
        for i in range(0, len(lit), self._batch):
            check()
            row = lit[i:i + self._batch]
            on = None if at.triangle is None else at.triangle[row]
            batch = Receivers(at.P[row], at.normals()[row], at.active[row], on)
            at.active[row] = self._average(batch, Answer(row, S, probe), check)

    def _ask_above(self, at: Receivers, lifted: NDArray[np.uint64], soft: NDArray[np.uint64], S: NDArray[np.float32],
                   check: Check, probe: NDArray | None) -> None:
        """Do the same for the lights in lifted (n,W) from points above the facets.

        The nodes are those above the smooth surface, and rays from there say which of them are seen. If a light is only
        partly lifted, the result is blended with the S that was computed on the facets.
        """
        lift = at.lift
        assert lift is not None
        rows = np.flatnonzero(lifted.any(1))
        lifted = lifted[rows]
        answered, above = lifted.copy(), np.zeros((len(rows), *S.shape[1:]), np.float32)
        work = None if probe is None else np.zeros((len(rows), probe.shape[1]))
        only = ~soft[rows].any(1)
        self._ask(Receivers(at.P[rows] + lift.above[rows], lift.side[rows], answered), above, check, work)
        merge(*lift, at.P, at.N, *self._targets, rows, lifted, answered, above, soft, S)
        if probe is not None and work is not None:
            probe[rows[only]] = work[only]

    def _average(self, at: Receivers, answer: Answer, check: Check) -> NDArray[np.uint64]:
        """Do steps 1 to 5 for the receivers' soft lights and fill S. Returns the lights (n,W) whose set is not
        empty.
        """
        stats, serve, soft = self._stats, self.classes.serve, at.active
        near = self._look_up(at, check)
        self._spare_rays(at, near)
        near = near._replace(weight=self._weights(near.seen))
        if self._uniform_skip:
            self._witness(at, near)
        with stats.stage("short rays"):
            row, index = averaging.listed(near, soft, self.classes)
            for i in range(0, len(row), PAIRS):
                check()
                k = slice(i, i + PAIRS)
                near.weight[index[k]] = self._partial(at, near, row[k], index[k])
            stats.add(short_rays=len(row))
        with stats.stage("average"):
            averaging.sizes(near)
            self._mean(at, near, answer)
        # If the smallest ball that has a node belongs to class k, the lights of all classes from k on have a set.
        m = near.m
        answered = soft & np.where(m[:, -1:] > 0, serve[(m > 0).argmax(1)], np.uint64(0))
        empty = (soft & ~answered).any(1)
        stats.add(candidates=len(near.candidate), empty_sets=int(empty.sum()))
        if answer.probe is not None:  # for the largest ball
            counts = near.start[:, -1] - near.start[:, 0], np.where(near.uniform, 0, m[:, -1]), empty, near.uniform
            answer.probe[answer.rows] = np.stack(counts, axis=1)
        return answered

    def _look_up(self, at: Receivers, check: Check) -> Neighbourhood:
        """Return the candidates of receivers (steps 1 and 2), and their values for the lights."""
        with self._stats.stage("candidates"):
            start, candidate, nodes = candidates(self.lattice, at.P, at.normals())
            need = np.zeros((len(nodes), at.active.shape[1]), np.uint64)
            averaging.ask(start, candidate, at.active, self.classes.serve, need)
            position = self.lattice.position(nodes)
        with self._stats.stage("nodes"):
            values = self.store.values(nodes, need, lambda n, todo: self._trace(n, todo, check))
        seen = np.zeros(len(candidate), np.bool_)
        return Neighbourhood(start, candidate, position, values, seen, seen, np.zeros(len(at.P), np.bool_),
                             np.zeros((len(at.P), len(self.classes.serve)), np.int32))

    def _spare_rays(self, at: Receivers, near: Neighbourhood) -> None:
        """Mark receivers whose candidates all agree, and candidates that are certainly seen."""
        if self._uniform_skip:
            with self._stats.stage("uniform skip"):
                self._agree(at, near)
        if self.certificate is not None and at.triangle is not None:
            with self._stats.stage("certificate"):
                holds = self.certificate.holds(at.P, at.normals(), at.triangle)
                spared = averaging.certify(near.start, near.candidate, holds, near.uniform, at.P, at.N, near.position,
                                           self._margin, near.seen)
                self._stats.add(certified=int(holds.sum()), spared_rays=spared)

    def _witness(self, at: Receivers, near: Neighbourhood) -> None:
        """Keep the mark `uniform` only where the first candidate is seen. Otherwise it is not certain that m > 0, and
        all candidates are tested.
        """
        with self._stats.stage("uniform skip"):
            witness = np.flatnonzero(near.uniform).astype(np.int32)
            witness = witness[~near.seen[near.start[witness, 0]]]
            clear = averaging.any_channel(self._partial(at, near, witness, near.start[witness, 0]))
            near.uniform[witness[~clear]] = False
            self._stats.add(short_rays=len(witness), uniform_skips=int(near.uniform.sum()))

    def _weights(self, seen: NDArray[np.bool_]) -> NDArray:
        """Return v(x_l,P) of candidates (c,) as far as it is known, for those that are certainly seen."""
        return seen

    def _partial(self, at: Receivers, near: Neighbourhood, row: NDArray, index: NDArray) -> NDArray:
        """Return v(x_l,P) of the receivers row (k,) and their candidates index (k,); 0 for nodes that step 3 drops."""
        return ~self._tracer.occluded(at.P, row, points(near.position), near.candidate[index], at.N, closed=True)

    def _agree(self, at: Receivers, near: Neighbourhood) -> None:
        """Mark receivers whose candidates all have the same values."""
        averaging.agreement(near.start, near.candidate, near.values, at.active, self.classes.serve, near.uniform)

    def _mean(self, at: Receivers, near: Neighbourhood, answer: Answer) -> None:
        """Do step 5: fill S of these rows."""
        mean = averaging.smooth_mean if self._smooth else averaging.mean
        mean(near, at.P, at.active, self.classes, answer.rows, answer.S)

    def _trace(self, nodes: NDArray[np.int32], todo: NDArray[np.uint64], check: Check) -> NDArray:
        """Return V(i, x) of nodes (n,3) for the lights in todo (n,W), as bits."""
        found = np.zeros_like(todo)
        position = self.lattice.position(nodes)
        for i in range(0, len(nodes), 16384):
            part = slice(i, i + 16384)
            for group in self._groups:
                for row, light in pairs.blocks(todo[part] & group.lights, self.count):
                    check()
                    blocked = self._tracer.occluded(position[part], row, self._targets, light, None, closed=False,
                                                    kind="opaque", casters=group.casters)
                    pairs.collect(row, light, blocked, found[part])
                    self._stats.add(long_rays=len(row))
        return found

    def take(self, old: Nodes) -> None:
        """Take over the nodes of `old`, which must all be valid here, and their paths."""
        self.store, self.paths = old.store, old.paths

    def interpolation_set(self, P: NDArray[np.float64], N: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """Return DLM(P) (steps 1 to 4) of the largest radius: receiver p keeps nodes[start[p]:start[p+1]], with start
        (n+1,).
        """
        start, candidate, nodes = candidates(self.lattice, P, N)
        row = np.repeat(np.arange(len(P), dtype=np.int32), start[:, -1] - start[:, 0])
        seen, none = np.zeros(len(candidate), np.bool_), np.zeros((len(nodes), 0))
        near = Neighbourhood(start, candidate, self.lattice.position(nodes), none, seen, seen, seen[:0],
                             np.zeros((0, 0), np.int32))
        at = Receivers(P, N, np.zeros((len(P), 0), np.uint64))
        seen = averaging.any_channel(self._partial(at, near, row, np.arange(len(candidate))))
        kept = np.concatenate([[0], np.cumsum(np.bincount(row[seen], minlength=len(P)))])
        return kept.astype(np.int64), nodes[candidate[seen]]
