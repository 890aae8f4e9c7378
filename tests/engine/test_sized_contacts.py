"""Shadows of lamps with a size at kI 2: at feet, of thin strips, across seams, and in the limit."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from light_meshes import Light, Scene, Shape, box, rectangle
from light_meshes.shadows import shares, sized
from scenes import WHITE, all_lights, combined, four_lights, look_down, settings, strip, tabletop, with_lights
from sized_lamps import Seen, rmse, scene_of
from test_lamps_with_a_size import disc_over_edge

ONE = (1.0, 1.0, 1.0)
RADIUS = 0.4


def profile(u):
    """The share of a disc that an edge at u radii from its middle leaves."""
    u = np.clip(u, -1, 1)
    return 0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / np.pi


def square(seen, *values):
    """Values of the receivers of a square picture, NaN elsewhere."""
    n = seen.ready.scene.camera.width
    out = np.full((len(values), n * n), np.nan)
    out[:, seen.pixel] = values
    return out.reshape(len(values), n, n)


@pytest.mark.parametrize("width", [0.4, 0.2, 0.1, 0.05, 0.02])
def test_a_strip_narrower_than_the_lamp(width):
    """Halfway to a disc of radius .4: the shadow is a band of the disc, twice as wide as the strip. Its darkness within
    .03 of that, its edges within two pixels; of what hides less than a quarter of the lamp only the darkness."""
    pixels = 100
    scene = strip(width, h=0.05, kI=2.0, shadows="LIGHT_MESHES")
    lamp = Light("disc", "AREA", ONE, position=(0.0, 0.0, 8.0), direction=(0.0, 0.0, -1.0), area_u=(RADIUS, 0.0, 0.0),
                 area_v=(0.0, RADIUS, 0.0), area_ellipse=True, softness="SIZE")
    seen = Seen(replace(with_lights(scene, lamp), camera=look_down(0.0, 0.0, 4 * RADIUS, pixels, height=2.0)))
    S, x = square(seen, seen.by("LIGHT_MESHES")[:, 0], seen.P[:, 0])
    found, x = S.mean(0), x[0]
    exact = 1 - (profile((x + width) / RADIUS) - profile((x - width) / RADIUS))
    assert abs(found.min() - exact.min()) <= 0.03 and rmse(found, exact) <= 0.02 and rmse(S, exact) <= 0.025
    if exact.min() > 3 / 4:
        return
    half, step = (1 + exact.min()) / 2, x[1] - x[0]
    for side in (x < 0, x > 0):
        places = [np.interp(half, *(a[side][:: -1 if x[side][0] < 0 else 1] for a in (s, x))) for s in (found, exact)]
        assert abs(places[0] - places[1]) <= 2 * step


FEET = {"sphere": Light("lamp", "POINT", ONE, position=(-2.0, 0.3, 2.5), radius=0.3, softness="SIZE"),
        "sun": Light("lamp", "SUN", ONE, direction=(0.6, -0.1, -0.8), angle=0.2, softness="SIZE"),
        "rectangle": Light("lamp", "AREA", ONE, position=(-1.5, 0.2, 2.0), direction=(0.6, 0.0, -0.8), softness="SIZE",
                           area_u=(0.0, 0.3, 0.0), area_v=(0.16, 0.0, 0.12))}


@pytest.mark.parametrize(("kI", "most", "share"), [(2.0, 0.04, 0.01), (3.0, 0.03, 0.004)])
@pytest.mark.parametrize("lamp", FEET)
def test_a_boxs_foot(lamp, kI, most, share):
    """From the corner where a box stands on the floor, its shadow's edge begins with no width: 10, 50 and 90 % lie
    within two pixels of the truth, along eight columns. In the umbra S is 0, near its border up to .03, at kI 2 .04.
    """
    shapes = [Shape(rectangle((-4, -4), (4, 4), 0.0), WHITE, "floor"),
              Shape(box((-0.4, -0.4, 0), (0, 0.4, 0.8)), WHITE, "box")]
    scene = Scene.from_shapes(shapes, look_down(0.2, 0.45, 0.6, 100, height=3.0), [FEET[lamp]],
                              settings(h=0.0125, kI=kI, shadows="LIGHT_MESHES"))
    seen = Seen(scene)
    S, truth = square(seen, seen.by("LIGHT_MESHES")[:, 0], seen.by("AREA_SAMPLING", 400)[:, 0])
    compared = 0
    for column in range(36, 100, 8):
        for level in (0.1, 0.5, 0.9):
            found, true = (np.flatnonzero(np.diff((a[:, column] > level).astype(int)) == 1) for a in (S, truth))
            if len(true):
                assert len(found) and abs(found[-1] - true[-1]) <= 2, (column, level, found, true)
                compared += 1
    assert compared >= 20
    umbra = S[truth == 0]
    assert len(umbra) > 500 and umbra.max() <= most and np.mean(umbra > 1 / 64) <= share


def test_no_seams_where_shadows_are_wide():
    """At kI 2 S jumps from pixel to pixel by no more than the truth and 1/64, but for one pair in 70, of .04."""
    seen = Seen(scene_of("board", "sphere", 100, h=0.0125, kI=2.0))
    S, truth, x = square(seen, seen.by("LIGHT_MESHES")[:, 0], seen.by("AREA_SAMPLING", 2048)[:, 0], seen.P[:, 0])
    excess = []
    for axis in (0, 1):
        step, true = np.abs(np.diff(S, axis=axis)), np.abs(np.diff(truth, axis=axis))
        wide = np.minimum(*(np.take(x, range(k, 99 + k), axis) for k in (0, 1))) > 0
        excess.append((step - true)[wide])
    excess = np.concatenate(excess)
    assert len(excess) > 3000 and np.mean(excess > 1 / 64) <= 0.015 and np.nanmax(excess) <= 0.04


def disc_error(h, kI, points, monkeypatch):
    """RMSE of S in the penumbra of a straight edge, whose profile is known."""
    monkeypatch.setattr(shares, "POINTS", points)
    monkeypatch.setattr(sized, "POINTS", points)
    monkeypatch.setattr(shares, "HALF", points // 2)
    seen = Seen(disc_over_edge(np.pi / 2, RADIUS, h=h, kI=kI))
    return rmse(seen.by("LIGHT_MESHES")[:, 0], profile(seen.P[:, 0] / RADIUS))


def test_it_converges_to_the_lamp(monkeypatch):
    """With 32 points in the step with the order .7 at least, from there in the points with the order ½ at least, and in
    all with the order .8 at least, over two halvings."""
    steps = [disc_error(h, 2.0, 32, monkeypatch) for h in (0.2, 0.1, 0.05)]
    points = [disc_error(0.05, 2.0, n, monkeypatch) for n in (8, 16, 32)]
    both = [disc_error(h, kI, n, monkeypatch) for h, kI, n in ((0.2, 1.5, 8), (0.1, 2.0, 16), (0.05, 3.0, 64))]
    print(np.round([steps, points, both], 4))
    for errors, order in ((steps, 0.7), (points, 0.5), (both, 0.8)):
        assert all(a > b for a, b in pairwise(errors)) and errors[0] >= errors[-1] * 4**order, errors
    assert both[-1] < 0.006


@pytest.mark.parametrize("kind", ["POINT", "SPOT", "AREA", "SUN"])
def test_a_vanishing_lamp_is_sharp_bit_for_bit(kind):
    light = next(light for light in four_lights().lights if light.type == kind)
    tiny = 1e-12
    light = replace(light, radius=tiny, angle=tiny, area_u=(tiny, 0.0, 0.0), area_v=(0.0, tiny, 0.0), softness="SIZE")
    scene = with_lights(four_lights(48), light)
    assert np.array_equal(combined(scene), combined(scene.with_settings(shadows="SHARP")))


def test_a_small_lamp_is_nearly_sharp():
    scene = all_lights(tabletop(64), softness="SIZE", radius=1e-4)
    assert np.mean(combined(scene) != combined(scene.with_settings(shadows="SHARP"))) < 1e-3


@pytest.mark.parametrize("way", ["the scene's shadows", "the lamp's switch"])
def test_sharp_shadows_of_a_lamp_with_a_size(way):
    """Sharp shadows are those of its middle; the light is that of all of it, as without shadows."""
    lamp = Light("lamp", "AREA", ONE, position=(0.0, 0.0, 1.2), direction=(0.0, 0.0, -1.0), area_u=(0.5, 0.0, 0.0),
                 area_v=(0.0, 0.5, 0.0), softness="SIZE")
    shapes = [Shape(rectangle((-4, -4), (4, 4), 0.0), WHITE, "floor"),
              Shape(box((0.1, -0.3, 0.3), (0.4, 0.3, 0.4)), WHITE, "box", flags={"visible_camera": False})]
    scene = Scene.from_shapes(shapes, look_down(0.0, 0.0, 2.0, 60, height=3.0), [lamp],
                              settings(h=0.05, kI=2.0, shadows="LIGHT_MESHES"))
    if way == "the lamp's switch":
        sharp = combined(all_lights(scene, soft_shadows=False))
    else:
        sharp = combined(scene.with_settings(shadows="SHARP"))
    unshadowed = combined(scene.with_settings(shadows="NONE"))
    seen = Seen(scene)
    V = square(seen, seen.by("SHARP")[:, 0])[0]
    assert set(np.unique(V)) == {0.0, 1.0}
    assert np.array_equal(sharp[..., 0], np.where(V > 0, unshadowed[..., 0], sharp.min()))
    point = combined(all_lights(scene, softness="SCENE").with_settings(shadows="NONE"))
    assert unshadowed.max() < 0.9 * point.max()


def test_the_foot_of_a_wall_below_a_wide_lamp():
    """A lamp as wide as a window stands close behind a low wall. Receivers at its foot see the lamp's upper edge, which
    gives them far less light than a count of the lamp's points says."""
    floor, wall = Shape(rectangle((-4, -4), (4, 4)), WHITE), Shape(box((-2.6, -4, 0), (-2.5, 4, 0.9)), WHITE)
    lamp = Light("lamp", "AREA", ONE, position=(-2.78, 0.0, 1.55), direction=(1.0, 0.0, 0.0), softness="SIZE",
                 area_u=(0.0, 1.1, 0.0), area_v=(0.0, 0.0, 0.8))
    scene = Scene.from_shapes([floor, wall], camera=look_down(-1.5, 0.0, 2.0, 60, height=6.0), lights=[lamp],
                              settings=settings(h=0.04, kI=3.0, shadows="LIGHT_MESHES"))
    found, exact = (combined(scene.with_settings(**more)).mean((0, 2)) for more in (
        {}, {"shadows": "AREA_SAMPLING", "light_samples": 512}))
    lit = exact > 0.05 * exact.max()
    assert lit.mean() > 0.8
    assert np.abs(found[lit] / exact[lit] - 1).max() < 0.04
