"""Panels of the render properties: what is computed and how."""

from typing import ClassVar

import bpy

from .. import penumbra
from ..operators import PRESETS
from .panel import LightMeshesPanel, table


class LIGHT_MESHES_PT_method(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Ray Tracing"

    def fill(self, layout, context):
        settings = context.scene.light_meshes
        row = layout.row(align=True)
        for level, preset in PRESETS.items():
            row.operator("light_meshes.preset", text=preset.name, depress=preset.is_set(settings)).level = level
        layout.prop(settings, "mode")
        layout.prop(settings, "samples")
        if settings.mode == 'WHITTED':
            layout.prop(settings, "max_depth")
            layout.prop(settings, "fast_reflections")
            layout.prop(settings, "clamp_indirect")


class LIGHT_MESHES_PT_everywhere(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Light from Everywhere"

    def fill(self, layout, context):
        settings = context.scene.light_meshes
        layout.prop(settings, "world_light")
        if settings.world_light == 'AMBIENT' or settings.mode == 'LOCAL':
            layout.prop(settings, "ambient")
        if settings.mode != 'LOCAL':
            layout.prop(settings, "bounces")


class LIGHT_MESHES_PT_shadows(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Shadows"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.scene.light_meshes.mode != 'LOCAL'

    def fill(self, layout, context):
        settings = context.scene.light_meshes
        layout.prop(settings, "shadows")
        if settings.shadows == 'LIGHT_MESHES':
            layout.operator("light_meshes.soften", icon='LIGHT')
            layout.prop(settings, "auto_h")
            if not settings.auto_h:
                layout.prop(settings, "h")
            if settings.auto_h or any(lamp.light_meshes.softness == 'LIGHT_SIZE' for lamp in bpy.data.lights):
                layout.prop(settings, "measure_frame")
            layout.prop(settings, "kI")
            layout.prop(settings, "weights")
            layout.prop(settings, "shadow_rate")
            layout.prop(settings, "light_threshold")
            table(layout, context, _meaning(context.scene))
        elif settings.shadows == 'AREA_SAMPLING':
            layout.prop(settings, "light_samples")


def _meaning(scene) -> list[tuple[str, str]]:
    """Return what the step and the quality mean for the picture."""
    kI, h = scene.light_meshes.kI, penumbra.step(scene)
    r = penumbra.radius(scene)
    rows = []
    if scene.light_meshes.auto_h:
        rows.append(("Step (h)", "measured when rendering" if h is None else
                     f"{penumbra.length(scene, h)} in the last render"))
    if r is not None:
        rows += [("Radius r = h·kI", penumbra.length(scene, r)),
                 ("Shadow Edges", f"{penumbra.length(scene, 2 * r)} wide")]
    on_screen = penumbra.pixels(scene, r)
    if on_screen:
        rows.append(("" if r is not None else "Shadow Edges", "{:.0f} pixels {}".format(*on_screen)))
    return [*rows, ("Gradation", f"{penumbra.nodes(kI)} nodes a point")]


class LIGHT_MESHES_PT_glass(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Glass"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        settings = context.scene.light_meshes
        layout.prop(settings, "refraction")
        if settings.refraction == 'VIEW':
            layout.prop(settings, "glass_shadows")
        soft = settings.mode != 'LOCAL' and settings.shadows == 'LIGHT_MESHES'
        if soft:
            layout.prop(settings, "glass", text="Soft Shadows")
        if settings.refraction == 'FULL':
            layout.prop(settings, "caustics")
            if soft:
                layout.prop(settings, "leak_free")


class LIGHT_MESHES_PT_film(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Film"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        layout.prop(context.scene.render, "filter_size")
        layout.prop(context.scene.light_meshes, "share_samples")
        layout.prop(context.scene.render, "film_transparent", text="Transparent")


class LIGHT_MESHES_PT_performance(LightMeshesPanel, bpy.types.Panel):
    bl_label = "Performance"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        layout.prop(context.scene.render, "threads_mode")
        if context.scene.render.threads_mode == 'FIXED':
            layout.prop(context.scene.render, "threads")
        layout.prop(context.scene.render, "use_persistent_data", text="Persistent Data")
        layout.prop(context.scene.render, "preview_pixel_size", text="Pixel Size of Views")


CLASSES = (
    LIGHT_MESHES_PT_method,
    LIGHT_MESHES_PT_everywhere,
    LIGHT_MESHES_PT_shadows,
    LIGHT_MESHES_PT_glass,
    LIGHT_MESHES_PT_film,
    LIGHT_MESHES_PT_performance,
)
