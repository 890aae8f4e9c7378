"""Cameras, the pixel filter and the passes."""

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from light_meshes import Camera, Mesh, Scene, Shape, rectangle, sphere, translate
from light_meshes.film import images as film
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Material
from light_meshes.scene.transforms import look_at
from oracle import Oracle, camera_ray
from scenes import GREY, four_lights, look_down, point, random_scene, settings

GLOW = Material("glow", Od=(0, 0, 0), kd=0.0, ka=0.0, emission=(0.7, 0.2, 3.0))


def test_a_pixel_is_the_mean_of_its_samples():
    """A glow without a shadow is exactly itself, however many samples there are."""
    for samples in (1, 2, 5, 16):
        scene = Scene.from_shapes([Shape(rectangle((-9, -9), (9, 9), 0.0), GLOW, "glow")], look_down(0, 0, 1, 16), [],
                                  settings(samples=samples, filter_size=1.5))
        picture = render_image(scene).passes["Combined"]
        np.testing.assert_allclose(picture, np.broadcast_to(np.float32([0.7, 0.2, 3, 1]), picture.shape), rtol=3e-7)


def edge_profile(samples, filter_size, axis):
    """(distance of a pixel's middle from an edge, value): the filter's running integral, seen at 32 × 32 places."""
    slope = 1 / 32  # over the picture the edge moves by one pixel
    glow = Material("white", Od=(0, 0, 0), kd=0.0, ka=0.0, emission=(1.0, 1.0, 1.0))
    corners = np.array([(0, -40, 0), (40, -40, 0), (40, 40, 0), (0, 40, 0)], float)
    corners[:, 0] += slope * corners[:, 1]
    if axis == 1:
        corners = corners[::-1, [1, 0, 2]]
    scene = Scene.from_shapes([Shape(Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)])), glow, "half")],
                              look_down(0, 0, 32, 32), [], settings(samples=samples, filter_size=filter_size))
    value = render_image(scene).passes["Combined"][..., 0]
    x, y = np.meshgrid(np.arange(32) - 15.5, np.arange(32) - 15.5)
    along, across = (x, y) if axis == 0 else (y, x)
    return along - slope * across, value


def blackman_harris(size):
    """(x, density) of the filter, which ends `size` from its middle: so it is Cycles' (test_cycles.py)."""
    x = np.linspace(-size, size, 2001)
    a = np.pi * (x / size + 1)
    density = 0.35875 - 0.48829 * np.cos(a) + 0.14128 * np.cos(2 * a) - 0.01168 * np.cos(3 * a)
    return x, density / density.sum()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("filter_size", [0.8, 1.5])
def test_the_pixel_filter_is_blackman_harris(filter_size, axis):
    distance, value = edge_profile(400, filter_size, axis)
    x, density = blackman_harris(filter_size)
    np.testing.assert_allclose(value, np.interp(distance, x, np.cumsum(density), 0, 1), atol=0.02)


@pytest.mark.parametrize("axis", [0, 1])
def test_the_filters_first_moments(axis):
    """Its middle is the pixel's, and its variance that of Blackman-Harris: the edge's profile, integrated."""
    distance, value = edge_profile(64, 1.5, axis)
    order = np.argsort(distance.ravel())
    d, share = distance.ravel()[order], value.ravel()[order].astype(float)
    step = np.diff(share)
    middle = (d[1:] + d[:-1]) / 2
    x, density = blackman_harris(1.5)
    assert (step * middle).sum() == pytest.approx(0, abs=0.005)
    assert (step * middle**2).sum() == pytest.approx((density * x**2).sum(), rel=0.05)


def test_without_a_filter_all_samples_are_the_middle():
    scene = four_lights(48)
    one, many = (render_image(scene.with_settings(samples=n)).passes["Combined"] for n in (1, 4))
    np.testing.assert_array_equal(one, many)


def test_a_transparent_film_is_clear_where_nothing_is_hit():
    camera = Camera.look_at((0, -5, 0), (0, 0, 0), 40, 64, 64)
    scene = Scene.from_shapes([Shape(sphere(1.0, 64, 32), GREY, "ball")], camera, [point((2, -4, 3))],
                              settings(samples=16, filter_size=1.5, film_transparent=True), world_color=(0.3, 0.4, 0.5))
    picture = render_image(scene).passes["Combined"]
    alpha = picture[..., 3]
    assert (picture[alpha == 0] == 0).all() and (alpha == 0).mean() > 0.3
    assert (alpha == 1).mean() > 0.2 and ((alpha > 0) & (alpha < 1)).any()
    full = render_image(scene.with_settings(film_transparent=False)).passes["Combined"]
    assert (full[..., 3] == 1).all()
    over = picture[..., :3] + (1 - alpha[..., None]) * np.float32([0.3, 0.4, 0.5])  # alpha is premultiplied
    np.testing.assert_allclose(over, full[..., :3], rtol=1e-5, atol=1e-6)


def test_where_all_is_hidden_from_the_camera_the_world_is_seen():
    scene = four_lights(8)
    hidden = replace(scene, objects=tuple(replace(o, visible_camera=False) for o in scene.objects))
    assert np.array_equal(render_image(hidden).passes["Combined"], np.broadcast_to(
        np.float32([*scene.world_color, 1]), (8, 8, 4)))


