"""What a picture takes over from the one before it: whatever is still right, by its contents, so that no bit changes.

`new` and `old` are `Prepared`; `new` is made in the order of the functions here. Each gives the old thing, or None
where it has to be made anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..glass.interfaces import Interfaces
from ..glass.refraction import RefractedPaths
from ..rays.geometry import Surfaces, same_frame
from ..rays.tracer import ULPS, Tracer
from ..scene.description import Camera, Scene
from ..shadows.meshes.certificate import Certificate
from ..shadows.visibility import LightMeshes
from ..support.native import kernel

if TYPE_CHECKING:
    from .prepared import Prepared

_forget = kernel("reuse_forget")
# Nodes are dropped before the next picture where they take more than the first, or more than the second and there are
# those of so many pictures: a flight must not fill the memory.
KEPT_BYTES, SMALL_BYTES, KEPT_PICTURES = 1 << 30, 16 << 20, 4
BOXES = 64  # changed casters that are told apart; of more there is one box
PAD = 64 * ULPS  # round each box: far more than rays and triangles are rounded by in the frame


def same(a: Any, b: Any) -> bool:
    """Whether two descriptions (`scene.py`) have the same contents."""
    if a is b:
        return True
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b)
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    return bool(a == b)


def shared_geometry(scene: Scene, old: Prepared | None) -> Scene:
    """`scene`, with the geometry of the old one where they are equal: one copy in memory, and known to be equal."""
    if old and same(scene.geometry, old.scene.geometry):
        return dataclasses.replace(scene, geometry=old.scene.geometry)
    return scene


def surfaces(scene: Scene, camera: Camera, old: Prepared | None) -> tuple[Surfaces, list[str]] | None:
    """Triangles in the frame that suits the camera, and the warnings about them, which name objects."""
    if old and scene.geometry is old.scene.geometry and _traced(scene) == _traced(old.scene) and (
            _frame_key(camera) == _frame_key(old.scene.camera) or same_frame(old.surfaces, scene, camera)):
        return old.surfaces, old.lost
    return None


def _traced(scene: Scene) -> list[tuple[str, bool, bool]]:
    """Names, and which objects the camera and any ray may meet."""
    return [(o.name, o.visible_camera, o.visible_camera or o.visible_reflection or o.visible_shadow)
            for o in scene.objects]


def _frame_key(camera: Camera) -> tuple:
    return camera.matrix.tolist(), camera.window, camera.perspective, camera.clip_start


def interfaces(new: Prepared, old: Prepared | None) -> Interfaces | None:
    """What surfaces let through."""
    if old and new.surfaces is old.surfaces and _interfaces_key(new) == _interfaces_key(old):
        return old.glass
    return None


def _interfaces_key(ready: Prepared) -> tuple:
    return (
        [(m.alpha, m.alpha_image, m.kt, m.mirror, m.ior, m.priority, m.fresnel, m.transparent_shadow)
         for m in ready.scene.materials],
        [texture and texture.key for texture in ready.textures], ready.scene.settings.refraction,
        [o.visible_shadow for o in ready.scene.objects],
    )


def tracer(new: Prepared, old: Prepared | None) -> Tracer | None:
    """A tracer whose Embree scenes have the right triangles, though other ones may be wanted now."""
    return old.tracer if old and new.surfaces is old.surfaces else None


def certificate(new: Prepared, old: Prepared | None, casts: NDArray[np.bool_], r: float) -> Certificate | None:
    """Where nothing but a receiver's own body is near; it knows what it was made of."""
    before = old.certificate if old else None
    if before and new.surfaces is before.surfaces and before.r == r and np.array_equal(before.casts, casts):
        return before
    return None


def measured_h(new: Prepared, old: Prepared | None) -> float | None:
    """h that suits the camera, where it was measured before in the same view of the same surfaces."""
    if (old and old.described.settings.auto_h and not old.described.settings.measured_h and new.surfaces is old.surfaces
            and same(new.scene.camera, old.described.camera)
            and [o.visible_camera for o in new.scene.objects] == [o.visible_camera for o in old.scene.objects]):
        return old.measured_h
    return None


