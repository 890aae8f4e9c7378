"""Layers of materials: what several shaders at one place reflect is the sum of what each does; see tests/peers, too."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Material, Scene, Shape, rectangle
from light_meshes.picture.render import render_image
from light_meshes.scene.errors import SceneError
from light_meshes.scene.programs import program
from light_meshes.scene.snapshot import read, write
from light_meshes.scene.validation import checked
from scenes import combined, four_lights, settings, sun, tabletop

PLASTIC = Material("plastic", Od=(0.2, 0.5, 0.8), highlight="GGX", blurred=True, dielectric=1.0, layered=1.0,
                   roughness=0.4, coat=1.0, coat_roughness=0.3, sheen=1.0, sheen_tint=(1.0, 0.5, 0.2))


def times(material, share):
    """So much of a material's light."""
    return replace(material, kd=material.kd * share, ka=material.ka * share, ks=material.ks * share,
                   mirror=tuple(share * c for c in material.mirror), metal=share * material.metal,
                   dielectric=share * material.dielectric, share=share)


def divided(scene):
    """The scene, each material's light given by three layers."""
    return replace(scene, materials=tuple(
        replace(times(m, 0.5), layers=(times(m, 0.3), times(m, 0.2))) for m in scene.materials))


def shiny(scene):
    return replace(scene, materials=tuple(replace(PLASTIC, name=m.name) for m in scene.materials))


@pytest.mark.parametrize("values", [
    {"shadows": "LIGHT_MESHES"}, {"shadows": "SHARP"}, {"mode": "WHITTED", "shadows": "SHARP", "max_depth": 2},
    {"shadows": "SHARP", "world_light": "SKY", "bounces": 1}], ids=["soft", "sharp", "mirrored", "gathered"])
def test_layers_add_up_to_one_material(values):
    scene = shiny(four_lights(48))
    scene = replace(scene, settings=replace(scene.settings, **values), world_color=(0.2, 0.3, 0.4))
    whole, sum_ = combined(scene), combined(divided(scene))
    assert whole.max() > 0.1
    assert np.abs(sum_ - whole).max() < 2e-3 * whole.max()


def test_with_a_shadow_rate_layers_are_computed():
    scene = tabletop(64, shadow_rate=4, shadows="LIGHT_MESHES")
    exact = combined(replace(scene, settings=replace(scene.settings, shadow_rate=1)))
    assert np.abs(combined(divided(scene)) - exact).max() < 2e-3 * exact.max()


def floor(material, *lights, **values):
    """What an eye straight above sees of a floor, with all passes."""
    scene = Scene.from_shapes([Shape(rectangle((-9, -9), (9, 9), 0.0), material, "floor")],
                              Camera.look_at((0, 1e-3, 10), (0, 0, 0), 1e-3, 1, 1), lights,
                              settings(mode="LOCAL", **values))
    return render_image(scene).passes["Combined"][0, 0, :3].astype(float)


def test_a_program_says_what_layers_are():
    made = program({"operations": [["add", 0.25, 0.5], ["multiply", [0], 2.0]], "values": {
        "kd": [[0]], "1.kd": [[1]], "1.Od": [1.0, 0.5, 0.25]}}, "here")
    material = Material("m", Od=(1.0, 1.0, 1.0), layers=(Material("layer"),), program=made)
    assert floor(material, sun((0, 0, -1))) == pytest.approx([0.75 + 1.5, 0.75 + 0.75, 0.75 + 0.375], rel=1e-5)


def test_each_layer_has_its_own_normal():
    """A layer without one has the surface's, whatever the first layer's is."""
    up, aside = ([0.0, 0.0, 1.0], [0.6, 0.0, 0.8])

    def lit(normals):
        names = {f"{k}.normal" if k else "normal": n for k, n in enumerate(normals) if n}
        made = program({"operations": [["position"]], "values": names}, "here")
        white = Material("m", Od=(1.0,) * 3, kd=0.5)
        return floor(replace(white, layers=(white,), program=made), sun((0, 0, -1)))[0]

    assert lit([aside, None]) == pytest.approx(0.5 * 0.8 + 0.5, rel=1e-5)
    assert lit([None, aside]) == pytest.approx(0.5 * 0.8 + 0.5, rel=1e-5)
    assert lit([aside, aside]) == pytest.approx(0.8, rel=1e-5)
    assert lit([aside, up]) == pytest.approx(0.5 * 0.8 + 0.5, rel=1e-5)


