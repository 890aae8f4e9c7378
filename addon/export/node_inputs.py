"""Values of Blender's input nodes: where on which surface a point is, seen from where by which ray."""

from __future__ import annotations

from . import values as v
from .values import Triple, Value


def uv(nodes, name: str) -> Triple:
    """The place on a UV map; empty: the mesh's own."""
    nodes.asks_for_uv(name)
    u, w = v.outputs("uv", 2)
    return u, w, 0.0


def generated() -> Triple:
    """The place in the mesh's texture space, 0 to 1."""
    return v.outputs("generated", 3)  # type: ignore[return-value]


def position() -> Triple:
    """The place in the world."""
    return v.outputs("position", 3)  # type: ignore[return-value]


def normal() -> Triple:
    """The shading normal, turned to the viewer."""
    return v.outputs("normal", 3)  # type: ignore[return-value]


def incoming() -> Triple:
    """The unit vector to where the ray came from."""
    return v.outputs("incoming", 3)  # type: ignore[return-value]


def texture_coordinates(nodes, node, socket) -> Triple | None:
    """The Texture Coordinate node."""
    name = socket.name
    if name == "UV":
        return uv(nodes, "")
    if name == "Generated":
        return generated()
    if name == "Normal":
        return v.outputs("object_normal", 3)  # type: ignore[return-value]
    if name == "Object" and node.object is None:
        return v.outputs("object", 3)  # type: ignore[return-value]
    if name == "Object":
        rows = node.object.matrix_world.inverted_safe()
        here = (*position(), 1.0)
        return tuple(v.dot(tuple(rows[i]), here) for i in range(3))  # type: ignore[return-value]
    if name == "Reflection":
        n, away = normal(), incoming()
        twice = v.dot(n, away) * 2.0
        return tuple(a * twice - b for a, b in zip(n, away, strict=True))  # type: ignore[return-value]
    return None  # Camera and Window move with the camera, which the engine moves by itself


def uv_map(nodes, node, socket) -> Triple:
    """The UV Map node."""
    return uv(nodes, node.uv_map)


def geometry(nodes, node, socket) -> Triple | Value | None:
    """The Geometry node."""
    name = socket.name
    if name == "Position":
        return position()
    if name == "Normal":
        return normal()
    if name == "True Normal":
        return v.outputs("true_normal", 3)  # type: ignore[return-value]
    if name == "Incoming":
        return incoming()
    if name == "Backfacing":
        return v.operation("backfacing")
    return None


def object_info(nodes, node, socket) -> Triple | Value | None:
    """The Object Info node: where the object is, and its numbers."""
    if socket.name == "Location":
        return v.outputs("object_location", 3)  # type: ignore[return-value]
    return None


def light_path(nodes, node, socket) -> Value | None:
    """The Light Path node: surfaces are translated as camera rays see them."""
    return {"Is Camera Ray": 1.0, "Is Shadow Ray": 0.0, "Is Diffuse Ray": 0.0, "Is Glossy Ray": 0.0,
            "Is Singular Ray": 0.0, "Is Reflection Ray": 0.0, "Is Transmission Ray": 0.0, "Ray Depth": 0.0,
            "Diffuse Depth": 0.0, "Glossy Depth": 0.0, "Transparent Depth": 0.0,
            "Transmission Depth": 0.0}.get(socket.name)


def fresnel_of(cosine: Value, ior: Value) -> Value:
    """Fresnel's reflectance of a dielectric, as the Fresnel node has it."""
    c = v.unary("absolute", abs, cosine)
    g2 = ior * ior - 1.0 + c * c
    g = v.square_root(g2)
    a = v.divide(g - c, g + c)
    b = v.divide((g + c) * c - 1.0, (g - c) * c + 1.0)
    found = a * a * 0.5 * (1.0 + b * b)
    return v.where(v.greater(g2, 0.0), found, 1.0)


def _normal_or(nodes, node) -> Triple:
    """The normal that an input names, or the surface's."""
    return nodes.vector(node, "Normal") if nodes.link(node, "Normal") else normal()


def fresnel(nodes, node, socket) -> Value:
    """The Fresnel node."""
    ior = v.maximum(nodes.value(node, "IOR"), 1e-5)
    inside = v.operation("backfacing")
    return fresnel_of(v.dot(incoming(), _normal_or(nodes, node)), v.where(inside, v.divide(1.0, ior), ior))


def layer_weight(nodes, node, socket) -> Value:
    """The Layer Weight node."""
    blend = nodes.value(node, "Blend")
    cosine = v.dot(incoming(), _normal_or(nodes, node))
    if socket.name == "Fresnel":
        eta = v.divide(1.0, v.maximum(1.0 - blend, 1e-5))
        inside = v.operation("backfacing")
        return fresnel_of(cosine, v.where(inside, v.divide(1.0, eta), eta))
    facing = v.unary("absolute", abs, cosine)
    held = v.minimum(v.maximum(blend, 0.0), 1.0 - 1e-5)
    exponent = v.where(v.less(held, 0.5), held * 2.0, v.divide(0.5, 1.0 - held))
    bent = v.where(v.unary("absolute", abs, blend - 0.5), v.power(facing, exponent), facing)
    return 1.0 - bent


def normal_node(nodes, node, socket) -> Triple | Value:
    """The Normal node."""
    own: Triple = tuple(node.outputs[0].default_value)[:3]
    if socket.name == "Normal":
        return own
    return v.dot(v.normalized(nodes.vector(node, "Normal")), v.normalized(own))


NODES = {
    'ShaderNodeTexCoord': texture_coordinates,
    'ShaderNodeUVMap': uv_map,
    'ShaderNodeNewGeometry': geometry,
    'ShaderNodeObjectInfo': object_info,
    'ShaderNodeLightPath': light_path,
    'ShaderNodeFresnel': fresnel,
    'ShaderNodeLayerWeight': layer_weight,
    'ShaderNodeNormal': normal_node,
}
