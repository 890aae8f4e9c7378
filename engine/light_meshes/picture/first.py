"""The first pictures of a view: direct light alone, with sharp shadows, before all that takes longer is computed.

They are only shown until the picture that was asked for has come. What they have in common with it is kept for it:
triangles, accelerators, textures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..rays.camera import coarser
from ..scene.description import Camera, Light, Scene
from ..shadows.registry import NONE
from .plan import Plan

COARSE, COARSEST = 8, 16  # the divisor of the resolution of the first picture; of one with many lamps
PAIRS = 200_000  # a receiver and a lamp are a pair; the first picture has no more, if fewer lamps will do
LATER_PAIRS = 3_000_000  # the same of the pictures after it
FEWEST = 16  # lamps that are not made fewer
DEPTH = 1  # reflections that are followed


def divisor(scene: Scene, camera: Camera) -> int:
    """Return the divisor of the resolution for the first picture of a scene by `camera`."""
    return COARSE if _pixels(camera, COARSE) * len(scene.lights) <= PAIRS else COARSEST


def lacks(scene: Scene, camera: Camera) -> bool:
    """Return whether a picture of direct light lacks something of the picture that was asked for that may take long."""
    return (scene.settings.gathers or _pixels(camera, COARSE) * len(scene.lights) > PAIRS
            or any(light.softness == "SIZE" for light in scene.lights)
            or any(m.blurred or m.frosted > 0 or "frosted" in m.program.values for m in scene.materials))


def direct(scene: Scene, camera: Camera, divisor: int, pairs: int) -> Scene:
    """Return the scene with little but direct light, for a picture by `camera` whose resolution is divided by
    `divisor`.

    All shadows are sharp, and a world that lights by its sky lights evenly. If there were more than `pairs` pairs of a
    pixel and a lamp, neighbouring lamps are joined. The plan of such a scene must go through `plain`.
    """
    s = scene.settings
    most = max(FEWEST, pairs // _pixels(camera, divisor))
    return replace(scene, lights=fewer(scene.lights, most), settings=replace(
        s, samples=1, shadow_rate=1, max_depth=min(s.max_depth, DEPTH), world_light="AMBIENT",
        ambient=1.0 if s.by_sky else s.ambient, shadows=s.shadows if s.shadows == NONE else "SHARP", method=None))


def plain(plan: Plan) -> None:
    """Remove from a plan what takes long: light from everywhere, and the rays that rough surfaces spread out."""
    plan.gathers = plan.follows = plan.frosted = plan.spreads = False


def _pixels(camera: Camera, divisor: int) -> int:
    small = coarser(camera, divisor)
    return small.width * small.height


def fewer(lights: tuple[Light, ...], most: int) -> tuple[Light, ...]:
    """Return these lights, or about `most` if there are more and many are alike.

    Neighbouring point lights become one, with the sum of their power, in their middle. Lights that have nodes, links or
    no shadow stay as they are.
    """
    alike = [light.type == "POINT" and light.cast_shadow and light.diffuse and not light.program
             and light.receivers is None and light.blockers is None for light in lights]
    points = [light for light, one in zip(lights, alike, strict=True) if one]
    rest = [light for light, one in zip(lights, alike, strict=True) if not one]
    wanted = max(FEWEST, most - len(rest))
    return lights if len(lights) <= most or len(points) <= wanted else (*rest, *_joined(points, wanted))


def _joined(lights: Sequence[Light], most: int) -> list[Light]:
    """Return n points of light, joined to more than most/2 and at most `most` points."""
    position, intensity = (np.array([getattr(light, name) for light in lights]) for name in ("position", "intensity"))
    groups = [np.arange(len(lights))]
    while 2 * len(groups) <= most:  # divided where they are widest, at the median
        halves = []
        for group in groups:
            axis = np.argmax(np.ptp(position[group], axis=0))
            order = group[np.argsort(position[group, axis], kind="stable")]
            halves += [half for half in (order[:len(order) // 2], order[len(order) // 2:]) if len(half)]
        groups = halves
    power = intensity.sum(1) + 1e-300
    return [replace(lights[group[0]], softness="SCENE", intensity=tuple(intensity[group].sum(0).tolist()),
                    position=tuple(np.average(position[group], axis=0, weights=power[group]).tolist()))
            for group in groups]
