"""Whitted's reflected rays (eq. 2): a plane mirror shows the mirrored scene; depth and cut-off end the series."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from light_meshes import Camera, Mesh, Scene, Shape, box, rectangle, scale, sphere, translate
from light_meshes.picture.render import Prepared, render_image
from light_meshes.scene.description import Material
from oracle import Lattice, Oracle
from scenes import GREY, point, random_scene, settings

TINT = (0.9, 0.6, 0.3)
MIRROR = Material("mirror", Od=(0, 0, 0), kd=0.0, ka=0.0, mirror=TINT)


def upright(z_mesh: Mesh) -> Mesh:
    """A rectangle that faces +z turned to face +x, through x = its height."""
    turn = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], float)
    return Mesh(z_mesh.vertices @ turn.T, z_mesh.triangles)


def room(mirrored: bool, **values):
    """A still life beside the plane x = 0, or beyond it, seen from its own side."""
    flip = np.diag([-1.0 if mirrored else 1.0, 1, 1, 1])
    side = -1 if mirrored else 1
    things = [Shape(box((0.05, -3, -0.1), (6, 3, 0)), GREY, "floor", [flip]),
              Shape(sphere(0.5, 24, 12), Material("ball", Od=(0.2, 0.5, 0.7), ks=0.5, nShiny=20.0), "ball",
                    [flip @ translate(3.5, 0.4, 0.6) @ scale(1, 1, 1.1)]),
              Shape(box((2.8, -1.2, 0), (3.4, -0.6, 1)), Material("box", Od=(0.7, 0.3, 0.2)), "box", [flip])]
    if not mirrored:
        things.append(Shape(upright(rectangle((-9, -9), (9, 9), 0.0)), MIRROR, "mirror"))
    lights = [point((side * 2.0, -2.0, 3.0)), point((side * 4.5, 2.0, 2.0), 5.0)]
    camera = Camera.look_at((2.0, -0.2, 1.2), (0, 0, 0.9), 40, 48, 48)
    return Scene.from_shapes(things, camera, lights, settings(mode="WHITTED", **values), world_color=(0.1, 0.2, 0.3))


def test_a_plane_mirror_shows_the_mirrored_scene():
    """In the mirror: its tint times what the mirrored scene sends through it. Unsure pixels by the oracle."""
    found = render_image(room(False, shadows="SHARP")).passes["Combined"][..., :3]
    expected = render_image(room(True, shadows="SHARP")).passes["Combined"][..., :3] * np.float32(TINT)
    _, sure = Oracle(room(True, shadows="SHARP")).picture()
    np.testing.assert_allclose(found[sure], expected[sure], rtol=1e-5, atol=1e-6)
    assert sure.mean() > 0.6


def test_what_a_mirror_shows_has_soft_shadows():
    soft, sharp = (render_image(room(False, shadows=s, h=0.1)).passes["Combined"]
                   for s in ("LIGHT_MESHES", "SHARP"))
    differs = (soft != sharp).any(-1)
    assert 0.02 < differs.mean() < 0.7


@hypothesis_settings(max_examples=4)
@given(seed=st.integers(0, 2**31 - 1), shadows=st.sampled_from(["SHARP", "LIGHT_MESHES"]))
def test_mirrors_among_random_things_are_the_oracles(seed, shadows):
    scene = random_scene(seed, 0.25, 1.5, 3, shadows=shadows, mode="WHITTED", max_depth=3)
    scene = replace(scene, materials=tuple(replace(m, mirror=(0.5, 0.4, 0.6)) for m in scene.materials))
    lattice = None
    if shadows == "LIGHT_MESHES":
        lattice = Lattice(Prepared(scene).soft.lattice.position)
    expected, sure = Oracle(scene, lattice).picture()
    found = render_image(scene).passes["Combined"][..., :3]
    np.testing.assert_allclose(found[sure], expected[sure], rtol=1e-5, atol=1e-6)
    assert sure.mean() > 0.3


def between(**values):
    """A camera between two parallel mirrors that glow: each bounce adds half of the one before."""
    glow = Material("glow", Od=(0, 0, 0), kd=0.0, ka=0.0, mirror=(0.5, 0.5, 0.5), emission=(1.0, 1.0, 1.0))
    low, high = rectangle((-50, -50), (50, 50), 0.0), rectangle((-50, -50), (50, 50), 2.0)
    camera = Camera(translate(0, 0, 1), (-0.1, 0.1, -0.1, 0.1), 8, 8)
    return Scene.from_shapes([Shape(low, glow, "low"), Shape(high, glow, "high")], camera, [],
                             settings(mode="WHITTED", **values))


@pytest.mark.parametrize("depth", [0, 1, 2, 7])
def test_the_depth_limit_counts_reflections(depth):
    picture = render_image(between(max_depth=depth, cutoff=0.0)).passes["Combined"][..., :3]
    np.testing.assert_allclose(picture, sum(0.5**k for k in range(depth + 1)), rtol=1e-6)


@pytest.mark.parametrize(("cutoff", "bounces"), [(0.6, 0), (0.3, 1), (0.2, 2), (0.01, 6)])
def test_the_cut_off_ends_what_can_add_little(cutoff, bounces):
    picture = render_image(between(max_depth=20, cutoff=cutoff)).passes["Combined"][..., :3]
    np.testing.assert_allclose(picture, sum(0.5**k for k in range(bounces + 1)), rtol=1e-6)


def test_an_object_hidden_from_mirrors_is_not_reflected():
    scene = room(False, shadows="SHARP")
    ball = replace(scene.objects[1], visible_reflection=False)
    hidden = render_image(replace(scene, objects=(scene.objects[0], ball, *scene.objects[2:]))).passes["Combined"]
    shown = render_image(scene).passes["Combined"]
    assert (hidden != shown).any(-1).sum() > 20


def looking_at(radiance, limit, mirrors, of="emission"):
    """The middle pixel of this many mirrors, which show a bright surface, the world, or a surface that a lamp lights.
    """
    black = Material("black", Od=(0, 0, 0), kd=0.0, ka=0.0)
    bright = replace(black, emission=radiance) if of == "emission" else Material("lit", Od=radiance, ka=0.0)
    mirror, things, lights = replace(MIRROR, mirror=(1.0, 1.0, 1.0)), [], []
    for n in range(mirrors):  # where the ray hits the floor and the ceiling in turn
        things.append(Shape(rectangle((-1, 5 * n - 1), (1, 5 * n + 1), 5.0 * (n % 2)), mirror, f"mirror {n}"))
    if of != "world":
        z, y = 5.0 * (mirrors % 2), 5 * mirrors
        things.append(Shape(rectangle((-1, y - 1), (1, y + 1), z), bright, "bright"))
        lights = [point((0, y, z + (-0.9 if mirrors % 2 else 0.9)), 100.0)] if of == "lit" else []
    scene = Scene.from_shapes(things, Camera.look_at((0, -1, 1), (0, 0, 0), 10, 3, 3), lights,
                              settings(mode="WHITTED", clamp_indirect=limit, filter_size=0.0, shadows="SHARP"),
                              world_color=radiance if of == "world" else (0.0, 0.0, 0.0))
    return render_image(scene).passes["Combined"][1, 1, :3]


def test_what_mirrors_show_has_a_limit_as_in_cycles():
    """The sum of the colours is at most three times the limit. What gives light itself has none in the first mirror."""
    bright, world = (60.0, 30.0, 0.0), (9.0, 9.0, 9.0)
    for mirrors, expected in (0, bright), (1, bright), (2, (20, 10, 0)), (3, (20, 10, 0)):
        np.testing.assert_allclose(looking_at(bright, 10.0, mirrors), expected, rtol=1e-5)
    for mirrors, expected in (1, world), (2, (2, 2, 2)):
        np.testing.assert_allclose(looking_at(world, 2.0, mirrors, "world"), expected, rtol=1e-5)
    np.testing.assert_array_equal(looking_at((10.0, 10.0, 10.0), 10.0, 2), looking_at((10.0, 10.0, 10.0), 0.0, 2))
    np.testing.assert_allclose(looking_at(bright, 0.0, 2), bright, rtol=1e-5)
    lit = looking_at((1.0, 0.5, 0.25), 0.0, 0, "lit")
    assert lit.sum() > 60
    np.testing.assert_allclose(looking_at((1.0, 0.5, 0.25), 10.0, 1, "lit"), lit * 30 / lit.sum(), rtol=1e-4)
