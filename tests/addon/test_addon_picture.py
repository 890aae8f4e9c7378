"""Pixels arrive in Blender: passes, alpha, frames, statistics."""

import shutil

import bpy
import numpy as np
import pytest


def test_passes(scene, add_plane, add_light, render):
    layer = scene.view_layers[0]
    for name in ("use_pass_z", "use_pass_normal", "use_pass_shadow"):
        setattr(layer, name, True)
    add_plane(2, rotation_euler=(0.3, 0, 0))
    add_light('SUN', energy=3, angle=0)
    found = render(scene)
    assert set(found) == {"Combined", "Depth", "Normal", "Shadow"}
    y, x = 24, 32
    assert found["Depth"][y, x, 0] == pytest.approx(10, abs=0.3)
    assert found["Depth"][0, 0, 0] > 1e9
    assert found["Normal"][y, x] == pytest.approx((0, -np.sin(0.3), np.cos(0.3)), abs=0.01)
    assert found["Shadow"][y, x] == pytest.approx((1, 1, 1), abs=0.01)


def test_only_the_passes_that_are_asked_for(scene, add_plane, render):
    add_plane()
    assert set(render(scene)) == {"Combined"}


def test_film_transparent(scene, add_plane, add_light, render):
    add_plane(1)
    add_light('SUN', energy=3)
    assert render(scene)["Combined"][0, 0].tolist() == [0, 0, 0, 1]
    scene.render.film_transparent = True
    picture = render(scene)["Combined"]
    assert picture[0, 0].tolist() == [0, 0, 0, 0] and picture[24, 32, 3] == pytest.approx(1)


def test_filter_size_softens_edges(scene, add_plane, add_light, render):
    add_plane(1)
    add_light('SUN', energy=3)
    scene.light_meshes.samples = 64
    partial = []
    for size in (0.01, 5.0):
        scene.render.filter_size = size
        row = render(scene)["Combined"][24, :, 0]
        partial.append(((row > 0.02 * row.max()) & (row < 0.98 * row.max())).sum())
    assert partial[1] >= partial[0] + 4


def test_view_layers(scene, add_plane, add_light, render):
    """Each layer is rendered with what it shows."""
    add_light('SUN', energy=3)
    plane = add_plane(1)
    collection = bpy.data.collections.new("Hidden")
    scene.collection.children.link(collection)
    collection.objects.link(plane)
    scene.collection.objects.unlink(plane)
    other = scene.view_layers.new("Other")
    other.layer_collection.children["Hidden"].exclude = True
    image = scene.render.image_settings
    render(scene)  # sets the format
    import OpenImageIO as oiio

    spec = oiio.ImageInput.open(scene.render.filepath).spec()
    assert {n.split(".")[0] for n in spec.channelnames} >= {"ViewLayer", "Other"} and image
    pixels = np.asarray(oiio.ImageInput.open(scene.render.filepath).read_image(oiio.FLOAT))
    level = {n: pixels[24, 32, i] for i, n in enumerate(spec.channelnames)}
    assert level["ViewLayer.Combined.R"] > 0.1 and level["Other.Combined.R"] == 0


def test_statistics_are_kept(scene, add_plane, add_light, render, capfd):
    from light_meshes_addon import session

    add_plane()
    add_light()
    render(scene)
    assert session.statistics["triangles"] == 2 and session.statistics["width"] == 64
    lines = [line for line in capfd.readouterr().out.splitlines() if line.startswith("Light Meshes:")]
    assert len(lines) == 1 and "64×48" in lines[0] and len(lines[0]) < 200


def test_nothing_is_left_behind(scene, add_plane, render):
    """The engine stays, its folder is empty: disk use does not grow."""
    from light_meshes_addon import session

    add_plane()
    render(scene)
    process = session.current()
    for _ in range(3):
        render(scene)
    assert session.current() is process and process.usable
    assert list(process.folder.iterdir()) == []
    assert process.folder.stat().st_mode & 0o777 == 0o700


