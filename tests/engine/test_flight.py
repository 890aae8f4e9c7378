"""The next frames of a flight keep the light from everywhere on surfaces as files have them: with bumps, which depend
on the camera's pixels, and with images that get a new file for each frame.
"""

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes import Camera, Image, Light, Material, Scene, Settings, Shape, box, rectangle, sphere, translate
from light_meshes.film.images import Framebuffer
from light_meshes.picture.render import draw, prepare, render_image
from light_meshes.picture.world import World
from light_meshes.scene.programs import program


def waves(colour=False, window=False):
    """The program of a bumpy surface: waves along x, whose heights are looked up one pixel apart. colour: its red
    follows them; window: and its green the place in the picture.
    """
    operations, values = [], {}
    for direction in range(3):
        first = 5 * direction
        operations += [["position", direction, 0.1], ["multiply", [first], 9.0], ["sine", [first + 3]]]
    operations += [["normal"], ["bump", [4], [9], [14], [15], [16], [17], 1.0, 0.1, 0.1], ["position"], ["sine", [21]],
                   ["window"]]
    values["normal"] = [[18], [19], [20]]
    if colour:
        values["Od"] = [[24], [25] if window else 0.5, 0.3]
    return program({"operations": operations, "values": values}, "here")


def scene(path, x=0.0, floor=None, content=None):
    """A bumpy floor, a box with an image, a ball and a pane of glass, seen from x; under a sky and a lamp."""
    if content is not None:
        assert oiio.ImageBuf(content).write(str(path))
    floor = floor or Material("floor", Od=(0.6,) * 3, program=waves(colour=True))
    painted, glass = Material("painted", image=0), Material("glass", kd=0.2, kt=(0.7,) * 3)
    parts = [Shape(rectangle((-9, -9), (9, 9), 0.0), floor, "floor"),
             Shape(box((-1, -0.3, 0), (-0.3, 0.4, 0.7)), painted, "box"),
             Shape(sphere(0.4), floor, "ball", [translate(0.3, 0, 0.4)]),
             Shape(rectangle((0.5, -0.6), (1.5, 0.6), 0.8), glass, "pane")]
    chosen = Settings(samples=1, world_light="SKY", bounces=1, shadows="SHARP", h=0.05)
    made = Scene.from_shapes(parts, Camera.look_at((x, -4, 2.5), (0, 0, 0.3), 50, 50, 40),
                             [Light("lamp", "POINT", (5.0,) * 3, (1.0, -2.0, 3.0))], chosen,
                             images=(Image("picture", str(path), alpha="IGNORED"),), world_color=(0.3, 0.4, 0.5))
    uvs = np.random.default_rng(1).random((len(made.geometry.triangles), 3, 2)).astype(np.float32)
    return replace(made, geometry=replace(made.geometry, uvs=uvs))


def texels(seed):
    return np.random.default_rng(seed).integers(0, 256, (8, 8, 3)).astype(np.uint8)


def next_frame(first, then):
    """Draw two frames, and compare the second with that of a new process. Return its records over the first one's."""
    ready = prepare(first, ("Combined",))
    before = draw(ready, Framebuffer.create(first, ("Combined",))).statistics["records"]
    result = draw(prepare(then, ("Combined",), previous=ready), Framebuffer.create(then, ("Combined",)))
    np.testing.assert_array_equal(result.passes["Combined"], render_image(then).passes["Combined"])
    return result.statistics["records"] / before


def test_the_next_frame_keeps_light_on_bumps_and_images_in_new_files(tmp_path):
    first = scene(tmp_path / "1.png", content=texels(1))
    assert next_frame(first, scene(tmp_path / "2.png", 0.2, content=texels(1))) < 0.5


def test_another_image_gathers_all_anew(tmp_path):
    first = scene(tmp_path / "1.png", content=texels(1))
    assert next_frame(first, scene(tmp_path / "2.png", content=texels(2))) > 0.9


def test_colours_that_depend_on_the_camera_gather_all_anew(tmp_path):
    floor = Material("floor", Od=(0.6,) * 3, program=waves(colour=True, window=True))
    first = scene(tmp_path / "1.png", floor=floor, content=texels(1))
    assert next_frame(first, scene(tmp_path / "1.png", 0.2, floor)) > 0.9


def test_a_file_that_is_painted_over_is_read_again(tmp_path):
    path = tmp_path / "1.png"
    first = scene(path, content=texels(1))
    ready = prepare(first, ("Combined",))
    path.unlink()
    then = scene(path, content=texels(2))
    again = prepare(then, ("Combined",), previous=ready)
    assert again.world.textures[0] is not ready.world.textures[0]
    back = scene(tmp_path / "3.png", content=texels(1))
    assert prepare(back, ("Combined",), previous=ready).world.textures[0] is ready.world.textures[0]


@pytest.mark.parametrize("lamp", [(1.0, -2.0, 3.0), (4.0, -2.0, 0.8)])
def test_light_from_bumps_is_hardly_other_than_that_from_a_flat_surface(monkeypatch, lamp):
    """Steep waves (their slope is up to .9) light a wall and a ball as a flat floor does, which patches are."""
    floor, white = Material("floor", Od=(0.6,) * 3, program=waves()), Material("white", Od=(0.8,) * 3)
    parts = [Shape(rectangle((-9, -9), (9, 9), 0.0), floor, "floor"),
             Shape(box((-1, 0.4, 0), (1, 0.6, 1.5)), white, "wall"),
             Shape(sphere(0.4), white, "ball", [translate(0.3, -0.5, 0.5)])]
    of = Scene.from_shapes(parts, Camera.look_at((0, -4, 2.5), (0, 0, 0.3), 50, 100, 80),
                           [Light("lamp", "POINT", (5.0,) * 3, lamp)],
                           Settings(samples=1, world_light="SKY", bounces=1, shadows="SHARP", h=0.05),
                           world_color=(0.05,) * 3)
    found, look = render_image(of).passes["Combined"][..., 0], World.look
    monkeypatch.setattr(World, "look", lambda self, hits, direction, ray, flat=False: look(self, hits, direction, ray))
    bumpy = render_image(of).passes["Combined"][..., 0]
    error = (np.abs(found - bumpy) / bumpy)[bumpy > 0.02]
    assert error.max() > 0
    assert abs(found.mean() / bumpy.mean() - 1) < 0.01 and np.quantile(error, 0.95) < 0.03


@pytest.mark.parametrize(("names", "sees"), [(None, True), ({"normal"}, True), ({"Od"}, False), ({"alpha"}, False)])
def test_which_parameters_depend_on_the_camera(names, sees):
    assert waves(colour=True).sees_camera(names) == sees
    assert waves(colour=True, window=True).sees_camera(names) == (sees or names == {"Od"})
    assert waves(colour=True).without_normals == {"Od"}
