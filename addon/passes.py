"""The one list of render passes: registration, the engine's request and the picture all read it."""

from typing import NamedTuple


class Pass(NamedTuple):
    """A pass, by Blender's name and by the engine's."""

    name: str  # in Blender
    engine_name: str
    channel_ids: str
    kind: str  # what the compositor makes of it
    switch: str  # the view layer's property that asks for it

    @property
    def channels(self) -> int:
        return len(self.channel_ids)


ALL = (
    Pass("Combined", "Combined", "RGBA", 'COLOR', "use_pass_combined"),
    Pass("Depth", "Depth", "Z", 'VALUE', "use_pass_z"),
    Pass("Normal", "Normal", "XYZ", 'VECTOR', "use_pass_normal"),
    Pass("Shadow", "Shadow", "RGB", 'COLOR', "use_pass_shadow"),
)


def wanted(view_layer) -> list[Pass]:
    """The passes that `view_layer` asks for. Blender always has Combined."""
    return [p for p in ALL if p.name == "Combined" or getattr(view_layer, p.switch)]
