"""Mist and Cryptomatte are the same as Cycles writes them, and Blender's compositor can read them."""

import json

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest
from exr import write_floats, write_layers
from light_meshes.film import mattes
from light_meshes_addon import cryptomatte
from test_addon_passes import render_layers


@pytest.fixture
def cut_outs(scene, add_plane, add_light, diffuse, node_material, add):
    """A floor without a material; above it a tilted plate, a pane half there, one that only tints, and a far wall."""
    add_plane(3.5, name="Floor")
    add_plane(1, name="Plate", location=(-1.5, 0.5, 2), rotation_euler=(0.9, 0.2, 0.1)).data.materials.append(
        diffuse((0.6, 0.3, 0.2), "Rot und grün"))
    half = add_plane(1, name="Half", location=(1.2, 0.3, 1))
    half.data.materials.append(node_material("Half", 'ShaderNodeBsdfPrincipled', Alpha=0.3))
    tint = add_plane(0.7, name="Tint", location=(0.8, -0.8, 1.5))
    tint.data.materials.append(node_material("Tint", 'ShaderNodeBsdfTransparent', Color=(0.8, 0.6, 0.4, 1)))
    rack = add(None, "Gestell")
    half.parent = rack
    add_light('SUN', energy=2, angle=0)
    scene.world = bpy.data.worlds.new("World")
    mist = scene.world.mist_settings
    mist.start, mist.depth, mist.falloff = 7, 4, 'QUADRATIC'
    layer = scene.view_layers[0]
    layer.use_pass_mist = layer.use_pass_cryptomatte_object = True
    layer.use_pass_cryptomatte_material = layer.use_pass_cryptomatte_asset = True
    layer.pass_cryptomatte_depth = 6
    scene.light_meshes.shadows, scene.light_meshes.samples = 'SHARP', 64
    scene.render.filter_size = 1.5
    cycles = scene.cycles
    cycles.samples, cycles.use_denoising, cycles.use_adaptive_sampling = 256, False, False
    cycles.pixel_filter_type, cycles.filter_width, cycles.max_bounces = 'BLACKMAN_HARRIS', 1.5, 0
    return scene


def written(scene, folder, engine):
    """The channels of the multilayer EXR that Blender writes, (h, w) each, and its metadata on mattes."""
    scene.render.engine = engine
    write_layers(scene, folder / f"{engine}.exr")
    bpy.ops.render.render(write_still=True)
    file = oiio.ImageInput.open(scene.render.filepath)
    spec = file.spec()
    pixels = np.asarray(file.read_image(oiio.FLOAT)).reshape(spec.height, spec.width, spec.nchannels)
    said = {a.name: a.value for a in spec.extra_attribs if a.name.startswith("cryptomatte/")}
    file.close()
    return {name.split(".", 1)[1]: pixels[:, :, i] for i, name in enumerate(spec.channelnames)}, said


def coverage(channels, kind, number):
    """How much of each pixel is covered by what has this id."""
    total = 0
    for level in range(3):
        for of_id, of_coverage in ("rg", "ba"):
            found = channels[f"{kind}{level:02d}.{of_id}"]
            total = total + np.where(found.view(np.uint32) == number, channels[f"{kind}{level:02d}.{of_coverage}"], 0)
    return total


def test_mattes_and_mist_are_those_of_cycles(cut_outs, tmp_path):
    (ours, said), (theirs, theirs_said) = (written(cut_outs, tmp_path, e) for e in ('LIGHT_MESHES', 'CYCLES'))
    assert set(ours) == set(theirs) and set(said) == set(theirs_said) and len(said) == 12
    for field, value in said.items():
        if not field.endswith("manifest"):
            assert value == theirs_said[field]
            continue
        manifest, full = json.loads(value), json.loads(theirs_said[field])
        assert manifest.items() <= full.items() and manifest, (manifest, full)
        kind = said[field.replace("manifest", "name")].split(".")[1]
        for name, number in manifest.items():
            number = mattes.as_floats(np.array([int(number, 16)], np.uint32)).view(np.uint32)[0]
            mine, cycles = (coverage(channels, kind, number) for channels in (ours, theirs))
            assert cycles.max() > 0.2, name
            assert np.abs(mine - cycles).mean() < 0.004 and np.abs(mine - cycles).max() < 0.15, name
    assert "Gestell" in said[next(f for f in said if "Asset" in str(said[f]) and f.endswith("name")).replace(
        "name", "manifest")]
    difference = np.abs(ours["Mist.Z"] - theirs["Mist.Z"])
    assert difference.mean() < 0.003 and difference.max() < 0.1
    assert np.ptp(theirs["Mist.Z"]) > 0.3


