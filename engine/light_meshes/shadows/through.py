"""Sharp shadows where surfaces let light through: Π t of the surfaces that a ray crosses, and refracted paths (eqs. 5
and 6).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..glass.refraction import RefractedPaths
from ..rays.tracer import Targets
from ..support.bits import has, mask_of
from ..support.native import kernel
from . import pairs
from .casters import Group, union
from .method import Check, Receivers, Setup, SharpMethod
from .terminator import starts

_add_paths = kernel("through_add_paths")


class LightPaths(NamedTuple):
    """The refracted paths (eq. 6) of one light to some receivers: row k has the paths start[k]:start[k+1]."""

    row: NDArray[np.int64]  # (k,) of the receivers
    light: int
    start: NDArray[np.int64]  # (k+1,)
    alpha: NDArray[np.float64]  # (c,3) α_j; in FOCUS multiplied by J
    ends: NDArray[np.float64]  # (c,3) P_j, the far end of the segment that reaches the receiver


class Straight:
    """V(i,P) as Π t of the surfaces crossed, and in FULL also the refracted paths: v(i,x) of eq. (6).

    Receivers may be points in free space, such as lattice nodes.
    """

    def __init__(self, setup: Setup, groups: tuple[Group, ...]) -> None:
        self._count, self._targets, self._tracer = len(setup.lights), setup.targets, setup.tracer
        self._stats, self._groups = setup.stats, groups
        self._channels, self._passing = setup.through.channels, setup.through.passing
        self._refraction = setup.through.refraction
        self._casting = union(groups, self._count)

    def whole(self, at: Receivers, check: Check) -> NDArray[np.float32]:
        """Return S (n,L,C): the straight segments and the refracted paths together."""
        S = self.straight(at, check)
        self._add_bent(at, S, check)
        return S

    def bent(self, at: Receivers, check: Check) -> NDArray[np.float32]:
        """Return what `whole` has more than the straight segments that nothing bends: (n,L,C)."""
        S = np.zeros((len(at.P), self._count, self._channels), np.float32)
        with self._stats.stage("refracted paths"):
            on = [i for i in range(self._count) if has(self._casting, i) and (s := self._solver(i)) and s.goes_on(i)]
            if on:  # where light goes straight on although something that bends is in the way
                some = at._replace(active=at.active & mask_of(on, self._count))
                direct = self._direct(some, check)
                S += self._gone_on(some, direct.copy(), check) - direct
            self._add_bent(at, S, check)
        return S

    def _add_bent(self, at: Receivers, S: NDArray[np.float32], check: Check) -> None:
        """Add the refracted paths."""
        focus = self._refraction is not None and self._refraction.footprint is not None
        normal = at.P if at.N is None else at.N if at.lift is None else at.lift.side
        for found in self.paths(at, check):
            _add_paths(found.row, found.start, found.alpha, found.ends, found.light, focus and at.N is not None, at.P,
                       normal, *self._targets, S)

    def straight(self, at: Receivers, check: Check) -> NDArray[np.float32]:
        """Return V (n,L,C): Π t of the straight segments; in FULL only where nothing bends them."""
        return self._gone_on(at, self._direct(at, check), check)

    def _direct(self, at: Receivers, check: Check) -> NDArray[np.float32]:
        """Return Π t (n,L,C) of the straight segments that meet nothing that bends; else 0."""
        S = pairs.seen(at.active & ~self._casting, self._count, self._channels)
        for group in self._groups:
            for row, light in pairs.blocks(at.active & group.lights, self._count):
                check()
                origin, normal, of = starts(at.lift, at.P, at.N, self._targets, row, light)
                on = at.triangle if at.triangle is None or of is row else at.triangle[row]
                S[row, light] = self.segments(origin, of, self._targets, light, normal, group.casters, on)
                self._stats.add(**{"shadow_rays" if at.N is not None else "long_rays": len(row)})
        return S

    def _gone_on(self, at: Receivers, S: NDArray[np.float32], check: Check) -> NDArray[np.float32]:
        """Return S (n,L,C) of `_direct`, filled in where light goes straight on although something that bends is in the
        way.
        """
        for i in range(self._count if self._refraction else 0):
            solver = self._solver(i)
            dark = np.flatnonzero(has(at.active.T, i) & ~S[:, i].any(1))
            if solver is not None and len(dark):
                check()
                origin, normal, of = self._starts(at, dark, i)
                straight = solver.straight_on(i, origin[of], None if normal is None else normal[of])
                if straight is not None:
                    S[dark, i] = straight[:, :self._channels]
        return S

    def _starts(self, at: Receivers, row: NDArray, light: int) -> tuple[NDArray, NDArray | None, NDArray]:
        """Return where rays of these rows to one light start; see `starts`."""
        return starts(at.lift, at.P, at.N, self._targets, row, np.full(len(row), light, np.int32))

    def _solver(self, light: int) -> RefractedPaths | None:
        """Return the solver for the refracted paths of a light; None if nothing bends them."""
        solvers = self._refraction.solvers if self._refraction else {}
        return next((solvers.get(g.casters) for g in self._groups if has(g.lights, light)), None)

    def paths(self, at: Receivers, check: Check) -> Iterator[LightPaths]:
        """Yield the refracted paths of eq. (6), light by light."""
        if self._refraction is None:
            return
        footprint = self._refraction.footprint
        for i in range(self._count):
            solver = self._solver(i)
            wanted = np.flatnonzero(has(at.active.T, i))
            if len(wanted) and solver is not None:
                check()
                origin, normal, of = self._starts(at, wanted, i)
                found, work = solver.paths(i, origin[of], None if normal is None else normal[of])
                alpha = found.alpha if footprint is None else found.alpha * found.clamped(footprint)[:, None]
                self._stats.add(refracted_paths=len(alpha), path_seeds=work.seeds, path_rays=work.rays,
                                path_seeds_not_converged=work.unconverged, paths_rejected=work.rejected)
                yield LightPaths(wanted, i, found.start, alpha, found.P)

    def segments(self, P: NDArray, row: NDArray, targets: Targets, target: NDArray, N: NDArray | None,
                 casters: int, triangle: NDArray[np.int32] | None = None,
                 light: NDArray[np.int32] | None = None) -> NDArray[np.float32]:
        """Return Π t (k,C) of straight segments from P[row], on triangle[row], to targets[target], points of lamps
        `light` (k,); None: `target` are the lamps.
        """
        return self._tracer.transmittance(P, row, targets, target, N, False, self._passing,
                                          unbent=self._refraction is not None, casters=casters, triangle=triangle,
                                          light=target if light is None else light)[:, :self._channels]


class SharpThrough(Straight, SharpMethod):
    """V_i(P) of receivers on surfaces."""

    def __call__(self, at: Receivers, check: Check, probe: NDArray | None = None) -> NDArray[np.float32]:
        """Return S, see `Method`."""
        with self._stats.stage("sharp shadows"):
            return self.whole(at, check)
