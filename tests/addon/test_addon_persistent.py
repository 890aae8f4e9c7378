"""Persistent Data: data that an animation keeps from frame to frame does not change a bit of the pictures."""

import math

import bpy
import numpy as np
import pytest
from blender_scene import read
from light_meshes_addon import observers, session


@pytest.fixture
def room(scene, add_plane, add_light, add_mesh):
    """A floor, a few blocks above it, two lights; exact EXR pictures of 48×36 pixels."""
    scene.render.resolution_x, scene.render.resolution_y = 48, 36
    add_plane(6)
    corners = [(x, y, z) for z in (0, 0.6) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
    faces = [(3, 2, 1, 0), (4, 5, 6, 7), *((i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i) for i in range(4))]
    blocks = [add_mesh(f"Block {i}", corners, faces, location=(2 * i - 3, i % 2, 0.5 * i)) for i in range(4)]
    lights = [add_light('POINT', (2, 1, 5), energy=500), add_light('SUN', rotation=(0.4, 0.2, 0), energy=2)]
    image = scene.render.image_settings
    image.file_format, image.color_depth = 'OPEN_EXR', '32'
    scene.light_meshes.auto_h, scene.light_meshes.h = False, 0.1
    return scene, blocks, lights


def fly(scene, frames):
    scene.frame_start, scene.frame_end = 1, frames
    for frame in range(1, frames + 1):
        angle = 0.3 * (frame - 1) / frames
        scene.camera.location = (3 * math.sin(angle), 0, 10 * math.cos(angle))
        scene.camera.rotation_euler = (0, angle, 0)
        for path in ("location", "rotation_euler"):
            scene.camera.keyframe_insert(path, frame=frame)


@pytest.fixture
def animation(tmp_path):
    """(scene, persistent) → its frames' pictures, and the statistics of each."""
    count = 0

    def run(scene, persistent):
        nonlocal count
        count += 1
        scene.render.use_persistent_data = persistent
        scene.render.filepath = str(tmp_path / f"{count}_")
        found = []
        observers.observers.append(lambda e: found.append(e["statistics"]) if e["event"] == "statistics" else None)
        try:
            bpy.ops.render.render(animation=True)
        finally:
            observers.observers.pop()
            scene.render.use_persistent_data = False
        return [read(p) for p in sorted(tmp_path.glob(f"{count}_*.exr"))], found
    return run


@pytest.fixture
def single(tmp_path):
    """(scene) → pictures of its frames, each rendered by itself with nothing kept."""
    def run(scene):
        pictures = []
        for frame in range(scene.frame_start, scene.frame_end + 1):
            scene.frame_set(frame)
            scene.render.filepath = str(tmp_path / f"single_{frame}.exr")
            bpy.ops.render.render(write_still=True)
            pictures.append(read(scene.render.filepath))
        return pictures
    return run


def bumpy(image):
    """A material with an image that is packed into the file, and with bumps."""
    material = bpy.data.materials.new("Bumpy")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = next(n for n in nodes if n.type == 'BSDF_PRINCIPLED')
    picture, noise, bump = (nodes.new(f"ShaderNode{name}") for name in ("TexImage", "TexNoise", "Bump"))
    picture.image = image
    links.new(picture.outputs["Color"], shader.inputs["Base Color"])
    links.new(noise.outputs[0], bump.inputs["Height"])
    links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    return material


def test_a_flight_keeps_the_light_on_packed_images_and_bumps(room, animation):
    """Their files are written anew for each frame, and bumps depend on the camera; the light that is gathered does not.
    """
    scene, blocks, _ = room
    image = bpy.data.images.new("Colours", 8, 8)
    image.pixels.foreach_set(np.random.default_rng(1).random(256).astype(np.float32))
    image.pack()
    material = bumpy(image)
    for block in blocks:
        block.data.materials.append(material)
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'SKY', 1
    fly(scene, 3)
    pictures, statistics = animation(scene, True)
    others, alone = animation(scene, False)
    for picture, other in zip(pictures, others, strict=True):
        np.testing.assert_array_equal(picture, other)
    first, *later = (s["records"] for s in statistics)
    assert max(later) < 0.5 * first
    assert min(s["records"] for s in alone) > 0.9 * first


def test_camera_flight(room, animation, single):
    """20 frames: the nodes of one serve the next, in pictures that are the same bit for bit."""
    scene = room[0]
    fly(scene, 20)
    pictures, statistics = animation(scene, True)
    others, alone = animation(scene, False)
    expected = single(scene)
    assert len(pictures) == len(others) == len(expected) == 20
    for i in range(20):
        np.testing.assert_array_equal(pictures[i], expected[i])
        np.testing.assert_array_equal(others[i], expected[i])
    assert np.std([p.mean() for p in pictures]) > 0  # the camera did fly
    assert all(s["nodes_kept"] > 0 for s in statistics[1:]) and not any(s["nodes_kept"] for s in alone)
    traced, all_traced = (sum(s["long_rays"] for s in found) for found in (statistics, alone))
    print(f"long rays: {traced:,} of {all_traced:,}; seconds {sum(s['seconds'] for s in statistics):.2f} "
          f"of {sum(s['seconds'] for s in alone):.2f}")
    assert traced <= 0.5 * all_traced


@pytest.mark.parametrize("what", ["block", "light", "material", "mesh", "auto_h"])
def test_what_moves_is_seen(room, animation, single, what):
    scene, blocks, lights = room
    fly(scene, 4)
    if what == "block":
        blocks[1].location = (0, 0, 0)
        blocks[1].keyframe_insert("location", frame=1)
        blocks[1].location = (1, 1, 1)
        blocks[1].keyframe_insert("location", frame=4)
    elif what == "light":
        lights[0].location = (2, 1, 5)
        lights[0].keyframe_insert("location", frame=1)
        lights[0].location = (-2, 1, 5)
        lights[0].keyframe_insert("location", frame=4)
    elif what == "material":
        material = bpy.data.materials.new("Fading")
        material.light_meshes.override_Od = True
        for frame, value in ((1, 0.1), (4, 0.9)):
            material.light_meshes.Od = (value,) * 3
            material.light_meshes.keyframe_insert("Od", frame=frame)
        blocks[0].data.materials.append(material)
    elif what == "mesh":
        key = blocks[2]
        key.shape_key_add(name="Basis")
        up = key.shape_key_add(name="Up")
        up.data[4].co.z = 2
        for frame, value in ((1, 0.0), (4, 1.0)):
            up.value = value
            up.keyframe_insert("value", frame=frame)
    else:
        scene.light_meshes.auto_h = True
    pictures, _ = animation(scene, True)
    expected = single(scene)
    for a, b in zip(pictures, expected, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(pictures[0], pictures[3])


def test_another_file_frees_what_was_kept(room, animation):
    scene = room[0]
    fly(scene, 1)
    animation(scene, True)
    assert session._sessions["render"].keeps
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert "render" not in session._sessions
