"""Export lights, with the same energy as in Cycles.

`intensity` is the radiance that a white diffuse surface reflects at distance 1, with the light straight above it. The
constants are those of Cycles; tests/peers/test_cycles.py compares them with its pictures.
"""

import math

import numpy as np

from ..passes import shadow_number
from ..softness import softness_of
from . import values
from .lamp_nodes import LampNodes, OfLamp, emission
from .materials import Materials
from .nodes import uses_nodes
from .report import Report


def light(instance, ob, depsgraph, report: Report, materials: Materials) -> dict:
    """Return the engine's description of the light object `ob`, one of the depsgraph's instances. Images and IES files
    that its nodes ask for are added to materials.
    """
    lamp, parent = ob.data, instance.parent
    seen = [ob] if parent is None else [ob, parent]
    matrix = np.array(instance.matrix_world, np.float64)
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    axes = (matrix[:3, :3] / np.where(lengths > 0, lengths, 1)).T
    z = axes[2]
    description = {
        "name": ob.name,
        "type": lamp.type,
        "position": matrix[:3, 3].tolist(),
        "direction": (-z).tolist() if z.any() else [0.0, 0.0, -1.0],
        "soft_shadows": lamp.light_meshes.soft_shadows,
        "cast_shadow": lamp.use_shadow,
        "shadow_pass": shadow_number(lamp),
        "softness": softness_of(lamp),
        "soft_radius": lamp.light_meshes.radius,
        "reference_distance": lamp.light_meshes.reference_distance,
        "diffuse": all(o.visible_diffuse for o in seen),
        "glossy": all(o.visible_glossy for o in seen),
        "seen_by_camera": all(o.visible_camera for o in seen),
        "seen_in_mirrors": all(o.visible_glossy for o in seen),
        "seen_in_glass": all(o.visible_transmission for o in seen),
    }
    factor, own = _SHAPES[lamp.type](lamp, lengths, axes, report)
    power = factor * lamp.energy * _exposure(lamp)
    if _off(lamp, lengths, axes):
        power = 0.0
    elif not all(o.visible_transmission for o in seen):
        report.warn("Ray Visibility: Transmission is off, but its light passes through glass", "Light", ob.name)
    color = _color(lamp)
    if uses_nodes(lamp):
        nodes = LampNodes(lamp, OfLamp(instance, ob, depsgraph), report, materials, matrix)
        given = emission(nodes)
        if given is not None and values.is_constant(*given):
            color *= np.array(given)
        elif given is not None:
            operations, results = values.compiled({"emission": given})
            description |= {"program": {"operations": operations, "values": results}, "matrix": matrix[:3].tolist()}
        values.forget()
    description["intensity"] = [power * c for c in color]
    return description | own


def _off(lamp, lengths, axes) -> bool:
    """Return whether the lamp gives no light in Cycles: because its scale or size is 0, or because it is a portal for
    the world's light.
    """
    if lamp.type == 'SUN':
        return not lengths[2] > 0
    if lamp.type == 'SPOT':
        return not _solid(lengths, axes)
    if lamp.type == 'AREA':
        sizes = [lamp.size, lamp.size_y if lamp.shape in {'RECTANGLE', 'ELLIPSE'} else lamp.size]
        return not (lengths.all() and all(sizes)) or (hasattr(lamp, "cycles") and lamp.cycles.is_portal)
    return False


def _exposure(lamp) -> float:
    return 2.0 ** getattr(lamp, "exposure", 0.0)  # 4.5+


def _normalized(lamp) -> bool:
    # 4.5+: whether the total power stays the same when the size of the light changes
    return getattr(lamp, "normalize", True)


def _color(lamp) -> np.ndarray:
    color = np.array(lamp.color, np.float64)
    if getattr(lamp, "use_temperature", False):
        color *= np.array(lamp.temperature_color)
    return color


def _point(lamp, lengths, axes, report):
    # A radiant flux Φ in all directions has I = Φ/4π; a diffuse surface reflects I/π.
    radius = lamp.shadow_soft_size
    factor = 1 / (4 * math.pi**2)
    if not _normalized(lamp) and radius > 0:
        # Then the energy is the radiosity of the sphere.
        factor *= 4 * math.pi * radius**2
    # With Soft Falloff (4.1+, and always before) Cycles has a disc that turns to each receiver, instead of a sphere.
    return factor, {"radius": radius, "facing_disc": getattr(lamp, "use_soft_falloff", True)}


def _sun(lamp, lengths, axes, report):
    # The energy is an irradiance.
    factor = 1 / math.pi
    if not _normalized(lamp) and lamp.angle > 0:
        factor *= math.pi * math.sin(lamp.angle / 2) ** 2  # then the energy is a radiance
    return factor, {"angle": lamp.angle}


def _spot(lamp, lengths, axes, report):
    factor, own = _point(lamp, lengths, axes, report)
    own |= {"spot_angle": lamp.spot_size, "spot_blend": lamp.spot_blend}
    if not _even(lengths, axes) and _solid(lengths, axes):
        # In the lamp's own space the cone is circular.
        own["axes"] = (np.linalg.inv((axes * lengths[:, None]).T) * lengths[2] * [[1], [1], [-1]]).tolist()
    return factor, own


def _even(lengths, axes) -> bool:
    """Return whether a lamp is neither sheared nor longer along one axis than along another."""
    return np.ptp(lengths) <= 1e-6 * lengths.max() and _upright(axes)


def _upright(axes) -> bool:
    """Return whether the axes of a lamp, shape (3,3), are perpendicular."""
    return np.abs(np.triu(axes @ axes.T, 1)).max() <= 1e-5


def _solid(lengths, axes) -> bool:
    """Return whether a lamp's axes span a space: none has length 0, and they are not in one plane."""
    return bool(lengths.all()) and abs(np.linalg.det(axes)) > 1e-6


def _area(lamp, lengths, axes, report):
    # A Lambertian emitter of flux Φ has I = Φ/π on its axis.
    factor = 1 / math.pi**2
    size_x = lamp.size * lengths[0]
    size_y = (lamp.size_y if lamp.shape in {'RECTANGLE', 'ELLIPSE'} else lamp.size) * lengths[1]
    ellipse = lamp.shape in {'DISK', 'ELLIPSE'}
    if not _normalized(lamp):
        factor *= size_x * size_y * (math.pi / 4 if ellipse else 1)
    own = {
        "spread": lamp.spread,
        "area_u": (axes[0] * size_x / 2).tolist(),
        "area_v": (axes[1] * size_y / 2).tolist(),
        "area_ellipse": ellipse,
    }
    if not _upright(axes):
        if not ellipse:
            own["axes"] = [*axes[:2].tolist(), np.cross(axes[0], axes[1]).tolist()]
        if lamp.spread < math.pi - 1e-4:
            report.warn("it is sheared: its spread is rendered as if it were not", "Light", lamp.name)
        if softness_of(lamp) == 'SIZE':
            # Cycles samples it as if its axes were perpendicular, and so lights by a shape that it does not have.
            report.warn("it is sheared: close to it its light differs from Cycles'", "Light", lamp.name)
    return factor, own


_SHAPES = {'POINT': _point, 'SUN': _sun, 'SPOT': _spot, 'AREA': _area}
