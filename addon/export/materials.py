"""Translate the node trees of materials to Whitted's parameters, with the artist's overrides."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..cryptomatte import DEFAULT
from .images import Images
from .nodes import Nodes, uses_nodes
from .report import Report
from .surface import Surface
from .surface_nodes import surface

_TUPLES = {"Od", "Os", "mirror", "emission", "kt"}


class Materials:
    """The materials and images of a snapshot, each once."""

    def __init__(self, report: Report, folder: Path, depsgraph) -> None:
        self.descriptions: list[dict] = []
        self._images = Images(folder)
        self.every_uv = False  # whether UVs are needed also without images, for the UV pass
        self._indices: dict[int, int] = {}
        self._uv_maps: list[str | None] = []
        self._reports: list[Report] = []  # the warnings of each material's translation
        self._translated: set[int] = set()
        self.begin(report, depsgraph)

    def begin(self, report: Report, depsgraph, changed: bool = False, repainted: bool = False) -> None:
        """Begin another snapshot. The same materials keep their numbers. They may have `changed`, and their images may
        have been `repainted`.
        """
        self._report, self._depsgraph = report, depsgraph
        self._override = depsgraph.view_layer_eval.material_override
        self._asked: set[int] = set()
        frame = depsgraph.scene_eval.frame_current
        changed |= self._images.moves and frame != self._images.frame
        self._images.frame = frame
        if changed or repainted:
            self._translated.clear()
            self._images.clear(repainted)
            # In case it is not asked for any more.
            self.descriptions = [d | {"image": -1, "alpha_image": -1} for d in self.descriptions]

    def forget_files(self, names: set[str]) -> None:
        """Forget these files in the snapshot's folder, which were removed."""
        self._images.forget_files(names)

    @property
    def images(self) -> list[dict]:
        return self._images.descriptions

    def index(self, material) -> int:
        """Return the number of `material` (None: Blender's default). It is translated when it is first asked for.

        The view layer may have one material instead of all.
        """
        material = self._override or material
        key = material.original.session_uid if material else 0
        index = self._indices.setdefault(key, len(self._indices))
        if key not in self._translated:
            report = Report()
            self._translate(index, material.evaluated_get(self._depsgraph) if material else None, report)
            self._reports[index:index + 1] = [report]
            self._translated.add(key)
        if key not in self._asked:
            self._asked.add(key)
            self._report.add(self._reports[index])
        return index

    def is_nothing(self, index: int) -> bool:
        """Return whether the material is no surface at all, like one with only a volume. Such a surface must not affect
        soft shadows.
        """
        description = self.descriptions[index]
        return description["alpha"] == 0 and description["alpha_image"] < 0

    def uv_map(self, indices: Iterable[int]) -> str | None:
        """Return the UV map that the images of these materials need: a name, "" for the mesh's default, None if there
        are no images.
        """
        maps = [m for m in (self._uv_maps[i] for i in indices) if m is not None]
        return maps[0] if maps else None

    def _translate(self, index: int, material, report: Report) -> None:
        surface = translate(material, report) if material else Surface()
        description: dict[str, Any] = {"name": material.name if material else DEFAULT, "image": -1, "alpha_image": -1}
        description |= surface.whitted()
        overrides = material.light_meshes if material else None
        if overrides:
            description |= _overrides(overrides) | {
                 name: getattr(overrides, name) for name in ("priority", "cast_soft_shadows", "receive_soft_shadows")}
            description |= {"transparent_shadow": material.use_transparent_shadow, "index": material.pass_index}
        if surface.image and not (overrides and overrides.override_Od):
            description["image"] = self._images.index(surface.image, report)
        if surface.alpha_image and not (overrides and overrides.override_alpha):
            description["alpha_image"] = self._images.index(surface.alpha_image, report)
        textured = max(description["image"], description["alpha_image"]) >= 0
        self.descriptions[index:index + 1] = [description]
        self._uv_maps[index:index + 1] = [surface.uv_map if textured else None]


def translate(material, report: Report) -> Surface:
    """Return the surface that the nodes of `material` describe, or its viewport colour if it has no nodes."""
    if uses_nodes(material):
        nodes = Nodes(material.node_tree, "Material", material.name, report)
        return surface(nodes, nodes.output('ShaderNodeOutputMaterial'))
    return Surface.diffuse(tuple(material.diffuse_color)[:3])  # as in Cycles


def translated_value(material, name: str):
    """Return Whitted's parameter `name`, translated from the nodes, without overrides. The panel shows it."""
    return translate(material, Report()).whitted()[name]


def _overrides(settings) -> dict:
    values = {}
    for name in Surface().whitted():
        if getattr(settings, f"override_{name}"):
            value = getattr(settings, name)
            values[name] = list(value) if name in _TUPLES else value
    return values
