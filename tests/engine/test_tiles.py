"""More images than fit into memory: their texels come out of OpenImageIO's cache, and pictures stay the same."""

from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes import Scene, Shape, rectangle
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Image, Material
from light_meshes.scene.errors import SceneError
from light_meshes.surface import textures
from scenes import look_down, settings

SIDE = 520  # more than two tiles


def saved(path, kind=oiio.UINT8, seed=1, side=SIDE, channels=4):
    """An image of clouds, with an alpha from 0 to 1."""
    rng = np.random.default_rng(seed)
    small = rng.uniform(0, 1, (side // 8 + 1, side // 8 + 1, channels)).astype(np.float32)
    pixels = np.ascontiguousarray(np.kron(small, np.ones((8, 8, 1), np.float32))[:side, :side])
    spec = oiio.ImageSpec(side, side, channels, oiio.FLOAT)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(oiio.ROI(0, side, 0, side), pixels)
    buffer.set_write_format(kind)
    assert buffer.write(str(path)), buffer.geterror()
    return str(path)


def shown(images, pixels=48, uv=((-0.3, -0.2), (1.4, 1.2))):
    """Squares side by side, each with an image; uv from the lower left to the upper right corner of each."""
    (u0, v0), (u1, v1) = uv
    corners, shapes, uvs = np.array([(u0, v0), (u1, v0), (u1, v1), (u0, v1)], np.float32), [], []
    n = len(images)
    for i in range(n):
        sheet = rectangle((i / n - 0.5, -0.5), ((i + 1) / n - 0.5, 0.5), 0.0)
        shapes.append(Shape(sheet, Material(f"{i}", kd=0.0, image=i), f"{i}"))
        uvs.append(corners[sheet.triangles])
    scene = Scene.from_shapes(shapes, look_down(0, 0, 1, pixels), [], settings(), world_color=(1.0, 1.0, 1.0),
                              images=tuple(images))
    return render_image(replace(scene, geometry=replace(scene.geometry, uvs=np.concatenate(uvs))))


@pytest.mark.parametrize("alpha", ["KEEP", "MULTIPLIED", "STRAIGHT", "IGNORED"])
@pytest.mark.parametrize(("name", "kind"), [("a.png", oiio.UINT8), ("a.tif", oiio.UINT16), ("a.exr", oiio.FLOAT)])
def test_the_same_bits(tmp_path, monkeypatch, name, kind, alpha):
    path = saved(tmp_path / name, kind)
    ways = [("LINEAR", "REPEAT"), ("CLOSEST", "MIRROR"), ("CUBIC", "CLIP"), ("CUBIC", "EXTEND")]
    images = [Image(f"{i}", path, interpolation=how, extension=beyond, alpha=alpha,
                    colorspace=("sRGB", "LINEAR")[i % 2]) for i, (how, beyond) in enumerate(ways)]
    whole = shown(images).passes["Combined"]
    monkeypatch.setattr(textures, "LIMIT", 1 << 20)
    monkeypatch.setattr(textures, "SMALL", 0)
    np.testing.assert_array_equal(shown(images).passes["Combined"], whole)


def test_memory_stays_within_the_limit(tmp_path, monkeypatch):
    """Forty images of 1 MiB each: the cache holds 12 MiB at most (OpenImageIO knows no less than 10), or 30."""
    images = [Image(f"{i}", saved(tmp_path / f"{i}.tif", seed=i), alpha="KEEP") for i in range(40)]
    uv = np.random.default_rng(3).uniform(0, 1, (200, 2)).astype(np.float32)
    for limit in (12 << 20, 30 << 20):
        monkeypatch.setattr(textures, "LIMIT", limit)
        made, unread = textures.load(images, set(range(40)), 2)
        assert not unread
        most = 0
        for texture in made:
            texture.lookup(uv, np.arange(len(uv)), np.empty((len(uv), 3)))
            most = max(most, texture.cache.bytes)
        assert len({texture.cache for texture in made}) == 1
        assert 0.7 * limit < most < 1.15 * limit
    assert textures.held([1100 << 10] * 40) == 30 << 20  # as the estimate of memory has it


def test_a_file_that_is_gone_is_named(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    saved(path)
    monkeypatch.setattr(textures, "LIMIT", 0)
    monkeypatch.setattr(textures, "SMALL", 0)
    texture, = textures.load([Image("a", str(path))], {0}, 1)[0]
    path.write_bytes(path.read_bytes()[:2000])
    texture.cache._cache.invalidate(str(path))
    with pytest.raises(SceneError, match="cannot be read any more"):
        texture.lookup(np.full((1, 2), 0.01, np.float32), np.arange(1), np.empty((1, 3)))
