"""Panels of a material."""

import bpy

from ..export.materials import translate, typical
from ..export.report import Report
from ..surface_properties import PARAMETERS, translated
from .panel import LightMeshesPanel, in_shader_editor, paragraph


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
        found = surface.whitted()
        translated[material.session_uid] = values = {name: typical(name, value) for name, value in found.items()}
        for name in PARAMETERS:
            overridden = getattr(settings, f"override_{name}")
            label = settings.bl_rna.properties[name].name
            row = layout.row(heading=label)
            row.prop(settings, f"override_{name}", text="")
            if overridden:
                row.prop(settings, name, text="")
            elif values[name] is not found[name]:
                row.label(text="From its nodes", icon='NODE_MATERIAL')
            elif isinstance(values[name], list):
                row.prop(material.light_meshes_translated, name, text="")
            elif isinstance(values[name], bool):
                row.label(text="On" if values[name] else "Off")
            else:
                row.label(text=f"{values[name]:.3g}")
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


_PANELS = (LIGHT_MESHES_PT_material, LIGHT_MESHES_PT_material_shadows)
CLASSES = (*_PANELS, *map(in_shader_editor, _PANELS))
