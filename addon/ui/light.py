"""Panels of a light."""

import bpy

from .. import penumbra
from ..softness import has_size, softness_of
from .panel import LightMeshesPanel, in_shader_editor, table


class _LightPanel(LightMeshesPanel):
    bl_context = "data"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.light


class LIGHT_MESHES_PT_light(_LightPanel, bpy.types.Panel):
    bl_label = "Light"

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
        _draw_size(layout, light)


def _draw_size(layout, light):
    if light.type == 'SUN':
        layout.prop(light, "angle")
    elif light.type == 'AREA':
        layout.prop(light, "shape")
        layout.prop(light, "size")
        if light.shape in {'RECTANGLE', 'ELLIPSE'}:
            layout.prop(light, "size_y", text="Y")
    else:
        layout.prop(light, "shadow_soft_size", text="Radius")


class LIGHT_MESHES_PT_light_shadow(_LightPanel, bpy.types.Panel):
    bl_label = "Shadow"

    def draw_header(self, context):
        self.layout.prop(context.light, "use_shadow", text="")

    def fill(self, layout, context):
        light, scene = context.light, context.scene
        own = light.light_meshes
        layout.active = light.use_shadow
        layout.prop(own, "soft_shadows")
        if scene.light_meshes.shadows != 'LIGHT_MESHES':
            return
        column = layout.column()
        column.active = own.soft_shadows
        column.prop(own, "softness")
        softness = softness_of(light)
        if softness == 'RADIUS':
            column.prop(own, "radius")
        elif softness == 'LIGHT_SIZE':
            column.prop(own, "reference_distance")
        if own.soft_shadows:
            table(column, context, _meaning(scene, light, context.object.name if context.object else ""))


def _meaning(scene, light, name: str) -> list[tuple[str, str]]:
    """Return the resulting radius and edge width as text."""
    if softness_of(light) == 'SIZE':
        return [("Shadow Edges", "wider farther from what casts them" if has_size(light) else "sharp: no size")]
    r = penumbra.light_radius(scene, light, name)
    if r is None:
        return [("Shadow Edges", "measured when rendering")]
    rows = [("Radius r", penumbra.length(scene, r)), ("Shadow Edges", f"{penumbra.length(scene, 2 * r)} wide")]
    on_screen = penumbra.pixels(scene, r)
    return [*rows, ("", "{:.0f} pixels {}".format(*on_screen))] if on_screen else rows


class LIGHT_MESHES_PT_light_nodes(_LightPanel, bpy.types.Panel):
    bl_label = "Nodes"

    def fill(self, layout, context):
        from bpy_extras.node_utils import find_node_input

        light = context.light
        layout.prop(light, "use_nodes", icon='NODETREE')
        if not light.use_nodes:
            return
        node = light.node_tree.get_output_node('CYCLES')
        socket = node and find_node_input(node, "Surface")
        if socket:
            layout.template_node_view(light.node_tree, node, socket)
        else:
            layout.label(text="No output node")


_PANELS = (LIGHT_MESHES_PT_light, LIGHT_MESHES_PT_light_shadow)
CLASSES = (*_PANELS, LIGHT_MESHES_PT_light_nodes, *map(in_shader_editor, _PANELS))
