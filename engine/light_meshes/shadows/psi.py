"""Light meshes: algorithm Ψ (paper §3), the mean over the lattice nodes around a receiver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import points
from ..support.native import Call, needs_memory, together
from ..support.rows import even, taken
from . import pairs
from .casters import union
from .lamp_points import Shapes
from .meshes import averaging
from .meshes.averaging import Neighbourhood
from .meshes.certificate import MARGIN
from .meshes.lattice import candidates
from .meshes.node_store import NodeStore
from .meshes.path_table import PathTable
from .method import Check, Facet, LatticeSetup, Method, Nodes, Receivers, Setup
from .pairs import PAIRS
from .sharp import dim, sharp
from .terminator import merge, split

CANDIDATES = 1 << 23  # about the largest number of candidates that are held at once, of 6 bytes each
TRACED = 3  # calls of PAIRS rays at a time, between which it is seen whether the picture is still wanted


class Answer(NamedTuple):
    """Where the means of some receivers are written: the rows (n,) of all that follows."""

    rows: NDArray[np.intp]
    active: NDArray[np.uint64]  # (…,W) which lights were asked for, then for which Ψ has an answer
    S: NDArray[np.float32]  # (…,L,C)
    probe: NDArray[np.float64] | None


class LightMeshes(Method):
    """Ψ if all surfaces are opaque: the value of a node for a light is one bit."""

    nodes: tuple[Nodes, ...]
    points = 0  # nodes know what they see of lamps' centres
    lamps: Shapes | None = None
    most = CANDIDATES, 1 << 17  # candidates and receivers at once

    def __init__(self, setup: Setup, nodes: LatticeSetup) -> None:
        casters = setup.casters
        self.lattice, self.classes, self.certificate = nodes.lattice, nodes.classes, nodes.certificate
        self.nodes = (self,)
        self._holds = None if nodes.certificate is None else nodes.certificate.asked()
        self._tracer, self._stats, self._targets = setup.tracer, setup.stats, setup.targets
        self._uniform_skip, self._smooth = nodes.uniform_skip, setup.settings.weights == "SMOOTH"
        self._margin = MARGIN * setup.tracer.scale
        self._receives = casters.receives
        self.count, self.channels = len(setup.lights), max(1, setup.through.channels)
        self._groups, self._soft = casters.soft, union(casters.soft, self.count)
        self._sharp = sharp(setup, casters.whole)
        self._edges = sharp(setup, casters.sharp) if casters.sharp else None
        self.store, self.paths = self._store()
        candidates, receivers = self.most
        self._batch = int(np.clip(candidates // (2.1 * self.lattice.reach[-1]**3 + 4), 64, receivers))

    def _store(self) -> tuple[NodeStore, PathTable | None]:
        """Return an empty store for the nodes' values, and one for refracted paths if these are stored separately."""
        return NodeStore(max(1, self.count)), None

    def __call__(self, at: Receivers, check: Check, probe: NDArray | None = None) -> NDArray[np.float32]:
        """Return S, see `Method`."""
        soft = at.active & self._soft
        if at.triangle is not None and self._receives is not None:
            soft[~self._receives[at.triangle]] = 0
        lifted = None
        if at.lift is not None:
            lifted = np.zeros_like(soft)
            needs_memory(split(*at.lift, at.P, at.N, *self._targets, soft, lifted))
        S = self._dark(soft)
        self._ask(at._replace(active=soft), S, check, probe)
        if lifted is not None:
            self._ask_above(at, lifted, soft, S, check, probe)
        self._stats.add(receivers=len(at.P))
        dim(S, self._edges, at._replace(active=soft), check)
        left = at.active & ~soft  # lights for which Ψ has no answer get sharp shadows
        if len(pairs.rows(left)):
            S += self._sharp(at._replace(active=left), check)  # S is still 0 there
        return S

    def _dark(self, asked: NDArray[np.uint64]) -> NDArray[np.float32]:
        """Return S of 0 for receivers, but not filled where they ask for lights, (n,W): `_mean` sets it there."""
        return pairs.dark(len(asked), self.count, self.channels, asked)

    def _ask(self, at: Receivers, S: NDArray[np.float32], check: Check, probe: NDArray | None) -> None:
        """Fill S for the lights in at.active (n,W). The bits of lights for which Ψ has no answer are cleared."""
        lit = pairs.rows(at.active)
        step = even(len(lit), self._batch)
        for i in range(0, len(lit), step):
            check()
            row = lit[i:i + step]
            self._average(at.at(row), Answer(row, at.active, S, probe), check)

    def _ask_above(self, at: Receivers, lifted: NDArray[np.uint64], soft: NDArray[np.uint64], S: NDArray[np.float32],
                   check: Check, probe: NDArray | None) -> None:
        """Do the same for the lights in lifted (n,W) from points above the facets.

        The nodes are those above the smooth surface, and rays from there say which of them are seen. If a light is only
        partly lifted, the result is blended with the S that was computed on the facets.
        """
        lift = at.lift
        assert lift is not None
        rows = pairs.rows(lifted)
        if not len(rows):
            return
        lifted = lifted.take(rows, axis=0)
        answered, above = lifted.copy(), self._dark(lifted)
        work = None if probe is None else np.zeros((len(rows), probe.shape[1]))
        places = taken(at.P, rows) + taken(lift.above, rows)
        only = None if probe is None else ~soft[rows].any(1)
        facet = None if at.triangle is None else Facet(*(taken(a, rows) for a in (at.P, at.normals(), at.triangle)))
        self._ask(Receivers(places, taken(lift.side, rows), answered, facet=facet), above, check, work)
        needs_memory(merge(*lift, at.P, at.N, *self._targets, rows, lifted, answered, above, soft, S))
        if probe is not None and work is not None and only is not None:
            probe[rows[only]] = work[only]

    def _average(self, at: Receivers, answer: Answer, check: Check) -> None:
        """Do steps 1 to 5 for the receivers' soft lights and write the answer."""
        stats = self._stats
        near = self._look_up(at, check)
        end, state = np.empty(len(at.P), np.int64), np.zeros(2, np.int64)
        with stats.stage("uniform skip"):
            self._spare_rays(at, near, end, state)
        near = near._replace(weight=self._weights(near.seen))
        self._short_rays(at, near, end, state, check)
        with stats.stage("average"):
            empty, count = self._mean(at, near, answer)
        stats.add(candidates=len(near.candidate), empty_sets=count)
        if answer.probe is not None:  # for the largest ball
            m = near.m[:, -1]
            counts = near.start[:, -1] - near.start[:, 0], np.where(near.uniform, 0, m), empty, near.uniform
            answer.probe[answer.rows] = np.stack(counts, axis=1)

    def _look_up(self, at: Receivers, check: Check) -> Neighbourhood:
        """Return the candidates of receivers (steps 1 and 2), and their values for the lights."""
        with self._stats.stage("candidates"):
            found = candidates(self.lattice, at.P, at.normals(), at.active, self.classes.serve)
        with self._stats.stage("nodes"):
            values = self.store.values(found.nodes, found.need, lambda n, todo: self._trace(n, todo, check))
        n, seen = len(at.P), np.empty(len(found.candidate), np.bool_)
        return Neighbourhood(found.start, found.candidate, found.position, values, seen, seen, np.zeros(n, np.bool_),
                             np.empty((n, len(self.classes.serve)), np.int32))

    def _spare_rays(self, at: Receivers, near: Neighbourhood, end: NDArray[np.int64], state: NDArray[np.int64]) -> None:
        """Mark receivers whose candidates all agree, and candidates that are certainly seen.

        Sets the ends (n,) of the candidates to which rays are needed first: one of each receiver that is marked. Begins
        to trace these, see `_near`.
        """
        calls: list[Call] = []
        counts, holds = np.empty(2, np.int64), None
        on = at.facet or (None if at.triangle is None else Facet(at.P, at.normals(), at.triangle))
        if self._holds is not None and on is not None:
            holds = np.empty(len(at.P), np.bool_)
            calls.append((self._holds, at.P, on.N, on.triangle, holds))
            if at.facet is not None:
                calls.append((averaging.free_start, at.P, at.normals(), on.P, on.N, self._margin, holds))
        calls.append((averaging.spare, near.start, near.candidate, self._agreeing(at, near), at.active,
                      self.classes.serve, holds, *(on or (None, None))[:2], near.position, self._margin, near.uniform,
                      near.seen, end, counts))
        together(*calls, *self._first_rays(at, near, end, state))
        if holds is not None:
            self._stats.add(certified=counts[0], spared_rays=counts[1])

    def _first_rays(self, at: Receivers, near: Neighbourhood, end: NDArray[np.int64],
                    state: NDArray[np.int64]) -> tuple[Call, ...]:
        """Return the calls that begin to trace the rays of the uniform skip."""
        return (self._near(at, near, end, state),) if self._uniform_skip else ()

    def _short_rays(self, at: Receivers, near: Neighbourhood, end: NDArray[np.int64], state: NDArray[np.int64],
                    check: Check) -> None:
        """Fill weight (which is `seen`) by rays, where it matters; first up to `end` (n,) of a receiver's candidates,
        which are traced as far as `state` says.

        The mark `uniform` is kept only where the first candidate is seen. Otherwise it is not certain that m > 0, and
        all candidates are tested.
        """
        rest = np.zeros(2, np.int64)
        with self._stats.stage("short rays"):
            if self._uniform_skip:
                self._go_on(at, near, end, state, check)
            check()
            uniform, _ = together((averaging.ends, near.start, at.active, self.classes.serve, near.seen, near.uniform,
                                   end), self._near(at, near, end, rest))
            self._go_on(at, near, end, rest, check)
        self._stats.add(short_rays=int(state[1] + rest[1]), uniform_skips=uniform)

    def _near(self, at: Receivers, near: Neighbourhood, end: NDArray[np.int64], state: NDArray[np.int64]) -> Call:
        """Return the call that fills `seen` of the candidates up to end (n,) of each receiver, from receiver state[0]
        on. It stops after about PAIRS rays; state[1] counts them.
        """
        return self._tracer.near(at.P, at.normals(), near.position, near.start, end, near.candidate, PAIRS, near.seen,
                                 state)

    def _go_on(self, at: Receivers, near: Neighbourhood, end: NDArray[np.int64], state: NDArray[np.int64],
               check: Check) -> None:
        """Repeat `_near` until there is no receiver left."""
        while state[0] < len(end):
            check()
            together(self._near(at, near, end, state))

    def _weights(self, seen: NDArray[np.bool_]) -> NDArray:
        """Return v(x_l,P) of candidates (c,) as far as it is known, for those that are certainly seen."""
        return seen

    def _partial(self, at: Receivers, near: Neighbourhood, row: NDArray, index: NDArray) -> NDArray:
        """Return v(x_l,P) of the receivers row (k,) and their candidates index (k,); 0 for nodes that step 3 drops."""
        return ~self._tracer.occluded(at.P, row, points(near.position), near.candidate[index], at.N, closed=True)

    def _agreeing(self, at: Receivers, near: Neighbourhood) -> NDArray | None:
        """Return the values (u,W) on which candidates must agree for the uniform skip; None: near.uniform knows."""
        return near.values if self._uniform_skip else None

    def _mean(self, at: Receivers, near: Neighbourhood, answer: Answer) -> tuple[NDArray[np.bool_], int]:
        """Do step 5: fill m, and write the answer. Returns which receivers (n,) have soft lights with an empty set, and
        how many these are.
        """
        return averaging.means(near, at.P, at.active, self.classes, self._smooth, answer.rows, answer.S, answer.active)

    def _trace(self, nodes: NDArray[np.int32], todo: NDArray[np.uint64], check: Check) -> NDArray:
        """Return V(i, x) of nodes (n,3) for the lights in todo (n,W), as bits."""
        found, position, rays = np.zeros_like(todo), np.empty((len(nodes), 3)), 0
        calls: list[Call] = [self.lattice.place(nodes, position)]
        for i in range(0, len(nodes), 16384):
            part = slice(i, i + 16384)
            step = max(1, PAIRS // len(position[part]))
            calls += [self._tracer.lit(position[part], self._targets, todo[part], group.lights,
                                       (first, min(first + step, self.count)), found[part], group.casters)
                      for group in self._groups for first in range(0, self.count, step)]
        for k in range(0, len(calls), TRACED):
            check()
            rays += sum(together(*calls[k:k + TRACED]))
        self._stats.add(long_rays=rays)
        return found

    def take(self, old: Nodes) -> None:
        """Take over the nodes of `old`, which must all be valid here, and their paths."""
        self.store, self.paths = old.store, old.paths

    def interpolation_set(self, P: NDArray[np.float64], N: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """Return DLM(P) (steps 1 to 4) of the largest radius: receiver p keeps nodes[start[p]:start[p+1]], with start
        (n+1,).
        """
        start, candidate, nodes, position, _ = candidates(self.lattice, P, N)
        row = np.repeat(np.arange(len(P), dtype=np.int32), start[:, -1] - start[:, 0])
        seen, none = np.zeros(len(candidate), np.bool_), np.zeros((len(nodes), 0))
        near = Neighbourhood(start, candidate, position, none, seen, seen, seen[:0],
                             np.zeros((0, 0), np.int32))
        at = Receivers(P, N, np.zeros((len(P), 0), np.uint64))
        seen = averaging.any_channel(self._partial(at, near, row, np.arange(len(candidate))))
        kept = np.concatenate([[0], np.cumsum(np.bincount(row[seen], minlength=len(P)))])
        return kept.astype(np.int64), nodes[candidate[seen]]
