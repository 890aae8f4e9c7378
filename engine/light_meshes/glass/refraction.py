"""Refracted shadow paths: all paths on which a light reaches a point through glass, eq. (6) of the paper.

The beams of the light (`beams`) say where to look, and Newton's method (`paths.h`) finds the path that ends at the
point. Then a ray from the light confirms it: it must meet the same interfaces and end there. Last, paths that opaque
surfaces block are dropped.

Nothing counts twice: v(i,x) = straight(i,x)·[nothing opaque between] + Σ_j α_j. `RefractedPaths.paths` returns only
paths with an interface that bends (two media of different index), even if the ray happens to go straight on there.
`RefractedPaths.straight` is Π t if the straight way meets no such interface, and 0 if it does. So with n = 1 everywhere
the result is that of M1.
"""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Surfaces
from ..rays.tracer import Targets, Tracer, leave, points
from ..support.native import kernel
from .beams import Beams, trace_beams
from .media import Media, glass
from .optics import NEWTON, RAYS, REJECTED, SEEDS, UNCONVERGED, Source, source

_straight, _solve = kernel("refraction_straight"), kernel("refraction_solve")
MOST = 64  # the largest number of paths from a light to a point; refraction.c has the same


class Paths(NamedTuple):
    """The paths of point p are the rows start[p]:start[p+1]."""

    start: NDArray[np.int64]  # (n+1,)
    alpha: NDArray[np.float64]  # (c,3) α_j = Π t
    P: NDArray[np.float64]  # (c,3) P_j, world: the far end of the first segment of the path, seen from the point
    arrival: NDArray[np.float64]  # (c,3) unit direction in which the light travels when it reaches the point
    J: NDArray[np.float64]  # (c,) |x−L|²·dω/dA⊥, for a sun dA at the sun/dA⊥ here; infinite on a caustic
    spread: NDArray[np.float64]  # (c,2) σ₁ ≥ σ₂ with J = 1/(σ₁σ₂): by how much the light is stretched in two directions
    reach: NDArray[np.float64]  # (c,) world length, see `clamped`

    def clamped(self, footprint: float) -> NDArray[np.float64]:
        """Return J (c,), limited so that a disc of radius `footprint` (world) receives no more light than the glass
        lets in.

        If nothing bent the light of the first patch of glass, it would cover `reach` at the point. A stretch below
        footprint/reach would bring all of this light into the disc.
        """
        least = footprint / self.reach
        return 1.0 / (np.maximum(self.spread[:, 0], least) * np.maximum(self.spread[:, 1], least))


class Work(NamedTuple):
    """Counts of the work that a call has done."""

    seeds: int  # searches that were started
    unconverged: int  # searches that found nothing
    steps: int  # steps of Newton's method
    rays: int  # through glass and, for occlusion, through the scene
    # paths that were found but do not exist: they meet other interfaces than the signature's, or miss the point
    rejected: int


