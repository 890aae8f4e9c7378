"""What tests of nodes beside Cycles have in common: the plane, node trees written quickly, and the comparison."""

import bpy
import numpy as np
import pytest
from node_trees import Tree  # noqa: F401 (for those who import it from here)


@pytest.fixture
def plane(scene, add_plane):
    """A plane that fills the picture, its UVs from 0 to 1, the render without filter, and Cycles' settings."""
    ob = add_plane(half=1.0)
    layer = ob.data.uv_layers.new(name="UVMap")
    for corner, at in zip(layer.uv, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        corner.vector = at
    scene.camera.data.type, scene.camera.data.ortho_scale = 'ORTHO', 1.96
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.filter_size = 0.0
    scene.light_meshes.samples = 1
    scene.cycles.samples, scene.cycles.filter_width, scene.cycles.use_denoising = 4, 0.01, False  # at pixels' middles
    scene.cycles.use_adaptive_sampling = False
    return ob


def both(scene, render):
    """Return this engine's picture and Cycles'."""
    scene.render.engine = 'LIGHT_MESHES'
    scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
    ours = render(scene)["Combined"][..., :3]
    scene.render.engine = 'CYCLES'
    theirs = render(scene)["Combined"][..., :3]
    return ours, theirs


def agree(ours, theirs, median=0.005, most=0.03):
    """Whether the pictures are the same: in the median, and at the 99th percentile away from the edges of patterns."""
    difference = np.abs(ours - theirs).max(2) / np.maximum(np.abs(theirs).max(2), 0.05)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(theirs, ((1, 1), (1, 1), (0, 0)), 'edge'), (3, 3), (0, 1))
    smooth = np.ptp(around, axis=(3, 4)).max(2) < 0.15 * max(theirs.max(), 0.05)
    assert smooth.mean() > 0.3
    assert np.median(difference) <= median, np.median(difference)
    assert np.quantile(difference[smooth], 0.99) <= most, np.quantile(difference[smooth], 0.99)


def check(plane, scene, render, socket, tree, **bounds):
    plane.data.materials.clear()
    plane.data.materials.append(tree.emit(socket))
    ours, theirs = both(scene, render)
    assert theirs.max() > 0.01
    agree(ours, theirs, **bounds)


def painted(width=24, height=16):
    """Return an image whose every texel is another colour, with an alpha that goes from 0 to 1."""
    image = bpy.data.images.new("painted", width, height, alpha=True)
    rng = np.random.default_rng(5)
    pixels = rng.uniform(0.1, 0.9, (height, width, 4)).astype(np.float32)
    pixels[..., 3] = np.linspace(0, 1, width)
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image
