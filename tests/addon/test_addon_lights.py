"""The exported properties of lights, except their energy, which test_addon_cycles.py checks."""

import math

import bpy
import numpy as np
import pytest


def the_light(found):
    assert len(found.lights) == 1
    return found.lights[0]


def test_place_and_direction(scene, add_light, snapshot):
    add_light('SPOT', location=(1, 2, 3), rotation=(math.pi / 2, 0, 0), scale=(2, 2, 2))
    light = the_light(snapshot(scene))
    assert light.position == pytest.approx((1, 2, 3))
    assert light.direction == pytest.approx((0, 1, 0), abs=1e-6)


def test_sizes(scene, add_light, snapshot):
    add_light('POINT', shadow_soft_size=0.25, scale=(3, 3, 3))  # a scale does not change it
    assert the_light(snapshot(scene)).radius == pytest.approx(0.25)


def test_sun(scene, add_light, snapshot):
    add_light('SUN', angle=0.1)
    light = the_light(snapshot(scene))
    assert light.type == 'SUN' and light.angle == pytest.approx(0.1)


def test_area(scene, add_light, snapshot):
    add_light('AREA', shape='ELLIPSE', size=2, size_y=1, spread=1.0, scale=(3, 1, 1), rotation=(0, 0, math.pi / 2))
    light = the_light(snapshot(scene))
    assert light.area_ellipse and light.spread == pytest.approx(1)
    assert light.area_u == pytest.approx((0, 3, 0), abs=1e-6)
    assert light.area_v == pytest.approx((-0.5, 0, 0), abs=1e-6)


def test_spot(scene, add_light, snapshot):
    add_light('SPOT', spot_size=1.0, spot_blend=0.3)
    light = the_light(snapshot(scene))
    assert (light.spot_angle, light.spot_blend) == (pytest.approx(1), pytest.approx(0.3))


def test_an_unevenly_scaled_spot_has_an_elliptic_cone(scene, add_light, snapshot):
    add_light('SPOT', scale=(2, 1, 1))
    light = the_light(snapshot(scene))
    np.testing.assert_allclose(light.axes, [(0.5, 0, 0), (0, 1, 0), (0, 0, -1)], atol=1e-6)


def test_shadow_switch(scene, add_light, snapshot):
    light = add_light('POINT')
    assert the_light(snapshot(scene)).cast_shadow
    light.data.use_shadow = False
    assert not the_light(snapshot(scene)).cast_shadow


def test_hidden_and_instanced_lights(scene, add, add_light, snapshot):
    light = add_light('POINT', location=(0, 0, 2))
    collection = bpy.data.collections.new("Lamps")
    collection.objects.link(light)
    scene.collection.objects.unlink(light)
    for x in (1, 5):
        add(None, f"Post {x}", instance_type='COLLECTION', instance_collection=collection, location=(x, 0, 0))
    add_light('POINT').hide_render = True
    found = snapshot(scene)
    assert sorted(round(one.position[0]) for one in found.lights) == [1, 5]


def nodes_of(light):
    light.data.use_nodes = True
    return light.data.node_tree, light.data.node_tree.nodes["Emission"]


def test_constant_nodes_need_no_program(scene, add_light, snapshot):
    tree, emission = nodes_of(add_light('POINT', energy=100))
    plain = the_light(snapshot(scene))
    emission.inputs["Color"].default_value = (0.5, 1.0, 0.25, 1)
    kelvin = tree.nodes.new('ShaderNodeMath')
    kelvin.operation, kelvin.inputs[0].default_value, kelvin.inputs[1].default_value = 'MULTIPLY', 2.0, 2.0
    tree.links.new(kelvin.outputs[0], emission.inputs["Strength"])
    found = the_light(snapshot(scene))
    assert not found.program and found.matrix is None and not plain.program
    assert np.allclose(found.intensity, np.multiply(plain.intensity, (2, 4, 1)))


