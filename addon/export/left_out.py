"""Features of nodes, objects and settings that Cycles shows and the engine does not. Each one in use is named in a
warning.

Each input of a translated node is either read, or listed here, or new in some version of Blender. A new input is named
as soon as its value is not 0.
"""

from __future__ import annotations

from typing import NamedTuple

from .nodes import Nodes
from .report import Report, shown


class LeftOut(NamedTuple):
    """An input that is not translated."""

    off: float = 0.0  # the value, for all channels, at which the input has no effect
    instead: str = "it is rendered as 0"
    details: tuple[str, ...] = ()  # inputs that have no effect if this one is off


_FILM = LeftOut(instead="it is rendered without a film", details=("Thin Film IOR",))
_ROUND = "it is rendered with round highlights of the same roughness"
# For each translated shader: the inputs that are read, and those that are left out.
_READ = {
    'ShaderNodeBsdfPrincipled': {
        "Base Color", "Metallic", "Roughness", "IOR", "Alpha", "Normal", "Specular IOR Level", "Specular Tint",
        "Coat Weight", "Coat Roughness", "Coat IOR", "Coat Tint", "Coat Normal",
        "Diffuse Roughness", "Sheen Weight", "Sheen Roughness", "Sheen Tint",
        "Transmission Weight", "Emission Color", "Emission Strength"},
    'ShaderNodeBsdfDiffuse': {"Color", "Roughness", "Normal"},
    'ShaderNodeBsdfGlossy': {"Color", "Roughness", "Normal"},
    'ShaderNodeBsdfMetallic': {"Base Color", "Edge Tint", "IOR", "Extinction", "Roughness", "Normal"},
    'ShaderNodeBsdfGlass': {"Color", "Roughness", "IOR", "Normal"},
    'ShaderNodeBsdfRefraction': {"Color", "Roughness", "IOR", "Normal"},
    'ShaderNodeBsdfTransparent': {"Color"},
    'ShaderNodeBsdfSheen': {"Color", "Roughness", "Normal"},
    'ShaderNodeBsdfTranslucent': {"Color", "Normal"},
    'ShaderNodeEmission': {"Color", "Strength"},
    'ShaderNodeMixShader': {"Fac", "Factor"},  # its name before 5.0
    'ShaderNodeBackground': {"Color", "Strength"},
}
_READ['ShaderNodeBsdfAnisotropic'] = _READ['ShaderNodeBsdfGlossy']  # the internal name of the Glossy BSDF
_LEFT_OUT: dict[str, dict[str, LeftOut]] = {
    'ShaderNodeBsdfPrincipled': {
        "Thin Wall": LeftOut(instead="it is rendered as a solid"),
        "Subsurface Weight": LeftOut(
            instead="it is rendered matt, in the base colour, where light is scattered below the surface",
            details=("Subsurface Radius", "Subsurface Scale", "Subsurface IOR", "Subsurface Anisotropy")),
        "Anisotropic": LeftOut(instead=_ROUND, details=("Anisotropic Rotation", "Tangent")),
        "Thin Film Thickness": _FILM,
    },
    'ShaderNodeBsdfGlossy': {"Anisotropy": LeftOut(instead=_ROUND, details=("Rotation", "Tangent"))},
    'ShaderNodeBsdfMetallic': {"Anisotropy": LeftOut(instead=_ROUND, details=("Rotation", "Tangent")),
                               "Thin Film Thickness": _FILM},
    'ShaderNodeBsdfGlass': {"Thin Film Thickness": _FILM},
}
_LEFT_OUT['ShaderNodeBsdfAnisotropic'] = _LEFT_OUT['ShaderNodeBsdfGlossy']


def inputs(nodes: Nodes, node) -> None:
    """Warn about the inputs of a translated shader that are in use but not read."""
    known, sockets = _LEFT_OUT.get(node.bl_idname, {}), node.inputs
    asked = _asked.get((node.bl_idname, len(sockets)))
    if asked is None:  # those of nodes of one type have the same names
        passed = _READ.get(node.bl_idname, set()).union(*(left.details for left in known.values()))
        asked = _asked[node.bl_idname, len(sockets)] = [
            i for i, s in enumerate(sockets) if s.type != 'SHADER' and s.name not in passed]
    for socket in (sockets[i] for i in asked):
        if not socket.enabled or socket.is_unavailable:
            continue
        name = socket.name
        left = known.get(name, LeftOut(instead="it is rendered without it"))
        value = getattr(socket, "default_value", left.off)
        linked = nodes.link(node, socket)
        if linked or (not socket.hide_value and _differs(value, left.off)):
            nodes.warn(f"'{name}' of node '{nodes.plain_name(node)}' is not translated; {left.instead}",
                       "" if linked else f"instead of {shown(value)}")


_asked: dict[tuple[str, int], list[int]] = {}  # places of the inputs that may have to be named, by type of node


def _differs(value, off: float) -> bool:
    if isinstance(value, str):
        return bool(value)
    values = [value] if isinstance(value, int | float) else list(value)[:3]
    return any(abs(v - off) > 1e-6 for v in values)


def settings(scene, view_layer, report: Report) -> None:
    """Warn about settings of the scene and the view layer that Cycles uses and the engine does not."""
    cycles, simplified = getattr(scene, "cycles", None), scene.render.use_simplify
    for used, sentence in (
        (scene.render.use_motion_blur and view_layer.use_motion_blur,
         "Motion Blur is switched on, but not rendered: what moves is sharp"),
        (not view_layer.use_sky,
         "View layer '{}': Include Environment is off, but the world is rendered: Film: Transparent leaves it out"),
        (not view_layer.use_solid, "View layer '{}': Include Surfaces is off, but they are rendered"),
        (cycles and cycles.film_exposure != 1,
         "Cycles' Film: Exposure is not translated: the picture has that of Color Management alone"),
        (cycles and scene.render.film_transparent and cycles.film_transparent_glass,
         "Cycles' Film: Transparent Glass is not translated: glass is opaque in the picture's alpha"),
        (cycles and cycles.sample_clamp_direct > 0,
         "Cycles' Clamping: Direct Light is not translated: no light is clamped"),
        (cycles and simplified and (cycles.use_camera_cull or cycles.use_distance_cull),
         "Cycles' Simplify: Culling is not translated: objects are rendered wherever they are"),
    ):
        if used:
            report.warn(sentence.format(view_layer.name))


def rays(ob, report: Report) -> None:
    """Warn about ray visibility settings of an object that the engine does not support."""
    if ob.visible_transmission != ob.visible_glossy:
        report.warn("Ray Visibility: Transmission is not translated; it is seen through glass as in mirrors",
                    "Object", ob.name)

