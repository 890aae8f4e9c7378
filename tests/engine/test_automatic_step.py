"""The automatic step follows the smallest radius: ragged edges always cause a warning, and no step takes for ever."""

import math
from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, rectangle
from light_meshes.film.images import Framebuffer
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import draw, measure, render_image
from light_meshes.scene.description import Light
from light_meshes.scene.errors import SceneError
from scenes import GREY, WHITE, point, settings, sun, with_lights

LAMP = point((4.1, 1.0, 5.9), radius=0.1, name="lamp")  # where Blender's first scene has it
KINDS = {
    "point": LAMP,
    "spot": replace(LAMP, type="SPOT", name="spot", direction=(-0.57, -0.14, -0.81), spot_angle=1.2),
    "area": Light("area", "AREA", (30.0,) * 3, position=LAMP.position, direction=(-0.57, -0.14, -0.81),
                  area_u=(0.06, 0, -0.04), area_v=(0, 0.08, 0)),
    "sun": sun((-0.57, -0.14, -0.81), angle=0.02),
}


def first_scene(*lights, **values):
    """Blender's cube, camera and lamp, on a floor."""
    parts = [Shape(box((-1, -1, -1), (1, 1, 1)), GREY, "cube"),
             Shape(rectangle((-10, -10), (10, 10), -1.0), WHITE, "floor")]
    camera = Camera.look_at((7.36, -6.93, 4.96), (0.2, -0.2, 0.1), 39.6, 120, 68)
    return Scene.from_shapes(parts, camera, lights or [LAMP],
                             settings(**({"auto_h": True, "kI": 3.0, "weights": "SMOOTH", "samples": 4} | values)))


def own(light, r):
    return replace(light, softness="RADIUS", soft_radius=r)


def sized(light):
    return replace(light, softness="LIGHT_SIZE")


@pytest.mark.parametrize("kI", [0.5, 1.0, 1.3, 3.0])
@pytest.mark.parametrize("softness", ["SCENE", "RADIUS", "LIGHT_SIZE"])
@pytest.mark.parametrize("kind", KINDS)
def test_no_point_of_the_first_scene_is_without_a_node(kind, softness, kI):
    """The paper has a dozen in a picture, at most. Many radii here are less than the step that suits the camera."""
    light = replace(KINDS[kind], softness=softness, soft_radius=0.02)
    found = render_image(first_scene(light, kI=kI))
    s = found.statistics
    assert s["empty_sets"] <= 12 and s["nodes"] > 0
    assert found.warnings == []
    asked = measure(first_scene(light, kI=kI))
    r = {"SCENE": kI * asked["h"], "RADIUS": 0.02}.get(softness) or asked["radii"][0]
    assert s["radii"] == [pytest.approx(r)] and s["h"] <= asked["h"] and r / s["h"] >= 1.5 * (1 - 1e-9)


def test_a_radius_larger_than_the_step_changes_nothing():
    scene = first_scene(own(LAMP, 0.2))
    h = measure(scene)["h"]
    by_hand = render_image(scene.with_settings(auto_h=False, h=h))
    assert render_image(scene).statistics["h"] == h
    np.testing.assert_array_equal(render_image(scene).passes["Combined"], by_hand.passes["Combined"])


def test_the_edge_is_nearer_to_a_lamp_with_a_size_than_a_sharp_one_is():
    scene = first_scene(sized(replace(LAMP, radius=0.2)), samples=9)
    soft, sharp, area = (render_image(scene.with_settings(shadows=shadows, light_samples=256)).passes["Combined"]
                         for shadows in ("LIGHT_MESHES", "SHARP", "AREA_SAMPLING"))
    error = [np.sqrt(((a - area)**2).mean()) for a in (soft, sharp)]
    assert error[0] < 0.75 * error[1]


