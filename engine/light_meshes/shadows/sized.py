"""Soft shadows of lamps with a size (softness SIZE): shares at nodes where penumbrae are wide, rays where they are not.

For a receiver and a lamp: where all candidates of the finest lattice see the whole lamp, or nothing of it, that is S.
Else a plane fitted to slid shares (`shares`) is taken from the coarsest lattice whose r the penumbra is wider
than, neighbouring lattices blended. Where the penumbra is narrower than the finest r, or something is within r, S is
the share of points of the lamp that rays from the receiver reach.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import Targets
from ..rays.tracer import points as places
from . import pairs
from .casters import union
from .lamp_points import FREE, narrowest, points, reaches, shapes, turns_of_points
from .meshes.certificate import certificate
from .method import Check, Method, Receivers, Setup
from .shares import Groups, Lamps, Shares
from .sharp import dim, sharp
from .terminator import starts, touched

LEVELS = 4  # lattices, each of twice the step of the one before
WIDE = 0.7  # the finest level counts where the penumbra is wider than so many r,
WIDER = 1.6  # and coarser ones, for which a finer one may stand in, where it is wider than so many of theirs,
BLEND = 0.5  # and alone from so many octaves above that on
# Rays come in sets of 16, whose points spread evenly; parts of such a set are far worse for edges along the lamp's.
RAYS = 16  # from a receiver to a lamp where the penumbra is narrow,
MORE_RAYS = 32  # and where no node may answer and they disagree
BATCH = 1 << 15  # receivers at once


class Batch(NamedTuple):
    """Receivers whose lights nodes may answer for, and where their answers go."""

    at: Receivers
    rows: NDArray[np.intp]  # (n,) of S
    S: NDArray[np.float32]  # (…,L,C)
    check: Check

    def of(self, rows: NDArray[np.integer], active: NDArray[np.uint64]) -> Receivers:
        """Some of the receivers, asked for other lights."""
        on = self.at.triangle
        return Receivers(self.at.P[rows], self.at.normals()[rows], active, None if on is None else on[rows])


class SizedLamps(Method):
    """S of lamps with a size."""

    def __init__(self, setup: Setup, others: Method, levels: int = LEVELS) -> None:
        """setup: its casters are those of lamps with a size only. others: of all other lights, and of such lamps on
        surfaces that take no soft shadows."""
        assert setup.lattice is not None
        casters = setup.casters
        self.nodes, self._others = others.nodes, others
        self._count, self._channels = len(setup.lights), max(1, setup.through.channels)
        self._tracer, self._stats = setup.tracer, setup.stats
        self._groups, self._soft = casters.soft, union(casters.soft, self._count)
        self._receives = casters.receives
        self._sharp = sharp(setup, casters.whole)
        self._edges = sharp(setup, casters.sharp) if casters.sharp else None
        self._lamps = lamps(setup)
        self._reaches = reaches(self._lamps.shapes)
        # Where light comes through surfaces, points of a lamp are seen in part, which a count of points cannot say.
        self.levels = [] if setup.through.channels else [self._level(setup, 2.0**k) for k in range(levels)]

    def _level(self, setup: Setup, coarser: float) -> Shares:
        assert setup.lattice is not None
        level = Shares(self._lamps, setup, setup.settings.h * coarser)
        if setup.lattice.casts is not None:
            with self._stats.stage("certificate"):
                level.certificate = certificate(setup.lattice.surfaces, setup.lattice.casts, level.reach)
        return level

    def __call__(self, at: Receivers, check: Check, probe: NDArray | None = None) -> NDArray[np.float32]:
        """S, see `Method`."""
        S = np.zeros((len(at.P), self._count, self._channels), np.float32)
        soft = at.active & self._soft
        if at.triangle is not None and self._receives is not None:
            soft[~self._receives[at.triangle]] = 0
        asked, lifted = soft.copy(), np.zeros_like(soft)
        if at.lift is not None:
            touched(*at.lift, at.P, at.N, *self._lamps.targets, self._reaches, asked, lifted)
        asked &= ~lifted
        if not self.levels:
            asked[:] = 0
        by_rays = soft & ~asked
        lit = np.flatnonzero(asked.any(1))
        for i in range(0, len(lit), BATCH):
            check()
            rows = lit[i:i + BATCH]
            on = None if at.triangle is None else at.triangle[rows]
            some = Receivers(at.P[rows], at.normals()[rows], asked[rows], on)
            by_rays[rows] |= self._ask(Batch(some, rows, S, check))
        self._stats.add(lamp_pairs=_count(soft))
        for row, light in pairs.blocks(by_rays, self._count):
            S[row, light] = self._by_rays(at, row, light, np.ones(len(row), np.bool_), check)
        dim(S, self._edges, at._replace(active=soft), check)
        if probe is not None:
            probe[:] = 0
        left = at.active & ~soft
        if left.any():
            S += self._others(at._replace(active=left), check, probe)  # S is 0 there so far
        return S

    def _ask(self, batch: Batch) -> NDArray[np.uint64]:
        """Fill S from nodes; returns the lights (n,W) that rays must answer for."""
        at, level, stats = batch.at, self.levels[0], self._stats
        with stats.stage("candidates"):
            g = level.groups(at)
            grazing = level.grazing(g, at.normals())
            g.lit[:] &= ~grazing
            by_rays = grazing[g.group] & at.active
            soft = at.active & ~by_rays
        with stats.stage("nodes"):
            seen, mixed = level.sorted(g, batch.check)
        certified = self._certified(level, at, g)
        unsure = mixed & np.where(certified, np.uint64(0), ~np.uint64(0))[:, None]
        by_rays |= unsure[g.group] & soft
        agreed = soft & ~mixed[g.group]
        hidden = self._hidden(at, g, np.flatnonzero(~certified[g.group] & agreed.any(1)).astype(np.int32))
        by_rays[hidden] |= agreed[hidden]
        agreed[hidden] = 0
        with stats.stage("average"):
            batch.S[batch.rows] += pairs.seen(agreed & seen[g.group], self._count)
        mixed &= ~unsure
        todo = mixed[g.group] & soft
        stats.add(receivers=len(at.P), mixed_pairs=_count(todo | by_rays))
        if todo.any():
            with stats.stage("nodes"):
                shares = level.shares(g, mixed, batch.check)
            for row, light in pairs.blocks(todo, self._count):
                with stats.stage("average"):
                    value, width = level.mean(at, row, light, g, shares)
                self._refine(batch, row, light, value, width)
                batch.S[batch.rows[row], light, 0] = value
        return by_rays

    def _hidden(self, at: Receivers, g: Groups, rows: NDArray[np.int32]) -> NDArray[np.int32]:
        """Those of these receivers whose nearest candidate is not seen: all of them may be behind something."""
        with self._stats.stage("short rays"):
            nearest = g.candidate[g.start[g.group[rows], 0]]
            self._stats.add(short_rays=len(rows))
            return rows[self._tracer.occluded(at.P, rows, places(g.position), nearest, at.N, closed=True)]

    def _refine(self, batch: Batch, row: NDArray[np.int32], light: NDArray[np.int32], value: NDArray[np.float32],
                width: NDArray[np.float32]) -> None:
        """Make the finest level's `value` (k,) of pairs, whose penumbrae are `width` r wide, that of rays where it is
        too coarse for them, and of coarser levels where these do."""
        trust = _trust(width, WIDE)
        near = np.flatnonzero(trust < 1)
        if len(near):
            rays = self._by_rays(batch.at, row[near], light[near], width[near] == 0, batch.check)[:, 0]
            value[near] = trust[near] * value[near] + (1 - trust[near]) * rays
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
        """What a coarser level says of pairs (k,): S, and the penumbra's width in its r; 0 where it has no say."""
        some, of = np.unique(row, return_inverse=True)
        soft = np.zeros((len(some), batch.at.active.shape[1]), np.uint64)
        np.bitwise_or.at(soft, (of, light >> 6), np.uint64(1) << (light & 63).astype(np.uint64))
        at = batch.of(some, soft)
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
        if level.certificate is None or at.triangle is None:
            return np.zeros(len(g.first), np.bool_)
        with self._stats.stage("certificate"):
            return level.certificate.holds(g.place, at.normals()[g.first], at.triangle[g.first])

    def _by_rays(self, at: Receivers, row: NDArray[np.int32], light: NDArray[np.int32], alone: NDArray[np.bool_],
                 check: Check) -> NDArray[np.float32]:
        """The share (k,C) of points on light[k] that P[row[k]] sees. alone (k,): no nodes have a say there."""
        self._stats.add(ray_pairs=len(row))
        with self._stats.stage("rays near contact"):
            clear, whole = self._clear(at, row, light, 0, RAYS, check)
            more = np.flatnonzero(alone & ((clear > 0) & (clear < whole)).any(1))
            found, further = self._clear(at, row[more], light[more], RAYS, MORE_RAYS - RAYS, check)
            clear[more] += found
            whole[more] += further
        return (clear / np.maximum(whole, 1e-300)).astype(np.float32)

    def _clear(self, at: Receivers, row: NDArray[np.int32], light: NDArray[np.int32], first: int, count: int,
               check: Check) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what points first..first+count of light[k] give P[row[k]], added up: what gets through (k,C), and what
        would if nothing stood between (k,1). Ω is that of the lamp above the horizon, so the points below do not count.
        """
        clear, whole = np.zeros((len(row), self._channels)), np.zeros((len(row), 1))
        facing = at.normals() if at.lift is None else at.lift.side
        turn = turns_of_points(at.P)
        targets = self._lamps.targets
        for group in self._groups:
            mine = np.flatnonzero(_in(group.lights, light))
            order = np.arange(len(mine), dtype=np.int32)
            for j in range(first, first + count if len(mine) else first):
                check()
                to = points(self._lamps.shapes, targets, at.P, turn, row[mine], light[mine], j, 1)
                weight = self._weight(at.P[row[mine]], facing[row[mine]], to, light[mine])
                origin, normal, of = starts(at.lift, at.P, at.N, to, row[mine], order)
                clear[mine] += weight * self._sharp.segments(origin, of, to, order, normal, group.casters)
                whole[mine] += weight
        self._stats.add(shadow_rays=len(row) * count)
        return clear, whole

    def _weight(self, P: NDArray[np.float64], N: NDArray[np.float64], to: Targets,
                light: NDArray[np.int32]) -> NDArray[np.float64]:
        """Return how much (k,1) matt surfaces at P get from these points of lamps, up to a constant of the pair."""
        way = to.position - np.where(to.directional[:, None], 0.0, P)
        square = np.einsum("ij,ij->i", way, way)
        cosine = np.einsum("ij,ij->i", way, N) / np.sqrt(square)
        side = np.abs(np.einsum("ij,ij->i", way, self._lamps.facing[light]))  # of a face; 0 of what turns to P
        weight = np.maximum(cosine, 0) * np.where(self._lamps.shapes.shape[light] == FREE, 1.0, side / square**1.5)
        return weight[:, None]


def lamps(setup: Setup) -> Lamps:
    """What nodes and receivers must know of the lights."""
    found = shapes(setup.lights)
    facing = np.array([light.direction for light in setup.lights], np.float64).reshape(-1, 3)
    return Lamps(setup.targets, found, narrowest(found), facing * (found.shape != 0)[:, None])


def _trust(width: NDArray[np.float32], least: float) -> NDArray[np.float32]:
    """How far a level counts where the penumbra is so many r wide, and must be `least`."""
    with np.errstate(divide="ignore"):
        octaves = np.log2(width / least)
    return np.clip(octaves / BLEND, 0, 1).astype(np.float32)


def _in(words: NDArray[np.uint64], light: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Whether each light is in a set (W,)."""
    found: NDArray[np.bool_] = (words[light >> 6] >> (light & 63).astype(np.uint64) & np.uint64(1)) != 0
    return found


def _count(mask: NDArray[np.uint64]) -> int:
    """How many bits are set."""
    return int(np.unpackbits(mask.view(np.uint8)).sum())
