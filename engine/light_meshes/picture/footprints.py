"""The shadow casters of a picture, instance by instance, and the places where they differ from those of the picture
before.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import ULPS
from ..scene.description import Material, Scene
from ..scene.programs import LETS_THROUGH
from .world import World

BOXES = 64  # the largest number of boxes for changed casters; if there are more casters, one box holds all
PAD = 64 * ULPS  # margin around each box: far more than the rounding of rays and triangles in the frame


class Footprints(NamedTuple):
    """The shadow casters of a scene, instance by instance."""

    digest: list[bytes]  # a hash of the triangles in the frame and of what they do to light; empty: it casts no shadow
    box: NDArray[np.float64]  # (I,2,3) low, high in the frame
    through: NDArray[np.bool_]  # (I,) some part of it lets light through


def casting(scene: Scene) -> list[tuple[bool, bool]]:
    """Return the settings of each object that decide about the shadows that it casts."""
    return [(o.visible_shadow, o.cast_soft_shadows) for o in scene.objects]


def footprints(world: World, channels: int) -> Footprints:
    """Return the casters of a world, where S has so many channels."""
    s, scene = world.surfaces, world.scene
    owner, flags = scene.geometry.instance_object, casting(scene)
    kind = np.array([int.from_bytes(hashlib.blake2b(repr((
        m.cast_soft_shadows, channels and m.transparent_shadow and (
            m.alpha, m.kt, m.ior, m.priority, _image(world, m), _program(world, m)),
    )).encode(), digest_size=8).digest(), "little") for m in scene.materials], np.uint64)
    cut = np.array([channels > 0 and (m.alpha_image >= 0 or _lets_through(m)) for m in scene.materials], np.bool_)
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
                g = scene.geometry
                for values in (s.uvs, g.attributes):  # by which programs and images say what is there
                    what.update(values[s.source[part]].tobytes() if len(values) else b"")
                what.update(g.instance_matrix[i].tobytes())
                what.update(g.instance_values[i].tobytes() if len(g.instance_values) else b"")
                what.update(repr((scene.objects[o].texture_location, scene.objects[o].texture_size)).encode())
            digest[i] = what.digest()
            box[i] = corners.min((0, 1)), corners.max((0, 1))
            through[i] = world.glass.lets_through[part].any()
    return Footprints(digest, box, through)


def _lets_through(material: Material) -> bool:
    """Return whether the material's program decides how much light passes for shadow rays."""
    return not LETS_THROUGH.isdisjoint(material.program.values)


def _program(world: World, material: Material) -> object:
    """Return what shadow rays see of a material's program, and from where, if that counts."""
    if not _lets_through(material):
        return None
    c = world.camera
    images = [texture and texture.key for i in sorted(material.program.images()) for texture in [world.textures[i]]]
    where = (c.matrix.tobytes(), c.window, c.perspective) if material.program.sees_camera(LETS_THROUGH) else None
    return material.program, images, where


def _image(world: World, material: Material) -> object:
    texture = world.textures[material.alpha_image] if material.alpha_image >= 0 else None
    return texture and texture.key


def changed(now: Footprints, then: Footprints) -> NDArray[np.float64]:
    """Return boxes (b,2,3) in the frame. A straight segment outside of all boxes meets the same casters as before.

    If some casters changed, casters that let light through count as changed too: where two of them coincide, the order
    in which Embree meets them, and so the last bit of the product, may depend on all others.
    """
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
