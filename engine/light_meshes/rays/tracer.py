"""Ray tracing with three functions: `closest`, `occluded` and `transmittance`. No other module of the engine uses
`embree.py`, the only one that uses Embree.

Precision (Embree uses float32): the scene is shifted and scaled (`frame`). Rays are built in float64. They start a few
ulps of their place away from their surface, along the geometric normal (`clearance`), are aimed from the *rounded*
origin at the target, and are converted to float32 last. Outside of this module points are float64 in world space.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Scene
from ..scene.errors import SceneError
from ..support.native import Call, kernel
from .embree import Accelerator, Met, accelerator, room_for
from .geometry import Surfaces
from .stacks import Stacks, place_of

CHUNK = 16384  # rays that are followed through glass at once
# relative to the frame's box: how far a ray starts from its surface, and how far beyond a closed end it goes
ULPS = 16 * 2.0**-23
BUILD_BYTES = 300  # a triangle, while Embree builds its tree. It crashes or hangs where it does not get them

_segments, _cross, leave = kernel("tracer_segments"), kernel("tracer_cross"), kernel("tracer_leave")
_directions = kernel("tracer_directions")


class Targets(NamedTuple):
    """Where rays go: to a point, or in the direction of a sun."""

    position: NDArray[np.float64]  # (m,3) world; for a directional one the unit vector towards the light
    directional: NDArray[np.bool_]  # (m,)


class Pixels(NamedTuple):
    """Which samples of which pixels rays from the camera are."""

    sample: NDArray[np.int64]  # (n,) numbers of samples, all of a pixel in sequence, in rows of pixels
    left: int  # the x of the rows' first pixel
    wide: int  # pixels of a row
    samples: int  # of a pixel


def points(position: NDArray[np.float64]) -> Targets:
    """Return targets that are all points."""
    return Targets(position, np.zeros(len(position), np.bool_))


class Turning(Protocol):
    """Says how much of straight rays through bodies of glass counts; see `glass.aside`."""

    def begin(self, n: int) -> NDArray[np.float64]:
        """Return the states of n rays."""

    def cross(self, state: NDArray[np.float64], row: NDArray[np.int64], triangle: NDArray[np.int32],
              u: NDArray[np.float32], v: NDArray[np.float32], start: NDArray[np.float64], end: NDArray[np.float64],
              sun: NDArray[np.bool_]) -> None:
        """Take the rays `row` of `state` through a crossing each."""

    def dim(self, state: NDArray[np.float64], light: NDArray[np.int32], through: NDArray[np.float32]) -> None:
        """Multiply `through` (n,3) of rays to lamps `light` (n,) by what counts of them."""


class Passing(NamedTuple):
    """What surfaces let through of straight rays of light."""

    # (triangle, u, v) → the share of light (n,3) that a crossing lets through
    factor: Callable[[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]
    turning: Turning | None  # None: glass turns nothing aside
    kernel: Callable[..., int]  # `glass/straight.c`, with all that it needs to know of surfaces


class Tracer:
    """The triangles of a scene, ready to be traced. There is one Embree scene for each distinct set of visible objects.

    `kind` says which rays: "camera", "reflection" (and refraction), "shadow", or, where light is gathered from
    everywhere, "diffuse". Shadow casters are divided into
    "opaque" and "glass" (those that let light through), and also into "stops" and "sheets" (those that let it through
    unbent). These four kinds exist for each set of `casters`; only triangles in the set count. Set 0 holds all
    triangles.
    """

    def __init__(self, scene: Scene, surfaces: Surfaces, glass: NDArray[np.bool_] | None = None,
                 bending: NDArray[np.bool_] | None = None, casters: Sequence[NDArray[np.bool_]] = (),
                 old: Tracer | None = None, stacks: Stacks | None = None) -> None:
        """`glass` (T,): triangles through which shadow rays may pass; `bending` (T,): triangles that refract them.
        None: no triangle does.

        `stacks`: the triangles that coincide. `casters`: sets of triangles (T,); the first one stands for all
        triangles. `old`: a tracer of the same surfaces, whose Embree scenes are used again.
        """
        glass = np.zeros(len(surfaces.triangles), np.bool_) if glass is None else glass
        bending = np.zeros(len(surfaces.triangles), np.bool_) if bending is None else bending
        self.centre, self.scale, self.reach = surfaces.centre, surfaces.scale, surfaces.reach
        self._frame = self.centre, self.scale, self.reach
        self._surfaces, self.stacks = surfaces, stacks
        self._embree: dict[tuple[str, int], tuple[Accelerator, NDArray[np.int32] | None]] = {}
        self._seen: dict[tuple[str, int], NDArray[np.bool_]] = {}
        owner = scene.geometry.instance_object[surfaces.instance]
        self.built: dict[bytes, tuple[Accelerator, NDArray[np.int32] | None]] = {}
        built = old.built if old else {}
        every = np.ones(len(owner), np.bool_)
        kinds: dict[str, tuple[str, NDArray[np.bool_]]] = {
            "camera": ("camera", every), "reflection": ("reflection", every), "shadow": ("shadow", every),
            "opaque": ("shadow", ~glass), "glass": ("shadow", glass),
            "stops": ("shadow", ~glass | bending), "sheets": ("shadow", glass & ~bending),
        }
        if scene.settings.gathers:
            kinds["diffuse"] = "diffuse", every
        for number, among in enumerate(casters or [every]):
            for kind, (looks, those) in kinds.items():
                if number and kind in ("camera", "reflection", "shadow", "diffuse"):
                    continue
                flags = np.array([getattr(o, f"visible_{looks}") for o in scene.objects], np.bool_)
                seen = flags[owner] & those & among if len(owner) else those
                key = seen.tobytes()
                if key not in self.built:
                    self.built[key] = built.get(key) or _build(surfaces, seen)
                self._embree[kind, number] = self.built[key]
                if stacks is not None:
                    self._seen[kind, number] = seen
        self.embree_scenes = len(self.built)

    def has(self, kind: str, casters: int = 0) -> bool:
        """Return whether rays of this kind can meet any triangle of this set of casters."""
        _, original = self._embree[kind, casters]
        return original is None or len(original) > 0

    def closest(
        self, kind: str, origin: NDArray[np.float64], direction: NDArray[np.float64],
        normal: NDArray[np.float64] | None = None, reach: NDArray[np.float64] | None = None, casters: int = 0,
        passed: tuple[NDArray[np.float64], NDArray[np.int32]] | None = None, pixels: Pixels | None = None,
    ) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
        """Return the first triangle along each ray (−1: none) and its barycentrics u, v.

        `origin`, `direction`: (n,3), unit directions. `normal` (n,3): of the surface that a ray leaves, on the ray's
        side. `reach` (n,): hits beyond this world length are ignored. `passed`: where the rays began (n,3), if they
        have gone straight since then, and the triangle (n,) that each hit or left last, −1 if none. It is needed for
        triangles that coincide. `pixels`: of rays that come from the camera, which are faster with it.
        """
        embree, original = self._embree[kind, casters]
        n = len(origin)
        if pixels is None:
            triangle, u, v = embree.closest_of(*self._frame, origin, direction, normal, reach)
        else:
            triangle, u, v = embree.closest_of_pixels(*pixels, *self._frame, origin, direction, reach)
        if original is not None:
            hit = triangle >= 0  # none where everything is hidden
            triangle[hit] = original[triangle[hit]]
        if self.stacks is not None:
            start, last = passed or (origin, np.full(n, -1, np.int32))
            self.stacks.first_of_all(self._surfaces, self._seen[kind, casters], start, direction, last, triangle, u, v)
        return triangle, u, v

    def around(self, kind: str, P: NDArray[np.float64], M: NDArray[np.float64], turn: NDArray[np.float64] | None,
               local: NDArray[np.float64]) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
        """Return what `closest` returns, for rays along `local` (d,3), turned to unit normals M (r,3), from points
        P (r,3) of surfaces; r·d of them.

        turn (r,2): `local` is turned by the angle with this cosine and sine before, around its z.
        """
        embree, original = self._embree[kind, 0]
        triangle, u, v = embree.around(*self._frame, P, M, turn, local)
        if original is not None:
            hit = triangle >= 0
            triangle[hit] = original[triangle[hit]]
        if self.stacks is not None:
            first = self.stacks.first
            row = np.flatnonzero((triangle >= 0) & (first[triangle + 1] > first[triangle]))
            met = triangle[row], u[row], v[row]
            self.stacks.first_of_all(self._surfaces, self._seen[kind, 0], P[row // len(local)],
                                     directions(M, turn, local, row), np.full(len(row), -1, np.int32), *met)
            triangle[row], u[row], v[row] = met
        return triangle, u, v

    def occluded(
        self, origin: NDArray[np.float64], origin_of: NDArray[np.int32], targets: Targets,
        target_of: NDArray[np.int32], normal: NDArray[np.float64] | None, closed: bool, kind: str = "shadow",
        casters: int = 0,
    ) -> NDArray[np.bool_]:
        """Return whether anything that casts shadows lies between origin[origin_of[k]] and targets[target_of[k]].

        `normal` (len(origin),3): surface normals along which rays leave their surface. None: the origins are free
        points, and a surface that touches them blocks. `closed`: a surface that touches the target blocks too (for
        lattice nodes); otherwise the ray ends just before the target (for lights).
        """
        embree, _ = self._embree[kind, casters]
        return embree.occluded_of(*self._frame, origin, normal, origin_of, *targets, target_of, closed)

    def field(self, kind: str, casters: int = 0) -> tuple | None:
        """Return what kernels that make shadow rays themselves need to trace them past this set of casters: how packets
        of rays are traced, and the frame of rays. None where such kernels cannot trace.
        """
        found = self._embree[kind, casters][0].for_kernels
        return None if found is None else (*found, *self._frame)

    def lit(self, origin: NDArray[np.float64], targets: Targets, asked: NDArray[np.uint64], among: NDArray[np.uint64],
            lights: tuple[int, int], found: NDArray[np.uint64], casters: int = 0) -> Call:
        """Return the call that sets the bits of found (n,W) for the lights that the free points origin (n,3) see past
        opaque surfaces.

        Only lights first..last, `lights`, are tried, of those in asked (n,W) and among (W,). Its result is how many
        rays that took.
        """
        embree, _ = self._embree["opaque", casters]
        return embree.lit, *self._frame, origin, *targets, asked, among, *lights, found

    def near(self, origin: NDArray[np.float64], normal: NDArray[np.float64], position: NDArray[np.float64],
             start: NDArray[np.int64], end: NDArray[np.int64], target: NDArray[np.int32], most: int,
             seen: NDArray[np.bool_], state: NDArray[np.int64]) -> Call:
        """Return the call that finds out what points on surfaces see of what is near them: whether nothing is between
        origin[p] and position[target[k]], with k from start[p,0] to end[p], where seen[k] is not set yet.

        As `occluded` with `closed`. It begins with point state[0] and stops after about `most` rays, which state[1]
        counts, so that the caller can see whether the picture is still wanted.
        """
        embree, _ = self._embree["shadow", 0]
        return embree.near, *self._frame, origin, normal, position, start, end, target, most, seen, state

    def transmittance(
        self, origin: NDArray[np.float64], origin_of: NDArray[np.int32], targets: Targets,
        target_of: NDArray[np.int32], normal: NDArray[np.float64] | None, closed: bool, passing: Passing,
        unbent: bool = False, casters: int = 0, triangle: NDArray[np.int32] | None = None,
        light: NDArray[np.int32] | None = None,
    ) -> NDArray[np.float32]:
        """Return Π t (n,3) of the surfaces crossed on the straight segments of `occluded`; 0 behind an opaque one.

        Each crossing counts once, although Embree may report both triangles at an edge. `unbent`: a surface that would
        bend the ray stops it. `triangle` (len(origin),): the triangles on which the origins lie; sheets on these count.
        `light` (n,): the lamps to which the segments go; what glass turns aside counts less then.
        """
        kinds = ("stops", "sheets") if unbent else ("opaque", "glass")
        light = None if passing.turning is None else light
        segments = origin, normal, origin_of, *targets, target_of, closed, triangle, light
        stops, (embree, original) = self.field(kinds[0], casters), self._embree[kinds[1], casters]
        if stops is None:
            return self._step_by_step(kinds, casters, passing, *segments)
        through, left = np.empty((len(origin_of), 3), np.float32), np.empty(len(origin_of), np.bool_)
        closest, sheets = embree.closest_for_kernels if self.has(kinds[1], casters) else (0, 0)
        if passing.kernel(*stops[:3], closest, sheets, original, *self._frame, *segments, through, left):
            rows = np.flatnonzero(left)
            lights = None if light is None else light[rows]
            through[rows] = self._step_by_step(kinds, casters, passing, origin, normal, origin_of[rows], *targets,
                                               target_of[rows], closed, triangle, lights)
        return through

    def _step_by_step(
        self, kinds: tuple[str, str], casters: int, passing: Passing, origin: NDArray[np.float64],
        normal: NDArray[np.float64] | None, origin_of: NDArray[np.int32], position: NDArray[np.float64],
        directional: NDArray[np.bool_], target_of: NDArray[np.int32], closed: bool,
        triangle: NDArray[np.int32] | None, light: NDArray[np.int32] | None,
    ) -> NDArray[np.float32]:
        """Return the same as `transmittance`, for any surface."""
        targets, (stops, kind), factor = Targets(position, directional), kinds, passing.factor
        turning = None if light is None else passing.turning
        blocked = self.occluded(origin, origin_of, targets, target_of, normal, closed, kind=stops, casters=casters)
        through = np.repeat(~blocked[:, None], 3, axis=1).astype(np.float32)
        s, (embree, original) = self._surfaces, self._embree[kind, casters]
        if original is not None and not len(original):
            return through
        for i in range(0, len(origin_of), CHUNK):
            alive = i + np.flatnonzero(~blocked[i:i + CHUNK])
            o, d, t = room_for(len(alive))
            _segments(*self._frame, origin, normal, origin_of[alive], *targets, target_of[alive], closed, o, d, t)
            stands = None if self.stacks is None or triangle is None else triangle[origin_of[alive]]
            some, first, start, end, (o, d, t) = self._that_cross(embree, stands, o, d, t)
            alive = alive[some]
            # distance of the last crossing from the start; its triangle; crossings in a row that are hardly apart
            passed, last, near = np.zeros(len(alive)), np.full(len(alive), -1, np.int32), np.zeros(len(alive), np.int32)
            state = turning.begin(min(CHUNK, len(origin_of) - i)) if turning and len(alive) else None
            done = np.full(len(alive), -1e-9)  # share of the segment up to which what is in one place has counted
            if self.stacks is not None and triangle is not None:
                done[:] = ULPS / 4 * np.maximum(1.0, np.abs(start).max(1)) / np.linalg.norm(end - start, axis=1)
                own = triangle[origin_of[alive]]
                self._together(kind, casters, own, start, end, True, done, done, alive, factor, through)
            while len(alive):
                hit, first = first or embree.closest(o, d, t), None
                on = hit.triangle >= 0
                met: NDArray[np.int32] = hit.triangle[on] if original is None else original[hit.triangle[on]]
                alive, start, end, passed = alive[on], start[on], end[on], passed[on]
                last, near, done, o, d, t = last[on], near[on], done[on], o[on], d[on], t[on]
                new, until = np.empty(len(alive), np.bool_), np.empty(len(alive))
                _cross(s.vertices, s.triangles, s.instance, met, start, end, o, d, t, passed, last, near, new, until)
                if self.stacks is not None:
                    stacked = self.stacks.first[met + 1] > self.stacks.first[met]
                    new = np.where(stacked, self._share_of_way(met, start, end) > done, new)
                    others = np.where(stacked, met, np.int32(-1))
                    self._together(kind, casters, others, start, end, False, done, until, alive, factor, through)
                    done = np.where(stacked, np.maximum(done, until), done)
                through[alive[new]] *= factor(met[new], hit.u[on][new], hit.v[on][new])
                if turning is not None and state is not None:
                    turning.cross(state, alive[new] - i, met[new], hit.u[on][new], hit.v[on][new], start[new], end[new],
                                  targets.directional[target_of[alive[new]]])
                on = (through[alive] > 0).any(1) & (t > 0)
                alive, start, end, passed = alive[on], start[on], end[on], passed[on]
                last, near, done, o, d, t = last[on], near[on], done[on], o[on], d[on], t[on]
            if turning is not None and state is not None and light is not None:
                turning.dim(state, light[i:i + CHUNK], through[i:i + CHUNK])
        return through

    def _share_of_way(self, triangle: NDArray[np.int32], start: NDArray[np.float64],
                      end: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share of segments (n,) that is before their triangles' planes."""
        share = np.empty(len(triangle))
        place_of(self._surfaces.vertices, self._surfaces.triangles, triangle, start, end, share)
        return share

    def _that_cross(self, embree: Accelerator, triangle: NDArray[np.int32] | None, o: NDArray[np.float32],
                    d: NDArray[np.float32], t: NDArray[np.float32]) -> tuple[
                        NDArray[np.int64], Met | None, NDArray[np.float64], NDArray[np.float64], tuple[NDArray, ...]]:
        """Which of these rays meet a triangle, which are few as a rule, and what; where they start and end; and they
        themselves, with t as far as they met. Also those that start on sheets in one place, on triangle (n,).
        """
        length = t.copy()
        hit = embree.closest(o, d, t)
        on = hit.triangle >= 0
        if self.stacks is not None and triangle is not None:
            on |= self.stacks.first[triangle + 1] > self.stacks.first[triangle]
        some = np.flatnonzero(on)
        start = o[some].astype(np.float64)
        end = start + d[some].astype(np.float64) * length[some, None].astype(np.float64)
        return some, Met(hit.triangle[some], hit.u[some], hit.v[some]), start, end, (o[some], d[some], t[some])

    def _together(self, kind: str, casters: int, triangle: NDArray[np.int32], start: NDArray, end: NDArray,
                  leaving: bool, done: NDArray, until: NDArray, alive: NDArray, factor: Callable,
                  through: NDArray[np.float32]) -> None:
        """Multiply through[alive] by the sheets that the segments cross together with `triangle`; see
        `Stacks.also_crossed`.
        """
        assert self.stacks is not None
        room = len(triangle)
        while True:
            row, partner = np.empty(room, np.int32), np.empty(room, np.int32)
            u, v = np.empty(room, np.float32), np.empty(room, np.float32)
            count = self.stacks.also_crossed(self._surfaces, self._seen[kind, casters], triangle, start, end, leaving,
                                             done, until, row, partner, u, v)
            if count <= room:
                break
            room = count
        if count:
            np.multiply.at(through, alive[row[:count]], factor(partner[:count], u[:count], v[:count]))


def directions(M: NDArray[np.float64], turn: NDArray[np.float64] | None, local: NDArray[np.float64],
               row: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the unit directions (n,3) of rays `row` (n,) of those that `Tracer.around` traces."""
    direction = np.empty((len(row), 3))
    _directions(M, turn, local, row, direction)
    return direction


def _build(surfaces: Surfaces, seen: NDArray[np.bool_]) -> tuple[Accelerator, NDArray[np.int32] | None]:
    """Return the accelerator of the triangles in `seen`, and their original numbers (None if it contains all)."""
    original = None if seen.all() else np.flatnonzero(seen).astype(np.int32)
    triangles = surfaces.triangles if original is None else surfaces.triangles[original]
    try:
        # test whether this much memory is available, because Embree does not
        np.empty(BUILD_BYTES * len(triangles) + 2**25, np.uint8)
        return accelerator(surfaces.vertices, triangles), original
    except MemoryError as e:
        raise SceneError(f"out of memory while building the accelerator of {len(triangles):,} triangles") from e