def test_falloff_is_a_program(scene, add_light, snapshot):
    tree, emission = nodes_of(add_light('POINT', energy=100, location=(1, 2, 3)))
    falloff = tree.nodes.new('ShaderNodeLightFalloff')
    tree.links.new(falloff.outputs["Linear"], emission.inputs["Strength"])
    found = snapshot(scene)
    light = the_light(found)
    assert not found.warnings and light.program.asks() == {"ray_length", "multiply"}
    assert np.allclose(light.intensity, 100 / (4 * math.pi**2))
    assert np.allclose(light.matrix, [(1, 0, 0, 1), (0, 1, 0, 2), (0, 0, 1, 3)])
    falloff.inputs["Strength"].default_value = 0.0
    assert not the_light(snapshot(scene)).program and not any(the_light(snapshot(scene)).intensity)


def test_what_nodes_cannot_say_has_a_mean_that_is_named(scene, add_light, snapshot):
    tree, emission = nodes_of(add_light('POINT', energy=100))
    tree.links.new(tree.nodes.new('ShaderNodeTexGabor' if bpy.app.version >= (4, 3) else 'ShaderNodeAmbientOcclusion')
                   .outputs[0], emission.inputs["Strength"])
    found = snapshot(scene)
    assert any("its mean is used in 'Strength'" in w and "'Point'" in w for w in found.warnings)
    assert not the_light(found).program and any(the_light(found).intensity)


def test_an_unknown_shader_is_named(scene, add_light, snapshot):
    tree, _ = nodes_of(add_light('POINT', energy=100))
    shader = tree.nodes.new('ShaderNodeVolumeScatter')
    tree.links.new(shader.outputs[0], tree.get_output_node('CYCLES').inputs["Surface"])
    found = snapshot(scene)
    assert any("the light shines in its own colour" in w for w in found.warnings)
    assert np.allclose(the_light(found).intensity, 100 / (4 * math.pi**2))


def test_ies_files_that_are_none(scene, add_light, snapshot, tmp_path):
    """Each says why, and gives 100 as in Cycles; one file is there once."""
    tree, emission = nodes_of(add_light('POINT', energy=100))
    node = tree.nodes.new('ShaderNodeTexIES')
    tree.links.new(node.outputs[0], emission.inputs["Strength"])
    node.mode, node.filepath = 'EXTERNAL', str(tmp_path / "none.ies")
    for text in (None, "no such thing"):
        if text:
            (tmp_path / "none.ies").write_text(text)
        found = snapshot(scene)
        assert any("IES file" in w and w.endswith(": 100") for w in found.warnings)
        assert np.allclose(the_light(found).intensity, 100 * 100 / (4 * math.pi**2)) and not the_light(found).program
    angles = "0 90 180\n0\n10 20 30\n"
    (tmp_path / "none.ies").write_text(f"IESNA\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 9\n{angles}")
    second = add_light('POINT', energy=10)
    second.data = next(o for o in scene.objects if o.type == 'LIGHT').data
    found = snapshot(scene)
    assert len(found.lights) == 2 and len(found.profiles) == 1 and not found.warnings
    assert found.lights[0].program.asks() >= {"ies", "object_normal"}
    assert np.allclose(found.profiles[0].values, np.repeat([[10, 20, 30]], 2, 0).ravel() * 4 * math.pi / 177.83)


def test_world(scene, add_plane, snapshot):
    add_plane()
    assert snapshot(scene).world_color == (0, 0, 0)  # none
    world = scene.world = bpy.data.worlds.new("Sky")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    background = next(n for n in world.node_tree.nodes if n.type == 'BACKGROUND')
    background.inputs["Color"].default_value = (0.1, 0.2, 0.4, 1)
    background.inputs["Strength"].default_value = 2
    assert snapshot(scene).world_color == pytest.approx((0.2, 0.4, 0.8))
    texture = world.node_tree.nodes.new('ShaderNodeTexSky')
    world.node_tree.links.new(texture.outputs[0], background.inputs["Color"])
    found = snapshot(scene)
    assert found.world_color == pytest.approx((0.2, 0.4, 0.8))
    assert any("'Sky'" in w and "Sky Texture" in w for w in found.warnings)
