"""Rays to points of lamps: the kernel that makes and traces them gives the same bits as arrays do (point_rays.py)."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Material, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.picture.render import render_image
from light_meshes.rays.tracer import Tracer
from light_meshes.shadows.point_rays import PointRays
from scenes import GREY, point, settings


def scene(glass, smooth):
    """A box and a ball on a floor under a wide lamp; the ball smooth, so that its receivers are lifted, or beside it a
    pane of coloured glass and a glass ball.
    """
    parts = [Shape(rectangle((-2, -2), (2, 2), 0.0), GREY, "floor"),
             Shape(box((-0.5, -0.2, 0.0), (-0.2, 0.2, 0.4)), GREY, "box")]
    if smooth:
        parts.append(Shape(sphere(0.4, 16, 8), GREY, "smooth ball", [translate(0.3, -0.6, 0.4)],
                           flags={"shadow_terminator_geometry_offset": 0.1}))
    if glass:
        pane, solid = Material("pane", kd=0.0, kt=(0.5, 0.25, 1.0)), Material("ball", kd=0.0, kt=(0.9,) * 3, ior=1.5)
        parts += [Shape(rectangle((-2, -2), (0, 2), 0.8), pane, "pane"),
                  Shape(sphere(0.2, 24, 12), solid, "ball", [translate(0.9, 0.9, 0.3)])]
    lamp = replace(point((0.2, -0.3, 2.0)), radius=0.5, softness="SIZE")
    return Scene.from_shapes(parts, Camera.look_at((0, -4, 4), (0, 0, 0), 40, 40, 40), [lamp],
                             settings(h=0.02, kI=2.0, refraction="VIEW", shadows="LIGHT_MESHES", samples=2))


@pytest.mark.parametrize(("glass", "smooth"), [(False, True), (True, False), (True, True)])
def test_the_kernel_gives_the_bits_of_arrays(monkeypatch, glass, smooth):
    """With glass it answers for the pairs whose rays meet none; some do, and some do not."""
    alone = []
    past = PointRays._past_glass

    def counted(*arguments):
        alone.append(past(*arguments))
        return alone[-1]

    monkeypatch.setattr(PointRays, "_past_glass", counted)
    fast = render_image(scene(glass, smooth), threads=1)
    assert fast.statistics["ray_pairs"] > 200
    if glass:
        share = np.concatenate(alone).mean()
        assert 0.2 < share < 0.98
    monkeypatch.setattr(Tracer, "field", lambda *arguments: None)
    slow = render_image(scene(glass, smooth), threads=1)
    np.testing.assert_array_equal(fast.passes["Combined"], slow.passes["Combined"])
