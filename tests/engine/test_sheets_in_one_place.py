"""Cut-outs and films in one plane, or nearer than a ray's offset: each is crossed once and none is skipped."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from light_meshes import Mesh, Scene, Shape, box, rectangle, rotate_x, sphere, translate
from light_meshes.picture.render import Prepared, render_image
from light_meshes.rays.geometry import flatten
from light_meshes.rays.stacks import stacks
from light_meshes.scene.description import Material
from scenes import GREY, IDENTITY, WHITE, look_down, point, settings

DISTANCES = (0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1e-3)


def film(t, name="film"):
    return Material(name, Od=(0, 0, 0), ka=0.0, kd=0.0, kt=t if isinstance(t, tuple) else (t, t, t))


def shining(*colour):
    return Material(f"shining {colour}", Od=(0, 0, 0), ka=0.0, kd=0.0, emission=colour)


FILMS = film((0.5, 1, 1), "a"), film((1, 0.5, 1), "b"), film((1, 1, 0.5), "c")
SQUARE = rectangle((-1, -1), (1, 1), 0.0)
DIAGONAL = Mesh(SQUARE.vertices, np.array([(1, 2, 3), (1, 3, 0)]))  # the other way
BACK = Mesh(SQUARE.vertices, SQUARE.triangles[:, ::-1])


def of(mesh):
    return Mesh(mesh.vertices.copy(), mesh.triangles)


def view(parts, lights=(), turned=IDENTITY, **values):
    """From above, all turned."""
    parts = [replace(p, matrices=[turned @ m for m in p.matrices]) for p in parts]
    camera = look_down(0.03, 0.04, 1.7, 16)
    camera = replace(camera, matrix=turned @ camera.matrix)
    lights = [replace(light, position=tuple((turned @ [*light.position, 1])[:3].tolist())) for light in lights]
    return Scene.from_shapes(parts, camera, lights,
                             settings(mode="WHITTED", **{"shadows": "SHARP", "cutoff": 0.0, **values}))


def colours(scene):
    return render_image(scene).passes["Combined"][..., :3].reshape(-1, 3).astype(float)


@pytest.mark.parametrize("order", list(permutations(range(4)))[::5])
@pytest.mark.parametrize("d", DISTANCES)
@pytest.mark.parametrize("turned", [IDENTITY, rotate_x(0.7)], ids=["flat", "turned"])
def test_the_camera_sees_through_all_films_to_what_lies_behind(order, d, turned):
    meshes = SQUARE, DIAGONAL, BACK, rectangle((-3, -3), (5, 4), 0.0)
    materials = (*FILMS, shining(1.0, 1.0, 1.0))
    parts = [Shape(of(meshes[k]), materials[k], f"{k}", [translate(0, 0, -d * k)]) for k in order]
    np.testing.assert_allclose(colours(view(parts, turned=turned)), 0.5, atol=1e-6)


@pytest.mark.parametrize("d", DISTANCES)
@pytest.mark.parametrize("front", [SQUARE, BACK], ids=["", "from behind"])
def test_the_card_in_front_is_seen_and_the_one_behind_through_its_hole(d, front):
    blue, red = shining(0, 0, 1), shining(1, 0, 0)
    hole = replace(shining(0, 0, 1), name="hole", alpha=0.0)
    for turn in (1, -1):
        parts = [Shape(of(front), red, "behind", [translate(0, 0, -d)]),
                 Shape(of(SQUARE), hole, "hole", [translate(-1, 0, 0)]),
                 Shape(of(DIAGONAL), replace(blue, alpha=0.999999), "front", [translate(1, 0, 0)])]
        seen = colours(view(parts[::turn])).reshape(16, 16, 3)
        np.testing.assert_allclose(seen[:, :7], np.broadcast_to([1, 0, 0], (16, 7, 3)), atol=1e-4)
        np.testing.assert_allclose(seen[:, 9:], np.broadcast_to([0, 0, 1], (16, 7, 3)), atol=1e-4)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
@pytest.mark.parametrize("d", DISTANCES)
@pytest.mark.parametrize("joined", [False, True])
@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
def test_light_crosses_each_film_once(order, d, joined, shadows):
    """Films over a floor, each an object or all one mesh."""
    meshes = [SQUARE, DIAGONAL, BACK]
    stack = [(of(meshes[k]), film(0.5), [translate(0, 0, 0.5 + d * k)]) for k in order]
    parts = [Shape(m, f, "film", t) for m, f, t in stack]
    if joined:
        corners = np.concatenate([m.vertices @ t[0][:3, :3].T + t[0][:3, 3] for m, _, t in stack])
        parts = [Shape(Mesh(corners, np.concatenate([m.triangles + 4 * n for n, (m, *_) in enumerate(stack)])),
                       film(0.5), "films")]
    floor = Shape(rectangle((-2, -2), (2, 2), 0.0), WHITE, "floor")
    lamp = [point((0.2, 0.1, 3.0), 9.0)]
    scene = view([floor, *parts], lamp, shadows=shadows, h=0.05, kI=2.0)
    P = np.c_[np.random.default_rng(0).uniform(-0.5, 0.5, (50, 2)), np.zeros(50)]
    S = Prepared(scene).light_visibility(P, np.tile((0.0, 0.0, 1.0), (50, 1))).reshape(50, -1)
    np.testing.assert_allclose(S, 0.125, rtol=1e-6)


@pytest.mark.parametrize("d", DISTANCES)
@pytest.mark.parametrize("first", [True, False])
def test_a_film_on_a_wall_tints_its_light_both_ways(d, first):
    wall, foil = Shape(of(DIAGONAL), WHITE, "wall"), Shape(of(SQUARE), film(0.5), "foil", [translate(0, 0, d)])
    lamp = [point((0.2, 0.1, 3.0), 9.0)]
    bare = colours(view([wall], lamp))
    np.testing.assert_allclose(colours(view([wall, foil] if first else [foil, wall], lamp)), bare / 4, rtol=1e-5)


@pytest.mark.parametrize("d", DISTANCES)
def test_a_film_on_a_mirror_is_crossed_twice(d):
    mirror = Shape(of(DIAGONAL), Material("mirror", Od=(0, 0, 0), ka=0.0, kd=0.0, mirror=(1.0, 1.0, 1.0)), "mirror")
    ceiling = Shape(rectangle((-30, -30), (30, 30), 20.0), shining(1.0, 1.0, 1.0), "ceiling")
    for parts in permutations([mirror, ceiling, Shape(of(SQUARE), film(0.5), "foil", [translate(0, 0, d)])]):
        np.testing.assert_allclose(colours(view(parts)), 0.25, atol=1e-6)


@pytest.mark.parametrize("d", DISTANCES)
def test_refracted_light_crosses_each_film_once(d):
    """Behind a pane of glass, whose paths are followed one by one."""
    glass = Material("glass", Od=(0, 0, 0), ka=0.0, kd=0.0, kt=(1.0, 1.0, 1.0), ior=1.5)
    pane = Shape(box((-1.5, -1.5, 1.0), (1.5, 1.5, 1.2)), glass, "pane")
    floor = Shape(rectangle((-2, -2), (2, 2), 0.0), WHITE, "floor")
    P = np.c_[np.random.default_rng(0).uniform(-0.4, 0.4, (20, 2)), np.zeros(20)]
    S = []
    for t in (1.0, 0.5):
        meshes = [SQUARE, DIAGONAL, BACK]
        corners = np.concatenate([np.add(m.vertices, (0, 0, 0.5 + d * k)) for k, m in enumerate(meshes)])
        films = Mesh(corners, np.concatenate([m.triangles + 4 * k for k, m in enumerate(meshes)]))
        lamp = [point((0.2, 0.1, 3.0), 9.0)]
        scene = view([floor, pane, Shape(films, film(t), "films")], lamp, refraction="FULL", caustics="PAPER")
        S.append(Prepared(scene).light_visibility(P, np.tile((0.0, 0.0, 1.0), (20, 1))).reshape(20, -1))
    assert (S[0] > 0.5).all()
    np.testing.assert_allclose(S[1], S[0] / 8, rtol=1e-5)


def test_meshes_without_anything_in_one_place_have_no_partners():
    for mesh in (sphere(1.0, 24, 12), box((-1, -1, -1), (1, 1, 1)), rectangle((-1, -1), (1, 1), 0.0)):
        surfaces, _ = flatten(view([Shape(mesh, film(0.5), "film"), Shape(box((2, 2, 2), (3, 3, 3)), GREY, "box")]))
        every = np.ones(len(surfaces.triangles), bool)
        assert stacks(surfaces, every, ~every) is None


def test_partners_are_those_that_overlap():
    """Against all pairs of a heap of cards, looked at one by one at random points."""
    random = np.random.default_rng(3)
    heights = [1e-7 * (k % 3) + (k % 2) for k in range(24)]
    cards = [Shape(Mesh(np.c_[random.uniform(-1, 1, (3, 2)), np.full(3, z)], np.array([(0, 1, 2)])), film(0.5), f"{z}")
             for z in heights]
    surfaces, _ = flatten(view(cards))
    every = np.ones(24, bool)
    found = stacks(surfaces, every, ~every)
    corners = surfaces.vertices[surfaces.triangles].astype(float)
    points = random.uniform(-1, 1, (40000, 2)) / surfaces.scale - surfaces.centre[:2] / surfaces.scale
    inside = np.empty((24, len(points)), bool)
    for k, c in enumerate(corners[..., :2]):
        e = [(b - a)[0] * (points[:, 1] - a[1]) - (b - a)[1] * (points[:, 0] - a[0])
             for a, b in zip(c, np.roll(c, -1, axis=0), strict=True)]
        inside[k] = np.all(np.array(e) > 0, 0) | np.all(np.array(e) < 0, 0)
    shared = inside.astype(int) @ inside.T.astype(int)
    for k in range(24):
        near = {n for n in range(24) if n != k and shared[k, n] > 3 and (n - k) % 2 == 0}
        assert near <= set(found.partner[found.first[k]:found.first[k + 1]].tolist())
        far = {n for n in range(24) if (n - k) % 2}
        assert not far & set(found.partner[found.first[k]:found.first[k + 1]].tolist())
