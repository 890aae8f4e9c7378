"""Translate the node trees of materials to Whitted's parameters, with the artist's overrides."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import bpy

from ..cryptomatte import DEFAULT
from . import values
from .channels import Asked, Channels, Key
from .facets import FORMULAS
from .ies import Profiles
from .images import Images
from .nodes import Nodes, uses_nodes
from .report import Report
from .surface import Surface
from .surface_nodes import surface

_PHONG = {"ks", "Os", "nShiny"}  # an override of one of these has Phong's highlights
_TUPLES = {"Od", "Os", "mirror", "emission", "kt"}


class Materials:
    """The materials and images of a snapshot, each once."""

    def __init__(self, report: Report, folder: Path, depsgraph) -> None:
        self.descriptions: list[dict] = []
        self._images = Images(folder)
        self.every_uv = False  # whether UVs are needed also without images, for the UV pass
        self._indices: dict[int, int] = {}
        self._uv_maps: list[str | None] = []
        self._channels = Channels()
        self.profiles = Profiles()  # of IES files, also of lamps and of the world
        self._asked_for: list[Asked] = []  # by each material's program
        self._reports: list[Report] = []  # of each material's translation
        self._translated: set[int] = set()
        self.begin(report, depsgraph)

    def begin(self, report: Report, depsgraph, changed: bool = False, repainted: bool = False) -> None:
        """Begin another snapshot. The same materials keep their numbers. They may have `changed`, and their images may
        have been `repainted`.
        """
        self._report, self.depsgraph = report, depsgraph
        self._override = depsgraph.view_layer_eval.material_override
        self._asked: set[int] = set()
        frame = depsgraph.scene_eval.frame_current
        changed |= self._images.moves and frame != self._images.frame
        self._images.frame = frame
        if changed or repainted:
            self._translated.clear()
            self._images.clear(repainted)
            # Should one not be asked for any more.
            self.descriptions = [{name: value for name, value in d.items() if name != "program"}
                                 | {"image": -1, "alpha_image": -1} for d in self.descriptions]

    def forget_files(self, names: set[str]) -> None:
        """Forget these files in the snapshot's folder, which were removed."""
        self._images.forget_files(names)

    @property
    def images(self) -> list[dict]:
        return self._images.descriptions

    def image(self, node, report: Report, tile: int = 0) -> int:
        """Return the number of the image of a node of a lamp or the world; negative where it cannot be had."""
        return self._images.index(node, report, tile)

    @property
    def textured(self) -> bool:
        """Return whether any material is placed by a UV map."""
        return any(name is not None for name in self._uv_maps)

    def index(self, material) -> int:
        """Return the number of `material` (None: Blender's default). It is translated when it is first asked for.

        The view layer may have one material instead of all.
        """
        material = self._override or material
        key = material.original.session_uid if material else 0
        index = self._indices.setdefault(key, len(self._indices))
        if key not in self._translated:
            report = Report()
            self._translate(index, material.evaluated_get(self.depsgraph) if material else None, report)
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

    def uv_maps(self, indices: Iterable[int]) -> tuple[str | None, ...]:
        """Return the UV map that each of these materials wants: a name, "" for the mesh's own, None for no images."""
        return tuple(self._uv_maps[i] for i in indices)

    def corners(self, indices: Iterable[int]) -> dict[Key, int]:
        """Return the values for which these materials ask at the corners of triangles, and their channels, in order."""
        return _numbered(self._channels.corners, [self._asked_for[i].corners for i in indices])

    def instances(self, indices: Iterable[int]) -> dict[Key, int]:
        """Return the values for which these materials ask of instances, and their channels."""
        return _numbered(self._channels.instances, [self._asked_for[i].instances for i in indices])

    def _translate(self, index: int, material, report: Report) -> None:
        asked = Asked(self._channels)
        nodes = _nodes(material, report, lambda node, tile: self._images.index(node, report, tile), asked)
        if nodes:
            nodes.profiles = self.profiles
        surface = translated(material, nodes)
        if material and surface.normal and not getattr(  # Cycles may be switched off
                getattr(material, "cycles", None), "use_bump_map_correction", True):
            report.warn("Bump Map Correction is switched off, but bumps are rendered with it", "Material",
                        material.name)
        description: dict[str, Any] = {"name": material.name if material else DEFAULT, "image": -1, "alpha_image": -1}
        overrides = material.light_meshes if material else None
        layers = _layers(surface, _overrides(overrides) if overrides else {})
        if nodes and nodes.displaced:
            layers[0]["displaced"] = list(nodes.displaced)
        description |= _written(*layers)
        if overrides:
            description |= {
                 name: getattr(overrides, name) for name in ("priority", "cast_soft_shadows", "receive_soft_shadows")}
            description |= {"transparent_shadow": material.use_transparent_shadow, "index": material.pass_index}
        self.descriptions[index:index + 1] = [description]
        self._uv_maps[index:index + 1] = [nodes.uv_map if nodes and _uses_uv(description) else None]
        self._asked_for[index:index + 1] = [asked]
        values.forget()


