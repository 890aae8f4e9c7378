"""The world by direction: its table has all its light, rays of any width share it, and suns become lamps."""

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes import Scene, SceneError, Shape, rectangle
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.description import Camera, Image, Material
from light_meshes.scene.programs import program
from light_meshes.surface import textures
from light_meshes.surface.sky import Sky
from light_meshes.surface.sky_table import directions
from scenes import look_down, settings

CAMERA = Camera.look_at((0, -3, 1), (0, 0, 1), 60, 32, 32)
POSITION = [["position"]]
BOWL = program({"operations": [*POSITION, ["maximum", [2], 0.0], ["multiply", [3], [3]]],
                "values": {"emission": [[4], [3], 0.5]}}, "world")  # z², z above the horizon; a half everywhere
# An image of all directions, as the add-on writes it.
AROUND = program({"operations": [
    *POSITION, ["arctan2", [1], [0]], ["multiply", [0], [0]], ["multiply", [1], [1]], ["add", [4], [5]], ["sqrt", [6]],
    ["arctan2", [2], [7]], ["multiply", [3], -0.5 / np.pi], ["add", [9], 0.5], ["multiply", [8], 1 / np.pi],
    ["add", [11], 0.5], ["image", 0.0, [10], [12]]], "values": {"emission": [[13], [14], [15]]}}, "world")


def sky_texture(model, elevation=0.5, size=0.0095, rotation=0.9):
    return program({"operations": [*POSITION, ["sky", model, elevation, rotation, 100.0, 1.0, 1.0, 1.0, size, 1.0, 3.0,
                                               [0], [1], [2]]], "values": {"emission": [[3], [4], [5]]}}, "world")


def lit_by(world, light="SKY", **more):
    return Scene.from_shapes([], CAMERA, settings=settings(world_light=light), world=world, **more)


def random_directions(n, seed=3):
    d = np.random.default_rng(seed).normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def painted(folder, width, suns):
    """A file with a blue sky and suns (azimuth, elevation, degrees, radiance), and its light over all directions."""
    u, v = (np.arange(width) + 0.5) / width, 1 - (np.arange(width // 2) + 0.5) / (width // 2)
    azimuth, elevation = (0.5 - u) * 2 * np.pi, (v - 0.5) * np.pi
    flat = np.cos(elevation)[:, None]
    d = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth),
                  np.broadcast_to(np.sin(elevation)[:, None], (width // 2, width))], -1)
    pixels = ((0.3, 0.5, 1.0) * (0.2 + 0.8 * np.clip(d[..., 2:], 0, 1))).astype(np.float32)
    for a, e, degrees, radiance in suns:
        toward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        pixels += (np.arccos(np.clip(d @ toward, -1, 1)) < np.radians(degrees) / 2)[..., None] * np.float32(radiance)
    path = folder / "sky.exr"
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), oiio.ImageSpec(width, width // 2, 3, oiio.FLOAT)) and out.write_image(pixels)
    out.close()
    half = np.pi / 2 / (width // 2)
    each = 2 * np.pi / width * (np.sin(elevation + half) - np.sin(elevation - half))
    return Image("sky", str(path), colorspace="LINEAR"), (pixels * each[:, None, None]).sum((0, 1))


def sky_of(scene):
    return Sky(scene, textures.load(scene.images, textures.alphas(scene), 1)[0])


def test_the_square_has_equal_areas_and_no_seams():
    x, y = (a.ravel() for a in np.meshgrid(*[(np.arange(64) + 0.5) / 64] * 2))
    d = directions(x, y)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(np.einsum("ni,nj->ij", d, d) / len(d), np.eye(3) / 3, atol=1e-3)
    everywhere = random_directions(20_000)
    linear = program({"operations": [*POSITION, ["add", [0], 1.0], ["add", [1], 1.0], ["add", [2], 1.0]],
                      "values": {"emission": [[3], [4], [5]]}}, "world")  # smooth: also across edges of the square
    np.testing.assert_allclose(Sky(lit_by(linear)).light(everywhere), 1 + everywhere, atol=0.02)


def test_the_table_has_all_light():
    sky = Sky(lit_by(BOWL))
    np.testing.assert_allclose(sky.mean, (1 / 6, 1 / 4, 1 / 2), rtol=1e-4)
    np.testing.assert_allclose(sky.light(random_directions(2), 4 * np.pi), [sky.mean, sky.mean], rtol=1e-5)


@pytest.mark.parametrize("width", [None, 1e-3, 0.025, 0.4])
def test_rays_of_any_width_gather_all_light(width):
    """The mean over evenly spread directions is that of the sky; what is between is interpolated."""
    sky = Sky(lit_by(BOWL))
    n = 8192
    z = 1 - (2 * np.arange(n) + 1) / n
    turn = np.arange(n) * np.pi * (3 - 5**0.5)
    d = np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    np.testing.assert_allclose(sky.light(d, width).mean(0), sky.mean, rtol=2e-3)
    one = sky.light(d[:4], width)
    if width:
        np.testing.assert_array_equal(sky.light(d[:4], np.full(4, width)), one)


def test_a_narrow_ray_finds_what_the_program_says():
    d = random_directions(5000)
    sky = Sky(lit_by(BOWL))
    np.testing.assert_allclose(sky.light(d, 1e-5), sky.seen(d), atol=0.01)


def test_few_wide_rays_find_a_speckled_world_without_noise(tmp_path):
    """256 rays of an image whose every texel is another: with their width as good as without the speckles."""
    path = tmp_path / "noise.exr"
    pixels = np.random.default_rng(1).exponential(1.0, (256, 512, 3)).astype(np.float32)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), oiio.ImageSpec(512, 256, 3, oiio.FLOAT)) and out.write_image(pixels) and out.close()
    sky = sky_of(lit_by(AROUND, images=(Image("noise", str(path), colorspace="LINEAR"),)))
    z = 1 - (2 * np.arange(256) + 1) / 256
    turn = np.arange(256) * np.pi * (3 - 5**0.5)
    d = np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])
    assert np.abs(sky.light(d, 4 * np.pi / 256).mean(0) - sky.mean).max() < 0.006 * 1.0
    assert np.abs(sky.light(d).mean(0) - sky.mean).max() > 0.01


