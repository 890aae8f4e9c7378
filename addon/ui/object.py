"""Panels of an object."""

from typing import ClassVar

import bpy

from .panel import LightMeshesPanel

_SHADED = {'MESH', 'CURVE', 'SURFACE', 'META', 'FONT'}


class LIGHT_MESHES_PT_object(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Shadows"
    bl_context = "object"

    @classmethod
    def poll(cls, context):
        ob = context.object
        return super().poll(context) and ob and (ob.type in _SHADED or ob.instance_type != 'NONE')

    def fill(self, layout, context):
        column = layout.column(heading="Soft Shadows")
        column.prop(context.object.light_meshes, "cast_soft_shadows", text="Cast")
        column.prop(context.object.light_meshes, "receive_soft_shadows", text="Receive")


class LIGHT_MESHES_PT_shadow_terminator(LightMeshesPanel, bpy.types.Panel):
    """The shadow terminator settings. Blender's own panel exists only from 4.3 on and lacks the normal offset."""

    bl_label = "Shadow Terminator"
    bl_context = "object"
    bl_parent_id = "LIGHT_MESHES_PT_object"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        ob, column = context.object, layout.column()
        if hasattr(ob, "shadow_terminator_geometry_offset"):
            for name in ("geometry", "normal", "shading"):
                column.prop(ob, f"shadow_terminator_{name}_offset", text=f"{name.title()} Offset")
        elif hasattr(ob, "cycles"):  # in 4.2 the setting belongs to the Cycles add-on
            column.prop(ob.cycles, "shadow_terminator_geometry_offset", text="Geometry Offset")
            column.prop(ob.cycles, "shadow_terminator_offset", text="Shading Offset")


class LIGHT_MESHES_PT_ray_visibility(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Ray Visibility"
    bl_context = "object"
    bl_parent_id = "OBJECT_PT_visibility"

    def fill(self, layout, context):
        column = layout.column()
        if context.object.type == 'LIGHT':
            column.prop(context.object, "visible_diffuse", text="Diffuse")
            column.prop(context.object, "visible_glossy", text="Glossy")
            return
        column.prop(context.object, "visible_camera", text="Camera")
        column.prop(context.object, "visible_glossy", text="Mirrors")
        column.prop(context.object, "visible_shadow", text="Shadow")
        column.prop(context.object, "is_shadow_catcher", text="Shadow Catcher")


class _Linking(LightMeshesPanel):
    """Light linking panels for Blender before 4.3, whose own panels cannot be used by other engines."""

    bl_context = "object"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}
    what: str  # receiver or blocker, as Blender's names of properties and operators begin

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.object and context.object.type == 'LIGHT'

    def fill(self, layout, context):
        linking = context.object.light_linking
        name = f"{self.what}_collection"
        layout.template_ID(linking, name, new=f"object.light_linking_{self.what}_collection_new")
        if not getattr(linking, name):
            return
        row = layout.row()
        row.column().template_light_linking_collection(row, linking, name)
        column = row.column(align=True)
        column.operator(f"object.light_linking_{self.what}s_link", icon='ADD', text="").link_state = 'INCLUDE'
        column.operator("object.light_linking_unlink_from_collection", icon='REMOVE', text="")


class LIGHT_MESHES_PT_light_linking(_Linking, bpy.types.Panel):
    bl_label = "Light Linking"
    what = "receiver"


class LIGHT_MESHES_PT_shadow_linking(_Linking, bpy.types.Panel):
    bl_label = "Shadow Linking"
    what = "blocker"


CLASSES: tuple[type, ...] = (LIGHT_MESHES_PT_object, LIGHT_MESHES_PT_shadow_terminator, LIGHT_MESHES_PT_ray_visibility)
if not hasattr(bpy.types, "OBJECT_PT_light_linking"):
    CLASSES += (LIGHT_MESHES_PT_light_linking, LIGHT_MESHES_PT_shadow_linking)