def _nodes(material, report: Report, image, asked: Asked | None = None) -> Nodes | None:
    if not (material and uses_nodes(material)):
        return None
    nodes = Nodes(material.node_tree, "Material", material.name, report, image, asked)
    nodes.pass_index, nodes.displacement_method = material.pass_index, material.displacement_method
    return nodes


def _numbered(channels: dict[Key, int], asked: Iterable[set[Key]]) -> dict[Key, int]:
    """Return those channels that are asked for, in the order of their numbers."""
    return {key: channels[key] for key in sorted(set().union(*asked), key=channels.__getitem__)}


def translated(material, nodes: Nodes | None) -> Surface:
    """Return the surface that the nodes of `material` describe, or its viewport colour if it has no nodes (None:
    Blender's default).
    """
    if nodes:
        return surface(nodes, nodes.output('ShaderNodeOutputMaterial'))
    if material:
        return Surface.diffuse(tuple(material.diffuse_color)[:3])  # as Cycles
    # Without any material Cycles shows a matt surface, and since 5.0 a new Principled BSDF.
    return Surface.principled((0.8, 0.8, 0.8), 0.0, 0.5, 0.5) if bpy.app.version >= (5, 0) else Surface()


def translate(material, report: Report) -> Surface:
    """Return the surface of `material` for who only wants to look at it: images have no numbers."""
    return translated(material, _nodes(material, report, lambda node, tile: 0))


# What stands for a value that differs from place to place, where a single one is wanted: in the panel when an override
# begins, and in the engine's plan.
_TYPICAL = {"ka": 1.0, "kd": 1.0, "Od": [0.8] * 3, "ks": 0.5, "Os": [1.0] * 3, "nShiny": 50.0, "mirror": [0.5] * 3,
            "emission": [0.5] * 3, "kt": [0.5] * 3, "ior": 1.5, "alpha": 0.5, "frosted": 0.5,
            "diffuse_roughness": 0.5, "translucent": [0.5] * 3,
            "roughness": 0.5, "metal": 0.5, "F0": [0.8] * 3, "F90": [1.0] * 3, "F82": [1.0] * 3, "dielectric": 0.5,
            "dielectric_ior": 1.5, "dielectric_tint": [1.0] * 3, "layered": 1.0, "compensation": 1.0,
            "coat": 0.5, "coat_roughness": 0.1, "coat_ior": 1.5, "coat_tint": [1.0] * 3,
            "sheen": 0.5, "sheen_roughness": 0.3, "sheen_tint": [1.0] * 3, "share": 1.0}


# What only the first layer of a material says, as it holds for the surface as a whole.
_OF_ALL = {"emission", "kt", "ior", "fresnel", "alpha", "frosted"}


def _layers(surface: Surface, chosen: dict[str, Any]) -> list[dict[str, Any]]:
    """Return `_parameters` of each layer. Overrides of the artist are for the whole surface, which then is one layer.
    """
    if chosen:
        return [_parameters(surface.merged(), chosen)]
    first, *further = (_parameters(part, {}) for part in surface.parts())
    layers = ({name: value for name, value in layer.items() if name not in _OF_ALL} for layer in further)
    return [first | {"alpha": surface.alpha}, *layers]


