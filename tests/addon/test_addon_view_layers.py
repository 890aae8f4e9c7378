"""View layers and scenes: each is rendered with its own settings, and layers of one picture are rendered alike."""

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest
from exr import write_floats


@pytest.fixture
def layers(render, tmp_path):
    """(scene) → layer → pass → (h, w, c), of all layers of one render."""
    def run(scene):
        render(scene)
        file = oiio.ImageInput.open(scene.render.filepath)
        spec = file.spec()
        pixels = np.asarray(file.read_image(oiio.FLOAT)).reshape(spec.height, spec.width, spec.nchannels)
        found = {}
        for i, name in enumerate(spec.channelnames):
            layer, kind, channel = name.split(".")
            found.setdefault(layer, {}).setdefault(kind, {})[channel] = pixels[:, :, i]
        return {layer: {kind: np.stack([c[k] for k in sorted(c, key="RGBXYZAV".index)], -1)
                        for kind, c in kinds.items()} for layer, kinds in found.items()}
    return run


@pytest.fixture
def lit(scene, add_plane, add_light, diffuse):
    """A red plane and, in a collection "Apart", a green one above it, under a sun."""
    red = add_plane(2, name="Red")
    red.data.materials.append(diffuse((0.5, 0, 0), "Red"))
    green = add_plane(1, name="Green", location=(0, 0, 1))
    green.data.materials.append(diffuse((0, 0.5, 0), "Green"))
    apart = bpy.data.collections.new("Apart")
    scene.collection.children.link(apart)
    apart.objects.link(green)
    scene.collection.objects.unlink(green)
    add_light('SUN', energy=np.pi, angle=0)
    return scene


def test_material_override(lit, layers, diffuse):
    other = lit.view_layers.new("Clay")
    other.material_override = diffuse((0.25, 0.25, 0.25), "Clay")
    found = layers(lit)
    assert found["ViewLayer"]["Combined"][24, 32, :3] == pytest.approx((0, 0.5, 0), abs=2e-3)
    assert found["Clay"]["Combined"][24, 32, :3] == pytest.approx((0.25,) * 3, abs=2e-3)
    assert found["Clay"]["Combined"][24, 24, :3] == pytest.approx((0.25,) * 3, abs=2e-3)


def test_material_override_of_faces_without_a_material(scene, add_plane, add_light, diffuse, snapshot):
    add_plane()
    scene.view_layers[0].material_override = diffuse((0.25, 0.5, 0.75), "Clay")
    found = snapshot(scene)
    assert [m.name for m in found.materials] == ["Clay"]


def test_world_override(lit, layers):
    lit.world = bpy.data.worlds.new("Own")
    other = lit.view_layers.new("Other")
    other.world_override = bpy.data.worlds.new("Sky")
    for world, color in ((lit.world, (0, 0, 0, 1)), (other.world_override, (0.1, 0.2, 0.3, 1))):
        if bpy.app.version < (5, 0):
            world.use_nodes = True
        world.node_tree.nodes["Background"].inputs["Color"].default_value = color
    found = layers(lit)
    assert not found["ViewLayer"]["Combined"][0, 0, :3].any()
    assert found["Other"]["Combined"][0, 0, :3] == pytest.approx((0.1, 0.2, 0.3), abs=1e-6)


def test_samples_override(lit, snapshot):
    lit.light_meshes.samples = 3
    assert snapshot(lit).settings.samples == 3
    lit.view_layers[0].samples = 7
    assert snapshot(lit).settings.samples == 7
    lit.view_layers[0].samples = 100_000
    assert snapshot(lit).settings.samples == 4096


def test_layers_have_passes_of_their_own(lit, layers):
    lit.view_layers[0].use_pass_z = True
    other = lit.view_layers.new("Other")
    other.use_pass_normal, other.use_pass_z = True, False
    found = layers(lit)
    assert set(found["ViewLayer"]) == {"Combined", "Depth"} and set(found["Other"]) == {"Combined", "Normal"}


@pytest.mark.parametrize("moves", [False, True])
def test_layers_have_one_step(lit, layers, moves):
    """That of the first: what is put together must have shadows alike, whatever each layer shows."""
    from light_meshes_addon import observers

    near = lit.view_layers.new("Near")
    near.layer_collection.children["Apart"].exclude = True
    lit.view_layers[0].name = "All"
    bpy.data.objects["Green"].location.z = 6
    bpy.data.objects["Green"].scale = (3, 3, 1)
    if moves:
        lit.camera.keyframe_insert("location", frame=1)
    steps = []
    observers.observers.append(lambda e: steps.append(e["statistics"]["h"]) if e["event"] == "statistics" else None)
    try:
        layers(lit)
        lit.view_layers["All"].use = False
        layers(lit)
    finally:
        observers.observers.pop()
    assert len(steps) == 3 and steps[0] == steps[1]
    assert steps[2] > 1.5 * steps[0]  # alone it has its own


def test_a_scene_that_is_not_the_windows(lit, add_light, tmp_path):
    """Its own camera, settings and statistics."""
    from light_meshes_addon import session

    other = bpy.data.scenes.new("Other")
    other.render.engine = 'LIGHT_MESHES'
    other.render.resolution_x, other.render.resolution_y = 32, 16
    other.collection.objects.link(bpy.data.objects["Red"])
    other.collection.objects.link(bpy.data.objects["Sun"])
    other.collection.objects.link(lit.camera)
    other.camera = lit.camera
    write_floats(other, tmp_path / "other.exr")
    bpy.ops.render.render(write_still=True, scene="Other")
    pixels = np.asarray(oiio.ImageInput.open(other.render.filepath).read_image(oiio.FLOAT))
    assert pixels.shape[:2] == (16, 32)
    assert pixels[8, 16, :3] == pytest.approx((0.5, 0, 0), abs=2e-3)
    assert session.statistics["width"] == 32


def test_a_background_set_is_seen(lit, add, add_plane, add_light, snapshot):
    other = bpy.data.scenes.new("Other")
    other.render.engine = 'LIGHT_MESHES'
    other.camera = lit.camera
    other.collection.objects.link(lit.camera)
    other.background_set = lit
    plane = bpy.data.objects.new("Own", bpy.data.objects["Red"].data)
    other.collection.objects.link(plane)
    bpy.context.window.scene = other
    found = snapshot(other)
    assert sorted(o.name for o in found.objects) == ["Green", "Own", "Red"]
    assert [light.name for light in found.lights] == ["Sun"]


def test_stereo_is_an_error(lit, render):
    lit.render.use_multiview = True
    with pytest.raises(RuntimeError, match="no stereo pictures: switch off Stereoscopy"):
        render(lit)
