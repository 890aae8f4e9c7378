"""Rough reflections: their sum is that of the lobe, their directions are those of microfacets; all else stays.

Beside Cycles: tests/peers/test_reflections.py.
"""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.picture import reflections
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Material
from scenes import combined, four_lights, point, settings, tabletop

WHITE = (1.0, 1.0, 1.0)
PASSES = ("Combined", "Glossy", "Ambient", "Environment", "Diffuse", "Emission", "Transmission")


def metal(**values):
    return replace(Material("metal", Od=(0, 0, 0), ka=0.0, kd=0.0, highlight="GGX", blurred=True, metal=1.0), **values)


def plastic(**values):
    return replace(Material("plastic", Od=WHITE, highlight="GGX", blurred=True, dielectric=1.0, layered=1.0), **values)


def one_pixel(material, cosine, *others, **values):
    """The radiance of a floor to an eye at this cosine, which sees one point of it in a white sky; others: shapes."""
    eye = 100 * np.array([np.sqrt(1 - cosine * cosine), 0.0, cosine])
    scene = Scene.from_shapes([Shape(rectangle((-1, -1), (1, 1), 0.0), material, "floor"), *others],
                              Camera.look_at(tuple(eye), (0, 0, 0), 1e-3, 1, 1), [],
                              settings(**({"mode": "WHITTED", "samples": 64} | values)), world_color=WHITE)
    return render_image(scene).passes["Combined"][0, 0, :3].astype(float)


@pytest.mark.parametrize("cosine", [0.15, 0.5, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.3, 0.6, 1.0])
def test_in_a_white_world_nothing_is_seen(roughness, cosine):
    """A metal that reflects everything, and a plastic on white: what comes back is what arrives."""
    assert one_pixel(metal(roughness=roughness), cosine) == pytest.approx(1, abs=0.015)
    assert one_pixel(plastic(roughness=roughness), cosine) == pytest.approx(1, abs=0.03)
    tinted = metal(roughness=roughness, F0=(0.2, 0.5, 0.9))
    assert one_pixel(tinted, cosine, mode="RAY_CASTING") == pytest.approx(one_pixel(tinted, cosine), abs=0.025)


def test_rough_glass_passes_what_clear_glass_passes():
    """From above, a pane in a white world, which is not seen, and the middle of a wide lamp behind it."""
    def seen(roughness, lights):
        pane = Material("glass", Od=(0, 0, 0), ka=0.0, kd=0.0, kt=WHITE, ior=1.45, fresnel=True, frosted=roughness)
        scene = Scene.from_shapes([Shape(box((-9, -9, -0.5), (9, 9, 0.0)), pane, "pane")],
                                  Camera.look_at((0, 0, 100), (0, 0, 0), 1e-3, 1, 1), lights,
                                  settings(mode="WHITTED", samples=16), world_color=WHITE)
        return render_image(scene).passes["Combined"][0, 0, :3].astype(float)

    bulb = replace(point((0, 0, -3), name="bulb"), softness="SIZE", radius=0.5, seen_in_glass=True)
    for lights in [], [bulb]:
        clear = seen(0.0, lights)
        assert clear.min() > (20 if lights else 0.99)
        np.testing.assert_allclose(seen(0.1, lights), clear, rtol=0.01)


def test_ambient_counts_only_where_the_world_is_ambient_light():
    """Without rays a metal reflects the world; with the sky as light, as much of it as there is."""
    metals = [one_pixel(metal(roughness=0.3), 0.5, mode="RAY_CASTING", **values) for values in (
        {}, {"world_light": "SKY", "ambient": 0.0}, {"ambient": 0.0})]
    assert metals[0].all() and np.array_equal(metals[0], metals[1]) and not metals[2].any()


def reflected(roughness, cosine, low, count=400):
    """Which share of a rough mirror's reflection comes from where x < low·z, by a grid of facets."""
    a = roughness**2
    V = np.array([np.sqrt(1 - cosine * cosine), 0.0, cosine])
    theta = np.arctan(a * np.tan(np.pi / 2 * (np.arange(count) + 0.5) / count))  # finer where the facets are
    phi = 2 * np.pi * (np.arange(count) + 0.5) / count
    t, p = np.meshgrid(theta, phi, indexing="ij")
    H = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1)
    L = 2 * (H @ V)[..., None] * H - V
    c2 = np.cos(t) ** 2
    D = a * a / (np.pi * (c2 * (a * a - 1) + 1) ** 2)
    masked = [np.sqrt(1 + a * a * (1 / np.maximum(x, 1e-9) ** 2 - 1)) for x in (L[..., 2], cosine)]
    G = 2 / (masked[0] + masked[1])
    width = np.gradient(theta)[:, None]
    part = np.where((L[..., 2] > 0) & (H @ V > 0), D * G * (H @ V) * np.sin(t) * width / cosine, 0)
    return part[L[..., 0] < low * L[..., 2]].sum() / part.sum()


@pytest.mark.parametrize(("roughness", "cosine", "low"), [(0.3, 0.8, -0.75), (0.5, 0.8, -0.3), (0.7, 0.5, 0.5),
                                                          (1.0, 0.9, 0.0)])
def test_a_rough_mirror_sees_as_much_as_its_lobe(roughness, cosine, low):
    """A black ceiling hides all that is above one side of a line."""
    black = Material("black", Od=(0, 0, 0), ka=0.0, kd=0.0)
    wall = Shape(rectangle((-500, -500), (low, 500), 1.0), black, "ceiling", flags={"visible_camera": False})
    mirror = metal(roughness=roughness, compensation=0.0)
    seen, alone = one_pixel(mirror, cosine, wall, samples=256), one_pixel(mirror, cosine, samples=256)
    assert seen[0] / alone[0] == pytest.approx(1 - reflected(roughness, cosine, low), abs=0.015)


