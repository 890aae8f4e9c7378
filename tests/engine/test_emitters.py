"""Surfaces that give light are lamps with a size: their light on a floor, against a sum over their triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Material, Mesh, Scene, Shape, box, cylinder, rectangle, rotate_x, rotate_y, sphere, translate
from light_meshes.picture import emitter_shapes as shapes
from light_meshes.picture import emitters
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from scenes import look_down, settings

GLOWS = Material("glows", Od=(0.0, 0.0, 0.0), emission=(3.0, 2.0, 1.0))
FLOOR = Material("floor", Od=(1.0, 1.0, 1.0), ka=0.0)
SIZE, PIXELS = 4.0, 24


def plate(x: float, y: float) -> Mesh:
    return rectangle((-x / 2, -y / 2), (x / 2, y / 2))


def disc(radius: float, n: int = 48) -> Mesh:
    a = np.linspace(0, 2 * np.pi, n, endpoint=False)
    ring = radius * np.stack([np.cos(a), np.sin(a), 0 * a], 1)
    return Mesh(np.concatenate([[[0.0, 0.0, 0.0]], ring]), [(0, 1 + k, 1 + (k + 1) % n) for k in range(n)])


def letters() -> Mesh:
    """Twenty bars side by side, of which no more than two fifths of their outline are there: one closed mesh."""
    bars = [box((-0.5 + 0.05 * i, -0.1 + 0.03 * (i % 2), -0.004), (-0.48 + 0.05 * i, 0.1, 0.004)) for i in range(20)]
    return Mesh(np.concatenate([b.vertices for b in bars]),
                np.concatenate([b.triangles + sum(len(o.vertices) for o in bars[:i]) for i, b in enumerate(bars)]))


def beads() -> Mesh:
    """Three balls as one mesh."""
    balls = [Mesh(sphere(r, 24, 12).vertices + np.array([x, 0, 0]), sphere(r, 24, 12).triangles)
             for x, r in ((-0.5, 0.1), (0.0, 0.2), (0.4, 0.05))]
    return Mesh(np.concatenate([b.vertices for b in balls]),
                np.concatenate([b.triangles + sum(len(o.vertices) for o in balls[:i]) for i, b in enumerate(balls)]))


def ring(radius: float, tube: float, n: int = 64, m: int = 12) -> Mesh:
    a, b = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    out = radius + tube * np.cos(b)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
    k, right = (i + 1) % n * m, (j + 1) % m
    return Mesh(np.stack([out * np.cos(a), out * np.sin(a), tube * np.sin(b)], -1).reshape(-1, 3), np.concatenate(
        [np.stack([i * m + j, k + j, k + right], 1), np.stack([i * m + j, k + right, i * m + right], 1)]))


SHAPES = {  # mesh, matrix, whether both sides are seen
    "panel": (plate(0.8, 0.5), translate(0.2, 0.1, 1.0), True),
    "round panel": (disc(0.5), translate(0.0, 0.3, 0.8) @ rotate_x(0.4), True),
    "round lamp": (cylinder(0.4, -0.03, 0.0, 128), translate(0.1, 0.2, 0.8) @ rotate_x(0.2), False),
    "tube": (cylinder(0.05, -1, 1, 24), translate(-1.0, 0.2, 0.4) @ rotate_y(np.pi / 2), False),
    "ball": (sphere(0.2, 24, 12), translate(0.3, 0.0, 0.6), False),
    "box": (box((-0.2, -0.15, -0.1), (0.2, 0.15, 0.1)), translate(0.0, 0.0, 0.5), False),
    "beads": (beads(), translate(0.3, 0.0, 0.6), False),
    "letters": (letters(), translate(0.1, 0.2, 1.0) @ rotate_x(0.5), False),
    "ring": (ring(0.5, 0.03), translate(0.1, 0.0, 0.7) @ rotate_x(0.3), False),
    "lens": (Mesh(sphere(0.3, 24, 12).vertices * (1, 0.7, 0.4), sphere(0.3, 24, 12).triangles),
             translate(0.1, 0.0, 0.6), False),
}


def scene(shape: str, **values) -> Scene:
    mesh, matrix, _ = SHAPES[shape]
    things = [Shape(plate(20, 20), FLOOR, "floor"), Shape(mesh, GLOWS, shape, (matrix,), {"visible_camera": False})]
    return Scene.from_shapes(things, look_down(0, 0, SIZE, PIXELS), [],
                             settings(**({"world_light": "SKY", "h": 0.05, "weights": "SMOOTH", "kI": 2.0} | values)))


def summed(shape: str) -> np.ndarray:
    """The irradiance of the floor at the pixels' centres, of light of radiance 1: the sum over small triangles."""
    mesh, matrix, two_sided = SHAPES[shape]
    corners = np.concatenate([mesh.vertices, np.ones((len(mesh.vertices), 1))], 1) @ matrix.T
    corners = corners[:, :3][mesh.triangles]
    while len(corners) < 3000:
        a, b, c = corners.swapaxes(0, 1)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(t, 1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    at = (np.arange(PIXELS) + 0.5) / PIXELS * SIZE - SIZE / 2
    P = np.stack([*np.meshgrid(at, at), np.zeros((PIXELS, PIXELS))], -1)
    to = corners.mean(1) - P[:, :, None]
    square = np.einsum("ijnk,ijnk->ijn", to, to)
    leaving = -np.einsum("ijnk,nk->ijn", to, cross)
    leaving = np.abs(leaving) if two_sided else np.maximum(leaving, 0)
    return (leaving * np.maximum(to[..., 2], 0) / square**2).sum(-1)


@pytest.mark.parametrize("shape", SHAPES)
def test_light_on_the_floor(shape: str) -> None:
    truth = summed(shape)[..., None] / np.pi * np.array(GLOWS.emission)
    seen = render_image(scene(shape)).passes["Combined"][..., :3]
    error = np.abs(seen / truth - 1)
    if shape == "letters":  # two lamps have the power of all their edges, too
        in_front = (slice(14, 20), slice(10, 15))  # 40 % of their area are edges, which send little there
        assert 1.0 < np.median(seen[in_front] / truth[in_front]) < 1.45
        return
    most = (0.035, 0.12) if shape == "ring" else (0.01, 0.02)  # its pieces are flat, and it hides some of itself
    assert np.median(error) <= most[0] and np.quantile(error, 0.95) <= most[1], np.quantile(error, (0.5, 0.95))


def test_power_is_exact() -> None:
    for shape, (_, _, two_sided) in SHAPES.items():
        bare = Prepared(scene(shape, world_light="AMBIENT")).world
        found = emitters.emitting(bare)
        lamps, taken, _ = emitters.lamps_of(bare, found)
        assert sorted(taken) == sorted(found.triangle)
        assert len(lamps) == {"letters": 2, "ring": shapes.PIECES, "ball": 1, "beads": 3}.get(shape, len(lamps))
        if lamps[0].type == "POINT":
            power = sum(4 * np.pi * lamp.intensity[0] for lamp in lamps)
        else:
            power = sum(np.pi * lamp.intensity[0] for lamp in lamps)
        exact = found.area.sum() * GLOWS.emission[0] * (1 + two_sided)
        assert power == pytest.approx(exact, rel=1e-5), shape


def bulbs(count: int, *others: Shape, radius: float = 0.012) -> tuple[Scene, np.ndarray]:
    """Bulbs over a floor, which the camera does not see; and their places."""
    place = np.random.default_rng(5).uniform((-2, -2, 0.3), (2, 2, 1.2), (count, 3))
    mesh, base, hidden = sphere(radius, 12, 6), scene("ball"), {"visible_camera": False}
    things = [Shape(plate(20, 20), FLOOR, "floor"), *others,
              *(Shape(mesh, GLOWS, f"bulb {i}", (translate(*p),), hidden) for i, p in enumerate(place.tolist()))]
    return Scene.from_shapes(things, base.camera, [], base.settings), place


def test_a_hundred_bulbs() -> None:
    """Each is a lamp: as the sum of so many points of light."""
    of, place = bulbs(100)
    corners = sphere(0.012, 12, 6).vertices[sphere(0.012, 12, 6).triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    at = (np.arange(PIXELS) + 0.5) / PIXELS * SIZE - SIZE / 2
    x, y = np.meshgrid(at, at)
    square = (x[..., None] - place[:, 0])**2 + (y[..., None] - place[:, 1])**2 + place[:, 2]**2
    truth = (place[:, 2] / square**1.5).sum(-1) * area * GLOWS.emission[0] / (4 * np.pi)
    found = render_image(of)
    error = np.abs(found.passes["Combined"][..., 0] / truth - 1)
    assert found.statistics["plan"]["emitting surfaces"].startswith("100 lamps")
    assert np.median(error) < 0.005 and error.max() < 0.03


def test_bulbs_have_few_sets_of_blockers() -> None:
    """A large ball shades the light of small bulbs, and they that of the ball; but the bulbs not each other's."""
    big = Shape(sphere(0.3, 24, 12), GLOWS, "big", (translate(0, 0, 0.6),))
    ready = Prepared(bulbs(40, big)[0])
    lamps, own = ready.scene.lights, {o.name: i for i, o in enumerate(ready.scene.objects)}
    blockers = {lamp.name.split(" (")[0]: set(lamp.blockers or ()) for lamp in lamps}
    assert len(lamps) == 41 and blockers.pop("big") == set(own.values()) - {own["big"]}
    assert all(own["big"] in those and own[name] not in those for name, those in blockers.items())
    assert len({lamp.blockers for lamp in lamps}) <= 1 + emitters.SETS


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("room", [box((-9, -9, -9), (9, 9, 12)), sphere(14, 24, 12),
                                  Mesh(sphere(1, 24, 12).vertices * (11, 13, 14), sphere(1, 24, 12).triangles)])
def test_a_room_that_glows_shines_inside(room: Mesh, seen: bool) -> None:
    """It is gathered: a floor in it has its radiance. Also where the camera is outside, and looks through."""
    things = [Shape(plate(5, 5), FLOOR, "floor"), Shape(room, GLOWS, "room", flags={"visible_camera": seen})]
    base = scene("ball")
    camera = base.camera if seen else look_down(0, 0, SIZE, PIXELS, height=30)
    picture = render_image(Scene.from_shapes(things, camera, [], base.settings)).passes["Combined"][..., :3]
    np.testing.assert_allclose(picture, np.broadcast_to(GLOWS.emission, picture.shape), rtol=0.005)


def test_only_where_light_is_gathered() -> None:
    assert not Prepared(scene("panel", world_light="AMBIENT")).scene.lights
    assert len(Prepared(scene("panel")).scene.lights) == 2
    assert len(Prepared(scene("panel", world_light="AMBIENT", bounces=1)).scene.lights) == 2


def test_many_are_gathered_instead() -> None:
    """No more than MOST lamps: those with most power. The others' triangles are not taken."""
    places = tuple(translate(x / 10, y / 10, 1.0) for x in range(20) for y in range(20))
    one = scene("panel")
    things = [Shape(plate(0.01, 0.01), GLOWS, "many", places), Shape(plate(0.5, 0.5), GLOWS, "large")]
    ready = Prepared(Scene.from_shapes(things, one.camera, [], one.settings))
    assert len(ready.scene.lights) == emitters.MOST
    assert ready.scene.lights[0].name == "large (emission)"
    assert np.count_nonzero(ready.world.as_lamps) == emitters.MOST  # two triangles for two sides


def test_inside_out_and_mirrored() -> None:
    mesh, matrix, _ = SHAPES["box"]
    turned = Mesh(mesh.vertices, mesh.triangles[:, ::-1])
    expected = render_image(scene("box")).passes["Combined"]
    for m, place in ((turned, matrix), (mesh, matrix @ np.diag([-1.0, 1, 1, 1]))):
        other = scene("box")
        things = [Shape(plate(20, 20), FLOOR, "floor"), Shape(m, GLOWS, "box", (place,), {"visible_camera": False})]
        other = Scene.from_shapes(things, other.camera, [], other.settings)
        np.testing.assert_allclose(render_image(other).passes["Combined"], expected, rtol=0.02, atol=1e-3)


def test_toggles() -> None:
    """A lampshade casts a shadow in the light of the bulb, and the bulb none in its own."""
    things = [Shape(plate(20, 20), FLOOR, "floor"),
              Shape(sphere(0.1, 24, 12), GLOWS, "bulb", (translate(0, 0, 1),), {"visible_camera": False}),
              Shape(plate(0.6, 0.6), FLOOR, "shade", (translate(0, 0, 0.5),), {"visible_camera": False})]
    base = scene("ball")
    shaded = Scene.from_shapes(things, base.camera, [], base.settings)
    picture = render_image(shaded).passes["Combined"][..., 0]
    free = render_image(replace(shaded, objects=tuple(
        replace(o, visible_shadow=o.name != "shade") for o in shaded.objects))).passes["Combined"][..., 0]
    middle = slice(PIXELS // 2 - 1, PIXELS // 2 + 1)
    assert not picture[middle, middle].any() and free[middle, middle].all()
    np.testing.assert_allclose(picture[0], free[0], rtol=1e-6)


def test_what_diffuse_rays_do_not_see_lights_nothing() -> None:
    """The visible bulb around a lamp, for example."""
    shown = scene("ball")
    hidden = replace(shown, objects=tuple(replace(o, visible_diffuse=o.name != "ball") for o in shown.objects))
    assert len(Prepared(shown).scene.lights) == 1 and not Prepared(hidden).scene.lights
    assert not render_image(hidden).passes["Combined"][..., :3].any()


def test_lamps_have_the_links_of_their_objects() -> None:
    """They light and are blocked by what their object says, and linked ones become lamps before others."""
    things = [Shape(plate(20, 20), FLOOR, "floor"),
              Shape(sphere(0.1, 24, 12), GLOWS, "bulb", (translate(0, 0, 1),), {"blockers": (0, 1), "receivers": (2,)}),
              Shape(plate(0.6, 0.6), FLOOR, "shade", (translate(0, 0, 0.5),)),
              Shape(plate(2.0, 2.0), GLOWS, "large", (translate(0, 0, 4.0),))]
    of = Scene.from_shapes(things, scene("ball").camera, [], scene("ball").settings)
    first, *others = Prepared(of).scene.lights
    assert (first.name, first.receivers, first.blockers) == ("bulb (emission)", (2,), (0,))
    assert others and all(lamp.receivers is None and lamp.blockers is None for lamp in others)


@pytest.mark.parametrize("faces", [8, 32])
@pytest.mark.parametrize("smooth", [False, True])
def test_a_ball_that_glows_does_not_light_itself(smooth: bool, faces: int) -> None:
    """It is matt, too, as Blender's Principled is by default: once its lamp made it nearly twice as bright, but for the
    corners of its faces, which were dark dots.
    """
    ball = Shape(sphere(0.5, faces, faces // 2, smooth), replace(GLOWS, Od=(0.8, 0.8, 0.8)), "ball")
    alone = Scene.from_shapes([ball], look_down(0, 0, SIZE, PIXELS), [], scene("ball").settings)
    assert [light.type for light in Prepared(alone).world.scene.lights] == ["POINT"]
    seen = render_image(alone).passes["Combined"][..., :3]
    there = seen[..., 0] > 0
    assert there.sum() > 20
    np.testing.assert_allclose(seen[there], np.tile(GLOWS.emission, (there.sum(), 1)), rtol=1e-5)
