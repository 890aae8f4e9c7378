"""What is measured once for a whole animation, always at its first frame: the automatic step, the lights' radii.

So all frames have the same, in whichever order and on however many machines they are rendered.
"""

import bpy
from bpy.app.handlers import persistent

# Modifiers that may move without any animation data.
_MOVING = {
    'BUILD', 'CLOTH', 'DYNAMIC_PAINT', 'EXPLODE', 'FLUID', 'MESH_CACHE', 'MESH_SEQUENCE_CACHE', 'NODES', 'OCEAN',
    'PARTICLE_INSTANCE', 'PARTICLE_SYSTEM', 'SOFT_BODY', 'VOLUME_TO_MESH', 'WAVE',
}
_measured: dict[str, dict] = {}  # of the render job that is going on


def for_frame(job) -> dict[str, dict]:
    """The overrides to export the current frame of `job` with. Empty: what the snapshot says by itself is right."""
    scene = job.depsgraph.scene
    own = job.depsgraph.scene_eval.light_meshes
    if own.shadows != 'LIGHT_MESHES' or own.mode == 'LOCAL' or not (own.auto_h or _sized_lights(job.depsgraph)):
        return {}
    engine, frame, subframe = job.engine, scene.frame_current, scene.frame_subframe
    if engine.is_preview:
        return {}
    moves = may_move(job.depsgraph)
    here = (frame == scene.frame_start and not subframe) or not moves
    alone = sum(layer.use for layer in scene.view_layers) == 1
    if alone and here and not (moves and engine.is_animation):
        return {}  # the engine measures what it renders
    key = scene.name_full  # layers that are put together must have the same: the first one's
    if key not in _measured:
        try:
            if not here:
                engine.frame_set(scene.frame_start, 0.0)
            job.export({})
            _measured[key] = job.measure()
        finally:
            if not here:
                engine.frame_set(frame, subframe)
    found = _measured[key]
    return {
        "settings": {"auto_h": False, "h": found["h"]} if own.auto_h else {},
        "lights": {name: {"softness": 'RADIUS', "soft_radius": r} for name, r in found["radii"].items()},
    }


def _sized_lights(depsgraph) -> bool:
    """Whether the size of any light is to set the width of its shadows' edges."""
    return any(isinstance(block, bpy.types.Light) and block.light_meshes.softness == 'LIGHT_SIZE'
               for block in depsgraph.ids)


def may_move(depsgraph) -> bool:
    """Whether frames may differ: False only when nothing in the scene could."""
    scene = depsgraph.scene
    if scene.rigidbody_world or any(m.camera for m in scene.timeline_markers):
        return True
    for block in depsgraph.ids:
        if getattr(block, "animation_data", None):
            return True
        if isinstance(block, bpy.types.Object) and (
                block.particle_systems or any(m.type in _MOVING for m in block.modifiers)):
            return True
        keys = getattr(block, "shape_keys", None)
        if keys and keys.animation_data:
            return True
    return False


@persistent
def _forget(*_):
    _measured.clear()


def register() -> None:
    bpy.app.handlers.render_init.append(_forget)


def unregister() -> None:
    bpy.app.handlers.render_init.remove(_forget)
