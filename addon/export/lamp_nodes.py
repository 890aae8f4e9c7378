"""The nodes of lamps: the factor by which they multiply a lamp's light, as numbers or as a program of the engine.

A lamp has no surface. This module has what Cycles returns for nodes that ask about one, and nodes that only lamps have.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from . import ies, left_out
from . import values as v
from .channels import instance_value
from .image_files import refusal
from .materials import Materials
from .node_inputs import geometry, incoming, normal, object_info, position, texture_coordinates
from .node_math import scaled
from .nodes import Nodes
from .report import Report
from .values import Triple, Value

_BLACK = (0.0, 0.0, 0.0)
_OBJECTS = bpy.app.version >= (4, 4)  # before, Cycles' lamps have no space of their own, and no numbers
MISSING = 100.0  # what an IES Texture gives in Cycles where it has no file


class Profiles:
    """The profiles of a snapshot, each once."""

    def __init__(self) -> None:
        self.descriptions: list[dict] = []
        self._numbers: dict[str, int] = {}  # of texts; −1: it is none

    def index(self, name: str, text: str) -> int:
        """Return the number of the profile of an IES file's text; −1 where it is no such text."""
        if text not in self._numbers:
            found = ies.parsed(text)
            self._numbers[text] = len(self.descriptions) if found else -1
            if found:
                self.descriptions.append({"name": name} | found)
        return self._numbers[text]


class OfLamp:
    """The values for which a lamp's nodes ask: none at corners, and numbers of its object; as `Asked` for surfaces."""

    def __init__(self, instance: Any, ob: Any, depsgraph: Any) -> None:
        self._instance, self._ob, self._depsgraph = instance, ob, depsgraph

    def corner(self, *key: Any) -> Value:
        """Return the value for "no such attribute": a lamp has none."""
        return 0.0

    def instance(self, *key: Any) -> Value:
        """Return a number of the lamp's object."""
        if not _OBJECTS and key[0] == "property":
            return 0.0
        return instance_value(key, self._instance, self._ob, self._ob, self._depsgraph)


class LampNodes(Nodes):
    """The node tree of a lamp."""

    def __init__(self, lamp: Any, asked: Any, report: Report, materials: Materials, profiles: Profiles,
                 matrix: np.ndarray) -> None:
        """matrix (4,4): the transformation from the lamp's own space to the world."""
        super().__init__(lamp.node_tree, "Light", lamp.name, report,
                         lambda node, tile: materials.image(node, report, tile), asked)
        self.uv_map = ""  # other maps are not there
        self.own, self.matrix, self.type, self.profiles = _OWN, matrix, lamp.type, profiles


def emission(nodes: LampNodes) -> Triple | None:
    """Return the factor of the light; None if there are nodes that the engine does not know."""
    return _shader(nodes, nodes.output('ShaderNodeOutputLight'), "Surface")


def _shader(nodes: LampNodes, node: Any, socket: Any) -> Triple | None:
    """Return the light of the shader at an input; shaders of surfaces give none."""
    source = nodes.source(node, socket) if node is not None else None
    if source is None:
        return _BLACK
    if source.bl_idname == 'ShaderNodeEmission':
        left_out.inputs(nodes, source)
        return scaled(nodes.color(source, "Color"), nodes.value(source, "Strength"))
    if source.bl_idname == 'ShaderNodeAddShader':
        return _sum(_shader(nodes, source, 0), _shader(nodes, source, 1))
    if source.bl_idname == 'ShaderNodeMixShader':
        factor = v.clamp(nodes.value(source, 0))
        if v.is_constant(factor) and factor in (0.0, 1.0):
            return _shader(nodes, source, 1 + int(factor))
        first, second = (_shader(nodes, source, n) for n in (1, 2))
        return _sum(first and scaled(first, 1.0 - factor), second and scaled(second, factor))
    if source.bl_idname in _DARK:
        return _BLACK
    nodes.not_translated(source, "the light shines in its own colour")
    return None


def _sum(a: Triple | None, b: Triple | None) -> Triple | None:
    if a is None or b is None:
        return None
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


_DARK = {f'ShaderNode{name}' for name in (
    'BsdfDiffuse', 'BsdfGlossy', 'BsdfAnisotropic', 'BsdfMetallic', 'BsdfGlass', 'BsdfRefraction', 'BsdfTransparent',
    'BsdfTranslucent', 'BsdfSheen', 'BsdfToon', 'BsdfVelvet', 'BsdfHair', 'SubsurfaceScattering', 'Holdout')}


