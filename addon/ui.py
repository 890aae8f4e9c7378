"""Panels, where an artist looks for them; and Blender's own panels that make sense for this engine."""

from typing import ClassVar

import bpy

from .export.materials import translate
from .export.report import Report
from .properties import PARAMETERS

ENGINE = 'LIGHT_MESHES'


class _Panel:
    bl_space_type = 'PROPERTIES'
    bl_region_type = 'WINDOW'
    bl_context = "render"
    COMPAT_ENGINES: ClassVar = {ENGINE}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        self.fill(layout, context)


class LIGHT_MESHES_PT_method(_Panel, bpy.types.Panel):
    bl_label = "Method"

    def fill(self, layout, context):
        settings = context.scene.light_meshes
        layout.prop(settings, "mode")
        layout.prop(settings, "samples")
        if settings.mode == 'WHITTED':
            layout.prop(settings, "max_depth")
        layout.prop(settings, "ambient")


class LIGHT_MESHES_PT_shadows(_Panel, bpy.types.Panel):
    bl_label = "Shadows"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.scene.light_meshes.mode != 'LOCAL'

    def fill(self, layout, context):
        settings = context.scene.light_meshes
        layout.prop(settings, "shadows")
        if settings.shadows == 'LIGHT_MESHES':
            layout.prop(settings, "auto_h")
            row = layout.row()
            row.active = not settings.auto_h
            row.prop(settings, "h")
            layout.prop(settings, "kI")
        elif settings.shadows == 'AREA_SAMPLING':
            layout.prop(settings, "light_samples")


class LIGHT_MESHES_PT_glass(_Panel, bpy.types.Panel):
    bl_label = "Glass"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        settings = context.scene.light_meshes
        layout.prop(settings, "refraction")
        soft = settings.mode != 'LOCAL' and settings.shadows == 'LIGHT_MESHES'
        if soft:
            layout.prop(settings, "glass")
        if settings.refraction == 'FULL':
            layout.prop(settings, "caustics")
            if soft:
                layout.prop(settings, "leak_free")


class LIGHT_MESHES_PT_film(_Panel, bpy.types.Panel):
    bl_label = "Film"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        layout.prop(context.scene.render, "filter_size")
        layout.prop(context.scene.render, "film_transparent", text="Transparent")


class LIGHT_MESHES_PT_passes(_Panel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def fill(self, layout, context):
        column = layout.column(heading="Include", align=True)
        for name in ("use_pass_combined", "use_pass_z", "use_pass_normal", "use_pass_shadow"):
            column.prop(context.view_layer, name)


class LIGHT_MESHES_PT_override(_Panel, bpy.types.Panel):
    bl_label = "Override"
    bl_context = "view_layer"
    bl_options: ClassVar = {'DEFAULT_CLOSED'}

    def fill(self, layout, context):
        for name in ("material_override", "world_override", "samples"):
            layout.prop(context.view_layer, name)


class LIGHT_MESHES_PT_light(_Panel, bpy.types.Panel):
    bl_label = "Light"
    bl_context = "data"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.light

    def fill(self, layout, context):
        light = context.light
        layout.prop(light, "type")
        if hasattr(light, "use_temperature"):  # 4.5+
            row = layout.row(heading="Temperature")
            row.prop(light, "use_temperature", text="")
            sub = row.row()
            sub.active = light.use_temperature
            sub.prop(light, "temperature", text="")
        layout.prop(light, "color")
        layout.prop(light, "energy")
        for name in ("exposure", "normalize"):  # 4.5+
            if hasattr(light, name):
                layout.prop(light, name)
        if light.type == 'SPOT':
            layout.prop(light, "spot_size", text="Cone")
            layout.prop(light, "spot_blend", text="Blend", slider=True)
        elif light.type == 'AREA':
            layout.prop(light, "spread")


class LIGHT_MESHES_PT_light_shadow(_Panel, bpy.types.Panel):
    bl_label = "Shadow"
    bl_context = "data"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.light

    def draw_header(self, context):
        self.layout.prop(context.light, "use_shadow", text="")

    def fill(self, layout, context):
        light = context.light
        layout.active = light.use_shadow
        layout.prop(light.light_meshes, "soft_shadows")
        # The size counts where it is sampled only, but a light has one in every engine.
        column = layout.column()
        column.active = context.scene.light_meshes.shadows == 'AREA_SAMPLING'
        if light.type == 'SUN':
            column.prop(light, "angle")
        elif light.type == 'AREA':
            column.prop(light, "shape")
            column.prop(light, "size")
            if light.shape in {'RECTANGLE', 'ELLIPSE'}:
                column.prop(light, "size_y", text="Y")
        else:
            column.prop(light, "shadow_soft_size", text="Radius")


class LIGHT_MESHES_PT_ray_visibility(_Panel, bpy.types.Panel):
    bl_label = "Ray Visibility"
    bl_context = "object"
    bl_parent_id = "OBJECT_PT_visibility"

    def fill(self, layout, context):
        column = layout.column()
        column.prop(context.object, "visible_camera", text="Camera")
        column.prop(context.object, "visible_glossy", text="Mirrors")
        column.prop(context.object, "visible_shadow", text="Shadow")


class LIGHT_MESHES_PT_material(_Panel, bpy.types.Panel):
    bl_label = "Light Meshes"
    bl_context = "material"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.material

    def fill(self, layout, context):
        material = context.material
        settings = material.light_meshes
        report = Report()
        surface = translate(material, report)
        translated = surface.whitted()
        for name in PARAMETERS:
            overridden = getattr(settings, f"override_{name}")
            label = settings.bl_rna.properties[name].name
            row = layout.row(heading=label)
            row.prop(settings, f"override_{name}", text="")
            if overridden:
                row.prop(settings, name, text="")
            elif name == "Od" and surface.image:
                row.label(text=surface.image.image.name, icon='IMAGE_DATA')
            else:
                value = translated[name]
                row.label(text="  ".join(f"{v:.3g}" for v in (value if isinstance(value, list) else [value])))
        layout.prop(settings, "priority")
        layout.prop(material, "use_transparent_shadow")
        for sentence in report.sentences:
            layout.label(text=sentence, icon='ERROR')


_CLASSES = (
    LIGHT_MESHES_PT_method,
    LIGHT_MESHES_PT_shadows,
    LIGHT_MESHES_PT_glass,
    LIGHT_MESHES_PT_film,
    LIGHT_MESHES_PT_passes,
    LIGHT_MESHES_PT_override,
    LIGHT_MESHES_PT_light,
    LIGHT_MESHES_PT_light_shadow,
    LIGHT_MESHES_PT_ray_visibility,
    LIGHT_MESHES_PT_material,
)
# Blender's panels for engines in general that say nothing to this one, or that ours replace.
_EXCLUDED = {
    "DATA_PT_light", "DATA_PT_spot", "DATA_PT_area", "DATA_PT_falloff_curve", "NODE_DATA_PT_light",
}
# Panels of EEVEE that show what this engine reads: shader nodes, depth of field.
_EEVEES = {
    "MATERIAL_PT_preview", "EEVEE_MATERIAL_PT_context_material", "EEVEE_MATERIAL_PT_surface",
    "EEVEE_WORLD_PT_surface", "DATA_PT_camera_dof", "DATA_PT_camera_dof_aperture",
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


def unregister() -> None:
    for panel in bpy.types.Panel.__subclasses__():
        if panel not in _CLASSES:
            getattr(panel, "COMPAT_ENGINES", set()).discard(ENGINE)
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
