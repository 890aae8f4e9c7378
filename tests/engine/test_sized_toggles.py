"""Lamps with a size under the artist's toggles, and through glass: as lamps of one width."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.description import Material
from scenes import GREY, all_lights, four_lights, point, settings, tabletop, with_lights, with_objects
from sized_lamps import Seen, nodes_everywhere, rmse, scene_of  # noqa: F401


def table(pixels=64, **light):
    return all_lights(tabletop(pixels, h=0.05, kI=2.0, ambient=0.0), **({"softness": "SIZE", "radius": 0.3} | light))


def combined(scene):
    return render_image(scene).passes["Combined"][..., :3]


def test_a_lamp_lights_what_it_is_linked_to():
    scene = table()
    only = {o.name: i for i, o in enumerate(scene.objects)}["tabletop"]
    linked, alone = combined(all_lights(scene, receivers=(only,))), combined(scene)
    lit = linked.sum(-1) > 0
    assert 0 < lit.sum() < (alone.sum(-1) > 0).sum()
    assert np.array_equal(linked[lit], alone[lit])


def test_the_shadow_pass_shows_the_share_of_the_lamp():
    scene = table()
    seen = Seen(scene)
    S = seen.by("LIGHT_MESHES")[:, 0]
    shadow = render_image(scene, ("Shadow",)).passes["Shadow"][..., 0].reshape(-1)[seen.pixel]
    assert np.allclose(shadow, S, atol=1e-6) and ((S > 0.05) & (S < 0.95)).mean() > 0.05


def test_a_catcher_is_dimmed_by_the_share_of_the_lamp():
    """What a white matt surface there would lose."""
    scene = scene_of("tabletop", "sphere", 64, h=0.05, ambient=0.0)
    caught = render_image(with_objects(scene, floor={"shadow_catcher": True}).with_settings(film_transparent=True))
    seen = Seen(scene)
    S, alpha = seen.by("LIGHT_MESHES")[:, 0], caught.passes["Combined"][..., 3].reshape(-1)[seen.pixel]
    shadow = (alpha > 0.5).mean()
    assert np.allclose(alpha, 1 - S, atol=1e-5) and 0.05 < shadow < 0.5


def test_a_holdout_is_a_hole_that_casts_its_soft_shadow():
    scene = table()
    hole = with_objects(scene, cylinder={"holdout": True})
    a, b = render_image(scene).passes["Combined"], render_image(hole).passes["Combined"]
    there = b[..., 3] == 0
    assert there.any() and (b[there, :3] == 0).all() and np.array_equal(a[~there], b[~there])


def test_a_lamp_without_shadows_and_one_with_sharp_ones():
    lit = combined(table(cast_shadow=False))
    assert np.array_equal(lit, combined(table().with_settings(mode="LOCAL")))
    hard = combined(table(soft_shadows=False))
    assert np.array_equal(hard, combined(table().with_settings(shadows="SHARP")))


def pane(refraction, pixels=48, **values):
    """A pane of coloured glass, half of a lamp's light, above a floor, with a ball of glass on it."""
    glass = Material("pane", kd=0.0, kt=(0.5, 0.25, 1.0))
    solid = Material("ball", kd=0.0, kt=(0.9, 0.9, 0.9), ior=1.5)
    parts = [Shape(rectangle((-2, -2), (2, 2), 0.0), GREY, "floor"),
             Shape(rectangle((-2, -2), (0, 2), 0.8), glass, "pane"),
             Shape(box((0.3, -0.2, 0.2), (0.6, 0.2, 0.5)), GREY, "box"),
             Shape(sphere(0.2, 24, 12), solid, "ball", [translate(0.9, 0.9, 0.3)])]
    lamp = replace(point((0.0, 0.0, 2.0)), radius=0.3, softness="SIZE")
    return Scene.from_shapes(parts, Camera.look_at((0, -4, 4), (0, 0, 0), 40, pixels, pixels), [lamp],
                             settings(**({"h": 0.08, "kI": 2.0, "refraction": refraction, "shadows": "LIGHT_MESHES"}
                                         | values)))


@pytest.mark.parametrize("refraction", ["NONE", "VIEW"])
def test_each_point_of_a_lamp_counts_by_the_glass_on_its_way(refraction):
    """M1 and M2: under the edge of a pane a lamp is half tinted, as by very many rays and by the exact share."""
    scene = pane(refraction)
    ready = Prepared(scene)
    x = np.linspace(-0.35, 0.3, 46)
    P, N = np.stack([x, np.full(46, -1.2), np.zeros(46)], 1), np.tile([0.0, 0.0, 1.0], (46, 1))
    S = ready.lighting.light_visibility(P, N)[:, 0].astype(float)
    truth = Prepared(scene.with_settings(shadows="AREA_SAMPLING", light_samples=1024)).lighting.light_visibility(P, N)
    sixteen = Prepared(scene.with_settings(shadows="AREA_SAMPLING", light_samples=16)).lighting.light_visibility(P, N)
    assert S.shape == (46, 3) and rmse(S, truth[:, 0]) <= rmse(sixteen[:, 0], truth[:, 0])
    through = (S - (0.5, 0.25, 1.0)) / (0.5, 0.75, 1e30)  # of the lamp beside the pane
    assert np.allclose(through[:, 0], through[:, 1], atol=1e-6) and (S[:, 2] == 1).all()
    assert through[0, 0] < 0.01 and through[-1, 0] > 0.99 and (np.abs(through[:, 0] - 0.5) < 0.4).sum() > 5