def test_other_lamps_keep_their_radius_beside_a_small_one():
    other = point((-3, -4, 5), 20, name="other")
    small = own(LAMP, 0.06)
    h = measure(first_scene(small, other))["h"]
    found = render_image(first_scene(small, other))
    s = found.statistics
    assert s["h"] < h and s["r"] == pytest.approx(3 * h) and s["radii"] == pytest.approx([0.06, 3 * h])
    assert s["empty_sets"] == 0 and found.warnings == [] and "'lamp'" in s["plan"]["step"]
    plain = render_image(first_scene(replace(small, softness="SCENE"), other)).statistics
    assert s["candidates"] < 25 * plain["candidates"] and s["nodes"] < 25 * plain["nodes"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("r", [1e-30, 1e-6, 2e-3])
def test_what_cannot_be_seen_is_sharp_and_said(kind, r):
    light = own(KINDS[kind], r)
    found, sharp = render_image(first_scene(light)), render_image(first_scene(replace(light, soft_shadows=False)))
    np.testing.assert_array_equal(found.passes["Combined"], sharp.passes["Combined"])
    (said,) = found.warnings
    assert f"'{light.name}'" in said and "drawn sharp" in said
    both = render_image(first_scene(light, replace(LAMP, name="other")))
    assert both.statistics["h"] == measure(first_scene())["h"] and both.statistics["light_radii"] == {}
    assert both.warnings == found.warnings


def test_nodes_are_bounded_however_small_the_radius():
    """The most that a radius asks for: of a picture as large as films have."""
    scene = first_scene(LAMP)
    scene = replace(scene, camera=replace(scene.camera, width=2048, height=1152))
    h = measure(scene)["h"]
    counts = []
    for r in np.geomspace(0.15, 1.5, 5) * h:
        ready = Prepared(with_lights(scene, own(LAMP, r)))
        s = ready.scene.settings
        counts.append(0 if ready.plan.shadows == "SHARP" else 70_000 * h * h * r / s.h**3)
        assert s.h > h / 8
    assert max(counts) < 3.1e6 and min(counts) == 0


def test_a_radius_of_very_many_steps_makes_the_step_coarser_where_it_may():
    scene = first_scene(own(LAMP, 2.0))
    found = render_image(scene.with_settings(samples=1))
    assert found.warnings == [] and found.statistics["radii"] == [pytest.approx(2.0)]
    assert found.statistics["h"] == pytest.approx(2.0 / 16)
    mixed = render_image(first_scene(own(LAMP, 2.0), point((-3, -4, 5), 20, name="other")).with_settings(samples=1))
    assert "'lamp'" in mixed.warnings[0] and mixed.statistics["radii"][0] == pytest.approx(mixed.statistics["r"])


def test_it_depends_on_nothing_but_the_scene_and_its_camera():
    scene = first_scene(sized(LAMP), point((-3, -4, 5), 20, name="other"))
    whole = render_image(scene)
    for threads, tile in ((1, 13), (2, 64)):
        np.testing.assert_array_equal(render_image(scene, threads=threads, tile_size=tile).passes["Combined"],
                                      whole.passes["Combined"])
    camera = replace(scene.camera, width=240, height=136)
    assert render_image(replace(scene, camera=camera)).statistics["h"] == whole.statistics["h"]
    crop = render_image(replace(scene, camera=replace(scene.camera, crop=(10, 20, 50, 40))))
    np.testing.assert_array_equal(crop.passes["Combined"], whole.passes["Combined"][20:40, 10:50])
    # What an animation measures once, and gives to each of its frames.
    found = measure(scene)
    given = with_lights(scene, own(LAMP, found["radii"][0]), scene.lights[1]).with_settings(measured_h=found["h"])
    np.testing.assert_array_equal(render_image(given).passes["Combined"], whole.passes["Combined"])
    # And what the window keeps between pictures, whose lamps have changed.
    first = Prepared(first_scene(LAMP, scene.lights[1]))
    again = draw(Prepared(scene, previous=first), Framebuffer.create(scene, ("Combined",)))
    np.testing.assert_array_equal(again.passes["Combined"], whole.passes["Combined"])


def test_ragged_edges_by_hand_are_said():
    lights = [own(replace(LAMP, name=f"L{i}"), r) for i, r in enumerate((0.05, 0.04, 0.2, 0.05, 0.05))]
    (said,) = render_image(first_scene(*lights, auto_h=False, h=0.04, samples=1)).warnings
    assert said.startswith("lights 'L0', 'L1', 'L3' and 1 more: the radius of soft shadows is 0.04, 1 steps")
    assert "a step h of 0.027 or less" in said
    (said,) = render_image(first_scene(auto_h=False, h=0.04, kI=0.5, samples=1)).warnings
    assert "'lamp'" in said and "0.5 steps" in said
    assert render_image(first_scene(auto_h=False, h=0.04, kI=1.5, samples=1)).warnings == []
    (said,) = render_image(first_scene(auto_h=False, h=1e-6, samples=1)).warnings
    assert "'lamp'" in said and "too small to be seen" in said


@pytest.mark.parametrize("name", ["h", "kI"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_numbers_that_make_no_lattice_are_refused(name, value):
    with pytest.raises(SceneError, match=f"settings: {name} is .*; it must be a finite number above 0"):
        render_image(first_scene(auto_h=False, **{name: value}))