def test_depth_and_normal_of_a_plane_are_exact():
    camera = Camera.look_at((1.0, -3.0, 2.0), (0.2, 0.1, 0.0), 50, 60, 40)
    scene = Scene.from_shapes([Shape(rectangle((-90, -90), (90, 90), 0.0), GREY, "floor")], camera, [], settings())
    passes = render_image(scene, passes=("Depth", "Normal")).passes
    left, right, bottom, top = camera.window
    u = left + (right - left) * (np.arange(60) + 0.5) / 60
    v = bottom + (top - bottom) * (np.arange(40) + 0.5) / 40
    M = camera.matrix
    z = M[2, 0] * u + (M[2, 1] * v - M[2, 2])[:, None]  # of the ray, for a depth of 1
    expected = np.where(z < 0, -M[2, 3] / z, 1e10)
    expected = np.where(expected < 60, expected, 1e10)
    near = expected < 60
    assert near.sum() > 500
    np.testing.assert_allclose(passes["Depth"][..., 0][near], expected[near], rtol=2e-6)
    np.testing.assert_allclose(passes["Normal"][near], np.broadcast_to([0, 0, 1], (near.sum(), 3)), atol=1e-6)


def test_normals_of_a_smooth_sphere_point_away_from_its_middle():
    scene = Scene.from_shapes([Shape(sphere(1.0, 128, 64), GREY, "ball")], look_down(0, 0, 1.6, 64), [], settings())
    N = render_image(scene, passes=("Normal",)).passes["Normal"]
    x, y = np.meshgrid(*[1.6 * ((np.arange(64) + 0.5) / 64 - 0.5)] * 2)
    inside = x * x + y * y < 0.6
    expected = np.stack([x, y, np.sqrt(np.maximum(1 - x * x - y * y, 0))], -1)
    np.testing.assert_allclose(N[inside], expected[inside], atol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(N[inside], axis=-1), 1, atol=1e-6)


def test_a_back_face_is_seen_with_its_normal_turned():
    below = Camera(look_at((0, 0, -2), (0, 0, 0)), (-0.1, 0.1, -0.1, 0.1), 8, 8)
    sheet = Shape(rectangle((-9, -9), (9, 9), 0.0), GREY, "sheet")
    scene = Scene.from_shapes([sheet], below, [point((0, 0, -3))], settings())
    passes = render_image(scene, passes=("Combined", "Normal")).passes
    assert (passes["Normal"][..., 2] == -1).all()
    assert (passes["Combined"][..., 0] > 0.1).all()


@hypothesis_settings(max_examples=5)
@given(seed=st.integers(0, 2**31 - 1), perspective=st.booleans())
def test_camera_rays_hit_what_the_oracle_hits(seed, perspective):
    """Shifted windows, both projections: depth of the first hit."""
    scene = random_scene(seed, 0.2, 2.0, 1)
    random = np.random.default_rng(seed)
    w = random.uniform(0.2, 0.5, 4) * (1 if perspective else 4)
    camera = replace(scene.camera, perspective=perspective, window=(-w[0], w[1], -w[2], w[3]))
    scene = replace(scene, camera=camera)
    depth = render_image(scene, passes=("Depth",)).passes["Depth"][..., 0]
    oracle = Oracle(scene)
    compared = 0
    for y in range(20):
        for x in range(20):
            origin, direction = camera_ray(scene, x + 0.5, y + 0.5)
            hit, sure = oracle.first_hit(origin, direction)
            if sure:
                expected = 1e10 if hit is None else -(hit.P - camera.matrix[:3, 3]) @ camera.matrix[:3, 2]
                assert depth[y, x] == pytest.approx(expected, rel=1e-5)
                compared += 1
    assert compared > 200


def test_clipping_hides_what_is_too_near_and_too_far():
    parts = [Shape(rectangle((-1, -1), (1, 1), z), GREY, f"sheet {z}") for z in (1.0, 2.0, 3.0)]
    for clip, expected in (((0.1, 9), 2.0), ((2.5, 9), 3.0), ((3.5, 9), 4.0), ((0.1, 1.5), 1e10)):
        camera = Camera(translate(0, 0, 5), (-0.1, 0.1, -0.1, 0.1), 4, 4, clip_start=clip[0], clip_end=clip[1])
        depth = render_image(Scene.from_shapes(parts, camera, [], settings()), passes=("Depth",)).passes["Depth"]
        np.testing.assert_allclose(depth, expected, rtol=1e-6)


def test_a_picture_in_another_working_space(tmp_path):
    """A PNG is sRGB all the same; an EXR says what its colours are."""
    to_rec709 = ((1.6605, -0.5876, -0.0728), (-0.1246, 1.1329, -0.0083), (-0.0182, -0.1006, 1.1187))  # from Rec.2020
    frame = film.Framebuffer(1, 1, {"Combined": np.array([[[0.3, 0.5, 0.2, 1]]], np.float32)})
    film.write(frame, tmp_path / "a.png", to_rec709)
    film.write(frame, tmp_path / "a.exr", to_rec709)
    shown = film.to_srgb(np.array([[[*(np.array(to_rec709) @ (0.3, 0.5, 0.2)), 1]]], np.float32))
    assert oiio.ImageBuf(str(tmp_path / "a.png")).get_pixels(oiio.UINT8).tolist() == shown.tolist()
    exr = oiio.ImageBuf(str(tmp_path / "a.exr"))
    assert exr.get_pixels(oiio.FLOAT)[0, 0] == pytest.approx((0.3, 0.5, 0.2, 1))
    assert exr.spec().getattribute("chromaticities") == pytest.approx(
        (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290), abs=1e-3)
