"""The automatic step: h from what the camera sees, finer if the radius of a light needs it.

A small radius must not make the step so fine that a picture takes for ever. Below a limit the light's shadows are drawn
sharp; the edge would be so narrow that nobody can see the difference. The result depends only on the scene and its
camera, not on the size of the picture, on tiles, or on earlier renders.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ..scene.description import Light
from ..shadows.casters import Casters, Group, union
from ..shadows.radius import EVEN, MOST
from ..shadows.registry import KINDS
from ..support.bits import has, mask_of
from .measured import Measured
from .world import World

SEEN = 70_000  # about how many squares of such a step a picture shows: 200 × 113, and more on slanted surfaces
NODES = 3_000_000  # the step gets no finer than about this many nodes allow
NODE = 24  # bytes of a node; if a node has more, fewer nodes are allowed
LEAST = 1.5**0.5  # in steps: with a smaller radius some points of a plane find no node
WIDE = 5  # in steps: the step gets no finer than this part of the largest radius, unless the smallest one needs it
WIDEST = 8  # in steps: the step never gets finer than this part of the largest radius


class Step(NamedTuple):
    """The step for the lights with soft shadows."""

    h: float
    kI: float  # h·kI is the scene's r, whatever h is
    sharp: dict[int, float]  # lights whose shadows are sharp because their r (the value, scene units) is too small
    reason: str  # why h is not the one that the camera alone would give; "" if it is


def automatic(world: World, measured: Measured) -> Step:
    """Return the step for lights with these radii. The camera alone would give `measured.h`. If the artist gave h,
    return the scene's step.
    """
    scene, settings = world.scene, world.scene.settings
    if not settings.auto_h:
        return Step(settings.h, settings.kI, {}, "")
    h, kI = measured.h, settings.kI
    lights, soft = scene.lights, union(world.casters.soft, len(scene.lights))
    if not KINDS[settings.shadows].lattice or not world.casters.soft:
        return Step(h, kI, {}, "")
    r = {i: measured.own_radii.get(i, h * kI) for i in range(len(lights)) if has(soft, i)}
    if min(r.values()) >= EVEN * h and max(r.values()) <= MOST * h:
        return Step(h, kI, {}, "")
    largest = max(r.values())
    finest = min(h, max((SEEN / NODES * h * h * largest * max(1.0, _bytes(world) / NODE))**(1 / 3), largest / WIDEST))
    sharp = {i: x for i, x in r.items() if x < LEAST * finest}
    rest = {i: x for i, x in r.items() if i not in sharp}
    if not rest:
        return Step(h, kI, sharp, "")
    least = min(rest, key=lambda i: (rest[i], i))
    smallest = rest[least]
    if smallest >= EVEN * h:
        new = max(h, min(smallest / max(kI, EVEN), largest / MOST))
    else:
        new = max(smallest / max(kI, EVEN), min(largest / WIDE, smallest / EVEN), finest)
    why = "" if new == h else (f"{'finer' if new < h else 'coarser'} than the {h:g} that suits the picture, for the "
                               f"radius {smallest:.3g} of '{lights[least].name}'")
    return Step(new, h * kI / new, sharp, why)


def _bytes(world: World) -> float:
    """Return the bytes that a node takes."""
    count, glass = len(world.scene.lights), world.glass
    values = 4 * count * (3 if glass.coloured else 1) if glass.lets_through.any() else count / 8
    return 16 + values


def without(casters: Casters, lights: dict[int, float], count: int) -> Casters:
    """Return `casters` in which the shadows of `lights`, out of `count`, are sharp."""
    if not lights:
        return casters
    others = ~mask_of(lights, count)

    def left(groups: tuple[Group, ...]) -> tuple[Group, ...]:
        kept = (g._replace(lights=g.lights & others) for g in groups)
        return tuple(g for g in kept if g.lights.any())

    return casters._replace(soft=left(casters.soft), sharp=left(casters.sharp))


def drawn_sharp(lights: Sequence[Light], step: Step) -> list[str]:
    """Return a sentence for each light that has sharp shadows instead."""
    return [f"light '{lights[i].name}': its shadows are drawn sharp, as the radius {r:.3g} of their edges "
            f"is too small for the steps that suit this picture: take a larger radius or light, or set a step h of "
            f"{r / EVEN:.2g} by hand" for i, r in step.sharp.items()]
