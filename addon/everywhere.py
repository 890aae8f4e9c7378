"""Settings whose values in files of earlier releases stay as they were: the world's light, bounces, the limit of
reflections, shadows of glass, samples that pixels share.

Blender saves only values that were set. So a scene in which such a setting was not set comes from an earlier release if
its `release` says so, or if it uses Light Meshes and has no `release`. When a file is saved, all values with which its
scenes render are set.
"""

import bpy
from bpy.app.handlers import persistent

from .softness import NOW, is_used, stamps

# value in earlier files, and the value of LightMeshesScene.release from which on files have the default
EARLIER = {"world_light": ('AMBIENT', 3), "bounces": (0, 3), "clamp_indirect": (0.0, 3), "glass_shadows": ('CLEAR', 4),
           "share_samples": (False, 5)}


def of(scene) -> dict:
    """Return the values of EARLIER's properties that a scene, evaluated or not, renders with."""
    own, release = scene.light_meshes, _release(scene.original)
    return {name: earlier if release < since and not own.is_property_set(name) else getattr(own, name)
            for name, (earlier, since) in EARLIER.items()}


def _release(scene) -> float:
    """Return the `release` of the file that a scene comes from, 0 if it has none and uses Light Meshes; infinity for
    scenes that are new or do not use it.
    """
    if not is_used(scene):
        return float("inf")
    own = scene.light_meshes
    if own.is_property_set("release"):
        return own.release
    return 0 if scene.library or (bpy.data.filepath and not stamps()) else float("inf")


def _set(scenes) -> None:
    """Set what was not chosen in these scenes to the values with which they render."""
    for scene in scenes:
        own = scene.light_meshes
        for name, value in of(scene).items():
            if not own.is_property_set(name):
                setattr(own, name, value)


def _own_scenes() -> list:
    return [scene for scene in bpy.data.scenes if not scene.library]


@persistent
def _keep_old(*_):
    _set([scene for scene in _own_scenes() if _release(scene) < NOW])


@persistent
def _before_saving(*_):
    _set([scene for scene in _own_scenes() if is_used(scene)])


def register() -> None:
    bpy.app.handlers.load_post.insert(0, _keep_old)  # before `softness` says that the file is of this release
    bpy.app.handlers.save_pre.append(_before_saving)


def unregister() -> None:
    bpy.app.handlers.save_pre.remove(_before_saving)
    bpy.app.handlers.load_post.remove(_keep_old)
