"""Panels for the artist, and the panels of Blender that make sense with this engine."""

import bpy

from . import last_render, light, material, object, render, view_layer
from .panel import ENGINE, LightMeshesPanel

_CLASSES = (*render.CLASSES, *last_render.CLASSES, *view_layer.CLASSES, *light.CLASSES, *object.CLASSES,
            *material.CLASSES)
# Blender's general panels that have no meaning for this engine, or that ours replace.
_EXCLUDED = {
    "DATA_PT_light", "DATA_PT_spot", "DATA_PT_area", "DATA_PT_falloff_curve", "NODE_DATA_PT_light",
}
# EEVEE's panels for settings that this engine reads: shader nodes, depth of field.
_EEVEES = {
    "MATERIAL_PT_preview", "EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface",
    "EEVEE_WORLD_PT_surface", "EEVEE_WORLD_PT_mist", "DATA_PT_camera_dof", "DATA_PT_camera_dof_aperture",
}


def _blenders_panels():
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", ())
        name = panel.__name__
        general = 'BLENDER_RENDER' in engines and name not in _EXCLUDED and "freestyle" not in name.lower()
        if general or name in _EEVEES:
            yield panel


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    for panel in _blenders_panels():
        panel.COMPAT_ENGINES.add(ENGINE)
    if not bpy.app.background:
        bpy.app.timers.register(last_render.follow, persistent=True)


def unregister() -> None:
    if bpy.app.timers.is_registered(last_render.follow):
        bpy.app.timers.unregister(last_render.follow)
    for panel in bpy.types.Panel.__subclasses__():
        if not issubclass(panel, LightMeshesPanel):
            getattr(panel, "COMPAT_ENGINES", set()).discard(ENGINE)
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
