"""Light from everywhere: its values where these are known, and that it depends on nothing else than the scene."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import (
    Camera,
    Light,
    Material,
    Scene,
    Settings,
    Shape,
    box,
    cylinder,
    rectangle,
    sphere,
    translate,
)
from light_meshes.film.images import Framebuffer
from light_meshes.gathered.nearness import Nearness
from light_meshes.gathered.records import Records
from light_meshes.picture import emitters, everywhere
from light_meshes.picture.render import draw, prepare, render_image
from light_meshes.surface import shading

WHITE = Material("white", Od=(1.0, 1.0, 1.0))
BLACK = Material("black", Od=(0.0, 0.0, 0.0))
FLOOR = rectangle((-20.0, -20.0), (20.0, 20.0))


def scene(shapes, eye, target=(0.0, 0.0, 0.0), pixels=80, lights=(), world=(1.0, 1.0, 1.0), **more):
    """One ray a pixel, light from the sky."""
    chosen = Settings(mode="RAY_CASTING", samples=1, filter_size=0.0, world_light="SKY", auto_h=True)
    return Scene.from_shapes(shapes, Camera.look_at(eye, target, 50, pixels, pixels), lights, replace(chosen, **more),
                             world_color=world)


def seen(of, where):
    """Positions (n,3) and red light (n,) of the pixels whose positions are `where`."""
    passes = render_image(of, ("Combined", "Position", "Depth")).passes
    P, light = passes["Position"].reshape(-1, 3).astype(np.float64), passes["Combined"].reshape(-1, 4)[:, 0]
    rows = where(*P.T) & (passes["Depth"].ravel() < 1e9)
    assert np.count_nonzero(rows) > 500
    return P[rows], light[rows]


def close(light, known, most=0.02, median=0.01):
    error = np.abs(light / known - 1)
    assert np.median(error) < median
    assert np.percentile(error, 99) < most


def test_a_plane_under_a_uniform_sky_returns_its_radiance():
    _, light = seen(scene([Shape(FLOOR, WHITE)], (0, -4, 3), world=(0.7, 0.5, 0.3)), lambda x, y, z: z < 1)
    np.testing.assert_allclose(light, 0.7, rtol=1e-6)


def test_the_corner_of_two_planes():
    """A floor beside a black wall of height 20: a half less the part of the sky above the wall."""
    wall = Shape(box((-200, 0, -20), (200, 20, 20)), BLACK)
    P, light = seen(scene([wall, Shape(rectangle((-200, -20), (200, 20)), WHITE)], (0, -3, 1.5)),
                    lambda x, y, z: (np.abs(z) < 1e-6) & (y > -2))
    y = np.maximum(-P[:, 1], 0)
    close(light, 1 - 0.5 * (1 - y / np.hypot(y, 20)))


def test_a_plane_under_a_disc():
    """The view factor of a disc, parallel, seen from a point beside its axis (Hamilton and Morgan 1952)."""
    P, light = seen(scene([Shape(cylinder(1, 1, 1.001, 128), BLACK), Shape(FLOOR, WHITE)], (0, -5, 0.9)),
                    lambda x, y, z: (np.abs(z) < 1e-6) & (np.hypot(x, y) < 3))
    a = np.hypot(P[:, 0], P[:, 1])
    close(light, 1 - 0.5 * (1 - a**2 / np.sqrt(a**4 + 4)))  # of radius 1 at height 1


def test_a_ball_on_a_plane_also_at_contact():
    ball = Shape(sphere(0.5, 64, 32), BLACK, matrices=[translate(0, 0, 0.5)])
    P, light = seen(scene([ball, Shape(FLOOR, WHITE)], (0, -3, 1.0), (0, -0.4, 0.1), 120),
                    lambda x, y, z: (np.abs(z) < 1e-6) & (np.hypot(x, y) < 2) & (np.hypot(x, y) > 0.1))
    d = np.linalg.norm(P - (0, 0, 0.5), axis=1)
    close(light, 1 - 0.5**2 / d**2 * (0.5 / d))


@pytest.mark.parametrize(("pane", "ior", "fresnel"), [("slab", 1.5, True), ("sheet", 1.5, True), ("slab", 1.0, True),
                                                      ("slab", 1.5, False)])
def test_a_floor_under_a_wide_pane(pane, ior, fresnel):
    """What Fresnel's equations leave of the sky: 1 − R at a sheet; at a slab, in which light goes to and fro, the sum
    of (1 − R)² R^2k. Its colour counts at each face.
    """
    glass = Material("glass", Od=(0.0, 0.0, 0.0), kd=0.0, kt=(0.5, 1.0, 1.0), ior=ior, fresnel=fresnel)
    mesh = rectangle((-90.0, -90.0), (90.0, 90.0), 1.0) if pane == "sheet" else box((-90, -90, 1), (90, 90, 1.1))
    _, light = seen(scene([Shape(mesh, glass), Shape(FLOOR, WHITE)], (0, -0.5, 0.9), pixels=24, refraction="VIEW",
                          auto_h=False, h=0.5),
                    lambda x, y, z: np.abs(z) < 1e-6)
    c = np.sqrt((np.arange(4000) + 0.5) / 4000)  # cosines of light that comes from all around
    inside = np.sqrt(1 - (1 - c * c) / ior**2)
    R = (((c - ior * inside) / (c + ior * inside))**2 + ((ior * c - inside) / (ior * c + inside))**2) / 2 * fresnel
    close(light, np.mean(0.5 * (1 - R) if pane == "sheet" else 0.25 * (1 - R) / (1 + R)), 0.01, 0.005)


def test_a_thin_wall_lets_no_light_into_the_other_room():
    """Two rooms on one floor, with a wall .02 thick between; one has a lamp."""
    walls = [box((-2, -2, -0.1), (2, 2, 0)), box((-2, -2, 2), (2, 2, 2.1)), box((-2.1, -2, 0), (-2, 2, 2)),
             box((2, -2, 0), (2.1, 2, 2)), box((-2, -2.1, 0), (2, -2, 2)), box((-2, 2, 0), (2, 2.1, 2)),
             box((-0.01, -2, 0), (0.01, 2, 2))]
    rooms = [Shape(m, Material("grey", Od=(0.8, 0.8, 0.8))) for m in walls]
    lamp = Light("lamp", "POINT", (1.0, 1.0, 1.0), (-1.0, 0.0, 1.5))
    lit, dark = (scene(rooms, eye, (side * 0.6, 1, 0.2), 50, [lamp], (0, 0, 0), bounces=2, shadows="SHARP",
                       auto_h=False, h=0.05)
                 for eye, side in (((-1, -1.9, 1.5), -1), ((1, -1.9, 1.5), 1)))
    bright, leaked = (render_image(s).passes["Combined"][..., 0] for s in (lit, dark))
    assert bright.mean() > 0.1
    assert leaked.max() < 1e-3 * bright.mean()


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("bounces", [1, 2, 4])
def test_a_furnace(monkeypatch, albedo, bounces):
    """A closed room of emitting walls, with a box in it: emission · Σ albedo^k."""
    for limit in ("MOST", "BALLS", "TUBES"):  # no lamps: all emission is gathered
        monkeypatch.setattr(emitters, limit, 0)
    glows = Material("glows", Od=(albedo,) * 3, emission=(1.0, 1.0, 1.0))
    shapes = [Shape(box((-2, -2, 0), (2, 2, 3)), glows), Shape(box((-0.5, -0.5, 0.2), (0.5, 0.5, 1)), glows)]
    light = render_image(scene(shapes, (0, -1.9, 1.5), (0, 0, 1.2), 8, world=(0, 0, 0), bounces=bounces)).passes[
        "Combined"][..., 0]
    np.testing.assert_allclose(light, sum(albedo**k for k in range(bounces + 2)), rtol=0.01)


@pytest.mark.parametrize("bounces", [1, 3])
def test_a_furnace_of_small_triangles(monkeypatch, bounces):
    """Patches there are triangles that stand for others, and wider ones gather for them."""
    for limit in ("MOST", "BALLS", "TUBES"):
        monkeypatch.setattr(emitters, limit, 0)
    glows = Material("glows", Od=(0.6,) * 3, emission=(1.0, 1.0, 1.0))
    shapes = [Shape(sphere(2.0, 96, 48), glows), Shape(sphere(0.4, 48, 24), glows)]
    of = scene(shapes, (0, -1.6, 0.4), (0, 0, 0), 8, world=(0, 0, 0), bounces=bounces, auto_h=False, h=0.2)
    ready = prepare(of, ("Combined",))
    light = draw(ready, Framebuffer.create(of, ("Combined",))).passes["Combined"][..., 0]
    gather = ready.everywhere.records._gather
    assert (gather.for_small[0] >= 0).all()
    assert len(np.unique(gather.for_small[3])) < len(gather.for_small[3]) / 4
    np.testing.assert_allclose(light, sum(0.6**k for k in range(bounces + 2)), rtol=0.01)


def test_triangles_that_stand_for_others():
    """The first one of those in a cell whose normals are nearest to the same axis, with their material and instance."""
    shapes = [Shape(sphere(0.5, 24, 12), WHITE, matrices=[translate(0, 0, 0.5), translate(0.3, 0, 0.5)]),
              Shape(sphere(0.3, 12, 6), BLACK, matrices=[translate(0, 1, 0.5)]), Shape(FLOOR, WHITE)]
    of = scene(shapes, (0, -3, 1), bounces=1, auto_h=False, h=0.05)
    ready = prepare(of, ("Combined",))
    g, found = ready.everywhere.records._field.grids, ready.everywhere.records._gather.for_small
    s, every = g.surfaces, np.arange(len(g.longest))
    N, middle = g.normals(every), s.vertices[s.triangles].astype(np.float64).mean(1) * s.scale + s.centre
    axis = np.abs(N).argmax(1)
    several = 0
    for step, first in enumerate(found):
        size, stands = everywhere.PATCH * everywhere.step(0.05) * 2.0**step, {}
        for t in every:
            key = (*np.floor(middle[t] / size), axis[t], N[t, axis[t]] > 0, s.materials[s.source[t]], s.instance[t])
            assert first[t] == (stands.setdefault(key, t) if g.longest[t] <= size else -1)
        several += sum(first >= 0) - len(stands)
    assert several > 1000


def test_wider_patches_of_all_sizes_are_patches():
    """Also around triangles that are smaller than some sizes of patches only."""
    shapes = [Shape(sphere(r, 24, 12), WHITE, matrices=[translate(3 * r, 0, r)]) for r in (0.2, 0.5, 1.0, 2.0, 4.0)]
    of = scene([*shapes, Shape(FLOOR, WHITE)], (0, -3, 1), bounces=1, auto_h=False, h=0.05)
    records = prepare(of, ("Combined",)).everywhere.records
    gather, g = records._gather, records._field.grids
    s, random = g.surfaces, np.random.default_rng(0)
    triangle = random.integers(len(g.longest), size=5000).astype(np.int32)
    P = s.vertices[s.triangles[triangle]].astype(np.float64).mean(1) * s.scale + s.centre
    met = gather.at(triangle, P, -g.normals(triangle), 2.0 ** random.uniform(-5, 5, 5000))
    whole = g.sizes(met.keys)[1] == 0
    assert 0.2 < whole.mean() < 0.8
    np.testing.assert_allclose(np.stack([met.u, met.v]), 1 / 3, atol=1e-4)
    for by in (1, 3):
        size, level = g.sizes(met.keys)
        wider, above = g.sizes(g.wider(met.keys, by, gather.for_small))
        assert (above[whole] == 0).all() and (wider[whole] <= gather._finest * 2.0 ** (len(gather.for_small) - 1)).all()
        np.testing.assert_array_equal(above[~whole], np.maximum(level[~whole] - by, 1))
        assert (wider[~whole] >= size[~whole]).all()


def things(pixels=60, eye=(0.0, -4.0, 2.5), **more):
    """Some things under a sky and a lamp."""
    red = Material("red", Od=(0.7, 0.1, 0.1))
    clear = Material("clear", Od=(0.2, 0.5, 0.2), kd=0.5, kt=(0.5, 0.5, 0.5))
    shapes = [Shape(FLOOR, Material("grey", Od=(0.6, 0.6, 0.6))), Shape(box((-1, -0.3, 0), (-0.3, 0.4, 0.7)), red),
              Shape(sphere(0.4), WHITE, matrices=[translate(0.3, 0, 0.4)]),
              Shape(rectangle((0.5, -0.6), (1.5, 0.6), 0.8), clear)]
    lamp = Light("lamp", "POINT", (5.0, 5.0, 5.0), (1.0, -2.0, 3.0))
    return scene(shapes, eye, (0, 0, 0.3), pixels, [lamp], (0.3, 0.4, 0.5),
                 **{"bounces": 2, "shadows": "SHARP", "auto_h": False, "h": 0.05} | more)


def test_tiles_threads_and_order_change_no_bit():
    of = things()
    pictures = [draw(prepare(of, ("Combined",)), Framebuffer.create(of, ("Combined",)), threads=threads,
                     tile_size=size).passes["Combined"] for threads, size in ((1, 256), (2, 8), (7, 16))]
    for picture in pictures[1:]:
        np.testing.assert_array_equal(picture, pictures[0])


def test_records_are_kept_while_they_are_right():
    """A flight gathers little anew and has the same pictures; a moved box gathers all anew."""
    first, other = things(), things(eye=(0.3, -4.0, 2.5))
    ready = prepare(first, ("Combined",))
    counted = draw(ready, Framebuffer.create(first, ("Combined",))).statistics["records"]
    then = prepare(other, ("Combined",), previous=ready)
    result = draw(then, Framebuffer.create(other, ("Combined",)))
    assert result.statistics["records"] < 0.5 * counted
    np.testing.assert_array_equal(result.passes["Combined"], render_image(other).passes["Combined"])

    moved = replace(other, geometry=replace(other.geometry, instance_matrix=other.geometry.instance_matrix
                                            + np.array([np.zeros((4, 4)), *[translate(0.1, 0, 0) - np.eye(4)] * 3])))
    after = draw(prepare(moved, ("Combined",), previous=then), Framebuffer.create(moved, ("Combined",)))
    np.testing.assert_array_equal(after.passes["Combined"], render_image(moved).passes["Combined"])


def test_a_point_has_the_same_light_in_every_frame_of_a_flight():
    """From wherever it is seen: what is gathered depends on the scene only, also if all is gathered anew."""
    frames = [prepare(things(20, eye=(0.4 * i, -4.0, 2.5 - 0.2 * i)), ("Combined",)) for i in range(3)]
    _, hits = frames[0].world.coarse_view()
    for ready in frames[1:]:
        draw(ready, Framebuffer.create(ready.scene, ("Combined",)))
    first, *others = (ready.everywhere.records(hits, lambda: None).light for ready in frames)
    assert first.max() > 0.1
    for light in others:
        np.testing.assert_array_equal(light, first)


def test_cells_in_which_nothing_stands_spare_short_rays(monkeypatch):
    """Fins smaller than cells, a screen, a sheet just above the floor: the same light as with rays of each receiver."""
    screen = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
    more = [Shape(rectangle((0.0, -0.02), (0.06, 0.02)), WHITE, matrices=[
                translate(-0.7 + 0.093 * i, -0.6 - 0.061 * i, 0.0) @ screen for i in range(16)]),
            Shape(rectangle((0.0, -0.3), (0.3, 0.3)), WHITE, matrices=[translate(0.8, -0.7, 0) @ screen]),
            Shape(rectangle((-0.2, -0.1), (0.2, 0.1), 0.001), WHITE, matrices=[translate(-0.2, -0.9, 0)])]
    of = scene([Shape(FLOOR, WHITE), Shape(sphere(0.4), WHITE, matrices=[translate(0, 0.3, 0.4)]), *more],
               (0.5, -3.0, 1.5), (0, -0.5, 0.1), 120, auto_h=False, h=0.1)
    pictures, rays = [], []
    for clear in (Nearness.clear, lambda self, corners, *_: np.zeros(len(corners), np.bool_)):
        monkeypatch.setattr(Nearness, "clear", clear)
        result = render_image(of)
        pictures.append(result.passes["Combined"])
        rays.append(result.statistics["gathered_short_rays"])
    np.testing.assert_allclose(pictures[0], pictures[1], rtol=1e-6)
    assert rays[0] < 0.5 * rays[1]


def test_nothing_is_gathered_on_what_is_cut_out(monkeypatch):
    """A rough sheet that is not there reflects nothing."""
    asked, call = [], Records.__call__

    def listen(self, hits, check):
        asked.append(hits.material)
        return call(self, hits, check)

    monkeypatch.setattr(Records, "__call__", listen)
    gone = Material("gone", alpha=0.0, highlight="GGX", blurred=True, dielectric=1.0, roughness=0.7)
    sheet = Shape(rectangle((-1, -1), (1, 1), 0.5), gone)
    render_image(scene([Shape(FLOOR, WHITE), sheet], (0, -3, 2), mode="WHITTED"))
    assert set(np.concatenate(asked)) == {0}


def test_what_fails_in_one_thread_ends_those_that_wait(monkeypatch):
    of = things()
    ready = prepare(of, ("Combined",))
    look, calls = ready.everywhere.records._patches._look, []

    def fails(*arguments):
        calls.append(1)
        if len(calls) == 5:
            raise RuntimeError("no such surface")
        return look(*arguments)

    monkeypatch.setattr(ready.everywhere.records._patches, "_look", fails)
    with pytest.raises(RuntimeError, match="no such surface"):
        draw(ready, Framebuffer.create(of, ("Combined",)), threads=4, tile_size=8)
    monkeypatch.undo()
    again = draw(prepare(of, ("Combined",), previous=ready), Framebuffer.create(of, ("Combined",)))
    np.testing.assert_array_equal(again.passes["Combined"], render_image(of).passes["Combined"])


def test_parts_of_the_light_add_up():
    of = things()
    names = ("Diffuse", "Diffuse Indirect", "Glossy", "Emission", "Ambient", "Transmission", "Environment")
    passes = render_image(of, ("Combined", "Ambient Occlusion", *names)).passes
    np.testing.assert_allclose(sum(passes[n] for n in names), passes["Combined"][..., :3], atol=1e-6)
    assert passes["Diffuse Indirect"].max() > 0.1
    assert not passes["Ambient"].any()
    assert 0 <= passes["Ambient Occlusion"].min() < 0.5
    assert passes["Ambient Occlusion"].max() == 1


def test_without_it_nothing_is_gathered():
    of = things(world_light="AMBIENT", bounces=0)
    result = render_image(of)
    assert "records" not in result.statistics
    assert "light from everywhere" not in result.statistics["plan"]


def test_objects_that_diffuse_rays_do_not_meet():
    """A roof over a plane that only the camera and shadow rays may meet takes no sky light."""
    roof = Shape(rectangle((-5, -5), (5, 5), 1.0), BLACK, flags={"visible_diffuse": False, "visible_camera": False})
    _, light = seen(scene([Shape(FLOOR, WHITE), roof], (0, -4, 3)), lambda x, y, z: z < 0.5)
    np.testing.assert_allclose(light, 1, rtol=1e-6)


def test_cloth_sends_light_on_as_a_matt_surface_of_its_albedo():
    cloth = Material("cloth", kd=0.0, ka=0.0, highlight="GGX", blurred=True, sheen=1.0,
                     sheen_roughness=0.6, sheen_tint=(1.0, 0.5, 0.2))
    sine2 = (np.arange(2000) + 0.5) / 2000
    up = np.tile((0.0, 0.0, 1.0), (2000, 1))
    eyes = np.stack([np.sqrt(sine2), np.zeros(2000), np.sqrt(1 - sine2)], axis=1)
    past = shading.covered((0.0, 0.0, 1.5, 1.0, 1.0, 1.0, 1.0), (1.0, 0.6, 1.0, 0.5, 0.2), up, eyes)
    matt = Material("matt", Od=tuple((1 - past).mean() * np.array([1.0, 0.5, 0.2])))
    lamp = Light("lamp", "POINT", (20.0, 20.0, 20.0), (0.0, -1.0, 1.0))
    wall = Shape(rectangle((-1, -1), (1, 1), 0), WHITE, "wall", matrices=[np.array(
        [[1, 0, 0, 0], [0, 0, 1, 0.5], [0, 1, 0, 1], [0, 0, 0, 1]], np.float64)])
    found = []
    for floor in (cloth, matt):
        made = scene([wall, Shape(FLOOR, floor)], (0, -4, 1.0), (0, 0.5, 0.8), lights=[lamp])
        passes = render_image(replace(made, settings=replace(made.settings, bounces=1, world_light="AMBIENT")),
                              ["Diffuse Indirect", "Position", "Depth"]).passes
        on_wall = (passes["Depth"][..., 0] < 1e9) & (np.abs(passes["Position"][..., 1] - 0.5) < 1e-5)
        found.append(passes["Diffuse Indirect"][on_wall])
    assert found[1].max() > 1e-3
    np.testing.assert_allclose(found[0], found[1], rtol=0.03, atol=1e-3 * found[1].max())


def test_many_lamps_have_shadows_in_groups_on_what_they_light(monkeypatch):
    """A floor seen by the light that a wall and a ball return, under 100 lamps, as if patches asked each."""
    lamps = [Light(f"lamp {i}", "POINT", (0.05 + 0.05 * (i % 3),) * 3, (i % 10 * 0.4 - 2, -1.5, 0.4 + i // 10 * 0.3))
             for i in range(100)]
    shapes = [Shape(box((-3, 1, 0), (3, 1.2, 3)), WHITE), Shape(FLOOR, WHITE),
              Shape(sphere(0.5, 32, 16), WHITE, matrices=[translate(0.5, 0.2, 0.5)])]
    of = scene(shapes, (0, -4, 2), (0, 0, 0.8), 40, lamps, (0, 0, 0), bounces=1, shadows="SHARP", auto_h=False, h=0.1)
    passes = []
    for part in (0.0, everywhere.PART):
        monkeypatch.setattr(everywhere, "PART", part)
        passes.append(render_image(of, ("Combined", "Diffuse Indirect")).passes["Diffuse Indirect"][..., 0])
    error = np.abs(passes[1] - passes[0]) / passes[0].mean()
    assert error.max() > 0 and np.median(error) < 0.005 and np.percentile(error, 99) < 0.03


@pytest.mark.parametrize(("turn", "h"), [(0.5, 0.03), (0.2, 0.05)])
def test_no_smudges_where_a_box_stands_on_a_lit_floor(turn, h):
    """The foot of its front sees a floor that is evenly lit, also where patches of the floor are mostly below it."""
    c, s = np.cos(turn), np.sin(turn)
    turned = np.array([[c, -s, 0, 0], [s, c, 0, 0.3], [0, 0, 1, 0], [0, 0, 0, 1]])
    shapes = [Shape(box((-0.3, -0.3, 0), (0.3, 0.3, 1.2)), WHITE, matrices=[turned]),
              Shape(rectangle((-1, -1), (1, 1)), WHITE)]
    sun = Light("sun", "SUN", (3.0, 3.0, 3.0), direction=(0.0, 0.28, -0.96))
    eye, target = (0.0, -1.5, 0.3), (0.0, 0.0, 0.02)
    of = replace(scene(shapes, eye, lights=[sun], world=(0, 0, 0), bounces=1, shadows="SHARP", auto_h=False, h=h),
                 camera=Camera.look_at(eye, target, 20, 100, 100))
    passes = render_image(of, ("Combined", "Diffuse Indirect", "Position", "Depth")).passes
    x, y, z = np.moveaxis(passes["Position"], -1, 0)
    front = (passes["Depth"][..., 0] < 1e9) & (z > 1e-4) & (z < 0.03) & (np.abs(x * c + (y - 0.3) * s) < 0.25)
    light = passes["Diffuse Indirect"][..., 0][front]
    assert len(light) > 100
    assert light.min() > 0.9 * np.median(light)
