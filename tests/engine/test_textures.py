"""An image on a surface: where its texels are, how they are blended, and which colours they mean."""

import os
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes import Scene, Shape, rectangle
from light_meshes.picture.render import prepare, render_image
from light_meshes.scene.description import IDENTITY, Image, Material
from light_meshes.surface import textures
from light_meshes.surface.textures import Texture
from scenes import look_down, settings

# Rows from the top, as a file has them: 3 × 2 texels of distinct colours.
TEXELS = np.array([[(255, 0, 0), (0, 255, 0), (0, 0, 255)], [(64, 128, 192), (255, 255, 255), (0, 0, 0)]], np.uint8)
NAMES = {np.uint8: "picture.png", np.uint16: "deep.png", np.float32: "picture.exr"}


def saved(folder, dtype=np.uint8, texels=TEXELS):
    path = folder / NAMES[dtype]
    kind, white = {np.uint8: (oiio.UINT8, 255), np.uint16: (oiio.UINT16, 65535), np.float32: (oiio.FLOAT, 1)}[dtype]
    pixels = (texels / np.float32(255) * white).astype(dtype)
    spec = oiio.ImageSpec(texels.shape[1], texels.shape[0], texels.shape[2], kind)
    spec.attribute("oiio:UnassociatedAlpha", 1)  # or the colours would be divided by alpha
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec) and out.write_image(np.ascontiguousarray(pixels)) and out.close()
    return path


def shown(path, pixels, uv=((0, 0), (1, 1)), **values):
    """The picture of a square with the image on it, uv from its lower left to its upper right corner."""
    (u0, v0), (u1, v1) = uv
    corners = np.array([(u0, v0), (u1, v0), (u1, v1), (u0, v1)], np.float32)
    sheet = rectangle((-0.5, -0.5), (0.5, 0.5), 0.0)
    material = Material("picture", Od=(9.0, 9.0, 9.0), kd=0.0, image=0)
    scene = Scene.from_shapes([Shape(sheet, material, "sheet")], look_down(0, 0, 1, pixels), [], settings(),
                              world_color=(1.0, 1.0, 1.0), images=(Image("picture", str(path), **values),))
    scene = replace(scene, geometry=replace(scene.geometry, uvs=corners[sheet.triangles]))
    return render_image(scene)


def linear(texels):
    x = texels / 255
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("dtype", NAMES)
@pytest.mark.parametrize(("colorspace", "meaning"), [("sRGB", linear), ("LINEAR", lambda t: t / 255)])
def test_texels_lie_where_uv_says_in_the_files_colours(tmp_path, dtype, colorspace, meaning):
    picture = shown(saved(tmp_path, dtype), 6, colorspace=colorspace, interpolation="CLOSEST").passes["Combined"]
    expected = np.repeat(np.repeat(meaning(TEXELS)[::-1], 3, axis=0), 2, axis=1)  # bottom-up, 6 × 6
    np.testing.assert_allclose(picture[..., :3], expected, atol=1e-5)


@pytest.mark.parametrize("matrix", [IDENTITY, ((0.5, 0.5, 0), (0, 1, 0), (0, 0, 1))])
def test_between_texels_the_numbers_of_srgb_are_blended(tmp_path, matrix):
    """As in Cycles: linear light is blended only where another conversion follows."""
    picture = shown(saved(tmp_path), 60, uv=((1 / 6, 0.25), (5 / 6, 0.75)), matrix=matrix).passes["Combined"][..., :3]
    x = (np.arange(60) + 0.5) / 60 * 2  # in texels from the middle of the first
    y = (np.arange(60) + 0.5) / 60
    left = np.minimum(x.astype(int), 1)
    rows = (TEXELS if matrix == IDENTITY else linear(TEXELS))[::-1]
    along = rows[:, left] * (1 - (x - left))[:, None] + rows[:, left + 1] * (x - left)[:, None]
    expected = along[0] * (1 - y)[:, None, None] + along[1] * y[:, None, None]
    expected = linear(expected) if matrix == IDENTITY else expected @ np.array(matrix).T
    np.testing.assert_allclose(picture, expected, atol=1e-4)


def test_values_below_0_stay(tmp_path):
    """Of data that are no colours, as a vector's; what is no number is 0."""
    texels = np.array([[(-0.5, 0.25, -2), (np.nan, 1, 1), (-1, np.inf, 3)]], np.float32)
    path = tmp_path / "signed.exr"
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(3, 1, 3, "float"))
    out.write_image(texels)
    out.close()
    texture = Texture(Image("signed", str(path), colorspace="LINEAR", interpolation="CLOSEST"))
    found = np.empty((3, 3))
    texture.lookup(np.array([(0.2, 0.5), (0.5, 0.5), (0.8, 0.5)], np.float32), np.arange(3), found)
    np.testing.assert_array_equal(found, [(-0.5, 0.25, -2), (0, 0, 0), (0, 0, 0)])


