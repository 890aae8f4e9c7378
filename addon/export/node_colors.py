"""Values of Blender's nodes for colours: Mix, Color Ramp, curves, Hue/Saturation, Gamma, Invert, Blackbody, …"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import bpy

from . import values as v
from .color import luminance_weights
from .node_math import fraction
from .values import Triple, Value

TABLE = 257  # samples of a ramp or a curve, as many as Cycles takes


def rgb_node(nodes, node, socket) -> Triple:
    """Translate the RGB node."""
    return tuple(socket.default_value)[:3]


def value_node(nodes, node, socket) -> Value:
    """Translate the Value node."""
    return float(socket.default_value)


def _soft_light(a: Value, b: Value) -> Value:
    screen = 1.0 - (1.0 - b) * (1.0 - a)
    return (1.0 - a) * b * a + a * screen



def _dodge(a: Value, b: Value, factor: Value) -> Value:
    left = 1.0 - factor * b
    bright = v.minimum(v.divide(a, left), 1.0)
    lit = v.where(v.greater(left, 0.0), bright, 1.0)
    return v.where(v.unary("absolute", abs, a), lit, a)


def _burn(a: Value, b: Value, factor: Value) -> Value:
    left = 1.0 - factor + factor * b
    found = v.clamp(1.0 - v.divide(1.0 - a, left))
    return v.where(v.greater(left, 0.0), found, 0.0)


def _linear_light(a: Value, b: Value, factor: Value) -> Value:
    return a + factor * (b * 2.0 - 1.0)


# Blend modes of each channel: (a, b, factor) → what the node gives.
CHANNELS: dict[str, Callable[[Value, Value, Value], Value]] = {
    'MIX': v.mixed,
    'ADD': lambda a, b, f: a + b * f,
    'SUBTRACT': lambda a, b, f: a - b * f,
    'MULTIPLY': lambda a, b, f: v.mixed(a, a * b, f),
    'DIVIDE': lambda a, b, f: v.where(v.unary("absolute", abs, b), a * (1.0 - f) + v.divide(a * f, b), a),
    'SCREEN': lambda a, b, f: 1.0 - (1.0 - f + f * (1.0 - b)) * (1.0 - a),
    'DIFFERENCE': lambda a, b, f: v.mixed(a, v.unary("absolute", abs, a - b), f),
    'EXCLUSION': lambda a, b, f: v.maximum(v.mixed(a, a + b - a * b * 2.0, f), 0.0),
    'DARKEN': lambda a, b, f: v.mixed(a, v.minimum(a, b), f),
    'LIGHTEN': lambda a, b, f: v.mixed(a, v.maximum(a, b), f),
    'OVERLAY': lambda a, b, f: v.where(v.less(a, 0.5), a * (1.0 - f + f * b * 2.0),
                                       1.0 - (1.0 - f + f * (1.0 - b) * 2.0) * (1.0 - a)),
    'DODGE': _dodge,
    'BURN': _burn,
    'SOFT_LIGHT': lambda a, b, f: v.mixed(a, _soft_light(a, b), f),
    'LINEAR_LIGHT': _linear_light,
}


def hsv(color: Triple) -> Triple:
    """Return hue, saturation and value of a colour."""
    high, low = v.largest(color), v.minimum(v.minimum(color[0], color[1]), color[2])
    reach = high - low
    saturation = v.where(v.unary("absolute", abs, high), v.divide(reach, high), 0.0)
    return v.where(v.unary("absolute", abs, saturation), _hue(color, high, reach), 0.0), saturation, high


def _hue(color: Triple, high: Value, reach: Value) -> Value:
    """Return the hue of a colour with this largest channel, whose channels are within `reach` of each other."""
    r, g, _ = color
    red, green, blue = (v.divide(high - c, reach) for c in color)
    of_green = v.where(1.0 - v.unary("absolute", abs, v.greater(high, g)), 2.0 + red - blue, 4.0 + green - red)
    hue = v.where(1.0 - v.greater(high, r), blue - green, of_green) * (1.0 / 6.0)
    return v.where(v.less(hue, 0.0), hue + 1.0, hue)


def from_hsv(color: Triple) -> Triple:
    """Return the colour of a hue, a saturation and a value."""
    hue, saturation, value = color
    # As Blender: what is no hue, below 0 or above 1, is taken for one of the last sixth, from magenta to red.
    none = v.maximum(v.less(hue, 0.0), v.greater(hue, 1.0))
    sixth = v.where(none, fraction(hue * 6.0) + 5.0, fraction(hue) * 6.0)

    def channel(offset: float) -> Value:
        k = fraction((sixth + offset) * (1.0 / 6.0)) * 6.0
        return value - value * saturation * v.maximum(v.minimum(v.minimum(k, 4.0 - k), 1.0), 0.0)
    return channel(5.0), channel(3.0), channel(1.0)


def _hsl(color: Triple) -> Triple:
    high, low = v.largest(color), v.minimum(v.minimum(color[0], color[1]), color[2])
    light, reach = v.minimum((high + low) * 0.5, 1.0), high - low
    share = v.divide(reach, v.where(v.greater(light, 0.5), 2.0 - high - low, high + low))
    return v.where(reach, _hue(color, high, reach), 0.0), v.where(reach, share, 0.0), light


def _from_hsl(color: Triple) -> Triple:
    hue, saturation, light = color
    chroma = (1.0 - v.unary("absolute", abs, light * 2.0 - 1.0)) * saturation
    pure = [v.clamp(c) for c in (v.unary("absolute", abs, hue * 6.0 - 3.0) - 1.0,
                                 2.0 - v.unary("absolute", abs, hue * 6.0 - 2.0),
                                 2.0 - v.unary("absolute", abs, hue * 6.0 - 4.0))]
    return tuple((c - 0.5) * chroma + light for c in pure)  # type: ignore[return-value]


def _blend_hsv(mode: str, a: Triple, b: Triple, factor: Value) -> Triple:
    """Return the blend modes that take hue, saturation or value of the second colour."""
    (ha, sa, va), (hb, sb, vb) = hsv(a), hsv(b)
    if mode == 'HUE':
        changed, counts = from_hsv((hb, sa, va)), v.greater(sb, 0.0)
    elif mode == 'COLOR':
        changed, counts = from_hsv((hb, sb, va)), v.greater(sb, 0.0)
    elif mode == 'SATURATION':
        found = from_hsv((ha, v.mixed(sa, sb, factor), va))
        gray = v.greater(sa, 0.0)
        return tuple(v.where(gray, x, y) for x, y in zip(found, a, strict=True))  # type: ignore[return-value]
    else:
        return from_hsv((ha, sa, v.mixed(va, vb, factor)))
    return tuple(v.where(counts, v.mixed(x, y, factor), x)
                 for x, y in zip(a, changed, strict=True))  # type: ignore[return-value]


def blended(mode: str, a: Triple, b: Triple, factor: Value) -> Triple | None:
    """Return two colours mixed as the Mix node does; None for modes that are not known."""
    if mode in ('HUE', 'SATURATION', 'VALUE', 'COLOR'):
        return _blend_hsv(mode, a, b, factor)
    channel = CHANNELS.get(mode)
    if channel is None:
        return None
    return tuple(channel(x, y, factor) for x, y in zip(a, b, strict=True))  # type: ignore[return-value]


def mix_node(nodes, node, socket) -> Value | Triple | None:
    """Translate the Mix node: numbers, vectors or colours."""
    inputs = [s for s in node.inputs if not s.is_unavailable]
    kind = node.data_type
    uniform = kind != 'VECTOR' or node.factor_mode == 'UNIFORM'
    factor = nodes.value(node, inputs[0]) if uniform else nodes.vector(node, inputs[0])
    if node.clamp_factor:
        factor = v.clamp(factor) if uniform else tuple(v.clamp(f) for f in factor)
    if kind == 'FLOAT':
        return v.mixed(nodes.value(node, inputs[1]), nodes.value(node, inputs[2]), factor)
    if kind == 'VECTOR':
        a, b = nodes.vector(node, inputs[1]), nodes.vector(node, inputs[2])
        factors = (factor,) * 3 if uniform else factor
        return tuple(v.mixed(x, y, f) for x, y, f in zip(a, b, factors, strict=True))  # type: ignore[return-value]
    if kind != 'RGBA':
        return None
    found = blended(node.blend_type, nodes.color(node, inputs[1]), nodes.color(node, inputs[2]), factor)
    return found and (tuple(map(v.clamp, found)) if node.clamp_result else found)  # type: ignore[return-value]


def mix_rgb_node(nodes, node, socket) -> Triple | None:
    """Translate the Mix node of Blender before 3.4, which old files still have."""
    factor = v.clamp(nodes.value(node, 0))
    found = blended(node.blend_type, nodes.color(node, 1), nodes.color(node, 2), factor)
    return found and (tuple(map(v.clamp, found)) if node.use_clamp else found)  # type: ignore[return-value]


def tabled(x: Value, table: list[float], interpolates: bool, low: float = 0.0, high: float = 1.0,
           extrapolates: bool = False) -> Value:
    """Return a function given by its values at equal steps from `low` to `high`; without interpolation the value
    before.
    """
    place = (x - low) * ((len(table) - 1) / (high - low))
    if v.is_constant(place):
        place = place if extrapolates else min(max(place, 0.0), len(table) - 1.0)
        i = min(max(int(place), 0), len(table) - 2)
        return table[i] + (table[i + 1] - table[i]) * (place - i) if interpolates else table[int(place)]
    return v.operation("table", place, tuple(table), float(interpolates), float(extrapolates))


def color_ramp_node(nodes, node, socket) -> Triple | Value:
    """Translate the Color Ramp node, looked up in a table, or step by step where it is constant."""
    factor, ramp = nodes.value(node, 0), node.color_ramp
    of_alpha = socket.name == "Alpha"
    exact = {'CONSTANT': _stepped, 'LINEAR': _straight}.get(ramp.interpolation if ramp.color_mode == 'RGB' else "")
    if v.is_constant(factor) and bpy.app.version >= (5, 0):  # since then Blender computes what is constant itself
        found = tuple(ramp.evaluate(min(max(factor, 0.0), 1.0)))
    elif exact:
        found = exact(factor, ramp)
    else:  # by hues, too, Cycles takes the colour before where the interpolation, which counts no more, was constant
        samples = [tuple(ramp.evaluate(i / (TABLE - 1))) for i in range(TABLE)]
        found = tuple(tabled(factor, list(channel), ramp.interpolation != 'CONSTANT')
                      for channel in zip(*samples, strict=True))
    return found[3] if of_alpha else found[:3]


def _stepped(factor: Value, ramp) -> tuple[Value, ...]:
    """Return a constant ramp: the colour of the last element that is not beyond the factor."""
    elements = sorted(ramp.elements, key=lambda e: e.position)
    found = [tuple(e.color) for e in elements]
    result: tuple[Value, ...] = found[0]
    for element, color in zip(elements[1:], found[1:], strict=True):
        beyond = v.less(factor, element.position)
        result = tuple(v.where(beyond, x, y) for x, y in zip(result, color, strict=True))
    return result


def _straight(factor: Value, ramp) -> tuple[Value, ...]:
    """Return a linear ramp, exactly."""
    elements = sorted(ramp.elements, key=lambda e: e.position)
    result: tuple[Value, ...] = tuple(elements[0].color)
    for a, b in itertools.pairwise(elements):
        width = b.position - a.position
        part = v.clamp((factor - a.position) * (1.0 / width)) if width > 0 else 1.0 - v.less(factor, b.position)
        result = tuple(x + (y - z) * part for x, y, z in zip(result, b.color, a.color, strict=True))
    return result


def curves_node(nodes, node, socket) -> Triple | Value:
    """Translate the RGB Curves, Vector Curves and Float Curve nodes."""
    mapping = node.mapping
    mapping.update()
    factor = nodes.value(node, 0)
    names = {s.name for s in node.inputs}
    rgb = "Color" in names
    extrapolates = mapping.extend == 'EXTRAPOLATED'
    # As Cycles: a table from the first point of all curves to the last.
    curves = [mapping.curves[i] for i in range(1 if "Value" in names else 4 if rgb else 3)]
    low, high = min(c.points[0].location[0] for c in curves), max(c.points[-1].location[0] for c in curves)

    def along(number: int, x: Value) -> Value:
        places = [low + (high - low) * i / (TABLE - 1) for i in range(TABLE)]
        if rgb:
            places = [mapping.evaluate(mapping.curves[3], place) for place in places]
        table = [mapping.evaluate(mapping.curves[number], place) for place in places]
        return tabled(x, table, True, low, high, extrapolates)
    if "Value" in names:
        value = nodes.value(node, "Value")
        return v.mixed(value, along(0, value), factor)
    given = nodes.color(node, 1)
    return tuple(v.mixed(x, along(i, x), factor) for i, x in enumerate(given))  # type: ignore[return-value]


def hue_saturation_node(nodes, node, socket) -> Triple:
    """Translate the Hue/Saturation/Value node."""
    hue, saturation, value, factor = (nodes.value(node, name) for name in ("Hue", "Saturation", "Value", _factor(node)))
    color = nodes.color(node, "Color")
    h, s, x = hsv(color)
    changed = from_hsv((fraction(h + hue + 0.5), v.clamp(s * saturation), x * value))
    return tuple(v.maximum(v.mixed(a, b, factor), 0.0)
                 for a, b in zip(color, changed, strict=True))  # type: ignore[return-value]


def _factor(node) -> str:
    """Return the name of the factor's input in this Blender."""
    return "Fac" if "Fac" in node.inputs else "Factor"


