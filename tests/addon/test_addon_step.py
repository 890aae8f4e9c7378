"""The measurements for an animation are made at one frame and used for all frames, however the job is divided."""

import math

import bpy
import numpy as np
import pytest
from light_meshes.picture.render import measure, render_image

TANGENT = 0.1  # of the sun's half-angle


@pytest.fixture
def rising(scene, add_plane, add_light):
    """A blocker 1 above a floor at frame 1, 3 above it at frame 5; the light's size sets its shadow's edges."""
    add_plane(20)
    blocker = add_plane(2, "Blocker", visible_camera=False)
    for frame, z in ((1, 1.0), (5, 3.0)):
        blocker.location.z = z
        blocker.keyframe_insert("location", frame=frame)
    sun = add_light('SUN', angle=2 * math.atan(TANGENT)).data
    sun.light_meshes.softness = 'LIGHT_SIZE'
    own = scene.light_meshes
    own.auto_h, own.h = False, 0.05
    scene.frame_set(5)
    return scene


def test_radii_are_those_of_the_first_frame(rising, snapshot):
    found = snapshot(rising)
    (light,) = found.lights
    assert light.softness == "RADIUS" and light.soft_radius == pytest.approx(1.32 * TANGENT * 1.0, rel=0.02)
    assert found.settings.h == pytest.approx(0.05) and not found.settings.auto_h
    assert rising.frame_current == 5


def test_with_the_automatic_step(rising, snapshot):
    rising.light_meshes.auto_h = True
    found = snapshot(rising)
    assert found.settings.auto_h and found.settings.measured_h == pytest.approx(7.2 / 200, rel=0.05)
    assert found.lights[0].softness == "RADIUS"


def test_the_first_frame_measures_itself(rising, snapshot):
    rising.frame_set(1)
    (light,) = snapshot(rising).lights
    assert light.softness == "LIGHT_SIZE" and light.reference_distance == 0


def test_what_does_not_move_measures_itself(rising, snapshot):
    rising.objects["Blocker"].animation_data_clear()
    assert snapshot(rising).lights[0].softness == "LIGHT_SIZE"


def test_where_no_light_needs_it_nothing_is_measured(rising, snapshot):
    rising.objects["Sun"].data.light_meshes.softness = 'SCENE'
    assert snapshot(rising).lights[0].softness == "SCENE"


def test_all_frames_of_an_animation_agree(rising, tmp_path):
    from light_meshes_addon.observers import observers

    seen = []

    def observer(event):
        if event["event"] == "statistics":
            seen.append(event["statistics"]["light_radii"])

    observers.append(observer)
    try:
        rising.frame_start, rising.frame_end, rising.frame_step = 1, 5, 2
        rising.render.filepath = str(tmp_path / "f_")
        bpy.ops.render.render(animation=True)
        rising.frame_set(3)
        bpy.ops.render.render()
        rising.frame_set(1)
        bpy.ops.render.render()  # measures itself
    finally:
        observers.pop()
    assert len(seen) == 5 and all(radii == seen[0] for radii in seen)
    assert seen[0] == {"Sun": pytest.approx(1.32 * TANGENT, rel=0.02)}


def by_driver(scene, folder):
    curve = scene.camera.driver_add("location", 2)
    curve.driver.expression = "10 + 2 * (frame - 1)"


def by_handler(scene, folder):
    bpy.app.handlers.frame_change_pre.append(
        lambda scene, *_: setattr(scene.camera, "location", (0, 0, 10 + 2 * (scene.frame_current - 1))))


def keyed(ob):
    for frame, z in ((1, 10.0), (20, 48.0)):
        ob.location.z = z
        ob.keyframe_insert("location", frame=frame)


def by_a_target(scene, folder):
    target = bpy.data.objects.new("Target", None)
    scene.collection.objects.link(target)
    keyed(target)
    scene.camera.constraints.new('COPY_LOCATION').target = target


