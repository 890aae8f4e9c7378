"""Soft shadows of lamps with a size (softness SIZE): shares at nodes where penumbrae are wide, rays where they are not.

For a receiver and a lamp: where all candidates of the finest lattice see the whole lamp, or nothing of it, that is S.
Else the mean of slid shares (`meshes.shares`) is taken from the coarsest lattice whose r is less than the penumbra is
wide, neighbouring lattices blended; and where the penumbra is narrower than the finest r, or something is within r, S
is the share of points of the lamp that rays from the receiver reach.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import Targets, Tracer
from ..rays.tracer import points as places
from ..support.native import kernel
from ..support.statistics import Statistics
from .casters import Casters, union
from .lamp_points import narrowest, points, shapes, turns_of_points
from .meshes.certificate import certificate
from .meshes.lattice import Lattice
from .meshes.shares import Groups, Lamps, Shares
from .terminator import Lift, split, starts
from .visibility import Check, blocks, dim, set_pairs

if TYPE_CHECKING:
    from ..picture.prepared import Prepared

LEVELS = 4
WIDE = 0.7  # a level counts where the penumbra is wider than so many r,
BLEND = 0.5  # and alone from so many octaves above that on
RAYS = 24  # from a receiver to a lamp, at most:
FIRST_RAYS = 16  # where these agree no more are traced
BATCH = 1 << 15  # receivers at once


class Nodes(NamedTuple):
    """How many nodes there are, and their memory in bytes."""

    count: int
    bytes: int


class SizedLamps:
    """S of lamps with a size; the interface of `visibility`."""

    def __init__(self, lamps: Lamps, tracer: Tracer, stats: Statistics, casters: Casters, levels: list[Shares],
                 sharp: Any, edges: Any, rays: int = 0, first_rays: int = 0) -> None:
        """levels: from the finest on, each of twice the step. sharp: V(P), and of the segments to points of lamps;
        edges: V(P) past the sharp casters, None: there are none. rays: from a receiver to a lamp, at most; first_rays:
        of those that are traced before it is asked whether they agree."""
        self.count, self._lamps, self._tracer, self._stats = len(lamps.narrow), lamps, tracer, stats
        self._groups, self.soft = casters.soft, union(casters.soft, self.count)
        self._receives = casters.receives
        self._levels, self._sharp, self._edges = levels, sharp, edges
        self._rays, self._first_rays = rays or int(RAYS), first_rays or int(FIRST_RAYS)

    @property
    def lattice(self) -> Lattice:
        """The finest lattice."""
        return self._levels[0].lattice

    @property
    def store(self) -> Nodes:
        """What the nodes of all lattices hold."""
        return Nodes(sum(level.nodes for level in self._levels), sum(level.bytes for level in self._levels))

    def __call__(self, P: NDArray, N: NDArray, active: NDArray[np.uint64], check: Check,
                 triangle: NDArray[np.int32] | None = None, lift: Lift | None = None) -> NDArray[np.float32]:
        """S, see `visibility`."""
        S = np.zeros((len(P), self.count), np.float32)
        soft = active & self.soft
        if triangle is not None and self._receives is not None:
            soft[~self._receives[triangle]] = 0
        left, asked = active & ~soft, soft.copy()
        lifted = np.zeros_like(soft)
        if lift is not None:
            split(*lift, P, N, *self._lamps.targets, asked, lifted)
        asked &= ~lifted
        by_rays = soft & ~asked
        rows = np.flatnonzero(asked.any(1))
        for i in range(0, len(rows), BATCH):
            check()
            row = rows[i:i + BATCH]
            by_rays[row] |= self._ask(P[row], N[row], None if triangle is None else triangle[row], asked[row], row, S,
                                      check)
        self._trace(P, N, by_rays, None, S, lift, check)
        dim(S, soft, self._edges, P, N, check, lift)
        if left.any():
            S += self._sharp(P, N, left, check, triangle, lift)
        return S

    def _ask(self, P: NDArray, N: NDArray, triangle: NDArray[np.int32] | None, soft: NDArray[np.uint64],
             rows: NDArray[np.intp], S: NDArray[np.float32], check: Check) -> NDArray[np.uint64]:
        """Fill S[rows] from nodes; returns the lights (n,W) that rays must answer for."""
        level = self._levels[0]
        with self._stats.stage("candidates"):
            g = level.groups(P, N, triangle, soft)
            grazing = level.grazing(g, N)
            g.lit[:] &= ~grazing
            by_rays = grazing[g.group] & soft
            soft = soft & ~by_rays
        with self._stats.stage("nodes"):
            seen, mixed = level.sorted(g, check)
        certified = self._certified(level, N, triangle, g)
        unsure = mixed & np.where(certified, np.uint64(0), ~np.uint64(0))[:, None]
        by_rays |= unsure[g.group] & soft
        agreed = soft & ~mixed[g.group]
        with self._stats.stage("short rays"):
            # Where something is near, the nearest candidate must be seen, or all may be behind it.
            doubtful = np.flatnonzero(~certified[g.group] & agreed.any(1)).astype(np.int32)
            witness = g.candidate[g.start[g.group[doubtful], 0]]
            hidden = doubtful[self._tracer.occluded(P, doubtful, places(g.position), witness, N, closed=True)]
            by_rays[hidden] |= agreed[hidden]
            agreed[hidden] = 0
            self._stats.add(short_rays=len(doubtful))
        with self._stats.stage("average"):
            part = np.zeros((len(P), self.count), np.float32)
            set_pairs(agreed & seen[g.group], self.count, 1.0, part)
            S[rows] += part
        mixed[~certified] = 0
        todo = mixed[g.group] & soft
        self._stats.add(receivers=len(P), pairs=_bits(soft), mixed_pairs=_bits(todo | by_rays))
        if todo.any():
            with self._stats.stage("nodes"):
                shares = level.shares(g, mixed, check)
            for row, light in blocks(todo, self.count):
                self._means(P, N, triangle, row, light, g, shares, rows, S, check)
        return by_rays

    def _means(self, P: NDArray, N: NDArray, triangle: NDArray[np.int32] | None, row: NDArray[np.int32],
               light: NDArray[np.int32], g: Groups, shares: NDArray[np.uint8], rows: NDArray[np.intp],
               S: NDArray[np.float32], check: Check) -> None:
        """S[rows[row], light] of pairs from all levels, and rays."""
        with self._stats.stage("average"):
            value, width = self._levels[0].mean(P, N, row, light, g, shares)
        trust = _trust(width)
        near = np.flatnonzero(trust < 1)
        if len(near):
            by_rays = self._shares_by_rays(P, N, row[near], light[near], None, check)
            value[near] = trust[near] * value[near] + (1 - trust[near]) * by_rays
            self._stats.add(ray_pairs=len(near))
        rest = np.flatnonzero(width >= 2 * WIDE)
        for level in self._levels[1:]:
            if not len(rest):
                break
            found, width = self._coarser(level, P, N, triangle, row[rest], light[rest], check)
            trust = _trust(width)
            value[rest] = (1 - trust) * value[rest] + trust * found
            rest = rest[width >= 2 * WIDE]
        S[rows[row], light] = value

    def _coarser(self, level: Shares, P: NDArray, N: NDArray, triangle: NDArray[np.int32] | None,
                 row: NDArray[np.int32], light: NDArray[np.int32],
                 check: Check) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """What a coarser level says of pairs: S and width, 0 where it must not be asked."""
        some, of = np.unique(row, return_inverse=True)
        soft = np.zeros((len(some), (self.count + 63) // 64), np.uint64)
        np.bitwise_or.at(soft, (of, light >> 6), np.uint64(1) << (light & 63).astype(np.uint64))
        near = None if triangle is None else triangle[some]
        P, N, of = P[some], N[some], of.astype(np.int32)
        with self._stats.stage("candidates"):
            g = level.groups(P, N, near, soft)
        certified = self._certified(level, N, near, g)
        g.lit[~certified] = 0
        with self._stats.stage("nodes"):
            shares = level.shares(g, g.lit, check)
        with self._stats.stage("average"):
            found, width = level.mean(P, N, of, light, g, shares)
        width[~certified[g.group[of]]] = 0
        return found, width

    def _certified(self, level: Shares, N: NDArray, triangle: NDArray[np.int32] | None, g: Groups) -> NDArray[np.bool_]:
        """Groups (g,) near which nothing but their own plane or convex body is."""
        if level.certificate is None or triangle is None:
            return np.zeros(len(g.first), np.bool_)
        with self._stats.stage("certificate"):
            return level.certificate.holds(g.place, N[g.first], triangle[g.first])

    def _trace(self, P: NDArray, N: NDArray, lights: NDArray[np.uint64], _: Any, S: NDArray[np.float32],
               lift: Lift | None, check: Check) -> None:
        """S of the lights (n,W), by rays."""
        for row, light in blocks(lights, self.count):
            S[row, light] = self._shares_by_rays(P, N, row, light, lift, check)
            self._stats.add(ray_pairs=len(row))

    def _shares_by_rays(self, P: NDArray, N: NDArray, row: NDArray[np.int32], light: NDArray[np.int32],
                        lift: Lift | None, check: Check) -> NDArray[np.float32]:
        """The share of `rays` points on light[k] that P[row[k]] sees; of first_rays where these agree."""
        with self._stats.stage("rays near contact"):
            clear = self._count(P, N, row, light, lift, 0, self._first_rays, check)
            share = clear / self._first_rays
            if self._rays > self._first_rays:
                more = np.flatnonzero((clear > 0) & (clear < self._first_rays))
                clear[more] += self._count(P, N, row[more], light[more], lift, self._first_rays,
                                           self._rays - self._first_rays, check)
                share[more] = clear[more] / self._rays
        return share.astype(np.float32)

    def _count(self, P: NDArray, N: NDArray, row: NDArray[np.int32], light: NDArray[np.int32], lift: Lift | None,
               first: int, count: int, check: Check) -> NDArray[np.float64]:
        """How many of the points first..first+count of light[k] P[row[k]] sees."""
        clear = np.zeros(len(row))
        if not len(row):
            return clear
        turn = turns_of_points(P)
        shapes, targets = self._lamps.shapes, self._lamps.targets
        origin, normal, of = starts(lift, P, N, targets, row, light)
        directional = targets.directional[light]
        for group in self._groups:
            mine = np.flatnonzero(_in(group.lights, light))
            if not len(mine):
                continue
            order = np.arange(len(mine), dtype=np.int32)
            for j in range(first, first + count):
                check()
                to = points(shapes, targets, P, turn, row[mine], light[mine], j, 1)
                clear[mine] += self._sharp.segments(origin, of[mine], Targets(to.position, directional[mine]), order,
                                                    normal, group.casters)
        self._stats.add(shadow_rays=len(row) * count)
        return clear


def _trust(width: NDArray[np.float32]) -> NDArray[np.float32]:
    """How far a level counts where the penumbra is so many r wide."""
    with np.errstate(divide="ignore"):
        octaves = np.log2(width / WIDE)
    return np.clip(octaves / BLEND, 0, 1).astype(np.float32)


def _in(words: NDArray[np.uint64], light: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Whether each light is in a set (W,)."""
    found: NDArray[np.bool_] = (words[light >> 6] >> (light & 63).astype(np.uint64) & np.uint64(1)) != 0
    return found