@pytest.fixture(scope="module")
def still_life():
    scene = four_lights(48, mode="WHITTED", samples=3, filter_size=1.5)
    materials = [replace(m, highlight="GGX", blurred=True, roughness=r, metal=1.0, F0=(0.8, 0.6, 0.3), kd=0.0, ka=0.0)
                 for m, r in zip(scene.materials, (0.4, 0.2, 0.7, 0.05, 0.5), strict=False)]
    return replace(scene, materials=(*materials, *scene.materials[len(materials):]), world_color=(0.2, 0.3, 0.5))


def test_tiles_and_threads_give_the_same_bits(still_life, monkeypatch):
    from light_meshes.picture import integrator

    first = render_image(still_life, PASSES, threads=1)
    monkeypatch.setattr(integrator, "PIECE", 1000)
    again = render_image(still_life, PASSES, threads=2, tile_size=7)
    for name in PASSES:
        np.testing.assert_array_equal(first.passes[name], again.passes[name], err_msg=name)
    total = sum(first.passes[name] for name in PASSES[1:])
    np.testing.assert_allclose(total, first.passes["Combined"][..., :3], atol=1e-5)
    assert first.statistics["plan"]["rough reflections"].startswith("rays")


def test_fewer_rays_show_the_same_less_evenly(still_life):
    """What `reflection_rays` saves, and what it costs: the picture is the same in the mean, and near it everywhere."""
    many, few = (render_image(still_life.with_settings(reflection_rays=n)) for n in (128, 24))
    assert few.statistics["secondary_rays"] < 0.4 * many.statistics["secondary_rays"]
    a, b = (r.passes["Combined"][..., :3] for r in (many, few))
    assert b.mean() == pytest.approx(a.mean(), rel=0.01)
    assert 0 < np.percentile(abs(a - b), 95) < 0.1 * a.mean()


def test_hits_whose_lobes_are_widened_alike_share_a_row(still_life):
    """And those that have a row of their own already, of a program, keep it: tables of many columns cost time."""
    m = Prepared(still_life).world.materials
    row, rows = np.array([0, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1, 1], np.int32), np.arange(1, 12)
    m = type(m)._make(column[:3] for column in m)
    dark = np.zeros(11, np.bool_)
    table, own, at = reflections._own_rows(m, row, rows, np.full(11, 0.5), dark)
    assert len(table.ka) == 3 + 2 and own[0] == 0 and np.array_equal(own[rows], at)
    for name, column in zip(m._fields, m, strict=True):
        np.testing.assert_array_equal(getattr(table, name)[own], column[row], err_msg=name)
    apart, _, at = reflections._own_rows(m, row, rows, None, dark)
    assert len(apart.ka) == 3 + 11 and len(np.unique(at)) == 11
    alone, own, at = reflections._own_rows(m, np.arange(3, dtype=np.int32), np.array([0, 2]), None, dark[:2])
    assert len(alone.ka) == 3 and at.tolist() == [0, 2]
    alone.roughness[at] = 0.77
    assert not (m.roughness == 0.77).any()


def test_matt_surfaces_and_mirrors_send_no_more_rays():
    scene = tabletop(32)
    assert not Prepared(scene).plan.blurred
    matt = plastic(roughness=0.5, Od=(0.8, 0.8, 0.8))
    one = [Shape(sphere(1.0, 24, 12), matt, "ball"),
           Shape(box((-1, -1, -1), (1, 1, 1)), matt, "box", [translate(0, 3, 0)])]
    view = Camera.look_at((0, -3, 6), (0, 0, 0), 40, 24, 24)
    result = render_image(Scene.from_shapes(one, view, [], settings(mode="WHITTED"), world_color=WHITE))
    # Where a plastic is not seen from aside its reflection is faint.
    assert result.statistics["secondary_rays"] < 0.5 * result.statistics["camera_rays"] * 32
    assert result.passes["Combined"][12, 12, 0] > 0.7


def test_a_lamps_stand_in_is_not_seen_twice():
    """A surface that became a lamp gives its highlight as a lamp, and not once more by the rays that find it."""
    glowing = Material("glow", Od=(0, 0, 0), kd=0.0, ka=0.0, emission=(5.0, 5.0, 5.0))
    shapes = [Shape(rectangle((-9, -9), (9, 9), 0.0), metal(roughness=0.5), "floor"),
              Shape(rectangle((-1, -1), (1, 1), 3.0, ), glowing, "glow")]
    view = Camera.look_at((0, -6, 3), (0, 0, 0), 30, 16, 16)
    scene = Scene.from_shapes(shapes, view, [], settings(mode="WHITTED", samples=8))
    by_rays = render_image(scene).passes["Combined"][..., :3].mean()
    ready = Prepared(scene.with_settings(bounces=1))
    assert ready.world.as_lamps is not None and ready.world.as_lamps.any()
    by_lamp = render_image(scene.with_settings(bounces=1, shadows="SHARP")).passes["Combined"][..., :3].mean()
    assert by_lamp == pytest.approx(by_rays, rel=0.25)
    smooth, mirror = metal(roughness=0.0), replace(glowing, emission=(0.0,) * 3, mirror=WHITE)
    seen = [combined(replace(scene, materials=(m, *scene.materials[1:])).with_settings(bounces=1))
            for m in (smooth, mirror)]
    np.testing.assert_allclose(*seen, rtol=1e-4, atol=1e-6)
