"""What is measured once for a whole animation, always at one frame: the automatic step, the lights' radii.

So all frames have the same, in whichever order and parts they are rendered, on however many machines. Which frame it
is stands in the file (`measure_frame`): the scene's range of frames is changed by whoever cuts a job.
"""

import contextlib
from functools import cache

import bpy
from bpy.app.handlers import persistent

# Modifiers that are the same in all frames where the mesh and the objects that they name are.
_STILL = {
    'ARMATURE', 'ARRAY', 'BEVEL', 'BOOLEAN', 'CAST', 'CORRECTIVE_SMOOTH', 'CURVE', 'DATA_TRANSFER', 'DECIMATE',
    'EDGE_SPLIT', 'HOOK', 'LAPLACIANDEFORM', 'LAPLACIANSMOOTH', 'LATTICE', 'MASK', 'MESH_DEFORM', 'MIRROR', 'MULTIRES',
    'NORMAL_EDIT', 'REMESH', 'SCREW', 'SHRINKWRAP', 'SIMPLE_DEFORM', 'SKIN', 'SMOOTH', 'SOLIDIFY', 'SUBSURF',
    'SURFACE_DEFORM', 'TRIANGULATE', 'UV_PROJECT', 'UV_WARP', 'WEIGHTED_NORMAL', 'WELD', 'WIREFRAME',
}
_HANDLERS = ("frame_change_pre", "frame_change_post", "depsgraph_update_pre", "depsgraph_update_post", "render_pre")
_measured: dict[str, dict] = {}  # of the render job that is going on


def for_frame(job) -> dict[str, dict]:
    """The overrides to export the current frame of `job` with. Empty: what the snapshot says by itself is right."""
    scene = job.depsgraph.scene
    own = job.depsgraph.scene_eval.light_meshes
    auto_h = own.auto_h  # of the evaluated scene nothing is left once another frame is set
    if own.shadows != 'LIGHT_MESHES' or own.mode == 'LOCAL' or not (auto_h or _sized_lights(job.depsgraph)):
        return {}
    engine, frame, subframe, at = job.engine, scene.frame_current, scene.frame_subframe, measure_frame(scene)
    if engine.is_preview:
        return {}
    moves = may_move(job.depsgraph)
    here = (frame == at and not subframe) or not moves
    alone = sum(layer.use for layer in scene.view_layers) == 1
    if alone and here and not (moves and engine.is_animation):
        return {}  # the engine measures what it renders
    key = scene.name_full  # layers that are put together must have the same: the first one's
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
        # A light whose size has no effect there, as nothing is in its way, has the scene's radius.
        "sized lights": {light: {"softness": 'SCENE'} if r is None else {"softness": 'RADIUS', "soft_radius": r}
                         for light, r in found["radii"].items()},
    }


def _sized_lights(depsgraph) -> bool:
    """Whether the size of any light is to set the width of its shadows' edges."""
    return any(isinstance(block, bpy.types.Light) and block.light_meshes.softness == 'LIGHT_SIZE'
               for block in depsgraph.ids)


def may_move(depsgraph) -> bool:
    """Whether frames may differ: False only when nothing in the scene could."""
    scene = depsgraph.scene
    if scene.rigidbody_world or any(m.camera for m in scene.timeline_markers) or any(
            getattr(bpy.app.handlers, name) for name in _HANDLERS):
        return True
    return any(map(_may_move, depsgraph.ids))


def _may_move(block) -> bool:
    """Constraints count, as caches, tracks and targets move what they hold."""
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
    """The frame at which is measured. Where the file does not say, its first one, and 1 of what is not saved yet."""
    own = scene.light_meshes
    if own.is_property_set("measure_frame") or not bpy.data.filepath:
        return own.measure_frame
    return _first_frames(bpy.path.abspath(bpy.data.filepath)).get(scene.name, scene.frame_start)


@cache
def _first_frames(file: str) -> dict[str, int]:
    """Scene → its first frame in the file; what is in memory `blender -s` or a script may have changed.

    Needed where the add-on was enabled later than that. Blender's own reader finds the current scene, or nothing.
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