@pytest.mark.parametrize("width", [512, 1024])
def test_a_sun_in_an_image_becomes_a_lamp(tmp_path, width):
    degrees = 1.0 if width > 512 else 2.0
    image, light = painted(tmp_path, width, [(1.0, 0.7, degrees, 30_000)])
    sky = sky_of(lit_by(AROUND, images=(image,)))
    (lamp,) = sky.suns
    assert lamp.name == "sun of the world" and (lamp.type, lamp.softness) == ("SUN", "SIZE")
    # What the table lost is what the lamp gives, and all together is what was painted.
    rest = sky.light(random_directions(3), 4 * np.pi)[0] * 4 * np.pi
    np.testing.assert_allclose(rest + np.array(lamp.intensity) * np.pi, light, rtol=0.01)
    _, without = painted(tmp_path, width, [])
    np.testing.assert_allclose(rest, without, atol=0.01 * light.max())
    np.testing.assert_allclose(lamp.direction, -np.array(
        [np.cos(0.7) * np.cos(1.0), np.cos(0.7) * np.sin(1.0), np.sin(0.7)]), atol=0.002)
    assert np.degrees(lamp.angle) == pytest.approx(degrees, rel=0.12)
    assert sky.light(-np.array([lamp.direction])).max() < 10 < 10_000 < sky.seen(-np.array([lamp.direction])).max()


def test_lamps_of_a_studio(tmp_path):
    """A large lamp, a small one of little power, and a sky: one becomes a lamp, what is dim or wide stays sky."""
    image, light = painted(tmp_path, 1024, [(1.0, 0.7, 12, 60), (3.0, 0.3, 50, 20), (5.0, 0.1, 1, 30)])
    sky = sky_of(lit_by(AROUND, images=(image,)))
    assert [round(float(np.degrees(lamp.angle))) for lamp in sky.suns] == [12]
    np.testing.assert_allclose(sky.mean * 4 * np.pi, light, rtol=2e-3)
    image, _ = painted(tmp_path, 512, [])
    assert not sky_of(lit_by(AROUND, images=(image,))).suns


def test_with_ambient_light_there_are_no_suns_and_the_mean_lights(tmp_path):
    image, light = painted(tmp_path, 512, [(1.0, 0.7, 2.0, 1000)])
    scene = lit_by(AROUND, "AMBIENT", images=(image,))
    ready = Prepared(scene)
    assert not ready.scene.lights
    np.testing.assert_allclose(np.array(ready.scene.world_color) * 4 * np.pi, light, rtol=5e-3)


def test_a_sun_of_the_world_casts_a_shadow_and_the_plan_says_so(tmp_path):
    image, _ = painted(tmp_path, 512, [(0.0, 0.9, 2.0, 3000)])
    floor, roof = rectangle((-9, -9), (9, 9), 0.0), rectangle((-1, -1), (1, 1), 1.0)
    scene = Scene.from_shapes([Shape(floor, Material("matt", ka=0.0), "floor"),
                               Shape(roof, Material("roof", ka=0.0), "roof", flags={"visible_camera": False})],
                              look_down(0, 0, 6, 40), [], settings(world_light="SKY"), world=AROUND, images=(image,))
    result = render_image(scene)
    picture = result.passes["Combined"][..., 0]
    # The shadow's middle is where the ray through the roof's middle falls, away from the sun.
    assert picture[20, 14] < 0.3 * picture[20, 32]
    assert "sun of the world" in result.statistics["plan"]["suns of the world"]
    assert result.statistics["lights"] == 1


