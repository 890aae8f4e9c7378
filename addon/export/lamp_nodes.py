"""The nodes of lamps: the factor by which they multiply a lamp's light, as numbers or as a program of the engine.

A lamp has no surface. This module has what Cycles returns for nodes that ask about one, and nodes that only lamps have.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from . import left_out
from . import values as v
from .channels import Elsewhere, instance_value
from .materials import Materials
from .node_bumps import normal_map
from .node_ies import profile
from .node_inputs import geometry, incoming, normal, object_info, position, texture_coordinates
from .node_math import scaled
from .nodes import Nodes
from .report import Report
from .values import Triple, Value

_BLACK = (0.0, 0.0, 0.0)
_OBJECTS = bpy.app.version >= (4, 4)  # before, Cycles' lamps have no space of their own, and no numbers
_FAR_SUNS = bpy.app.version < (4, 4)  # then Light Falloff takes suns for lamps that are very far away
_FAR = 3.4e38


class OfLamp(Elsewhere):
    """The values for which a lamp's nodes ask: none at corners, and numbers of its object."""

    def __init__(self, instance: Any, ob: Any, depsgraph: Any) -> None:
        super().__init__(depsgraph)
        self._instance, self._ob = instance, ob

    def instance(self, *key: Any) -> Value:
        """Return a number of the lamp's object."""
        if not _OBJECTS and key[0] in ("property", "instancer"):
            return super().instance(*key)
        return instance_value(key, self._instance, self._ob, self._ob, self._depsgraph)


class LampNodes(Nodes):
    """The node tree of a lamp."""

    def __init__(self, lamp: Any, asked: Any, report: Report, materials: Materials,
                 matrix: np.ndarray) -> None:
        """matrix (4,4): the transformation from the lamp's own space to the world."""
        super().__init__(lamp.node_tree, "Light", lamp.name, report,
                         lambda node, tile: materials.image(node, report, tile), asked)
        self.uv_map = ""  # other maps are not there
        self.homeless = not _OBJECTS
        self.own, self.matrix, self.type, self.profiles = _OWN, matrix, lamp.type, materials.profiles


def emission(nodes: LampNodes) -> Triple | None:
    """Return the factor of the light; None if there are nodes that the engine does not know."""
    found = _shader(nodes, nodes.output('ShaderNodeOutputLight'), "Surface")
    if found and _FAR_SUNS and nodes.type == 'SUN':  # what single precision cannot hold gives no light
        held = v.less(v.largest(tuple(v.unary("absolute", abs, c) for c in found)), _FAR / 100.0)
        found = tuple(v.where(held, c, 0.0) for c in found)  # type: ignore[assignment]
    return found


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
        return strength * _FAR if _FAR_SUNS and socket.name != "Quadratic" else strength
    far = v.operation("ray_length")
    square = far * far
    smooth = nodes.value(node, "Smooth")
    if not (v.is_constant(smooth) and smooth <= 0):
        eased = v.divide(square, smooth + square)
        strength = strength * (eased if v.is_constant(smooth) else v.where(v.greater(smooth, 0.0), eased, 1.0))
    return {"Quadratic": strength, "Linear": strength * far, "Constant": strength * square}[socket.name]


def _ies(nodes: LampNodes, node: Any, socket: Any) -> Value:
    """Translate the IES Texture node."""
    return profile(nodes, node, _local_way(nodes))


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
    """Translate the Bump node: there is no surface whose normal it could bend."""
    return normal()


def _normal_map(nodes: LampNodes, node: Any, socket: Any) -> Triple:
    """Translate the Normal Map node: there are no tangents."""
    return normal() if node.space == 'TANGENT' else normal_map(nodes, node, socket)


def _geometry(nodes: LampNodes, node: Any, socket: Any) -> Triple | Value | None:
    """Translate the Geometry node."""
    if socket.name in ("Backfacing", "Pointiness", "Random Per Island"):
        return 0.0
    return _BLACK if socket.name == "Tangent" else geometry(nodes, node, socket)


def _texture_coordinates(nodes: LampNodes, node: Any, socket: Any) -> Triple | None:
    """Translate the Texture Coordinate node."""
    if not _OBJECTS and not (socket.name == "Object" and node.object) and not node.from_instancer:
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
    'ShaderNodeNormalMap': _normal_map,
    'ShaderNodeNewGeometry': _geometry,
}
