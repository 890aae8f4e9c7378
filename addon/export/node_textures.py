"""Values of Blender's texture nodes."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

import bpy

from . import values as v
from .node_inputs import position, usual, uv
from .node_math import floor, modulo, scaled
from .nodes import UNREAD
from .values import Triple, Value


def _place(nodes, node, otherwise: Callable[[], Triple] | None = None) -> Triple:
    """Return the place of a point on the texture: what is linked to Vector, or Blender's default, Generated if no
    other.
    """
    if nodes.link(node, "Vector"):
        return nodes.vector(node, "Vector")
    return otherwise() if otherwise else usual(nodes)


def image(nodes, node, socket) -> Triple | Value | None:
    """Translate the Image Texture node: its colour or its alpha."""
    if node.image is None:
        return (0.0, 0.0, 0.0) if socket.name == "Color" else 0.0  # as Cycles, where none is chosen
    place = _place(nodes, node, lambda: uv(nodes, ""))
    boxed = node.projection == 'BOX'
    if node.image.source == 'TILED' and not (boxed and bpy.app.version < (5, 2)):  # before, the first one counts there
        def texels(x: Value, y: Value) -> tuple[Value, ...]:
            return _tiled(nodes, node, x, y)
    else:
        number = nodes.image(node)
        if number < 0:
            return UNREAD

        def texels(x: Value, y: Value) -> tuple[Value, ...]:
            return v.outputs("image", 4, float(number), x, y)
    found = (_boxed(texels, place, node.projection_blend) if boxed else
             texels(*_projected(node.projection, place)[:2]))
    return found[:3] if socket.name == "Color" else found[3]  # type: ignore[return-value]


def environment(nodes, node, socket) -> Any:
    """Translate the Environment Texture node: an image of all directions."""
    if node.image is None:
        return 0.0, 0.0, 0.0
    number = nodes.image(node)
    if number < 0:
        return UNREAD  # type: ignore[return-value]
    x, y, z = v.normalized(_place(nodes, node, position))
    if node.projection == 'MIRROR_BALL':
        toward = y - 1.0  # the ball is seen along y; what it mirrors lies between that and the direction
        long = v.square_root(toward * -0.5) * 2.0
        across, up = (v.divide(a, long) * 0.5 + 0.5 for a in (x, z))
    else:
        around = v.operation("arctan2", y, x) if not v.is_constant(x, y) else math.atan2(y, x)
        flat = v.square_root(x * x + y * y)
        above = v.operation("arctan2", z, flat) if not v.is_constant(z, flat) else math.atan2(z, flat)
        across, up = around * (-0.5 / math.pi) + 0.5, above * (1 / math.pi) + 0.5
    return v.outputs("image", 4, float(number), across, up)[:3]  # type: ignore[return-value]


def _tiled(nodes, node, x: Value, y: Value) -> tuple[Value, ...]:
    """Return an image of UDIM tiles, each a unit square of its own; magenta where there is none, as Blender shows it.
    """
    column, row = v.truncated(x), v.truncated(y)  # as Cycles has it, just below 0 the first one still counts
    found: tuple[Value, ...] = (1.0, 0.0, 1.0, 1.0)
    for tile in node.image.tiles:
        number = nodes.image(node, tile.number)
        if number < 0:
            continue
        across, up = (tile.number - 1001) % 10, (tile.number - 1001) // 10
        here = v.less(v.unary("absolute", abs, column - across), 0.5) * v.less(v.unary("absolute", abs, row - up), 0.5)
        texels = v.outputs("image", 4, float(number), x - float(across), y - float(up))
        found = tuple(v.where(here, a, b) for a, b in zip(texels, found, strict=True))
    return found


def _boxed(texels: Callable[[Value, Value], tuple[Value, ...]], place: Triple, blend: float) -> tuple[Value, ...]:
    """Return an image that is projected onto the sides of a box, none of them mirrored. texels: place → its channels.
    """
    x, y, z = place
    normal = v.outputs("object_normal", 3)
    sides = [(v.where(v.less(normal[0], 0.0), 1.0 - y, y), z), (v.where(v.greater(normal[1], 0.0), 1.0 - x, x), z),
             (v.where(v.greater(normal[2], 0.0), 1.0 - y, y), x)]
    weights = v.outputs("box", 3, blend)
    images = [texels(*side) for side in sides]
    return tuple(v.dot(weights, channel) for channel in zip(*images, strict=True))


def _projected(kind: str, place: Triple) -> Triple:
    """Return the place on a flat image that is wrapped around a sphere or a tube."""
    if kind not in ('SPHERE', 'TUBE'):
        return place
    x, y, z = (p * 2.0 - 1.0 for p in place)
    around = (1.0 - v.operation("arctan2", x, y) * (1.0 / math.pi)) * 0.5
    around = v.where(v.length((x, y, 0.0)), around, 0.0)
    if kind == 'TUBE':
        return around, (z + 1.0) * 0.5, 0.0
    long = v.length((x, y, z))
    up = 1.0 - v.unary("arccosine", math.acos, v.clamp(v.divide(z, long), -1.0, 1.0)) * (1.0 / math.pi)
    return around, v.where(long, up, 0.0), 0.0


def _single(x: Value) -> Value:
    """x in single precision."""
    return v.unary("single", lambda a: struct.unpack("f", struct.pack("f", a))[0], x)


def checker(nodes, node, socket) -> Triple | Value:
    """Translate the Checker Texture node."""
    place = scaled(_place(nodes, node), nodes.value(node, "Scale"))
    # As Blender, in single precision: what lies on the edge of a cell is of the cell above.
    cells = [v.unary("absolute", abs, floor(_single(_single(_single(p) + 1e-6) * 0.999999))) for p in place]
    odd = [c - floor(c * 0.5) * 2.0 for c in cells]
    same = 1.0 - v.unary("absolute", abs, odd[0] - odd[1])
    first = 1.0 - v.unary("absolute", abs, same - odd[2])
    if socket.name != "Color":
        return first
    return tuple(v.where(first, a, b) for a, b in zip(nodes.color(node, "Color1"), nodes.color(node, "Color2"),
                                                     strict=True))  # type: ignore[return-value]


def gradient(nodes, node, socket) -> Triple | Value:
    """Translate the Gradient Texture node."""
    x, y, z = _place(nodes, node)
    kind = node.gradient_type
    if kind == 'LINEAR':
        found = x
    elif kind == 'QUADRATIC':
        r = v.maximum(x, 0.0)
        found = r * r
    elif kind == 'EASING':
        r = v.clamp(x)
        found = r * r * (3.0 - r * 2.0)
    elif kind == 'DIAGONAL':
        found = (x + y) * 0.5
    elif kind == 'RADIAL':
        found = v.operation("arctan2", y, x) * (0.5 / math.pi) + 0.5
    else:
        r = v.maximum(0.999999 - v.length((x, y, z)), 0.0)
        found = r * r if kind == 'QUADRATIC_SPHERE' else r
    found = v.clamp(found)
    return (found, found, found) if socket.name == "Color" else found


def magic(nodes, node, socket) -> Triple | Value:
    """Translate the Magic Texture node."""
    scale, distortion = nodes.value(node, "Scale"), nodes.value(node, "Distortion")
    place = _place(nodes, node)
    if bpy.app.version < (5, 2):  # there Cycles' pattern repeats whatever its scale is
        place = tuple(modulo(p, 2 * math.pi) for p in place)  # type: ignore[assignment]
    found = v.outputs("magic", 3, *scaled(place, scale), distortion, float(node.turbulence_depth))
    if socket.name == "Color":
        return found  # type: ignore[return-value]
    return (found[0] + found[1] + found[2]) * (1.0 / 3.0)


def _dimensions(nodes, node) -> tuple[float, Triple, Value]:
    """Return how many dimensions a texture has, and where on it a point is: x, y, z, and w."""
    count = float(node.noise_dimensions[0])
    place = _place(nodes, node) if count > 1 else (0.0, 0.0, 0.0)
    return count, place, nodes.value(node, "W") if count in (1.0, 4.0) else 0.0


FRACTALS = ('FBM', 'MULTIFRACTAL', 'HYBRID_MULTIFRACTAL', 'RIDGED_MULTIFRACTAL', 'HETERO_TERRAIN')


def noise(nodes, node, socket) -> Triple | Value:
    """Translate the Noise Texture node."""
    count, place, w = _dimensions(nodes, node)
    scale = nodes.value(node, "Scale")
    x, y, z = scaled(place, scale)
    x = w * scale if count == 1 else x
    how = [nodes.value(node, name) for name in ("Detail", "Roughness", "Lacunarity", "Offset", "Gain", "Distortion")]
    found = v.outputs("noise", 4, count, float(FRACTALS.index(node.noise_type)), float(node.normalize), x, y, z,
                      w * scale, *how)
    return found[1:] if socket.name == "Color" else found[0]  # type: ignore[return-value]


def white_noise(nodes, node, socket) -> Triple | Value:
    """Translate the White Noise Texture node."""
    count, (x, y, z), w = _dimensions(nodes, node)
    found = v.outputs("white_noise", 4, count, w if count == 1 else x, y, z, w)
    return found[1:] if socket.name == "Color" else found[0]  # type: ignore[return-value]


def wave(nodes, node, socket) -> Triple | Value:
    """Translate the Wave Texture node."""
    scale = nodes.value(node, "Scale")
    # Blender moves the place a little, so that a wave's edge does not lie in a plane through the origin.
    x, y, z = place = tuple((p + 0.000001) * 0.999999 for p in scaled(_place(nodes, node), scale))
    if node.wave_type == 'BANDS':
        n = {'X': lambda: x * 20.0, 'Y': lambda: y * 20.0, 'Z': lambda: z * 20.0,
             'DIAGONAL': lambda: (x + y + z) * 10.0}[node.bands_direction]()
    else:
        off = {'X': (0.0, y, z), 'Y': (x, 0.0, z), 'Z': (x, y, 0.0), 'SPHERICAL': place}[node.rings_direction]
        n = v.length(off) * 20.0
    n = n + nodes.value(node, "Phase Offset")
    distortion = nodes.value(node, "Distortion")
    if not (v.is_constant(distortion) and distortion == 0):
        bent = scaled(place, nodes.value(node, "Detail Scale"))
        n = n + v.operation("bend", *bent, nodes.value(node, "Detail"), nodes.value(node, "Detail Roughness")
                            ) * distortion
    if node.wave_profile == 'SIN':
        found = v.unary("sine", math.sin, n - math.pi / 2) * 0.5 + 0.5
    else:
        turns = n * (0.5 / math.pi)
        found = turns - floor(turns) if node.wave_profile == 'SAW' else (
            v.unary("absolute", abs, turns - floor(turns + 0.5)) * 2.0)
    return (found, found, found) if socket.name == "Color" else found


def brick(nodes, node, socket) -> Triple | Value:
    """Translate the Brick Texture node."""
    x, y, _ = scaled(_place(nodes, node), nodes.value(node, "Scale"))
    how = [nodes.value(node, name) for name in ("Mortar Size", "Mortar Smooth", "Bias", "Brick Width", "Row Height")]
    tint, mortar = v.outputs("brick", 2, node.offset, float(node.offset_frequency), node.squash,
                             float(node.squash_frequency), x, y, *how)
    if socket.name != "Color":
        return mortar
    first, second, joint = (nodes.color(node, name) for name in ("Color1", "Color2", "Mortar"))
    return tuple(v.mixed(v.mixed(a, b, tint), c, mortar)
                 for a, b, c in zip(first, second, joint, strict=True))  # type: ignore[return-value]


# In the order of the engine's voronoi.c.
VORONOI_FEATURES = ('F1', 'F2', 'SMOOTH_F1', 'DISTANCE_TO_EDGE', 'N_SPHERE_RADIUS')
VORONOI_DISTANCES = ('EUCLIDEAN', 'MANHATTAN', 'CHEBYCHEV', 'MINKOWSKI')


def voronoi_hash() -> float:
    """Return how this Blender chooses the points of cells: another pattern from 5.0 on."""
    return float(bpy.app.version >= (5, 0))


def voronoi(nodes, node, socket) -> Triple | Value:
    """Translate the Voronoi Texture node."""
    dimensions = float(node.voronoi_dimensions[0])
    place = _place(nodes, node) if dimensions > 1 else (0.0, 0.0, 0.0)
    w = nodes.value(node, "W") if dimensions in (1.0, 4.0) else 0.0
    scale = nodes.value(node, "Scale")
    x, y, z = scaled(place, scale)
    how = [nodes.value(node, name) for name in ("Detail", "Roughness", "Lacunarity", "Smoothness", "Exponent",
                                                "Randomness")]
    found = v.outputs("voronoi", 8, dimensions, float(VORONOI_FEATURES.index(node.feature)),
                      float(VORONOI_DISTANCES.index(node.distance)), float(node.normalize), voronoi_hash(),
                      w * scale if dimensions == 1 else x, y, z, w * scale, *how)
    if socket.name == "Color":
        return found[1:4]
    if socket.name == "Position":
        return tuple(v.divide(p, scale) for p in found[4:7])  # type: ignore[return-value]
    if socket.name == "W":
        return v.divide(found[4] if dimensions == 1 else found[7], scale)
    return found[0]


NODES = {
    'ShaderNodeTexVoronoi': voronoi,
    'ShaderNodeTexNoise': noise,
    'ShaderNodeTexWhiteNoise': white_noise,
    'ShaderNodeTexWave': wave,
    'ShaderNodeTexBrick': brick,
    'ShaderNodeTexMagic': magic,
    'ShaderNodeTexImage': image,
    'ShaderNodeTexEnvironment': environment,
    'ShaderNodeTexChecker': checker,
    'ShaderNodeTexGradient': gradient,
}
