"""Lamps with a size in the house: kept nodes, sparse light, memory, passes, statistics, the plan."""

from dataclasses import replace

import numpy as np
import pytest
from kept import after, drawn, moved, with_camera, with_light, with_material, with_object
from light_meshes import Light, Scene
from light_meshes.picture import memory
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from scenes import four_lights, with_lights


@pytest.fixture(scope="module")
def still_life() -> Scene:
    """Floor, ball and box under one lamp with a size of each type."""
    scene = four_lights(48)
    sizes = {"SUN": {"angle": 0.15}, "AREA": {}}
    return with_lights(scene, *(replace(light, softness="SIZE", **sizes.get(light.type, {"radius": 0.25}))
                                for light in scene.lights))


def test_the_same_picture_again_traces_no_node(still_life):
    kept, fresh, before, now = after(still_life, still_life)
    assert kept["long_rays"] == 0 < fresh["long_rays"] and kept["nodes_kept"] == kept["nodes"] == fresh["nodes"]
    levels = zip(before.shadowing.method.levels, now.shadowing.method.levels, strict=True)
    assert all(a.certificate is b.certificate is not None for a, b in levels)


def test_a_flight_is_made_of_the_same_pictures(still_life):
    ready = None
    for n in range(4):
        scene = with_camera(still_life, (2.5 + 0.1 * n, -4.5, 3.0 - 0.1 * n))
        kept, ready = drawn(scene, ready)
        fresh = render_image(scene)
        assert np.array_equal(kept.passes["Combined"], fresh.passes["Combined"])
        assert n == 0 or kept.statistics["long_rays"] < 0.5 * fresh.statistics["long_rays"]


@pytest.mark.parametrize("i", range(4))
def test_a_moved_lamp_drops_its_own_values_only(still_life, i):
    light = still_life.lights[i]
    change = {"direction": (0.0, 0.6, -0.8)} if light.type == "SUN" else {
        "position": tuple(np.add(light.position, (0.3, -0.2, 0.1)).tolist())}
    kept, fresh, *_ = after(still_life, with_light(still_life, i, **change))
    assert 0 < kept["long_rays"] < 0.6 * fresh["long_rays"]


@pytest.mark.parametrize("i", range(4))
def test_so_does_one_of_another_size(still_life, i):
    light = still_life.lights[i]
    change = {"SUN": {"angle": 0.1}, "AREA": {"area_u": tuple(np.multiply(light.area_u, 0.5).tolist())}}
    kept, fresh, *_ = after(still_life, with_light(still_life, i, **change.get(light.type, {"radius": 0.2})))
    assert 0 < kept["long_rays"] < 0.6 * fresh["long_rays"]


def test_lamps_may_come_go_and_change_places(still_life):
    a, b, c, d = still_life.lights
    for lights in ((d, b, a, c), (c, a)):
        kept, *_ = after(still_life, with_lights(still_life, *lights))
        assert kept["long_rays"] == 0
    kept, fresh, *_ = after(with_lights(still_life, c, a), still_life)
    assert 0 < kept["long_rays"] < fresh["long_rays"]


@pytest.mark.parametrize("instance", range(3))
def test_a_caster_that_moves_drops_what_it_may_have_hidden_of_a_whole_lamp(still_life, instance):
    """Not only of its centre."""
    for by in ((0.05, 0.0, 0.0), (0.0, 0.0, 0.4)):
        kept, fresh, *_ = after(still_life, moved(still_life, instance, by))
        assert 0 < kept["long_rays"] <= fresh["long_rays"]


def test_a_small_caster_that_leaves_keeps_what_is_far_from_it(still_life):
    kept, fresh, *_ = after(still_life, with_object(still_life, 2, visible_shadow=False))
    assert kept["long_rays"] < fresh["long_rays"] and kept["nodes_kept"] > 0


def test_colours_and_kinds_of_lamps(still_life):
    kept, *_ = after(still_life, with_light(with_material(still_life, 0, kd=0.3), 0, intensity=(1.0, 5.0, 9.0)))
    assert kept["long_rays"] == 0
    after(still_life, with_light(still_life, 0, softness="SCENE"))
    after(with_light(still_life, 0, softness="SCENE"), still_life)
    after(still_life, with_light(still_life, 1, soft_shadows=False))


def test_statistics_when_all_lamps_have_a_size(still_life):
    found = render_image(still_life).statistics
    assert found["h"] == still_life.settings.h and found["kI"] == still_life.settings.kI
    assert found["nodes"] > 0 < found["node_bytes"] and found["long_rays"] > 0
    automatic = render_image(still_life.with_settings(auto_h=True)).statistics
    assert automatic["h"] == automatic["measured_h"] > 0
