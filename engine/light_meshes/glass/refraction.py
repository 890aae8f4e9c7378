"""Refracted shadow paths: all ways on which a light reaches a point through glass, eq. (6) of the paper.

Beams of the light (`beams`) say where to look, Newton's method (`paths`) finds the path that ends in the point, and a
ray from the light that must meet the same interfaces and end there says whether it exists. Then the opaque
surfaces get their say.

What counts, so that nothing counts twice: v(i,x) = straight(i,x)·[nothing opaque between] + Σ_j α_j.
`RefractedPaths.paths` returns only paths with an interface that bends (two media of different index), even where
the ray happens to go straight on; `RefractedPaths.straight` is Π t where the straight way meets no such interface,
and 0 where it does. So n = 1 everywhere leaves M1.
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
MOST = 64  # paths from a light to a point that are told apart; the same in refraction.c


class Paths(NamedTuple):
    """Paths of point p are rows start[p]:start[p+1]."""

    start: NDArray[np.int64]  # (n+1,)
    alpha: NDArray[np.float64]  # (c,3) α_j = Π t
    P: NDArray[np.float64]  # (c,3) P_j, world: the far end of the path's first segment seen from the point
    arrival: NDArray[np.float64]  # (c,3) unit, the way the light travels when it reaches the point
    J: NDArray[np.float64]  # (c,) |x−L|²·dω/dA⊥, for a sun dA at the sun/dA⊥ here; infinite on a caustic
    spread: NDArray[np.float64]  # (c,2) σ₁ ≥ σ₂ with J = 1/(σ₁σ₂): by how much light stretches in two directions
    reach: NDArray[np.float64]  # (c,) world length, see `clamped`

    def clamped(self, footprint: float) -> NDArray[np.float64]:
        """J (c,) of finite light: no more goes through a disc of radius `footprint` (world) than the glass lets in.

        The first patch of glass would spread over `reach` at the point if it bent nothing; a stretch below
        footprint/reach would bring all of it into the disc.
        """
        least = footprint / self.reach
        return 1.0 / (np.maximum(self.spread[:, 0], least) * np.maximum(self.spread[:, 1], least))


class Work(NamedTuple):
    """What a call has done."""

    seeds: int  # searches started
    unconverged: int  # of them, that found nothing
    steps: int  # of Newton's method
    rays: int  # through glass and, for occlusion, through the scene
    rejected: int  # paths found that do not exist: other interfaces than the signature's, or missing the point


class RefractedPaths:
    """The solver for one scene. Beams are made once a light, when first asked for; results do not depend on batches."""

    def __init__(self, surfaces: Surfaces, media: Media, lights: Targets, opaque: Tracer, h: float,
                 casters: int = 0, total: bool = False) -> None:
        """`lights`: all lights of the scene. `opaque`: a tracer of the triangles that are not `media.transparent`.

        h (world): detail that the answers need; beams are refined to h/4, Newton's method does the rest. casters: the
        tracer's set of what may stand in the way, which holds all of `media`. total: follow light that is reflected
        totally, too.
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
        """The light's beams."""
        with self._lock:
            if light not in self._beams:
                self._beams[light] = trace_beams(self.glass, self._source(light), self._h)
            return self._beams[light]

    def lost(self, light: int) -> int:
        """How many bends the light was followed through if some of it went on; 0: none did, as far as was asked."""
        return self._beams[light].most if light in self._beams and self._beams[light].cut else 0

    def paths(self, light: int, x: NDArray[np.float64], normal: NDArray[np.float64] | None = None,
              ) -> tuple[Paths, Work]:
        """All refracted paths from a light to points x (n,3), world.

        normal (n,3): unit, of the surface that the points are on, on the side that is looked at; None: free points.
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
        """Which paths meet nothing opaque, and the number of rays: each path's segments from x back to the light."""
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
        """Π t (n,3) of all that the straight way from a light to points x (n,3) crosses, 0 where it would bend.

        beyond > 0: not 0 where it would bend so often and more. Opaque surfaces are not looked at.
        """
        s = self._source(light)
        local = np.ascontiguousarray((x - self._centre) / self._scale)
        if normal is not None:
            leave(local, np.ascontiguousarray(normal))
        out = np.zeros((len(x), 3))
        _straight(*self.glass[1:], *s, local, beyond or 1 << 30, out)
        return out

    def straight_on(self, light: int, x: NDArray[np.float64], normal: NDArray[np.float64] | None,
                    ) -> NDArray[np.float64] | None:
        """What of the light comes straight to points x (n,3) though bending surfaces stand there; None: nothing.

        That is Π t (n,3), 0 behind opaque surfaces, where they do not bend it: a body of index 1 outside of other
        glass. And where there are so many of them that the light was not followed through all.
        """
        beams = self.beams(light)
        if not beams.cut and not self._hollow:
            return None
        through = self.straight(light, x, normal, beams.most + 1 if beams.cut else 0)
        lit = np.flatnonzero(through.any(1)).astype(np.int32)
        blocked = self._opaque.occluded(x, lit, self._lights, np.full(len(lit), light, np.int32), normal,
                                        closed=False, kind="opaque", casters=self._casters)
        through[lit[blocked]] = 0
        return through


def _room(n: int, most: int) -> tuple[NDArray, ...]:
    return (np.empty((n, 3)), np.empty((n, most, 3)), np.empty(n, np.int64), np.empty((n, 3)), np.empty((n, 2)),
            np.empty(n))
