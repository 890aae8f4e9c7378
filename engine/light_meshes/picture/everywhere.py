"""Light from everywhere in a picture: the surfaces and lamps whose light is gathered, how finely it is gathered, and
the colours of surfaces for rays that gather.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..gathered.grids import Grids
from ..gathered.nearness import Nearness
from ..gathered.patches import Patches
from ..gathered.rays import STEPS, Field, Gatherer
from ..gathered.records import Records
from ..lights.registry import KINDS as LIGHTS
from ..rays.camera import camera_rays
from ..rays.geometry import Hits
from ..scene.description import Camera, Light, Settings, same
from ..shadows import lamp_points
from ..shadows.grouped import Grouped
from ..shadows.method import Method, Setup, Through
from ..shadows.radius import extents
from ..shadows.registry import KINDS, NONE
from ..shadows.unshadowed import Unshadowed
from ..support.statistics import Statistics
from ..surface import albedo
from ..surface.points import REFLECTED
from .lighting import Lighting
from .plan import Plan
from .world import World

FINE = 2.0  # the finest distance of records, in steps h that suit the picture
LEVELS = 6  # that are coarser, each by 2
LAMP_RAYS = 4  # from each point of a patch to each lamp, where there are
FEW_LAMPS = 64  # or fewer; one where there are more, and then
PART = 0.05  # lamps that together give a patch at most this share of its light have one ray (`shadows.grouped`)
NARROW = 0.02  # one, too, where all are small: suns up to this angle, radians, others up to the smallest patches' size
AHEAD = 1 << 16  # points of the picture, about, for which light is gathered before it is drawn
ASKED = 1 << 16  # of them at once
LAYERS = 64  # of cut-outs through which they are looked for
PATCH = 2.0  # the size of the smallest patches, in finest distances


def step(h: float) -> float:
    """Return the finest distance of records where h suits the picture: a power of two, so that it stays when h hardly
    changes.
    """
    return float(2.0 ** np.round(np.log2(FINE * h)))


class Everywhere(NamedTuple):
    """The records of a picture, and everything that they depend on."""

    records: Records
    world: World
    settings: tuple


def everywhere(world: World, plan: Plan, lighting: Lighting, settings: Settings, h: float, stats: Statistics,
               old: Everywhere | None) -> Everywhere:
    """Return the records of a world, which are computed when they are needed. old: those of the picture before, which
    are used again if everything that they depend on is the same.
    """
    fine = step(h)
    own = (fine, settings.bounces, settings.world_light, settings.refraction, settings.glass_shadows,
           plan.shadows == NONE, plan.channels, plan.blurred)
    if old and own == old.settings and _alike(world, old.world) and old.records.kept(stats):
        return old._replace(world=world)
    return Everywhere(_records(world, plan, lighting, settings, fine, stats), world, own)


def _alike(new: World, old: World) -> bool:
    """Return whether light from everywhere is the same in both worlds."""
    def flags(world: World) -> list[tuple]:
        return [(o.visible_diffuse, o.visible_shadow) for o in world.scene.objects]

    a, b = new.scene, old.scene
    sees = any(m.program.sees_camera(m.program.without_normals) for m in a.materials)
    return (new.surfaces is old.surfaces and new.glass is old.glass and not sees and flags(new) == flags(old)
            and same(a.materials, b.materials) and same(a.lights, b.lights) and new.sky.alike(old.sky)
            and [t and t.key for t in new.textures] == [t and t.key for t in old.textures])


def _records(world: World, plan: Plan, lighting: Lighting, settings: Settings, fine: float,
             stats: Statistics) -> Records:
    with stats.stage("gathered light: prepared"):
        grids = Grids(world.surfaces, fine * 2.0**LEVELS, PATCH * fine * 2.0**(STEPS - 1))
        sky = world.sky if settings.by_sky and not world.sky.dark else None
        field = Field(world.scene, grids, world.tracer, world.glass, sky, stats)
        gather = Gatherer(field, PATCH * fine)
        owner = world.owner(np.arange(len(world.surfaces.triangles), dtype=np.int32))
        met = np.array([o.visible_diffuse for o in world.scene.objects], np.bool_)[owner]
        gives = np.array([m.emits for m in world.scene.materials], np.bool_)
        left = gives[world.surfaces.materials[world.surfaces.source]] & met
        if world.as_lamps is not None:
            left &= ~world.as_lamps
        patches = Patches(field, gather, Look(world, lighting, _shadows(world, plan, settings, PATCH * fine, stats)),
                          len(world.scene.lights), bool(left.any()), PATCH * fine)
    return Records(field, gather, patches, Nearness(grids, met, fine), fine, settings.bounces,
                   plan.blurred)


def _lamp_rays(lights: tuple[Light, ...], patch: float) -> int:
    """Return how many rays go from each of the four points of a patch to each lamp: one where there are many lamps, or
    where all are so small that their penumbras are hardly wider than the smallest patches, of size `patch`.
    """
    wide = 2 * lamp_points.reaches(lamp_points.shapes(lights))
    narrow = np.array([LIGHTS[light.type].directional for light in lights], np.bool_)
    small = wide <= np.where(narrow, NARROW, patch)
    return 1 if len(lights) > FEW_LAMPS or small.all() else LAMP_RAYS


def _shadows(world: World, plan: Plan, settings: Settings, patch: float, stats: Statistics) -> Method:
    """Return a shadow method for the light of lamps on patches: a few rays to points on each lamp, right in the mean.
    """
    lights = world.scene.lights
    if plan.shadows == NONE:
        return Unshadowed(len(lights))
    aside = world.glass.aside(settings, extents(lights))
    through = Through(plan.channels, world.glass.passing(aside), None, world.glass.cutouts)
    few = replace(settings, light_samples=_lamp_rays(lights, patch), light_threshold=PART)
    setup = Setup(lights, world.lights.targets(), world.tracer, stats, world.casters, few, {}, through, None)
    method = KINDS["AREA_SAMPLING"].make(setup)
    return Grouped(setup, method, told=False) if len(lights) > FEW_LAMPS else method


class Look:
    """Tells emission, colour and direct light of surfaces to the rays that gather; see `patches.Lit`."""

    def __init__(self, world: World, lighting: Lighting, visibility: Method) -> None:
        """visibility: shadows for the light of lamps on patches."""
        self._world, self._lighting, self._visibility = world, lighting, visibility
        self._check: Callable[[], None] = lambda: None

    def __call__(self, triangle: NDArray[np.int32], P: NDArray[np.float64], N: NDArray[np.float64],
                 lit: bool) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return emission, albedo and direct light, each (n,3), at points P (n,3) of triangles (n,), seen from the side
        of N (n,3). Bumps do not count: they depend on pixels and so on the camera, and patches are wider than they are.
        """
        world, n = self._world, len(P)
        material = np.empty(n, np.int32)
        hits = Hits(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.zeros((n, 2), np.float32), material,
                    np.empty(n, np.int32), np.empty(n, np.bool_), material, world.materials)
        zero = np.zeros(n, np.float32)
        world.surface(None, triangle, zero, zero, P + N * world.surfaces.scale, -N, hits)
        hits = world.look(hits, -N, np.full(n, REFLECTED, np.int8), flat=True)
        m, row = hits.table, hits.row
        returned = albedo.mean(hits, world.textures)
        emission = m.emission[row].copy()
        if world.as_lamps is not None:
            emission[world.as_lamps[triangle]] = 0
        direct = np.zeros((n, 3))
        if lit:
            direct = self._lighting.arriving(hits, -N, self._check, self._visibility)
        return emission, returned, direct


