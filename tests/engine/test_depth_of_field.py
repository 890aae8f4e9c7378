"""Depth of field: what is in focus looks as with a pinhole; everything else is blurred by the whole lens."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, rectangle, translate
from light_meshes.picture.render import render_image
from light_meshes.rays.camera import camera_rays, filter_offsets, lens_points
from light_meshes.scene.description import Material
from light_meshes.scene.errors import SceneError
from light_meshes.scene.snapshot import read, write
from scenes import four_lights, settings

BOX = (3, 5, 11, 9)
LENS = {"lens_radius": 0.3, "focus_distance": 4.0}


def camera(perspective=True, **values):
    matrix = Camera.look_at((2, -3, 4), (0.3, 0.2, 0), 40, 16, 12).matrix
    return Camera(matrix, (-0.4, 0.5, -0.3, 0.35), 16, 12, perspective, 0.1, 50.0, **values)


@pytest.mark.parametrize("perspective", [True, False])
def test_without_a_lens_rays_are_a_pinholes(perspective):
    """To the last bit: the rays in plain numpy, each coordinate by itself."""
    offsets = filter_offsets(5, 1.5)
    c = camera(perspective)
    origin, direction, reach = camera_rays(c, BOX, offsets)
    x, y = np.meshgrid(np.arange(BOX[0], BOX[2]), np.arange(BOX[1], BOX[3]))
    left, right, bottom, top = c.window
    u = (left + (right - left) * (x[..., None] + 0.5 + offsets[:, 0]) / c.width).ravel()
    v = (bottom + (top - bottom) * (y[..., None] + 0.5 + offsets[:, 1]) / c.height).ravel()
    one = np.ones(len(u))
    length = np.sqrt(u * u + v * v + 1) if perspective else one
    o = (0.1 * u, 0.1 * v, -0.1 * one) if perspective else (u, v, -0.1 * one)
    d = (u / length, v / length, -1 / length) if perspective else (0 * one, 0 * one, -one)
    m = c.matrix
    assert np.array_equal(origin, np.stack([
        m[r, 0] * o[0] + m[r, 1] * o[1] + m[r, 2] * o[2] + m[r, 3] for r in range(3)], 1))
    assert np.array_equal(direction, np.stack([
        m[r, 0] * d[0] + m[r, 1] * d[1] + m[r, 2] * d[2] for r in range(3)], 1))
    assert np.array_equal(reach, length * (50.0 - 0.1))


@pytest.mark.parametrize("perspective", [True, False])
def test_rays_of_a_pixel_pass_the_lens_and_meet_in_focus(perspective):
    offsets = np.zeros((32, 2))
    c, pinhole = camera(perspective, **LENS), camera(perspective)
    origin, direction, reach = camera_rays(c, BOX, offsets)
    start, forward, _ = camera_rays(pinhole, BOX, offsets[:1])
    axis = -c.matrix[:3, 2]

    def at(depth, origin, direction):
        height = (origin - c.matrix[:3, 3]) @ axis
        return origin + ((depth - height) / (direction @ axis))[:, None] * direction

    meet = at(4.0, origin, direction).reshape(-1, 32, 3)
    assert np.abs(meet - at(4.0, start, forward)[:, None]).max() < 1e-12
    lens = at(0.0, origin, direction).reshape(-1, 32, 3) - at(0.0, start, forward)[:, None]
    distance = np.linalg.norm(lens, axis=2)
    assert 0.25 < distance.max() <= 0.3 and distance[:, 0].max() == distance.min(1).max() < 0.05
    assert ((origin - c.matrix[:3, 3]) @ axis) == pytest.approx(0.1, abs=1e-12)
    assert ((origin + reach[:, None] * direction - c.matrix[:3, 3]) @ axis) == pytest.approx(50, abs=1e-10)


@pytest.mark.parametrize("blades", [0, 3, 6])
@pytest.mark.parametrize("samples", [16, 64, 256])
def test_points_are_spread_over_the_whole_lens(blades, samples):
    """Their variance is that of the disk, R²/4, or of the polygon, R²(2 + cos 2π/n)/12; all lie inside."""
    offsets = filter_offsets(samples, 1.5)
    points = lens_points(camera(lens_radius=2.0, lens_blades=blades, lens_rotation=0.3), offsets)
    wanted = 1.0 if not blades else 4 * (2 + np.cos(2 * np.pi / blades)) / 12
    assert points.var(0) == pytest.approx([wanted] * 2, rel={16: 0.2, 64: 0.06, 256: 0.02}[samples])
    assert np.abs(points.mean(0)).max() < 2 / samples
    assert np.linalg.norm(points, axis=1).max() <= 2
    if blades:  # a blade's middle points where the rotation says
        angle = 0.3 + 2 * np.pi * np.arange(blades) / blades
        assert (points @ [np.cos(angle), np.sin(angle)]).max() <= 2 * np.cos(np.pi / blades) + 1e-12
    narrow = lens_points(camera(lens_radius=2.0, lens_ratio=2.0), np.zeros((samples, 2)))
    assert narrow[:, 0].var() == pytest.approx(narrow[:, 1].var() / 4, rel=0.2)
    # Where in the lens says little about where in the pixel.
    relation = np.corrcoef(np.hstack([offsets, points]).T)[:2, 2:]
    assert np.abs(relation).max() < {16: 0.25, 64: 0.1, 256: 0.05}[samples]


def test_one_sample_is_a_pinhole():
    scene = four_lights(24)
    lens = replace(scene, camera=replace(scene.camera, **LENS))
    assert np.array_equal(*(render_image(s).passes["Combined"] for s in (scene, lens)))


def test_a_plane_in_focus_is_sharp_and_one_behind_is_not():
    """A glowing half-plane: its edge's variance is that of the circle of confusion, and of the filter."""
    glow = Material("glow", Od=(0, 0, 0), emission=(1, 1, 1))

    def variance(distance, **lens):
        view = Camera(translate(0, 0, 0), (-0.1, 0.1, -0.1, 0.1), 64, 64, **lens)
        scene = Scene.from_shapes([Shape(rectangle((0, -9), (9, 9), -distance), glow, "glow")], view, [],
                                  settings(mode="LOCAL", samples=256, filter_size=1.5))
        step = np.diff(render_image(scene).passes["Combined"][..., 0].mean(0))
        x = np.arange(1, 64) - 32
        assert step.sum() == pytest.approx(1, abs=1e-6)
        assert abs((step * x).sum()) < 0.05
        return (step * x**2).sum()

    pixel = 0.2 / 64
    sharp = variance(8.0)
    for distance in (4.0, 2.5, 9.0):
        radius = 0.25 * abs(1 / 4.0 - 1 / distance) / pixel  # pixels
        blur = variance(distance, lens_radius=0.25, focus_distance=4.0)
        assert blur - sharp == pytest.approx(radius**2 / 4, rel=0.03, abs=1e-9), distance
    assert sharp < 1


def test_depth_is_that_of_the_middle_of_the_lens():
    scene = four_lights(24, samples=16, filter_size=1.5)
    found = [render_image(replace(scene, camera=replace(scene.camera, lens_radius=r, focus_distance=5.0)),
                          ("Combined", "Depth")).passes for r in (0.0, 0.05)]
    near = np.abs(found[0]["Depth"] - found[1]["Depth"]) < 0.05 * found[0]["Depth"]
    assert near.mean() > 0.95
    assert np.abs(found[0]["Combined"] - found[1]["Combined"]).max() > 0.05


@pytest.mark.parametrize(("name", "value"), [
    ("lens_radius", -1.0), ("focus_distance", 0.0), ("lens_blades", -1), ("lens_ratio", 0.0)])
def test_a_lens_that_cannot_be_is_an_error(tmp_path, name, value):
    scene = four_lights(8)
    write(replace(scene, camera=replace(scene.camera, **LENS)), tmp_path / "good")
    assert read(tmp_path / "good").camera.lens_radius == 0.3
    write(replace(scene, camera=replace(scene.camera, **{name: value})), tmp_path / "bad")
    with pytest.raises(SceneError, match=f"camera: {name}"):
        read(tmp_path / "bad")
