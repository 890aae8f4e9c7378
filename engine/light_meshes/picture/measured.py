"""Measurements by the scene's own camera on a coarse grid: the step h that suits it, and radii by the size of lights.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..lights.registry import KINDS
from ..rays.camera import depth
from ..scene.description import same
from ..shadows import lamp_points
from ..shadows.radius import magnified, radius
from ..shadows.registry import KINDS as METHODS
from ..support.bits import has
from ..surface import shading
from .world import World

SMALL = 4  # pixels
ACROSS = 200  # steps in the picture's width, at the median depth


class Measured:
    """The measurements of a scene. Each is made once, when it is asked for."""

    def __init__(self, world: World, old: Measured | None = None) -> None:
        """old: the measurements of the picture before; its h is used again if the view and the surfaces are the same.
        """
        self._world = world
        s = world.scene.settings
        self._h: float | None = s.measured_h if s.auto_h and s.measured_h else None
        if self._h is None and old and _same_view(world, old._world):
            self._h = old.h

    @cached_property
    def h(self) -> float:
        """Return the step that suits what the camera sees."""
        return step(self._world) if self._h is None else self._h

    @cached_property
    def own_radii(self) -> dict[int, float]:
        """Return r, in scene units, of the lights (by number) that have their own; all others have the scene's,
        h·kI.
        """
        lights, weights = self._world.scene.lights, self._world.scene.settings.weights
        own = {i: light.soft_radius for i, light in enumerate(lights) if light.softness == "RADIUS"}
        sized = [i for i, light in enumerate(lights) if light.softness == "LIGHT_SIZE"]
        for i in list(sized):
            if KINDS[lights[i].type].directional and lights[i].reference_distance > 0:
                own[i] = radius(lights[i], lights[i].reference_distance, weights)
                sized.remove(i)
        if sized:
            for i, magnification in zip(sized, _magnifications(self._world, sized), strict=True):
                if magnification is not None:
                    own[i] = radius(lights[i], magnification, weights)
        return own


    @cached_property
    def pinpoints(self) -> dict[int, float]:
        """Return those lamps of softness SIZE, by number, whose shadows have no edge as wide as a pixel in a coarse
        view of the picture, and how many pixels the widest has.

        Only lamps are looked at that are smaller than SMALL pixels, and only where nodes would answer for them.
        """
        world, camera = self._world, self._world.scene.camera
        lights = world.scene.lights
        sized = [i for i, light in enumerate(lights) if light.softness == "SIZE" and light.cast_shadow]
        if not sized or not METHODS[world.scene.settings.shadows].lattice:
            return {}
        pixel = (self._h or step(world)) * ACROSS / max(camera.width, camera.height)
        wide = 2 * lamp_points.reaches(lamp_points.shapes(lights))
        small = [i for i in sized if 0 < wide[i] * (
            2 * world.surfaces.scale if KINDS[lights[i].type].directional else 1) < SMALL * pixel]
        found = zip(small, _magnifications(world, small, most=True) if small else [], strict=True)
        return {i: width for i, most in found if (width := wide[i] * (most or 0.0) / pixel) < 1}


def _same_view(world: World, old: World) -> bool:
    """Return whether the old world's h was measured, in the same view of the same surfaces."""
    before = old.scene.settings
    return (before.auto_h and not before.measured_h and world.surfaces is old.surfaces
            and same(world.scene.camera, old.scene.camera)
            and [o.visible_camera for o in world.scene.objects] == [o.visible_camera for o in old.scene.objects])


def step(world: World) -> float:
    """Return a step h that suits what the camera sees: 1/200 of the picture's width at the median visible depth.

    The median over the picture is not moved by a far horizon or a large ground; a backdrop or a sky behind a gap of
    16 times the distance does not count. Two digits, so that it reads well.
    """
    camera = world.scene.camera
    _, hits = world.coarse_view()
    left, right, bottom, top = camera.window
    width = max(abs(right - left), abs(top - bottom))
    if len(hits.P) == 0:  # nothing is in view
        width = world.surfaces.scale
    elif camera.perspective:
        near = np.sort(depth(camera, hits.P))
        gaps = np.flatnonzero(near[1:] > 16 * near[:-1])
        gaps = gaps[gaps >= len(near) // 20]  # the things before the gap are more than a blade of grass
        width *= float(np.median(near[:gaps[0] + 1] if len(gaps) else near))
    return float(f"{max(width / ACROSS, 1e-30):.1e}")


def _magnifications(world: World, numbers: list[int], most: bool = False) -> list[float | None]:
    """Return the median (or the largest) of a/(L − a) over a coarse grid of the camera's view; for a SUN that of a;
    None if it cannot be measured.

    With a reference distance, a is this distance and L the median way to the surfaces on which the light shines.
    Otherwise both are measured where something blocks the light.
    """
    lights = tuple(world.scene.lights[i] for i in numbers)
    if most:
        lights = tuple(replace(light, reference_distance=0.0) for light in lights)
    arrays = shading.light_arrays(lights)
    targets = arrays.targets()
    direction, hits = world.coarse_view()
    n, owner = len(hits.P), world.owner(hits.triangle)
    shines = np.zeros((n, (len(lights) + 63) // 64), np.uint64)
    shading.reaching(shading.Lit(arrays, world.materials, hits, direction, np.zeros((n, 3))), True, shines)
    found: list[float | None] = []
    for k, light in enumerate(lights):
        on = has(shines.T, k)
        if light.receivers is not None:
            on &= np.isin(owner, light.receivers)
        if world.casters.receives is not None:
            on &= world.casters.receives[hits.triangle]
        P, N = hits.P[on], hits.Ng[on]
        way = np.broadcast_to(targets.position[k], P.shape) - (0 if targets.directional[k] else P)
        length = np.sqrt((way * way).sum(1))
        if light.reference_distance > 0:
            values = np.array([magnified(light.reference_distance, np.median(length))] if len(P) else [])
        elif (casters := _blockers(world, numbers[k])) is None:
            values = np.zeros(0)
        else:
            hit, blocker = world.closest("opaque", P, way / length[:, None], N,
                                         None if targets.directional[k] else length, casters)
            a: NDArray = np.sqrt(((blocker.P - P[hit]) ** 2).sum(1))
            values = a if targets.directional[k] else magnified(a, length[hit])
        found.append(float(np.max(values) if most else np.median(values)) if len(values) else None)
    return found


def _blockers(world: World, light: int) -> int | None:
    """Return the casters of the light's soft shadows, or of all its shadows if none is soft; None if it has no
    shadows.
    """
    groups = (*world.casters.soft, *world.casters.whole)
    return next((g.casters for g in groups if has(g.lights, light)), None)