def test_kinds_of_rays_see_other_worlds():
    world = program({"operations": [["ray", 0.0], ["ray", 2.0], ["ray", 4.0]],
                     "values": {"emission": [[0], [1], [2]]}}, "world")
    sky = Sky(lit_by(world))
    d = random_directions(3)
    np.testing.assert_array_equal(sky.seen(d, np.array([0, 2, 4], np.int8)), np.eye(3))
    np.testing.assert_array_equal(sky.light(d), [0, 0, 1])  # one row: it is alike from all around
    assert not sky.suns


def test_a_world_of_one_colour_is_as_it_was():
    sky = Sky(Scene.from_shapes([], CAMERA, world_color=(0.1, 0.2, 0.3)))
    assert not sky.varies and not sky.suns and sky.light(random_directions(2), 0.1).shape == (3,)
    assert Sky(Scene.from_shapes([], CAMERA)).dark


@pytest.mark.parametrize("model", [0.0, 1.0, 2.0])
def test_the_sun_of_a_sky_has_the_energy_of_its_disc(model):
    """What a sky has more with its disc than without is what its lamp gives."""
    size = 0.0095 if model < 2 else 0.0
    off, on = Sky(lit_by(sky_texture(model, size=0.0))), Sky(lit_by(sky_texture(model, size=size)))
    assert len(on.suns) == (model < 2) and not off.suns
    np.testing.assert_allclose(on.light(random_directions(1), 13.0), off.light(random_directions(1), 13.0), rtol=1e-3)
    for lamp in on.suns:
        np.testing.assert_allclose((on.mean - off.mean) * 4, lamp.intensity, rtol=2e-3)
        assert np.arcsin(-lamp.direction[2]) == pytest.approx(0.5, abs=1e-3)
        assert np.arctan2(-lamp.direction[0], -lamp.direction[1]) == pytest.approx(0.9, abs=1e-3)
        assert 0.9 * size < lamp.angle < size  # darker at its limb: as an even disc that is a little smaller


def test_sunlight_that_comes_through_air_by_hand():
    """The disc's colour straight up, from the law of the scale heights: 8 km of air, 1.2 km of dust."""
    from light_meshes.surface import atmosphere as a

    weather = a.Weather(0.0, np.pi / 2, 0.0, 0.0, 1.0, 1.0, 0.0, 0.01, 1.0, 0.0)
    found = a._single_sun(weather).mean(0)[1] * a._solid_angle(weather)
    waves = np.linspace(380, 780, 21)
    left = np.exp(-8000 * 1.13116e-6 / (waves / 1000) ** 4 - 1200 * 2e-5 * 1.11)
    assert found == pytest.approx(float((a._SUN * left) @ a._OBSERVER[:, 1] * 20), rel=0.01)
    assert a._SUN.max() == pytest.approx(1.79, rel=0.01)  # W/(m²·nm) at 500 nm


def test_what_a_world_cannot_have_is_said(tmp_path):
    uv = program({"operations": [["uv"]], "values": {"emission": [[0], [1], 0.0]}}, "world")
    with pytest.raises(SceneError, match="'uv' of surfaces"):
        snapshot.check(lit_by(uv))
    with pytest.raises(SceneError, match="'Od'"):
        snapshot.check(lit_by(program({"operations": [], "values": {"Od": [1.0, 1.0, 1.0]}}, "world")))
    with pytest.raises(SceneError, match="image that does not exist"):
        snapshot.check(lit_by(AROUND))
    with pytest.raises(SceneError, match="from 0 to 2"):
        sky_texture(3.0)
    snapshot.write(lit_by(sky_texture(1.0)), tmp_path)
    assert snapshot.read(tmp_path).world == sky_texture(1.0)


def test_the_table_is_taken_over_between_pictures():
    first = Prepared(lit_by(sky_texture(1.0)))
    moved = Camera.look_at((0, -2, 1), (0, 1, 1), 60, 32, 32)
    again = Prepared(replace(first.world.scene, camera=moved, lights=()), previous=first)
    assert again.world.sky._table is first.world.sky._table and again.scene.lights == first.scene.lights
    other = Prepared(lit_by(sky_texture(1.0, elevation=0.4)), previous=first)
    assert other.world.sky._table is not first.world.sky._table
