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

from ..rays.boxes import STACK
from ..rays.geometry import Surfaces
from ..rays.tracer import Targets, Tracer, leave, points
from ..support.compiled import kernel, part
from .beams import PAD, Beams, trace_beams
from .media import BODY, E1, E2, A, Media, glass
from .optics import (
    BENDS,
    ENDS,
    NEWTON,
    RAYS,
    REJECTED,
    SEEDS,
    UNCONVERGED,
    Scratch,
    chain,
    cross_section,
    miss,
    next_bend,
    scratch,
    set_out,
)
from .paths import newton

MOST = 64  # paths from a light to a point that are told apart
SAME = 1e-6  # of the first patch's radius: paths whose first points are nearer are one
MISS = 1e-8  # of the same: how far from the point a path may end


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

    def _scratch(self, light: int) -> Scratch:
        position = self._lights.position[light]
        sun = bool(self._lights.directional[light])
        return scratch(self.glass, position if sun else (position - self._centre) / self._scale, sun, self._total)

    def beams(self, light: int) -> Beams:
        """The light's beams."""
        with self._lock:
            if light not in self._beams:
                self._beams[light] = trace_beams(self.glass, self._scratch(light), self._h)
            return self._beams[light]

    def lost(self, light: int) -> int:
        """How many bends the light was followed through if some of it went on; 0: none did, as far as was asked."""
        return self._beams[light].most if light in self._beams and self._beams[light].cut else 0

    def paths(self, light: int, x: NDArray[np.float64], normal: NDArray[np.float64] | None = None,
              ) -> tuple[Paths, Work]:
        """All refracted paths from a light to points x (n,3), world.

        normal (n,3): unit, of the surface that the points are on, on the side that is looked at; None: free points.
        """
        beams, s = self.beams(light), self._scratch(light)
        local = np.ascontiguousarray((x - self._centre) / self._scale)
        if normal is not None:
            leave(local, np.ascontiguousarray(normal))
        count = np.zeros(len(x), np.int64)
        parts = [_room(0, beams.most)]
        p = 0
        while p < len(x) and len(beams.slot):
            room = _room(len(x) - p + MOST, beams.most)
            p, rows = _solve(self.glass, beams, s, local, p, count, *room)
            parts.append(tuple(a[:rows] for a in room))
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
        s = self._scratch(light)
        local = np.ascontiguousarray((x - self._centre) / self._scale)
        if normal is not None:
            leave(local, np.ascontiguousarray(normal))
        out = np.zeros((len(x), 3))
        _straight(self.glass, s, local, beyond or 1 << 30, out)
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


@kernel
def _straight(g, s, x, beyond, out):
    y = np.empty(3)
    for p in range(len(x)):
        for j in range(3):
            y[j] = x[p, j]
        set_out(s, y)
        _, end = miss(s.ray, y)
        bends, met = 0, next_bend(g, s, end)
        while met == BENDS and beyond < 1 << 30:
            for j in range(3):
                s.ray[0, j] += s.out[0] * s.ray[1, j]
            end -= s.out[0]
            bends, met = bends + 1, next_bend(g, s, end)
        if met == ENDS and (bends == 0 or bends >= beyond):
            for j in range(3):
                out[p, j] = s.alpha[j]


@kernel
def _solve(g, beams, s, points, p, count, alpha, bends, k_out, arrival, spread, reach):
    """Paths to points from p on, until all are done or the room is; returns the next p and the rows filled."""
    rows = np.int64(0)
    stack = np.empty(STACK, np.int64)
    known, known_beam = np.empty((MOST, 3)), np.empty(MOST, np.int64)
    x, y = np.empty(3), np.empty(3)
    o = beams.bounds
    while p < len(points) and rows + MOST <= len(alpha):
        first, tried = rows, np.int64(0)
        for j in range(3):
            x[j] = points[p, j]
        for group in range(6):
            top = 0
            if beams.root[group] >= 0:
                stack[0] = beams.root[group]
                top = 1
            axis = group >> 1
            z = -x[axis] if group & 1 else x[axis]
            a, b = x[(axis + 1) % 3], x[(axis + 2) % 3]
            while top:
                top -= 1
                n = stack[top]
                w = z - o[n, 0]
                if not (z >= o[n, 1] and z <= o[n, 2] and a >= o[n, 3] + w * o[n, 7] and a <= o[n, 4] + w * o[n, 8]
                        and b >= o[n, 5] + w * o[n, 9] and b <= o[n, 6] + w * o[n, 10]):
                    continue
                child = beams.child[n, 0]
                if not beams.child[n, 1]:
                    stack[top], stack[top + 1] = child + 1, child
                    top += 2
                    continue
                for beam in range(child, child + beams.child[n, 1]):
                    found, u, v = _inside(beams, beam, z, a, b)
                    if not found or tried == MOST:
                        continue
                    s.work[SEEDS] += 1
                    k = np.int64(beams.k[beam])
                    for j in range(k):
                        s.want[j], s.want_eta[j] = beams.code[beam, j], beams.eta[beam, j]
                    along = _search(g, s, x, np.int64(beams.slot[beam]), u, v, k, y, beams, known, known_beam, tried)
                    if along == _NOWHERE:
                        s.work[UNCONVERGED] += 1
                    elif along == _UNREAL:
                        s.work[REJECTED] += 1
                    if along < 0.0:
                        continue
                    _record(g, s, x, k, along, rows, alpha, bends, k_out, arrival, spread, reach)
                    rows += 1
                    for j in range(3):
                        known[tried, j] = y[j]
                    known_beam[tried] = beam
                    tried += 1
        count[p] = rows - first
        p += 1
    return p, rows