def bright_contrast_node(nodes, node, socket) -> Triple:
    """Translate the Brightness/Contrast node."""
    bright, contrast = nodes.value(node, "Bright" if "Bright" in node.inputs else "Brightness"), nodes.value(
        node, "Contrast")
    return tuple(v.maximum(c * (1.0 + contrast) + (bright - contrast * 0.5), 0.0)
                 for c in nodes.color(node, "Color"))  # type: ignore[return-value]


def gamma_node(nodes, node, socket) -> Triple:
    """Translate the Gamma node."""
    gamma = nodes.value(node, "Gamma")
    return tuple(v.where(v.unary("absolute", abs, gamma), v.where(v.greater(c, 0.0), v.power(c, gamma), c), 1.0)
                 for c in nodes.color(node, "Color"))  # type: ignore[return-value]


def invert_node(nodes, node, socket) -> Triple:
    """Translate the Invert Color node."""
    factor = nodes.value(node, 0)
    return tuple(v.mixed(c, 1.0 - c, factor) for c in nodes.color(node, "Color"))  # type: ignore[return-value]


def to_bw_node(nodes, node, socket) -> Value:
    """Translate the RGB to BW node: the luminance."""
    return v.dot(nodes.color(node, 0), luminance_weights())


_INTO = {'RGB': lambda c: c, 'HSV': hsv, 'HSL': _hsl}
_OUT_OF = {'RGB': lambda c: c, 'HSV': from_hsv, 'HSL': _from_hsl}