def ahead(world: World, records: Records, camera: Camera, offsets: NDArray[np.float64], part: int, parts: int,
          check: Callable[[], None]) -> None:
    """Compute the records that a coarse view of the picture asks for, so that they are computed many at a time; tiles
    then ask for few that are new.

    offsets (S,2): of the samples in a pixel. part: of `parts` bands of the picture, which threads do side by side.
    """
    x0, y0, x1, y1 = crop = camera.crop or (0, 0, camera.width, camera.height)
    part_of = (x1 - x0) * (y1 - y0) / AHEAD
    every, samples = max(1, round(part_of**0.5)), offsets[:max(1, int(1 / part_of))]
    left, low, right, top = (i // every for i in crop)
    rows = np.linspace(low, max(top, low + 1), parts + 1).astype(int)
    small = replace(camera, width=max(camera.width // every, right), height=max(camera.height // every, top), crop=None)
    box = left, int(rows[part]), max(right, left + 1), int(rows[part + 1])
    origin, direction, reach = camera_rays(small, box, samples)
    normal: NDArray | None = None
    ends: NDArray | None = reach
    share = np.ones(len(origin))  # of a ray's light
    waiting, count = list[tuple[NDArray, ...]](), 0  # places, and how many
    for layer in range(1, LAYERS + 1):
        met, hits = world.closest("camera", origin, direction, normal, ends)
        alpha, direction, share = world.glass.alpha(hits), direction[met], share[met]
        matt = np.flatnonzero((world.materials.kd[hits.material] > 0) & (alpha > 0))
        waiting.append(tuple(a[matt] for a in hits[:8]))
        count += len(matt)
        share *= 1 - alpha
        on = np.flatnonzero(share > world.scene.settings.cutoff)  # straight on, through cut-outs
        last = not len(on) or layer == LAYERS
        if count > ASKED or last:
            columns = zip(Hits._fields, zip(*waiting, strict=True), strict=False)
            found = hits._replace(**{name: np.concatenate(several) for name, several in columns})
            for i in range(0, count, ASKED):
                records(found.at(np.arange(i, min(i + ASKED, count))), check)
            waiting, count = [], 0
        if last:
            break
        origin, direction, normal, ends, share = hits.P[on], direction[on], -hits.Ng[on], None, share[on]
