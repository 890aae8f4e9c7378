"""Sharp shadows (eqs. 1 to 3): one ray from the receiver to each light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import Targets
from . import pairs
from .casters import Group, union
from .method import Check, Kind, Receivers, Setup, SharpMethod
from .terminator import starts
from .through import SharpThrough


class Sharp(SharpMethod):
    """V_i(P) by one ray to each light, past the casters of its group; 1 for lights in no group."""

    def __init__(self, setup: Setup, groups: tuple[Group, ...]) -> None:
        self._count, self._targets, self._tracer = len(setup.lights), setup.targets, setup.tracer
        self._stats, self._groups = setup.stats, groups
        self._casting = union(groups, self._count)

    def __call__(self, at: Receivers, check: Check, probe: NDArray | None = None) -> NDArray[np.float32]:
        """Return S, see `Method`."""
        S = pairs.seen(at.active & ~self._casting, self._count)
        with self._stats.stage("sharp shadows"):
            for group in self._groups:
                for row, light in pairs.blocks(at.active & group.lights, self._count):
                    check()
                    origin, normal, of = starts(at.lift, at.P, at.N, self._targets, row, light)
                    S[row, light] = self.segments(origin, of, self._targets, light, normal, group.casters)
                    self._stats.add(shadow_rays=len(row))
        return S

    def segments(self, P: NDArray, row: NDArray, targets: Targets, target: NDArray, N: NDArray | None, casters: int,
                 triangle: NDArray[np.int32] | None = None, light: NDArray[np.int32] | None = None) -> NDArray:
        """Return 1 for each clear segment (k,1) from P[row] to targets[target], otherwise 0."""
        blocked = self._tracer.occluded(P, row, targets, target, N, closed=False, kind="opaque", casters=casters)
        return ~blocked[:, None]


def sharp(setup: Setup, groups: tuple[Group, ...]) -> SharpMethod:
    """Return sharp shadows for the casters of these groups, including surfaces that let light through."""
    return SharpThrough(setup, groups) if setup.through.channels else Sharp(setup, groups)


def dim(S: NDArray[np.float32], edges: SharpMethod | None, at: Receivers, check: Check) -> None:
    """Multiply S of soft lights (in at.active; S of others is 0) by V(P) past the sharp casters, `edges`; None: there
    are none.
    """
    if edges is not None:
        S *= edges(at._replace(active=pairs.bright(S, at.active), triangle=None), check)


KIND = Kind(lambda setup: sharp(setup, setup.casters.whole), bends=True)
