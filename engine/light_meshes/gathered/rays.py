"""Rays that gather light: which patches of surfaces they meet, and the sky where they meet nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..glass.interfaces import Interfaces
from ..glass.media import closed
from ..rays.tracer import Tracer
from ..scene.description import Scene
from ..support.native import kernel
from ..support.statistics import Statistics
from ..surface.sky import Sky
from .grids import Grids

_rays, _met, _at = kernel("records_rays"), kernel("records_met"), kernel("patches_at")
SHARE = 0.35  # patches are up to this share of the way to them
STEPS = 8  # sizes of patches, each twice the one before
THROUGH = 16  # surfaces that let a ray pass


@dataclass(eq=False)
class Field:
    """What light is gathered in."""

    scene: Scene
    grids: Grids
    tracer: Tracer
    glass: Interfaces
    sky: Sky | None  # None: the world sends no light
    stats: Statistics


class Layer(NamedTuple):
    """Patches that rays meet: the first of each, or those behind what lets them pass."""

    row: NDArray[np.int64]  # (m,) of the ray
    keys: NDArray[np.uint64]  # (m,)
    on: NDArray[np.float32]  # (m,2) where on the axes of its grid each was met
    weight: NDArray[np.float64] | None  # (m,3) of what they send; None: all counts


class Seen(NamedTuple):
    """What some rays meet."""

    distance: NDArray[np.float32]  # (x,) to the first surface that is there; 0: none
    light: NDArray[np.float64]  # (x,3) of the sky
    layers: list[Layer]


class Gatherer:
    """Traces rays and names patches."""

    def __init__(self, field: Field, finest: float) -> None:
        """finest: the size of the smallest patches, scene units."""
        self._field, self._finest = field, finest
        s = field.grids.surfaces
        material = s.materials[s.source]
        passes = field.glass.passes
        self._clear = passes if field.glass.transparent else None
        every = np.ones(len(material), np.bool_)
        self.solid = np.append(closed(s, every) & ~passes, False)  # (T+1,) of closed meshes; the last: no hit
        self.for_small = np.stack([self._stand_ins(material, finest * 2.0**i) for i in range(STEPS)])

    def _stand_ins(self, material: NDArray, size: float) -> NDArray[np.int32]:
        """For triangles (T,) that are not larger than `size`, one of those that are near, look the same way and have
        the same material; −1 for larger ones.
        """
        g = self._field.grids
        s = g.surfaces
        out = np.full(len(s.triangles), -1, np.int32)
        small = np.flatnonzero(g.longest <= size)
        if len(small):
            N = g.normals(small)
            axis = np.abs(N).argmax(1)
            side = 2 * axis + (N[np.arange(len(N)), axis] > 0)
            middle = s.vertices[s.triangles[small]].mean(1) * s.scale + s.centre
            what = np.column_stack([np.floor(middle / size).astype(np.int64), side, material[small],
                                    s.instance[small]])
            _, first, number = np.unique(what, axis=0, return_index=True, return_inverse=True)
            out[small] = small[first][number.reshape(-1)]
        return out

    def __call__(self, P: NDArray[np.float64], M: NDArray[np.float64], local: NDArray[np.float64],
                 turn: NDArray[np.float64] | None = None, larger: float = 1.0) -> Seen:
        """What rays from points P (r,3) along `local` (d,3), turned to normals M (r,3), meet; x = r·d.

        turn (r,2): by the angle with this cosine and sine before. larger: how much larger patches are.
        """
        f = self._field
        x = len(P) * len(local)
        origin, direction, normal = np.empty((x, 3)), np.empty((x, 3)), np.empty((x, 3))
        _rays(P, M, turn, local, origin, direction, normal)
        layers: list[Layer] = []
        light = np.zeros((x, 3))
        first = self._trace(origin, direction, normal, larger)
        f.stats.add(gathered_rays=x)
        triangle, _, _, distance, keys, on = first
        hit = triangle >= 0
        # The solid angle that each ray speaks for, as they share the half-space by the cosine.
        width = np.tile(np.pi / (len(local) * np.maximum(local[:, 2], 1e-3)), len(P))
        self._add_sky(light, np.flatnonzero(~hit), direction, None, width)
        clear = hit & self._clear[triangle] if self._clear is not None else None
        stops = np.flatnonzero(hit if clear is None else hit & ~clear)
        layers.append(Layer(stops, keys[stops], on[stops], None))
        if clear is not None and clear.any():
            rows = np.flatnonzero(clear)
            self._pass(rows, direction[rows], tuple(a[rows] for a in first), light, layers, larger, width)
        return Seen(distance, light, layers)

    def at(self, triangle: NDArray[np.int32], P: NDArray[np.float64], direction: NDArray[np.float64],
           size: NDArray[np.float64]) -> Layer:
        """Return the patches of about size (n,), scene units, at places P (n,3) of triangles (n,) that rays along
        `direction` (n,3) meet.
        """
        g, n = self._field.grids, len(P)
        keys, on = np.empty(n, np.uint64), np.empty((n, 2), np.float32)
        _at(*g.shape, g.other, g.flipped, self.for_small, self._finest, triangle, P, direction, size, keys, on)
        return Layer(np.arange(n), keys, on, None)

    def _trace(self, origin: NDArray, direction: NDArray, normal: NDArray, larger: float) -> tuple[NDArray, ...]:
        """Triangles, barycentrics, distances, keys of patches and places on their axes of what rays meet."""
        g, n = self._field.grids, len(origin)
        triangle, u, v = self._field.tracer.closest("diffuse", origin, direction, normal)
        distance, keys, on = np.empty(n, np.float32), np.empty(n, np.uint64), np.empty((n, 2), np.float32)
        _met(*g.shape, g.other, g.flipped, self.for_small, self._finest, SHARE * larger, triangle, u, v, origin,
             direction, distance, keys, on)
        return triangle, u, v, distance, keys, on

    def _add_sky(self, light: NDArray, rows: NDArray, direction: NDArray, weight: NDArray | None,
                 width: NDArray[np.float64]) -> None:
        sky = self._field.sky
        if sky is not None and len(rows):
            found = sky.light(direction[rows] if weight is None else direction, width[rows])
            light[rows] += found if weight is None else weight * found

    def _pass(self, row: NDArray, direction: NDArray, met: tuple[NDArray, ...], light: NDArray, layers: list[Layer],
              larger: float, width: NDArray[np.float64]) -> None:
        """Follow rays (m,) of numbers `row`, which met what lets them pass, straight on, as shadow rays go."""
        g, glass = self._field.grids, self._field.glass
        weight = np.ones((len(row), 3))
        assert self._clear is not None
        for _ in range(THROUGH):
            triangle, u, v, _, keys, on = met
            clear = self._clear[triangle]
            passed = np.zeros((len(row), 3))
            passed[clear] = glass.factor(triangle[clear], u[clear], v[clear])
            layers.append(Layer(row, keys, on, weight * (1 - passed)))
            go = np.flatnonzero((weight * passed).max(1, initial=0) > 1e-3)
            if not len(go):
                break
            row, weight, direction = row[go], weight[go] * passed[go], direction[go]
            P, N = g.behind(triangle[go], u[go], v[go], direction)
            met = self._trace(P, direction, N, larger)
            hit = met[0] >= 0
            if not hit.all():
                self._add_sky(light, row[~hit], direction[~hit], weight[~hit], width)
                row, weight, direction = row[hit], weight[hit], direction[hit]
                met = tuple(a[hit] for a in met)


Check = Callable[[], None]
