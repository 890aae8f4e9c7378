"""Materials: node trees → Whitted's parameters, with the artist's overrides."""

from collections.abc import Iterable
from pathlib import Path

from .images import Images
from .nodes import Nodes, uses_nodes
from .report import Report
from .surface import Surface
from .surface_nodes import surface

DEFAULT = "default"  # of faces without a material
_TUPLES = {"Od", "Os", "mirror", "emission", "kt"}


class Materials:
    """The materials and images of a snapshot, each once."""

    def __init__(self, report: Report, folder: Path, depsgraph) -> None:
        self.descriptions: list[dict] = []
        self._images = Images(report, folder)
        self._report = report
        self.every_uv = depsgraph.view_layer_eval.use_pass_uv  # the UV pass wants them, with images or without
        self._depsgraph = depsgraph
        self._override = depsgraph.view_layer_eval.material_override
        self._indices: dict[int, int] = {}
        self._uv_maps: list[str | None] = []

    @property
    def images(self) -> list[dict]:
        return self._images.descriptions

    def index(self, material) -> int:
        """Number of `material` (None: Blender's default), translated when first asked for.

        The view layer may have one material instead of all.
        """
        material = self._override or material
        key = material.original.as_pointer() if material else 0
        if key not in self._indices:
            self._indices[key] = len(self.descriptions)
            if material is None:
                self._append(DEFAULT, Surface())
            else:
                material = material.evaluated_get(self._depsgraph)
                self._append(material.name, translate(material, self._report), material)
        return self._indices[key]

    def uv_map(self, indices: Iterable[int]) -> str | None:
        """The UV map that the images of these materials want: a name, "" for the mesh's own, None for no images."""
        maps = [m for m in (self._uv_maps[i] for i in indices) if m is not None]
        return maps[0] if maps else None

    def _append(self, name: str, surface: Surface, material=None) -> None:
        description = {"name": name, "image": -1, "alpha_image": -1} | surface.whitted()
        overrides = material.light_meshes if material else None
        if overrides:
            description |= _overrides(overrides) | {
                 name: getattr(overrides, name) for name in ("priority", "cast_soft_shadows", "receive_soft_shadows")}
            description |= {"transparent_shadow": material.use_transparent_shadow, "index": material.pass_index}
        if surface.image and not (overrides and overrides.override_Od):
            description["image"] = self._images.index(surface.image)
        if surface.alpha_image and not (overrides and overrides.override_alpha):
            description["alpha_image"] = self._images.index(surface.alpha_image)
        self.descriptions.append(description)
        self._uv_maps.append(surface.uv_map if max(description["image"], description["alpha_image"]) >= 0 else None)


def translate(material, report: Report) -> Surface:
    """The surface that the nodes of `material` describe, or its viewport colours where it has none."""
    if uses_nodes(material):
        nodes = Nodes(material.node_tree, f"Material '{material.name}'", report)
        return surface(nodes, nodes.output('ShaderNodeOutputMaterial'))
    return Surface.principled(
        tuple(material.diffuse_color)[:3], material.metallic, material.roughness, material.specular_intensity)


def translated_value(material, name: str):
    """Whitted's parameter `name` as translated from the nodes, without overrides: what the panel shows."""
    return translate(material, Report()).whitted()[name]


def _overrides(settings) -> dict:
    values = {}
    for name in Surface().whitted():
        if getattr(settings, f"override_{name}"):
            value = getattr(settings, name)
            values[name] = list(value) if name in _TUPLES else value
    return values
