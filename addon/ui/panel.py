"""Functions and base classes that all panels use."""

import textwrap
from typing import Any, ClassVar

from ..console import shown

ENGINE = 'LIGHT_MESHES'


class LightMeshesPanel:
    """A panel in the properties editor that is shown only while this engine is chosen."""

    bl_space_type = 'PROPERTIES'
    bl_region_type = 'WINDOW'
    bl_context = "render"
    COMPAT_ENGINES: ClassVar = {ENGINE}
    layout: Any  # Blender's

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        self.fill(layout, context)

    def fill(self, layout, context):
        raise NotImplementedError


def in_shader_editor(panel):
    """Return a copy of the panel for the sidebar of the shader editor (tab Options), where Blender also repeats its own
    panels.
    """
    own = {name: value for name, value in vars(panel).items() if name not in {"__dict__", "__weakref__", "bl_rna"}}
    place = {"bl_space_type": 'NODE_EDITOR', "bl_region_type": 'UI', "bl_category": "Options", "bl_context": ""}
    return type(f"NODE_{panel.__name__}", panel.__bases__, own | place)


def table(layout, context, rows: list[tuple[str, str]]) -> None:
    """Draw rows of a name and a text, aligned like Blender's properties. Long texts are wrapped."""
    column = layout.column(align=True)
    for name, text in rows:
        for n, line in enumerate(_lines(context, shown(text), 0.58)):
            split = column.split(factor=0.4)
            left = split.row()
            left.alignment = 'RIGHT'
            left.label(text="" if n else shown(name))
            split.label(text=line)


def paragraph(layout, context, text: str, icon: str = 'NONE') -> None:
    """Draw a text on several lines."""
    column = layout.column(align=True)
    for n, line in enumerate(_lines(context, text, 0.9)):
        column.label(text=line, icon=icon if n == 0 else ('BLANK1' if icon != 'NONE' else 'NONE'))


def _lines(context, text: str, share: float) -> list[str]:
    """Split `text` into lines that fit into `share` of the region's width."""
    letter = 6.5 * context.preferences.system.ui_scale  # average width of a letter in pixels
    width = context.region.width if context.region else 400
    return textwrap.wrap(text, max(int(share * width / letter), 12)) or [""]
