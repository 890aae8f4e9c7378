"""Soft light computed at sparse points of the picture: how little this changes, and where nothing is interpolated."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.bench.targets import MAX_ADDED, RMSE_ADDED
from light_meshes.film.images import Framebuffer
from light_meshes.film.passes import LIGHT
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import draw, render_image
from light_meshes.scene.description import Material
from light_meshes.scene.errors import SceneError
from light_meshes.scene.snapshot import with_setting
from scenes import GREY, all_lights, four_lights, hall, point, settings, tabletop, with_lights, with_objects

FINE = {"samples": 4, "filter_size": 1.5, "mode": "WHITTED"}
PASSES = ("Combined", "Depth", "Normal", "Debug Candidates", *LIGHT)


def still_life(width=96, **values):
    """Four lights, a glossy ball that mirrors a little, and a pane of glass before some of it."""
    scene = four_lights(width, **(FINE | values))
    ball = replace(scene.materials[1], mirror=(0.2, 0.2, 0.3))
    return replace(scene, materials=(scene.materials[0], ball, *scene.materials[2:]))


def glass(width=96, **values):
    pane = Material("glass", kd=0.1, kt=(0.7, 0.8, 0.6), ks=0.3, nShiny=20.0)
    parts = [Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor"),
             Shape(box((-0.5, -0.1, 0.0), (0.9, 0.1, 1.1)), pane, "pane")]
    return Scene.from_shapes(parts, Camera.look_at((2.5, -4.5, 3.0), (0, 0, 0.4), 40, width, width),
                             [point((1.5, 2.0, 3.0), 4.0)], settings(**(FINE | {"h": 0.08} | values)))


def error(scene, rate=4):
    """The picture's difference from that of rate 1, and what the statistics say."""
    exact, sparse = render_image(scene), render_image(scene.with_settings(shadow_rate=rate))
    difference = np.abs(exact.passes["Combined"].astype(np.float64) - sparse.passes["Combined"])
    return difference, sparse.statistics


@pytest.mark.parametrize(("scene", "saved"), [
    (tabletop(160, **FINE), 0.6), (still_life(160), 0.5), (still_life(160, weights="SMOOTH", samples=1), 0.5),
    (hall(16, width=160, h=0.1, **FINE), 0.25), (hall(100, width=160, h=0.1, **FINE), 0.3), (glass(160), 0.6),
], ids=["one light", "four lights", "smooth weights, one sample", "sixteen lights", "a hundred lights", "glass"])
@pytest.mark.parametrize("rate", [4, 8])
def test_it_adds_less_than_can_be_seen(scene, saved, rate):
    """saved: at least so many receivers are interpolated. Lights' changes add up, so with many there are fewer."""
    difference, statistics = error(scene, rate)
    assert np.sqrt((difference**2).mean()) <= RMSE_ADDED and difference.max() <= MAX_ADDED
    shares = np.array([statistics[name] for name in ("interpolated", "refined", "computed")])
    assert shares.sum() <= statistics["camera_rays"]
    assert shares[:2].sum() > saved * shares.sum() and shares[2] > 0
    assert statistics["points"] < shares.sum() and difference.max() > 0


def fence(lights, **values):
    """Thin posts and a glossy ball under `lights`."""
    posts = [translate(x, 0.3 * np.sin(3 * x), 0) for x in np.linspace(-2, 2, 40)]
    parts = [Shape(box((-3, -3, -0.1), (3, 3, 0)), Material("floor", Od=(0.9, 0.9, 0.9)), "floor"),
             Shape(box((-0.012, -0.012, 0), (0.012, 0.012, 1.0)), GREY, "posts", posts),
             Shape(box((-2, -0.01, 0.7), (2, 0.01, 0.74)), GREY, "rail"),
             Shape(sphere(0.3, 24, 12), Material("ball", Od=(0.3, 0.5, 0.8), ks=2.0, nShiny=60.0), "ball",
                   [translate(0.5, -1.2, 0.3)])]
    return Scene.from_shapes(parts, Camera.look_at((2.6, -4.4, 2.8), (0, -0.2, 0.2), 38, 100, 100), lights,
                             settings(**(FINE | values)))