def solvers(new: Prepared, old: Prepared | None) -> dict[int, RefractedPaths] | None:
    """The refracted paths' beams, by sets of casters."""
    if old and old.refraction and new.glass is old.glass and new.scene.settings.h == old.scene.settings.h and (
            new.scene.settings.caustics == old.scene.settings.caustics) and all(
            np.array_equal(a, b) for a, b in zip(new.lights.targets(), old.lights.targets(), strict=True)) and (
            len(new.casters.sets) == len(old.casters.sets)) and all(
            np.array_equal(a, b) for a, b in zip(new.casters.sets, old.casters.sets, strict=True)):
        return old.refraction.solvers
    return None


def nodes(new: Prepared, old: Prepared | None) -> int:
    """Take over the nodes' values that are still right; returns how many nodes have some.

    A value is that of a node and a light. It stays unless the light is another, or the segment between them may meet
    the box of a caster that came, went or changed.
    """
    if not (old and isinstance(old.visibility, LightMeshes) and isinstance(new.visibility, LightMeshes)):
        return 0
    store = old.visibility.store
    store.end_picture()
    enough = SMALL_BYTES if store.count > KEPT_PICTURES * store.largest else KEPT_BYTES
    if store.bytes > enough or _store_key(new) != _store_key(old):
        return 0
    store.mend()
    unchanged = new.glass is old.glass and _casting(new) == _casting(old) and _soft(new) == _soft(old)
    boxes = np.zeros((0, 2, 3)) if unchanged else _changed(new, old)
    source = _columns(new, old)
    if not len(boxes) and len(new.scene.lights) == len(old.scene.lights) and (source == np.arange(len(source))).all():
        new.visibility.take(old.visibility)
    elif new.plan.paths:
        return 0
    else:
        new.visibility.store.inherit(store, source, lambda nodes, known: _forget_near(old, boxes, nodes, known))
        new.visibility.store.largest = store.largest
    return new.visibility.store.count


def _store_key(ready: Prepared) -> tuple:
    """What all values of a store depend on: the lattice (not r), the tracer's frame, and the kind of number."""
    s, p = ready.scene.settings, ready.plan
    key = (s.h, s.lattice_rotation, s.lattice_origin, ready.surfaces.centre.tolist(), ready.surfaces.scale, p.channels,
           ready.surfaces.reach > 1)
    return (*key, s.caustics, s.leak_free, *map(id, ready.refraction.solvers.values())) if ready.refraction else key


def _casting(ready: Prepared) -> list[tuple]:
    """What an object decides about the shadows that it casts."""
    return [(o.visible_shadow, o.cast_soft_shadows) for o in ready.scene.objects]


def _soft(ready: Prepared) -> list[bool]:
    """Which materials cast soft shadows."""
    return [m.cast_soft_shadows for m in ready.scene.materials]


def _columns(new: Prepared, old: Prepared) -> NDArray[np.int32]:
    """For each new light the old one with the same values at nodes (as far as casters are the same), or −1."""
    ways: dict[tuple, list[int]] = {}
    for i in range(len(old.scene.lights)):
        ways.setdefault(_column_key(old, i), []).append(i)
    source = np.full(max(1, len(new.scene.lights)), -1, np.int32)
    for i in range(len(new.scene.lights)):
        equal = ways.get(_column_key(new, i))
        if equal:  # of several the first, but the last one may serve again
            source[i] = equal.pop(0) if len(equal) > 1 else equal[0]
    return source


def _column_key(ready: Prepared, i: int) -> tuple:
    """What the values of light i at nodes depend on beside the casters: where it is, and whose shadows it has."""
    targets, light = ready.lights.targets(), ready.scene.lights[i]
    blockers = None
    if light.blockers is not None:  # by their contents: numbers of objects mean nothing in another scene
        owner = ready.scene.geometry.instance_object
        blockers = tuple(sorted(d for d, o in zip(ready.footprints.digest, owner, strict=True) if o in light.blockers))
    return bool(targets.directional[i]), tuple(targets.position[i].tolist()), blockers


