"""Spectra, camera data, window coordinates, light paths and box projection beside Cycles."""

import numpy as np
import pytest
from node_pictures import agree, both, check, painted
from node_trees import Tree
from test_node_bumps import ball  # noqa: F401

pytestmark = pytest.mark.slow


def test_blackbody(plane, scene, render):
    tree = Tree()
    kelvin = tree.node('ShaderNodeMath', {0: tree.separate(tree.uv())[0], 1: 11500.0, 2: 900.0},
                       operation='MULTIPLY_ADD').outputs[0]
    check(plane, scene, render, tree.node('ShaderNodeBlackbody', {0: kelvin}).outputs[0], tree)


def test_wavelength(plane, scene, render):
    tree = Tree()
    nm = tree.node('ShaderNodeMath', {0: tree.separate(tree.uv())[0], 1: 500.0, 2: 350.0},
                   operation='MULTIPLY_ADD').outputs[0]
    check(plane, scene, render, tree.node('ShaderNodeWavelength', {0: nm}).outputs[0], tree)


@pytest.mark.parametrize("lens", ['ORTHO', 'PERSP'])
@pytest.mark.parametrize(("idname", "output"), [
    ('ShaderNodeCameraData', "View Vector"), ('ShaderNodeCameraData', "View Z Depth"),
    ('ShaderNodeCameraData', "View Distance"), ('ShaderNodeTexCoord', "Camera"), ('ShaderNodeTexCoord', "Window")])
def test_what_the_camera_sees(ball, scene, render, idname, output, lens):  # noqa: F811
    scene.camera.data.type, scene.camera.data.lens, scene.camera.data.shift_x = lens, 150, 0.1
    scene.camera.rotation_euler = (0.02, 0.03, 0.4)
    tree = Tree()
    shown = tree.node('ShaderNodeVectorMath', {0: tree.node(idname).outputs[output], 1: (0.3, 0.3, 0.3)},
                      operation='MULTIPLY').outputs[0]
    check(ball, scene, render, shown, tree)


@pytest.mark.parametrize("blend", [0.0, 0.3, 1.0])
def test_box_projection(ball, scene, render, blend):  # noqa: F811
    tree = Tree()
    place = tree.node('ShaderNodeTexCoord').outputs["Generated"]
    image = tree.node('ShaderNodeTexImage', {0: place}, image=painted(6, 6), projection='BOX', interpolation='Closest',
                      projection_blend=blend)
    check(ball, scene, render, image.outputs["Color"], tree)


def test_what_is_seen_in_a_mirror_and_in_shadow(plane, scene, render, add_plane, add_light):
    """A sheet that only mirrors see, over one half; one that only shadows see, over a quarter."""
    plane.data.materials.clear()
    tree = Tree("Mirror")
    glossy = tree.node('ShaderNodeBsdfGlossy', {"Color": (0.8, 0.8, 0.8, 1), "Roughness": 0.0})
    diffuse = tree.node('ShaderNodeBsdfDiffuse')
    both_ = tree.node('ShaderNodeAddShader', {0: glossy.outputs[0], 1: diffuse.outputs[0]})
    tree.tree.links.new(both_.outputs[0], tree.tree.nodes.new('ShaderNodeOutputMaterial').inputs[0])
    plane.data.materials.append(tree.material)
    for name, x, y, where in (("Is Camera Ray", 0.5, 0, True), ("Is Shadow Ray", -0.5, 0.5, False)):
        sheet = add_plane(half=0.5, name=name, location=(x, y, 1))
        tree = Tree(name)
        seen = tree.node('ShaderNodeLightPath').outputs[name]
        if where:
            seen = tree.node('ShaderNodeMath', {0: 1.0, 1: seen}, operation='SUBTRACT').outputs[0]
        mix = tree.node('ShaderNodeMixShader', {0: seen})
        tree.tree.links.new(tree.node('ShaderNodeBsdfTransparent').outputs[0], mix.inputs[1])
        tree.tree.links.new(tree.node('ShaderNodeEmission', {"Color": (0.3, 0.6, 0.2, 1)}).outputs[0], mix.inputs[2])
        tree.tree.links.new(mix.outputs[0], tree.tree.nodes.new('ShaderNodeOutputMaterial').inputs[0])
        tree.material.cycles.emission_sampling, sheet.visible_diffuse = 'NONE', False  # no indirect light
        sheet.data.materials.append(tree.material)
    lamp = add_light('SUN', energy=2.0, rotation=(0.3, 0, 0))
    lamp.data.angle, lamp.visible_glossy = 0, False  # its highlight is another test's
    scene.cycles.max_bounces, scene.cycles.samples = 4, 16
    scene.cycles.diffuse_bounces = 0
    scene.light_meshes.shadows = 'SHARP'
    ours, theirs = both(scene, render)
    assert len(np.unique(theirs[..., 1].round(2))) > 2
    agree(ours, theirs)


@pytest.mark.parametrize("packed", [False, True])
def test_tiles(plane, scene, render, tmp_path, packed):
    """Three tiles, and places where there is none."""
    import bpy

    for number in (1001, 1002, 1012):
        one = painted(8, 8)
        one.filepath_raw, one.file_format = str(tmp_path / f"tile.{number}.png"), 'PNG'
        values = np.random.default_rng(number).uniform(0, 1, 256).astype(np.float32)
        values[3::4] = 1
        one.pixels.foreach_set(values)
        one.save()
    image = bpy.data.images.load(str(tmp_path / "tile.1001.png"))
    image.source = 'TILED'
    image.filepath = str(tmp_path / "tile.<UDIM>.png")
    for number in (1002, 1012):
        image.tiles.new(number)
    if packed:
        image.pack()
        for file in tmp_path.glob("tile.*"):
            file.unlink()
    tree = Tree()
    place = tree.node('ShaderNodeMapping', {"Vector": tree.uv(), "Scale": (2, 2, 1)}).outputs[0]
    node = tree.node('ShaderNodeTexImage', {0: place}, image=image, interpolation='Closest')
    check(plane, scene, render, node.outputs["Color"], tree)