@pytest.mark.parametrize(("extension", "columns"), [("REPEAT", [0, 1, 2, 0, 1, 2, 0, 1, 2]),
                                                    ("MIRROR", [2, 1, 0, 0, 1, 2, 2, 1, 0]),
                                                    ("EXTEND", [0, 0, 0, 0, 1, 2, 2, 2, 2]),
                                                    ("CLIP", [-1, -1, -1, 0, 1, 2, -1, -1, -1])])
def test_beyond_the_image(tmp_path, extension, columns):
    picture = shown(saved(tmp_path), 9, uv=((-1, 0.5), (2, 1)), interpolation="CLOSEST",
                    extension=extension).passes["Combined"][..., :3]
    top = np.vstack([linear(TEXELS)[0], np.zeros((1, 3))])
    np.testing.assert_allclose(picture, np.broadcast_to(top[columns], (9, 9, 3)), atol=1e-5)


@pytest.mark.parametrize("channels", [1, 4])
def test_grey_images_and_images_with_alpha(tmp_path, channels):
    texels = TEXELS[..., :1] if channels == 1 else np.concatenate([TEXELS, TEXELS[..., :1] // 2 + 9], 2)
    picture = shown(saved(tmp_path, texels=texels), 6, interpolation="CLOSEST").passes["Combined"][..., :3]
    colours = np.repeat(texels, 3, 2) if channels == 1 else TEXELS  # as painted, not multiplied by alpha
    np.testing.assert_allclose(picture, np.repeat(np.repeat(linear(colours)[::-1], 3, 0), 2, 1), atol=1e-5)


LEAF = np.array([[(200, 100, 50, 255), (10, 250, 90, 0), (30, 60, 240, 128)]], np.uint8)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("colorspace", ["sRGB", "LINEAR"])
def test_colours_are_multiplied_by_alpha_where_asked(tmp_path, dtype, colorspace):
    """In the file's own numbers, as Cycles does. What is stored multiplied is not once more."""
    path = saved(tmp_path, dtype, LEAF)
    kinds = {"alpha": "MULTIPLIED", "stored": "STRAIGHT"}, {"alpha": "MULTIPLIED", "stored": "MULTIPLIED"}, {}
    multiplied, as_it_is, kept = (shown(path, 3, colorspace=colorspace, interpolation="CLOSEST", **values).passes[
        "Combined"][0, :, :3] for values in kinds)
    meaning = linear if colorspace == "sRGB" else lambda t: t / 255
    alpha = LEAF[0, :, 3:] / 255
    np.testing.assert_allclose(multiplied, meaning(LEAF[0, :, :3] * alpha), atol=4e-3 if dtype == np.uint8 else 2e-5)
    np.testing.assert_allclose(kept, meaning(LEAF[0, :, :3]), atol=1e-5)
    np.testing.assert_array_equal(as_it_is, kept)


def test_a_clear_texel_does_not_bleed_into_its_neighbour(tmp_path):
    """Straight colours are blended by how much of them is there."""
    uv = ((1 / 3, 0), (1 / 3, 1))  # between the red texel, which is there, and the green one, which is not
    path = saved(tmp_path, texels=LEAF)
    straight, kept = (shown(path, 1, uv=uv, alpha=alpha).passes["Combined"][0, 0, :3] for alpha in ("STRAIGHT", "KEEP"))
    red = linear(LEAF[0, 0, :3])
    np.testing.assert_allclose(straight, red, atol=1e-5)
    np.testing.assert_allclose(kept, linear((LEAF[0, 0, :3].astype(float) + LEAF[0, 1, :3]) / 2), atol=1e-5)


@pytest.mark.parametrize(("colorspace", "meaning"), [("sRGB", linear), ("LINEAR", lambda t: t / 255)])
def test_another_working_space(tmp_path, colorspace, meaning):
    """A matrix turns linear light into the scene's; what lies outside of its gamut is black there."""
    matrix = np.array([(0.5, 0.25, 0), (0, 1, 0), (1, 0, -0.5)])
    picture = shown(saved(tmp_path), 6, colorspace=colorspace, interpolation="CLOSEST",
                    matrix=tuple(map(tuple, matrix))).passes["Combined"]
    expected = np.maximum(meaning(TEXELS) @ matrix.T, 0)
    np.testing.assert_allclose(picture[..., :3], np.repeat(np.repeat(expected[::-1], 3, 0), 2, 1), atol=1e-5)


CONFIG = """ocio_profile_version: 2.0
roles: {scene_linear: light, default: light}
file_rules: [!<Rule> {name: Default, colorspace: default}]
displays: {screen: [!<View> {name: plain, colorspace: light}]}
colorspaces:
  - !<ColorSpace> {name: light, family: "", isdata: false}
  - !<ColorSpace>
    name: halved
    isdata: false
    to_scene_reference: !<MatrixTransform> {matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]}
"""


def test_a_colour_space_of_a_configuration(tmp_path):
    (tmp_path / "config.ocio").write_text(CONFIG)
    ocio = str(tmp_path / "config.ocio")
    result = shown(saved(tmp_path), 6, interpolation="CLOSEST", colorspace="halved", ocio=ocio)
    np.testing.assert_allclose(result.passes["Combined"][..., :3], np.repeat(np.repeat(TEXELS[::-1], 3, 0), 2, 1) / 510,
                               atol=1e-5)
    assert not result.warnings


def test_a_configuration_is_read_once_and_again_when_its_file_has_changed(tmp_path):
    file, path = tmp_path / "config.ocio", saved(tmp_path)
    file.write_text(CONFIG)
    before = textures._configuration.cache_info()
    for _ in range(2):
        assert not shown(path, 6, colorspace="halved", ocio=str(file)).warnings
    after = textures._configuration.cache_info()
    assert (after.misses - before.misses, after.hits - before.hits) == (1, 1)
    file.write_text(CONFIG.replace("halved", "other than before"))
    (warning,) = shown(path, 6, colorspace="halved", ocio=str(file)).warnings
    assert "no such conversion" in warning


@pytest.mark.parametrize(("config", "space"), [(CONFIG, "unknown"), ("no configuration", "halved"), (None, "halved"),
                                               (CONFIG.replace("2.0", "2.99"), "halved")])
def test_a_conversion_that_cannot_be_made_is_named_and_read_as_srgb(tmp_path, config, space):
    if config:
        (tmp_path / "config.ocio").write_text(config)
    result = shown(saved(tmp_path), 6, interpolation="CLOSEST", colorspace=space, ocio=str(tmp_path / "config.ocio"))
    expected = np.repeat(np.repeat(linear(TEXELS)[::-1], 3, 0), 2, 1)
    np.testing.assert_allclose(result.passes["Combined"][..., :3], expected, atol=1e-5)
    (warning,) = result.warnings
    assert all(word in warning for word in ("picture", space, "config.ocio", "read as sRGB"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_what_is_no_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "folder.png").mkdir()
    for path in (tmp_path / "pipe.png", tmp_path / "folder.png", "/dev/zero", "/proc/self/maps"):
        result = shown(path, 4)
        assert any("picture" in w and str(path) in w and "cannot be read" in w for w in result.warnings)
        assert (result.passes["Combined"][..., :3] == (1, 0, 1)).all()


@pytest.mark.parametrize("content", [None, b"", b"no picture", b"\x89PNG\r\n\x1a\n broken"])
def test_an_image_that_cannot_be_read_is_named_and_magenta(tmp_path, content):
    path = tmp_path / "lost.png"
    if content is not None:
        path.write_bytes(content)
    result = shown(path, 4)
    assert any("picture" in w and "lost.png" in w for w in result.warnings)
    assert (result.passes["Combined"][..., :3] == (1, 0, 1)).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("extension", ["REPEAT", "CLIP"])
def test_what_a_crossing_lets_through_is_the_same_in_the_kernel(tmp_path, dtype, channels, extension):
    """By alpha of images of all kinds, beside the way for any material."""
    random = np.random.default_rng(3)
    path = saved(tmp_path, dtype, random.integers(0, 256, (5, 7, channels)).astype(np.uint8))
    images = tuple(Image(kind, str(path), extension=extension, interpolation=kind)
                   for kind in ("LINEAR", "CLOSEST", "CUBIC"))
    materials = [Material("tinted", alpha=0.7, kt=(0.1, 0.5, 0.9)), *(
        Material(str(i), alpha=0.9, alpha_image=i, kt=(0.2, 0.0, 0.0)) for i in range(3))]
    shapes = [Shape(rectangle((0, 0), (1, 1), i), material, str(i)) for i, material in enumerate(materials)]
    scene = Scene.from_shapes(shapes, look_down(0, 0, 9, 8), [], settings(), images=images)
    uvs = random.random((len(scene.geometry.triangles), 3, 2)).astype(np.float32) * 3 - 1
    glass = prepare(replace(scene, geometry=replace(scene.geometry, uvs=uvs)), ("Combined",)).glass
    triangle = random.integers(0, len(uvs), 3000).astype(np.int32)
    u, v = (random.random((2, 3000)) / 2).astype(np.float32)
    found = glass.factor(triangle, u, v)
    np.testing.assert_array_equal(found, glass._factor_of(triangle, u, v))
    assert (len(np.unique(found)) > 100) == (channels == 4 or extension == "CLIP")