_NOWHERE, _KNOWN, _UNREAL = -3.0, -2.0, -1.0


@part
def _inside(beams, i, z, a, b):
    """Whether (a, b) at height z is in beam i, and (u, v) on its first triangle of the ray that is there."""
    if not (z >= beams.z[i, 1] and z <= beams.z[i, 2]):
        return False, 0.0, 0.0
    w = z - beams.z[i, 0]
    p, d, uv = beams.p, beams.d, beams.uv
    x0, y0 = p[i, 0, 0] + w * d[i, 0, 0], p[i, 0, 1] + w * d[i, 0, 1]
    x1, y1 = p[i, 1, 0] + w * d[i, 1, 0] - x0, p[i, 1, 1] + w * d[i, 1, 1] - y0
    x2, y2 = p[i, 2, 0] + w * d[i, 2, 0] - x0, p[i, 2, 1] + w * d[i, 2, 1] - y0
    det = x1 * y2 - x2 * y1
    l1, l2 = ((a - x0) * y2 - x2 * (b - y0)) / det, (x1 * (b - y0) - (a - x0) * y1) / det
    if not (l1 >= -PAD and l2 >= -PAD and l1 + l2 <= 1.0 + PAD):
        return False, 0.0, 0.0
    u = uv[i, 0, 0] + l1 * (uv[i, 1, 0] - uv[i, 0, 0]) + l2 * (uv[i, 2, 0] - uv[i, 0, 0])
    v = uv[i, 0, 1] + l1 * (uv[i, 1, 1] - uv[i, 0, 1]) + l2 * (uv[i, 2, 1] - uv[i, 0, 1])
    u, v = max(u, 0.0), max(v, 0.0)
    if u + v > 1.0:
        u, v = u / (u + v), v / (u + v)
    return True, u, v


@part
def _search(g, s, x, slot, u, v, k, y, beams, known, known_beam, tried):
    """The path that a seed leads to: its length behind the last bend, or _NOWHERE, _KNOWN, _UNREAL; y: its start."""
    size = g.patch_size[s.want[0] >> 1]
    for _ in range(2):
        slot = newton(g, s, x, slot, u, v, k)
        if slot < 0:
            return _NOWHERE
        u, v = s.out[5], s.out[6]
        for j in range(3):
            y[j] = g.place[slot, A + j] + u * g.place[slot, E1 + j] + v * g.place[slot, E2 + j]
        for i in range(tried):
            square = (y[0] - known[i, 0]) ** 2 + (y[1] - known[i, 1]) ** 2 + (y[2] - known[i, 2]) ** 2
            same = square < (SAME * size) ** 2 and k == beams.k[known_beam[i]]
            for j in range(k):
                same = same and s.want[j] == beams.code[known_beam[i], j]
            if same:
                return _KNOWN
        if chain(g, s, y, k, 0.0) < k:
            return _UNREAL
        for j in range(k):
            if s.code[j, 0] != s.want[j] or s.bend[j, 0] != s.want_eta[j]:
                return _UNREAL
        distance, along = miss(s.ray, x)
        if not along > 0.0:
            return _UNREAL
        if distance <= MISS * size:
            if next_bend(g, s, along) != ENDS:
                return _UNREAL
            return along
        # Planes of one patch that differ by rounding: once more from the triangles that are really met.
        slot, u, v = s.code[0, 1], s.bend[0, 1], s.bend[0, 2]
    return _UNREAL


@part
def _record(g, s, x, k, along, row, alpha, bends, k_out, arrival, spread, reach):
    """Fill a row of the outputs with the path in s; reach in the frame."""
    k_out[row] = k
    for j in range(3):
        alpha[row, j], arrival[row, j] = s.alpha[j], s.ray[1, j]
        for i in range(bends.shape[1]):
            bends[row, i, j] = s.rays[i, 0, j] if i < k else 0.0
    cross_section(s.ray, x, along, s.section)
    m = s.section
    total = m[0, 0] ** 2 + m[0, 1] ** 2 + m[1, 0] ** 2 + m[1, 1] ** 2
    skew = np.sqrt((m[0, 0] ** 2 + m[1, 0] ** 2 - m[0, 1] ** 2 - m[1, 1] ** 2) ** 2
                   + 4.0 * (m[0, 0] * m[0, 1] + m[1, 0] * m[1, 1]) ** 2)
    large = np.sqrt(0.5 * (total + skew))
    small = abs(m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]) / large if large > 0.0 else 0.0
    body = g.link[s.code[0, 1], BODY]
    distance, off = 1.0, 1.0
    if not s.sun:
        distance = np.sqrt((x[0] - s.light[0]) ** 2 + (x[1] - s.light[1]) ** 2 + (x[2] - s.light[2]) ** 2)
        off = np.sqrt((g.ball[body, 0] - s.light[0]) ** 2 + (g.ball[body, 1] - s.light[1]) ** 2
                      + (g.ball[body, 2] - s.light[2]) ** 2)
        off = max(off, g.ball[body, 3])
    spread[row, 0], spread[row, 1] = large / distance, small / distance
    reach[row] = distance * g.ball[body, 3] / off