def _bits(mask: NDArray[np.uint64]) -> int:
    return int(np.bitwise_count(mask).sum()) if hasattr(np, "bitwise_count") else int(
        np.unpackbits(mask.view(np.uint8)).sum())


def sized_lamps(ready: Prepared, casters: Casters, sharp: Any, edges: Any, levels: int = LEVELS, **how: Any) -> SizedLamps:
    """The shadows of the lamps in `casters.soft`, for a scene made ready so far."""
    s, lights = ready.scene.settings, ready.scene.lights
    facing = np.array([light.direction if light.type == "AREA" else (0, 0, 0) for light in lights], np.float64)
    lamps = Lamps(ready.lights.targets(), shapes(lights), np.array([narrowest(light) for light in lights]), facing)
    found = []
    casts = np.array([o.visible_shadow for o in ready.scene.objects], np.bool_)
    meets = casts[ready.owner(np.arange(len(ready.surfaces.triangles)))]
    for k in range(levels):
        level = Shares(lamps, ready.tracer, ready.surfaces, ready.stats, casters.soft, s.h * 2**k, s.kI,
                       s.lattice_rotation, s.lattice_origin)
        with ready.stats.stage("certificate"):
            level.certificate = certificate(ready.surfaces, meets, level.reach)
        found.append(level)
    return SizedLamps(lamps, ready.tracer, ready.stats, casters, found, sharp, edges, **how)
