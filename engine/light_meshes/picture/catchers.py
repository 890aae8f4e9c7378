"""Shadow catchers: how much of their light the other objects leave them.

As in Cycles, this is the light that arrives there, from lamps and from everywhere, divided by what would arrive if the
catchers were alone in the scene. So a catcher's shadow on another catcher is not seen, and surfaces that give light
make no catcher darker.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits
from ..scene.description import Scene, Settings
from ..shadows.method import Check
from ..shadows.registry import NONE
from ..support.statistics import Statistics
from ..surface import shading
from . import automatic_step, everywhere
from .everywhere import Everywhere
from .lighting import Lighting
from .measured import Measured
from .plan import Plan
from .shadowing import shadowing
from .world import World, blockers

PLANE = 1e-5  # catchers that are no thicker than this share of the scene's size cast no shadows on each other


@dataclass(frozen=True, eq=False)
class Alone:
    """A scene's shadow catchers without its other objects."""

    lighting: Lighting
    everywhere: Everywhere | None

    def ratio(self, lighting: Lighting, hits: Hits, direction: NDArray[np.float64], check: Check,
              work: NDArray | None = None) -> NDArray[np.float64]:
        """Return the share (n,1) of the light at hits of catchers that the other objects leave: the mean over the
        channels in which light arrives without them, at most 1. It is 1 where there are no such channels. lighting: of
        the whole scene. `work` is as in `Lighting.direct`.
        """
        lit = lighting.caught(hits, direction, check, work)
        more = None if work is None else np.zeros_like(work)
        full = self.lighting.caught(hits, direction, check, more)
        if work is not None:
            work += more
        there = full > 0
        left = (lit / np.where(there, full, 1) * there).sum(1, keepdims=True)
        channels = there.sum(1, keepdims=True)
        return np.where(channels > 0, np.clip(left / np.maximum(channels, 1), 0, 1), 1.0)


def alone(world: World, plan: Plan, settings: Settings, h: float, sharp: dict[int, float], measured: Measured,
          stats: Statistics, old: Alone | None) -> Alone:
    """Return the shadow catchers of a world without its other objects. settings, h: as for the light of the whole
    scene; sharp: the lamps that have sharp shadows there. old: those of the picture before.
    """
    bare = _catchers_only(world)
    plan = dataclasses.replace(plan, paths=False)  # what bends light is not there, unless a catcher does
    if plan.shadows == NONE or _plane(bare):
        plan = dataclasses.replace(plan, shadows=NONE, threshold=False)
    who = automatic_step.without(bare.casters, sharp, len(bare.scene.lights))
    lighting = Lighting(bare, plan, shadowing(bare, settings, who, plan, measured, stats, None).method, (), stats)
    around = None
    if plan.gathers:
        around = everywhere.everywhere(bare, plan, lighting, settings, h, stats, old.everywhere if old else None)
        lighting.everywhere = around.records
    return Alone(lighting, around)


def _catchers_only(world: World) -> World:
    """Return the world in which only shadow catchers block light, and no other surface gives any."""
    lights, first = list(world.scene.lights), len(world.scene.lights) - len(world.lamp_objects)
    for i, ob in enumerate(world.lamp_objects, first):
        if not world.scene.objects[ob].shadow_catcher:
            lights[i] = dataclasses.replace(lights[i], intensity=(0.0, 0.0, 0.0))
    scene: Scene = dataclasses.replace(world.scene, lights=tuple(lights), objects=tuple(
        o if o.shadow_catcher else dataclasses.replace(o, visible_diffuse=False, visible_shadow=False)
        for o in world.scene.objects))
    who, tracer = blockers(scene, world.surfaces, world.glass, world.tracer)
    return dataclasses.replace(world, scene=scene, casters=who, tracer=tracer,
                               lights=shading.light_arrays(scene.lights))


def _plane(bare: World) -> bool:
    """Return whether all that casts shadows lies in one plane, so that none falls on it."""
    casts = np.array([o.visible_shadow for o in bare.scene.objects], np.bool_)
    s = bare.surfaces
    corners = s.vertices[s.triangles[casts[bare.owner(np.arange(len(s.triangles), dtype=np.int32))]]].astype(np.float64)
    if not len(corners):
        return True
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    largest = int(np.argmax((cross * cross).sum(1)))
    normal = cross[largest] / np.linalg.norm(cross[largest])
    return bool((np.abs((corners - corners[largest, 0]) @ normal) <= PLANE).all())
