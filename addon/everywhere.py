"""The settings of the world's light, of bounces and of the limit of reflections: scenes of earlier files keep what they
had.

Earlier releases had only ambient light, and no limit of reflections. Blender saves only values that were set. So a
scene in which nothing was set comes from an earlier release if its `release` says so, or if it uses Light Meshes and
has no `release`. When a file is saved, all values with which its scenes render are set.
"""

import bpy
from bpy.app.handlers import persistent

from .softness import NOW, is_used, stamps

EARLIER = {"world_light": 'AMBIENT', "bounces": 0, "clamp_indirect": 0.0}


def of(scene) -> dict:
    """Return the values of EARLIER's properties that a scene, evaluated or not, renders with."""
    own, old = scene.light_meshes, _is_old(scene.original)
    return {name: EARLIER[name] if old and not own.is_property_set(name) else getattr(own, name) for name in EARLIER}


def _is_old(scene) -> bool:
    """Return whether a scene uses Light Meshes and comes from a file of an earlier release."""
    if not is_used(scene):
        return False
    own = scene.light_meshes
    if own.is_property_set("release"):
        return own.release < NOW
    return bool(scene.library) or (bool(bpy.data.filepath) and not stamps())


def _set(values) -> None:
    """Set what was not chosen in the scenes of the open file, to values(scene)."""
    for scene in bpy.data.scenes:
        if not scene.library:
            own = scene.light_meshes
            for name, value in values(scene).items():
                if not own.is_property_set(name):
                    setattr(own, name, value)


@persistent
def _keep_old(*_):
    _set(lambda scene: EARLIER if _is_old(scene) else {})


@persistent
def _before_saving(*_):
    _set(lambda scene: of(scene) if is_used(scene) else {})


def register() -> None:
    bpy.app.handlers.load_post.insert(0, _keep_old)  # before `softness` says that the file is of this release
    bpy.app.handlers.save_pre.append(_before_saving)


def unregister() -> None:
    bpy.app.handlers.save_pre.remove(_before_saving)
    bpy.app.handlers.load_post.remove(_keep_old)