def clustered(count, apart, colours=False):
    """Lamps that are `apart`, of 20 W in all; coloured ones are of very different power."""
    random = np.random.default_rng(1)
    power = random.random(count) ** 6 if colours else np.ones(count)
    places = np.array([1.0, -1.5, 3.3]) + apart * random.normal(size=(count, 3))
    tints = random.random((count, 3)) if colours else np.ones((count, 3))
    return [replace(point(tuple(p)), name=f"lamp {i}", intensity=tuple(20 * w / power.sum() * tint))
            for i, (p, w, tint) in enumerate(zip(places, power, tints, strict=True))]


def light_of(scene):
    """What the errors are shares of."""
    return Prepared(scene.with_settings(shadow_rate=4)).sparse.light


@pytest.mark.parametrize("values", [{"kI": 1.3, "h": 0.12}, {"kI": 3.0, "h": 0.06},
                                    {"kI": 2.0, "h": 0.09, "weights": "SMOOTH"}], ids=["few", "many", "smooth"])
@pytest.mark.parametrize(("count", "apart", "colours"), [
    (1, 0.0, False), (64, 0.0, False), (16, 0.05, False), (30, 0.05, True), (16, 0.3, False), (64, 0.3, True)])
def test_lamps_close_together_change_together(count, apart, colours, values):
    """Each of them changes little, where all go at once."""
    scene = fence(clustered(count, apart, colours), **values)
    difference, statistics = error(scene)
    light = light_of(scene)
    assert np.sqrt((difference**2).mean()) <= RMSE_ADDED * light and difference.max() <= MAX_ADDED * light
    assert statistics["interpolated"] + statistics["refined"] > 0 or values["kI"] < 2


@pytest.mark.parametrize("power", [2.0**-10, 2.0**10, 1e-3, 1e3])
@pytest.mark.parametrize("scene", [still_life(), hall(16, width=96, h=0.1, **FINE)], ids=["still life", "hall"])
def test_dark_and_bright_scenes_are_interpolated_alike(scene, power):
    scene = scene.with_settings(shadow_rate=4, ambient=0.0)
    scene = replace(scene, world_color=(0.0,) * 3)
    scaled = with_lights(scene, *(replace(light, intensity=tuple(power * c for c in light.intensity))
                                  for light in scene.lights))
    a, b = render_image(scene), render_image(scaled)
    colours = [r.passes["Combined"][..., :3] for r in (a, b)]
    counts = [[r.statistics[name] for name in ("interpolated", "refined", "computed")] for r in (a, b)]
    assert light_of(scaled) == pytest.approx(power * light_of(scene)) and counts[0][1] > 0
    if np.log2(power) % 1 == 0:  # no number is rounded otherwise
        np.testing.assert_array_equal(colours[1], np.float32(power) * colours[0])
        assert counts[0] == counts[1]
    else:
        np.testing.assert_allclose(colours[1] / power, colours[0], atol=2 * MAX_ADDED * light_of(scene))
        assert np.abs(colours[1] / power - colours[0]).mean() < 1e-5
        assert np.abs(np.subtract(*counts)).max() < 0.001 * sum(counts[0])


def test_many_lights_need_fewer_shadow_rays():
    scene = hall(100, width=160, h=0.1, **FINE)
    exact, sparse = (render_image(scene.with_settings(shadow_rate=rate)).statistics for rate in (1, 4))
    # Receivers are hardly fewer, 99 in 100. They were 85 while lights' changes were maximised, which passed the bound.
    assert sparse["receivers"] < exact["receivers"] and sparse["short_rays"] < 0.85 * exact["short_rays"]
    assert "between points" in sparse["plan"]["shadow rate"]


def test_caustics_are_computed_at_each_sample():
    """They may be as sharp as they like: of one the largest difference was twice what is allowed."""
    scene = glass()
    scene = replace(scene, materials=tuple(replace(m, ior=1.5) if m.name == "glass" else m for m in scene.materials))
    difference, statistics = error(scene.with_settings(refraction="FULL"))
    assert not difference.any() and "bent" in statistics["plan"]["shadow rate"]
    assert error(scene.with_settings(refraction="VIEW"))[0].any()


def test_at_rate_1_there_is_none_of_it():
    scene = still_life(48)
    assert scene.settings.shadow_rate == 1 and Prepared(scene).sparse is None
    report = render_image(scene).statistics
    assert "interpolation" not in report["stages"] and "shadow rate" not in report["plan"]


