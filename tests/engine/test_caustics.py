"""Refracted shadow paths in the picture (paper §5): eq. (6), its leak-free form, the energy of FOCUS."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.picture.render import Prepared, render_image
from light_meshes.scene.description import Material
from refraction_reference import sphere_roots
from scenes import GREY, look_down, point, settings
from visible import visibility

CENTRE, RADIUS, INDEX, T = np.array([0, 0, 0.9]), 0.6, 1.5, 0.95  # S5
LIGHT = np.array([0.8, -0.6, 4.2])


def glass(t=T, ior=INDEX, **more):
    return Material("glass", Od=(0, 0, 0), ka=0.0, kd=0.0, kt=(t, t, t), ior=ior, **more)


def lens(material, width=64, rings=48, **values):
    """S5 (Fig. 5)."""
    parts = [Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor"),
             Shape(sphere(RADIUS, 2 * rings, rings), material, "lens", [translate(*CENTRE)]),
             Shape(sphere(0.3, 32, 16), Material("red", Od=(0.7, 0.2, 0.1)), "ball", [translate(-0.9, 0.4, 0.3)])]
    values = {"refraction": "FULL", "max_depth": 8, "h": 0.05, "kI": 3.0} | values
    return Scene.from_shapes(parts, Camera.look_at((2.6, -4.2, 2.6), (-0.2, 0, 0.5), 36, width, width),
                             [point(LIGHT, 20.0)], settings(mode="WHITTED", **values))


def on_the_floor(scene, half=1.5, cells=200):
    """Light on a square of the floor from a source of 1 W/sr: Σ S·cos/d² over cells, and a cell's area."""
    x = (np.arange(cells) + 0.5) / cells * 2 * half - half
    P = np.stack([*np.meshgrid(x, x), np.zeros((cells, cells))], -1).reshape(-1, 3)
    S = visibility(Prepared(scene), P, np.repeat([[0.0, 0, 1]], len(P), 0)).reshape(-1).astype(float)
    v = LIGHT - P
    return (S * v[:, 2] / (v**2).sum(1) ** 1.5).sum() * (2 * half / cells) ** 2


