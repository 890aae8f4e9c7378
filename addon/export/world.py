"""Export the world: one colour, or a program that gives its radiance by direction."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from . import left_out, values
from . import values as v
from .channels import Elsewhere
from .ies import Profiles
from .nodes import Nodes, uses_nodes
from .report import Report
from .values import Triple, Value

BLACK: Triple = (0.0, 0.0, 0.0)
# Ray visibility of the world in Cycles, and the kinds of rays that it is about, as the engine's `points` has them.
_VISIBILITY = {"camera": 0.0, "glossy": 2.0, "transmission": 3.0, "diffuse": 4.0}


def described(world: Any, report: Report, image: Callable[[Any, int], int],
              profiles: Profiles, depsgraph: Any) -> dict[str, Any]:
    """Return the entries of the snapshot for the world: `world_color`, and `world` if it is not the same in all
    directions. image: as `Nodes` takes it. profiles: of IES files. Without a world it is black.
    """
    if world is None:
        return {"world_color": list(BLACK)}
    radiance = _radiance(world, report, image, profiles, depsgraph)
    for name, kind in _VISIBILITY.items():
        if not getattr(getattr(world, "cycles_visibility", None), name, True):
            hidden = v.operation("ray", kind)
            radiance = tuple(v.where(hidden, 0.0, c) for c in radiance)  # type: ignore[assignment]
    if v.is_constant(*radiance):
        return {"world_color": list(radiance)}
    operations, results = values.compiled({"emission": values.outside(radiance)})
    values.forget()
    if v.is_constant(*results["emission"]) and not any(isinstance(r, list) for r in results["emission"]):
        return {"world_color": results["emission"]}
    return {"world_color": list(BLACK), "world": {"operations": operations, "values": results}}


def _radiance(world: Any, report: Report, image: Callable[[Any, int], int], profiles: Profiles,
              depsgraph: Any) -> Triple:
    if not uses_nodes(world):
        return tuple(world.color)  # type: ignore[return-value]
    nodes = Nodes(world.node_tree, "World", world.name, report, image, Elsewhere(depsgraph))
    nodes.profiles = profiles
    output = nodes.output('ShaderNodeOutputWorld')
    volume = nodes.source(output, "Volume")
    if volume is not None:
        nodes.not_translated(volume, "it is rendered without volume")
    return _shader(nodes, output, "Surface")


def _shader(nodes: Nodes, node: Any, socket: str | int) -> Triple:
    """Return the radiance that input `socket` of `node` gets."""
    shader = nodes.source(node, socket)
    if shader is None:
        return BLACK
    if shader.bl_idname in ('ShaderNodeBackground', 'ShaderNodeEmission'):
        left_out.inputs(nodes, shader)
        strength = nodes.value(shader, "Strength")
        return tuple(c * strength for c in nodes.color(shader, "Color"))  # type: ignore[return-value]
    if shader.bl_idname == 'ShaderNodeAddShader':
        return tuple(a + b for a, b in zip(  # type: ignore[return-value]
            _shader(nodes, shader, 0), _shader(nodes, shader, 1), strict=True))
    if shader.bl_idname == 'ShaderNodeMixShader':
        return _mixed(nodes, shader)
    nodes.not_translated(shader, "its background is black")
    return BLACK


def _mixed(nodes: Nodes, node: Any) -> Triple:
    factor: Value = v.clamp(nodes.value(node, 0))
    # A side that is not seen must not warn.
    if v.is_constant(factor) and factor in (0.0, 1.0):
        return _shader(nodes, node, 1 + int(factor))
    return tuple(v.mixed(a, b, factor) for a, b in zip(  # type: ignore[return-value]
        _shader(nodes, node, 1), _shader(nodes, node, 2), strict=True))