@pytest.mark.parametrize(("name", "number"), [
    ("", 0), ("test", 0xBA6BD213), ("Hello, world!", 0xC0363E43),
    ("The quick brown fox jumps over the lazy dog", 0x2E4FF723),
])
def test_numbers_of_names(name, number):
    """Known values of MurmurHash3_32 with seed 0."""
    assert cryptomatte.number(name) == number


def test_numbers_are_normal_floats():
    odd = np.array([0, 0x7F800001, 0xFF812345, 0x80000001, 0x3F800000], np.uint32)
    floats = mattes.as_floats(odd)
    assert np.isfinite(floats).all() and (np.abs(floats) >= np.finfo(np.float32).tiny).all()
    assert floats[4] == 1 and (floats < 0).tolist() == [False, False, True, True, False]


def test_they_cost_no_bit(cut_outs, tmp_path):
    layer = cut_outs.view_layers[0]
    with_them, _ = written(cut_outs, tmp_path, 'LIGHT_MESHES')
    layer.use_pass_mist = layer.use_pass_cryptomatte_object = False
    layer.use_pass_cryptomatte_material = layer.use_pass_cryptomatte_asset = False
    without, said = written(cut_outs, tmp_path, 'LIGHT_MESHES')
    assert not said and set(without) < set(with_them)
    for name, pixels in without.items():
        np.testing.assert_array_equal(pixels, with_them[name])


@pytest.mark.parametrize("falloff", ['LINEAR', 'QUADRATIC', 'INVERSE_QUADRATIC'])
def test_mist_falls_off_as_in_cycles(scene, add_plane, tmp_path, falloff):
    add_plane(5, rotation_euler=(0.6, 0, 0))
    scene.world = bpy.data.worlds.new("World")
    mist = scene.world.mist_settings
    mist.start, mist.depth, mist.falloff = 8, 5, falloff
    scene.view_layers[0].use_pass_mist = True
    scene.cycles.samples, scene.cycles.use_denoising = 16, False
    (ours, _), (theirs, _) = (written(scene, tmp_path, e) for e in ('LIGHT_MESHES', 'CYCLES'))
    inside = np.s_[14:34, 20:44]
    np.testing.assert_allclose(ours["Mist.Z"][inside], theirs["Mist.Z"][inside], atol=0.01)
    assert np.ptp(ours["Mist.Z"][inside]) > 0.2


def test_blenders_cryptomatte_node_picks_an_object(cut_outs, tmp_path):
    """In the compositor, of a result of ours: white where the plate is."""
    scene = cut_outs
    tree = render_layers(scene).id_data
    node = tree.nodes.new('CompositorNodeCryptomatteV2')
    node.source, node.scene = 'RENDER', scene
    node.layer_name = "ViewLayer.CryptoObject"
    node.matte_id = "Plate"
    if bpy.app.version >= (5, 0):
        tree.interface.new_socket("Image", in_out='OUTPUT', socket_type='NodeSocketColor')
        output = tree.nodes.new('NodeGroupOutput')
    else:
        output = tree.nodes.new('CompositorNodeComposite')
    tree.links.new(node.outputs["Matte"], output.inputs[0])
    scene.render.engine = 'LIGHT_MESHES'
    write_floats(scene, tmp_path / "picked.exr")
    bpy.ops.render.render(write_still=True)
    picked = oiio.ImageBuf(scene.render.filepath).get_pixels(oiio.FLOAT)[..., 0]
    scene.render.use_compositing = False
    channels, _ = written(scene, tmp_path, 'LIGHT_MESHES')
    plate = np.array([cryptomatte.number("Plate")], np.uint32)
    expected = coverage(channels, "CryptoObject", mattes.as_floats(plate).view(np.uint32)[0])
    np.testing.assert_allclose(picked, expected, atol=1e-5)
    assert 0.02 < (picked > 0.9).mean() < 0.3


# What the compositor does not get

def test_a_pass_that_the_compositor_lacks_is_named(scene, add_plane, render, capfd):
    add_plane()
    layer = scene.view_layers[0]
    layer.use_pass_transmission_color = layer.use_pass_z = True
    node = render_layers(scene)
    tree = node.id_data
    switch = tree.nodes.new('CompositorNodeSetAlpha')
    scene.render.engine = 'CYCLES'
    layer.update_render_passes()
    lacks = next(s for s in node.outputs if s.name in ("TransCol", "Transmission Color"))
    tree.links.new(lacks, switch.inputs[0])
    tree.links.new(node.outputs["Depth"], switch.inputs[1])
    scene.render.engine = 'LIGHT_MESHES'
    layer.update_render_passes()
    layer.use_pass_z = False
    render(scene)
    said = capfd.readouterr().out
    assert f"pass '{lacks.name}' of view layer 'ViewLayer', which Light Meshes does not have" in said
    assert "pass 'Depth' of view layer 'ViewLayer', which is not switched on" in said