def by_alembic(scene, folder):
    """Camera and blocker come from a cache, and have no animation in Blender."""
    blocker = scene.objects["Blocker"]
    keyed(scene.camera)
    scene.frame_end = 20
    bpy.ops.wm.alembic_export(filepath=str(folder / "cache.abc"), start=1, end=20)
    for ob in (scene.camera, blocker):
        bpy.data.objects.remove(ob)
    bpy.ops.wm.alembic_import(filepath=str(folder / "cache.abc"))
    scene.camera = next(ob for ob in scene.objects if ob.type == 'CAMERA')
    assert not scene.camera.animation_data
    scene.frame_end = 250


def by_markers(scene, folder):
    far = scene.camera.copy()
    far.location.z = 48
    scene.collection.objects.link(far)
    scene.timeline_markers.new("near", frame=1).camera = scene.camera
    scene.timeline_markers.new("far", frame=15).camera = far


MOVES = [by_driver, by_handler, by_a_target, by_alembic, by_markers]


@pytest.mark.parametrize("move", MOVES)
def test_the_step_does_not_depend_on_the_range(scene, add_plane, add_light, snapshot, tmp_path, move):
    add_plane(50, "Floor")
    add_plane(1, "Blocker", location=(0, 0, 1))
    add_light()
    scene.frame_set(1)
    try:
        move(scene, tmp_path)
        found = {}
        for job in ((1, 250, 1, 1), (1, 250, 1, 20), (20, 20, 1, 20), (5, 40, 5, 20), (1, 9, 1, 5)):
            first, last, step, frame = job
            scene.frame_start, scene.frame_end, scene.frame_step = first, last, step
            scene.frame_set(frame)
            found[job] = snapshot(scene)
            assert scene.frame_current == frame
    finally:
        bpy.app.handlers.frame_change_pre.clear()
    at_first = found.pop((1, 250, 1, 1))
    h = measure(at_first)["h"]
    assert [(s.settings.auto_h, s.settings.measured_h) for s in found.values()] == [(True, h)] * 4
    cameras = [tuple(s.camera.matrix[:3, 3]) for s in found.values()]
    assert cameras[0] == cameras[1] == cameras[2] != tuple(at_first.camera.matrix[:3, 3])
    assert 4 < cameras[0][2] / at_first.camera.matrix[2, 3] < 5


@pytest.mark.parametrize("of", ["collections", "vertices", "objects"])
def test_radii_belong_to_instances(scene, add, add_plane, add_light, snapshot, of):
    """As in a still: what moves has no effect on the lamps' shadows. One lamp is lower than all that casts."""
    add_plane(12, "Floor")
    scene.camera.location.z = 20
    places = ((-6, 0, 3), (6, 0, 9), (0, 5, 0.5))
    lamp = add_light(energy=400, shadow_soft_size=0.5, location=(0, 0, 0))
    lamp.data.light_meshes.softness = 'LIGHT_SIZE'
    if of == "vertices":
        mesh = bpy.data.meshes.new("Vertices")
        mesh.from_pydata(places, [], [])
        lamp.parent = add(mesh, instance_type='VERTS')
    else:
        lamps = bpy.data.collections.new("Lamps")
        lamps.objects.link(lamp)
        scene.collection.objects.unlink(lamp)
        for place in places:
            if of == "collections":
                add(None, "Instance", instance_type='COLLECTION', instance_collection=lamps, location=place)
            else:
                add(lamp.data, location=place)
    for x in (-6, 6):
        add_plane(0.6, "Blocker", location=(x, 0, 1))
    own = scene.light_meshes
    own.auto_h, own.h = False, 0.06
    still = snapshot(scene)
    expected = measure(still)["radii"]
    assert len(expected) == 3 and expected.count(None) == 1 and len(set(expected)) == 3
    mover = add_plane(0.1, "Mover", location=(0, -11, 0))
    mover.driver_add("location", 0).driver.expression = "frame / 1000"
    scene.frame_set(7)
    found = snapshot(scene)
    assert [light.soft_radius if light.softness == "RADIUS" else None for light in found.lights] == expected
    mover.hide_render = True
    hidden = snapshot(scene)
    np.testing.assert_array_equal(render_image(hidden).passes["Combined"], render_image(still).passes["Combined"])
