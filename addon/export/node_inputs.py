"""Values of Blender's input nodes: where on which surface a point is, seen from where by which ray."""

from __future__ import annotations

from . import values as v
from .values import Triple, Value


def uv(nodes, name: str) -> Triple:
    """Return the place on a UV map; empty: the mesh's own."""
    if nodes.uv_map is None:
        nodes.uv_map = name
    if name == nodes.uv_map:
        u, w = v.outputs("uv", 2)
        return u, w, 0.0
    kind = "attribute" if name else "uv"
    return nodes.asked.corner(kind, name, 0), nodes.asked.corner(kind, name, 1), 0.0


def generated() -> Triple:
    """Return the place in the mesh's texture space, 0 to 1."""
    return v.outputs("generated", 3)  # type: ignore[return-value]


def usual(nodes) -> Triple:
    """Return where textures are that have no Vector: Generated, or the place in the world for what has no space of its
    own.
    """
    return position() if nodes.homeless else generated()


def position() -> Triple:
    """Return the place in the world."""
    return v.outputs("position", 3)  # type: ignore[return-value]


def normal() -> Triple:
    """Return the shading normal, turned to the viewer."""
    return v.outputs("normal", 3)  # type: ignore[return-value]


def incoming() -> Triple:
    """Return the unit vector to where the ray came from."""
    return v.outputs("incoming", 3)  # type: ignore[return-value]


def _of_instancer(nodes, name: str) -> Triple:
    """Return the place on what the object is an instance of: of its UV map, or Generated."""
    if name == "UV":
        return nodes.asked.instance("instancer", "uv", 0), nodes.asked.instance("instancer", "uv", 1), 0.0
    return tuple(nodes.asked.instance("instancer", "generated", i) for i in range(3))  # type: ignore[return-value]


def texture_coordinates(nodes, node, socket) -> Triple | None:
    """Translate the Texture Coordinate node."""
    name = socket.name
    if node.from_instancer and name in ("UV", "Generated"):
        return _of_instancer(nodes, name)
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
    if name == "Camera":  # what the camera sees of the world are directions
        return v.outputs("in_camera", 3, *position(), 0.0) if nodes.kind == "World" else _in_camera()
    if name == "Window":
        across, up = v.outputs("window", 2)
        return across, up, 0.0
    return None


def uv_map(nodes, node, socket) -> Triple:
    """Translate the UV Map node."""
    if node.from_instancer:
        return _of_instancer(nodes, "UV")
    return uv(nodes, node.uv_map)


def geometry(nodes, node, socket) -> Triple | Value | None:
    """Translate the Geometry node."""
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
    if name == "Parametric":
        first, second = v.outputs("parametric", 2)
        return first, second, 0.0
    if name == "Tangent":
        return radial_tangent(nodes, 'Z')
    if name in ("Pointiness", "Random Per Island"):
        return nodes.asked.corner(name, "", 4)
    return None


def object_info(nodes, node, socket) -> Triple | Value | None:
    """Translate the Object Info node: where the object is, and its numbers."""
    if socket.name == "Location":
        return v.outputs("object_location", 3)  # type: ignore[return-value]
    if socket.name == "Color":
        return tuple(nodes.asked.instance("color", i) for i in range(3))  # type: ignore[return-value]
    if socket.name == "Alpha":
        return nodes.asked.instance("color", 3)
    if socket.name == "Object Index":
        return nodes.asked.instance("index")
    if socket.name == "Material Index":
        return float(nodes.pass_index)
    if socket.name == "Random":
        return nodes.asked.instance("random")
    return None


def attribute(nodes, node, socket) -> Triple | Value:
    """Translate the Attribute node: of the mesh, or a property of the object, of what made the instance, or of the view
    layer.
    """
    name, kind = node.attribute_name, node.attribute_type

    def channel(component: int) -> Value:
        if kind == 'GEOMETRY':
            return nodes.asked.corner("attribute", name, component)
        return nodes.asked.instance("property", kind, name, component)
    if socket.name in ("Fac", "Factor"):
        return channel(4)
    return channel(3) if socket.name == "Alpha" else (channel(0), channel(1), channel(2))


def vertex_color(nodes, node, socket) -> Triple | Value:
    """Translate the Color Attribute node."""
    if socket.name == "Alpha":
        return nodes.asked.corner("color", node.layer_name, 3)
    return tuple(nodes.asked.corner("color", node.layer_name, i) for i in range(3))  # type: ignore[return-value]


def _in_camera() -> Triple:
    """Return the place as the camera has it; z is the distance along its view."""
    return v.outputs("to_camera", 3, *position())  # type: ignore[return-value]


def _still(nodes, value: Value) -> Value:
    """Return a value that bumps do not move; only materials have some."""
    return v.unshifted(value) if nodes.kind == "Material" else value


def camera_data(nodes, node, socket) -> Triple | Value:
    """Translate the Camera Data node, which bumps do not move."""
    place: Triple = v.outputs("to_camera", 3, *(_still(nodes, p) for p in position()))  # type: ignore[assignment]
    if socket.name == "View Vector":
        return v.normalized(place)
    return place[2] if socket.name == "View Z Depth" else v.length(place)


def uv_tangent(nodes, name: str) -> tuple[Triple, Value]:
    """Return the tangent of a UV map, in the object's space and as triangles interpolate it, and its sign; bumps do not
    move it.
    """
    x, y, z, sign = (_still(nodes, nodes.asked.corner("tangent", name, i)) for i in range(4))
    return (x, y, z), sign


def to_world_normal(vector: Triple) -> Triple:
    """Return a normal in the object's space as one of the world."""
    return v.outputs("to_world_normal", 3, *vector)  # type: ignore[return-value]


