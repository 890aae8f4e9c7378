"""Panels of the view layer properties."""

from typing import ClassVar

import bpy

from .. import cryptomatte, passes
from .panel import LightMeshesPanel


class LIGHT_MESHES_PT_passes(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def fill(self, layout, context):
        pass


class _Passes(LightMeshesPanel):
    bl_context = "view_layer"
    bl_parent_id = "LIGHT_MESHES_PT_passes"
    names: tuple[str, ...] = ()  # names of passes in the engine

    def fill(self, layout, context):
        column = layout.column(heading="Include", align=True)
        for name in self.names:
            p = passes.ALL[name]
            # The engine's names. Its pass Diffuse contains all diffuse light, direct or not, multiplied by the
            # surface's colour.
            label = {"text": name} if name in passes.LIGHT else {}
            column.prop(p.owner(context.view_layer), p.switch, **label)


class LIGHT_MESHES_PT_passes_data(_Passes, bpy.types.Panel):
    bl_label = "Data"
    names = passes.DATA


class LIGHT_MESHES_PT_passes_light(_Passes, bpy.types.Panel):
    bl_label = "Light"
    names = passes.LIGHT


class LIGHT_MESHES_PT_passes_cryptomatte(_Passes, bpy.types.Panel):
    bl_label = "Cryptomatte"

    def fill(self, layout, context):
        layer = context.view_layer
        column = layout.column(heading="Include", align=True)
        for name, text in (("object", "Object"), ("material", "Material"), ("asset", "Asset")):
            column.prop(layer, f"use_pass_cryptomatte_{name}", text=text)
        column = layout.column()
        column.active = bool(cryptomatte.wanted(layer))
        column.prop(layer, "pass_cryptomatte_depth", text="Levels")


class LIGHT_MESHES_PT_passes_shadow(_Passes, bpy.types.Panel):
    bl_label = "Shadow of Each Light"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        column = layout.column(heading="Include", align=True)
        for light in passes.lights(context.scene):
            column.prop(light.light_meshes, "shadow_pass", text=light.name_full)


class LIGHT_MESHES_PT_passes_debug(_Passes, bpy.types.Panel):
    bl_label = "Debug"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}
    names = passes.DEBUG


class LIGHT_MESHES_PT_override(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Override"
    bl_context = "view_layer"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        for name in ("material_override", "world_override", "samples"):
            layout.prop(context.view_layer, name)


CLASSES = (
    LIGHT_MESHES_PT_passes, LIGHT_MESHES_PT_passes_data, LIGHT_MESHES_PT_passes_light,
    LIGHT_MESHES_PT_passes_cryptomatte, LIGHT_MESHES_PT_passes_shadow, LIGHT_MESHES_PT_passes_debug,
    LIGHT_MESHES_PT_override,
)
