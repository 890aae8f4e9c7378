"""The softness of lamps: new lamps cast the shadow of their own shape; those of earlier files keep what they had.

Until release 0.1 a lamp whose softness was not set had the softness SCENE. Blender saves only values that were set, so
each scene stores which release made the lamps of its file. Files that were saved without the add-on store nothing: they
come from an earlier release if a scene in them uses Light Meshes or has any of its settings.
"""

import bpy
from bpy.app.handlers import persistent

# values of LightMeshesScene.release; 2: lamps as now, but ambient light; 3: but clear shadows of glass; 4: but pixels
# do not share their samples (`everywhere`)
EARLIER, NOW = 1, 5
_OF_ANY_FILE = {"rna_type", "name", "release", "measure_frame"}  # the last is set when any file is loaded


def softness_of(lamp) -> str:
    """Return the softness that the data of a lamp, evaluated or not, renders with. It is SCENE for lamps of files of
    earlier releases in which nothing was chosen.
    """
    own, block = lamp.light_meshes, lamp.original
    if own.is_property_set("softness"):
        return own.softness
    if block.library or block.override_library or not stamps():  # else `_keep_old` has set it where it must be
        return 'SCENE' if _release(bool(bpy.data.filepath)) == EARLIER else own.softness
    return own.softness


def has_size(lamp) -> bool:
    """Return whether the data of a lamp has a size."""
    if lamp.type == 'SUN':
        return lamp.angle > 0
    return lamp.type == 'AREA' or lamp.shadow_soft_size > 0


def stamps() -> list[int]:
    """Return what the scenes of the open file say about the release that made its lamps."""
    return [s.light_meshes.release for s in bpy.data.scenes if s.light_meshes.is_property_set("release")]


def _release(saved: bool) -> int:
    """Return which release made the lamps of the open file in which nothing is set. `saved`: it comes from a file."""
    return min(stamps() or [EARLIER if saved and any(map(is_used, bpy.data.scenes)) else NOW])


def is_used(scene) -> bool:
    """Return whether a scene uses Light Meshes, or any of its settings has been set."""
    own = scene.light_meshes
    return scene.render.engine == 'LIGHT_MESHES' or any(
        own.is_property_set(p.identifier) for p in own.bl_rna.properties if p.identifier not in _OF_ANY_FILE)


def _stamp(saved: bool) -> None:
    release = _release(saved)
    if release == EARLIER and not stamps():
        for lamp in bpy.data.lights:
            if not (lamp.library or lamp.override_library or lamp.light_meshes.is_property_set("softness")):
                lamp.light_meshes.softness = 'SCENE'
    for scene in bpy.data.scenes:
        if not (scene.library or scene.light_meshes.is_property_set("release")):
            scene.light_meshes.release = release


@persistent
def _keep_old(*_):
    _stamp(saved=True)


@persistent
def _before_saving(*_):
    _stamp(bool(bpy.data.filepath))


def register() -> None:
    bpy.app.handlers.load_post.append(_keep_old)
    bpy.app.handlers.save_pre.append(_before_saving)


def unregister() -> None:
    bpy.app.handlers.save_pre.remove(_before_saving)
    bpy.app.handlers.load_post.remove(_keep_old)
