"""Which triangles cast shadows in which light, and which of these shadows are soft: V = V_sharp casters · S_soft
casters (method §4).

A surface casts or receives soft shadows if its object and its material both allow it. A light may have its own
blockers. Lights with the same casters are traced together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Surfaces
from ..scene.description import Light, Scene
from ..scene.errors import SceneError
from ..support.bits import mask_of
from .radius import extent

# the largest number of sets; each needs an accelerator or more, and Embree's wrapper fails beyond a thousand
MOST = 100


class Group(NamedTuple):
    """Lights that have the same casters."""

    lights: NDArray[np.uint64]  # (W,) bits
    casters: int  # row of Casters.sets


class Casters(NamedTuple):
    """The shadows of a scene. Lights that cast no shadows are in no group."""

    sets: tuple[NDArray[np.bool_], ...]  # (T,) each: the triangles in the set; the first set has all
    whole: tuple[Group, ...]  # everything that casts shadows in a light
    soft: tuple[Group, ...]  # the casters of soft shadows, for lights with soft shadows
    sharp: tuple[Group, ...]  # the other casters of the lights in `soft`
    receives: NDArray[np.bool_] | None  # (T,) surfaces that receive soft shadows; None: all do
    dims: int  # row of `sets`: soft casters of any light; in PAPER their glass weights the nodes behind it


def union(groups: tuple[Group, ...], count: int) -> NDArray[np.uint64]:
    """Return the lights of all groups as bits."""
    words = mask_of([], count)
    for group in groups:
        words |= group.lights
    return words


def kept(casters: Casters, lights: NDArray[np.uint64]) -> Casters:
    """Return `casters` with soft shadows of `lights` (W,) only."""
    def left(groups: tuple[Group, ...]) -> tuple[Group, ...]:
        those = (g._replace(lights=g.lights & lights) for g in groups)
        return tuple(g for g in those if g.lights.any())

    return casters._replace(soft=left(casters.soft), sharp=left(casters.sharp))


def smooth_lights(casters: Casters, lights: int) -> NDArray[np.uint64]:
    """Return the lights (W,) that cast no sharp shadow on surfaces that receive soft ones."""
    shadows, sharp = union(casters.whole, lights), union(casters.sharp, lights)
    return mask_of(range(lights), lights) & ~(shadows & ~union(casters.soft, lights)) & ~sharp


def casters(scene: Scene, surfaces: Surfaces, bent: NDArray[np.bool_], soft_shadows: bool, radii: bool) -> Casters:
    """Return which triangles cast shadows in which light. `bent` (T,): triangles that refract shadow rays.

    `soft_shadows`: whether the shadow method has soft shadows; `radii`: whether it lets each light have its own radius.
    """
    owner = scene.geometry.instance_object[surfaces.instance]
    material = surfaces.materials[surfaces.source]

    def agreed(name: str) -> NDArray[np.bool_]:
        return (np.array([getattr(o, name) for o in scene.objects], np.bool_)[owner]
                & np.array([getattr(m, name) for m in scene.materials], np.bool_)[material])

    casts = np.array([o.visible_shadow for o in scene.objects], np.bool_)[owner]
    softly, receives = agreed("cast_soft_shadows"), agreed("receive_soft_shadows")
    # Refracted paths treat a body of glass as one object: it is sharp as a whole if a part of it is.
    torn = surfaces.instance[bent & ~softly]
    if len(torn):
        softly &= ~(bent & np.isin(surfaces.instance, torn))

    numbers: dict[bytes, int] = {casts.tobytes(): 0}
    sets = [np.ones(len(casts), np.bool_)]
    parts: dict[tuple[int, ...] | None, list[int]] = {}
    found: tuple[dict[int, list[int]], ...] = {}, {}, {}  # whole, soft, sharp: casters → lights
    for i, light in enumerate(scene.lights):
        if not (light.cast_shadow and any(light.intensity)):
            continue
        if light.blockers not in parts:
            blocks = casts if light.blockers is None else casts & np.isin(owner, light.blockers)
            parts[light.blockers] = [_number(part, numbers, sets) for part in
                                     (blocks, blocks & softly, blocks & ~softly)]
        soft = soft_shadows and _soft(light, radii) and receives.any() and parts[light.blockers][1] >= 0
        for kind, part in zip(found, parts[light.blockers], strict=True):
            if part >= 0 and (kind is found[0] or soft):
                kind.setdefault(part, []).append(i)
    count = len(scene.lights)
    whole, soft_part, sharp_part = (
        tuple(Group(mask_of(lights, count), part) for part, lights in kind.items()) for kind in found)
    dims = _number(casts & softly, numbers, sets) if scene.settings.glass == "PAPER" and soft_part else 0
    return Casters(tuple(sets), whole, soft_part, sharp_part, None if receives.all() else receives, dims)


def _number(part: NDArray[np.bool_], numbers: dict[bytes, int], sets: list[NDArray[np.bool_]]) -> int:
    """Return the row of `sets` for these triangles, which is added if it is new; −1 if there are none."""
    if not part.any():
        return -1
    number = numbers.setdefault(part.tobytes(), len(sets))
    if number == MOST:
        raise SceneError(f"the lights' shadow links make more than {MOST} different sets of objects that cast shadows: "
                         f"let more lights share a collection of blockers")
    if number == len(sets):
        sets.append(part)
    return number


def _soft(light: Light, radii: bool) -> bool:
    """Return whether the artist lets the light have soft shadows, and gives it a radius; the shadows of a point are
    sharp.
    """
    if radii and light.softness != "SCENE":
        return light.soft_shadows and (light.soft_radius if light.softness == "RADIUS" else extent(light)) > 0
    return light.soft_shadows