def _parameters(surface: Surface, chosen: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of the engine's Material for a surface, with those that the artist has chosen instead."""
    highlight = None if chosen.keys() & _PHONG else surface.facets.parameters()
    found = surface.whitted(phong=not highlight) | FORMULAS | chosen
    if not values.is_constant(surface.frosted) or surface.frosted > 1e-3:
        found["frosted"] = values.clamp(surface.frosted)
    if not values.is_constant(surface.diffuse_roughness) or surface.diffuse_roughness > 0:
        found["diffuse_roughness"] = values.clamp(surface.diffuse_roughness)
    if not values.is_constant(*surface.translucent) or any(surface.translucent):
        found["translucent"] = list(surface.translucent)
    if highlight:
        # Phong's stand for these where one number must do, as in the engine's plan.
        found |= highlight | {name: typical(name, found[name]) for name in _PHONG}
        if "mirror" not in chosen and not surface.fresnel:
            # Reflected rays follow the same lobes, and find the world's light, too. What mirrors sharply is lit in full
            # where other rough surfaces show it: a program says it point by point.
            found["blurred"] = True
            if "ka" not in chosen:
                found["ka"] = found["kd"]
    return found


def typical(name: str, value: Any) -> Any:
    """Return Whitted's parameter `name` with the value that was translated, or a typical one if it differs over the
    surface.
    """
    channels = value if isinstance(value, list) else [value]
    return value if values.is_constant(*channels) else _TYPICAL[name]


def _written(*layers: dict[str, Any]) -> dict[str, Any]:
    """Return Whitted's parameters as the engine's Material has them, layer by layer: numbers, images, and one program
    for everything else.
    """
    descriptions: list[dict[str, Any]] = []
    varies: dict[str, Any] = {}
    for n, found in enumerate(layers):
        description, own = _plain(found)
        descriptions.append({"name": f"layer {n}"} | description if n else description)
        varies |= {f"{n}.{name}" if n else name: value for name, value in own.items()}
    first, *further = descriptions
    if further:
        first["layers"] = further
    if varies:
        operations, results = values.compiled(varies)
        first["program"] = {"operations": operations, "values": results}
    return first


# Values of programs only: normals, for shading, of coat and fibres, and with displacement shown as bumps.
_NORMALS = {"normal", "coat_normal", "sheen_normal", "displaced"}


def _plain(found: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return those parameters of a layer that are numbers or images, and the rest, which needs a program."""
    description = {name: typical(name, value) for name, value in found.items() if name not in _NORMALS}
    varies = {name: value for name, value in found.items() if name in _NORMALS or description[name] is not value}
    if "Od" in varies and (image := values.plain_image(varies["Od"], 0)) >= 0:
        description["image"] = image
        del varies["Od"]
    if "alpha" in varies and (image := values.plain_image([varies["alpha"]], 3)) >= 0:
        description |= {"alpha_image": image, "alpha": 1.0}
        del varies["alpha"]
    return description, varies


def _uses_uv(description: dict[str, Any]) -> bool:
    """Return whether anything that is left after overrides is placed by a UV map."""
    program = description.get("program", {"operations": []})
    images = [layer.get("image", -1) for layer in description.get("layers", ())]
    return (max(description["image"], description["alpha_image"], *images) >= 0
            or any(name == "uv" for name, *_ in program["operations"]))


def translated_value(material, name: str):
    """Return Whitted's parameter `name` as translated from the nodes, without overrides; the panel shows it."""
    return typical(name, _parameters(translate(material, Report()).merged(), {})[name])


_OVERRIDDEN = tuple(Surface().whitted())


def _overrides(settings) -> dict:
    found = {}
    for name in _OVERRIDDEN:
        if getattr(settings, f"override_{name}"):
            value = getattr(settings, name)
            found[name] = list(value) if name in _TUPLES else value
    return found
