"""The shadow terminator: smooth surfaces made of facets, at grazing light (terminator.py)."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from light_meshes import Camera, Mesh, Scene, Shape, rectangle, rotate_z, scale, sphere, translate
from light_meshes.picture.render import Prepared, render_image
from light_meshes.scene import snapshot
from light_meshes.scene.description import Material
from light_meshes.shadows.terminator import merge, split, starts
from scenes import GREY, IDENTITY, WHITE, all_objects, look_down, point, settings, sun, tabletop

HONOURED = {"shadow_terminator_geometry_offset": 0.1}
SHEAR = np.array([[1.2, 0.5, 0, 0], [0, 0.8, 0, 0], [0.3, 0, 1.5, 0], [0, 0, 0, 1.0]])
METHODS = ["SHARP", "LIGHT_MESHES", "AREA_SAMPLING"]


def turned_round(mesh: Mesh) -> Mesh:
    """The same surface, the other side of which is called outside."""
    return Mesh(mesh.vertices, mesh.triangles[:, ::-1], -mesh.normals[:, ::-1])


def ball(matrix=IDENTITY, mesh=None, offset=0.1, **values):
    """A coarse smooth ball under a grazing sun."""
    part = Shape(mesh or sphere(1.0, 12, 6), WHITE, "ball", [matrix],
                 flags={"shadow_terminator_geometry_offset": offset})
    return Scene.from_shapes([part], Camera.look_at((0, -6, 1), (0, 0, 0), 36, 96, 96),
                             [sun((-0.9, 0.3, -0.5), angle=0.01)],
                             settings(**{"h": 0.03, "light_samples": 4} | values))


def lit(scene, least=0.02):
    """The shadow pass, and where N·L is at least so large."""
    passes = render_image(scene, passes=("Combined", "Shadow", "Normal")).passes
    toward = -np.array(scene.lights[0].direction)
    return passes["Shadow"][..., 0], passes["Normal"] @ (toward / np.linalg.norm(toward)) > least


@pytest.mark.parametrize("matrix", [IDENTITY, SHEAR, scale(1, 1, -1) @ rotate_z(0.3), scale(1.4, 0.6, 1)],
                         ids=["as it is", "sheared", "mirrored", "scaled"])
@pytest.mark.parametrize("shadows", METHODS)
def test_a_convex_surface_has_no_black_facet(shadows, matrix):
    S, facing = lit(ball(matrix, shadows=shadows))
    assert facing.sum() > 800
    assert (S[facing] > 0.99).all()
    without, _ = lit(ball(matrix, shadows=shadows, offset=0.0))
    assert (without[facing] == 0).sum() > 20  # the fault is there, were it not mended


def test_under_a_sun_with_a_size_it_has_none_either():
    """Where the whole sun is above the surface, all of it is seen."""
    scene, size = ball(shadows="LIGHT_MESHES"), 0.2
    scene = replace(scene, lights=tuple(replace(light, softness="SIZE", angle=size) for light in scene.lights))
    S, facing = lit(scene, least=np.sin(size / 2) + 0.02)
    assert facing.sum() > 800
    assert (S[facing] > 0.99).all()


@pytest.mark.parametrize("shadows", METHODS)
def test_the_back_of_a_surface_is_as_good_as_its_front(shadows):
    front, facing = lit(ball(shadows=shadows))
    back, _ = lit(ball(mesh=turned_round(sphere(1.0, 12, 6)), shadows=shadows))
    np.testing.assert_allclose(back, front, atol=1e-6)
    assert (back[facing] > 0.99).all()


@pytest.mark.parametrize("shadows", METHODS)
def test_glass_elsewhere_changes_nothing(shadows):
    """Shadows through glass are other code; with a pane that shadows nothing they give the same."""
    scene = ball(shadows=shadows)
    pane = Shape(rectangle((20, 20), (21, 21), 0.0), Material("pane", kt=(0.5, 0.5, 0.5)), "pane")
    honoured = Shape(sphere(1.0, 12, 6), WHITE, "ball", flags=HONOURED)
    glassy = Scene.from_shapes([honoured, pane], scene.camera, scene.lights, scene.settings)
    assert Prepared(glassy).plan.channels
    np.testing.assert_allclose(lit(glassy)[0], lit(scene)[0], atol=1e-6)


@pytest.mark.parametrize("shadows", METHODS)
def test_flat_surfaces_keep_their_bits(shadows):
    scene = tabletop(48).with_settings(shadows=shadows, light_samples=4)
    plain = render_image(scene).passes["Combined"]
    moved = all_objects(scene, shadow_terminator_geometry_offset=0.5, shadow_terminator_normal_offset=1.0)
    np.testing.assert_array_equal(render_image(moved).passes["Combined"], plain)


@pytest.mark.parametrize("shadows", METHODS)
def test_a_smooth_plane_keeps_its_bits_almost(shadows):
    """Where the smooth surface is the facet, only rounding tells the two."""
    floor = rectangle((-2, -2), (2, 2), 0.0)
    normals = np.tile([0.0, 0, 1], (2, 3, 1)) + np.arange(6).reshape(2, 3, 1) * 1e-9  # not all the same
    floor = Mesh(floor.vertices, floor.triangles, normals)
    scene = Scene.from_shapes([Shape(floor, WHITE, "floor"), Shape(sphere(0.3), GREY, "ball", [translate(0, 0, 0.5)])],
                              look_down(0, 0, 4, 48), [sun((-1, 0, -0.06))],
                              settings(shadows=shadows, h=0.05, light_samples=4))
    S = [render_image(all_objects(scene, shadow_terminator_geometry_offset=v), passes=("Combined", "Shadow"))
         .passes["Shadow"] for v in (0.0, 0.1)]
    assert np.abs(S[0] - S[1]).max() < 0.02 and (S[0] < 0.5).any()


def ridge(ceiling: float):
    """Two slopes that rise to a ridge, and a plate `ceiling` above it, which the sun shines on from above.

    The surface that the normals describe bulges above the ridge: through the plate.
    """
    vertices = np.array([(-1, -2, 0), (1, -2, 0), (1, 2, 0), (-1, 2, 0), (0, -2, 0.3), (0, 2, 0.3)], float)
    triangles = np.array([(0, 4, 5), (0, 5, 3), (4, 1, 2), (4, 2, 5)])
    slope = np.array([(-0.55, 0, 0.83), (0.55, 0, 0.83), (0.55, 0, 0.83), (-0.55, 0, 0.83), (0, 0, 1), (0, 0, 1)])
    normals = slope[triangles]
    normals[np.isin(triangles, (4, 5))] = np.array([(0.3, 0, 0.95)] * 3 + [(-0.3, 0, 0.95)] * 3)
    plate = Shape(rectangle((-50, -50), (50, 50), 0.3 + ceiling), GREY, "plate", flags={"visible_camera": False})
    return Scene.from_shapes([Shape(Mesh(vertices, triangles, normals), WHITE, "roof", flags=HONOURED), plate],
                             look_down(0, 0, 1.8, 64), [sun((1, 0, -0.05), angle=0.01)],
                             settings(h=0.02, light_samples=4))


@pytest.mark.parametrize("shadows", METHODS)
@pytest.mark.parametrize("ceiling", [1e-3, 0.02])
def test_nothing_is_lifted_through_a_wall(shadows, ceiling):
    scene = ridge(ceiling).with_settings(shadows=shadows)
    ready = Prepared(scene)
    _, hits = ready.world.coarse_view()
    lift = ready.lighting.terminator.lift(hits)
    through = hits.P[:, 2] + lift.above[:, 2] > 0.3 + ceiling
    assert through.sum() > 50
    passes = render_image(scene, passes=("Combined", "Shadow")).passes
    assert (passes["Shadow"] == 0).all() and (passes["Combined"][..., :3] == 0).all()
    open_air = ridge(5.0).with_settings(shadows=shadows)
    assert (render_image(open_air, passes=("Shadow",)).passes["Shadow"] > 0.9).mean() > 0.4


@pytest.mark.parametrize("shadows", METHODS[:2])
def test_other_things_still_cast_their_shadows(shadows):
    """A plate between the sun and the ball: the ball is dark."""
    scene = ball(shadows=shadows)
    wall = Mesh(np.array([(2, -9, -9), (2, 9, -9), (2, 9, 9), (2, -9, 9)], float), np.array([(0, 1, 2), (0, 2, 3)]))
    shaded = Scene.from_shapes([Shape(sphere(1.0, 12, 6), WHITE, "ball", flags=HONOURED), Shape(wall, GREY, "wall")],
                               scene.camera, scene.lights, scene.settings)
    S, facing = lit(shaded)
    assert facing.sum() > 800 and (S[facing] == 0).all()


def test_a_mirror_shows_it_as_well():
    """The ball in a mirror is the picture of the mirrored ball."""
    mirror = Material("mirror", Od=(0, 0, 0), kd=0.0, ka=0.0, mirror=(1, 1, 1))
    things = [Shape(sphere(1.0, 12, 6), WHITE, "ball", [translate(0, 0, 1.5)], HONOURED | {"visible_camera": False}),
              Shape(rectangle((-30, -30), (30, 30), 0.0), mirror, "mirror", flags={"visible_shadow": False})]
    camera, values = Camera.look_at((0, -6, 1), (0, 0, -1.5), 36, 64, 64), settings(mode="WHITTED", h=0.03)
    seen = Scene.from_shapes(things, camera, [sun((-0.9, 0.3, -0.5))], values)
    flipped = Shape(sphere(1.0, 12, 6), WHITE, "ball", [scale(1, 1, -1) @ translate(0, 0, 1.5)], flags=HONOURED)
    direct = Scene.from_shapes([flipped], camera, [sun((-0.9, 0.3, 0.5))], values)
    a, b = (render_image(s).passes["Combined"] for s in (seen, direct))
    assert (b > 0.1).mean() > 0.1
    assert np.quantile(np.abs(a - b), 0.995) < 0.02


@given(st.integers(0, 2**31), st.floats(0.1, 10), st.booleans())
@hypothesis_settings(max_examples=20, deadline=None)
def test_the_lift_reaches_the_ball_and_not_much_higher(seed, size, flipped):
    """Above each facet the lifted point is on the ball that the facets stand for, or a little outside.

    However the ball is turned, mirrored and sized.
    """
    random = np.random.default_rng(seed)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0] * (-1 if flipped else 1)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = size * turn, random.normal(size=3) * 3 * size
    x, y, z = matrix[:3, 3]
    scene = Scene.from_shapes([Shape(sphere(1.0, 16, 8), WHITE, "ball", [matrix], flags=HONOURED)],
                              look_down(x, y, 1.9 * size, 8, height=z + 4 * size), [sun((0, 0, -1))])
    ready = Prepared(scene)
    _, hits = ready.world.coarse_view()
    lift = ready.lighting.terminator.lift(hits)
    assert len(hits.P) > 1000 and (lift.cutoff == 0.1).all() and (lift.side == hits.Ns).all()
    facet = np.linalg.norm(hits.P - matrix[:3, 3], axis=1) / size
    lifted = np.linalg.norm(hits.P + lift.above - matrix[:3, 3], axis=1) / size
    assert (lifted >= 1 - 2e-3).all()  # half a parabola is a little flatter than a ball
    assert (lifted <= 1 + 3 * (1 - facet) + 1e-5).all()


def how_far(P, N, side, cutoff, end, is_sun):
    """The formula of terminator.c for one receiver and one light, as it is written there."""
    way = end - (0.0 if is_sun else 1.0) * P
    length, toward, over = np.sqrt((way[0] * way[0] + way[1] * way[1]) + way[2] * way[2]), *(
        (way[0] * v[0] + way[1] * v[1]) + way[2] * v[2] for v in (N, side))
    if toward < 0:
        return 1.0
    facet, smooth = toward / length, over / length
    return np.clip(2 - (facet + smooth) / cutoff if smooth < cutoff else 1 - facet / cutoff, 0, 1)


@given(st.integers(0, 2**31), st.sampled_from([0.0, 3.0, 1e5]))
@hypothesis_settings(max_examples=30, deadline=None)
def test_lights_are_sorted_as_one_by_one(seed, away):
    """Many lights are told apart in single precision first: none is missed, also where that is much too coarse."""
    rng = np.random.default_rng(seed)
    n, lights = 12, 70
    unit = lambda a: a / np.linalg.norm(a, axis=1, keepdims=True)  # noqa: E731
    P, N = rng.normal(size=(n, 3)) + away, unit(rng.normal(size=(n, 3)))
    side, cutoff = unit(N + 0.3 * rng.normal(size=(n, 3))), rng.choice([0.0, 0.05, 0.3], n)
    is_sun = rng.random(lights) < 0.2
    end = rng.normal(size=(lights, 3)) * rng.choice([0.3, 3, 30], (lights, 1)) + away
    end[is_sun] = unit(rng.normal(size=(int(is_sun.sum()), 3)))
    near = rng.random(lights) < 0.3  # ways that are almost at the cutoff of some receiver
    across = unit(np.cross(N[0], rng.normal(size=(lights, 3))))
    way = across + rng.choice([0.05, 0.3], (lights, 1)) * (1 + 1e-5 * rng.normal(size=(lights, 1))) * N[0]
    end[near & ~is_sun] = (P[0] + 3 * way)[near & ~is_sun]
    asked = rng.integers(0, 2**63, (n, 2), np.uint64)
    asked[:, 1] &= np.uint64(63)
    soft, lifted = asked.copy(), np.zeros_like(asked)
    lift = np.zeros((n, 3)), side, cutoff
    assert split(*lift, P, N, end, is_sun, soft, lifted) == 0
    S, above, known = np.zeros((n, lights, 1), np.float32), np.ones((n, lights, 1), np.float32), asked.copy()
    merge(*lift, P, N, end, is_sun, np.arange(n), lifted, lifted, above, known, S)
    for p in range(n):
        for i in range(lights):
            has = lambda bits, p=p, i=i: bool(bits[p, i // 64] >> np.uint64(i % 64) & np.uint64(1))  # noqa: E731
            share = how_far(P[p], N[p], side[p], cutoff[p], end[i], is_sun[i]) if cutoff[p] and has(asked) else 0.0
            assert (has(lifted), has(soft)) == (share > 0, has(asked) and share < 1)
            assert S[p, i, 0] == np.float32(share)


def test_how_far_follows_cycles():
    """No lift where a light is well above the facet, all of it where the facet turns away; and in between a share."""
    scene = ball()
    ready = Prepared(scene)
    _, hits = ready.world.coarse_view()
    lift = ready.lighting.terminator.lift(hits)
    toward = -np.array(scene.lights[0].direction) / np.linalg.norm(scene.lights[0].direction)
    row = np.arange(len(hits.P), dtype=np.int32)
    origin, _, _ = starts(lift, hits.P, hits.Ng, ready.world.lights.targets(), row, np.zeros(len(row), np.int32))
    facet, smooth = hits.Ng @ toward, hits.Ns @ toward
    share = np.clip(np.where(smooth < 0.1, 2 - (facet + smooth) / 0.1, 1 - facet / 0.1), 0, 1)
    np.testing.assert_allclose(origin, hits.P + share[:, None] * lift.above, atol=1e-12)
    seen = smooth > 0
    assert (share[seen] == 0).any() and (share[seen] == 1).any() and ((share > 0.1) & (share < 0.9))[seen].any()


def test_many_lights_are_the_sum_of_each():
    """Each light is lifted by itself, in whatever word of the sets it stands."""
    lights = [sun((np.cos(a), np.sin(a), -0.4), intensity=0.1) for a in np.linspace(0, 6.28, 70, endpoint=False)]
    lights += [point((3, -2, 1.0)), point((-3, 1, -1.0), radius=0.1)]
    scene = replace(ball(h=0.05, kI=2.0), lights=tuple(lights), world_color=(0.0, 0.0, 0.0))
    scene = replace(scene, camera=Camera.look_at((0, -6, 1), (0, 0, 0), 36, 32, 32))
    both = render_image(scene).passes["Combined"]
    each = sum(render_image(replace(scene, lights=(light,))).passes["Combined"].astype(float) for light in lights)
    np.testing.assert_allclose(both[..., :3], each[..., :3], atol=2e-5)


def test_the_shading_offset_moves_the_terminator_towards_the_light():
    """The light is cos(φ/(1 − offset/2)) instead of cos φ."""
    scene = ball(shadows="SHARP")
    plain = render_image(scene, passes=("Combined", "Normal")).passes
    faded = render_image(all_objects(scene, shadow_terminator_shading_offset=0.5)).passes["Combined"][..., :3]
    toward = -np.array(scene.lights[0].direction) / np.linalg.norm(scene.lights[0].direction)
    cosine = plain["Normal"] @ toward
    seen = cosine > 0.1
    angle = np.arccos(np.minimum(cosine[seen], 1))
    expected = plain["Combined"][seen, :3] * (np.maximum(np.cos(angle / 0.75), 0) / cosine[seen])[:, None]
    np.testing.assert_allclose(faded[seen], expected, atol=1e-5)
    assert (faded[seen] == 0).any()


def test_the_normal_offset_lifts_further():
    ready, further = (Prepared(all_objects(ball(), **HONOURED, shadow_terminator_normal_offset=v)) for v in (0.0, 0.25))
    _, hits = ready.world.coarse_view()
    more = further.lighting.terminator.lift(hits).above - ready.lighting.terminator.lift(hits).above
    np.testing.assert_allclose(more, 0.25 * hits.Ns, atol=1e-12)


def test_snapshots_without_the_offsets_keep_their_picture(tmp_path):
    scene = ball(shadows="SHARP", offset=0.0)
    snapshot.write(scene, tmp_path / "new")
    file = tmp_path / "new" / "scene.json"
    old = file.read_text().replace(', "shadow_terminator_geometry_offset": 0.0', "")
    assert old != file.read_text()
    file.write_text(old)
    np.testing.assert_array_equal(render_image(snapshot.read(tmp_path / "new")).passes["Combined"],
                                  render_image(scene).passes["Combined"])
