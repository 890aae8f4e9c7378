"""Pixels that share their samples: against a slow sum, whatever the tiles and the crop, and nearer to the truth."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, rectangle
from light_meshes.film.passes import CENTRE, LIGHT, PASSES
from light_meshes.picture.render import render_image
from light_meshes.rays.camera import filter_offsets
from light_meshes.scene.description import Material
from scenes import four_lights, hall, point, settings, tabletop

MATTES = ("CryptoObject00", "CryptoObject01", "CryptoMaterial00")
ALL = (*PASSES, *MATTES)
WHITE = Material("white", Od=(0, 0, 0), kd=0.0, ka=0.0, emission=(1.0, 1.0, 1.0))


def shared(scene, **values):
    return scene.with_settings(**{"share_samples": True, "samples": 4, "filter_size": 1.5} | values)


def window(x, filter_size):
    """The Blackman-Harris filter at a distance x from its middle, written anew."""
    t = np.pi * (x / filter_size + 1)
    value = 0.35875 - 0.48829 * np.cos(t) + 0.14128 * np.cos(2 * t) - 0.01168 * np.cos(3 * t)
    return np.where(np.abs(x) < filter_size, value, 0)


def slowly(scene, name):
    """The pass, from a picture for each sample: its pixels' middles are where the samples are."""
    s, camera = scene.settings, scene.camera
    left, right, bottom, top = camera.window
    sizes = (right - left) / camera.width, (top - bottom) / camera.height
    total = weights = 0.0
    for x, y in filter_offsets(s.samples, s.filter_size, shared=True):
        moved = replace(camera, window=(left + x * sizes[0], right + x * sizes[0], bottom + y * sizes[1],
                                        top + y * sizes[1]))
        one = render_image(replace(scene, camera=moved).with_settings(samples=1, share_samples=False), (name,))
        values = np.pad(one.passes[name].astype(float), ((3, 3), (3, 3), (0, 0)))
        there = np.pad(np.ones((camera.height, camera.width, 1)), ((3, 3), (3, 3), (0, 0)))
        for up in range(-3, 4):
            for right_by in range(-3, 4):
                weight = window(right_by + x, s.filter_size) * window(up + y, s.filter_size)
                part = np.s_[3 + up:3 + up + camera.height, 3 + right_by:3 + right_by + camera.width]
                total, weights = total + weight * values[part], weights + weight * there[part]
    return total / weights


@pytest.mark.parametrize(("samples", "filter_size"), [(4, 1.5), (3, 1.5), (2, 2.2), (5, 1.0)])
def test_a_pixel_is_the_mean_of_all_samples_within_reach(samples, filter_size):
    scene = shared(four_lights(24, shadows="SHARP"), samples=samples, filter_size=filter_size)
    for name in ("Combined", "Normal", "Mist"):
        found = render_image(scene, (name,)).passes[name]
        np.testing.assert_allclose(found, slowly(scene, name), rtol=0, atol=2e-6, err_msg=name)


def many_lamps():
    """A scene whose pixels find out in blocks what they see of lamps with a size."""
    scene = hall(16, width=37)
    return replace(scene, lights=tuple(replace(light, softness="SIZE", radius=0.2) for light in scene.lights))


SCENES = {
    "soft": lambda: shared(four_lights(35, mode="WHITTED"), film_transparent=True),
    "blocks": lambda: shared(many_lamps()),
    "interpolated": lambda: shared(tabletop(28, h=0.1, kI=1.3), shadow_rate=4, filter_size=2.0),
    "three samples": lambda: shared(four_lights(33, shadows="SHARP"), samples=3),
}


@pytest.fixture(scope="module", params=SCENES)
def drawn(request):
    scene = SCENES[request.param]()
    return scene, render_image(scene, ALL, threads=2).passes


def test_tiles_change_no_bit(drawn):
    scene, expected = drawn
    found = render_image(scene, ALL, threads=1, tile_size=8).passes
    for name in ALL:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)


@pytest.mark.parametrize("crop", [(0, 3, 17, 20), (9, 8, 27, 22), (12, 5, 13, 6)])
def test_a_crop_is_a_part_of_the_picture(drawn, crop):
    scene, expected = drawn
    x0, y0, x1, y1 = crop
    found = render_image(replace(scene, camera=replace(scene.camera, crop=crop)), ALL, tile_size=8).passes
    for name in ALL:
        np.testing.assert_array_equal(found[name], expected[name][y0:y1, x0:x1], err_msg=name)


