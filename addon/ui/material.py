"""Panels of a material."""

import bpy

from ..export.materials import translate
from ..export.report import Report
from ..properties import PARAMETERS
from .panel import LightMeshesPanel, paragraph


class _MaterialPanel(LightMeshesPanel):
    bl_context = "material"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.material


class LIGHT_MESHES_PT_material(_MaterialPanel, bpy.types.Panel):
    bl_label = "Light Meshes"

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
        for sentence in report.sentences:
            paragraph(layout, context, sentence, 'ERROR')


class LIGHT_MESHES_PT_material_shadows(_MaterialPanel, bpy.types.Panel):
    bl_label = "Shadows"

    def fill(self, layout, context):
        material = context.material
        layout.prop(material, "use_transparent_shadow")
        column = layout.column(heading="Soft Shadows")
        column.prop(material.light_meshes, "cast_soft_shadows", text="Cast")
        column.prop(material.light_meshes, "receive_soft_shadows", text="Receive")


CLASSES = (LIGHT_MESHES_PT_material, LIGHT_MESHES_PT_material_shadows)
