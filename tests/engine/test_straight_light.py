"""Straight rays of light through glass, cut-outs and films: the kernel gives the bits of the steps in `Tracer`."""

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes import Image, Material, Scene, Shape, box, rectangle, rotate_x, sphere, translate
from light_meshes.picture.render import prepare
from light_meshes.rays.tracer import Targets
from light_meshes.scene.programs import program
from scenes import GREY, look_down, point, settings

GLASS = Material("glass", kd=0.0, kt=(0.9, 0.7, 0.5), ior=1.5, fresnel=True)
FILM, DARK = Material("film", kd=0.0, kt=(0.5, 0.25, 1.0)), Material("dark film", kd=0.0, alpha=0.4)
PANE = Material("pane", kd=0.0, kt=(0.9,) * 3, ior=1.5, fresnel=True)


def through(glass_shadows, refraction="VIEW", materials=(), shapes=(), **values):
    """What is ready of a ball with a bubble, a box, panes and films above a floor, under a point and a sun."""
    hole = sphere(0.2, 16, 8)
    parts = [Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor"),
             Shape(sphere(0.5, 24, 12), GLASS, "ball", [translate(0, 0, 0.8)]),
             Shape(replace(hole, triangles=hole.triangles[:, ::-1]), GLASS, "bubble", [translate(0, 0.1, 0.8)]),
             Shape(box((0.8, -0.5, 0.2), (1.3, 0.5, 1.2)), GLASS, "block", [rotate_x(0.3)]),
             Shape(rectangle((-2, -2), (0, 2), 1.6), FILM, "film"),
             Shape(rectangle((-1, -2), (2, 1), 1.7), DARK, "dark film"),
             Shape(rectangle((-2, -2), (2, 2), 1.9), PANE, "pane"),
             Shape(box((-1.2, -0.4, 0.0), (-0.9, 0.4, 0.5)), GREY, "post"), *shapes]
    lamp = replace(point((0.3, 0.2, 2.6)), radius=0.2)
    scene = Scene.from_shapes(parts, look_down(0, 0, 9, 8), [lamp, replace(lamp, name="other")],
                              settings(glass_shadows=glass_shadows, refraction=refraction), **values)
    return prepare(scene, ("Combined",))


def segments(seed, n=4000):
    """Random segments: from places above the floor to the lamp, to places around it, and to suns."""
    random = np.random.default_rng(seed)
    origin = random.uniform((-2, -2, 0), (2, 2, 1.5), (n // 4, 3))
    origin[::2, 2] = 0
    position = random.normal((0.3, 0.2, 2.6), 0.2, (n // 4, 3))
    sun = random.random(n // 4) < 0.3
    position[sun] /= np.linalg.norm(position[sun], axis=1)[:, None]
    of = random.integers(0, n // 4, (2, n)).astype(np.int32)
    N = np.tile([0.0, 0.0, 1.0], (n // 4, 1))
    return origin, of[0], Targets(position, sun), of[1], N, random.integers(0, 2, n).astype(np.int32)


def compared(ready, seed, unbent=False, lamps=True, closed=False, normals=True):
    """Return what arrives by the kernel, and how many of the segments it has left to the steps."""
    tracer, glass = ready.world.tracer, ready.world.glass
    aside = glass.aside(ready.scene.settings, np.array([0.2, 0.01]))
    origin, of, to, target, N, light = segments(seed)
    light, N = light if lamps else None, N if normals else None
    passing, steps = glass.passing(aside), []

    def kernel(*arguments):
        steps.append(passing.kernel(*arguments))
        return steps[-1]

    watched = passing._replace(kernel=kernel)
    found = tracer.transmittance(origin, of, to, target, N, closed, watched, unbent, light=light)
    kinds = ("stops", "sheets") if unbent else ("opaque", "glass")
    slow = tracer._step_by_step(kinds, 0, passing, origin, N, of, *to, target, closed, None, light)
    np.testing.assert_array_equal(found.view(np.uint32), slow.view(np.uint32))
    return found, steps[0]


@pytest.mark.parametrize("lamps", [True, False])
@pytest.mark.parametrize("unbent", [True, False])
@pytest.mark.parametrize(("closed", "normals"), [(False, True), (True, True), (False, False)])
def test_the_kernel_gives_the_bits_of_the_steps(unbent, lamps, closed, normals):
    ready = through("SOLID")
    found, left = compared(ready, 1, unbent, lamps, closed, normals)
    assert left == 0
    assert 0.02 < (found == 0).all(1).mean() < 0.9
    assert len(np.unique(found[:, 0])) > (400 if lamps and not unbent else 10)


def test_light_that_is_not_turned_aside_has_the_same_bits():
    found, left = compared(through("CLEAR"), 2)
    assert left == 0
    assert len(np.unique(found)) > 5


def test_cut_outs_are_looked_up_in_the_kernel(tmp_path):
    path = tmp_path / "leaf.png"
    pixels = np.random.default_rng(5).integers(0, 256, (6, 8, 4)).astype(np.uint8)
    assert oiio.ImageBuf(pixels).write(str(path))
    leaf = Material("leaf", alpha_image=0, kd=0.5)
    images = (Image("leaf", str(path), interpolation="CLOSEST"),)
    shapes = [Shape(rectangle((-2, -2), (2, 2), 1.3), leaf, "leaf")]
    found, left = compared(through("SOLID", shapes=shapes, images=images), 3)
    assert left == 0
    assert len(np.unique(found[:, 0])) > 100


def test_segments_past_a_program_that_cuts_are_left_to_the_steps():
    cut = program({"operations": [["position"], ["sine", [0]], ["absolute", [3]]], "values": {"alpha": [[4]]}}, "here")
    shapes = [Shape(rectangle((-2, -2), (0, 2), 1.3), Material("leaf", kd=0.5, alpha=0.5, program=cut), "leaf")]
    found, left = compared(through("SOLID", shapes=shapes), 5)
    assert 100 < left < 3000
    assert len(np.unique(found[:, 0])) > 400


@pytest.mark.parametrize("apart", [0.0, 1e-7])
def test_segments_past_sheets_in_one_place_are_left_to_the_steps(apart):
    """They and no others: the kernel does those beside it."""
    shapes = [Shape(rectangle((-2, -2), (0, 2), 1.6 + apart), FILM, "second film")]
    _, left = compared(through("SOLID", shapes=shapes), 4)
    assert 100 < left < 3000


def test_without_glass_the_rest_stops_nothing():
    ready = through("SOLID")
    tracer, of = ready.world.tracer, np.zeros(1, np.int32)
    up = Targets(np.array([[2.5, 2.5, 5.0]]), np.zeros(1, np.bool_))
    origin, N = np.array([[2.5, 2.5, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    found = tracer.transmittance(origin, of, up, of, N, False, ready.world.glass.passing(None))
    assert (found == 1).all()
