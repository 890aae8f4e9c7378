"""Values of Blender's nodes for numbers and vectors: Math, Vector Math, Clamp, Map Range, Mapping, Vector Rotate, …"""

from __future__ import annotations

import math
from collections.abc import Callable

from . import values as v
from .values import Triple, Value


def _log(x: Value, base: Value) -> Value:
    """Return the logarithm, 0 where there is none."""
    return v.divide(v.unary("log", lambda a: math.log(a) if a > 0 else 0.0, x),
                    v.unary("log", lambda a: math.log(a) if a > 0 else 0.0, base))


def floor(x: Value) -> Value:
    """Return the next whole number below."""
    return v.unary("floor", math.floor, x)


def fraction(x: Value) -> Value:
    """Return x minus the next whole number below."""
    return x - floor(x)


def modulo(x: Value, y: Value) -> Value:
    """Return the rest of x/y with the sign of x; 0 where y is 0."""
    if v.is_constant(x, y):
        return math.fmod(x, y) if y != 0 else 0.0
    return v.operation("modulo", x, y)


def _floored_modulo(x: Value, y: Value) -> Value:
    return v.where(v.unary("absolute", abs, y), x - floor(v.divide(x, y)) * y, 0.0)


def _wrap(x: Value, high: Value, low: Value) -> Value:
    reach = high - low
    return v.where(v.unary("absolute", abs, reach), x - reach * floor(v.divide(x - low, reach)), low)


def _ping_pong(x: Value, scale: Value) -> Value:
    return v.where(v.unary("absolute", abs, scale),
                   v.unary("absolute", abs, fraction(v.divide(x - scale, scale * 2.0)) * scale * 2.0 - scale), 0.0)


def _smooth_minimum(a: Value, b: Value, width: Value) -> Value:
    """Return Blender's smooth minimum: of two numbers nearer than `width` a smaller one."""
    h = v.divide(v.maximum(width - v.unary("absolute", abs, a - b), 0.0), width)
    smooth = v.minimum(a, b) - h * h * h * width * (1.0 / 6.0)
    return v.where(v.unary("absolute", abs, width), smooth, v.minimum(a, b))


def _compare(a: Value, b: Value, within: Value) -> Value:
    return 1.0 - v.greater(v.unary("absolute", abs, a - b), v.maximum(within, 1e-5))


def _arc(name: str, fold: Callable[[float], float]) -> Callable[[Value], Value]:
    return lambda x: v.unary(name, fold, v.clamp(x, -1.0, 1.0))


def _two(name: str, fold: Callable[[float, float], float]) -> Callable[[Value, Value], Value]:
    return lambda a, b: float(fold(a, b)) if v.is_constant(a, b) else v.operation(name, a, b)


_arc_tangent2 = _two("arctan2", math.atan2)
# Math's operations: (number of inputs, what they give).
MATH: dict[str, tuple[int, Callable[..., Value]]] = {
    'ADD': (2, lambda a, b: a + b),
    'SUBTRACT': (2, lambda a, b: a - b),
    'MULTIPLY': (2, lambda a, b: a * b),
    'DIVIDE': (2, v.divide),
    'MULTIPLY_ADD': (3, lambda a, b, c: a * b + c),
    'POWER': (2, v.power),
    'LOGARITHM': (2, _log),
    'SQRT': (1, v.square_root),
    'INVERSE_SQRT': (1, lambda a: v.divide(1.0, v.square_root(a))),
    'ABSOLUTE': (1, lambda a: v.unary("absolute", abs, a)),
    'EXPONENT': (1, lambda a: v.unary("exponent", math.exp, a)),
    'MINIMUM': (2, v.minimum),
    'MAXIMUM': (2, v.maximum),
    'LESS_THAN': (2, v.less),
    'GREATER_THAN': (2, v.greater),
    'SIGN': (1, lambda a: v.greater(a, 0.0) - v.less(a, 0.0)),
    'COMPARE': (3, _compare),
    'SMOOTH_MIN': (3, _smooth_minimum),
    'SMOOTH_MAX': (3, lambda a, b, c: -_smooth_minimum(-a, -b, c)),
    'ROUND': (1, lambda a: floor(a + 0.5)),
    'FLOOR': (1, floor),
    'CEIL': (1, lambda a: -floor(-a)),
    'TRUNC': (1, v.truncated),
    'FRACT': (1, fraction),
    'MODULO': (2, modulo),
    'FLOORED_MODULO': (2, _floored_modulo),
    'WRAP': (3, _wrap),
    'SNAP': (2, lambda a, b: floor(v.divide(a, b)) * b),
    'PINGPONG': (2, _ping_pong),
    'SINE': (1, lambda a: v.unary("sine", math.sin, a)),
    'COSINE': (1, lambda a: v.unary("cosine", math.cos, a)),
    'TANGENT': (1, lambda a: v.unary("tangent", math.tan, a)),
    'ARCSINE': (1, _arc("arcsine", math.asin)),
    'ARCCOSINE': (1, _arc("arccosine", math.acos)),
    'ARCTANGENT': (1, lambda a: v.unary("arctangent", math.atan, a)),
    'ARCTAN2': (2, _arc_tangent2),
    'SINH': (1, lambda a: v.unary("sinh", math.sinh, a)),
    'COSH': (1, lambda a: v.unary("cosh", math.cosh, a)),
    'TANH': (1, lambda a: v.unary("tanh", math.tanh, a)),
    'RADIANS': (1, lambda a: a * (math.pi / 180)),
    'DEGREES': (1, lambda a: a * (180 / math.pi)),
}