class RefractedPaths:
    """The solver for one scene. The beams of a light are made when they are first needed. Results do not depend on
    batches.
    """

    def __init__(self, surfaces: Surfaces, media: Media, lights: Targets, opaque: Tracer, h: float,
                 casters: int = 0, total: bool = False) -> None:
        """`lights`: all lights of the scene. `opaque`: a tracer of the triangles that are not `media.transparent`.

        `h` (world): the detail that the results need. Beams are refined to h/4; Newton's method gives the rest of the
        precision. `casters`: the tracer's set of triangles that may block, which contains all of `media`. `total`: also
        follow light that is totally reflected.
        """
        self.glass = glass(surfaces, media)
        self._centre, self._scale, self._h = surfaces.centre, surfaces.scale, h / surfaces.scale
        self._lights, self._opaque, self._casters = lights, opaque, casters
        self._total = total
        self._any_opaque = not media.transparent.all()
        self._hollow = bool((self.glass.ior == 1.0).any())
        self._beams: dict[int, Beams] = {}
        self._lock = threading.Lock()

    def _source(self, light: int) -> Source:
        position = self._lights.position[light]
        sun = bool(self._lights.directional[light])
        return source(self.glass, position if sun else (position - self._centre) / self._scale, sun, self._total)

    def beams(self, light: int) -> Beams:
        """Return the beams of the light."""
        with self._lock:
            if light not in self._beams:
                self._beams[light] = trace_beams(self.glass, self._source(light), self._h)
            return self._beams[light]

    def lost(self, light: int) -> int:
        """Return through how many bends the light was followed if some of it went on; 0 if none did, as far as it is
        known.
        """
        return self._beams[light].most if light in self._beams and self._beams[light].cut else 0

    def paths(self, light: int, x: NDArray[np.float64], normal: NDArray[np.float64] | None = None,
              ) -> tuple[Paths, Work]:
        """Return all refracted paths from a light to points x (n,3), world.

        `normal` (n,3): unit normals of the surface on which the points lie, on the visible side; None for free points.
        """
        beams, s = self.beams(light), self._source(light)
        local = np.ascontiguousarray((x - self._centre) / self._scale)
        if normal is not None:
            leave(local, np.ascontiguousarray(normal))
        count = np.zeros(len(x), np.int64)
        parts = [_room(0, beams.most)]
        state = np.zeros(2, np.int64)
        what = (*self.glass[1:], *s, *beams[:5], *beams[6:13], local)
        while state[0] < len(x) and len(beams.slot):
            room = _room(len(x) - int(state[0]) + MOST, beams.most)
            _solve(*what, state, count, *room)
            parts.append(tuple(a[:state[1]] for a in room))
        alpha, bends, k, arrival, spread, reach = (np.concatenate(a) for a in zip(*parts, strict=True))
        bends = self._centre + self._scale * bends
        row = np.repeat(np.arange(len(x), dtype=np.int32), count)
        work = s.work
        clear = np.ones(len(row), np.bool_)
        if self._any_opaque and len(row):
            clear, rays = self._clear(light, x, normal, row, bends, k)
            work[RAYS] += rays
        count = np.bincount(row[clear], minlength=len(x))
        with np.errstate(divide="ignore"):
            J = 1.0 / (spread[:, 0] * spread[:, 1])
        last = bends[np.arange(len(row)), k - 1]
        return Paths(
            np.concatenate([[0], np.cumsum(count)]), alpha[clear], last[clear], arrival[clear], J[clear],
            spread[clear], reach[clear] * self._scale,
        ), Work(int(work[SEEDS]), int(work[UNCONVERGED]), int(work[NEWTON]), int(work[RAYS]), int(work[REJECTED]))

    def _clear(self, light: int, x: NDArray[np.float64], normal: NDArray[np.float64] | None, row: NDArray[np.int32],
               bends: NDArray[np.float64], k: NDArray[np.int64]) -> tuple[NDArray[np.bool_], int]:
        """Return which paths meet nothing opaque, and the number of rays. Each path's segments are traced from x back
        to the light.
        """
        index = np.arange(len(row), dtype=np.int32)
        last = points(np.ascontiguousarray(bends[index, k - 1]))
        clear = ~self._opaque.occluded(x, row, last, index, normal, closed=False, kind="opaque",
                                       casters=self._casters)
        rays = len(row)
        for j in range(int(k.max()) - 1, -1, -1):
            going = index[clear & (k > j)]
            target, to = self._lights, np.full(len(going), light, np.int32)
            if j:
                target, to = points(np.ascontiguousarray(bends[:, j - 1])), going
            origin = np.ascontiguousarray(bends[:, j])
            clear[going] = ~self._opaque.occluded(origin, going, target, to, None, closed=False, kind="opaque",
                                                  casters=self._casters)
            rays += len(going)
        return clear, rays

    def straight(self, light: int, x: NDArray[np.float64], normal: NDArray[np.float64] | None = None,
                 beyond: int = 0) -> NDArray[np.float64]:
        """Return Π t (n,3) of everything that the straight way from a light to points x (n,3) crosses; 0 if it would
        bend.

        If `beyond` > 0, it is not 0 where the way would bend `beyond` times or more. Opaque surfaces are ignored.
        """
        s = self._source(light)
        local = np.ascontiguousarray((x - self._centre) / self._scale)
        if normal is not None:
            leave(local, np.ascontiguousarray(normal))
        out = np.zeros((len(x), 3))
        _straight(*self.glass[1:], *s, local, beyond or 1 << 30, out)
        return out

    def goes_on(self, light: int) -> bool:
        """Return whether `straight_on` may find light."""
        return bool(self._hollow or self.beams(light).cut)

    def straight_on(self, light: int, x: NDArray[np.float64], normal: NDArray[np.float64] | None,
                    ) -> NDArray[np.float64] | None:
        """Return the light that reaches points x (n,3) straight although surfaces that bend stand in the way; None if
        there is none.

        This is Π t (n,3), 0 behind opaque surfaces. It has two sources: surfaces that do not bend this light (a body of
        index 1 outside of other glass), and light that was not followed through all of the surfaces because there are
        too many.
        """
        if not self.goes_on(light):
            return None
        beams = self.beams(light)
        through = self.straight(light, x, normal, beams.most + 1 if beams.cut else 0)
        lit = np.flatnonzero(through.any(1)).astype(np.int32)
        blocked = self._opaque.occluded(x, lit, self._lights, np.full(len(lit), light, np.int32), normal,
                                        closed=False, kind="opaque", casters=self._casters)
        through[lit[blocked]] = 0
        return through


def _room(n: int, most: int) -> tuple[NDArray, ...]:
    return (np.empty((n, 3)), np.empty((n, most, 3)), np.empty(n, np.int64), np.empty((n, 3)), np.empty((n, 2)),
            np.empty(n))
