"""Semitransparent surfaces with straight shadow rays (paper §4 and §5): Π t, eq. (7), view rays that bend, cut-outs."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from light_meshes import Camera, Mesh, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.picture.render import Prepared, render_image
from light_meshes.rays import tracer as tracing
from light_meshes.scene.description import Material
from scenes import GREY, WHITE, look_down, point, settings, sun, tabletop
from visible import visibility

UP = np.array([[0.0, 0.0, 1.0]])


def glass(t=0.7, name="glass", **more):
    kt = tuple(t) if np.ndim(t) else (t, t, t)
    return Material(name, Od=(0, 0, 0), ka=0.0, kd=0.0, kt=kt, **more)


def under(parts, P, lights=None, **values):
    """S at points P of the floor z = 0 under `parts`, as (n, L, C)."""
    scene = Scene.from_shapes([Shape(rectangle((-9, -9), (9, 9), 0.0), WHITE, "floor"), *parts], look_down(0, 0, 4, 8),
                              lights or [sun((0, 0, -1))], settings(**values))
    P = np.atleast_2d(np.asarray(P, float))
    S = visibility(Prepared(scene), P, np.repeat(UP, len(P), 0))
    return S.reshape(len(P), len(scene.lights), -1)


@given(st.integers(1, 12), st.floats(0.1, 0.95), st.floats(-1, 1), st.floats(-1, 1))
def test_each_sheet_on_the_way_multiplies_by_its_t(sheets, t, x, y):
    panes = [Shape(rectangle((-3, -3), (3, 3), 0.5 + 0.1 * n), glass(t), f"pane {n}") for n in range(sheets)]
    S = under(panes, (x, y, 0), shadows="SHARP")
    np.testing.assert_allclose(S, t**sheets, rtol=1e-5)


@given(st.floats(0.1, 0.95), st.integers(0, 2**31 - 1))
def test_a_solid_is_crossed_twice_wherever_the_ray_meets_it(t, seed):
    """Also through the edges and vertices of its triangles, where Embree may report both neighbours."""
    mesh = box((-1, -1, 0.5), (1, 1, 1.5))
    random = np.random.default_rng(seed)
    share = random.uniform(-0.99, 0.99, 200)
    P = np.stack([share, share, np.zeros(200)], 1)  # along the diagonals of top and bottom
    P[100:, 1] *= -1
    S = under([Shape(mesh, glass(t), "block")], P, shadows="SHARP")
    np.testing.assert_allclose(S, t * t, rtol=1e-5)


def test_a_ray_through_a_vertex_of_a_fine_sphere_is_counted_once():
    ball = sphere(0.5, 48, 24)
    P = ball.vertices * (1, 1, 0)
    inside = np.hypot(P[:, 0], P[:, 1]) < 0.499
    S = under([Shape(ball, glass(0.5), "ball", [translate(0, 0, 2)])], P[inside], shadows="SHARP")
    np.testing.assert_allclose(S, 0.25, rtol=1e-5)


def test_coloured_glass_colours_its_shadow():
    colour = (0.9, 0.5, 0.1)
    for shadows in ("SHARP", "LIGHT_MESHES", "AREA_SAMPLING"):
        S = under([Shape(rectangle((-3, -3), (3, 3), 1.0), glass(colour), "pane")], (0.1, 0.2, 0), shadows=shadows)
        np.testing.assert_allclose(S[0, 0], colour, rtol=1e-6)


def test_an_opaque_thing_behind_glass_is_opaque():
    parts = [Shape(rectangle((-3, -3), (3, 3), 1.0), glass(0.7), "pane"),
             Shape(box((-1, -1, 2), (1, 1, 3)), GREY, "box")]
    S = under(parts, [(0, 0, 0), (2, 2, 0)], shadows="SHARP")
    np.testing.assert_allclose(S[:, 0, 0], (0, 0.7), rtol=1e-6)


def test_glass_that_casts_no_transparent_shadow_is_opaque_to_lights_only():
    pane = Shape(rectangle((-3, -3), (3, 3), 1.0), glass(0.7, transparent_shadow=False), "pane")
    assert under([pane], (0, 0, 0), shadows="SHARP").max() == 0
    lamp = Material("lamp", emission=(1, 1, 1), kd=0.0)
    scene = Scene.from_shapes([Shape(rectangle((-9, -9), (9, 9), 0.0), lamp, "floor"), pane], look_down(0, 0, 4, 8),
                              [sun((0, 0, -1))], settings(shadows="SHARP"))
    np.testing.assert_allclose(render_image(scene).passes["Combined"][..., :3], 0.7, rtol=1e-6)


def beside_a_pane(t, glass_rule):
    """S at points beside a vertical pane, the light on their own side (method §3)."""
    pane = Mesh(np.array([(0, -5, -1), (0, 5, -1), (0, 5, 5), (0, -5, 5)], float),
                np.array([(0, 1, 2), (0, 2, 3)]))
    P = np.array([(0.01, 0.1 * k, 0) for k in range(8)])
    return under([Shape(pane, glass(t), "pane")], P, [sun((-1, 0, -1))], glass=glass_rule, h=0.05, kI=4.0)[:, 0, 0]


def test_paper_darkens_beside_a_pane_and_bounded_does_not():
    np.testing.assert_array_equal(beside_a_pane(0.5, "BOUNDED"), 1)
    # Eq. (7): nodes behind the pane weigh t for the short ray and t for the light's.
    u = 0.01 / 0.2
    before = 0.5 + 0.75 * u - 0.25 * u**3  # share of the half-ball on the light's side
    np.testing.assert_allclose(beside_a_pane(0.5, "PAPER"), before + (1 - before) * 0.25, atol=0.03)
    np.testing.assert_allclose(beside_a_pane(1e-4, "PAPER"), before, atol=0.03)


@pytest.mark.parametrize(("t", "channels"), [(0.5, 1), ((0.5, 0.4, 0.3), 3)])
@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
def test_bits_numbers_and_rgb_agree_where_no_glass_is_in_the_way(t, channels, shadows):
    scene = tabletop(80, shadows=shadows)
    g = scene.geometry
    # A pane below the table, which no ray meets.
    pane = np.array([(-1, -1, -3), (1, -1, -3), (1, 1, -3)], np.float32)
    geometry = replace(
        g, vertices=np.concatenate([g.vertices, pane]),
        triangles=np.concatenate([g.triangles, np.array([(0, 1, 2)], np.int32)]),
        corner_normals=np.concatenate([g.corner_normals, np.array([[(0, 0, 1)] * 3], np.float32)]),
        triangle_materials=np.append(g.triangle_materials, np.int32(len(scene.materials))),
        meshes=np.concatenate([g.meshes, np.array([(len(g.vertices), 3, len(g.triangles), 1)])]),
        instance_mesh=np.append(g.instance_mesh, np.int32(len(g.meshes))),
        instance_object=np.append(g.instance_object, np.int32(0)),
        instance_matrix=np.concatenate([g.instance_matrix, np.eye(4)[None]]),
    )
    with_pane = replace(scene, geometry=geometry, materials=(*scene.materials, glass(t)))
    assert Prepared(with_pane).plan.channels == channels and Prepared(scene).plan.channels == 0
    # Only the frame that the tracer recentres to differs.
    a, b = (render_image(s).passes["Combined"] for s in (scene, with_pane))
    assert (np.abs(a - b).max(-1) > 1e-5).mean() < 2e-3


def still_life(material, **values):
    parts = [Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor"),
             Shape(sphere(0.6, 40, 20), material, "ball", [translate(0, 0, 0.9)]),
             Shape(rectangle((-1, -1), (0.5, 0.5), 1.8), replace(material, name="sheet", ior=1.5), "sheet"),
             Shape(box((0.8, 0.2, 0), (1.2, 1.0, 1.0)), Material("red", Od=(0.8, 0.2, 0.1)), "box")]
    return Scene.from_shapes(parts, Camera.look_at((3, -4, 2.5), (0, 0, 0.6), 40, 64, 64),
                             [point((1.5, -1, 4)), sun((-1, 1, -2))],
                             settings(mode="WHITTED", max_depth=8, h=0.1, **values), world_color=(0.1, 0.2, 0.3))


def test_an_index_of_one_bends_nothing():
    pictures = [render_image(still_life(glass(0.6, ior=1.0), refraction=r)).passes["Combined"]
                for r in ("NONE", "VIEW", "FULL")]
    np.testing.assert_allclose(pictures[1], pictures[0], atol=1e-6)
    np.testing.assert_allclose(pictures[2], pictures[0], atol=1e-6)


def test_a_view_ray_through_a_slab_is_shifted_by_snells_law():
    """H6's slab, seen at 45°: the edge of a dark half floor moves by T·(tan θ − tan θ')."""
    T, n = 0.3, 1.5
    shift = T * (1 - np.tan(np.arcsin(np.sin(np.pi / 4) / n)))
    lit = Material("lit", emission=(1, 1, 1), kd=0.0, ka=0.0)
    dark = Material("dark", kd=0.0, ka=0.0)
    camera = Camera.look_at((-4, 0, 4), (0, 0, 0), 10, 400, 4)
    camera = replace(camera, perspective=False, window=(-0.5, 0.5, -0.005, 0.005))
    quarter = np.eye(4)
    quarter[:2, :2] = [[0, -1], [1, 0]]
    camera = replace(camera, matrix=camera.matrix @ quarter)  # rows of pixels run along the slab
    edges = []
    for refraction in ("NONE", "VIEW"):
        scene = Scene.from_shapes([Shape(rectangle((-9, -9), (0, 9), 0.0), dark, "dark"),
                                   Shape(rectangle((0, -9), (9, 9), 0.0), lit, "lit"),
                                   Shape(box((-8, -8, 1), (8, 8, 1 + T)), glass(1.0, ior=n), "slab")],
                                  camera, [], settings(refraction=refraction))
        edges.append((render_image(scene).passes["Combined"][2, :, 0] > 0.5).sum() / 400)
    # On the floor by `shift`, across the view by shift·cos 45°.
    assert abs(edges[1] - edges[0]) == pytest.approx(shift * np.cos(np.pi / 4), abs=2 / 400)


def inside(ior, mode):
    """What an eye inside glass sees of its flat top at 60° to the normal; a lamp stands behind the eye."""
    camera = Camera.look_at((0, 0, 0), (np.sin(np.pi / 3), 0, np.cos(np.pi / 3)), 0.01, 1, 1)
    lamp = Material("lamp", Od=(0, 0, 0), kd=0.0, ka=0.0, emission=(3, 3, 3))
    scene = Scene.from_shapes([Shape(box((-50, -50, -9), (50, 50, 1)), glass(1.0, ior=ior), "block"),
                               Shape(rectangle((-40, -40), (40, 40), -5.0), lamp, "lamp")],
                              camera, [], settings(max_depth=3, mode=mode), world_color=(1, 1, 1))
    return render_image(scene).passes["Combined"][0, 0, 0]


def test_beyond_the_critical_angle_all_is_reflected():
    """The critical angle is 41.8° at 1.5 and 65° at 1.1. Ray casting follows no reflection."""
    assert inside(1.5, "WHITTED") == pytest.approx(3)
    assert inside(1.5, "RAY_CASTING") == 0
    assert inside(1.1, "WHITTED") == inside(1.1, "RAY_CASTING") == pytest.approx(1)


def test_fresnel_shares_light_between_both_ways():
    """At a pane that reflects and transmits the same white world nothing is lost or won."""
    pane = glass(1.0, ior=1.5, fresnel=True)
    camera = Camera.look_at((0, -3, 1.5), (0, 0, 1), 20, 16, 16)
    scene = Scene.from_shapes([Shape(rectangle((-2, -2), (2, 2), 1.0), pane, "pane")], camera,
                              settings=settings(mode="WHITTED"), world_color=(1, 1, 1))
    np.testing.assert_allclose(render_image(scene).passes["Combined"][..., :3], 1, rtol=1e-6)
    dark = render_image(scene.with_settings(mode="RAY_CASTING")).passes["Combined"][8, 8, 0]
    assert 0.3 < dark < 0.99  # without reflections F is missing


def test_of_overlapping_media_the_higher_priority_is_there():
    """A core inside a shell of the same index: no interface. With a lower priority the core is not there at all."""
    def picture(core, **more):
        parts = [Shape(sphere(0.8, 48, 24), glass(0.9, "shell", ior=1.5, priority=1), "shell", [translate(0, 0, 1)])]
        if core is not None:
            parts.append(Shape(sphere(0.4, 48, 24), core, "core", [translate(0, 0, 1)]))
        parts.append(Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor"))
        scene = Scene.from_shapes(parts, Camera.look_at((2, -3, 2), (0, 0, 0.9), 35, 48, 48), [point((0, 0, 4))],
                                  settings(mode="WHITTED", max_depth=8, shadows="SHARP"))
        return render_image(scene).passes["Combined"]

    alone = picture(None)
    lower = glass(0.5, "core", ior=2.0, priority=0)
    visible = np.abs(picture(lower) - alone).max(-1)
    # Its straight shadow remains (M2 multiplies every crossing), what is seen through the shell does not change
    # where the floor behind is not in that shadow.
    assert (visible > 1e-6).mean() < 0.25
    higher = picture(replace(lower, priority=2))
    assert (np.abs(higher - alone).max(-1) > 1e-3).mean() > (visible > 1e-3).mean()


def test_alpha_cuts_out_in_view_in_shadow_and_in_the_film():
    half = Material("half", Od=(0, 0, 0), ka=0.0, kd=0.0, alpha=0.25)
    pane = Shape(rectangle((-3, -3), (3, 3), 1.0), half, "pane")
    np.testing.assert_allclose(under([pane], (0, 0, 0), shadows="SHARP"), 0.75, rtol=1e-6)
    scene = Scene.from_shapes([pane], look_down(0, 0, 4, 8), [], settings(film_transparent=True), world_color=(1, 1, 1))
    combined = render_image(scene).passes["Combined"]
    np.testing.assert_allclose(combined[..., 3], 0.25, rtol=1e-6)
    np.testing.assert_allclose(combined[..., :3], 0, atol=1e-7)


def test_a_fully_cut_out_sheet_changes_nothing():
    scene = still_life(Material("nothing", alpha=0.0))
    g = scene.geometry
    keep = (g.instance_object == 0) | (g.instance_object == 3)
    rest = {name: getattr(g, name)[keep] for name in ("instance_mesh", "instance_object", "instance_matrix")}
    without = replace(scene, geometry=replace(g, **rest))
    a, b = (render_image(s).passes["Combined"] for s in (scene, without))
    assert (np.abs(a - b).max(-1) > 1e-5).mean() < 2e-3  # the tracer's frame differs


@pytest.mark.parametrize("values", [
    {"shadows": "SHARP"}, {"shadows": "LIGHT_MESHES"}, {"shadows": "LIGHT_MESHES", "glass": "PAPER"},
    {"shadows": "AREA_SAMPLING", "light_samples": 4}, {"refraction": "NONE"},
], ids=str)
def test_tiles_threads_and_runs_give_the_same_bits(values):
    scene = still_life(glass((0.9, 0.6, 0.5), ior=1.5, ks=0.5, mirror=(0.1, 0.1, 0.1)), **values)
    reference = render_image(scene, threads=2, tile_size=32).passes["Combined"]
    for threads, tile in ((1, 256), (2, 7)):
        picture = render_image(scene, threads=threads, tile_size=tile).passes["Combined"]
        np.testing.assert_array_equal(picture, reference)


def test_the_uniform_skip_gives_the_same_bits_through_glass():
    scene = still_life(glass((0.9, 0.6, 0.5), ior=1.5))
    a, b = (render_image(scene.with_settings(uniform_skip=u)) for u in (True, False))
    np.testing.assert_array_equal(a.passes["Combined"], b.passes["Combined"])
    assert a.statistics["short_rays"] < 0.7 * b.statistics["short_rays"]


def test_a_surface_that_is_met_at_once_again_and_again_ends_soon():
    """A ray along the edge of a glass box may meet its faces wherever it starts: half a million steps of some ulps."""
    cube = Shape(box((0, 0, 0), (1, 1, 1)), GREY, "box")
    surfaces = Prepared(Scene.from_shapes([cube], look_down(0, 0, 2, 8))).surfaces
    start, end = np.array([[0.1, 0.1, -0.8]]), np.array([[0.1, 0.1, 0.9]])
    o, d = start.astype(np.float32), (end - start).astype(np.float32)
    t, passed, new = np.zeros(1, np.float32), np.zeros(1), np.empty(1, np.bool_)
    last, near = np.full(1, -1, np.int32), np.zeros(1, np.int32)
    steps, ahead = 0, []
    while steps < 100:
        t[:] = 0  # Embree's hit: at the very start
        tracing._cross(surfaces.vertices, surfaces.triangles, surfaces.instance, np.array([3], np.int32), start, end, o,
                       d, t, passed, last, near, new, np.empty(1))
        steps += 1
        ahead.append(float(passed[0]))
        if t[0] == 0:
            break
    assert 10 < steps < 50
    assert (np.diff(ahead[:8]) < 2 * tracing.ULPS).all()  # the first steps are as short as ever


@pytest.mark.parametrize("far", [100, 1000])
def test_rays_meet_surfaces_that_cross_only_once(far):
    """A large floor makes the steps larger by which rays leave surfaces. Where two cut-outs cross, rays went back and
    forth between them, up to a thousand times.
    """
    rng = np.random.default_rng(3)
    corners = (0.3 * rng.uniform(-1, 1, (60, 1, 3)) + rng.uniform(-1, 1, (60, 3, 3))).reshape(-1, 3)
    leaves = Mesh(corners, np.arange(180).reshape(-1, 3))
    clear = Material("clear", alpha=0.0)
    camera = Camera.look_at((0.1, -5, 0.3), (0, 0, 0), 30, 64, 64)

    def seen(size):
        shapes = [Shape(leaves, clear, "leaves"), Shape(rectangle((-size, -size), (size, size), -4.0), GREY, "floor")]
        return render_image(Scene.from_shapes(shapes, camera, [sun((0, 0, -1))], settings(samples=4))).statistics

    near = seen(1)
    assert near["secondary_rays"] > 2 * near["camera_rays"]
    assert seen(far)["secondary_rays"] == near["secondary_rays"]