@pytest.mark.parametrize("scene", [still_life(), still_life(samples=1), glass()], ids=["opaque", "1 sample", "glass"])
@pytest.mark.parametrize("lens", [0.0, 0.05])
def test_tiles_and_threads_give_the_same_bits_and_a_crop_is_a_part(scene, lens):
    camera = replace(scene.camera, lens_radius=lens, focus_distance=5.0)
    scene = replace(scene, camera=camera).with_settings(shadow_rate=4)
    whole = render_image(scene, PASSES, threads=1, tile_size=96)
    assert whole.statistics["interpolated"] > 0 and whole.statistics["refined"] > 0
    for threads, tile in ((2, 32), (1, 7)):
        other = render_image(scene, PASSES, threads=threads, tile_size=tile)
        for name in PASSES:
            np.testing.assert_array_equal(whole.passes[name], other.passes[name], err_msg=name)
    crop = render_image(replace(scene, camera=replace(camera, crop=(13, 21, 62, 38))), PASSES)
    for name in PASSES:
        np.testing.assert_array_equal(whole.passes[name][21:38, 13:62], crop.passes[name], err_msg=name)


def test_passes_change_nothing_and_add_up():
    scene = still_life().with_settings(shadow_rate=4)
    alone, all_of = render_image(scene).passes["Combined"], render_image(scene, PASSES).passes
    np.testing.assert_allclose(all_of["Combined"], alone, atol=1e-6)
    np.testing.assert_allclose(sum(all_of[name] for name in LIGHT), all_of["Combined"][..., :3], atol=1e-5)
    exact = render_image(scene.with_settings(shadow_rate=1), PASSES).passes
    for name in ("Depth", "Normal", "Environment", "Emission", "Ambient"):
        np.testing.assert_array_equal(all_of[name], exact[name], err_msg=name)
    for name in ("Diffuse", "Glossy"):
        assert np.sqrt(((all_of[name] - exact[name])**2).mean()) < RMSE_ADDED
    assert 0 < (all_of["Debug Candidates"] > 0).sum() < (exact["Debug Candidates"] > 0).sum()
    with_shadows = render_image(scene, ("Combined", "Shadow"))
    np.testing.assert_array_equal(with_shadows.passes["Combined"], exact["Combined"])
    assert "shadow passes" in with_shadows.statistics["plan"]["shadow rate"]


def test_other_shadows_and_what_takes_none_stay_as_they_are():
    scene = still_life()
    for other in (scene.with_settings(shadows="SHARP"), scene.with_settings(shadows="AREA_SAMPLING", light_samples=4),
                  all_lights(scene, soft_shadows=False), with_objects(scene, box={"cast_soft_shadows": False}),
                  scene.with_settings(mode="LOCAL")):
        difference, _ = error(other)
        assert not difference.any()
    scene = with_objects(scene, floor={"receive_soft_shadows": False}).with_settings(samples=1)
    difference, statistics = error(scene)
    floor = render_image(scene, ("Position",)).passes["Position"][..., 2] < 1e-3
    assert statistics["refined"] > 0 and difference.max() > 0 and not difference[floor].any()


def test_sharp_lights_are_computed_at_each_sample_beside_smooth_ones():
    scene = still_life(160)
    scene = with_lights(scene, replace(scene.lights[0], soft_shadows=False), *scene.lights[1:])
    difference, statistics = error(scene)
    exact = render_image(scene).statistics
    assert statistics["refined"] > 0 and 0 < difference.max() <= MAX_ADDED
    assert np.sqrt((difference**2).mean()) <= RMSE_ADDED
    assert exact["empty_sets"] == 0 and statistics["shadow_rays"] == exact["shadow_rays"] > 0


def test_kept_nodes_give_the_same_picture():
    scene = still_life().with_settings(shadow_rate=4)
    first = Prepared(scene)
    pictures = [draw(ready, Framebuffer.create(scene, ("Combined",))).passes["Combined"]
                for ready in (first, Prepared(scene, previous=first))]
    np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize("value", ["0", "17", "2.5", "fast"])
def test_a_bad_rate_is_named(value):
    with pytest.raises(SceneError, match="shadow_rate"):
        with_setting(still_life().settings, "shadow_rate", value)