def combine_color_node(nodes, node, socket) -> Triple:
    """Translate the Combine Color node, and those for RGB and HSV of older files."""
    mode = getattr(node.node, "mode", None) or node.bl_idname.removeprefix("ShaderNodeCombine")
    return _OUT_OF[mode]((nodes.value(node, 0), nodes.value(node, 1), nodes.value(node, 2)))


def separate_color_node(nodes, node, socket) -> Value:
    """Translate the Separate Color node, and those for RGB and HSV of older files."""
    mode = getattr(node.node, "mode", None) or node.bl_idname.removeprefix("ShaderNodeSeparate")
    place = next(i for i, s in enumerate(node.outputs) if s.identifier == socket.identifier)
    return _INTO[mode](nodes.color(node, 0))[place]


NODES = {
    'ShaderNodeRGB': rgb_node,
    'ShaderNodeValue': value_node,
    'ShaderNodeMix': mix_node,
    'ShaderNodeMixRGB': mix_rgb_node,
    'ShaderNodeValToRGB': color_ramp_node,
    'ShaderNodeRGBCurve': curves_node,
    'ShaderNodeVectorCurve': curves_node,
    'ShaderNodeFloatCurve': curves_node,
    'ShaderNodeHueSaturation': hue_saturation_node,
    'ShaderNodeBrightContrast': bright_contrast_node,
    'ShaderNodeGamma': gamma_node,
    'ShaderNodeInvert': invert_node,
    'ShaderNodeRGBToBW': to_bw_node,
    'ShaderNodeCombineColor': combine_color_node,
    'ShaderNodeSeparateColor': separate_color_node,
    'ShaderNodeCombineRGB': combine_color_node,
    'ShaderNodeSeparateRGB': separate_color_node,
    'ShaderNodeCombineHSV': combine_color_node,
    'ShaderNodeSeparateHSV': separate_color_node,
}
