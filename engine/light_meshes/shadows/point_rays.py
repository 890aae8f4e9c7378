"""Rays from receivers to points of lamps with a size, and what arrives by them.

Past opaque surfaces a kernel makes, traces and adds up the rays on the way (`lamp_rays.c`). Where surfaces let light
through, it first finds the pairs of a receiver and a lamp none of whose rays meets such a surface. For the other pairs,
and without Embree's own interface, the same is done array by array, with the same result.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel
from . import blocks
from .casters import Group
from .lamp_points import Patterns, points, turns_of_points
from .lamp_points import rays as traced
from .lifts import Lift
from .method import Check, Receivers, Setup, SharpMethod
from .shares import Lamps
from .sharp import Sharp
from .terminator import starts

RAYS_AT_ONCE = 1 << 14
RAYS_OF_A_CALL = 1 << 18  # of the kernel, which holds no arrays of them

_sums = kernel("lamp_sums")


class Aim(NamedTuple):
    """Receivers that send rays to points of lamps."""

    at: Receivers
    facing: NDArray[np.float64]  # (n,3) the normals above which points give light
    patterns: Patterns  # of points


def aimed(at: Receivers, samples: int) -> Aim:
    """Return receivers with the patterns of points that they send rays to. samples: those of a pixel."""
    sample, common = at.sample, at.block is not None and samples == blocks.COMMON
    if sample is not None and at.block is not None and common:
        inside, number = blocks.quads(at.block)
        sample = np.stack([number, 4 * inside + sample[:, 1]], axis=1)
    share = None if sample is None else np.ascontiguousarray(sample[:, 1])
    facing = at.normals() if at.lift is None else at.lift.side
    return Aim(at, facing, Patterns(turns_of_points(at.P, sample), share, samples, common))


class PointRays:
    """Rays to points of the lamps of a scene."""

    def __init__(self, setup: Setup, lamps: Lamps, sharp: SharpMethod) -> None:
        """setup: its soft casters are those of lamps with a size. sharp: what single rays find."""
        self._groups, self._tracer, self._stats = setup.casters.soft, setup.tracer, setup.stats
        self._lamps, self._sharp, self._plain = lamps, sharp, isinstance(sharp, Sharp)
        self._stops, self._sheets = ("opaque", "glass") if setup.through.refraction is None else ("stops", "sheets")

    def add(self, aim: Aim, lift: Lift | None, row: NDArray[np.int32], light: NDArray[np.int32],
            some: NDArray[np.int32], first: int, count: int, clear: NDArray[np.float64], whole: NDArray[np.float64],
            check: Check) -> None:
        """Add what points first..first+count of light[k] give P[row[k]], for `some` pairs k: to clear (k,C) what gets
        through, and to whole (k,) what would if nothing stood between.

        Ω is that of the lamp above the horizon, so the points below do not count. lift: of receivers that rays are
        lifted from; None: they are not.
        """
        at, facing, patterns = aim
        targets, shapes = self._lamps.targets, self._lamps.shapes
        for group in self._groups:
            mine = some if len(self._groups) == 1 else some[among(group.lights, light[some])]
            if not self._plain:
                mine = mine[~self._past_glass(aim, lift, group, row, light, mine, first, count, clear, whole, check)]
            field = self._tracer.field("opaque", group.casters) if self._plain else None
            step = (RAYS_AT_ONCE if field is None else RAYS_OF_A_CALL) // count
            for i in range(0, len(mine), step):
                check()
                part = mine[i:i + step]
                if field is not None:
                    rays = self._traced(field, aim, lift, row, light, part, first, count, clear, whole)
                    self._stats.add(shadow_rays=rays)
                    continue
                rows, lights = row[part], light[part]
                to = points(shapes, targets, at.P, patterns, rows, lights, first, count)
                order = np.arange(len(to.position), dtype=np.int32)
                origin, normal, of = starts(lift, at.P, at.N, to, rows if count == 1 else np.repeat(rows, count), order)
                lamp = lights if count == 1 else np.repeat(lights, count)
                visible = self._sharp.segments(origin, of, to, order, normal, group.casters, light=lamp)
                _sums(count, at.P, facing, rows, lights, targets.directional, shapes.shape, self._lamps.facing,
                      to.position, visible.astype(np.float32), part, clear, whole)
                self._stats.add(shadow_rays=len(order))

    def _traced(self, field: tuple, aim: Aim, lift: Lift | None, row: NDArray[np.int32], light: NDArray[np.int32],
                part: NDArray[np.int32], first: int, count: int, clear: NDArray[np.float64],
                whole: NDArray[np.float64]) -> int:
        """Do what `add` does by a kernel, past the opaque surfaces of `field`; return the number of rays."""
        at, lamps = aim.at, self._lamps
        return traced(field, lamps.shapes, lamps.targets, lamps.facing, at.P, at.normals(), aim.facing, aim.patterns,
                      row, light, part, first, count, clear, whole, lift)

    def _past_glass(self, aim: Aim, lift: Lift | None, group: Group, row: NDArray[np.int32],
                    light: NDArray[np.int32], some: NDArray[np.int32], first: int, count: int,
                    clear: NDArray[np.float64], whole: NDArray[np.float64], check: Check) -> NDArray[np.bool_]:
        """Do what `add` does for those of `some` (s,) none of whose rays meets a surface that lets light through, and
        return which these are. This is faster, with the same result.
        """
        stops = self._tracer.field(self._stops, group.casters)
        sheets = self._tracer.field(self._sheets, group.casters)
        done = np.zeros(len(some), np.bool_)
        if stops is None or sheets is None:
            return done
        step = RAYS_OF_A_CALL // count
        for i in range(0, len(some), step):
            check()
            part = some[i:i + step]
            alone = (clear[part] == clear[part, :1]).all(1)
            if self._tracer.has(self._sheets, group.casters):
                free, total = whole[part, None], whole[part]
                self._traced(sheets, aim, lift, row[part], light[part], np.arange(len(part), dtype=np.int32), first,
                             count, free, total)
                alone &= free[:, 0] == total
            part, done[i:i + step] = part[alone], alone
            found, total = np.ascontiguousarray(clear[part, :1]), whole[part]
            rays = self._traced(stops, aim, lift, row[part], light[part], np.arange(len(part), dtype=np.int32), first,
                                count, found, total)
            clear[part], whole[part] = found, total
            self._stats.add(shadow_rays=rays)
        return done


def among(words: NDArray[np.uint64], light: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return whether each light (k,) is in a set (W,)."""
    found: NDArray[np.bool_] = (words[light >> 6] >> (light & 63).astype(np.uint64) & np.uint64(1)) != 0
    return found