def photons(count, half=1.5):
    """The share of 1 W/sr that the exact sphere sends to that square: photons bent twice by Snell's law."""
    axis = CENTRE - LIGHT
    distance = np.linalg.norm(axis)
    axis /= distance
    side = np.cross(axis, [1, 0, 0]) / np.linalg.norm(np.cross(axis, [1, 0, 0]))
    edge = np.sqrt(1 - (RADIUS / distance) ** 2)
    random = np.random.default_rng(1)
    landed = 0
    for _ in range(count // 10**6):
        c = 1 - random.random(10**6) * (1 - edge)
        phi = 2 * np.pi * random.random(10**6)
        s = np.sqrt(1 - c * c)
        D = c[:, None] * axis + (s * np.cos(phi))[:, None] * side + (s * np.sin(phi))[:, None] * np.cross(axis, side)
        along = D @ (CENTRE - LIGHT)
        inside = RADIUS**2 - distance**2 + along**2
        D, along, inside = D[inside > 0], along[inside > 0], inside[inside > 0]
        P = LIGHT + (along - np.sqrt(inside))[:, None] * D
        D = bent(D, (P - CENTRE) / RADIUS, 1 / INDEX)
        P = P - 2 * (D * (P - CENTRE)).sum(1)[:, None] * D
        D = bent(D, (CENTRE - P) / RADIUS, INDEX)
        D, P = D[D[:, 2] < 0], P[D[:, 2] < 0]
        floor = P - (P[:, 2] / D[:, 2])[:, None] * D
        landed += (np.abs(floor[:, :2]) < half).all(1).sum()
    return landed / count * 2 * np.pi * (1 - edge) * T**2


def bent(D, N, eta):
    cosine = -(D * N).sum(1)
    return eta * D + (eta * cosine - np.sqrt(np.maximum(1 - eta**2 * (1 - cosine**2), 0)))[:, None] * N


@pytest.mark.slow
def test_the_lens_sends_as_much_light_to_the_floor_as_photons_bring():
    """FOCUS within 5 %. The clamp (footprint h/2) and the lattice lose more the coarser h is."""
    def through(h, kI):
        values = {"h": h, "kI": kI, "caustics": "FOCUS"}
        scene = lens(glass(), **values)
        bare = replace(scene, objects=tuple(replace(o, visible_shadow=o.name != "ball") for o in scene.objects))
        blocked = replace(bare, materials=tuple(replace(m, kt=(0, 0, 0)) for m in bare.materials))
        return on_the_floor(bare) - on_the_floor(blocked)

    expected = photons(2 * 10**6)
    fine, coarse = through(0.0125, 8.0) / expected, through(0.05, 3.0) / expected
    print(f"of 2·10⁶ photons' light: {fine:.1%} with h = .0125, {coarse:.1%} with h = .05")
    assert fine == pytest.approx(1, rel=0.05)
    assert 0.85 < coarse < 1


def test_soft_shadows_are_the_mean_of_the_nodes_paths():
    """M3 under a unit sphere, light 4 above its middle: S is the mean over DLM(P) of V + t²·(paths by root finding)."""
    segments, t = 144, 0.9
    ball = sphere(1.0, segments, segments // 2)
    scene = Scene.from_shapes([Shape(rectangle((-4, -4), (4, 4), -1.5), GREY, "floor"), Shape(ball, glass(t), "ball")],
                              look_down(0, 0, 4, 8), [point((0, 0, 4))], settings(refraction="FULL", h=0.1, kI=2.0))
    ready = Prepared(scene)
    random = np.random.default_rng(5)
    P = np.c_[random.uniform(-2.2, 2.2, (1000, 2)), np.full(1000, -1.5)]
    N = np.repeat([[0.0, 0, 1]], len(P), 0)
    start, nodes = ready.soft.interpolation_set(P, N)
    x = ready.soft.lattice.position(nodes)
    across = np.hypot(x[:, 0], x[:, 1])
    row, phi = sphere_roots(np.stack([across, x[:, 2]], 1), 4.0, INDEX, 4000)
    off_axis = np.arctan2(across, 4 - x[:, 2]) - np.arcsin(1 / 4)  # of the straight way, from the sphere's limb
    v = (off_axis > 0) + t**2 * np.bincount(row, minlength=len(x))
    edge = 2 * np.pi / segments
    unsure = abs(off_axis) < edge / 4
    unsure[row[np.arccos(1 / 4) - abs(phi) < edge]] = True  # where the mesh ends before the sphere does
    expected = np.add.reduceat(v, start[:-1]) / np.diff(start)
    sure = np.add.reduceat(unsure.astype(int), start[:-1]) == 0
    assert sure.sum() > 100 and (v[~unsure] > 1.5).any() and np.unique(expected[sure]).size > 20
    np.testing.assert_allclose(visibility(ready, P, N).reshape(-1)[sure], expected[sure], rtol=1e-6)


def test_the_lens_makes_a_bright_spot_in_its_shadow():
    """Straight shadow rays leave an even shadow t²; refracted ones gather light in the middle and clear the rest."""
    middle = LIGHT + (CENTRE - LIGHT) * LIGHT[2] / (LIGHT[2] - CENTRE[2])  # of the shadow
    P = middle + np.array([(x, 0.0, 0.0) for x in np.linspace(-0.7, 0.7, 31)])
    N = np.repeat([[0.0, 0, 1]], len(P), 0)
    S = {r: visibility(Prepared(lens(glass(), refraction=r, caustics="FOCUS", shadows="SHARP")), P, N).reshape(-1)
         for r in ("VIEW", "FULL")}
    shaded = np.isclose(S["VIEW"], T**2, rtol=1e-5)
    assert shaded.sum() > 10 and S["FULL"][shaded].max() > 5 and np.median(S["FULL"][shaded]) < 0.5


@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
@pytest.mark.parametrize("leak_free", [False, True])
def test_an_index_of_one_makes_m3_equal_m1(shadows, leak_free):
    a, b = (render_image(lens(glass(ior=1.0), 48, 24, refraction=r, shadows=shadows, leak_free=leak_free)
                         ).passes["Combined"] for r in ("NONE", "FULL"))
    np.testing.assert_allclose(b, a, atol=1e-6)


def beside_the_table(**values):
    """S on a table's edge, lit from above; a ball of heavy glass below sends light up past the edge."""
    parts = [Shape(box((0, -1, 0.9), (1, 1, 1)), GREY, "table"),
             Shape(sphere(0.3, 64, 32), glass(0.9, ior=2.4), "ball", [translate(-1, 0, 0.8)])]
    scene = Scene.from_shapes(parts, look_down(0, 0, 4, 8), [point((-1, 0, 4))],
                              settings(h=0.03, kI=3.0, refraction="FULL", **values))
    P = np.array([(x, 0.0, 1.0) for x in (0.005, 0.01, 0.02, 0.04, 0.08, 0.2)])
    return visibility(Prepared(scene), P, np.repeat([[0.0, 0, 1]], len(P), 0)).reshape(-1)


def test_the_leak_free_form_keeps_light_from_below_off_the_table():
    """Paths reach nodes above the table from P_j below it: ξ(i,P) lets them light the table, ξ(P_j,P) does not."""
    assert beside_the_table()[:4].min() > 1.3
    np.testing.assert_array_equal(beside_the_table(leak_free=True), 1)
    np.testing.assert_array_equal(beside_the_table(caustics="FOCUS"), 1)


def test_away_from_leaks_both_forms_agree():
    plain, free = (render_image(lens(glass(), 48, 24, leak_free=f)).passes["Combined"] for f in (False, True))
    assert (np.abs(plain - free).max(-1) > 1e-5).mean() < 0.01  # at the foot of the balls
    assert (free <= plain + 1e-5).all()


def test_sheets_alone_never_start_the_solver():
    sheet = Shape(rectangle((-1, -1), (1, 1), 1.0), glass(0.5), "sheet")
    floor = Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor")
    ready = Prepared(Scene.from_shapes([sheet, floor], look_down(0, 0, 4, 8), [point(LIGHT)],
                                       settings(refraction="FULL")))
    assert not ready.plan.paths and "no closed mesh" in ready.plan.reasons["refracted shadow paths"]
    assert Prepared(lens(glass(), 8, 8)).plan.paths
    assert not Prepared(lens(glass(), 8, 8).with_settings(refraction="VIEW")).plan.paths


@pytest.mark.parametrize("values", [{}, {"shadows": "SHARP"}, {"leak_free": True}, {"caustics": "FOCUS"}], ids=str)
def test_glass_hidden_from_shadows_neither_shades_nor_gathers(values):
    """S beside and under it is 1: its light must not count twice. No other glass: the solver does not start."""
    scene = lens(glass(), 8, 24, **values)
    hidden = replace(scene, objects=tuple(replace(o, visible_shadow=False) for o in scene.objects))
    P = np.stack([*np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), np.zeros((9, 9))], -1).reshape(-1, 3)
    N = np.repeat([[0.0, 0, 1]], len(P), 0)
    ready = Prepared(hidden)
    np.testing.assert_array_equal(visibility(ready, P, N), 1)
    assert not ready.plan.paths and Prepared(scene).plan.paths
    # Beside other glass that does cast, the solver runs and still passes it by.
    seen = replace(hidden, objects=tuple(replace(o, visible_shadow=o.name == "ball") for o in hidden.objects),
                   materials=tuple(replace(m, kt=(0.9,) * 3, ior=1.2) if m.name == "red" else m
                                   for m in hidden.materials))
    alone = replace(seen, objects=tuple(replace(o, visible_camera=False) for o in seen.objects),
                    materials=tuple(replace(m, kt=(0, 0, 0)) if m.name == "glass" else m for m in seen.materials))
    assert Prepared(seen).plan.paths
    np.testing.assert_allclose(visibility(Prepared(seen), P, N), visibility(Prepared(alone), P, N), atol=1e-6)


def test_area_sampling_keeps_to_straight_rays():
    scenes = (lens(glass(), 32, 16, refraction=r, shadows="AREA_SAMPLING", light_samples=4) for r in ("VIEW", "FULL"))
    a, b = (render_image(s).passes["Combined"] for s in scenes)
    np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("values", [{}, {"leak_free": True}, {"caustics": "FOCUS"}, {"shadows": "SHARP"}], ids=str)
def test_tiles_threads_and_runs_give_the_same_bits(values):
    scene = lens(glass(), 40, 16, **values)
    reference = render_image(scene, threads=2, tile_size=32).passes["Combined"]
    for threads, tile in ((1, 256), (2, 7)):
        picture = render_image(scene, threads=threads, tile_size=tile).passes["Combined"]
        np.testing.assert_array_equal(picture, reference)
