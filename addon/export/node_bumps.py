"""Values of Blender's nodes that bend the shading normal: Bump, Normal Map, and displacement as bumps."""

from __future__ import annotations

import bpy

from . import values as v
from .node_inputs import normal, to_world_normal, uv_tangent
from .values import Triple, Value

# How many pixels apart Cycles takes heights for displacement's bumps.
DISPLACEMENT_WIDTH = 0.1 if bpy.app.version >= (4, 4) else 1.0


def bumped(height: Value, n: Triple, strength: Value = 1.0, distance: Value = 1.0, width: float = 1.0) -> Triple:
    """The normal `n` of a surface that is raised by `height`·`distance`.

    width: how many pixels apart heights are taken.
    """
    if v.is_constant(height):
        return n
    heights = [v.shifted(height, step, width) for step in range(3)]
    return v.outputs("bump", 3, *heights, *n, strength, distance, width)  # type: ignore[return-value]


def _own_normal(nodes) -> Triple:
    """The normal that nodes take without one of their own: with the material's displacement, if it has some."""
    return nodes.displaced or normal()


def given(nodes, node, name: str = "Normal") -> Triple | None:
    """The normal that an input gets; None: the surface's own."""
    found = nodes.vector(node, name) if nodes.link(node, name) else nodes.displaced
    return None if found == normal() else found


def bump(nodes, node, socket) -> Triple:
    """The Bump node."""
    n = given(nodes, node) or normal()
    width = nodes.value(node, "Filter Width") if "Filter Width" in node.inputs else 1.0
    if not v.is_constant(width):
        width = 1.0
    distance = nodes.value(node, "Distance")
    return bumped(nodes.value(node, "Height"), n, nodes.value(node, "Strength"),
                  distance * -1.0 if node.invert else distance, max(width, 1e-3))


def normal_map(nodes, node, socket) -> Triple:
    """The Normal Map node."""
    strength = v.maximum(nodes.value(node, "Strength"), 0.0)
    x, y, z = ((c - 0.5) * 2.0 for c in nodes.color(node, "Color"))
    if getattr(node.node, "convention", "") == 'DIRECTX':
        y = y * -1.0
    back = 1.0 - v.operation("backfacing") * 2.0
    if node.space == 'TANGENT':
        x, y, z = x * strength, y * strength, v.mixed(1.0, z, v.clamp(strength))
        t, sign = uv_tangent(nodes, node.uv_map)
        n: Triple = v.outputs("corner_normal", 3)  # type: ignore[assignment]
        b = v.cross(n, t)
        found = to_world_normal(tuple(x * t[i] + y * sign * b[i] + z * n[i] for i in range(3)))  # type: ignore[arg-type]
        return tuple(c * back for c in found)  # type: ignore[return-value]
    if node.space.startswith('BLENDER'):
        y, z = y * -1.0, z * -1.0
    found = to_world_normal((x, y, z)) if node.space.endswith('OBJECT') else v.normalized((x, y, z))
    found = tuple(c * back for c in found)  # type: ignore[assignment]
    own = _own_normal(nodes)
    return v.normalized(tuple(a + (c - a) * strength for a, c in zip(own, found, strict=True)))  # type: ignore[arg-type]


def displacement(nodes, node) -> Value | None:
    """How far a Displacement node raises the surface, in the world; None: it is another node."""
    if node.bl_idname != 'ShaderNodeDisplacement':
        return None
    height = (nodes.value(node, "Height") - nodes.value(node, "Midlevel")) * nodes.value(node, "Scale")
    return height * v.operation("object_scale") if node.space == 'OBJECT' else height


NODES = {
    'ShaderNodeBump': bump,
    'ShaderNodeNormalMap': normal_map,
}
