"""Lights, with Cycles' energy.

`intensity` is the radiance that a white diffuse surface returns at distance 1, the light straight above it.
The constants are those of Cycles, checked against its pictures by tests/blender/test_cycles.py.
"""

import math

import numpy as np

from ..passes import shadow_number
from . import left_out
from .nodes import Nodes, uses_nodes
from .report import Report


def light(ob, matrix_world, report: Report) -> dict:
    """The engine's description of light object `ob`, which stands at `matrix_world`."""
    lamp = ob.data
    matrix = np.array(matrix_world, np.float64)
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    axes = matrix[:3, :3] / np.where(lengths > 0, lengths, 1)
    x, y, z = axes.T
    description = {
        "name": ob.name,
        "type": lamp.type,
        "position": matrix[:3, 3].tolist(),
        "direction": (-z).tolist() if z.any() else [0.0, 0.0, -1.0],
        "soft_shadows": lamp.light_meshes.soft_shadows,
        "cast_shadow": lamp.use_shadow,
        "shadow_pass": shadow_number(lamp),
        "softness": lamp.light_meshes.softness,
        "soft_radius": lamp.light_meshes.radius,
        "reference_distance": lamp.light_meshes.reference_distance,
    }
    factor, own = _SHAPES[lamp.type](lamp, lengths, x, y, report)
    power = factor * lamp.energy * _exposure(lamp)
    description["intensity"] = [power * c for c in _color(lamp, report)]
    return description | own


def _exposure(lamp) -> float:
    return 2.0 ** getattr(lamp, "exposure", 0.0)  # 4.5+


def _normalized(lamp) -> bool:
    return getattr(lamp, "normalize", True)  # 4.5+: whether a larger light is as bright in all


def _color(lamp, report: Report) -> np.ndarray:
    color = np.array(lamp.color, np.float64)
    if getattr(lamp, "use_temperature", False):
        color *= np.array(lamp.temperature_color)
    if uses_nodes(lamp):
        nodes = Nodes(lamp.node_tree, "Light", lamp.name, report)
        node = nodes.source(nodes.output('ShaderNodeOutputLight'), "Surface")
        if node is None:
            return color * 0
        if node.bl_idname != 'ShaderNodeEmission':
            nodes.not_translated(node, "the light shines in its own colour")
        else:
            left_out.inputs(nodes, node)
            color *= np.array(nodes.color(node, "Color")) * nodes.value(node, "Strength")
    return color


def _point(lamp, lengths, x, y, report):
    # Radiant flux Φ in all directions: I = Φ/4π; a diffuse surface returns I/π.
    radius = lamp.shadow_soft_size
    factor = 1 / (4 * math.pi**2)
    if not _normalized(lamp) and radius > 0:
        # The energy is then the radiosity of the sphere.
        factor *= 4 * math.pi * radius**2
    return factor, {"radius": radius}


def _sun(lamp, lengths, x, y, report):
    # The energy is irradiance.
    factor = 1 / math.pi
    if not _normalized(lamp) and lamp.angle > 0:
        factor *= math.pi * math.sin(lamp.angle / 2) ** 2  # the energy is then radiance
    return factor, {"angle": lamp.angle}


def _spot(lamp, lengths, x, y, report):
    factor, own = _point(lamp, lengths, x, y, report)
    # A scaled spot lights a scaled cone; one scaled sideways would be elliptic.
    across = math.sqrt(lengths[0] * lengths[1])
    if not math.isclose(lengths[0], lengths[1], rel_tol=1e-3):
        report.warn("it is scaled unevenly: its elliptic cone is drawn round", "Light", lamp.name)
    half = lamp.spot_size / 2
    if lengths[2] > 0 and not math.isclose(across, lengths[2], rel_tol=1e-6) and half < math.pi / 2:
        half = math.atan(math.tan(half) * across / lengths[2])
    return factor, own | {"spot_angle": 2 * half, "spot_blend": lamp.spot_blend}


def _area(lamp, lengths, x, y, report):
    # A Lambertian emitter of flux Φ: I = Φ/π on its axis.
    factor = 1 / math.pi**2
    size_x = lamp.size * lengths[0]
    size_y = (lamp.size_y if lamp.shape in {'RECTANGLE', 'ELLIPSE'} else lamp.size) * lengths[1]
    ellipse = lamp.shape in {'DISK', 'ELLIPSE'}
    if not _normalized(lamp):
        factor *= size_x * size_y * (math.pi / 4 if ellipse else 1)
    return factor, {
        "spread": lamp.spread,
        "area_u": (x * size_x / 2).tolist(),
        "area_v": (y * size_y / 2).tolist(),
        "area_ellipse": ellipse,
    }


_SHAPES = {'POINT': _point, 'SUN': _sun, 'SPOT': _spot, 'AREA': _area}
