"""The value of the IES Texture node: the light of a luminaire by direction; and of Light Falloff at surfaces."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import bpy

from . import values as v
from .image_files import refusal
from .node_inputs import incoming
from .values import Triple, Value

MISSING = 100.0  # what an IES Texture gives in Cycles where it has no file


def profile(nodes: Any, node: Any, otherwise: Triple) -> Value:
    """Return the light of the node's IES file. otherwise: the direction where none is linked."""
    strength = nodes.value(node, "Strength")
    name, text = _text(nodes, node)
    number = nodes.profiles.index(name, text) if text else -1
    if number < 0:
        if text:
            nodes.warn(f"the IES file in node '{nodes.plain_name(node)}' cannot be read", f"{MISSING:g}")
        return strength * MISSING
    x, y, z = v.normalized(nodes.vector(node, "Vector") if nodes.link(node, "Vector") else otherwise)
    up = v.unary("arccosine", math.acos, v.clamp(z * -1.0, -1.0, 1.0))
    around = _arctan2(x, y) + math.pi
    return strength * v.operation("ies", float(number), around, up)


def _text(nodes: Any, node: Any) -> tuple[str, str]:
    """Return the name and the text of an IES file; empty where none is chosen, or where it cannot be read."""
    if node.mode == 'INTERNAL':
        return (node.ies.name, node.ies.as_string()) if node.ies else ("", "")
    if not node.filepath:
        return "", ""
    path = Path(bpy.path.abspath(node.filepath, library=nodes.tree.id_data.library))
    refused = refusal(path)
    if refused:
        nodes.warn(f"its IES file {str(path)!r} {refused}", f"{MISSING:g}")
        return "", ""
    return path.name, path.read_text(encoding="utf-8", errors="replace")


def _arctan2(y: Value, x: Value) -> Value:
    return math.atan2(y, x) if v.is_constant(y, x) else v.operation("arctan2", y, x)


def ies(nodes: Any, node: Any, socket: Any) -> Value:
    """Translate the IES Texture node of a surface or a world: by the way to the eye, in the object's own space."""
    return profile(nodes, node, v.outputs("to_object_normal", 3, *incoming()))  # type: ignore[arg-type]


def falloff(nodes: Any, node: Any, socket: Any) -> Value | None:
    """Translate the Light Falloff node of a surface: only what does not depend on how far a ray came."""
    smooth = nodes.value(node, "Smooth")
    if socket.name != "Quadratic" or not v.is_constant(smooth) or smooth > 0:
        return None
    return nodes.value(node, "Strength")


NODES = {'ShaderNodeTexIES': ies, 'ShaderNodeLightFalloff': falloff}
