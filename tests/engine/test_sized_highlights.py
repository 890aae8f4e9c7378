"""Highlights of wide lamps that are hidden in part: what is left is the part of the lamp that the lobe mirrors."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Light, Material, Scene, Shape, box, rectangle, sphere
from light_meshes.picture.render import render_image
from scenes import combined, settings
from sized_lamps import rmse

WINDOW = Light("window", "AREA", (20.0,) * 3, position=(-1.5, 0.0, 1.2), direction=(1.0, 0.0, 0.0), softness="SIZE",
               area_u=(0.0, 1.2, 0.0), area_v=(0.0, 0.0, 0.7))
SUN = Light("sun", "SUN", (3.0,) * 3, direction=(0.8, 0.0, -0.5), angle=0.5, softness="SIZE")


def beside_a_wall(roughness, lamp, pixels=48):
    """A metal floor, half of which is behind a wall from the lamp."""
    metal = Material("metal", Od=(0.0,) * 3, highlight="GGX", roughness=roughness, metal=1.0, F0=(0.9,) * 3)
    shapes = [Shape(rectangle((-4, -4), (4, 4)), metal), Shape(box((-0.1, -4, 0), (0, 0, 1.2)), Material("wall"))]
    return Scene.from_shapes(shapes, Camera.look_at((3.5, 0, 1.6), (0.6, 0, 0), 40, pixels, pixels), [lamp],
                             settings(h=0.03, kI=3.0, shadows="LIGHT_MESHES", samples=4))


def in_parts(scene, n=12):
    """The same window as n² small ones, each with the sharp shadows of its middle."""
    lamp, parts = scene.lights[0], []
    centre, u, v = (np.array(a) for a in (lamp.position, lamp.area_u, lamp.area_v))
    for i in range(n * n):
        a, b = (2 * (k + 0.5) / n - 1 for k in divmod(i, n))
        parts.append(replace(lamp, name=str(i), position=tuple(centre + a * u + b * v), area_u=tuple(u / n),
                             area_v=tuple(v / n), intensity=tuple(c / n**2 for c in lamp.intensity)))
    return replace(scene, lights=tuple(parts)).with_settings(shadows="SHARP")


@pytest.mark.parametrize("roughness", [0.2, 0.4])
def test_a_window_mirrored_beside_a_wall(roughness):
    """As a window of 144 parts; with one share of all of it the error was half of the mean and more."""
    scene = beside_a_wall(roughness, WINDOW)
    truth = combined(in_parts(scene))
    assert rmse(combined(scene), truth) < 0.15 * truth.mean()


def test_the_mirrored_part_of_a_sun_is_behind_the_wall_or_not():
    """Where the wall hides the mirrored middle of a wide sun from a nearly smooth floor the highlight is dark, also
    where most of the sun lights it: beside rays to 200 points of the sun, each counted by the lobe."""
    scene = beside_a_wall(0.2, SUN)
    axis, parts = -np.array(SUN.direction) / np.linalg.norm(SUN.direction), []
    e = np.cross(axis, (0.0, 1.0, 0.0)) / np.linalg.norm(np.cross(axis, (0.0, 1.0, 0.0)))
    f, count = np.cross(axis, e), 200
    for k in range(count):
        far, turn = np.tan(SUN.angle / 2) * np.sqrt((k + 0.5) / count), 2.399963 * k
        way = axis + far * (np.cos(turn) * e + np.sin(turn) * f)
        parts.append(replace(SUN, name=str(k), direction=tuple(-way / np.linalg.norm(way)), angle=0.0,
                             intensity=tuple(c / count for c in SUN.intensity)))
    truth = combined(replace(scene, lights=tuple(parts)).with_settings(shadows="SHARP"))
    assert rmse(combined(scene), truth) < 0.15 * truth.mean()


def test_a_matt_floor_has_no_such_rays_and_a_rough_one_few():
    scene = beside_a_wall(0.2, WINDOW)
    matt = replace(scene, materials=tuple(replace(m, highlight="PHONG", Od=(0.8,) * 3) for m in scene.materials))
    rough = replace(scene, materials=tuple(replace(m, roughness=1.0) for m in scene.materials))
    counts = [render_image(one).statistics["shadow_rays"] for one in (matt, rough, scene)]
    assert counts[0] < counts[1] < counts[2] and counts[1] < 1.05 * counts[0]


def test_a_ball_of_chrome_shows_a_lamp_once():
    """Highlights of curved surfaces are widened where samples would miss them, but not those of lamps that a smooth
    surface mirrors as they are: these were seen twice. A coat is such a surface, too.
    """
    lamp = replace(WINDOW, position=(1.0, -3.0, 2.0), direction=(-0.3, 0.8, -0.5), seen_in_mirrors=True)
    black = Material("black", Od=(0.0,) * 3, kd=0.0, ka=0.0)
    facets = replace(black, highlight="GGX", blurred=True, roughness=0.0)

    def seen(material, pixels):
        scene = Scene.from_shapes([Shape(sphere(0.5, 96, 48), material, "ball")],
                                  Camera.look_at((0, -4, 0.5), (0, 0, 0), 20, pixels, pixels), [lamp],
                                  settings(mode="WHITTED", shadows="LIGHT_MESHES", samples=4, filter_size=1.5))
        return combined(scene)

    mirrored = seen(replace(black, mirror=(1.0,) * 3), 16)
    np.testing.assert_allclose(seen(replace(facets, metal=1.0), 16), mirrored, rtol=1e-3, atol=1e-6)
    coated = seen(replace(facets, coat=1.0), 16)
    assert coated.max() == pytest.approx(0.04 * mirrored.max(), rel=0.1)
    assert seen(replace(facets, roughness=0.2, metal=1.0), 16).max() > 0.2 * mirrored.max()  # no mirror: a highlight
