"""Translate shader nodes to a Surface. An unknown node is replaced by the nearest known one, and a warning names it."""

from dataclasses import replace

from . import left_out
from .nodes import Nodes
from .report import shown
from .surface import BLACK, RGB, Surface, scaled

IMAGE = 'ShaderNodeTexImage'


def surface(nodes: Nodes, output) -> Surface:
    """Return the surface at a material's output node."""
    if output is None:
        nodes.warn("there is no output node; it is rendered black")
        return Surface.emitting(BLACK)
    for extra in ("Displacement", "Volume"):
        node = nodes.source(output, extra)
        if node is not None:
            nodes.not_translated(node, f"it is rendered without {extra.lower()}")
    if nodes.source(output, "Volume") and not nodes.source(output, "Surface"):
        return Surface.transparent((1.0, 1.0, 1.0))  # a volume has no surface
    return _shader(nodes, output, "Surface")


def _shader(nodes: Nodes, node, socket) -> Surface:
    """Return the surface that arrives at input `socket` of `node`."""
    shader = nodes.source(node, socket)
    if shader is None:
        return Surface.emitting(BLACK)  # as Blender shows it
    translate = _SHADERS.get(shader.bl_idname)
    if translate:
        left_out.inputs(nodes, shader)
        return translate(nodes, shader)
    # Most shaders have a colour, and the colour is the most visible property of a surface.
    if "Color" in shader.inputs:
        nodes.not_translated(shader, "it is rendered as a diffuse surface of its colour")
        return _colored(nodes, shader, "Color", Surface.diffuse)
    nodes.not_translated(shader, "it is rendered as a grey diffuse surface")
    return Surface()


def _principled(nodes: Nodes, node) -> Surface:
    metallic, roughness, specular = (nodes.value(node, s) for s in ("Metallic", "Roughness", "Specular IOR Level"))
    _without_bumps(nodes, node)
    ior = nodes.value(node, "IOR")
    base = _colored(nodes, node, "Base Color",
                    lambda color: Surface.principled(color, metallic, roughness, specular, ior))
    if base.image and metallic > 0:
        nodes.not_translated(base.image, f"'{node.name}' is metallic, and its image colours only the diffuse part")
    transmission = min(max(nodes.value(node, "Transmission Weight"), 0.0), 1.0) * (1 - metallic)
    if transmission > 0:
        # As in Cycles: the base colour is the colour after two crossings.
        color = tuple(max(c, 0.0) ** 0.5 for c in base.color)
        base = base.plus(_glassy(nodes, node, color, True), 1 - transmission, transmission)
    strength = nodes.value(node, "Emission Strength")
    if strength > 0:
        base = base.plus(Surface.emitting(scaled(tuple(nodes.color(node, "Emission Color")), strength)))
    return _cut_out(nodes, node, base)


def _diffuse(nodes: Nodes, node) -> Surface:
    _without_bumps(nodes, node)
    return _colored(nodes, node, "Color", Surface.diffuse)


def _glossy(nodes: Nodes, node) -> Surface:
    _without_bumps(nodes, node)
    return Surface.glossy(tuple(nodes.color(node, "Color")), nodes.value(node, "Roughness"))


def _glass(nodes: Nodes, node) -> Surface:
    _without_bumps(nodes, node)
    return _glassy(nodes, node, tuple(nodes.color(node, "Color")), node.bl_idname == 'ShaderNodeBsdfGlass')


def _glassy(nodes: Nodes, node, color: RGB, fresnel: bool) -> Surface:
    roughness = nodes.value(node, "Roughness")
    if roughness > 1e-3:
        nodes.warn(f"'Roughness' of the glass in node '{nodes.plain_name(node)}' is not translated; it is rendered "
                   "clear", f"instead of {shown(roughness)}")
    return Surface.glass(color, max(nodes.value(node, "IOR"), 0.01), fresnel)


def _transparent(nodes: Nodes, node) -> Surface:
    return Surface.transparent(tuple(nodes.color(node, "Color")))


def _cut_out(nodes: Nodes, node, base: Surface) -> Surface:
    """Apply the Alpha of a Principled BSDF to `base`: a constant, or the alpha of an image."""
    link = nodes.link(node, "Alpha")
    if link and link.from_node.bl_idname == IMAGE and link.from_socket.name == "Alpha" and link.from_node.image:
        image = link.from_node
        return replace(base, alpha_image=image, uv_map=base.uv_map or _uv_map(nodes, image))
    return replace(base, alpha=base.alpha * min(max(nodes.value(node, "Alpha"), 0.0), 1.0))


