"""Glass Shadows: Solid. Straight light through bodies counts as far as they do not turn it aside."""

from dataclasses import replace

import numpy as np
import pytest
from kept import after
from light_meshes import Material, Scene, Shape, box, rectangle, rotate_x, rotate_y, sphere, translate
from light_meshes.glass.aside import LEAST
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from scenes import GREY, look_down, point, settings, sun
from visible import visibility

SPOTS = np.c_[np.linspace(0, 1.4, 29), np.full(29, 0.13), np.zeros(29)]  # below a ball of radius 1
FLOOR = Shape(rectangle((-9, -9), (9, 9), 0.0), GREY, "floor")


def glass(t=1.0, ior=1.5, **more):
    return Material("glass", Od=(0, 0, 0), ka=0.0, kd=0.0, kt=(t, t, t), ior=ior, **more)


def ball(material, segments=192):
    return Shape(sphere(1.0, segments, segments // 2), material, "ball", [translate(0, 0, 1.5)])


def below(parts, light, **values):
    values = {"shadows": "SHARP", "glass_shadows": "SOLID"} | values
    return Scene.from_shapes([FLOOR, *parts], look_down(0, 0, 4, 40), [light], settings(**values))


def seen(scene, P=SPOTS):
    return visibility(Prepared(scene), P, np.repeat([[0.0, 0, 1]], len(P), 0)).reshape(len(P), -1)[:, 0]


def bent(d, N, eta):
    """The direction behind a surface, by Snell's law, and what passes by Fresnel's equations."""
    c = -d @ N
    out = np.sqrt(max(0, 1 - eta**2 * (1 - c**2)))
    s, p = (eta * c - out) / (eta * c + out), (eta * out - c) / (eta * out + c)
    return eta * d + (eta * c - out) * N, 1 - (s**2 + p**2) / 2


def expected(P, lamp, radius, t, ior, fresnel, centre=(0, 0, 1.5)):
    """What a straight ray through an exact ball of radius 1 counts, from P to a lamp."""
    to = np.array(lamp) - P
    length = np.linalg.norm(to)
    d, off = to / length, P - np.array(centre)
    b = off @ d
    if b**2 - off @ off + 1 <= 0:
        return 1.0
    near, far = -b - np.sqrt(b**2 - off @ off + 1), -b + np.sqrt(b**2 - off @ off + 1)
    inside, first = bent(d, off + near * d, 1 / ior)
    after, second = bent(inside, -(off + far * d), ior)
    left = length - far
    miss = np.linalg.norm(after - d) * left / 2 / max(radius, LEAST * left)
    return t**2 * (first * second if fresnel else 1) * max(0, 1 - miss)


@pytest.mark.parametrize("angle", [0.0, 60.0, 75.0])
def test_a_sheet_dims_as_view_rays(angle):
    """Also where no body of glass is in the scene."""
    a = np.radians(angle)
    sheet = Shape(rectangle((-9, -9), (9, 9), 1.0), glass(fresnel=True), "sheet")
    light, way = sun((np.sin(a), 0, -np.cos(a))), np.array([np.sin(a), 0, -np.cos(a)])
    passed = bent(way, np.array([0.0, 0, 1]), 1 / 1.5)[1]
    assert seen(below([sheet], light)) == pytest.approx(passed, abs=1e-6)
    assert (seen(below([sheet], light, glass_shadows="CLEAR")) == 1).all()


@pytest.mark.parametrize("radius", [0.02, 0.5])
@pytest.mark.parametrize("fresnel", [False, True])
@pytest.mark.parametrize("ior", [1.1, 1.5])
def test_light_through_a_ball_is_what_its_formula_says(ior, fresnel, radius):
    lamp = (0.0, -0.39, 6.0)  # the first spot is in line with the middle of the ball
    got = seen(below([ball(glass(0.9, ior, fresnel=fresnel))], point(lamp, radius=radius)))
    want = [expected(P, lamp, radius, 0.9, ior, fresnel) for P in SPOTS]
    rim = np.abs(np.linalg.norm(SPOTS[:, :2], axis=1) - 1.37) < 0.05  # there facets decide
    np.testing.assert_allclose(got[~rim], np.array(want)[~rim], atol=0.02)
    assert (got == 0).any() or ior < 1.2  # most of the shadow is dark, and its middle is not
    assert got[:3].max() > 0.1


@pytest.mark.parametrize("light", [point((1.5, 0.4, 5.0)), sun((0.5, 0.2, -1), angle=0.0)], ids=["point", "sun"])
@pytest.mark.parametrize("parts", [
    [Shape(box((-2, -2, 0.4), (2, 2, 0.44)), glass(0.9), "pane", [rotate_x(0.3)])],
    [Shape(box((-2, -2, 0.4 + 0.3 * i), (2, 2, 0.5 + 0.3 * i)), glass(0.9 ** 0.5), f"pane {i}") for i in range(2)],
    [Shape(box((-2, -2, -0.5), (2, 2, 0.5)), glass(0.81, 1.33), "water")],  # the floor is in it
], ids=["pane", "panes", "water"])
def test_what_bends_no_light_lets_it_through_as_before(parts, light):
    clear, solid = (seen(below(parts, light, glass_shadows=which)) for which in ("CLEAR", "SOLID"))
    np.testing.assert_allclose(solid, clear, atol=1e-6)
    assert clear.min() > 0.8


@pytest.mark.parametrize("values", [
    {"shadows": "LIGHT_MESHES", "h": 0.05}, {"shadows": "LIGHT_MESHES", "h": 0.05, "softness": "SIZE"},
    {"shadows": "AREA_SAMPLING", "light_samples": 32}], ids=["one width", "lamp shape", "area"])
def test_soft_shadows_have_it_too(values):
    values = dict(values)
    lamp = point((0.0, 0.0, 6.0), radius=0.05, softness=values.pop("softness", "SCENE"))
    clear, solid = (seen(below([ball(glass(0.9))], lamp, glass_shadows=which, **values))
                    for which in ("CLEAR", "SOLID"))
    middle = (SPOTS[:, 0] > 0.45) & (SPOTS[:, 0] < 1.0)
    np.testing.assert_allclose(clear[middle], 0.81, atol=0.01)
    np.testing.assert_array_equal(solid[middle], 0)


def test_faces_that_look_inwards_change_nothing():
    inwards = Shape(sphere(1.0, 64, 32), glass(0.9), "ball", [translate(0, 0, 1.5) @ np.diag([-1.0, 1, 1, 1])])
    mirrored = seen(below([inwards], point((0.2, 0.1, 6.0), radius=0.5)))
    np.testing.assert_allclose(mirrored, seen(below([ball(glass(0.9), 64)], point((0.2, 0.1, 6.0), radius=0.5))),
                               atol=0.02)


@pytest.mark.parametrize("softness", ["SCENE", "SIZE"])
@pytest.mark.parametrize("change", [
    lambda s: replace(s, materials=tuple(replace(m, ior=1.2 if m.ior > 1 else 1.0) for m in s.materials)),
    lambda s: replace(s, lights=(replace(s.lights[0], radius=0.5),)),
    lambda s: s.with_settings(glass_shadows="CLEAR"),
], ids=["index", "lamp", "clear"])
def test_the_next_picture_has_the_bits_of_a_new_one(change, softness):
    first = below([ball(glass(0.9), 24)], point((0.2, 0.1, 6.0), radius=0.2, softness=softness),
                  shadows="LIGHT_MESHES", h=0.1)
    after(first, change(first))


def test_patches_that_return_light_have_it_too():
    """The floor below a ball is darker, so a slope beside it gets less of its light."""
    slope = Shape(rectangle((0, -3), (3, 3), 0.0), GREY, "slope", [translate(1.1, 0, 0) @ rotate_y(-0.9)])
    dark, clear = (render_image(below([ball(glass(0.9), 32), slope], sun((0, 0, -1), angle=0.01), bounces=1, h=0.2,
                                      glass_shadows=which), ("Diffuse Indirect",)).passes["Diffuse Indirect"][:, 26:]
                   .mean() for which in ("SOLID", "CLEAR"))
    assert 0 < dark < 0.9 * clear
