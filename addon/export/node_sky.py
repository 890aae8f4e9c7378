"""Values of Blender's Sky Texture node."""

from __future__ import annotations

import math
from typing import Any

from . import values as v
from .node_inputs import usual
from .node_spectra import from_light
from .report import shown
from .values import Triple

# In the order of the engine's `atmosphere`.
_MODELS = {'NISHITA': 0.0, 'SINGLE_SCATTERING': 0.0, 'MULTIPLE_SCATTERING': 1.0, 'PREETHAM': 2.0}


def sky(nodes: Any, node: Any, socket: Any) -> Triple:
    """Translate the Sky Texture node."""
    place = nodes.vector(node, "Vector") if nodes.link(node, "Vector") else usual(nodes)
    kind, model = node.sky_type, _MODELS.get(node.sky_type)
    if model is None:
        name = node.bl_rna.properties["sky_type"].enum_items[kind].name
        nodes.warn(f"sky type {name} of node '{nodes.plain_name(node)}' is not translated; it is rendered as Preetham",
                   f"turbidity {shown(node.turbidity)}")
        model = 2.0
    if model == 2.0:
        x, y, z = node.sun_direction
        elevation, rotation = math.atan2(z, math.hypot(x, y)), math.atan2(x, y)
        weather = (model, elevation, rotation, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, min(max(node.turbidity, 0.0), 30.0))
    else:
        dust = node.aerosol_density if hasattr(node, "aerosol_density") else node.dust_density  # before 5.0
        elevation = math.asin(math.sin(node.sun_elevation))
        size = max(node.sun_size, 0.0005) if node.sun_disc else 0.0
        weather = (model, elevation, node.sun_rotation, min(max(node.altitude, 0.0), 1e5), node.air_density, dust,
                   node.ozone_density, size, node.sun_intensity, 0.0)
    return from_light(v.outputs("sky", 3, *weather, *place))  # type: ignore[arg-type]


NODES = {'ShaderNodeTexSky': sky}
