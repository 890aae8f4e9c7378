"""Shaders become highlights of microfacets (GGX); what is overridden is Phong's."""

import pytest
from test_addon_materials import mixed


def test_highlights_are_those_of_facets(translated, node_material):
    found, scene = translated(node_material(
        "Tinted", 'ShaderNodeBsdfPrincipled', Base_Color=(0.5, 0.4, 0.3, 1), Roughness=0.5, Metallic=0.25,
        Specular_Tint=(1.0, 0.5, 0.25, 1), Specular_IOR_Level=1.0))
    assert found.highlight == "GGX" and found.roughness == 0.5 and found.layered == found.compensation == 1
    assert found.metal == 0.25 and pytest.approx((0.5, 0.4, 0.3)) == found.F0 and found.F90 == (1, 1, 1)
    assert found.F82 == found.dielectric_tint == (1.0, 0.5, 0.25) and found.dielectric == 0.75
    # Twice the reflectance of 1.5, 0.04: (n − 1)²/(n + 1)² = 0.08.
    assert ((found.dielectric_ior - 1) / (found.dielectric_ior + 1)) ** 2 == pytest.approx(0.08)
    assert not scene.warnings
    found, _ = translated(node_material("Matt", 'ShaderNodeBsdfPrincipled', Specular_IOR_Level=0))
    assert found.highlight == "PHONG" and found.ks == 0 and found.kd == 1


def test_a_coat(translated, node_material):
    material = node_material("Lacquer", 'ShaderNodeBsdfPrincipled', Roughness=0.6, Coat_Weight=0.5, Coat_Roughness=0.05,
                             Coat_IOR=1.8, Coat_Tint=(1, 0.5, 0.25, 1))
    found, scene = translated(material)
    assert (found.coat, found.coat_tint) == (0.5, (1, 0.5, 0.25)) and not scene.warnings
    assert (found.coat_roughness, found.coat_ior) == (pytest.approx(0.05), pytest.approx(1.8))
    assert found.mirror == pytest.approx((0.5 * (0.8 / 2.8) ** 2,) * 3)  # so smooth a coat mirrors


@pytest.mark.parametrize(("name", "value"), [("ks", 0.3), ("Os", (1, 0, 0)), ("nShiny", 9.0)])
def test_an_overridden_highlight_is_phongs(translated, node_material, name, value):
    material = node_material("Plastic", 'ShaderNodeBsdfPrincipled')
    setattr(material.light_meshes, f"override_{name}", True)
    setattr(material.light_meshes, name, value)
    found, _ = translated(material)
    assert found.highlight == "PHONG" and getattr(found, name) == pytest.approx(value)
    material.light_meshes.property_unset(f"override_{name}")
    material.light_meshes.override_kd = True
    assert translated(material)[0].highlight == "GGX"


def test_facets_of_textures_and_mixes(translated):
    material = mixed("Mixed", 'ShaderNodeMixShader', ('ShaderNodeBsdfPrincipled', {"Roughness": 0.3}),
                     ('ShaderNodeBsdfDiffuse', {}), 0.75)
    found, _ = translated(material)
    # A quarter is below the dielectric, of which there is a quarter; the rest is a layer without one.
    assert (found.dielectric, found.layered, found.kd) == (0.25, 1, 0.25) and found.roughness == pytest.approx(0.3)
    [rest] = found.layers
    assert (rest.dielectric, rest.layered, rest.kd) == (0, 0, 0.75)
    principled = next(n for n in material.node_tree.nodes if n.bl_idname == 'ShaderNodeBsdfPrincipled')
    noise = material.node_tree.nodes.new('ShaderNodeTexNoise')
    for socket in ("Roughness", "Metallic", "Base Color", "IOR"):
        material.node_tree.links.new(noise.outputs[0], principled.inputs[socket])
    found, scene = translated(material)
    assert found.highlight == "GGX" and not scene.warnings
    assert {"roughness", "metal", "F0", "dielectric", "dielectric_ior"} <= set(found.program.values)
    assert not {"ks", "Os", "nShiny"} & set(found.program.values)  # nobody asks for Phong's
