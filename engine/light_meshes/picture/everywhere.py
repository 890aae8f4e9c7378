"""Light from everywhere in a picture: what is gathered, how finely, and what surfaces are to rays that gather."""

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
from ..rays.geometry import Hits
from ..scene.description import Settings, same
from ..shadows.method import Method, Setup, Through
from ..shadows.registry import KINDS, NONE
from ..shadows.unshadowed import Unshadowed
from ..support.statistics import Statistics
from ..surface import colours, layers, shading
from ..surface.points import REFLECTED
from .lighting import Lighting
from .plan import Plan
from .world import World

FINE = 2.0  # the finest distance of records, in steps h that suit the picture
LEVELS = 6  # that are coarser, each by 2
LAMP_RAYS = 4  # from each point of a patch to each lamp, where there are
FEW_LAMPS = 64  # or fewer; one where there are more
PATCH = 2.0  # the size of the smallest patches, in finest distances


def step(h: float) -> float:
    """Return the finest distance of records where h suits the picture: a power of two, so that it stays when h hardly
    changes.
    """
    return float(2.0 ** np.round(np.log2(FINE * h)))


class Everywhere(NamedTuple):
    """The records of a picture, and of what they were made."""

    records: Records
    world: World
    settings: tuple


def everywhere(world: World, plan: Plan, lighting: Lighting, settings: Settings, h: float, stats: Statistics,
               old: Everywhere | None) -> Everywhere:
    """Return the records of a world, which are computed when they are asked for.

    old: those of the picture before, which are taken over if all that they depend on is the same.
    """
    fine = step(h)
    own = fine, settings.bounces, settings.world_light, settings.refraction, plan.shadows == NONE, plan.channels
    if old and own == old.settings and _alike(world, old.world) and old.records.kept(stats):
        return old._replace(world=world)
    return Everywhere(_records(world, plan, lighting, settings, fine, stats), world, own)


def _alike(new: World, old: World) -> bool:
    """Return whether light from everywhere is the same in both worlds."""
    def flags(world: World) -> list[tuple]:
        return [(o.visible_diffuse, o.visible_shadow) for o in world.scene.objects]

    a, b = new.scene, old.scene
    sees = any(m.program.sees_camera() for m in a.materials)
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
        patches = Patches(field, gather, Look(world, lighting, _shadows(world, plan, settings, stats)),
                          len(world.scene.lights), bool(left.any()), PATCH * fine)
    return Records(field, gather, patches, Nearness(grids, met), fine, settings.bounces)


def _shadows(world: World, plan: Plan, settings: Settings, stats: Statistics) -> Method:
    """Shadows of the lamps' light on patches, by a few rays to points on each lamp: they are right in the mean."""
    lights = world.scene.lights
    if plan.shadows == NONE:
        return Unshadowed(len(lights))
    through = Through(plan.channels, world.glass.factor, None, world.glass.cutouts)
    few = replace(settings, light_samples=LAMP_RAYS if len(lights) <= FEW_LAMPS else 1)
    setup = Setup(lights, world.lights.targets(), world.tracer, stats, world.casters, few, {}, through, None)
    return KINDS["AREA_SAMPLING"].make(setup)


class Look:
    """What surfaces are to rays that gather; see `patches.Lit`."""

    def __init__(self, world: World, lighting: Lighting, visibility: Method) -> None:
        """visibility: shadows for the light of lamps on patches."""
        self._world, self._lighting, self._visibility = world, lighting, visibility
        self._check: Callable[[], None] = lambda: None
        self._layers = any(m.layers for m in world.scene.materials)

    def __call__(self, triangle: NDArray[np.int32], P: NDArray[np.float64], N: NDArray[np.float64],
                 lit: bool) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Emission, albedo and direct light (n,3) at points P (n,3) of triangles (n,), seen from the side of N."""
        world, n = self._world, len(P)
        material = np.empty(n, np.int32)
        hits = Hits(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.zeros((n, 2), np.float32), material,
                    np.empty(n, np.int32), np.empty(n, np.bool_), material, world.materials)
        zero = np.zeros(n, np.float32)
        world.surface(None, triangle, zero, zero, P + N * world.surfaces.scale, -N, hits)
        hits = world.look(hits, -N, np.full(n, REFLECTED, np.int8))
        m, row = hits.table, hits.row
        Od = colours.matt(hits, world.textures)
        shading.dim(m, hits, -N, Od)
        # what mirrors and metals return is taken as if they returned it in all directions
        albedo = m.kd[row, None] * Od + np.maximum(m.mirror[row], m.metal[row, None] * m.F0[row])
        albedo += shading.cloth(m, row)
        for layer in layers.lit(layers.further(hits), -N, world.textures) if self._layers else ():
            own, at = layer.hits.table, layer.hits.row
            albedo[layer.rows] += own.kd[at, None] * layer.Od + np.maximum(
                own.mirror[at], own.metal[at, None] * own.F0[at]) + shading.cloth(own, at)
        emission = m.emission[row].copy()
        if world.as_lamps is not None:
            emission[world.as_lamps[triangle]] = 0
        direct = np.zeros((n, 3))
        if lit:
            direct = self._lighting.arriving(hits, -N, self._check, self._visibility)
        return emission, albedo, direct
