"""Highlights that are smaller than the distance of samples do not become specks."""

import light_meshes as lm
import numpy as np
import pytest
from light_meshes.film.images import Framebuffer
from light_meshes.picture import render as rendering
from light_meshes.surface import curvature


def balls(radius, samples, count=12):
    """A row of shining balls in front of a camera of 96 × 32 pixels, each `radius` pixels large, under a small lamp."""
    metal = lm.Material("metal", kd=0.0, highlight="GGX", roughness=0.15, metal=1.0, F0=(0.9, 0.9, 0.9))
    places = [lm.translate(8.0 * (i - count / 2 + 0.5) + 0.37 * i, 0.0, 0.0) for i in range(count)]
    return lm.Scene.from_shapes(
        [lm.Shape(lm.sphere(radius), metal, "balls", matrices=places)],
        camera=lm.Camera.orthographic((0, -50, 0), (0, 0, 0), 96.0, 96, 32),
        lights=[lm.Light("lamp", "POINT", intensity=(4e4,) * 3, position=(20.0, -60.0, 80.0), radius=0.5)],
        settings=lm.Settings(samples=samples, shadows="SHARP", world_light="AMBIENT"))


def picture(scene, widens=True):
    ready = rendering.prepare(scene, ("Combined",))
    assert ready.curved is not None
    if not widens:
        ready.curved = None
    return rendering.draw(ready, Framebuffer.create(scene, ("Combined",))).passes["Combined"][..., :3]


@pytest.mark.parametrize("radius", [0.1, 2.0])
def test_a_ball_turns_by_its_radius_and_a_box_not_at_all(radius):
    for shape, known in ((lm.Shape(lm.sphere(radius)), 1 / radius), (lm.Shape(lm.box((0, 0, 0), (1, 1, 1))), 0.0)):
        scene = lm.Scene.from_shapes([shape], camera=lm.Camera.look_at((0, -9, 0), (0, 0, 0), 40, 8, 8))
        found = curvature.curvature(rendering.prepare(scene, ("Combined",)).surfaces)
        assert np.abs(found - known).max() <= 0.02 * known


@pytest.mark.parametrize("radius", [1.0, 3.0])
def test_small_balls_have_no_specks(radius):
    truth = picture(balls(radius, 1024), widens=False)
    plain, wide = (picture(balls(radius, 4), widens) for widens in (False, True))
    rms = [np.sqrt(((p - truth)**2).mean()) for p in (plain, wide)]
    assert rms[1] < 0.5 * rms[0]
    assert wide.max() < 2.5 * truth.max() < plain.max()


@pytest.mark.parametrize("radius", [0.4, 0.6, 1.0, 2.0, 3.0])
def test_highlights_keep_their_light(radius):
    truth, wide = picture(balls(radius, 1024), widens=False), picture(balls(radius, 4))
    assert abs(wide.mean() / truth.mean() - 1) < 0.3


def test_large_balls_hardly_change():
    plain, wide = (picture(balls(15.0, 16, 3), widens) for widens in (False, True))
    assert np.abs(wide - plain).max() < 0.05 * plain.max()
    assert abs(wide.mean() / plain.mean() - 1) < 0.01


def test_more_samples_widen_less():
    first, second = (np.abs(picture(balls(4.0, n), True) - picture(balls(4.0, n), False)).max() for n in (1, 64))
    assert second < 0.1 * first