def test_warnings_are_reported_once_each(scene, add_plane, node_material, render, capfd):
    for i in range(3):
        add_plane(name=f"P{i}").data.materials.append(node_material("Glass", 'ShaderNodeBsdfToon'))
        bpy.data.materials[-1].name = "Glass"
    bpy.data.objects["P1"].data.materials[0] = bpy.data.objects["P0"].data.materials[0]
    render(scene)
    (said,) = [line for line in capfd.readouterr().out.splitlines() if "Toon" in line]
    assert said.startswith("Warning: In 2 materials: ") and said.endswith(": 'Glass' and 'Glass.002'")


# The automatic step

@pytest.fixture
def zooming(scene, add_plane):
    """A camera that moves away: every frame would measure a step of its own."""
    add_plane(100)
    scene.frame_start, scene.frame_end = 3, 5
    for frame, z in ((3, 5), (5, 50)):
        scene.camera.location.z = z
        scene.camera.keyframe_insert("location", frame=frame)
    return scene


def step_of_the_render():
    from light_meshes_addon import session

    return session.statistics["h"]


def test_automatic_step_is_that_of_the_first_frame(zooming, render, add_light):
    add_light('SUN', energy=3)
    depths = []
    steps = []
    zooming.view_layers[0].use_pass_z = True
    for frame in (3, 5, 4):
        zooming.frame_set(frame)
        depths.append(render(zooming)["Depth"][24, 32, 0])
        steps.append(step_of_the_render())
        assert zooming.frame_current == frame
    assert steps[0] == steps[1] == steps[2]
    assert depths == pytest.approx([5, 50, 27.5], rel=1e-3)  # the pictures are of their own frames
    zooming.frame_start = 5
    zooming.frame_set(5)
    render(zooming)
    assert step_of_the_render() == steps[0]  # whichever part of the animation is rendered
    zooming.light_meshes.measure_frame = 5
    render(zooming)
    assert step_of_the_render() > 3 * steps[0]


def test_automatic_step_is_measured_once_an_animation(zooming, add_light, tmp_path):
    from light_meshes_addon import observers

    add_light('SUN', energy=3)
    steps = []
    observers.observers.append(lambda e: steps.append(e["statistics"]["h"]) if e["event"] == "statistics" else None)
    zooming.render.image_settings.file_format = 'PNG'
    zooming.render.filepath = str(tmp_path / "frame_")
    try:
        bpy.ops.render.render(animation=True)
    finally:
        observers.observers.pop()
    assert len(steps) == 3 and len(set(steps)) == 1
    assert len(list(tmp_path.glob("frame_*.png"))) == 3


def test_a_still_scene_is_not_exported_twice(scene, add_plane):
    from light_meshes_addon import step

    add_plane()
    bpy.context.view_layer.update()
    assert not step.may_move(bpy.context.evaluated_depsgraph_get())
    scene.camera.keyframe_insert("location", frame=1)
    assert step.may_move(bpy.context.evaluated_depsgraph_get())


def test_drivers_with_python_do_not_hang(scene, add_plane, add_light, render):
    """Frames are changed inside the render, where drivers need the interpreter's lock."""
    plane = add_plane(5)
    add_light('SUN', energy=3)
    driver = plane.driver_add("location", 2).driver
    driver.expression = "max([frame, 0]) / 10"
    scene.frame_set(20)
    scene.view_layers[0].use_pass_z = True
    assert render(scene)["Depth"][24, 32, 0] == pytest.approx(8, abs=0.01)


def test_a_shared_folder_that_was_cleaned_away_is_made_anew(scene, add_plane, render):
    from light_meshes_addon import session

    add_plane()
    first = render(scene)["Combined"]
    shutil.rmtree(session._sessions["render"].folder)
    np.testing.assert_array_equal(render(scene)["Combined"], first)
