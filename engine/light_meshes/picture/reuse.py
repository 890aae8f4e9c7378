"""Nodes that a picture takes over from the one before it: those that are still right, so that no bit changes.

What else is taken over is decided where it is made: `world`, `measured`, `shadowing`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel
from .footprints import casting, changed
from .shadowing import Shadowing
from .world import World

_forget = kernel("reuse_forget")
# Nodes are dropped before the next picture if they need more bytes than the first number, or more than the second and
# there are as many as so many pictures added at most: a camera flight must not fill the memory.
KEPT_BYTES, SMALL_BYTES, KEPT_PICTURES = 1 << 30, 16 << 20, 4


def nodes(new: Shadowing, old: Shadowing | None) -> int:
    """Take over the nodes' values that are still valid; return how many nodes have some.

    A value belongs to a node and a light. It stays valid unless the light changed, or the segment between them may meet
    the box of a caster that came, went or changed.
    """
    if not (old and old.method.nodes and new.method.nodes):
        return 0
    kept, store, world, before = new.method.nodes, old.method.nodes.store, new.world, old.world
    store.end_picture()
    enough = SMALL_BYTES if store.count > KEPT_PICTURES * store.largest else KEPT_BYTES
    if store.bytes > enough or _store_key(new) != _store_key(old):
        return 0
    store.mend()
    unchanged = world.glass is before.glass and casting(world.scene) == casting(before.scene) and (
        _soft(world) == _soft(before))
    boxes = np.zeros((0, 2, 3)) if unchanged else changed(new.footprints, old.footprints)
    source = _columns(new, old)
    lights = len(world.scene.lights)
    if not len(boxes) and lights == len(before.scene.lights) and (source == np.arange(len(source))).all():
        kept.take(old.method.nodes)
    elif new.paths:
        return 0
    else:
        lattice = old.method.nodes.lattice
        kept.store.inherit(store, source,
                           lambda nodes, known: _forget_near(before, lattice.position(nodes), boxes, known))
        kept.store.largest = store.largest
    return kept.store.count


def _store_key(shadowing: Shadowing) -> tuple:
    """Return everything on which all values of a store depend: the lattice (not r), the tracer's frame, and the kind of
    value.
    """
    s, surfaces = shadowing.settings, shadowing.world.surfaces
    key = (s.h, s.lattice_rotation, s.lattice_origin, surfaces.centre.tolist(), surfaces.scale, shadowing.channels,
           surfaces.reach > 1)
    refraction = shadowing.refraction
    return (*key, s.caustics, s.leak_free, *map(id, refraction.solvers.values())) if refraction else key


def _soft(world: World) -> list[bool]:
    """Return which materials cast soft shadows."""
    return [m.cast_soft_shadows for m in world.scene.materials]


def _columns(new: Shadowing, old: Shadowing) -> NDArray[np.int32]:
    """Return for each new light the old one with the same values at nodes (as far as casters are the same), or −1."""
    ways: dict[tuple, list[int]] = {}
    for i in range(len(old.world.scene.lights)):
        ways.setdefault(_column_key(old, i), []).append(i)
    source = np.full(max(1, len(new.world.scene.lights)), -1, np.int32)
    for i in range(len(new.world.scene.lights)):
        equal = ways.get(_column_key(new, i))
        if equal:  # if several are equal the first is used, but the last one may be used again
            source[i] = equal.pop(0) if len(equal) > 1 else equal[0]
    return source


def _column_key(shadowing: Shadowing, i: int) -> tuple:
    """Return everything besides the casters on which the values of light i at nodes depend: its place, and whose
    shadows it has.
    """
    scene, targets = shadowing.world.scene, shadowing.targets
    light, blockers = scene.lights[i], None
    if light.blockers is not None:  # compare them by content, because object numbers mean nothing in another scene
        owner, digests = scene.geometry.instance_object, shadowing.footprints.digest
        blockers = tuple(sorted(d for d, o in zip(digests, owner, strict=True) if o in light.blockers))
    return bool(targets.directional[i]), tuple(targets.position[i].tolist()), blockers


def _forget_near(old: World, x: NDArray[np.float64], boxes: NDArray[np.float64], known: NDArray[np.uint64]) -> None:
    """Clear the bits of known (n,W) for segments from x (n,3), world, to lights that may meet a box."""
    if len(boxes):
        targets, centre, scale = old.lights.targets(), old.surfaces.centre, old.surfaces.scale
        place = np.where(targets.directional[:, None], targets.position, (targets.position - centre) / scale)
        _forget((x - centre) / scale, place, targets.directional, boxes, known)
