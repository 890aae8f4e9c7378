"""Lamps with a size where something in the scene is glass: nodes answer where it is not in the way."""

import numpy as np
import pytest
from light_meshes import Material, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from scenes import GREY, look_down, point, settings
from sized_lamps import Seen, floor, rmse


def table(pixels=90, **values) -> Scene:
    """A floor with a post, a small ball of glass, and a coloured pane over a corner of it."""
    pane = Material("pane", kd=0.0, kt=(0.5, 0.25, 1.0))
    glass = Material("ball", kd=0.0, kt=(0.9, 0.9, 0.9), ior=1.5)
    shapes = [floor(), Shape(box((-0.5, -0.05, 0), (-0.4, 0.05, 0.8)), GREY, "post"),
              Shape(rectangle((0.4, 0.4), (1.2, 1.2), 0.4), pane, "pane"),
              Shape(sphere(0.15, 32, 16), glass, "ball", [translate(0.5, -0.6, 0.15)])]
    lamp = point((0.8, 0.6, 2.5), radius=0.25, softness="SIZE")
    return Scene.from_shapes(shapes, look_down(0, 0, 2.6, pixels), [lamp],
                             settings(**({"h": 0.02, "kI": 3.0, "shadows": "LIGHT_MESHES"} | values)))


class Colours(Seen):
    """S of all channels."""

    def by(self, shadows, samples=64, **values):
        ready = Prepared(self.ready.scene.with_settings(shadows=shadows, light_samples=samples, seed=1, **values))
        S = ready.shadowing.method(self.at, lambda: None)
        self.counts = ready.stats.counts
        return S.astype(float)


def test_it_is_as_near_as_rays_and_most_receivers_take_none():
    seen = Colours(table())
    truth = seen.by("AREA_SAMPLING", 400)
    assert truth.shape[2] == 3 and np.ptp(truth, axis=2).max() > 0.5  # the pane colours light
    sixteen = rmse(seen.by("AREA_SAMPLING", 16), truth)
    assert rmse(seen.by("LIGHT_MESHES"), truth) <= sixteen
    assert seen.counts["ray_pairs"] < 0.4 * seen.counts["lamp_pairs"]


def test_glass_that_is_far_from_all_ways_changes_no_bit():
    """As if it were opaque."""
    scene = table(h=0.08)

    def with_ball(material: Material) -> Scene:
        ball = Shape(sphere(0.15, 32, 16), material, "ball", [translate(3.5, 3.5, 0.15)])
        return Scene.from_shapes([floor(), Shape(box((-0.5, -0.05, 0), (-0.4, 0.05, 0.8)), GREY, "post"), ball],
                                 scene.camera, list(scene.lights), scene.settings)

    opaque, glass = (render_image(with_ball(m)) for m in (GREY, Material("ball", kd=0.0, kt=(0.9, 0.9, 0.9), ior=1.5)))
    assert np.array_equal(opaque.passes["Combined"], glass.passes["Combined"])
    assert opaque.statistics["ray_pairs"] == glass.statistics["ray_pairs"] < 0.5 * glass.statistics["lamp_pairs"]
    assert 0 < opaque.statistics["nodes"] == glass.statistics["nodes"]


@pytest.mark.parametrize("part", ["pane", "ball"])
def test_behind_glass_rays_answer_as_before(part):
    """Where glass is in the way the shares are those of 16 to 32 rays: near the truth, also at its edges."""
    seen = Colours(table())
    truth, found = seen.by("AREA_SAMPLING", 400), seen.by("LIGHT_MESHES")
    tinted = (np.ptp(truth, axis=2) > 0.02)[:, 0] if part == "pane" else np.hypot(
        seen.P[:, 0] - 0.45, seen.P[:, 1] + 0.7) < 0.35
    assert tinted.sum() > 50 and rmse(found[tinted], truth[tinted]) < 0.03
