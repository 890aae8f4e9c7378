"""Blocks of the picture that find out together which of many lamps with a size they see in part."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from light_meshes import Light, Scene, Shape, box, sphere, translate
from light_meshes.picture.render import render_image
from light_meshes.shadows import blocks
from scenes import GREY, look_down, settings
from sized_lamps import floor

LAMPS = tuple(Light(f"lamp {n}", "POINT", (0.3 + n % 3,) * 3, position=(2 * np.cos(n), 2 * np.sin(n), 2.0 + n % 2),
                    radius=0.2, softness="SIZE") for n in range(8))


def scene(pixels=96, samples=4, kI=3.0, lamps=LAMPS):
    """Posts, one of them thinner than a pixel, and a ball, under eight lamps."""
    shapes = [floor(), Shape(sphere(0.2), GREY, "ball", [translate(0.4, 0.3, 0.2)]),
              Shape(box((-0.5, -0.4, 0), (-0.35, -0.25, 0.6)), GREY, "post"),
              Shape(box((0.3, -0.5, 0), (0.308, -0.492, 0.7)), GREY, "thin"),
              Shape(box((-0.2, 0.2, 0.3), (0.0, 0.6, 0.32)), GREY, "plate")]
    return Scene.from_shapes(shapes, look_down(0.0, 0.0, 1.6, pixels, height=5.0), lamps,
                             settings(shadows="LIGHT_MESHES", auto_h=True, kI=kI, samples=samples, weights="SMOOTH"))


def combined(of, **more):
    return render_image(of, **more).passes["Combined"][..., :3].astype(float)


@pytest.fixture(scope="module")
def errors():
    """RMSE over the mean of the reference, and rays for each pair: by method."""
    whole = scene()
    by = {f"area {n}": whole.with_settings(shadows="AREA_SAMPLING", light_samples=n) for n in (4, 16)}
    by |= {"Balanced": whole, "Fine": whole.with_settings(kI=4.0)}
    truth = combined(whole.with_settings(shadows="AREA_SAMPLING", light_samples=96, seed=7))
    found = {}
    for name, one in by.items():
        done = render_image(one)
        off = done.passes["Combined"][..., :3] - truth
        pairs = done.statistics.get("lamp_pairs", 0)
        found[name] = np.sqrt((off**2).mean()) / truth.mean(), done.statistics["shadow_rays"] / max(pairs, 1)
    return found


@pytest.mark.parametrize(("quality", "rival", "rays"), [("Balanced", "area 4", 1.3), ("Fine", "area 16", 4.5)])
def test_they_are_as_near_as_area_sampling_by_far_fewer_rays(errors, quality, rival, rays):
    assert errors[quality][0] <= 1.05 * errors[rival][0]
    assert errors[quality][1] <= rays


@pytest.mark.parametrize("samples", [1, 4])
def test_tiles_threads_and_crops_give_the_same_bits(samples):
    """Blocks stand where the picture is, not where a tile or a crop begins; nothing is split between tiles."""
    whole = scene(45, samples)
    expected = combined(whole)
    for more in ({"tile_size": 7}, {"tile_size": 45, "threads": 1}, {"tile_size": 16, "threads": 2}):
        np.testing.assert_array_equal(combined(whole, **more), expected)
    crop = replace(whole, camera=replace(whole.camera, crop=(13, 6, 38, 43)))
    np.testing.assert_array_equal(combined(crop), expected[6:43, 13:38])


def test_parts_of_receivers_give_the_same_bits(monkeypatch):
    """With many lamps receivers are lit in parts, and no block is cut."""
    from light_meshes.picture import lighting
    expected = combined(scene(45))
    monkeypatch.setattr(lighting, "SHADED", 1 << 11)
    np.testing.assert_array_equal(combined(scene(45)), expected)


def test_lamps_that_all_see_cost_half_a_ray_or_less():
    open_floor = replace(scene(), geometry=Scene.from_shapes([floor()], look_down(0, 0, 1, 8), LAMPS).geometry)
    done = render_image(open_floor)
    pairs = 96 * 96 * 4 * len(LAMPS)
    assert done.statistics["lamp_pairs"] == pairs and done.statistics["ray_pairs"] == 0
    assert done.statistics["shadow_rays"] <= 0.5 * pairs


def test_few_lamps_ask_nodes():
    done = render_image(scene(lamps=LAMPS[:3]).with_settings(auto_h=False, h=0.1))
    assert done.statistics["receivers"] > 0


@given(st.integers(1, 70), st.integers(0, 40), st.integers(0, 40), st.integers(1, 40), st.integers(1, 40))
def test_blocks_of_a_box_are_those_of_the_picture(samples, x, y, width, height):
    """Whole blocks, cut at the picture's edge only; a block has about as many receivers for any number of samples."""
    small = blocks.edge(samples)
    assert small == 1 or 32 <= small**2 * samples <= 4 * blocks.RECEIVERS
    box = blocks.whole((x, y, x + width, y + height), 80, 80, samples)
    assert box[0] <= x and box[1] <= y and box[2] >= x + width and box[3] >= y + height
    assert all(edge % (2 * small) == 0 or edge == 80 for edge in box)
    pixel = blocks.ordered(box, samples)[::samples] // samples
    number = blocks.numbers(pixel, box, samples)
    assert (np.diff(number) >= 0).all() and len(np.unique(pixel)) == (box[2] - box[0]) * (box[3] - box[1])
    py, px = np.divmod(pixel, box[2] - box[0])
    place = (py + box[1]) // small * 1000 + (px + box[0]) // small
    assert len(np.unique(np.stack([number, place]), axis=1).T) == len(np.unique(number)) == len(np.unique(place))


@given(st.lists(st.integers(0, 12), max_size=60), st.integers(1, 20))
def test_no_large_block_is_cut(numbers, most):
    block = np.sort(np.array(numbers, np.int64))
    parts = blocks.slices(block, most)
    assert [i for part in parts for i in range(part.start, part.stop)] == list(range(len(block)))
    for a, b in pairwise(parts):
        assert block[a.stop - 1] >> 2 != block[b.start] >> 2
