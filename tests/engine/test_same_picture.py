"""Things that must not change a picture: tiles, threads, runs, shortcuts, the order of lights."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import translate
from light_meshes.picture.render import render_image
from light_meshes.scene.description import SHADOWS
from scenes import four_lights, hall, tabletop, with_lights

PASSES = ("Combined", "Depth", "Normal", "Shadow")


def same_bits(a, b):
    for name in a.passes:
        np.testing.assert_array_equal(a.passes[name], b.passes[name], err_msg=name)


@pytest.fixture(scope="module", params=SHADOWS)
def still_life(request):
    scene = four_lights(80, shadows=request.param, mode="WHITTED", samples=3, filter_size=1.5, light_samples=16)
    ball = replace(scene.materials[1], mirror=(0.3, 0.3, 0.4))
    scene = replace(scene, materials=(scene.materials[0], ball, *scene.materials[2:]))
    return scene, render_image(scene, PASSES, threads=1, tile_size=32)


@pytest.mark.parametrize(("threads", "tile"), [(1, 32), (2, 32), (1, 256), (2, 256), (2, 7)])
def test_tiles_threads_and_runs_give_the_same_bits(still_life, threads, tile):
    scene, first = still_life
    same_bits(first, render_image(scene, PASSES, threads=threads, tile_size=tile))


def test_a_crop_is_a_part_of_the_whole_picture(still_life):
    scene, whole = still_life
    crop = render_image(replace(scene, camera=replace(scene.camera, crop=(13, 20, 61, 37))), PASSES)
    for name in PASSES:
        np.testing.assert_array_equal(crop.passes[name], whole.passes[name][20:37, 13:61])


@pytest.mark.parametrize("scene", [tabletop(120), four_lights(80), hall(16), hall(100)],
                         ids=["one light", "four lights", "sixteen lights", "a hundred lights"])
def test_the_uniform_skip_changes_no_bit(scene):
    on = render_image(scene.with_settings(uniform_skip=True), PASSES)
    off = render_image(scene.with_settings(uniform_skip=False), PASSES)
    same_bits(on, off)
    assert on.statistics["uniform_skips"] > 0 and off.statistics["uniform_skips"] == 0
    assert on.statistics["short_rays"] < off.statistics["short_rays"]


@pytest.mark.parametrize("shadows", ["LIGHT_MESHES", "AREA_SAMPLING"])
def test_lights_that_are_all_sharp_give_the_sharp_picture(shadows):
    scene = four_lights(80)
    scene = with_lights(scene, *(replace(light, soft_shadows=False) for light in scene.lights))
    same_bits(render_image(scene.with_settings(shadows=shadows), PASSES),
              render_image(scene.with_settings(shadows="SHARP"), PASSES))


def test_each_light_is_soft_or_sharp_by_itself():
    """A sum of pictures of one light each: the sharp light's part is that of the sharp picture."""
    scene = four_lights(80)
    lights = [replace(light, soft_shadows=n % 2 == 0) for n, light in enumerate(scene.lights)]
    scene = replace(scene, world_color=(0.0, 0.0, 0.0))
    together = render_image(with_lights(scene, *lights)).passes["Combined"][..., :3]
    apart = sum(render_image(with_lights(scene.with_settings(
        shadows="LIGHT_MESHES" if light.soft_shadows else "SHARP"), light)).passes["Combined"][..., :3]
        for light in lights)
    np.testing.assert_allclose(together, apart, rtol=1e-6, atol=1e-6)


def test_a_light_that_casts_no_shadow_shines_through_everything():
    scene = four_lights(80)
    shining = with_lights(scene, *(replace(light, cast_shadow=False) for light in scene.lights))
    same_bits(render_image(shining), render_image(scene.with_settings(mode="LOCAL")))


def test_an_object_that_casts_no_shadow_leaves_the_picture_of_its_absence_beside_it():
    scene = tabletop(120)
    bar = replace(scene.objects[2], visible_shadow=False)
    ghost = render_image(replace(scene, objects=(*scene.objects[:2], bar))).passes["Combined"]
    gone = render_image(replace(scene, objects=(
        *scene.objects[:2], replace(bar, visible_camera=False, visible_reflection=False)))).passes["Combined"]
    full = render_image(scene).passes["Combined"]
    seen = (ghost != gone).any(-1)
    assert 0 < seen.mean() < 0.1  # the bar itself
    assert ((full != ghost).any(-1) & ~seen).sum() > 100  # its shadow


@pytest.mark.parametrize("shadows", SHADOWS)
def test_the_order_of_the_lights_does_not_matter(shadows):
    scene = hall(9, width=64).with_settings(shadows=shadows, light_samples=16)
    forth = render_image(scene).passes["Combined"]
    back = render_image(with_lights(scene, *scene.lights[::-1])).passes["Combined"]
    np.testing.assert_allclose(forth, back, rtol=2e-6, atol=1e-7)


def test_the_seed_changes_what_is_sampled_and_only_that():
    scene = four_lights(48, shadows="AREA_SAMPLING", light_samples=4)
    first, second = (render_image(scene.with_settings(seed=n), PASSES).passes for n in (0, 1))
    differs = (first["Combined"] != second["Combined"]).any(-1)
    assert 0 < differs.mean() < 0.3  # penumbrae
    np.testing.assert_array_equal(first["Depth"], second["Depth"])


@pytest.mark.parametrize("by", [1e-7, -1e-7])
def test_a_floor_on_a_plane_of_the_lattice_may_move_a_little(by):
    """H2: nodes lie exactly on the floor, or 1e-7 beside it; no pixel cares."""
    scene = tabletop(100, h=0.1, lattice_rotation=False)
    moved = replace(scene, geometry=replace(
        scene.geometry, instance_matrix=translate(0, 0, by) @ scene.geometry.instance_matrix))
    np.testing.assert_allclose(render_image(moved).passes["Combined"], render_image(scene).passes["Combined"],
                               rtol=0, atol=1e-6)
