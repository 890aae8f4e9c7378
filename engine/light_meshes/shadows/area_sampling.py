"""Soft shadows by many rays to a light with a size. Light meshes are compared with this reference."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..lights.registry import KINDS
from ..rays.tracer import Targets
from ..support.native import kernel
from ..surface import sized
from ..surface.shading import light_arrays
from . import pairs
from .casters import union
from .method import Check, Kind, Method, Receivers, Setup
from .sharp import dim, sharp
from .terminator import starts

_sample, _sized_sample = kernel("area_sample"), kernel("sized_sample")


class AreaSampling(Method):
    """Computes S_i(P) as the mean of N rays to points on the light.

    For a light of softness SIZE it is Σ V_j·Ω_j ÷ Σ Ω_j, where Ω_j is the light that a matt surface gets from the j-th
    point. So S·Ω is the light of the whole lamp past its blockers, and the picture converges to it as N grows. For
    other lights only the visibility is sampled, and Ω is that of the point source, so that all methods agree away from
    shadows.
    """

    def __init__(self, setup: Setup) -> None:
        lights, casters, settings = setup.lights, setup.casters, setup.settings
        self._count, self._targets, self._stats = len(lights), setup.targets, setup.stats
        self._samples, self._seed = settings.light_samples, settings.seed
        self._sharp = sharp(setup, casters.whole)  # for lights without a size, and for the segment of each sample
        self._edges = sharp(setup, casters.sharp) if casters.sharp else None  # V(P) past sharp casters
        self._receives, self._channels = casters.receives, max(1, setup.through.channels)
        self._groups, self._soft = casters.soft, union(casters.soft, self._count)
        shapes = [KINDS[light.type].shape(light) for light in lights]
        self._rectangle = np.array([shape.rectangle for shape in shapes], np.bool_)
        self._disc = np.array([not shape.face for shape in shapes], np.bool_)
        self._size = np.array([shape.disc for shape in shapes], np.float64)
        self._u = np.array([shape.u for shape in shapes], np.float64).reshape(-1, 3)
        self._v = np.array([shape.v for shape in shapes], np.float64).reshape(-1, 3)
        self._sized = np.array([sized.kind(light) is not None for light in lights], np.bool_)
        arrays = light_arrays(lights)
        self._lamps = (arrays.type, arrays.position, arrays.direction, arrays.edge, arrays.slope, arrays.axes,
                       arrays.extent)

    def __call__(self, at: Receivers, check: Check, probe: NDArray | None = None) -> NDArray[np.float32]:
        """Return S, see `Method`."""
        soft = at.active & self._soft
        if at.triangle is not None and self._receives is not None:
            soft[~self._receives[at.triangle]] = 0
        hard = self._sharp(at._replace(active=at.active & ~soft), check)
        S = hard if self._edges is None else np.zeros_like(hard)
        with self._stats.stage("area sampling"):
            for group in self._groups:
                for row, light in pairs.blocks(soft & group.lights, self._count):
                    whole = self._sized[light]
                    for some, share in ((~whole, self._share), (whole, self._sized_share)):
                        if some.any():
                            S[row[some], light[some]] = share(at, row[some], light[some], group.casters, check)
        dim(S, self._edges, at._replace(active=soft), check)
        return S if S is hard else S + hard  # one is 0, because a light is either soft or sharp for a receiver

    def _share(self, at: Receivers, row: NDArray, light: NDArray, casters: int, check: Check) -> NDArray[np.float32]:
        """Return how much (k,C) of light[k] the receiver row[k] sees past `casters`."""
        clear = np.zeros((len(row), self._channels))
        target = np.empty((len(row), 3))
        directional = self._targets.directional[light]
        order = np.arange(len(row), dtype=np.int32)
        origin, normal, of = starts(at.lift, at.P, at.N, self._targets, row, light)
        for s in range(self._samples):
            check()
            _sample(s, self._samples, self._seed, at.P, row, *self._targets, light, self._disc, self._rectangle,
                    self._size, self._u, self._v, target)
            clear += self._sharp.segments(origin, of, Targets(target, directional), order, normal, casters,
                                           light=light)
        self._stats.add(shadow_rays=len(row) * self._samples)
        return (clear / self._samples).astype(np.float32)

    def _sized_share(self, at: Receivers, row: NDArray, light: NDArray, casters: int,
                     check: Check) -> NDArray[np.float32]:
        """Return the share (k,C) of the light of light[k], a lamp with a size, that passes `casters`.

        Ω_j is taken with the geometric normal, except on smooth surfaces of which rays start above their facets.
        """
        clear, everything = np.zeros((len(row), self._channels)), np.zeros((len(row), 1))
        target, weight = np.empty((len(row), 3)), np.empty(len(row))
        directional = self._targets.directional[light]
        order = np.arange(len(row), dtype=np.int32)
        facing = at.normals() if at.lift is None else at.lift.side
        for s in range(self._samples):
            check()
            _sized_sample(s, self._samples, self._seed, at.P, facing, row, *self._lamps, light, target, weight)
            to = Targets(target, directional)
            origin, normal, of = starts(at.lift, at.P, at.N, to, row, order)
            visible = self._sharp.segments(origin, of, to, order, normal, casters, light=light)
            clear += visible * weight[:, None]
            everything += weight[:, None]
        self._stats.add(shadow_rays=len(row) * self._samples)
        return (clear / np.maximum(everything, 1e-300)).astype(np.float32)


KIND = Kind(AreaSampling, soft=True)
