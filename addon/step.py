"""Measure once for a whole animation, always at the same frame: the automatic step and the lights' radii.

So all frames have the same values, in whatever order and parts and on however many machines they are rendered. The file
says which frame is used (`measure_frame`). The scene's frame range cannot be used for this, because jobs for parts of
an animation change it.
"""

import contextlib
from functools import cache

import bpy
from bpy.app.handlers import persistent

# Modifiers whose result is the same in all frames if the mesh and the objects that they refer to do not change.
_STILL = {
    'ARMATURE', 'ARRAY', 'BEVEL', 'BOOLEAN', 'CAST', 'CORRECTIVE_SMOOTH', 'CURVE', 'DATA_TRANSFER', 'DECIMATE',
    'EDGE_SPLIT', 'HOOK', 'LAPLACIANDEFORM', 'LAPLACIANSMOOTH', 'LATTICE', 'MASK', 'MESH_DEFORM', 'MIRROR', 'MULTIRES',
    'NORMAL_EDIT', 'REMESH', 'SCREW', 'SHRINKWRAP', 'SIMPLE_DEFORM', 'SKIN', 'SMOOTH', 'SOLIDIFY', 'SUBSURF',
    'SURFACE_DEFORM', 'TRIANGULATE', 'UV_PROJECT', 'UV_WARP', 'WEIGHTED_NORMAL', 'WELD', 'WIREFRAME',
}
_HANDLERS = ("frame_change_pre", "frame_change_post", "depsgraph_update_pre", "depsgraph_update_post", "render_pre")
_measured: dict[str, dict] = {}  # values of the current render job


def for_frame(job) -> dict[str, dict]:
    """Return the overrides for exporting the current frame of `job`. They are empty if the snapshot alone gives the
    right values.
    """
    scene = job.depsgraph.scene
    own = job.depsgraph.scene_eval.light_meshes
    auto_h = own.auto_h  # read it now: setting another frame invalidates the evaluated scene
    if own.shadows != 'LIGHT_MESHES' or own.mode == 'LOCAL' or not (auto_h or _sized_lights(job.depsgraph)):
        return {}
    engine, frame, subframe, at = job.engine, scene.frame_current, scene.frame_subframe, measure_frame(scene)
    if engine.is_preview:
        return {}
    moves = may_move(job.depsgraph)
    here = (frame == at and not subframe) or not moves
    alone = sum(layer.use for layer in scene.view_layers) == 1
    if alone and here and not (moves and engine.is_animation):
        return {}  # the engine measures the frame that it renders
    key = scene.name_full  # all view layers of a picture must use the same values: those of the first one
    if key not in _measured:
        try:
            if not here:
                engine.frame_set(at, 0.0)
            job.export({})
            _measured[key] = job.measure()
        finally:
            if not here:
                engine.frame_set(frame, subframe)
    found = _measured[key]
    return {
        "settings": {"measured_h": found["h"]} if auto_h else {},
        # A light whose size has no effect at that frame, because nothing blocks it, gets the scene's radius.
        "sized lights": {light: {"softness": 'SCENE'} if r is None else {"softness": 'RADIUS', "soft_radius": r}
                         for light, r in found["radii"].items()},
    }


def _sized_lights(depsgraph) -> bool:
    """Return whether the size of any light sets the width of its shadows' edges."""
    return any(isinstance(block, bpy.types.Light) and block.light_meshes.softness == 'LIGHT_SIZE'
               for block in depsgraph.ids)


def may_move(depsgraph) -> bool:
    """Return whether frames may differ. It is False only if nothing in the scene can change."""
    scene = depsgraph.scene
    if scene.rigidbody_world or any(m.camera for m in scene.timeline_markers) or any(
            getattr(bpy.app.handlers, name) for name in _HANDLERS):
        return True
    return any(map(_may_move, depsgraph.ids))


def _may_move(block) -> bool:
    """Return whether a data block may change from frame to frame. Constraints count, because caches, tracks and targets
    move their owner.
    """
    for owner in (block, getattr(block, "shape_keys", None), getattr(block, "node_tree", None)):
        if getattr(owner, "animation_data", None):
            return True
    return isinstance(block, bpy.types.Object) and bool(
        block.particle_systems or block.constraints or any(m.type not in _STILL for m in block.modifiers)
        or (block.pose and any(bone.constraints for bone in block.pose.bones)))


@persistent
def _forget(*_):
    _measured.clear()


def measure_frame(scene) -> int:
    """Return the frame to measure at. A file without this setting uses the first frame of its range; a scene that is
    not saved yet uses 1.
    """
    own = scene.light_meshes
    if own.is_property_set("measure_frame") or not bpy.data.filepath:
        return own.measure_frame
    return _first_frames(bpy.path.abspath(bpy.data.filepath)).get(scene.name, scene.frame_start)


@cache
def _first_frames(file: str) -> dict[str, int]:
    """Return scene name → first frame, read from the file. The values in memory may have been changed by `blender -s`
    or a script.

    This is needed if the add-on was enabled after such a change. Blender's own reader finds only the current scene, or
    nothing.
    """
    import blend_render_info

    with contextlib.suppress(Exception):
        return {name: first for first, _, name in blend_render_info.read_blend_rend_chunk(file)}
    return {}


@persistent
def _keep_loaded(*_):
    for scene in bpy.data.scenes:
        if not scene.light_meshes.is_property_set("measure_frame"):
            scene.light_meshes.measure_frame = scene.frame_start


@persistent
def _keep_saved(*_):
    for scene in bpy.data.scenes:
        scene.light_meshes.measure_frame = measure_frame(scene)


_KEPT = ((bpy.app.handlers.render_init, _forget), (bpy.app.handlers.load_post, _keep_loaded),
         (bpy.app.handlers.save_pre, _keep_saved))


def register() -> None:
    for handlers, function in _KEPT:
        handlers.append(function)


def unregister() -> None:
    for handlers, function in _KEPT:
        handlers.remove(function)
