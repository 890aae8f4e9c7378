"""Shader nodes → a Surface. What is not known here falls back to its nearest and is named in a warning."""

from dataclasses import replace

from . import left_out, node_bumps
from . import values as v
from .facets import Facets
from .node_inputs import normal
from .nodes import Nodes
from .surface import BLACK, Surface, scaled
from .values import Triple, Value


def surface(nodes: Nodes, output) -> Surface:
    """Translate the surface at a material's output node."""
    if output is None:
        nodes.warn("there is no output node; it is rendered black")
        return Surface.emitting(BLACK)
    volume = nodes.source(output, "Volume")
    if volume is not None:
        nodes.not_translated(volume, "it is rendered without volume")
    _displace(nodes, output)
    if nodes.source(output, "Volume") and not nodes.source(output, "Surface"):
        return Surface.transparent((1.0, 1.0, 1.0))  # a volume has no surface
    return _shader(nodes, output, "Surface")


def _shader(nodes: Nodes, node, socket) -> Surface:
    """Return the surface that input `socket` of `node` gets."""
    shader = nodes.source(node, socket)
    if shader is None:
        return Surface.emitting(BLACK)  # as Blender draws it
    translate = _SHADERS.get(shader.bl_idname)
    if translate:
        left_out.inputs(nodes, shader)
        found = translate(nodes, shader)
        return replace(found, normal=node_bumps.given(nodes, shader)) if "Normal" in shader.inputs else found
    # Most shaders have a colour, and the colour of a surface is what one sees first.
    if "Color" in shader.inputs:
        nodes.not_translated(shader, "it is rendered as a diffuse surface of its colour")
        return Surface.diffuse(nodes.color(shader, "Color"))
    nodes.not_translated(shader, "it is rendered as a grey diffuse surface")
    return Surface()


def _principled(nodes: Nodes, node) -> Surface:
    metallic, roughness = (v.clamp(nodes.value(node, s)) for s in ("Metallic", "Roughness"))
    specular = nodes.value(node, "Specular IOR Level")
    color = nodes.color(node, "Base Color")
    tint, several = nodes.color(node, "Specular Tint"), _several(nodes, node)
    base = Surface.principled(color, metallic, roughness, specular, nodes.value(node, "IOR"), tint, several)
    if "Diffuse Roughness" in node.inputs:
        base = replace(base, diffuse_roughness=nodes.value(node, "Diffuse Roughness"))
    transmission = v.clamp(nodes.value(node, "Transmission Weight")) * (1 - metallic)
    if not is_zero(transmission):
        # As Cycles: the base colour is that of two crossings.
        root = tuple(v.square_root(c) if not v.is_constant(c) else max(c, 0.0) ** 0.5 for c in color)
        glass = _glassy(nodes, node, root, True)
        base = base.times(1 - transmission).joined(glass.times(transmission))
        base = replace(base, facets=replace(base.facets, share=1.0))  # all of it mirrors
    coat = nodes.value(node, "Coat Weight")
    if not is_zero(coat):
        base = replace(base, facets=base.facets.coated(
            coat, nodes.value(node, "Coat Roughness"), nodes.value(node, "Coat IOR"), nodes.color(node, "Coat Tint")))
    sheen = nodes.value(node, "Sheen Weight")
    if not is_zero(sheen):
        base = replace(base, facets=base.facets.with_sheen(
            sheen, nodes.value(node, "Sheen Roughness"), nodes.color(node, "Sheen Tint")))
    strength = nodes.value(node, "Emission Strength")
    if not is_zero(strength) and not (v.is_constant(strength) and strength < 0):
        glow = scaled(nodes.color(node, "Emission Color"), strength)
        base = replace(base, emission=base.facets.dims(glow))
    base = replace(base, alpha=base.alpha * v.clamp(nodes.value(node, "Alpha")))
    if not is_zero(coat):
        base = base.under_smooth_coat(node_bumps.given(nodes, node), node_bumps.given(nodes, node, "Coat Normal"))
    return base


def _diffuse(nodes: Nodes, node) -> Surface:
    return Surface.diffuse(nodes.color(node, "Color"), nodes.value(node, "Roughness"))


def _glossy(nodes: Nodes, node) -> Surface:
    color = tuple(v.maximum(c, 0.0) for c in nodes.color(node, "Color"))
    return Surface.metal(color, Facets.glossy(color, v.clamp(nodes.value(node, "Roughness")), _several(nodes, node)))


