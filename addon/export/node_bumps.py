"""Values of Blender's nodes that bend the shading normal: Bump, Normal Map, and displacement as bumps."""

from __future__ import annotations

import bpy

from . import values as v
from .node_inputs import normal, normal_at, to_world_normal, uv_tangent
from .values import Triple, Value

# How many pixels apart Cycles takes heights for displacement's bumps.
DISPLACEMENT_WIDTH = 0.1 if bpy.app.version >= (4, 4) else 1.0


def bumped(height: Value, n: Triple, strength: Value = 1.0, distance: Value = 1.0, width: float = 1.0) -> Triple:
    """Return the normal `n` of a surface that is raised by `height`·`distance`.

    width: how many pixels apart heights are taken.
    """
    if v.is_constant(height):
        return n
    heights = [v.shifted(height, step, width) for step in range(3)]
    return v.outputs("bump", 3, *heights, *n, strength, distance, width)  # type: ignore[return-value]


def _own_normal(nodes) -> Triple:
    """Return the normal that nodes take without one of their own: with the material's displacement, if it has some."""
    return nodes.displaced or normal()


def given(nodes, node, name: str = "Normal") -> Triple | None:
    """Return the normal that an input gets; None: the surface's own."""
    found = normal_at(nodes, node, name) or nodes.displaced
    return None if found == normal() else found


def bump(nodes, node, socket) -> Triple:
    """Translate the Bump node."""
    n = given(nodes, node) or normal()
    width = nodes.value(node, "Filter Width") if "Filter Width" in node.inputs else 1.0
    if not v.is_constant(width):
        width = 1.0
    distance = nodes.value(node, "Distance")
    return bumped(nodes.value(node, "Height"), n, nodes.value(node, "Strength"),
                  distance * -1.0 if node.invert else distance, max(width, 1e-3))


def normal_map(nodes, node, socket) -> Triple:
    """Translate the Normal Map node."""
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
        has = sign * sign  # 0 where the mesh has no such UV map
        return tuple(v.where(has, c * back, own) for c, own in zip(found, normal(), strict=True))  # type: ignore[return-value]
    if node.space.startswith('BLENDER'):
        y, z = y * -1.0, z * -1.0
    found = to_world_normal((x, y, z)) if node.space.endswith('OBJECT') else v.normalized((x, y, z))
    found = tuple(c * back for c in found)  # type: ignore[assignment]
    own = _own_normal(nodes)
    return v.normalized(tuple(a + (c - a) * strength for a, c in zip(own, found, strict=True)))  # type: ignore[arg-type]


def height(nodes, output) -> Value:
    """Return how far the displacement of a material's output raises the surface, along its normal, in the world."""
    link = nodes.link(output, "Displacement")
    if link.from_node.bl_idname == 'ShaderNodeDisplacement' and not nodes.link(link.from_node, "Normal"):
        raised = _raised(nodes, link.from_node)
        return raised if link.from_node.space == 'WORLD' else raised * v.dot(_by_object(normal()), normal())
    return v.dot(nodes.vector(output, "Displacement"), normal())


def _raised(nodes, node) -> Value:
    return (nodes.value(node, "Height") - nodes.value(node, "Midlevel")) * nodes.value(node, "Scale")


def _by_object(n: Triple) -> Triple:
    """Return the length in the world of 1 along a normal in the object's own space."""
    return v.outputs("to_world", 3, *v.outputs("to_object_normal", 3, *n), 0.0)  # type: ignore[return-value]


def displacement(nodes, node, socket) -> Triple:
    """Translate the Displacement node: by how much the surface moves, in the world."""
    raised, n = _raised(nodes, node), given(nodes, node) or normal()
    n = n if node.space == 'WORLD' else _by_object(n)
    return tuple(c * raised for c in n)  # type: ignore[return-value]


def vector_displacement(nodes, node, socket) -> Triple:
    """Translate the Vector Displacement node."""
    middle, scale = nodes.value(node, "Midlevel"), nodes.value(node, "Scale")
    moved: Triple = tuple((c - middle) * scale for c in nodes.vector(node, "Vector"))  # type: ignore[assignment]
    if node.space == 'WORLD':
        return moved
    if node.space == 'TANGENT':
        n: Triple = v.outputs("object_normal", 3)  # type: ignore[assignment]
        t, sign = uv_tangent(nodes, "")
        b = v.normalized(v.cross(n, t))
        x, y, z = moved
        moved = tuple(x * t[i] + y * n[i] + z * sign * b[i] for i in range(3))  # type: ignore[assignment]
    return v.outputs("to_world", 3, *moved, 0.0)  # type: ignore[return-value]


NODES = {
    'ShaderNodeBump': bump,
    'ShaderNodeNormalMap': normal_map,
    'ShaderNodeDisplacement': displacement,
    'ShaderNodeVectorDisplacement': vector_displacement,
}