def tangent(nodes, node, socket) -> Triple:
    """Translate the Tangent node."""
    if node.direction_type != 'UV_MAP':
        return radial_tangent(nodes, node.axis)
    return _along_surface(uv_tangent(nodes, node.uv_map)[0])


def radial_tangent(nodes, axis: str) -> Triple:
    """Return the direction around an axis through the middle of the mesh's texture space; a lamp has none."""
    x, y, z = (_still(nodes, p) - 0.5 for p in (position() if nodes.kind == "Light" else generated()))
    return _along_surface({'X': (0.0, -z, y), 'Y': (-z, 0.0, x), 'Z': (-y, x, 0.0)}[axis])


def _along_surface(along: Triple) -> Triple:
    """Return a direction of the object's own space as the nearest one on the surface in the world."""
    return v.cross(normal(), v.normalized(v.cross(to_world_normal(along), normal())))


# Kinds of rays, in the order of the engine's `points`.
_CAMERA, _SHADOW, _REFLECTED, _TRANSMITTED, _LIGHTING = (float(i) for i in range(5))


def light_path(nodes, node, socket) -> Value | None:
    """Translate the Light Path node. Only a world has diffuse rays: what lights surfaces. How often one was bent is not
    said.
    """
    name, lighting = socket.name, (_LIGHTING,) if nodes.kind == "World" else ()
    rays = {"Is Camera Ray": (_CAMERA,), "Is Shadow Ray": (_SHADOW,), "Is Reflection Ray": (_REFLECTED,),
            "Is Transmission Ray": (_TRANSMITTED,), "Is Glossy Ray": (_REFLECTED, _TRANSMITTED),
            "Is Singular Ray": (_REFLECTED, _TRANSMITTED), "Is Diffuse Ray": lighting,
            "Diffuse Depth": lighting, "Ray Depth": (_REFLECTED, _TRANSMITTED, *lighting),
            "Glossy Depth": (_REFLECTED,), "Transmission Depth": (_TRANSMITTED,), "Transparent Depth": ()}.get(name)
    if rays is None:
        return None
    found: Value = float(nodes.kind == "World" and name == "Ray Depth")  # it is behind all surfaces
    for kind in rays:
        found = found + v.operation("ray", kind)
    return found


def fresnel_of(cosine: Value, ior: Value) -> Value:
    """Return Fresnel's reflectance of a dielectric, as the Fresnel node has it."""
    c = v.unary("absolute", abs, cosine)
    g2 = ior * ior - 1.0 + c * c
    g = v.square_root(g2)
    a = v.divide(g - c, g + c)
    b = v.divide((g + c) * c - 1.0, (g - c) * c + 1.0)
    found = a * a * 0.5 * (1.0 + b * b)
    return v.where(v.greater(g2, 0.0), found, 1.0)


def _normal_or(nodes, node) -> Triple:
    """Return the normal that an input names, or the surface's, with its displacement."""
    return normal_at(nodes, node, "Normal") or nodes.displaced or normal()


def normal_at(nodes, node, socket: str) -> Triple | None:
    """Return the normal that feeds an input; None: nothing does. Cycles overlooks one that is the same everywhere."""
    found = nodes.vector(node, socket) if nodes.link(node, socket) else (0.0, 0.0, 0.0)
    return None if v.is_constant(*found) else found


def fresnel(nodes, node, socket) -> Value:
    """Translate the Fresnel node."""
    ior = v.maximum(nodes.value(node, "IOR"), 1e-5)
    inside = v.operation("backfacing")
    return fresnel_of(v.dot(incoming(), _normal_or(nodes, node)), v.where(inside, v.divide(1.0, ior), ior))


def layer_weight(nodes, node, socket) -> Value:
    """Translate the Layer Weight node."""
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


def vector_transform(nodes, node, socket) -> Triple:
    """Translate the Vector Transform node: between the world, the object's space and the camera's."""
    x, y, z = nodes.vector(node, "Vector")
    a, b, point = node.convert_from, node.convert_to, float(node.vector_type == 'POINT')
    if a == b:
        return x, y, z
    if node.vector_type == 'NORMAL':
        return _turned_normal((x, y, z), a, b)
    found: Triple = (x, y, z)
    for operation in ([] if a == 'WORLD' else [_FROM[a]]) + ([] if b == 'WORLD' else [_TO[b]]):
        found = v.outputs(operation, 3, *found, point)  # type: ignore[assignment]
    return found


# Operations of the engine that move a vector (0) or a point (1) between the world and another space.
_FROM = {'OBJECT': "to_world", 'CAMERA': "from_camera"}
_TO = {'OBJECT': "to_object", 'CAMERA': "in_camera"}


def _turned_normal(n: Triple, a: str, b: str) -> Triple:
    """Return a normal in another space, with length 1; it turns as a plane does."""
    if a == 'OBJECT':
        n = to_world_normal(n)
    elif a == 'CAMERA':
        n = v.outputs("from_camera", 3, *n, 0.0)  # type: ignore[assignment]
    if b == 'OBJECT':
        n = v.outputs("to_object_normal", 3, *n)  # type: ignore[assignment]
    elif b == 'CAMERA':
        n = v.outputs("in_camera", 3, *n, 0.0)  # type: ignore[assignment]
    return v.normalized(n)


def normal_node(nodes, node, socket) -> Triple | Value:
    """Translate the Normal node."""
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
    'ShaderNodeVectorTransform': vector_transform,
    'ShaderNodeAttribute': attribute,
    'ShaderNodeVertexColor': vertex_color,
    'ShaderNodeCameraData': camera_data,
    'ShaderNodeTangent': tangent,
}