def _falloff(nodes: LampNodes, node: Any, socket: Any) -> Value:
    """Translate the Light Falloff node."""
    strength = nodes.value(node, "Strength")
    if nodes.type == 'SUN':
        return strength
    far = v.operation("ray_length")
    square = far * far
    smooth = nodes.value(node, "Smooth")
    if not (v.is_constant(smooth) and smooth <= 0):
        eased = v.divide(square, smooth + square)
        strength = strength * (eased if v.is_constant(smooth) else v.where(v.greater(smooth, 0.0), eased, 1.0))
    return {"Quadratic": strength, "Linear": strength * far, "Constant": strength * square}[socket.name]


def _ies(nodes: LampNodes, node: Any, socket: Any) -> Value:
    """Translate the IES Texture node."""
    strength = nodes.value(node, "Strength")
    name, text = _text(nodes, node)
    number = nodes.profiles.index(name, text) if text else -1
    if number < 0:
        if text:
            nodes.warn(f"the IES file in node '{nodes.plain_name(node)}' cannot be read", f"{MISSING:g}")
        return strength * MISSING
    x, y, z = v.normalized(nodes.vector(node, "Vector") if nodes.link(node, "Vector") else _local_way(nodes))
    up = v.unary("arccosine", math.acos, v.clamp(z * -1.0, -1.0, 1.0))
    around = _arctan2(x, y) + math.pi
    return strength * v.operation("ies", float(number), around, up)


def _text(nodes: LampNodes, node: Any) -> tuple[str, str]:
    """Return the name and the text of an IES file; empty where none is chosen, or where it cannot be read."""
    if node.mode == 'INTERNAL':
        return (node.ies.name, node.ies.as_string()) if node.ies else ("", "")
    if not node.filepath:
        return "", ""
    path = Path(bpy.path.abspath(node.filepath, library=nodes.tree.id_data.library))
    refused = refusal(path)
    if refused:
        nodes.warn(f"its IES file {str(path)!r} {refused}", f"{MISSING:g}")
        return "", ""
    return path.name, path.read_text(encoding="utf-8", errors="replace")


def _arctan2(y: Value, x: Value) -> Value:
    return math.atan2(y, x) if v.is_constant(y, x) else v.operation("arctan2", y, x)


def _local_way(nodes: LampNodes) -> Triple:
    """Return the way to what is lit, in the lamp's own space, turned as normals are."""
    if nodes.type != 'AREA':
        return v.outputs("object_normal", 3)  # type: ignore[return-value]
    way = incoming()
    return tuple(v.dot(nodes.matrix[:3, i].tolist(), way) for i in range(3))  # type: ignore[return-value]


def _light_path(nodes: LampNodes, node: Any, socket: Any) -> Value:
    """Translate the Light Path node. A lamp is asked for the light that it sends, which belongs to none of the kinds of
    rays.
    """
    if socket.name == "Ray Length":
        return v.operation("ray_length")
    return 1.0 if socket.name == "Ray Depth" else 0.0


def _bump(nodes: LampNodes, node: Any, socket: Any) -> Triple:
    """Translate the Bump and Normal Map nodes: there is no surface whose normal they could bend."""
    return normal()


def _geometry(nodes: LampNodes, node: Any, socket: Any) -> Triple | Value | None:
    """Translate the Geometry node."""
    if socket.name in ("Backfacing", "Pointiness", "Random Per Island"):
        return 0.0
    return _BLACK if socket.name == "Tangent" else geometry(nodes, node, socket)


def _texture_coordinates(nodes: LampNodes, node: Any, socket: Any) -> Triple | None:
    """Translate the Texture Coordinate node."""
    if not _OBJECTS and not (socket.name == "Object" and node.object):
        if socket.name in ("Generated", "Object"):
            return position()
        if socket.name == "Reflection":
            return incoming()
        if socket.name == "Camera":
            seen, origin = v.outputs("to_camera", 3, *position()), v.outputs("to_camera", 3, *_BLACK)
            return tuple(a - b for a, b in zip(seen, origin, strict=True))  # type: ignore[return-value]
    return texture_coordinates(nodes, node, socket)


def _object_info(nodes: LampNodes, node: Any, socket: Any) -> Triple | Value | None:
    """Translate the Object Info node."""
    if _OBJECTS or socket.name == "Random":
        return object_info(nodes, node, socket)
    return _BLACK if socket.name in ("Location", "Color") else 0.0


_OWN = {
    'ShaderNodeTexCoord': _texture_coordinates,
    'ShaderNodeObjectInfo': _object_info,
    'ShaderNodeLightFalloff': _falloff,
    'ShaderNodeTexIES': _ies,
    'ShaderNodeLightPath': _light_path,
    'ShaderNodeBump': _bump,
    'ShaderNodeNormalMap': _bump,
    'ShaderNodeNewGeometry': _geometry,
}
