"""Refracted shadow paths, eq. (6): scenes with a known answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Mesh, Scene, Shape, box, rectangle, scale, sphere, translate
from light_meshes.glass.media import closed
from light_meshes.rays.geometry import flatten
from refraction_reference import FLOOR, GLASS, Lab, Stuff, only, paths, torus
from scenes import look_down


def test_light_at_the_centre_of_a_sphere_is_not_bent():  # H4
    lab = Lab([(Shape(sphere(1, 48, 24)), Stuff(1.5, (0.9, 0.8, 0.7)))], (0, 0, 0))
    x = np.random.default_rng(0).normal(size=(200, 3))
    x *= (1.5 / np.linalg.norm(x, axis=1))[:, None]
    found = only(lab, *x)
    assert np.allclose(found.arrival, x / 1.5, atol=1e-6)
    assert np.allclose(found.alpha, (0.9, 0.8, 0.7), rtol=1e-12)
    assert np.allclose(found.J, 1, atol=1e-5)
    assert (lab.solver.straight(0, x) == 0).all()  # the straight way is that very path: it must not count twice


def test_sun_through_a_slab_is_shifted():  # H6
    lab = Lab([(Shape(box((-5, -5, 0), (5, 5, 0.3))), GLASS)], sun=(1, 0, -1))
    inner = np.arcsin(np.sin(np.pi / 4) / 1.5)
    leaves = np.array([0.3 * np.tan(inner), 0.3, 0.0])
    d = np.array([1, 0, -1]) / np.sqrt(2)
    found = only(lab, leaves + 2 * d)
    assert np.allclose(found.P[0], leaves, atol=1e-6)
    along = 0.3 * np.tan(np.pi / 4) - found.P[0, 0]  # it came in over the origin
    assert along == pytest.approx(0.1396, abs=5e-5)
    assert along * np.cos(np.pi / 4) == pytest.approx(0.0987, abs=5e-5)
    assert np.allclose(found.arrival[0], d, atol=1e-7)
    assert np.allclose(found.alpha, 0.81) and found.J[0] == pytest.approx(1, abs=1e-6)


def test_point_light_behind_a_slab_has_one_path():  # H6
    lab = Lab([(Shape(box((-5, -5, 0), (5, 5, 0.3))), GLASS)], (0.2, 0.1, 2))
    x = np.random.default_rng(1).uniform((-2, -2, -2), (2, 2, -0.1), (500, 3))
    assert np.allclose(only(lab, *x).alpha, 0.81)


def test_core_of_the_same_glass_changes_no_path():  # H7
    whole = [(Shape(sphere(1, 48, 24)), GLASS)]
    core = [*whole, (Shape(sphere(0.5, 32, 16), matrices=[translate(0.1, 0, 0)]), Stuff(1.5, 0.5))]
    x = np.random.default_rng(2).uniform(-2, 2, (400, 3))
    a, b = (paths(Lab(parts, (0, 0, 4)), *x) for parts in (whole, core))
    assert np.array_equal(a.start, b.start)
    assert np.allclose(a.P, b.P, atol=1e-6) and np.allclose(a.J, b.J, rtol=1e-4)
    crossed = b.alpha[:, 0] / a.alpha[:, 0]
    assert np.isclose(crossed[:, None], (1, 0.5, 0.25)).any(1).all() and (crossed < 0.9).any()


def test_core_that_fills_a_hollow_shell_exactly():  # H7, with surfaces in one place
    solid, hole = sphere(1, 48, 24), sphere(0.5, 48, 24)
    shell = Mesh(np.vstack([solid.vertices, hole.vertices]),
                 np.vstack([solid.triangles, hole.triangles[:, ::-1] + len(solid.vertices)]),
                 np.concatenate([solid.normals, -hole.normals[:, ::-1]]))
    x = np.random.default_rng(3).uniform(-2, 2, (300, 3))
    x = x[abs(np.linalg.norm(x, axis=1) - 0.5) > 0.01]
    whole = paths(Lab([(Shape(solid), Stuff(1.5, 1))], (0.1, 0.2, 4)), *x)
    filled = paths(Lab([(Shape(shell), Stuff(1.5, 1)), (Shape(hole), Stuff(1.5, 1))], (0.1, 0.2, 4)), *x)
    assert np.array_equal(whole.start, filled.start) and np.allclose(whole.P, filled.P, atol=1e-6)
    hollow = Lab([(Shape(shell), Stuff(1.5, 1))], (0.1, 0.2, 4))
    assert not np.array_equal(paths(hollow, *x).start, whole.start)


def test_index_one_leaves_straight_ways():  # H7: M3 = M1
    lab = Lab([(Shape(sphere(1, 48, 24)), Stuff(1.0, (0.9, 0.5, 1))),
               (Shape(box((-2, -2, -2), (2, 2, -1.5))), Stuff(1.0, 0.8))], (0, 0.3, 4))
    x = np.random.default_rng(4).uniform(-3, 3, (300, 3))
    found, work = lab.solver.paths(0, x)
    assert len(found.alpha) == 0 and work.seeds == 0
    expected = np.ones((len(x), 3))
    for i, p in enumerate(x):
        t, index = lab.hits(lab.light, p - lab.light)
        for j in index[(t > 0) & (t < 1)]:
            expected[i] *= lab.parts[lab.owner[j]][1].t
    assert np.allclose(lab.solver.straight(0, x), expected, atol=1e-6)


def test_nothing_gets_through_the_hypotenuse_of_a_prism():  # H8
    corners = np.array([(0, 0), (1, 0), (0, 1)], float)
    vertices = np.vstack([np.c_[corners, np.full(3, -2)], np.c_[corners, np.full(3, 2)]])[:, [0, 2, 1]]
    prism = Mesh(vertices, np.array([(0, 1, 2), (5, 4, 3), (0, 3, 4), (0, 4, 1), (1, 4, 5), (1, 5, 2), (2, 5, 3),
                                     (2, 3, 0)]))
    lab = Lab([(Shape(prism), GLASS)], sun=(0, 0, 1))  # into the leg z = 0
    assert closed(flatten(Scene.from_shapes([Shape(prism)], look_down(0, 0, 1, 1), []))[0], np.ones(8, bool)).all()
    behind = np.random.default_rng(5).uniform((0.1, -1, 1.2), (0.9, 1, 3), (200, 3))
    inside = np.random.default_rng(6).uniform((0.1, -1, 0.1), (0.4, 1, 0.4), (50, 3))
    assert len(paths(lab, *behind).alpha) == 0
    assert np.allclose(only(lab, *inside).alpha, 0.9)


def test_light_under_water():  # H8
    for d, z in ((1.0, 1.0), (0.5, 2.0)):
        lab = Lab([(Shape(box((-9, -9, -5), (9, 9, 0))), Stuff(1.33, 1))], (0, 0, -d))
        found = only(lab, (0, 0, z))
        assert found.J[0] == pytest.approx(((d + z) / (d + 1.33 * z)) ** 2, rel=1e-6)
        assert np.allclose(found.P[0], 0, atol=1e-6)
        x = np.random.default_rng(7).uniform((-3, -3, 0.1), (3, 3, 3), (200, 3))
        assert len(only(lab, *x).alpha) == 200
        below = np.random.default_rng(8).uniform((-3, -3, -4), (3, 3, -0.1), (50, 3))
        assert len(paths(lab, *below).alpha) == 0 and (lab.solver.straight(0, below) == 1).all()


def test_opaque_things_and_sheets_on_the_way():
    ball = (Shape(sphere(1, 48, 24)), GLASS)
    x = (0.2, 0.1, -3)
    free = only(Lab([ball], (0, 0, 4)), x)
    for z in (2.0, 0.0, -2.0):  # before, in and behind the ball
        patch = Shape(rectangle((-0.6, -0.6), (0.6, 0.6), z))
        assert len(paths(Lab([ball, (patch, None)], (0, 0, 4)), x).alpha) == 0
        seen = only(Lab([ball, (patch, Stuff(1.5, 0.5))], (0, 0, 4)), x)  # open: it does not bend, whatever its n
        assert np.allclose(seen.alpha, 0.81 * 0.5)
        assert np.allclose(seen.P, free.P, atol=1e-6) and np.allclose(seen.J, free.J, rtol=1e-4)
    aside = Shape(rectangle((2, 2), (3, 3), 2.0))
    assert np.allclose(only(Lab([ball, (aside, None)], (0, 0, 4)), x).alpha, 0.81)


def test_point_on_a_surface_is_reached_from_its_own_side():
    lab = Lab([(Shape(sphere(1, 48, 24)), GLASS), (FLOOR, None)], (0, 0, 4))
    x, up = np.array([[0.3, 0.2, -8.0]]), np.array([[0, 0, 1.0]])
    assert len(lab.solver.paths(0, x, up)[0].alpha) == 1
    assert len(lab.solver.paths(0, x, -up)[0].alpha) == 0
    top = np.array([[0, 0, 1.0]])
    assert len(lab.solver.paths(0, top, up)[0].alpha) == 0  # outside of the glass: nothing was crossed
    assert len(lab.solver.paths(0, top, -up)[0].alpha) == 1


def test_priority_decides_where_bodies_overlap():
    ball, block = Shape(sphere(1, 48, 24)), Shape(box((-0.4, -0.4, -3), (0.4, 0.4, 0.1)))
    x = (0.02, 0.01, -4)
    for first, second, t in ((1, 0, 0.9**2 * 0.8), (0, 1, 0.9 * 0.8**2)):
        lab = Lab([(ball, Stuff(1.5, 0.9, first)), (block, Stuff(1.3, 0.8, second))], (0, 0, 4))
        found = paths(lab, x)
        straightest = np.argmin(np.linalg.norm(found.P - (0, 0, -3), axis=1))
        # Where the ball is the medium the block begins at its far side; else the ball ends where the block begins.
        assert found.alpha[straightest, 0] == pytest.approx(t)


def test_meshes_that_are_closed():
    def marks(mesh: Mesh, matrix=None) -> np.ndarray:
        shape = Shape(mesh, matrices=[np.eye(4) if matrix is None else matrix])
        scene = Scene.from_shapes([shape], look_down(0, 0, 1, 1))
        surfaces, _ = flatten(scene)
        return closed(surfaces, np.ones(len(surfaces.triangles), bool))

    cube = box((0, 0, 0), (1, 1, 1))
    assert marks(cube).all() and marks(sphere(1)).all() and marks(torus(1, 0.3, 12, 8)).all()
    assert marks(cube, scale(-1, 1, 1)).all()
    assert not marks(replace(cube, triangles=cube.triangles[1:])).any()
    assert not marks(rectangle((0, 0), (1, 1), 0)).any()
    turned = cube.triangles.copy()
    turned[0] = turned[0, ::-1]
    assert not marks(replace(cube, triangles=turned)).any()
    split = Mesh(cube.vertices[cube.triangles].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert marks(split).all()  # vertices of its own for each face: what counts is where they are
    both = Mesh(np.vstack([cube.vertices, cube.vertices[:4] + 5]), np.vstack([cube.triangles, [(8, 9, 10)]]))
    assert marks(both).tolist() == [True] * 12 + [False]


@pytest.mark.parametrize("flip", [False, True])
def test_mirrored_and_inside_out_bodies_are_the_same_bodies(flip):
    ball = sphere(1, 48, 24)
    if flip:
        ball = Mesh(ball.vertices, ball.triangles[:, ::-1], -ball.normals[:, ::-1])
    x = np.random.default_rng(9).uniform(-2, 2, (100, 3))
    a = paths(Lab([(Shape(sphere(1, 48, 24)), GLASS)], (0.2, 0, 4)), *x)
    b = paths(Lab([(Shape(ball, matrices=[np.eye(4) if flip else scale(1, -1, 1)]), GLASS)], (0.2, 0, 4)), *x)
    assert np.array_equal(a.start, b.start) and np.allclose(a.P, b.P, atol=1e-6)