def math_node(nodes, node, socket) -> Value | None:
    """Translate the Math node."""
    found = MATH.get(node.operation)
    if found is None:
        return None
    count, compute = found
    value = compute(*(nodes.value(node, i) for i in range(count)))
    return v.clamp(value) if node.use_clamp else value


def _each(compute: Callable[..., Value]) -> Callable[..., Triple]:
    """Return the same for each of the three numbers."""
    def of_three(*triples: Triple) -> Triple:
        return tuple(compute(*numbers) for numbers in zip(*triples, strict=True))  # type: ignore[return-value]
    return of_three


def scaled(a: Triple, factor: Value) -> Triple:
    """Return a vector times a number."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def _plus(a: Triple, b: Triple) -> Triple:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _minus(a: Triple, b: Triple) -> Triple:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _projected(a: Triple, b: Triple) -> Triple:
    return scaled(b, v.divide(v.dot(a, b), v.dot(b, b)))


def _reflected(a: Triple, b: Triple) -> Triple:
    n = v.normalized(b)
    return _minus(a, scaled(n, v.dot(n, a) * 2.0))


def _facing(a: Triple, b: Triple, c: Triple) -> Triple:
    turn = v.where(v.less(v.dot(b, c), 0.0), 1.0, -1.0)
    return scaled(a, turn)


VECTOR_MATH: dict[str, tuple[int, Callable[..., Triple]]] = {
    name: (MATH[name][0], _each(MATH[name][1])) for name in (
        'ADD', 'SUBTRACT', 'MULTIPLY', 'DIVIDE', 'MULTIPLY_ADD', 'ABSOLUTE', 'MINIMUM', 'MAXIMUM', 'FLOOR', 'CEIL',
        'MODULO', 'WRAP', 'SNAP', 'ROUND', 'SINE', 'COSINE', 'TANGENT', 'POWER', 'SIGN')
} | {
    'FRACTION': (1, _each(fraction)),
    'CROSS_PRODUCT': (2, v.cross),
    'PROJECT': (2, _projected),
    'REFLECT': (2, _reflected),
    'FACEFORWARD': (3, _facing),
    'NORMALIZE': (1, v.normalized),
}
VECTOR_NUMBERS: dict[str, tuple[int, Callable[..., Value]]] = {
    'DOT_PRODUCT': (2, v.dot),
    'DISTANCE': (2, lambda a, b: v.length(_minus(a, b))),
    'LENGTH': (1, v.length),
}


def vector_math_node(nodes, node, socket) -> Triple | Value | None:
    """Translate the Vector Math node."""
    name = node.operation
    inputs = [s for s in node.inputs if not s.is_unavailable]
    if name == 'SCALE':
        return scaled(nodes.vector(node, inputs[0]), nodes.value(node, inputs[1]))
    if name == 'REFRACT':
        return _refracted(nodes.vector(node, inputs[0]), nodes.vector(node, inputs[1]), nodes.value(node, inputs[2]))
    found = VECTOR_MATH.get(name) or VECTOR_NUMBERS.get(name)
    if found is None:
        return None
    return found[1](*(nodes.vector(node, s) for s in inputs[:found[0]]))


def _refracted(a: Triple, b: Triple, eta: Value) -> Triple:
    n = v.normalized(b)
    along = v.dot(n, a)
    k = 1.0 - eta * eta * (1.0 - along * along)
    passes = 1.0 - v.less(k, 0.0)
    bent = _minus(scaled(a, eta), scaled(n, eta * along + v.square_root(k)))
    return scaled(bent, passes)


def clamp_node(nodes, node, socket) -> Value:
    """Translate the Clamp node."""
    value, low, high = (nodes.value(node, i) for i in range(3))
    if node.clamp_type == 'RANGE':
        low, high = v.minimum(low, high), v.maximum(low, high)
    return v.minimum(v.maximum(value, low), high)


def _mapped(kind: str, clamps: bool, value: Value, a: Value, b: Value, to_a: Value, to_b: Value,
            steps: Value, *, vector: bool) -> Value:
    """Translate Map Range for one number, or for one component of a vector."""
    t = v.divide(value - a, b - a)
    if kind in ('SMOOTHSTEP', 'SMOOTHERSTEP'):
        t = v.clamp(t)
        t = t * t * (3.0 - t * 2.0) if kind == 'SMOOTHSTEP' else t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    elif kind == 'STEPPED':
        t = v.where(v.greater(steps, 0.0), v.divide(floor(t * (steps + 1.0)), steps), 0.0)
    found = to_a + (to_b - to_a) * t
    if not vector:  # the same number at both ends of the old range: the node gives 0
        found = v.where(v.unary("absolute", abs, b - a), found, 0.0)
    if not clamps or (vector and kind.startswith('SMOOTH')):
        return found
    return v.minimum(v.maximum(found, v.minimum(to_a, to_b)), v.maximum(to_a, to_b))


def map_range_node(nodes, node, socket) -> Value | Triple:
    """Translate the Map Range node, of numbers or of vectors."""
    inputs = [s for s in node.inputs if not s.is_unavailable]
    read = nodes.vector if node.data_type == 'FLOAT_VECTOR' else nodes.value
    found = [read(node, s) for s in inputs]
    vector = node.data_type == 'FLOAT_VECTOR'
    if len(found) < 6:
        found.append((4.0, 4.0, 4.0) if vector else 4.0)  # the steps, which only one kind has
    kind, clamps = node.interpolation_type, node.clamp
    if not vector:
        return _mapped(kind, clamps, *found[:6], vector=False)
    each = [_mapped(kind, clamps, *numbers, vector=True) for numbers in zip(*found[:6], strict=True)]
    return each[0], each[1], each[2]


def combine_xyz_node(nodes, node, socket) -> Triple:
    """Translate the Combine XYZ node."""
    return nodes.value(node, 0), nodes.value(node, 1), nodes.value(node, 2)


def separate_xyz_node(nodes, node, socket) -> Value:
    """Translate the Separate XYZ node."""
    return nodes.vector(node, 0)["XYZ".index(socket.name)]


def _turned(a: Triple, angles: Triple, inverse: bool = False) -> Triple:
    """Return a vector turned about x, then y, then z; or back."""
    (sx, cx), (sy, cy), (sz, cz) = ((MATH['SINE'][1](w), MATH['COSINE'][1](w)) for w in angles)
    rows: tuple[Triple, Triple, Triple] = (
        (cy * cz, sx * sy * cz - cx * sz, cx * sy * cz + sx * sz),
        (cy * sz, sx * sy * sz + cx * cz, cx * sy * sz - sx * cz),
        (-1.0 * sy, sx * cy, cx * cy))
    if inverse:
        rows = tuple(zip(*rows, strict=True))  # type: ignore[assignment]
    return (v.dot(rows[0], a), v.dot(rows[1], a), v.dot(rows[2], a))


def mapping_node(nodes, node, socket) -> Triple:
    """Translate the Mapping node."""
    vector, rotation, scale = (nodes.vector(node, name) for name in ("Vector", "Rotation", "Scale"))
    if v.is_constant(*scale) and not any(scale):
        return 0.0, 0.0, 0.0  # Cycles overlooks the location then
    kind = node.vector_type
    location: Triple = nodes.vector(node, "Location") if kind in ('POINT', 'TEXTURE') else (0.0, 0.0, 0.0)
    if kind == 'TEXTURE':
        turned = _turned(_minus(vector, location), rotation, inverse=True)
        return _each(v.divide)(turned, scale)
    if kind == 'NORMAL':
        return v.normalized(_turned(_each(v.divide)(vector, scale), rotation))
    return _plus(_turned(_each(lambda a, b: a * b)(vector, scale), rotation), location)


def vector_rotate_node(nodes, node, socket) -> Triple:
    """Translate the Vector Rotate node."""
    vector, centre = nodes.vector(node, "Vector"), nodes.vector(node, "Center")
    away = _minus(vector, centre)
    if node.rotation_type == 'EULER_XYZ':
        return _plus(_turned(away, nodes.vector(node, "Rotation"), node.invert), centre)
    axes: dict[str, Triple] = {'X_AXIS': (1.0, 0.0, 0.0), 'Y_AXIS': (0.0, 1.0, 0.0), 'Z_AXIS': (0.0, 0.0, 1.0)}
    axis = axes.get(node.rotation_type) or v.normalized(nodes.vector(node, "Axis"))
    angle = nodes.value(node, "Angle") * (-1.0 if node.invert else 1.0)
    sine, cosine = MATH['SINE'][1](angle), MATH['COSINE'][1](angle)
    # Rodrigues' formula.
    turned = _plus(_plus(scaled(away, cosine), scaled(v.cross(axis, away), sine)),
                   scaled(axis, v.dot(axis, away) * (1.0 - cosine)))
    there = v.where(v.length(axis), 1.0, 0.0)
    moved = _plus(turned, centre)
    return (v.where(there, moved[0], vector[0]), v.where(there, moved[1], vector[1]),
            v.where(there, moved[2], vector[2]))


NODES = {
    'ShaderNodeMath': math_node,
    'ShaderNodeVectorMath': vector_math_node,
    'ShaderNodeClamp': clamp_node,
    'ShaderNodeMapRange': map_range_node,
    'ShaderNodeCombineXYZ': combine_xyz_node,
    'ShaderNodeSeparateXYZ': separate_xyz_node,
    'ShaderNodeMapping': mapping_node,
    'ShaderNodeVectorRotate': vector_rotate_node,
}
