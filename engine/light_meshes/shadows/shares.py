"""Nodes of one lattice that store which share of a lamp they see, and the means of these shares at receivers.

A node that some receiver asks for traces FIRST points of the lamp. Receivers of one lattice cell on one triangle are a
*group*, with one set of candidates: where all of them see all of these points, or none, the group is done. Only the
nodes of the other groups trace all POINTS, and store the distance of the nearest thing in the way.

Where surfaces let light through, nodes also store whether such a surface is in the way of points that nothing opaque
hides. The number of points is no answer then, so receivers trace rays instead.

A receiver's mean takes each node *slid* onto the receiver's plane, along the way from the lamp's centre: the node sees
the same as that place, as long as nothing lies between. So it is only used where the certificate says that nothing
does.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import Targets
from ..support.bits import mask_of
from ..support.native import kernel, needs_memory
from . import pairs
from .lamp_points import Patterns, Shapes, points, turns_of_nodes
from .meshes.averaging import ask
from .meshes.certificate import Certificate
from .meshes.lattice import Lattice, candidates, lattice
from .meshes.node_store import NodeStore
from .method import Check, Nodes, Receivers, Setup

FIRST = 2  # points of a lamp that every node traces
THROUGH = 1 << 7  # the bit beside these of a node from which the lamp is seen through something, if at all
UNKNOWN = 1  # the distance of such a node: so near that its share counts nowhere
HALF, POINTS = 8, 16  # that nodes near penumbrae trace: all, or with many lamps half, and all where these disagree
UNEVEN = 0.5  # lamps whose radius is this share of their distance, by the cosine, are too near for a count of points
FAR = 2.6  # steps: nodes farther from a receiver are not asked whether its neighbourhood agrees
MANY = 2.0  # nodes for each step² that they are slid at most: so many are enough; at grazing light there are fewer
ACROSS = 0.8661  # steps: from the middle of a cell to what is farthest in it
PAIRS = 1 << 15  # of node and lamp traced at once

_groups, _sorted, _mean = kernel("shares_groups"), kernel("shares_sorted"), kernel("shares_mean")
_distances, _grazing, _agreed = kernel("shares_distances"), kernel("shares_grazing"), kernel("shares_agreed")
_uneven = kernel("shares_uneven")


class Groups(NamedTuple):
    """Receivers grouped by cells and triangles, and their candidates."""

    group: NDArray[np.int32]  # (n,) of each receiver
    first: NDArray[np.int64]  # (g,) its first receiver
    place: NDArray[np.float64]  # (g,3) where its candidates are around
    lit: NDArray[np.uint64]  # (g,W) lights that its receivers ask for
    start: NDArray[np.int64]  # (g,2) see `lattice.candidates`
    candidate: NDArray[np.int32]
    nodes: NDArray[np.int32]  # (u,3)
    position: NDArray[np.float64]  # (u,3) world


class Lamps(NamedTuple):
    """The data of the lamps that nodes and receivers need."""

    targets: Targets  # their centres
    shapes: Shapes
    narrow: NDArray[np.float64]  # (L,) half of the least width (`lamp_points.narrowest`)
    facing: NDArray[np.float64]  # (L,3) the normal of AREA lamps, 0 of others, which look the same from everywhere


class LampNodes(Nodes):
    """Values of the nodes of one lattice; a value comes from several points of a lamp."""

    def __init__(self, of: Lattice, lamps: Shapes, points: int, numbers: int) -> None:
        """points: the number of points of each lamp for one value. numbers: the bytes of a value."""
        self.lattice, self.lamps, self.points, self.paths = of, lamps, points, None
        self.store = NodeStore(len(lamps.shape), numbers, np.uint8)

    def take(self, old: Nodes) -> None:
        """Take over the nodes of `old`, see `Nodes`."""
        self.store = old.store


class Shares:
    """One lattice whose nodes store shares."""

    def __init__(self, lamps: Lamps, setup: Setup, h: float, enough: int = POINTS) -> None:
        """h: the step, world units; r = h·kI. enough: HALF or all of the POINTS; where the first HALF agree, the rest
        is not traced.
        """
        assert setup.lattice is not None
        settings, self.count = setup.settings, len(lamps.narrow)
        self.h, self.r, self._enough = h, h * settings.kI, enough
        self.lattice = lattice(h, np.array([settings.kI + ACROSS]), settings.lattice_rotation, settings.lattice_origin)
        self._lamps, self._tracer, self._stats = lamps, setup.tracer, setup.stats
        self._surfaces, self._certify = setup.lattice.surfaces, setup.lattice.certify
        self._casters = setup.casters.soft
        # What bends light stops it here: refracted paths bring it (`through`).
        self._stops, self._sheets = ("opaque", "glass") if setup.through.refraction is None else ("stops", "sheets")
        self._through = {g.casters for g in self._casters if setup.tracer.has(self._sheets, g.casters)} if (
            setup.through.channels) else set()
        self._first, self._all = (LampNodes(self.lattice, lamps.shapes, *kind)
                                  for kind in ((FIRST, 1), (enough, 2)))
        self.nodes = (self._first, self._all)
        self._every = np.stack([mask_of(range(self.count), self.count)])

    @property
    def certificate(self) -> Certificate | None:
        """Return the certificate within `reach`, which is made when it is first asked for; None if there is none."""
        return None if self._certify is None else self._certify(self.reach)

    @property
    def reach(self) -> float:
        """Return how far from a receiver its group's candidates may be, world units."""
        return self.h * (float(self.lattice.reach[-1]) + ACROSS)

    def groups(self, at: Receivers) -> Groups:
        """Return the groups of receivers, which ask for the lights in at.active."""
        n, s, L, N = len(at.P), self._surfaces, self.lattice, at.normals()
        table = np.full(1 << int(2 * n + 2).bit_length(), -1, np.int32)
        cells, group = np.empty((n, 3), np.int64), np.empty(n, np.int32)
        first, place, lit = np.empty(n, np.int64), np.empty((n, 3)), np.empty_like(at.active)
        count = _groups(L.h, L.rotation, L.origin, s.centre, s.scale, s.vertices, s.triangles, at.P, N, at.triangle,
                        at.active, table, cells, group, first, place, lit)
        first, place, lit = first[:count].copy(), place[:count].copy(), lit[:count].copy()
        near = candidates(L, place, N[first])
        return Groups(group, first, place, lit, near.start, near.candidate, near.nodes, near.position)

    def sorted(self, g: Groups, check: Check) -> tuple[NDArray[np.uint64], NDArray[np.uint64], NDArray[np.uint64],
                                                       NDArray[np.uint8]]:
        """Return sets of lights for each group (g,W): those that all candidates see; those on which the candidates
        disagree; and of these the ones that some candidates see through a surface. Also return which of the FIRST
        points the nodes see (u,L), see `_trace_first`.
        """
        need = self._need(g, g.lit)
        seen_points = self._first.store.values(g.nodes, need, lambda nodes, todo: self._trace_first(nodes, todo, check))
        seen, mixed, through = np.empty_like(g.lit), np.empty_like(g.lit), np.empty_like(g.lit)
        needs_memory(_sorted(g.start, g.candidate, (1 << FIRST) - 1, seen_points, g.lit, seen, mixed, through))
        return seen, mixed, through, seen_points

    def agreed(self, at: Receivers, g: Groups, seen_points: NDArray[np.uint8], asked: NDArray[np.uint64],
               slid: float, to: NDArray[np.intp], rest: NDArray[np.float32],
               S: NDArray[np.float32]) -> NDArray[np.uint64]:
        """Let the nodes near receivers answer for lights of asked (n,W): add to S[to] (…,L,C), weighted by rest (…,L),
        and return the lights for which they had an answer.

        Nodes are near if they are less than FAR steps from a receiver, and less than `slid` steps when they are slid
        onto its plane. They have an answer if all of them agree, and if they are not too few. seen_points: from
        `sorted`.
        """
        known = np.empty_like(asked)
        needs_memory(_agreed(at.P, at.N, g.group, g.start, g.candidate, g.position, (1 << FIRST) - 1, seen_points,
                             *self._lamps.targets, FAR * self.h, slid * self.h, int(MANY * slid**2), asked,
                             to, rest, S, known))
        return known

    def grazing(self, g: Groups, N: NDArray) -> NDArray[np.uint64]:
        """Return the lamps (g,W) that the plane of a group may cut."""
        out = np.empty_like(g.lit)
        _grazing(g.place, N, g.first, *self._lamps.targets, *self._lamps.shapes[:4], g.lit, out)
        return out

    def uneven(self, g: Groups, N: NDArray, mixed: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Return the lights of `mixed` (g,W) that are so wide and near, or so oblique, that the number of visible
        points tells little about how much of their light arrives. N (n,3): the receivers' normals.
        """
        out = np.empty_like(mixed)
        _uneven(UNEVEN, g.place, N, g.first, *self._lamps.targets, *self._lamps.shapes[:4], mixed, out)
        return out

    def shares(self, g: Groups, lights: NDArray[np.uint64], check: Check) -> NDArray[np.uint8]:
        """Return shares and distances (u,2L) of the nodes of groups; they are valid for `lights` (g,W)."""
        found: NDArray[np.uint8] = self._all.store.values(g.nodes, self._need(g, lights),
                                                          lambda nodes, todo: self._trace_all(nodes, todo, check))
        return found

    def mean(self, at: Receivers, row: NDArray[np.int32], light: NDArray[np.int32], g: Groups,
             shares: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return S (k,) of pairs of a receiver and a light, and the width of the narrowest penumbra near, in r; 0 if
        there are too few nodes.
        """
        S, width = np.empty(len(row), np.float32), np.empty(len(row), np.float32)
        _mean(at.P, at.N, row, light, g.group, g.start, g.candidate, g.position, shares, POINTS, self.h, self.r,
              *self._lamps.targets, self._lamps.narrow, self._lamps.facing, S, width)
        return S, width

    def _need(self, g: Groups, lights: NDArray[np.uint64]) -> NDArray[np.uint64]:
        need = np.zeros((len(g.nodes), lights.shape[1]), np.uint64)
        ask(g.start, g.candidate, lights, self._every, need)
        return need

    def _pairs(self, todo: NDArray[np.uint64],
               check: Check) -> Iterator[tuple[NDArray[np.int32], NDArray[np.int32], int]]:
        """Yield the pairs to be traced as (row, light, casters), in pieces of bounded length."""
        for casters in self._casters:
            for i in range(0, len(todo), PAIRS):
                for row, light in pairs.blocks(todo[i:i + PAIRS] & casters.lights, self.count):
                    for k in range(0, len(row), PAIRS):
                        check()
                        yield row[k:k + PAIRS] + np.int32(i), light[k:k + PAIRS], casters.casters

    def _trace_first(self, nodes: NDArray[np.int32], todo: NDArray[np.uint64], check: Check) -> NDArray[np.uint8]:
        """Return which of the FIRST points of lights in todo (n,W) the nodes (n,3) see, as bits: (n,L)."""
        found = np.zeros((len(nodes), self.count), np.uint8)
        x, turn = self.lattice.position(nodes), turns_of_nodes(nodes)
        for row, light, casters in self._pairs(todo, check):
            blocked = self._blocked(x, turn, row, light, 0, FIRST, casters)
            found[row, light] = np.packbits(~blocked, axis=1, bitorder="little")[:, 0]
            some = self._behind_glass(x, turn, row, light, blocked, casters)
            found[row[some], light[some]] |= THROUGH
        return found

    def _trace_all(self, nodes: NDArray[np.int32], todo: NDArray[np.uint64], check: Check) -> NDArray[np.uint8]:
        """Return how many of all POINTS nodes see, and the distance of something in the way, as 8 bits or 0: (n,2L)."""
        found = np.zeros((len(nodes), self.count, 2), np.uint8)
        first = self._first.store.values(nodes, todo, lambda some, wanted: self._trace_first(some, wanted, check))
        x, turn = self.lattice.position(nodes), turns_of_nodes(nodes)
        for row, light, casters in self._pairs(todo, check):
            blocked = np.empty((len(row), POINTS), np.bool_)
            blocked[:, :FIRST] = np.unpackbits(first[row, light][:, None], axis=1, count=FIRST, bitorder="little") == 0
            enough = self._enough
            blocked[:, FIRST:enough] = self._blocked(x, turn, row, light, FIRST, enough - FIRST, casters)
            if enough < POINTS:
                blocked[:, enough:] = blocked[:, :1]
                seen = enough - blocked[:, :enough].sum(1)
                more = np.flatnonzero((seen > 0) & (seen < enough))
                rest = self._blocked(x, turn, row[more], light[more], enough, POINTS - enough, casters)
                blocked[more, enough:] = rest
            found[row, light, 0] = POINTS - blocked.sum(1, dtype=np.uint8)
            found[row, light, 1] = self._nearest(x, turn, row, light, blocked, casters)
            some = self._behind_glass(x, turn, row, light, blocked, casters)
            found[row[some], light[some], 1] = UNKNOWN
        return found.reshape(len(nodes), -1)

    def _behind_glass(self, x: NDArray[np.float64], turn: NDArray[np.float64], row: NDArray[np.int32],
                      light: NDArray[np.int32], blocked: NDArray[np.bool_], casters: int) -> NDArray[np.intp]:
        """Return the pairs from which points that are not blocked (k,count) are seen through a surface."""
        if casters not in self._through:
            return np.zeros(0, np.intp)
        count = blocked.shape[1]
        target = points(self._lamps.shapes, self._lamps.targets, x, Patterns(turn), row, light, 0, count)
        order = np.flatnonzero(~blocked).astype(np.int32)
        self._stats.add(long_rays=len(order))
        met = self._tracer.occluded(x, np.repeat(row, count)[order], target, order, None, closed=False,
                                    kind=self._sheets, casters=casters)
        return np.unique(order[met] // count)

    def _blocked(self, x: NDArray[np.float64], turn: NDArray[np.float64], row: NDArray[np.int32],
                 light: NDArray[np.int32], first: int, count: int, casters: int) -> NDArray[np.bool_]:
        """Return whether something is between x[row] and the points first..first+count of light: (k,count)."""
        target = points(self._lamps.shapes, self._lamps.targets, x, Patterns(turn), row, light, first, count)
        order = np.arange(len(row) * count, dtype=np.int32)
        self._stats.add(long_rays=len(order))
        return self._tracer.occluded(x, np.repeat(row, count), target, order, None, closed=False, kind=self._stops,
                                     casters=casters).reshape(-1, count)

    def _nearest(self, x: NDArray[np.float64], turn: NDArray[np.float64], row: NDArray[np.int32],
                 light: NDArray[np.int32], blocked: NDArray[np.bool_], casters: int) -> NDArray[np.uint8]:
        """Return the distance of what blocks the first or the last of the blocked points (k,POINTS), whichever is
        nearer.
        """
        out, some = np.zeros(len(row), np.uint8), np.flatnonzero(blocked.any(1))
        at, to = x[row[some]], (self._lamps.shapes, self._lamps.targets, x, Patterns(turn), row[some],
                                light[some])
        target = points(*to, 0, POINTS)
        ends = blocked[some].argmax(1), POINTS - 1 - blocked[some, ::-1].argmax(1)
        a, b = (self._distance(at, target, np.arange(len(some)) * POINTS + end, casters) for end in ends)
        out[some] = np.minimum(np.where(a > 0, a, 255), np.where(b > 0, b, 255))
        self._stats.add(long_rays=2 * len(some))
        return out

    def _distance(self, origin: NDArray[np.float64], targets: Targets, target: NDArray[np.intp],
                  casters: int) -> NDArray[np.uint8]:
        """Return the distance from origins (n,3) of the first thing on the way to their targets, as 8 bits; 0: there is
        none.
        """
        s, directional, out = self._surfaces, targets.directional[target], np.empty(len(origin), np.uint8)
        way = targets.position[target] - np.where(directional[:, None], 0.0, origin)
        length = np.sqrt((way * way).sum(1))
        triangle, u, v = self._tracer.closest(self._stops, origin, way / length[:, None], None,
                                              np.where(directional, 1e300, length), casters)
        _distances(s.centre, s.scale, s.vertices, s.triangles, self.h, origin, triangle, u, v, out)
        return out
