"""What is measured for an animation is measured at its first frame, for all frames alike."""

import math

import bpy
import pytest

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
    assert not found.settings.auto_h and found.settings.h == pytest.approx(7.2 / 200, rel=0.05)
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
