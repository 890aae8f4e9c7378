"""A scene made ready to be rendered. This module puts its parts together; each part is made in a module of its own."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from ..film.numbers import numbers
from ..rays.camera import filter_offsets
from ..scene.description import Camera, Scene
from ..shadows import radius, registry
from ..shadows.casters import Casters
from ..support.statistics import Statistics
from ..surface.curvature import curvature
from ..surface.points import CAMERA
from ..surface.seen import SeenLamps
from . import automatic_step, emitters, everywhere, first, memory, reuse
from .catchers import Alone, alone
from .everywhere import Everywhere
from .lighting import Lighting
from .measured import Measured
from .plan import darkness, plan
from .shadowing import Shadowing, shadowing
from .sparse import Sparse
from .world import World, world


class Before(Protocol):
    """What was prepared before: `Prepared`, or parts of two."""

    world: World
    measured: Measured
    shadowing: Shadowing
    everywhere: Everywhere | None
    alone: Alone | None


class Prepared:
    """A scene made ready: its world, its plan, the shadow method that this asks for, and the lighting."""

    def __init__(self, scene: Scene, passes: Sequence[str] = ("Combined",), *, previous: Before | None = None,
                 camera: Camera | None = None, check: Callable[[], None] = lambda: None, quick: bool = False,
                 told: Callable[[str], None] | None = None) -> None:
        """previous: what was prepared before; all parts of it that are still right are used again. camera: the camera
        of the rays if it is not the scene's; h is measured by the scene's. `check` raises an error to give up. quick:
        the scene was made by `first.direct`, and parts that take long are left out. told(name) is called when a stage
        begins.
        """
        began = time.perf_counter()
        stats, view = Statistics(), camera or scene.camera
        stats.told = told
        radius.check(scene.settings)
        registry.check(scene.settings)
        parts = memory.before(dataclasses.replace(scene, camera=view), passes)
        memory.check(parts)

        bare = world(scene, view, stats, check, previous.world if previous else None, whole=not quick)
        self.world: World = emitters.lit(bare, scene, stats, check)
        scene = self.world.scene  # with the lamps that stand for the world's suns, and for surfaces that give light
        measured = Measured(self.world, previous.measured if previous else None)
        step = automatic_step.automatic(self.world, measured)
        settings = dataclasses.replace(scene.settings, h=step.h, kI=step.kI)
        sharp = step.sharp | measured.pinpoints
        casters = automatic_step.without(self.world.casters, sharp, len(scene.lights))
        self.scene = dataclasses.replace(self.world.scene, settings=settings, camera=view)  # as it is drawn
        self.plan = plan(self.scene, self.world.glass, casters, tuple(passes), step.reason, measured.pinpoints)
        if quick:
            first.plain(self.plan)
        self._say_what_lights(len(scene.lights) - len(bare.scene.lights))
        before = previous.shadowing if previous else None
        self.shadowing: Shadowing = shadowing(self.world, settings, casters, self.plan, measured, stats, before)
        nodes = self.shadowing.method.nodes
        self.soft = next((one for one in nodes if not one.points), None)  # nodes of lights of one width
        if self.soft:
            parts.append(memory.nodes(self.scene, self.world, self.soft.lattice.reach, self.plan.channels))
        parts += memory.shares(self.scene, self.world, nodes)
        self.warnings = [*darkness(scene, self.plan), *self.world.lost, *self.world.unread,
                         *automatic_step.drawn_sharp(scene.lights, step), *self.shadowing.warnings,
                         *memory.check(parts)]
        self.memory = memory.expected(parts)  # in bytes
        self.nodes_kept = reuse.nodes(self.shadowing, before)
        self.lighting = Lighting(self.world, self.plan, self.shadowing.method, passes, stats)
        self._measure_light()
        self.everywhere: Everywhere | None = None
        self.alone: Alone | None = None  # the shadow catchers
        self._gather(measured, sharp, stats, previous)
        self.offsets = filter_offsets(settings.samples, settings.filter_size, self.plan.shares_samples)
        small = bool(scene.lights) and bool(self.world.materials.ggx.any())  # highlights may be smaller than samples
        self.curved = curvature(self.world.surfaces) if small else None
        self.lamps = SeenLamps(scene.lights, self.world.lamps)
        self.numbers = numbers(scene)
        self.sparse = self._sparse(casters, stats)

        self.passes, self.stats = tuple(passes), stats
        stats.told = None
        self.measured: Measured = measured
        self.measured_h = measured.h if settings.auto_h else 0.0
        self.surfaces, self.tracer, self.glass = self.world.surfaces, self.world.tracer, self.world.glass
        self.seconds = time.perf_counter() - began

    def _say_what_lights(self, lamps: int) -> None:
        """Write into the plan what lights the scene beside its lamps. lamps: how many stand for emitting surfaces."""
        for what, value, why in self.world.sky.decisions():
            self.plan.decide(what, value, why)
        if self.world.as_lamps is not None:
            self.plan.decide("emitting surfaces", f"{lamps} lamps",
                             f"for {np.count_nonzero(self.world.as_lamps):,} triangles that give light")

    def _measure_light(self) -> None:
        """Find the light of a usual pixel, if rough surfaces show lamps whose light is shared out by it."""
        if self.plan.shares and self.plan.blurred:
            direction, hits = self.world.coarse_view()
            self.lighting.measure(self.world.look(hits, direction, np.full(len(direction), CAMERA, np.int8)), direction)

    def _gather(self, measured: Measured, sharp: dict[int, float], stats: Statistics, before: Before | None) -> None:
        """Set up light from everywhere, and the light on shadow catchers without other objects, where the plan has
        them. sharp: the lamps with sharp shadows. before: the picture before.
        """
        settings, plan = self.scene.settings, self.plan
        suits = measured.h if settings.auto_h and plan.gathers else settings.h
        if plan.gathers:
            self.everywhere = everywhere.everywhere(self.world, plan, self.lighting, settings, suits, stats,
                                                    before.everywhere if before else None)
            self.lighting.everywhere = self.everywhere.records
        if plan.catchers:
            self.alone = alone(self.world, plan, settings, suits, sharp, measured, stats,
                               before.alone if before else None)

    def _sparse(self, casters: Casters, stats: Statistics) -> Sparse | None:
        """Return what asks for shadows at some pixels only, if the plan has it."""
        nodes, settings = self.shadowing.method.nodes, self.scene.settings
        if self.plan.shadow_rate <= 1 or not nodes:
            return None
        reach = min(settings.kI if one.points else float(one.lattice.reach[0]) for one in nodes)
        return Sparse(self.world, self.lighting, casters, (settings.h, reach), self.offsets, stats)
