"""Rough surfaces that show matt ones by the light of patches: near what lighting each hit gives, else exact."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Light, Material, Scene, Settings, Shape, box, rectangle, sphere, translate
from light_meshes.picture.render import render_image

RED, GREEN = Material("red", Od=(0.8, 0.2, 0.1)), Material("green", Od=(0.2, 0.7, 0.2))
GLOSSY = Material("glossy", Od=(0.5, 0.5, 0.5), highlight="GGX", blurred=True, dielectric=1.0, layered=1.0,
                  roughness=0.5)
CLOTH = Material("cloth", Od=(0.3, 0.1, 0.1), highlight="GGX", blurred=True, sheen=0.6, sheen_roughness=0.4)


def metal(roughness):
    return Material("metal", Od=(0, 0, 0), kd=0.0, highlight="GGX", blurred=True, metal=1.0, F0=(0.9, 0.8, 0.7),
                    roughness=roughness)


def room(roughness, fast, wall=RED, **values):
    """A floor of rough metal before two walls and a ball, under an area lamp and a grey sky."""
    shapes = [Shape(rectangle((-3, -3), (3, 3)), metal(roughness), "floor"),
              Shape(box((-3, 1, 0), (3, 1.2, 3)), wall, "wall"), Shape(box((-2, -1, 0), (-1.8, 1, 2)), GREEN, "side"),
              Shape(sphere(0.4, 32, 16), wall, "ball", matrices=[translate(0.6, 0.2, 0.4)])]
    lamp = Light("lamp", "AREA", (3.0,) * 3, (1.0, -1.0, 2.8), (0.0, 0.0, -1.0), softness="SIZE",
                 area_u=(0.5, 0.0, 0.0), area_v=(0.0, -0.5, 0.0))
    chosen = Settings(mode="WHITTED", samples=4, world_light="SKY", bounces=1, auto_h=True, fast_reflections=fast)
    return Scene.from_shapes(shapes, Camera.look_at((0, -3, 1.5), (0, 0, 0.3), 50, 40, 30), [lamp],
                             replace(chosen, **values), world_color=(0.2, 0.2, 0.25))


def seen(scene, **more):
    passes = render_image(scene, ("Combined", "Glossy", "Object Index"), **more).passes
    return passes["Combined"][..., :3].astype(float), passes["Glossy"][..., :3].astype(float)


@pytest.mark.parametrize(("wall", "median", "most"), [(RED, 0.01, 0.03), (GLOSSY, 0.03, 0.1), (CLOTH, 0.04, 0.08)],
                         ids=lambda m: getattr(m, "name", ""))
@pytest.mark.parametrize("roughness", [0.2, 0.5])
def test_reflections_are_near_those_that_are_lit_one_by_one(roughness, wall, median, most):
    """What is matt is nearly the same; highlights and sheen are spread out."""
    (_, slow), (_, fast) = (seen(room(roughness, fast, wall)) for fast in (False, True))
    rows = slow.sum(2) > 0.05
    error = np.abs(fast - slow).sum(2)[rows] / slow.sum(2)[rows]
    assert rows.sum() > 400 and (fast != slow).any()
    assert np.median(error) < median and np.percentile(error, 95) < most
    assert abs(fast[rows].mean() / slow[rows].mean() - 1) < 0.03


def test_it_depends_on_neither_tiles_nor_threads():
    scene = room(0.4, True)
    one, _ = seen(scene, threads=1)
    other, _ = seen(scene, threads=2, tile_size=16)
    np.testing.assert_array_equal(one, other)


def test_mirrors_and_what_metals_show_of_metals_are_as_before():
    """A mirror sees surfaces in full, and so does the picture where no light comes from everywhere."""
    for values in ({"roughness": 0.0}, {"roughness": 0.4, "world_light": "AMBIENT", "bounces": 0}):
        slow, fast = (seen(room(fast=fast, **values))[0] for fast in (False, True))
        np.testing.assert_array_equal(slow, fast)


def test_the_plan_says_it():
    plan = render_image(room(0.4, True)).statistics["plan"]
    assert plan["rough reflections"].startswith("patches")
    assert not render_image(room(0.4, False)).statistics["plan"]["rough reflections"].startswith("patches")
