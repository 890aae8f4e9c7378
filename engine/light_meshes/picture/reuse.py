"""Nodes that a picture takes over from the one before it: those that are still right, so that no bit changes.

What else is taken over is decided where it is made: `world`, `measured`, `shadowing`.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..shadows.lamp_points import reaches
from ..shadows.method import Nodes
from ..shadows.radius import extent
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

    A value belongs to a node and a light. It stays valid unless the light changed, or the segments between them may
    meet the box of a caster that came, went or changed.
    """
    if not (old and old.method.nodes and new.method.nodes):
        return 0
    before = {}
    for one in old.method.nodes:
        store = one.store
        store.end_picture()
        enough = SMALL_BYTES if store.count > KEPT_PICTURES * store.largest else KEPT_BYTES
        if store.bytes <= enough:
            before[_store_key(old, one)] = one
    if sum(one.store.bytes for one in before.values()) > KEPT_BYTES:
        return 0
    pairs = [(one, before[key]) for one in new.method.nodes if (key := _store_key(new, one)) in before]
    unchanged = casting(new.world.scene) == casting(old.world.scene) and _soft(new.world) == _soft(old.world) and (
        new.world.glass is old.world.glass)
    boxes = changed(new.footprints, old.footprints) if pairs and not unchanged else np.zeros((0, 2, 3))
    for one, then in pairs:
        # By which glass light was turned aside is not in the boxes.
        same_glass = unchanged and new.world.surfaces is old.world.surfaces
        if one.lamps is None and new.aside and not same_glass:
            continue
        _keep(one, then, boxes, new, old)
    return count(new.method.nodes)


def count(nodes: Iterable[Nodes]) -> int:
    """Return how many nodes of lattices have a value."""
    most: dict[float, int] = {}
    for one in nodes:
        most[one.lattice.h] = max(most.get(one.lattice.h, 0), one.store.count)
    return sum(most.values())


def _keep(now: Nodes, then: Nodes, boxes: NDArray[np.float64], new: Shadowing, old: Shadowing) -> None:
    """Put the values of `then` that are still right into `now`; the stores of both have the same key."""
    store, lights = then.store, len(new.world.scene.lights)
    store.mend()
    source = _columns(new, now, old, then)
    if not len(boxes) and lights == len(old.world.scene.lights) and (source == np.arange(len(source))).all():
        now.take(then)
    elif not new.paths:
        spread = reaches(then.lamps) if then.lamps else np.zeros(len(old.world.scene.lights))
        now.store.inherit(store, source, lambda nodes, known: _forget_near(
            old.world, then.lattice.position(nodes), spread, boxes, known))
        now.store.largest = store.largest


def _store_key(shadowing: Shadowing, nodes: Nodes) -> tuple:
    """Return everything on which all values of a store depend: the lattice (not r), the tracer's frame, and the kind of
    value.
    """
    s, surfaces = shadowing.settings, shadowing.world.surfaces
    key = (nodes.points, nodes.lattice.h, s.lattice_rotation, s.lattice_origin, surfaces.centre.tolist(),
           surfaces.scale, shadowing.channels, surfaces.reach > 1, shadowing.aside)
    refraction = shadowing.refraction
    key = (*key, s.caustics, s.leak_free, *map(id, refraction.solvers.values())) if refraction else key
    return tuple(map(repr, key))


def _soft(world: World) -> list[bool]:
    """Return which materials cast soft shadows."""
    return [m.cast_soft_shadows for m in world.scene.materials]


def _columns(new: Shadowing, now: Nodes, old: Shadowing, then: Nodes) -> NDArray[np.int32]:
    """Return for each new light the old one with the same values at nodes (as far as casters are the same), or −1."""
    ways: dict[tuple, list[int]] = {}
    for i in range(len(old.world.scene.lights)):
        ways.setdefault(_column_key(old, then, i), []).append(i)
    source = np.full(max(1, len(new.world.scene.lights)), -1, np.int32)
    for i in range(len(new.world.scene.lights)):
        equal = ways.get(_column_key(new, now, i))
        if equal:  # if several are equal the first is used, but the last one may be used again
            source[i] = equal.pop(0) if len(equal) > 1 else equal[0]
    return source


def _column_key(shadowing: Shadowing, nodes: Nodes, i: int) -> tuple:
    """Return everything besides the casters on which the values of light i at nodes depend: its place, its shape if
    that counts, and whose shadows it has.
    """
    scene, targets = shadowing.world.scene, shadowing.targets
    light, blockers = scene.lights[i], None
    if light.blockers is not None:  # compare them by content, because object numbers mean nothing in another scene
        owner, digests = scene.geometry.instance_object, shadowing.footprints.digest
        blockers = tuple(sorted(d for d, o in zip(digests, owner, strict=True) if o in light.blockers))
    shape = nodes.lamps.alike(i) if nodes.lamps else (extent(light),) if shadowing.aside else ()
    return bool(targets.directional[i]), tuple(targets.position[i].tolist()), blockers, shape


def _forget_near(old: World, x: NDArray[np.float64], spread: NDArray[np.float64], boxes: NDArray[np.float64],
                 known: NDArray[np.uint64]) -> None:
    """Clear the bits of known (n,W) for segments from x (n,3), world, to lights that may meet a box.

    spread (L,): how far from its centre a light's points may be, scene units; of a sun at distance 1.
    """
    if len(boxes):
        targets, centre, scale = old.lights.targets(), old.surfaces.centre, old.surfaces.scale
        place = np.where(targets.directional[:, None], targets.position, (targets.position - centre) / scale)
        spread = np.where(targets.directional, spread, spread / scale)
        _forget((x - centre) / scale, place, targets.directional, spread, boxes, known)