def test_the_parts_of_light_add_up_to_combined(drawn):
    scene, passes = drawn
    world = 0 if not scene.settings.film_transparent else passes["Environment"]
    total = sum(passes[name] for name in LIGHT) - world
    np.testing.assert_allclose(total, passes["Combined"][..., :3], rtol=0, atol=2e-6)


@pytest.mark.parametrize("values", [{"samples": 1}, {"filter_size": 0.9}, {"filter_size": 2.6}, {"filter_size": 0.0}])
def test_where_nothing_is_shared_the_bits_are_those_of_each_pixel_alone(values):
    scene = shared(four_lights(24), **values)
    both = [render_image(scene.with_settings(share_samples=s), ALL).passes for s in (False, True)]
    for name in ALL:
        np.testing.assert_array_equal(both[0][name], both[1][name], err_msg=name)


def test_passes_without_a_mean_are_of_a_sample_of_the_pixel():
    scene = shared(four_lights(24))
    passes = render_image(scene, CENTRE).passes
    left, right, bottom, top = scene.camera.window
    x, y = filter_offsets(4, 1.5, shared=True)[0] * [(right - left) / 24, (top - bottom) / scene.camera.height]
    moved = replace(scene.camera, window=(left + x, right + x, bottom + y, top + y))
    alone = render_image(replace(scene, camera=moved).with_settings(samples=1, share_samples=False), CENTRE).passes
    for name in CENTRE:
        np.testing.assert_allclose(passes[name], alone[name], rtol=1e-6, atol=1e-6, err_msg=name)


def test_mattes_cover_what_the_picture_shows():
    """The white things' light is what their mattes say of each pixel."""
    things = [Shape(rectangle((-3, -3), (3, 3), 0.0), Material("dark", kd=0.0, ka=0.0), "ground",
                    flags={"cryptomatte": 0x40000001}),
              Shape(box((-0.7, -0.5, 0.2), (0.4, 0.6, 0.9)), WHITE, "box", flags={"cryptomatte": 0x3F800007})]
    camera = Camera.look_at((2.0, -3.0, 4.0), (0, 0, 0.3), 30, 40, 32)
    passes = render_image(shared(Scene.from_shapes(things, camera, [], settings())), ALL, tile_size=16).passes
    white = passes["Combined"][..., 0].astype(float)
    covers = np.concatenate([passes[name][..., 1::2] for name in MATTES[:2]], axis=2).astype(float)
    ids = np.concatenate([passes[name][..., ::2] for name in MATTES[:2]], axis=2)
    of_box = ids == np.uint32(0x3F800007).view(np.float32)
    np.testing.assert_allclose((covers * of_box).sum(2), white, atol=1e-6)
    assert ((white > 0.01) & (white < 0.99)).sum() > 50 and (white[:, 0] == 0).all()
    assert (np.diff(covers, axis=2) <= 0).all()


def test_edges_and_soft_shadows_are_nearer_to_the_truth():
    """Four samples that are shared are about as near as nine of each pixel alone."""
    scene = four_lights(48, samples=4, filter_size=1.5, h=0.04, kI=3.0)
    truth = render_image(scene.with_settings(samples=256)).passes["Combined"]

    def error(**values):
        return np.sqrt(((render_image(scene.with_settings(**values)).passes["Combined"] - truth)**2).mean())

    both = {n: (error(samples=n), error(samples=n, share_samples=True)) for n in (2, 4, 9, 16)}
    for n, (alone, shared) in both.items():
        print(f"{n} samples: RMSE {alone:.4f} of each pixel alone, {shared:.4f} shared")
    assert both[4][1] < 0.6 * both[4][0] and both[16][1] < 0.6 * both[16][0]
    assert both[4][1] < both[9][0]


def test_a_bright_lamp_in_view_is_as_bright_as_without():
    """Light is neither lost nor made."""
    scene = four_lights(48, samples=16, filter_size=1.5)
    scene = replace(scene, lights=(*scene.lights, replace(point((0.3, 0.2, 1.2), 40), radius=0.1, seen_by_camera=True)))
    both = [render_image(scene.with_settings(share_samples=s)).passes["Combined"].astype(float) for s in (False, True)]
    assert both[0].max() > 50
    np.testing.assert_allclose(both[1].sum((0, 1)), both[0].sum((0, 1)), rtol=0.02)