def _metallic(nodes: Nodes, node) -> Surface:
    roughness, several = v.clamp(nodes.value(node, "Roughness")), _several(nodes, node)
    if node.fresnel_type == 'F82':
        facets = Facets.principled(nodes.color(node, "Base Color"), 1.0, roughness, 0.0, 1.5,
                                   nodes.color(node, "Edge Tint"), several)
    else:
        facets = Facets.conductor(nodes.vector(node, "IOR"), nodes.vector(node, "Extinction"), roughness, several)
    return Surface.metal(facets.F0, facets)


def _several(nodes: Nodes, node) -> float:
    """Return whether the light that microfacets reflect several times counts in a node's distribution, 1 or 0."""
    if node.distribution not in ('MULTI_GGX', 'GGX'):
        name = node.bl_rna.properties["distribution"].enum_items[node.distribution].name
        nodes.warn(f"distribution {name} of node '{nodes.plain_name(node)}' is not translated; it is rendered as GGX")
    return float(node.distribution == 'MULTI_GGX')


def _glass(nodes: Nodes, node) -> Surface:
    return _glassy(nodes, node, nodes.color(node, "Color"), node.bl_idname == 'ShaderNodeBsdfGlass')


def _glassy(nodes: Nodes, node, color: Triple, fresnel: bool) -> Surface:
    roughness = v.clamp(nodes.value(node, "Roughness"))
    if not v.is_constant(roughness) or roughness > 1e-3:
        nodes.warn(f"shadows of the rough glass in node '{nodes.plain_name(node)}' are those of clear glass")
    ior = v.maximum(nodes.value(node, "IOR"), 0.01)
    if not fresnel:
        return Surface.glass(color, ior, False, frosted=roughness)
    tint = color if node.bl_idname == 'ShaderNodeBsdfGlass' else (1.0, 1.0, 1.0)
    return Surface.glass(color, ior, True, Facets.glass(tint, ior, roughness, _several(nodes, node)), roughness)


def _sheen(nodes: Nodes, node) -> Surface:
    if node.distribution != 'MICROFIBER':
        name = node.bl_rna.properties["distribution"].enum_items[node.distribution].name
        nodes.warn(f"distribution {name} of node '{nodes.plain_name(node)}' is not translated; it is rendered as "
                   "Microfiber")
    facets = Facets.fibres(nodes.color(node, "Color"), nodes.value(node, "Roughness"))
    return Surface(color=BLACK, kd=0.0, ka=0.0, facets=facets)


def _transparent(nodes: Nodes, node) -> Surface:
    return Surface.transparent(nodes.color(node, "Color"))


def _translucent(nodes: Nodes, node) -> Surface:
    return Surface.translucent_of(nodes.color(node, "Color"))


def _emission(nodes: Nodes, node) -> Surface:
    return Surface.emitting(scaled(nodes.color(node, "Color"), nodes.value(node, "Strength")))


def _mix(nodes: Nodes, node) -> Surface:
    factor = v.clamp(nodes.value(node, 0))
    # A side that is not seen must not warn.
    if v.is_constant(factor) and factor in (0.0, 1.0):
        return _shader(nodes, node, 1 + int(factor))
    return _shader(nodes, node, 1).plus(_shader(nodes, node, 2), 1 - factor, factor)


def _add(nodes: Nodes, node) -> Surface:
    return _shader(nodes, node, 0).plus(_shader(nodes, node, 1))


_SHADERS = {
    'ShaderNodeBsdfPrincipled': _principled,
    'ShaderNodeBsdfDiffuse': _diffuse,
    'ShaderNodeBsdfGlossy': _glossy,
    'ShaderNodeBsdfAnisotropic': _glossy,  # what Glossy is called inside
    'ShaderNodeBsdfMetallic': _metallic,
    'ShaderNodeBsdfGlass': _glass,
    'ShaderNodeBsdfRefraction': _glass,
    'ShaderNodeBsdfSheen': _sheen,
    'ShaderNodeBsdfTranslucent': _translucent,
    'ShaderNodeBsdfTransparent': _transparent,
    'ShaderNodeEmission': _emission,
    'ShaderNodeMixShader': _mix,
    'ShaderNodeAddShader': _add,
}


def _displace(nodes: Nodes, output) -> None:
    """Show displacement as bumps, as Cycles' "Bump Only"."""
    node = nodes.source(output, "Displacement")
    if node is None:
        return
    height = node_bumps.height(nodes, output)
    if nodes.displacement_method != 'BUMP':
        nodes.warn("its displacement is shown as bumps only; the surface itself stays where it is")
    if not v.is_constant(height):
        nodes.displaced = node_bumps.bumped(height, normal(), width=node_bumps.DISPLACEMENT_WIDTH)


def is_zero(value: Value) -> bool:
    """Return whether a value is the number 0."""
    return v.is_constant(value) and value == 0
