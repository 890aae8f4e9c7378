"""Soft and sharp casters, receivers and links where surfaces let light through."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Mesh, Scene, Shape, rectangle
from light_meshes.picture.render import Prepared, render_image
from scenes import GREY, WHITE, all_lights, look_down, settings, sun, with_lights, with_objects
from test_semitransparent import glass, still_life

UP = np.array([[0.0, 0.0, 1.0]])


def under_pane(pane_soft, t=0.5, pane=True, values=None, **light):
    """S on a floor under a pane at z = 1 over x < 0, and an opaque roof at z = 2 over y < 0; the sun stands above."""
    parts = [Shape(rectangle((-9, -9), (9, 9), 0.0), WHITE, "floor"),
             Shape(rectangle((-3, -8), (3, 0), 2.0), GREY, "roof"),
             Shape(rectangle((-8, -4), (0, 4), 1.0), glass(t), "pane",
                   flags={"cast_soft_shadows": pane_soft, "visible_shadow": pane})]
    scene = Scene.from_shapes(parts, look_down(0, 0, 4, 8), [replace(sun((0, 0, -1)), **light)],
                              settings(h=0.1, **(values or {})))
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-0.5, 0.5, 41) + 0.0037, np.linspace(-0.5, 0.5, 21)))
    P = np.stack([x, y, 0 * x], 1)
    return x, y, Prepared(scene).light_visibility(P, np.repeat(UP, len(P), 0)).reshape(len(P), -1)


@pytest.mark.parametrize("values", [
    {}, {"glass": "PAPER"}, {"weights": "SMOOTH"}, {"shadows": "AREA_SAMPLING"}, {"refraction": "FULL"}], ids=str)
@pytest.mark.parametrize("t", [0.5, (0.7, 0.5, 0.2)], ids=str)
def test_sharp_glass_multiplies_by_its_t_at_the_receiver(values, t):
    x, y, S = under_pane(False, t, values=values, angle=0.1)
    _, _, without = under_pane(False, t, pane=False, values=values, angle=0.1)
    np.testing.assert_allclose(S, without * np.where(x[:, None] < 0, t, 1.0), rtol=1e-5)
    assert ((without > 0.1) & (without < 0.9)).any()  # the roof is soft
    _, _, soft = under_pane(True, t, values=values, angle=0.1)
    lit = y > 0.35
    assert len(np.unique(soft[lit].round(5))) > 5 and len(np.unique(S[lit].round(5), axis=0)) == 2


def test_beside_a_sharp_pane_paper_counts_its_t_once():
    """Eq. (7) weighs soft glass alone: what is sharp dims at the receiver."""
    upright = Mesh(np.array([(0, -5, -1), (0, 5, -1), (0, 5, 5), (0, -5, 5)], float), np.array([(0, 1, 2), (0, 2, 3)]))
    parts = [Shape(rectangle((-9, -9), (9, 9), 0.0), WHITE, "floor"),
             Shape(rectangle((-3, -8), (3, 0), 2.0), GREY, "roof"),
             Shape(upright, glass(0.5), "pane", flags={"cast_soft_shadows": False})]
    scene = Scene.from_shapes(parts, look_down(0, 0, 4, 8), [sun((-1, 0, -1))], settings(h=0.1, glass="PAPER"))
    x = np.array([-0.05, -0.2, 0.05, 0.2])
    S = Prepared(scene).light_visibility(np.stack([x, 0 * x + 2, 0 * x], 1), np.repeat(UP, len(x), 0)).ravel()
    np.testing.assert_array_equal(S, np.where(x > 0, 1.0, 0.5))


def test_smooth_weights_are_exact_where_all_agree_through_glass():
    x, _, S = under_pane(True, 0.3, values={"weights": "SMOOTH", "uniform_skip": False})
    _, _, skipped = under_pane(True, 0.3, values={"weights": "SMOOTH"})
    np.testing.assert_array_equal(S, skipped)
    assert (S[(x < -0.35), 0] <= np.float32(0.3)).all() and (np.float32(0.3) == S).any()


def test_glass_that_does_not_block_a_light_does_not_bend_it():
    """FULL: a light whose blockers leave the ball out sees past it; the other light's caustic stays."""
    scene = still_life(glass(0.9, ior=1.5), shadows="SHARP", refraction="FULL")
    first, second = (replace(light, intensity=(1.0,) * 3) for light in scene.lights)
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-2, 2, 15), np.linspace(-2, 2, 15)))
    P = np.stack([x, y, 0 * x], 1)
    N = np.repeat(UP, len(P), 0)
    everything = Prepared(with_lights(scene, first, second)).light_visibility(P, N)
    unblocked = with_lights(scene, replace(first, blockers=(0, 2, 3)), second)
    S = Prepared(unblocked).light_visibility(P, N)
    np.testing.assert_array_equal(S[:, 1], everything[:, 1])
    gone = Prepared(with_objects(scene, ball={"visible_shadow": False})).light_visibility(P, N)
    np.testing.assert_allclose(S[:, 0], gone[:, 0], rtol=1e-5)
    assert (S[:, 0] != everything[:, 0]).any()
    straight = [render_image(all_lights(scene.with_settings(refraction=r), blockers=(0, 2, 3)))
                for r in ("VIEW", "FULL")]
    np.testing.assert_allclose(*(picture.passes["Combined"] for picture in straight), rtol=1e-5)


def test_a_sharp_ball_of_glass_has_the_sharp_caustic():
    """FULL: V of the ball alone, its paths at the receiver, times S of the rest."""
    scene = still_life(glass(0.9, ior=1.5), refraction="FULL")
    mixed = with_objects(scene, ball={"cast_soft_shadows": False}, sheet={"visible_shadow": False})
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-2, 2, 25), np.linspace(-2, 2, 25)))
    P = np.stack([x, y, 0 * x], 1)[np.hypot(x, y) > 0.8]
    P = P[np.maximum(np.abs(P[:, 0] - 1), np.abs(P[:, 1] - 0.6)) > 0.75]
    N = np.repeat(UP, len(P), 0)
    ball = Prepared(all_lights(mixed, blockers=(1,)).with_settings(shadows="SHARP")).light_visibility(P, N)
    rest = Prepared(all_lights(mixed, blockers=(0, 3))).light_visibility(P, N)
    np.testing.assert_allclose(Prepared(mixed).light_visibility(P, N), ball * rest, rtol=1e-6)
    assert (ball > 0).any() and ((rest > 0) & (rest < 1)).any()
