"""Panels of the view layer properties."""

from typing import ClassVar

import bpy

from .panel import LightMeshesPanel


class LIGHT_MESHES_PT_passes(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def fill(self, layout, context):
        column = layout.column(heading="Include", align=True)
        for name in ("use_pass_combined", "use_pass_z", "use_pass_normal", "use_pass_shadow"):
            column.prop(context.view_layer, name)


class LIGHT_MESHES_PT_override(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Override"
    bl_context = "view_layer"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        for name in ("material_override", "world_override", "samples"):
            layout.prop(context.view_layer, name)


CLASSES = (LIGHT_MESHES_PT_passes, LIGHT_MESHES_PT_override)
