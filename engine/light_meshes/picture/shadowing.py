"""The shadows of a picture, made ready: the method that the plan asks for, and everything that it needs."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..glass.refraction import RefractedPaths
from ..rays.tracer import Targets
from ..scene.description import Settings
from ..shadows import radius as light_size
from ..shadows.casters import Casters, union
from ..shadows.grouped import Grouped
from ..shadows.meshes.averaging import classes
from ..shadows.meshes.certificate import Certificate, certificate
from ..shadows.meshes.lattice import lattice
from ..shadows.method import LatticeSetup, Method, Refraction, Setup, Through
from ..support.bits import has
from ..support.statistics import Statistics
from .footprints import Footprints, footprints
from .measured import Measured
from .plan import Plan
from .world import World


class Certify:
    """Makes the certificates of a picture, one for each radius in which nothing but a receiver's own body is near."""

    def __init__(self, world: World, stats: Statistics, old: Certify | None) -> None:
        """old: those of the picture before; its certificates are used again if surfaces and casters are the same."""
        self._world, self._stats, self._before = world, stats, old._made if old else {}
        self._made: dict[float, Certificate | None] = {}
        self._making = threading.Lock()

    @cached_property
    def casts(self) -> NDArray[np.bool_]:
        """Return the triangles (T,) that shadow rays may meet."""
        casts = np.array([o.visible_shadow for o in self._world.scene.objects], np.bool_)
        return casts[self._world.owner(np.arange(len(self._world.surfaces.triangles), dtype=np.int32))]

    def __call__(self, r: float) -> Certificate | None:
        """Return the certificate for this radius; None: there are no bodies. Several threads may ask."""
        with self._making:
            if r not in self._made:
                with self._stats.stage("certificate"):
                    self._made[r] = self._taken(r) or certificate(self._world.surfaces, self.casts, r)
            return self._made[r]

    def _taken(self, r: float) -> Certificate | None:
        before = self._before.get(r)
        same = before and before.surfaces is self._world.surfaces and np.array_equal(before.casts, self.casts)
        return before if same else None


@dataclass(frozen=True, eq=False)
class Shadowing:
    """A shadow method, and the data from which it was made; the next picture compares its own data with these."""

    world: World
    settings: Settings  # with the step h and kI that are used
    casters: Casters
    targets: Targets  # of the lights
    method: Method
    channels: int  # of values at nodes, as `Plan.channels`
    paths: bool  # shadow paths bend
    refraction: Refraction | None
    aside: bool  # what glass turns aside of straight rays is missing
    certificate: Certificate | None  # of lights of one width
    certify: Certify
    radii: dict[int, float]  # r of lights that have their own
    warnings: list[str]

    @cached_property
    def footprints(self) -> Footprints:
        """Return the shadow casters in the form in which the next picture compares them with its own."""
        return footprints(self.world, self.channels)

    def path_warnings(self) -> list[str]:
        """Return, after a render, one sentence for each light that was not followed through all the glass in its
        way.
        """
        solvers = list(self.refraction.solvers.values()) if self.refraction else []
        lights = self.world.scene.lights
        most = [min((n for solver in solvers if (n := solver.lost(i))), default=0) for i in range(len(lights))]
        return [f"light '{light.name}': it was followed through {n} bends only, so many surfaces of glass stand in its "
                f"way or scatter it; behind more of them it falls straight through"
                for light, n in zip(lights, most, strict=True) if n]


def shadowing(world: World, settings: Settings, casters: Casters, plan: Plan, measured: Measured, stats: Statistics,
              old: Shadowing | None) -> Shadowing:
    """Make the method of `plan`. settings: with the step that is used; casters: those that are soft with it.

    old: of the picture before, of which what is still right is taken over; nodes are not, see `reuse`.
    """
    targets = world.lights.targets()
    refraction = _refraction(world, settings, casters, targets, old) if plan.paths else None
    aside = world.glass.aside(settings, light_size.extents(world.scene.lights))
    through = Through(plan.channels, world.glass.passing(aside), refraction, world.glass.cutouts)
    certify = Certify(world, stats, old.certify if old else None)
    of_lattice: LatticeSetup | None = None
    radii: dict[int, float] = {}
    warnings: list[str] = []
    if plan.kind.lattice:
        of_lattice, radii, warnings = _lattice(world, settings, casters, plan, measured, certify)
    own = plan.kind.own(settings if plan.shadows == settings.shadows else Settings())  # the plan may need no more
    setup = Setup(world.scene.lights, targets, world.tracer, stats, casters, settings, own, through, of_lattice)
    method = plan.kind.make(setup)
    if plan.threshold:
        method = Grouped(setup, method)
    proof = of_lattice.certificate if of_lattice else None
    return Shadowing(world, settings, casters, targets, method, plan.channels, plan.paths, refraction,
                     aside is not None, proof, certify, radii, warnings)


def _lattice(world: World, s: Settings, casters: Casters, plan: Plan, measured: Measured,
             certify: Certify) -> tuple[LatticeSetup, dict[int, float], list[str]]:
    """Return the lattice, with a class of lights a radius; r of lights that have one of their own; and warnings."""
    lights, own = world.scene.lights, measured.own_radii
    soft = union(casters.soft, len(lights))
    steps, warnings = light_size.steps(lights, s, own)
    warnings += light_size.small(lights, soft, s, steps, measured.h)
    radii = {i: float(f"{s.h * steps[i]:.9g}") for i in own if has(soft, i)}
    # there are none if the plan was forced
    reach = np.unique([step for i, step in enumerate(steps) if has(soft, i)] or [s.kI])
    nodes = lattice(s.h, reach, s.lattice_rotation, s.lattice_origin)
    one_width = any(has(soft, i) and light.softness != "SIZE" for i, light in enumerate(lights))
    proof = certify(s.h * float(reach[-1])) if plan.certificate and one_width else None
    if plan.certificate and one_width and proof is None:
        plan.reasons["certificate"] = "off: no object is convex, no surface plane"
    ring = np.searchsorted(reach, np.minimum(steps, reach[-1]))
    found = LatticeSetup(nodes, classes(ring, s.h * reach, soft), proof, plan.uniform_skip, world.surfaces,
                         certify if plan.certifies_lamps else None)
    return found, radii, warnings


def _refraction(world: World, s: Settings, casters: Casters, targets: Targets,
                old: Shadowing | None) -> Refraction | None:
    """Return how shadow paths bend; None: what bends blocks no light."""
    solvers: dict[int, RefractedPaths] = {}
    if old and old.refraction and _same_paths(world, s, casters, targets, old):
        solvers = old.refraction.solvers
    else:
        for n in sorted({g.casters for g in (*casters.whole, *casters.soft, *casters.sharp)}):
            media = world.glass.media(casters.sets[n])
            if media.solid.any():
                solvers[n] = RefractedPaths(world.surfaces, media, targets, world.tracer, s.h, n, s.caustics == "FOCUS")
    return Refraction(solvers, s.h / 2 if s.caustics == "FOCUS" else None, s.leak_free) if solvers else None


def _same_paths(world: World, s: Settings, casters: Casters, targets: Targets, old: Shadowing) -> bool:
    """Return whether the refracted paths' beams, by sets of casters, are those of the old picture."""
    sets, before = casters.sets, old.casters.sets
    return (world.glass is old.world.glass and s.h == old.settings.h and s.caustics == old.settings.caustics
            and all(np.array_equal(a, b) for a, b in zip(targets, old.targets, strict=True))
            and len(sets) == len(before) and all(np.array_equal(a, b) for a, b in zip(sets, before, strict=True)))