def test_a_lamp_that_only_a_layer_sees_counts():
    made = program({"operations": [["position"]], "values": {"normal": [0.8, 0.0, 0.6]}}, "here")
    first = Material("m", Od=(1.0,) * 3, kd=0.5, program=made, layers=(Material("layer", Od=(1.0,) * 3, kd=0.5),))
    away = np.array([-0.9, 0.0, 0.2]) / np.hypot(0.9, 0.2)  # above the floor, behind the first layer's normal
    assert floor(first, sun(tuple(-away))) == pytest.approx(0.5 * away[2], rel=1e-5)


def test_glass_mirrors_by_its_share():
    glass = Material("glass", kd=0.0, ka=0.0, kt=(0.5,) * 3, ior=1.5, fresnel=True, share=0.5)

    scene = Scene.from_shapes([Shape(rectangle((-9, -9), (9, 9), 0.0), glass, "floor")], Camera.look_at(
        (0, 1e-3, 10), (0, 0, 0), 1e-3, 1, 1), (), settings(mode="WHITTED"))
    for share in (0.5, 1.0):
        one = replace(scene, materials=(replace(glass, share=share),), world_color=(1.0,) * 3)
        mirrored = render_image(one).passes["Combined"][0, 0, 0]
        assert mirrored == pytest.approx(0.5 * 0.96 + share * 0.04, rel=1e-3)


def test_layers_are_read_as_they_were_written(tmp_path):
    scene = divided(four_lights(8))
    write(scene, tmp_path)
    assert read(tmp_path).materials == scene.materials == checked(scene).materials


@pytest.mark.parametrize("layers, says", [
    ((Material("a", layers=(Material("b"),)),), "layer 1 has layers"),
    ((Material("a"), Material("b", program=program({"operations": [], "values": {"kd": 1.0}}, ""))), "layer 2 has"),
    ((Material("a"),) * 8, "7 materials at most"), ((Material("a", kd="much"),), "kd"),
    ((Material("a", image=3),), "image 3 does not exist")])
def test_layers_that_make_no_sense_are_named(layers, says):
    scene = four_lights(8)
    with pytest.raises(SceneError, match=says):
        checked(replace(scene, materials=(replace(scene.materials[0], layers=layers), *scene.materials[1:])))


def test_programs_name_layers_that_there_are():
    made = program({"operations": [], "values": {"2.kd": 1.0}}, "here")
    scene = four_lights(8)
    with pytest.raises(SceneError, match="a layer that does not exist"):
        checked(replace(scene, materials=(replace(scene.materials[0], program=made), *scene.materials[1:])))
    with pytest.raises(SceneError, match="no parameter"):
        program({"operations": [], "values": {"8.kd": 1.0}}, "here")


def test_materials_with_equal_programs_keep_what_else_they_are():
    """Equal programs run as one, also those of materials with layers; with a step that nothing uses they are unequal.
    """
    scene = shiny(four_lights(48))

    def picture(*steps):
        made = [program({"operations": [["position"], ["sine", [0]], *[["sine", [0]]] * extra],
                         "values": {"Od": [[3], 0.5, 0.4]}}, "it") for extra in steps]
        looks = [replace(m, kd=1.0 / (n + 1), program=made[n % len(made)], layers=(times(PLASTIC, 0.2),) * (n % 2))
                 for n, m in enumerate(scene.materials)]
        return combined(replace(scene, materials=tuple(looks)))

    assert len(scene.materials) > 1
    assert picture(0, 0).max() > 0.1
    assert np.array_equal(picture(0, 0), picture(0, 1))
