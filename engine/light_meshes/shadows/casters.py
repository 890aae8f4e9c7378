"""Which triangles shadow which light, and which of them softly: V = V_sharp casters · S_soft casters (method §4).

A surface casts and receives soft shadows where its object and its material both say so. A light may have blockers of
its own. Lights that the same triangles shadow are traced together.
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

MOST = 100  # sets; each is an accelerator or more, and Embree's wrapper fails beyond a thousand


class Group(NamedTuple):
    """Lights that the same triangles shadow."""

    lights: NDArray[np.uint64]  # (W,) bits
    casters: int  # row of Casters.sets


class Casters(NamedTuple):
    """The shadows of a scene. Lights that nothing shadows are in no group."""

    sets: tuple[NDArray[np.bool_], ...]  # (T,) each: which triangles; the first has all
    whole: tuple[Group, ...]  # all that shadows a light
    soft: tuple[Group, ...]  # the part that does so softly, of lights with soft shadows
    sharp: tuple[Group, ...]  # the rest of what shadows the lights in `soft`
    receives: NDArray[np.bool_] | None  # (T,) surfaces that soft shadows fall on; None: all do
    dims: int  # row of `sets`: soft casters of any light, whose glass weighs the nodes behind it in PAPER


def union(groups: tuple[Group, ...], count: int) -> NDArray[np.uint64]:
    """The lights of all groups, as bits."""
    words = mask_of([], count)
    for group in groups:
        words |= group.lights
    return words


def kept(casters: Casters, lights: NDArray[np.uint64]) -> Casters:
    """`casters` with soft shadows of `lights` (W,) only."""
    def left(groups: tuple[Group, ...]) -> tuple[Group, ...]:
        those = (g._replace(lights=g.lights & lights) for g in groups)
        return tuple(g for g in those if g.lights.any())

    return casters._replace(soft=left(casters.soft), sharp=left(casters.sharp))


def smooth_lights(casters: Casters, lights: int) -> NDArray[np.uint64]:
    """The lights (W,) with no sharp shadow on surfaces that take soft ones."""
    shadows, sharp = union(casters.whole, lights), union(casters.sharp, lights)
    return mask_of(range(lights), lights) & ~(shadows & ~union(casters.soft, lights)) & ~sharp


def casters(scene: Scene, surfaces: Surfaces, bent: NDArray[np.bool_], soft_shadows: bool, radii: bool) -> Casters:
    """Who shadows whom; bent (T,): triangles that refract shadow rays.

    soft_shadows: the shadow method has them; radii: and by it each light may have a radius of its own.
    """
    owner = scene.geometry.instance_object[surfaces.instance]
    material = surfaces.materials[surfaces.source]

    def agreed(name: str) -> NDArray[np.bool_]:
        return (np.array([getattr(o, name) for o in scene.objects], np.bool_)[owner]
                & np.array([getattr(m, name) for m in scene.materials], np.bool_)[material])

    casts = np.array([o.visible_shadow for o in scene.objects], np.bool_)[owner]
    softly, receives = agreed("cast_soft_shadows"), agreed("receive_soft_shadows")
    # A body of glass is one thing to refracted paths: sharp as a whole where a part of it is.
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
    """The row of `sets` for these triangles, added where it is new; −1 for none."""
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
    """Whether the artist lets the light have soft shadows, and gives it a radius: that of a point is sharp."""
    if radii and light.softness != "SCENE":
        return light.soft_shadows and (light.soft_radius if light.softness == "RADIUS" else extent(light)) > 0
    return light.soft_shadows