def test_where_shadow_paths_bend_a_lamp_keeps_its_shape_and_the_plan_says_so():
    """M3: the shadow is that of a ball that lets nothing through, as by very many rays; what it bends is added."""
    scene = pane("FULL", caustics="FOCUS")
    told = render_image(scene).statistics
    assert told["plan"]["refracted shadow paths"].startswith("yes") and told["refracted_paths"] > 0
    assert "light that glass bends comes from the lamp's centre" in told["plan"]["lamps with a size"]
    x, y = np.meshgrid(np.linspace(0.2, 1.8, 40), np.linspace(0.2, 1.8, 40))
    P = np.stack([x.ravel(), y.ravel(), np.zeros(1600)], 1)
    N = np.tile([0.0, 0.0, 1.0], (1600, 1))
    dark = replace(scene, materials=tuple(replace(m, kt=(0.0,) * 3, ior=1.0) if m.name == "ball" else m
                                          for m in scene.materials))

    def seen(of, **values):
        return Prepared(of.with_settings(**values)).lighting.light_visibility(P, N)[:, 0].astype(float)

    bent, opaque = seen(scene), seen(dark)
    truth = seen(dark, shadows="AREA_SAMPLING", light_samples=1024)
    assert rmse(opaque, truth) <= rmse(seen(dark, shadows="AREA_SAMPLING", light_samples=16), truth)
    more = bent - opaque
    assert more.min() > -1e-6 and more.max() > 2  # a focus, and nowhere less light
    centre = seen(scene, shadows="SHARP") - seen(dark, shadows="SHARP")  # the paths alone, from the lamp's centre
    assert np.allclose(more, centre, atol=1e-5)
    assert (np.abs(more) < 1e-6).all(1).mean() > 0.3  # far from the ball: the same shadows
    middle = (opaque[:, 0] > 0.1) & (opaque[:, 0] < 0.9)
    assert middle.sum() > 50  # the edge is as soft as the lamp is large


def test_a_snapshot_renders_the_same(tmp_path):
    """As a farm's machine does."""
    scene = with_lights(four_lights(48), *(replace(light, softness="SIZE", radius=0.2, angle=0.1)
                                           for light in four_lights().lights))
    snapshot.write(scene, tmp_path)
    assert np.array_equal(combined(scene), combined(snapshot.read(tmp_path)))


WIDE = {"a fixture inside the sphere": {"position": (0.8, 0.6, 1.8), "radius": 0.25},
        "a fixture inside the disc": {"position": (0.8, 0.6, 1.8), "radius": 0.25, "facing_disc": True},
        "all is inside the sphere": {"position": (0.0, 0.0, 1.8), "radius": 30.0},
        "a disc beyond the horizon": {"position": (0.0, 0.0, 1.8), "radius": 30.0, "facing_disc": True},
        "half of the sky": {"type": "SUN", "direction": (0.5, 0.3, -0.81), "angle": 3.1}}


@pytest.mark.parametrize("name", WIDE)
def test_lamps_that_are_near_or_wide_are_seen_as_cycles_samples_them(name):
    """A sphere's light starts at its front, and all directions in which a lamp is seen count alike: as by 512 rays of
    area sampling, as near as by 16. What is inside a sphere casts no shadow; what is behind a disc's middle does."""
    shell = Shape(box((0.7, 0.5, 1.7), (0.9, 0.7, 1.9)), GREY, "fixture")
    parts = [Shape(rectangle((-4, -4), (4, 4), 0.0), GREY, "floor"), Shape(sphere(0.2), GREY, "ball",
             [translate(0.4, 0.1, 0.35)]), *([shell] if "fixture" in name else [])]
    lamp = replace(point((0.0, 0.0, 1.0)), softness="SIZE", **WIDE[name])
    seen = Seen(Scene.from_shapes(parts, Camera.look_at((0, -2.4, 2.2), (0, 0, 0.2), 40, 48, 48), [lamp],
                                  settings(h=0.05, kI=2.0, shadows="LIGHT_MESHES")))
    truth, sixteen, found = (seen.by(*way)[:, 0] for way in (("AREA_SAMPLING", 512), ("AREA_SAMPLING", 16),
                                                             ("LIGHT_MESHES",)))
    assert rmse(found, truth) <= 1.1 * rmse(sixteen, truth)
    assert np.ptp(truth) > 0.2 and abs((found - truth).mean()) < 0.01
    if name == "a fixture inside the sphere":
        assert found.max() == 1
