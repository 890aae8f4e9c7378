"""Soft shadows of lamps with a size (softness SIZE): shares at nodes where penumbrae are wide, rays where they are not.

For a receiver and a lamp: where all candidates of the finest lattice see the whole lamp, or nothing of it, that is S.
Else a plane fitted to slid shares (`shares`) is taken from the coarsest lattice whose r the penumbra is wider
than, neighbouring lattices blended. Where the penumbra is narrower than the finest r, or something is within r, or the
lamp is seen through something, S is the share of points of the lamp that rays from the receiver reach (`ray_counts`).

So it is also where receivers are few: in small pictures, and where rough surfaces see them. Rays of their own are fewer
there than those of the nodes around them.

With many such lamps what the camera sees first asks no nodes: `blocks` of the picture find out where rays are worth
while. Of few lamps nodes leave less grain, and a step between pixels would be seen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import points as places
from ..support.bits import has
from ..support.native import kernel
from . import blocks, lobe_points, pairs
from .casters import union
from .lamp_points import narrowest, reaches, shapes, turns_of_points
from .lifts import Lift
from .method import Check, Lobes, Method, Receivers, Setup
from .point_rays import RAYS_AT_ONCE, Aim, PointRays, aimed
from .ray_counts import FINE, RayCounts, Rays, many
from .shares import HALF, POINTS, Groups, Lamps, Shares
from .sharp import dim, sharp
from .terminator import starts, touched
from .through import Straight

LEVELS = 4  # lattices, each of twice the step of the one before
WIDE = 0.8  # the finest level counts where the penumbra is wider than so many r,
WIDER = 1.6  # and coarser ones, for which a finer one may stand in, where it is wider than so many of theirs,
BLEND = 0.5  # and alone from so many octaves above that on
# Nodes so many steps around a receiver may answer for it where those of its group disagree; with many lamps fewer
CLOSE = (2.0, 1.5)
DENSE = 2.0  # nodes are asked where receivers stand so many times as close as the step
BATCH = 1 << 15  # receivers at once

_add = kernel("shares_add")


class Batch(NamedTuple):
    """Receivers whose lights nodes may answer for, and where their answers go."""

    at: Receivers
    rows: NDArray[np.intp]  # (n,) of S and rest
    S: NDArray[np.float32]  # (…,L,C)
    rest: NDArray[np.float32]  # (…,L) by how much what rays say of a pair counts
    check: Check
    narrow: NDArray[np.uint64] | None  # see Receivers
    probe: NDArray[np.float64] | None  # see Method

    def of(self, rows: NDArray[np.integer], active: NDArray[np.uint64]) -> Batch:
        """Return some of the receivers, asked for other lights."""
        on = self.at.triangle
        at = Receivers(self.at.P[rows], self.at.normals()[rows], active, None if on is None else on[rows])
        return self._replace(at=at, rows=self.rows[rows])


class SizedLamps(Method):
    """S of lamps with a size."""

    def __init__(self, setup: Setup, others: Method, levels: int = LEVELS) -> None:
        """setup: its casters are those of lamps with a size only. others: of all other lights, and of such lamps on
        surfaces that take no soft shadows."""
        assert setup.lattice is not None
        casters = setup.casters
        self._others = others
        self._count, self._channels = len(setup.lights), max(1, setup.through.channels)
        self._tracer, self._stats = setup.tracer, setup.stats
        self._groups, self._soft = casters.soft, union(casters.soft, self._count)
        self._receives = casters.receives
        self._sharp = sharp(setup, casters.whole)
        self._edges = sharp(setup, casters.sharp) if casters.sharp else None
        self._bent = Straight(setup, casters.soft) if setup.through.refraction else None
        self._lamps = lamps(setup)
        self._point_rays = PointRays(setup, self._lamps, self._sharp)
        self._reaches, self._samples = reaches(self._lamps.shapes), setup.settings.samples
        self.highlights = self._highlights if self._channels == 1 else None
        kI, sized = setup.settings.kI, sum(has(self._soft, i) for i in range(self._count))
        self._rays = RayCounts(kI, sized, setup.settings.samples)
        self.weighs = self._rays.shared
        quick = many(sized) and kI < FINE
        self._enough, self._close = (HALF, CLOSE[1]) if quick else (POINTS, CLOSE[0])
        self.levels = [self._level(setup, 2.0**k) for k in range(levels)]
        self.nodes = (*others.nodes, *(nodes for level in self.levels for nodes in level.nodes))

    def _level(self, setup: Setup, coarser: float) -> Shares:
        return Shares(self._lamps, setup, setup.settings.h * coarser, self._enough)

    def __call__(self, at: Receivers, check: Check, probe: NDArray | None = None) -> NDArray[np.float32]:
        """S, see `Method`."""
        S = np.zeros((len(at.P), self._count, self._channels), np.float32)
        soft = at.active & self._soft
        if at.triangle is not None and self._receives is not None:
            soft[~self._receives[at.triangle]] = 0
        by_nodes, lifted, aim = soft.copy(), np.zeros_like(soft), aimed(at, self._samples)
        if at.lift is not None:
            touched(*at.lift, at.P, at.N, *self._lamps.targets, self._reaches, by_nodes, lifted)
        by_blocks, partly = np.zeros_like(soft), np.zeros_like(soft)
        if self._rays.shared and at.block is not None and at.weight is not None:
            by_blocks = soft if at.several is None else soft & ~at.several
            partly = self._ask_blocks(aim, by_blocks, lifted, self._rays.in_blocks(soft, at.weight), S, check)
        asked = by_nodes & ~lifted & ~by_blocks
        if at.apart is not None:  # where few receivers are, rays from them are fewer than rays from nodes
            asked[DENSE * at.apart > self.levels[0].h] = 0
        if at.several is not None:  # which lamp it is differs from receiver to receiver
            asked &= ~at.several
        if at.narrow is not None:
            at.narrow[:] |= soft & ~asked
        by_rays: NDArray[np.uint64] = np.bitwise_and(soft & ~asked, ~by_blocks)
        own = None if probe is None else np.zeros_like(probe)
        lit = np.flatnonzero(asked.any(1))
        rest = np.ones(S.shape[:2], np.float32) if len(lit) else None
        for i in range(0, len(lit), BATCH):
            check()
            rows = lit[i:i + BATCH]
            on = None if at.triangle is None else at.triangle[rows]
            assert rest is not None
            some = Receivers(at.P[rows], at.normals()[rows], asked[rows], on)
            by_rays[rows] |= self._ask(Batch(some, rows, S, rest, check, at.narrow, own))
        for name, pairs_of in (("lamp_pairs", soft), ("ray_pairs", np.bitwise_or(by_rays, partly))):
            self._stats.add_each(name, _each(pairs_of, self._count))
        if by_rays.any():
            counts = self._rays(soft, at.weight, at.shown)
            self._add_rays(aim, None, np.bitwise_and(by_rays, ~lifted), counts, S, rest, check)
            if lifted.any():
                self._add_rays(aim, at.lift, np.bitwise_and(by_rays, lifted), counts, S, rest, check)
        if self._bent is not None:
            S += self._bent.bent(at._replace(active=soft), check)
        dim(S, self._edges, at._replace(active=soft), check)
        if probe is not None:
            probe[:] = 0
        left = at.active & ~soft
        if left.any():
            S += self._others(at._replace(active=left), check, probe)  # S is 0 there so far
        if probe is not None and own is not None:
            own[:, 2] = (by_rays | partly).any(1)
            probe += own
        return S

    def _ask_blocks(self, aim: Aim, asked: NDArray[np.uint64], lifted: NDArray[np.uint64],
                    counts: NDArray[np.uint8], S: NDArray[np.float32], check: Check) -> NDArray[np.uint64]:
        """Set S of lights asked for (n,W), see `blocks.ask`, which needs at.block. Returns those that are seen in part.

        lifted (n,W): of which rays are lifted. counts (n,L): how many rays there are at last.
        """
        at = aim.at
        assert at.block is not None and at.sample is not None

        def add(row: NDArray[np.int32], light: NDArray[np.int32], some: NDArray[np.int32], lifts: bool, first: int,
                count: int, clear: NDArray[np.float64], whole: NDArray[np.float64]) -> None:
            self._point_rays.add(aim, at.lift if lifts else None, row, light, some, first, count, clear, whole, check)

        with self._stats.stage("rays of blocks"):
            where = blocks.Where(at.P, at.normals(), at.block, at.sample, blocks.edge(self._samples))
            return blocks.ask(asked, where, lifted, self._rays.rules, counts, self._rays.steps, add, S)

    def _add_rays(self, aim: Aim, lift: Lift | None, by_rays: NDArray[np.uint64], counts: NDArray[np.uint8],
                  S: NDArray[np.float32], rest: NDArray[np.float32] | None, check: Check) -> None:
        """Add to S (n,L,C) what rays say of by_rays (n,W), by how much that counts, rest (n,L); None: all is 1, as no
        nodes were asked. counts (n,L) or (n,1): of rays. lift: of receivers; None: the rays to these lights are not
        lifted.
        """
        counts = np.broadcast_to(counts, S.shape[:2])
        for row, light in pairs.blocks(by_rays, self._count):
            share, count = np.ones(len(row), np.float32) if rest is None else rest[row, light], counts[row, light]
            for number in np.flatnonzero(np.bincount(count)):
                some = np.flatnonzero(count == number)
                found = self._by_rays(aim, lift, row[some], light[some], self._rays.kind(int(number)), share[some] == 1,
                                      check)
                S[row[some], light[some]] += share[some, None] * found

    def _highlights(self, at: Receivers, S: NDArray[np.float32], lobes: Lobes,
                    check: Check) -> NDArray[np.float32] | None:
        """See `Method.highlights`; S (n,L,C): what it said of the receivers."""
        soft = at.active & self._soft
        soft[lobes.alpha <= 0] = 0
        if at.triangle is not None and self._receives is not None:
            soft[~self._receives[at.triangle]] = 0
        out: NDArray[np.float32] | None = None
        turn, targets, shapes = turns_of_points(at.P, at.sample), self._lamps.targets, self._lamps.shapes
        if at.sample is not None:
            turn = lobe_points.turns(turn, at.sample, self._samples)
        for group in self._groups:
            for row, light in pairs.blocks(soft & group.lights, self._count):
                seen = S[row, light, 0]
                partly = np.flatnonzero((seen > 0) & (seen < 1))
                partly = partly[lobe_points.matter(targets, self._reaches, at.P, *lobes, row[partly], light[partly])]
                for i in range(0, len(partly), RAYS_AT_ONCE // lobe_points.DIRECTIONS):
                    check()
                    some = partly[i:i + RAYS_AT_ONCE // lobe_points.DIRECTIONS]
                    to, weight = lobe_points.points(shapes, targets, at.P, *lobes, turn, row[some], light[some])
                    order = np.flatnonzero(weight.reshape(-1)).astype(np.int32)
                    of = np.repeat(row[some], lobe_points.DIRECTIONS)[order]
                    origin, normal, of = starts(at.lift, at.P, at.N, to, of, order)
                    visible = np.zeros(weight.size)
                    lamp = np.repeat(light[some], lobe_points.DIRECTIONS)[order]
                    visible[order] = self._sharp.segments(origin, of, to, order, normal, group.casters,
                                                          light=lamp)[:, 0]
                    self._stats.add(shadow_rays=len(order))
                    found = lobe_points.share(weight, visible.reshape(weight.shape), seen[some])
                    if out is None:
                        out = np.ones_like(S)
                    out[row[some], light[some], 0] = found / seen[some]
        return out

    def _ask(self, batch: Batch) -> NDArray[np.uint64]:
        """Add to S what nodes say; returns the lights (n,W) that rays must answer for."""
        at, level, stats = batch.at, self.levels[0], self._stats
        with stats.stage("candidates"):
            g = level.groups(at)
            grazing = level.grazing(g, at.normals())
            g.lit[:] &= ~grazing
            by_rays = grazing[g.group] & at.active
            soft = at.active & ~by_rays
        with stats.stage("nodes"):
            seen, mixed, through, seen_points = level.sorted(g, batch.check)
        certified = self._certified(level, at, g)
        unsure = mixed & (through | np.where(certified, np.uint64(0), ~np.uint64(0))[:, None])
        unsure |= level.uneven(g, at.normals(), mixed)
        by_rays |= unsure[g.group] & soft
        agreed = soft & ~mixed[g.group]
        unclear = mixed[g.group] & ~through[g.group] & soft
        hidden = self._hidden(at, g, np.flatnonzero(~certified[g.group] & (agreed | unclear).any(1)).astype(np.int32))
        by_rays[hidden] |= agreed[hidden]
        agreed[hidden] = 0
        with stats.stage("average"):
            _add(agreed & seen[g.group], batch.rows, batch.rest, batch.S)
        mixed &= ~unsure
        todo = mixed[g.group] & soft
        stats.add(receivers=len(at.P), mixed_pairs=int(_each(todo | by_rays, self._count).sum()))
        if todo.any():
            with stats.stage("nodes"):
                shares = level.shares(g, mixed, batch.check)
            for row, light in pairs.blocks(todo, self._count):
                with stats.stage("average"):
                    value, width = level.mean(at, row, light, g, shares)
                self._coarsen(batch, row, light, value, width)
                trust, to = _trust(width, WIDE), batch.rows[row]
                batch.S[to, light] += (batch.rest[to, light] * trust * value)[:, None]
                batch.rest[to, light] *= 1 - trust
                near = trust < 1
                np.bitwise_or.at(by_rays, (row[near], light[near] >> 6),
                                 np.uint64(1) << (light[near] & 63).astype(np.uint64))
        unclear &= by_rays
        unclear[hidden] = 0
        by_rays &= ~self._nearby(batch, g, seen_points, unclear)
        if batch.narrow is not None:
            batch.narrow[batch.rows] |= by_rays
        if batch.probe is not None:
            count = (g.start[:, -1] - g.start[:, 0])[g.group]
            none = np.zeros(len(count))  # sets that are empty, which rays stand for: known at the end
            batch.probe[batch.rows] = np.stack([count, np.where(todo.any(1), count, 0), none,
                                                ~(todo | by_rays).any(1)], axis=1)
        return by_rays

    def _nearby(self, batch: Batch, g: Groups, seen_points: NDArray[np.uint8],
                unclear: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Add to S what the nodes close to receivers say of lights in unclear (n,W), on which those of their groups do
        not agree; returns the lights of which they say something.
        """
        with self._stats.stage("average"):
            return self.levels[0].agreed(batch.at, g, seen_points, unclear, self._close, batch.rows,
                                         batch.rest, batch.S)

    def _hidden(self, at: Receivers, g: Groups, rows: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return those of these receivers whose nearest candidate is not seen: all of them may be behind something."""
        with self._stats.stage("short rays"):
            nearest = g.candidate[g.start[g.group[rows], 0]]
            self._stats.add(short_rays=len(rows))
            return rows[self._tracer.occluded(at.P, rows, places(g.position), nearest, at.N, closed=True)]

    def _coarsen(self, batch: Batch, row: NDArray[np.int32], light: NDArray[np.int32], value: NDArray[np.float32],
                 width: NDArray[np.float32]) -> None:
        """Make the `value` (k,) of pairs, by the lattice of h, whose penumbrae are `width` r wide, that of coarser ones
        where these do."""
        rest = np.flatnonzero(width >= 2 * WIDER)
        for level in self.levels[1:]:
            if not len(rest):
                return
            found, wide = self._coarser(level, batch, row[rest], light[rest])
            trust = _trust(wide, WIDER)
            value[rest] = (1 - trust) * value[rest] + trust * found
            rest = rest[wide >= 2 * WIDER]

    def _coarser(self, level: Shares, batch: Batch, row: NDArray[np.int32],
                 light: NDArray[np.int32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return S of a coarser level for pairs (k,), and the penumbra's width in its r; 0 where this level has no
        answer.
        """
        some, of = np.unique(row, return_inverse=True)
        soft = np.zeros((len(some), batch.at.active.shape[1]), np.uint64)
        np.bitwise_or.at(soft, (of, light >> 6), np.uint64(1) << (light & 63).astype(np.uint64))
        at = batch.of(some, soft).at
        with self._stats.stage("candidates"):
            g = level.groups(at)
        certified = self._certified(level, at, g)
        g.lit[~certified] = 0
        with self._stats.stage("nodes"):
            shares = level.shares(g, g.lit, batch.check)
        with self._stats.stage("average"):
            found, width = level.mean(at, of.astype(np.int32), light, g, shares)
        width[~certified[g.group[of]]] = 0
        return found, width

    def _certified(self, level: Shares, at: Receivers, g: Groups) -> NDArray[np.bool_]:
        """Groups (g,) near which nothing but their own plane or convex body is."""
        certificate = None if at.triangle is None else level.certificate
        if certificate is None or at.triangle is None:
            return np.zeros(len(g.first), np.bool_)
        with self._stats.stage("certificate"):
            return certificate.holds(g.place, at.normals()[g.first], at.triangle[g.first])

    def _by_rays(self, aim: Aim, lift: Lift | None, row: NDArray[np.int32], light: NDArray[np.int32], rays: Rays,
                 alone: NDArray[np.bool_], check: Check) -> NDArray[np.float32]:
        """Return the share (k,C) of points on light[k] that P[row[k]] sees. alone (k,): no nodes have a say there."""
        with self._stats.stage("rays near contact"):
            clear, whole = self._clear(aim, lift, row, light, 0, rays.first, check)
            if rays.most > rays.first:
                disagree = ((clear > 0) & (clear < whole[:, None])).any(1)
                more = np.flatnonzero(disagree & alone if rays.alone else disagree)
                found, further = self._clear(aim, lift, row[more], light[more], rays.first,
                                             rays.most - rays.first, check)
                clear[more] += found
                whole[more] += further
        return (clear / np.maximum(whole, 1e-300)[:, None]).astype(np.float32)

    def _clear(self, aim: Aim, lift: Lift | None, row: NDArray[np.int32], light: NDArray[np.int32], first: int,
               count: int, check: Check) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what points first..first+count of light[k] give P[row[k]], added up: what gets through (k,C), and what
        would if nothing stood between (k,). Ω is that of the lamp above the horizon, so the points below do not count.
        lift: of receivers that rays are lifted from.
        """
        clear, whole = np.zeros((len(row), self._channels)), np.zeros(len(row))
        every = np.arange(len(row), dtype=np.int32)
        self._point_rays.add(aim, lift, row, light, every, first, count, clear, whole, check)
        return clear, whole


def lamps(setup: Setup) -> Lamps:
    """Return the data of the lights that nodes and receivers need."""
    found = shapes(setup.lights)
    facing = np.array([light.direction for light in setup.lights], np.float64).reshape(-1, 3)
    return Lamps(setup.targets, found, narrowest(found), facing * found.faces[:, None])


def _trust(width: NDArray[np.float32], least: float) -> NDArray[np.float32]:
    """Return how much a level counts if the penumbra is so many r wide and must be at least `least`."""
    with np.errstate(divide="ignore"):
        octaves = np.log2(width / least)
    return np.clip(octaves / BLEND, 0, 1).astype(np.float32)


def _each(mask: NDArray[np.uint64], lights: int) -> NDArray[np.int64]:
    """Return how many rows of mask (n,W) have the bit of each light: (L,)."""
    bits = np.unpackbits(np.ascontiguousarray(mask).view(np.uint8), axis=1, count=lights, bitorder="little")
    return bits.sum(0, dtype=np.int64)
