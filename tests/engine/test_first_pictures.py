"""The first pictures of a 3D view: direct light, quickly, before those with all light, whose bits are as ever."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes.picture import first
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Light
from scenes import four_lights
from test_service_views import view


def all_light(scene):
    return replace(scene, world_color=(0.2, 0.3, 0.4), settings=replace(
        scene.settings, world_light="SKY", bounces=1))


def bulbs(count):
    """Points of light in a box, no two alike."""
    random = np.random.default_rng(1)
    return tuple(Light(f"Bulb {i}", "POINT", tuple(random.uniform(1, 2, 3)), tuple(random.uniform(-5, 5, 3)))
                 for i in range(count))


def test_direct_light_comes_first_and_changes_no_bit_of_what_follows(child):
    scene = all_light(four_lights(48))
    child.put(scene)
    events, pictures = view(child, 1, steps=[[8, 1], [4, 1], [2, 1], [1, 1], [1, 2]], direct=True)
    assert [e["step"] for e in events[:-1]] == list(range(len(pictures)))
    divisors = [round(48 / e["width"]) for e in events[:-1]]
    assert divisors[0] in (first.COARSE, first.COARSEST) and divisors[-3:] == [2, 1, 1]
    assert np.isfinite(pictures[0]).all() and pictures[0][..., :3].max() > 0
    best = replace(scene, settings=replace(scene.settings, samples=2))
    np.testing.assert_array_equal(pictures[-1], render_image(best).passes["Combined"])
    # and the next view, which takes over what was kept
    _, again = view(child, 2, steps=[[8, 1], [1, 2]], direct=True)
    np.testing.assert_array_equal(again[-1], pictures[-1])


def test_no_direct_light_alone_where_all_light_is_as_quick(child):
    scene = four_lights(48)
    scene = replace(scene, lights=tuple(replace(light, softness="SCENE") for light in scene.lights))
    child.put(scene)
    events, _ = view(child, 1, steps=[[8, 1], [4, 1]], direct=True)
    assert [e["width"] for e in events[:-1]] == [6, 12]


def test_it_is_near_the_whole_picture():
    """Without sky and bounces, and with points of light, there is no difference but soft edges."""
    scene = four_lights(64)
    quick = first.direct(scene, scene.camera, 1, first.LATER_PAIRS)
    a, b = (render_image(s).passes["Combined"] for s in (quick, scene))
    assert np.median(np.abs(a - b)) < 0.01 * b.mean()


@pytest.mark.parametrize("most", [16, 50, 200])
def test_neighbouring_lamps_count_together(most):
    lights = bulbs(300)
    found = first.fewer(lights, most)
    assert most / 2 < len(found) <= most
    np.testing.assert_allclose(sum(np.array(light.intensity) for light in found),
                               sum(np.array(light.intensity) for light in lights))
    middle = np.average([light.position for light in lights], axis=0, weights=[sum(x.intensity) for x in lights])
    np.testing.assert_allclose(np.average([light.position for light in found], axis=0,
                                          weights=[sum(x.intensity) for x in found]), middle)


def test_lamps_that_are_unlike_stay():
    sun = Light("Sun", "SUN", (1.0, 1.0, 1.0))
    linked = replace(bulbs(1)[0], name="Linked", receivers=(0,))
    found = first.fewer((sun, linked, *bulbs(300)), 40)
    assert found[:2] == (sun, linked) and 2 + 16 <= len(found) <= 40
    assert first.fewer(bulbs(30), 30) == bulbs(30)