def _emission(nodes: Nodes, node) -> Surface:
    return Surface.emitting(scaled(tuple(nodes.color(node, "Color")), nodes.value(node, "Strength")))


def _mix(nodes: Nodes, node) -> Surface:
    link = nodes.link(node, 0)
    if link and link.from_node.bl_idname == IMAGE and link.from_socket.name == "Alpha" and link.from_node.image:
        # The usual way to make leaves: transparent outside the image's alpha, the surface inside.
        below, above = _shader(nodes, node, 1), _shader(nodes, node, 2)
        if below.alpha == 0 and above.alpha > 0:
            return replace(above, alpha_image=link.from_node, uv_map=above.uv_map or _uv_map(nodes, link.from_node))
    factor = min(max(nodes.value(node, 0), 0.0), 1.0)
    # A shader with weight 0 must not cause warnings.
    if factor in (0.0, 1.0):
        return _shader(nodes, node, 1 + int(factor))
    return _sum(nodes, node, _shader(nodes, node, 1), _shader(nodes, node, 2), 1 - factor, factor)


def _add(nodes: Nodes, node) -> Surface:
    return _sum(nodes, node, _shader(nodes, node, 0), _shader(nodes, node, 1), 1.0, 1.0)


def _sum(nodes: Nodes, node, a: Surface, b: Surface, weight_a: float, weight_b: float) -> Surface:
    if (a.image and b.kd > 0) or (b.image and a.kd > 0):
        nodes.not_translated(node, "of its two diffuse colours only the one with the image is used")
    return a.plus(b, weight_a, weight_b)


_SHADERS = {
    'ShaderNodeBsdfPrincipled': _principled,
    'ShaderNodeBsdfDiffuse': _diffuse,
    'ShaderNodeBsdfGlossy': _glossy,
    'ShaderNodeBsdfAnisotropic': _glossy,  # the internal name of the Glossy BSDF
    'ShaderNodeBsdfGlass': _glass,
    'ShaderNodeBsdfRefraction': _glass,
    'ShaderNodeBsdfTransparent': _transparent,
    'ShaderNodeEmission': _emission,
    'ShaderNodeMixShader': _mix,
    'ShaderNodeAddShader': _add,
}


def _without_bumps(nodes: Nodes, node) -> None:
    bump = nodes.source(node, "Normal")
    if bump is not None:
        nodes.not_translated(bump, "the surface is rendered without it")


def _colored(nodes: Nodes, node, socket: str, make) -> Surface:
    """Call `make` with the colour at input `socket`, and add the image if there is one; return the surface."""
    link = nodes.link(node, socket)
    image = _image_above(nodes, link) if link else None
    if image is None:
        return make(tuple(nodes.color(node, socket)))
    if link.from_node != image:
        nodes.not_translated(link.from_node, f"the image of '{image.name}' is used as it is")
    # If the highlights of a metal need a colour, the socket's own value is the nearest constant.
    color: RGB = tuple(nodes.input(node, socket).default_value)[:3]
    return replace(make(color), image=image, uv_map=_uv_map(nodes, image))


def _image_above(nodes: Nodes, link):
    """Return the image texture from which `link` comes, directly or through nodes that would change its colours."""
    seen, todo = set(), [link]
    while todo:
        link = todo.pop(0)
        source = link.from_node
        if source.name in seen:
            continue
        seen.add(source.name)
        if source.bl_idname == IMAGE and source.image and link.from_socket.name == "Color":
            return source
        colors = [s for s in source.inputs if s.type == 'RGBA']
        todo += [above for above in (nodes.link(source, s) for s in colors) if above]
    return None


def _uv_map(nodes: Nodes, image) -> str:
    link = nodes.link(image, "Vector")
    if link is None:
        return ""
    source = link.from_node
    if source.bl_idname == 'ShaderNodeUVMap':
        return source.uv_map
    if not (source.bl_idname == 'ShaderNodeTexCoord' and link.from_socket.name == "UV"):
        nodes.not_translated(source, f"'{image.name}' is placed by the UV map")
    return ""
