"""Rays that gather light: they find patches of surfaces, and the sky where they hit nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..glass.interfaces import Interfaces
from ..glass.media import closed
from ..rays.tracer import Tracer, directions
from ..scene.description import Scene
from ..support.native import kernel
from ..support.statistics import Statistics
from ..surface.sky import Sky
from .grids import Grids

_met, _passed, _stand_ins = kernel("rays_met"), kernel("rays_passed"), kernel("rays_stand_ins")
_at = kernel("patches_at")
SHARE = 0.17  # patches are up to this share of the way to them
STEPS = 8  # sizes of patches, each twice the one before
THROUGH = 16  # surfaces that let a ray pass
LEAST = 1e-3  # of a ray's light goes on
LAST_KEY = np.uint64(2**64 - 3)  # larger ones are no patches (rays.c)
_NOTHING, _CLEAR = np.uint64(2**64 - 1), np.uint64(2**64 - 2)


@dataclass(eq=False)
class Field:
    """The surroundings in which light is gathered."""

    scene: Scene
    grids: Grids
    tracer: Tracer
    glass: Interfaces
    sky: Sky | None  # None: the world sends no light
    stats: Statistics


class Met(NamedTuple):
    """The patches that rays meet, and the places where they meet them."""

    keys: NDArray[np.uint64]  # (m,) those above LAST_KEY are none
    triangle: NDArray[np.int32]  # (m,)
    u: NDArray[np.float32]  # (m,) barycentrics
    v: NDArray[np.float32]


def joined(several: Sequence[Met]) -> Met:
    """Return all of them joined into one."""
    return several[0] if len(several) == 1 else Met(*(np.concatenate(a) for a in zip(*several, strict=True)))


class Layer(NamedTuple):
    """A surface that rays meet: one that lets light pass, or the next surface behind such ones."""

    row: NDArray[np.int64]  # (m,) of Seen.row
    met: Met
    weight: NDArray[np.float64]  # (m,3) how much of it counts


class Seen(NamedTuple):
    """The results of x rays: a patch each, or the sky. Some rays meet light of their own, or more than one patch."""

    distance: NDArray[np.float32]  # (x,) to the first surface that is there; 0: none
    met: Met
    sky: NDArray[np.float64]  # (3,) the light of those that meet nothing and have none of their own
    row: NDArray[np.int64]  # (e,) of the rays that have light of their own
    light: NDArray[np.float64]  # (e,3) the sky's, of these rays
    layers: list[Layer]  # of these rays


class Gatherer:
    """Traces rays and finds the patches that they meet."""

    def __init__(self, field: Field, finest: float) -> None:
        """finest: the size of the smallest patches, scene units."""
        self._field, self._finest = field, finest
        s = field.grids.surfaces
        material = s.materials[s.source]
        passes = field.glass.passes
        self._clear = passes if field.glass.transparent else None
        self._lets = np.append(passes, False)  # (T+1,)
        every = np.ones(len(material), np.bool_)
        self.solid = np.append(closed(s, every) & ~passes, False)  # (T+1,) of closed meshes; the last: no hit
        self.for_small = self._stand_ins(material)

    def _stand_ins(self, material: NDArray) -> NDArray[np.int32]:
        """Return a triangle (s,T) that stands for each triangle not larger than patches of size s: it is near, faces
        the same way and has the same material. −1 for larger triangles.
        """
        g = self._field.grids
        found = np.empty((STEPS, len(material)), np.int32)
        for i, size in enumerate(self._finest * 2.0 ** np.arange(STEPS)):
            small = int(np.count_nonzero(g.longest <= size))
            slots = np.full(1 << (2 * small + 1).bit_length(), -1, np.int32)
            _stand_ins(*g.shape, g.flipped, g.longest, material, g.surfaces.instance, size, slots, found[i])
        return found

    def __call__(self, P: NDArray[np.float64], M: NDArray[np.float64], local: NDArray[np.float64],
                 turn: NDArray[np.float64] | None = None, larger: float = 1.0, sky_only: bool = False) -> Seen:
        """Return what rays meet that start at points P (r,3) of surfaces with normals M (r,3); x = r·d rays, along
        `local` (d,3) turned to M.

        turn (r,2): the cosine and sine of the angle by which `local` is turned around z before. larger: the factor by
        which patches are larger. sky_only: only the sky's light is needed, and no patch.
        """
        f, g = self._field, self._field.grids
        x, d = len(P) * len(local), len(local)
        hit = f.tracer.around("diffuse", P, M, turn, local)
        distance, keys = np.empty(x, np.float32), np.empty(x, np.uint64)
        _met(*g.shape, g.other, g.flipped, self.for_small, self._clear, self._finest, SHARE * larger, *hit, P, M, turn,
             local, distance, keys)
        f.stats.add(gathered_rays=x)
        constant = np.zeros(3) if f.sky is None else f.sky.constant
        free = np.flatnonzero(keys == _NOTHING) if constant is None else np.zeros(0, np.int64)
        clear = np.flatnonzero(keys == _CLEAR) if self._clear is not None else np.zeros(0, np.int64)
        row = np.concatenate([free, clear])
        light, layers = np.zeros((len(row), 3)), list[Layer]()
        if len(row):
            direction = directions(M, turn, local, row)
            # The solid angle that each ray speaks for, as they share the half-space by the cosine.
            width = (np.pi / (d * np.maximum(local[:, 2], 1e-3)))[row % d]
            at = np.arange(len(free))
            self._add_sky(light, at, direction[at], None, width)
            if len(clear):
                at = np.arange(len(free), len(row))
                self._pass(at, P[clear // d], direction[at], tuple(a[clear] for a in hit), light,
                           None if sky_only else layers, larger, width)
        return Seen(distance, Met(keys, *hit), np.zeros(3) if constant is None else constant, row, light, layers)

    def at(self, triangle: NDArray[np.int32], P: NDArray[np.float64], direction: NDArray[np.float64],
           size: NDArray[np.float64]) -> Met:
        """Return the patches of about size (n,), scene units, at places P (n,3) of triangles (n,) that rays along
        `direction` (n,3) meet.
        """
        g, n = self._field.grids, len(P)
        found = Met(np.empty(n, np.uint64), triangle, np.empty(n, np.float32), np.empty(n, np.float32))
        _at(*g.shape, g.other, g.flipped, self.for_small, self._finest, triangle, P, direction, size, found.keys,
            found.u, found.v)
        return found

    def _add_sky(self, light: NDArray, rows: NDArray, direction: NDArray, weight: NDArray | None,
                 width: NDArray[np.float64]) -> None:
        """Add the sky's light along `direction` (m,3) to these rows of `light`. width: the solid angle of each row's
        ray.
        """
        sky = self._field.sky
        if sky is not None and len(rows):
            found = sky.light(direction, width[rows])
            light[rows] += found if weight is None else weight * found

    def _pass(self, row: NDArray, origin: NDArray, direction: NDArray, hit: tuple[NDArray, ...], light: NDArray,
              layers: list[Layer] | None, larger: float, width: NDArray[np.float64]) -> None:
        """Follow rays (m,) with the numbers `row`, which met surfaces that let light pass, straight on, as shadow rays
        go. layers: the list that gets the surfaces that they meet; None: only the sky's light is needed.
        """
        f, g, m, clear = self._field, self._field.grids, len(row), self._clear
        assert clear is not None
        row, weight, N, state = row.astype(np.int64), np.ones((m, 3)), np.empty((m, 3)), np.zeros(3, np.int64)
        out = np.empty(m, np.int64), np.empty((m, 3)), np.empty((m, 3))
        for step in range(THROUGH + 1):
            n = len(hit[0])
            before, keys, at, counts = row[:n].copy(), np.empty(n, np.uint64), np.empty(n, np.int64), np.empty((n, 3))
            _passed(*g.shape, g.other, g.flipped, self.for_small, self._finest, SHARE * larger, clear,
                    f.glass.dims, LEAST, step == THROUGH, self._factor(*hit), *hit, row, weight, origin, direction, N,
                    keys, at, counts, *out, state)
            met = slice(int(state[1]))
            if layers is not None and state[1]:
                layers.append(Layer(before[at[met]], Met(keys[met], *(a[at[met]] for a in hit)), counts[met]))
            n = int(state[0])
            if not n:
                break
            hit = f.tracer.closest("diffuse", origin[:n], direction[:n], N[:n])
            f.stats.add(gathered_rays=n)
        rows, directions_out, left = (a[:state[2]] for a in out)
        self._add_sky(light, rows, directions_out, left, width)

    def _factor(self, triangle: NDArray[np.int32], u: NDArray[np.float32],
                v: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return how much light (n,3) triangles (n,), some −1, let through; 0 for those that let none pass."""
        rows = np.flatnonzero(self._lets[triangle])  # the last is that of −1
        if len(rows) == len(triangle):
            return self._field.glass.factor(triangle, u, v)
        factor = np.zeros((len(triangle), 3), np.float32)
        factor[rows] = self._field.glass.factor(triangle[rows], u[rows], v[rows])
        return factor


Check = Callable[[], None]