class Footprints(NamedTuple):
    """The shadow casters of a scene, instance by instance."""

    digest: list[bytes]  # of the triangles in the frame and of what they do to light; empty: casts no shadow
    box: NDArray[np.float64]  # (I,2,3) low, high in the frame
    through: NDArray[np.bool_]  # (I,) lets light through somewhere


def footprints(ready: Prepared) -> Footprints:
    """The casters of a prepared scene."""
    s, scene, channels = ready.surfaces, ready.scene, ready.plan.channels
    owner, flags = scene.geometry.instance_object, _casting(ready)
    kind = np.array([int.from_bytes(hashlib.blake2b(repr((
        m.cast_soft_shadows, channels and m.transparent_shadow and (m.alpha, m.kt, m.ior, m.priority, _image(ready, m)),
    )).encode(), digest_size=8).digest(), "little") for m in scene.materials], np.uint64)
    cut = np.array([channels > 0 and m.alpha_image >= 0 for m in scene.materials], np.bool_)
    ends = np.searchsorted(s.instance, np.arange(len(owner) + 1))
    digest = [b""] * len(owner)
    box, through = np.zeros((len(owner), 2, 3)), np.zeros(len(owner), np.bool_)
    for i, o in enumerate(owner):
        part = slice(ends[i], ends[i + 1])
        if flags[o][0] and part.stop > part.start:
            corners = s.vertices[s.triangles[part]]
            material = s.materials[s.source[part]]
            what = hashlib.blake2b(corners, digest_size=16, key=repr(flags[o]).encode())
            what.update(kind[material])
            if cut[material].any():
                what.update(s.uvs[s.source[part]])
            digest[i] = what.digest()
            box[i] = corners.min((0, 1)), corners.max((0, 1))
            through[i] = ready.glass.lets_through[part].any()
    return Footprints(digest, box, through)


def _image(ready: Prepared, material: Any) -> Any:
    texture = ready.textures[material.alpha_image] if material.alpha_image >= 0 else None
    return texture and texture.key


def _changed(new: Prepared, old: Prepared) -> NDArray[np.float64]:
    """Boxes (b,2,3) in the frame: outside of them no straight segment meets anything but what it met before.

    Where some casters changed, those that let light through count as well: where two coincide, the order in which
    Embree meets them, and so the last bit of the product, may depend on all others.
    """
    now, then = new.footprints, old.footprints
    boxes = []
    for here, there in ((now, then), (then, now)):
        others = Counter(there.digest)
        for i, digest in enumerate(here.digest):
            others[digest] -= 1
            if digest and others[digest] < 0:
                boxes.append(here.box[i])
    if not boxes:
        return np.zeros((0, 2, 3))
    boxes += [box for c in (now, then) for box in c.box[c.through]]
    out = np.array(boxes)
    if len(out) > BOXES:
        out = np.stack([out[:, 0].min(0), out[:, 1].max(0)])[None]
    pad = PAD * np.maximum(1.0, np.abs(out).max((1, 2)))[:, None]
    out[:, 0] -= pad
    out[:, 1] += pad
    return out


def _forget_near(old: Prepared, boxes: NDArray[np.float64], nodes: NDArray[np.int32], known: NDArray) -> None:
    """Clear the bits of known (n,W) for segments from nodes (n,3) to lights that may meet a box."""
    if len(boxes):
        targets, centre, scale = old.lights.targets(), old.surfaces.centre, old.surfaces.scale
        place = np.where(targets.directional[:, None], targets.position, (targets.position - centre) / scale)
        x = (old.soft.lattice.position(nodes) - centre) / scale
        _forget(x, place, targets.directional, boxes, known)
