"""Soft shadows by many rays to a light that has a size: the reference that light meshes are compared with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import Targets, Tracer
from ..scene.description import Light
from ..support.native import kernel
from ..support.statistics import Statistics
from ..surface import sized
from ..surface.shading import light_arrays
from .casters import Casters, union
from .meshes.semitransparent import SharpThrough
from .terminator import Lift, starts
from .visibility import Check, Sharp, blocks, dim

_sample, _sized_sample = kernel("area_sample"), kernel("sized_sample")


class AreaSampling:
    """S_i(P) as the mean of N rays to points of the light; the interface of `visibility`.

    Of a light that is `sized` it is Σ V_j·Ω_j ÷ Σ Ω_j, Ω_j being what a matt surface gets from the j-th point: S·Ω is
    then what the whole lamp gives past its blockers, and the picture converges to it as N grows. Of other lights only
    visibility is sampled; Ω stays the point source's, so that away from shadows all three ways agree.
    """

    def __init__(self, lights: tuple[Light, ...], targets: Targets, tracer: Tracer, stats: Statistics,
                 casters: Casters, sharp: Sharp | SharpThrough, edges: Sharp | SharpThrough | None, samples: int,
                 seed: int) -> None:
        """sharp: V(P) of lights without a size, and of the segments to each sample; edges: V(P) past sharp casters."""
        self.count, self._targets, self._tracer, self._stats = len(lights), targets, tracer, stats
        self._samples, self._seed = samples, seed
        self._sharp, self._edges, self._receives = sharp, edges, casters.receives
        self._groups, self._soft = casters.soft, union(casters.soft, self.count)
        rectangle = [light.type == "AREA" and not light.area_ellipse for light in lights]
        self._rectangle = np.array(rectangle, np.bool_)
        self._free = np.array([light.type != "AREA" for light in lights], np.bool_)  # turns to the receiver
        self._size = np.array([np.tan(light.angle / 2) if light.type == "SUN" else light.radius
                               for light in lights], np.float64)
        self._u = np.array([light.area_u for light in lights], np.float64).reshape(-1, 3)
        self._v = np.array([light.area_v for light in lights], np.float64).reshape(-1, 3)
        self._sized = np.array([sized.kind(light) is not None for light in lights], np.bool_)
        arrays = light_arrays(lights)
        self._lamps = (arrays.type, arrays.position, arrays.direction, arrays.edge, arrays.slope, arrays.axes,
                       arrays.extent)

    def __call__(self, P: NDArray, N: NDArray, active: NDArray[np.uint64], check: Check,
                 triangle: NDArray[np.int32] | None = None, lift: Lift | None = None) -> NDArray[np.float32]:
        """S, see the module."""
        soft = active & self._soft
        if triangle is not None and self._receives is not None:
            soft[~self._receives[triangle]] = 0
        hard = self._sharp(P, N, active & ~soft, check, triangle, lift)
        S = np.zeros_like(hard)
        with self._stats.stage("area sampling"):
            for group in self._groups:
                for row, light in blocks(soft & group.lights, self.count):
                    for some, share in ((~self._sized[light], self._share), (self._sized[light], self._sized_share)):
                        if some.any():
                            r, i = row[some], light[some]
                            S[r, i] = share(P, N, r, i, lift, group.casters, check, S.shape[2:])
        dim(S, soft, self._edges, P, N, check, lift)
        return S + hard  # disjoint bits: the sum is a choice

    def _share(self, P: NDArray, N: NDArray, row: NDArray, light: NDArray, lift: Lift | None, casters: int,
               check: Check, channels: tuple[int, ...]) -> NDArray[np.float32]:
        """How much (n, *channels) of light[k] P[row[k]] sees past `casters`."""
        clear = np.zeros((len(row), *channels))
        target = np.empty((len(row), 3))
        directional = self._targets.directional[light]
        order = np.arange(len(row), dtype=np.int32)
        origin, normal, of = starts(lift, P, N, self._targets, row, light)
        for s in range(self._samples):
            check()
            _sample(s, self._samples, self._seed, P, row, *self._targets, light, self._free, self._rectangle,
                    self._size, self._u, self._v, target)
            clear += self._sharp.segments(origin, of, Targets(target, directional), order, normal, casters)
        self._stats.add(shadow_rays=len(row) * self._samples)
        return (clear / self._samples).astype(np.float32)

    def _sized_share(self, P: NDArray, N: NDArray, row: NDArray, light: NDArray, lift: Lift | None, casters: int,
                     check: Check, channels: tuple[int, ...]) -> NDArray[np.float32]:
        """The same for lights with a size: how much of their light is left (n, *channels).

        By the geometric normals, where smooth surfaces are not lifted.
        """
        clear, all_of_it = np.zeros((len(row), *channels)), np.zeros(len(row))
        target, weight = np.empty((len(row), 3)), np.empty(len(row))
        directional = self._targets.directional[light]
        order = np.arange(len(row), dtype=np.int32)
        origin, normal, of = starts(lift, P, N, self._targets, row, light)
        facing = N if lift is None else lift.side
        for s in range(self._samples):
            check()
            _sized_sample(s, self._samples, self._seed, P, facing, row, *self._lamps, light, target, weight)
            seen = self._sharp.segments(origin, of, Targets(target, directional), order, normal, casters)
            clear += seen * weight.reshape(-1, *[1] * len(channels))
            all_of_it += weight
        self._stats.add(shadow_rays=len(row) * self._samples)
        return (clear / np.maximum(all_of_it, 1e-300).reshape(-1, *[1] * len(channels))).astype(np.float32)
