"""Blocks of the picture that find out together which of many lamps with a size they see in part."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from light_meshes import Light, Scene, Shape, box, sphere, translate
from light_meshes.film.images import Framebuffer
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import draw, render_image
from light_meshes.rays.tracer import Tracer
from light_meshes.shadows import blocks
from light_meshes.support.native import kernel
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


@pytest.mark.parametrize(("quality", "rival", "rays"), [("Balanced", "area 4", 0.85), ("Fine", "area 16", 4.5)])
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


@pytest.mark.parametrize("kI", [3.0, 4.0])
def test_rays_of_one_kernel_give_the_same_bits_as_arrays_of_them(monkeypatch, kI):
    expected = combined(scene(33, kI=kI))
    monkeypatch.setattr(Tracer, "field", lambda *_: None)
    np.testing.assert_array_equal(combined(scene(33, kI=kI)), expected)


def test_what_only_nodes_need_is_made_when_nodes_are_asked():
    """In this picture blocks answer for all receivers; a receiver by itself asks nodes."""
    ready = Prepared(scene())
    done = draw(ready, Framebuffer.create(ready.scene, ("Combined",)))
    assert done.statistics["nodes"] == 0 and not ready.shadowing.certify._made
    _, hits = ready.world.coarse_view()
    ready.lighting.light_visibility(hits.P, hits.Ng, hits.triangle)
    assert ready.shadowing.method.levels[0].reach in ready.shadowing.certify._made


# --- Penumbrae that are wide ------------------------------------------------------------------------------------------

EDGE = 4  # pixels of a small block with four samples


def block_of(share, rng):
    """Receivers of one large block of 8² pixels with four samples, of which share(x, y) of the rays arrive, spread over
    a pixel's; places, and what arrives (n,1)."""
    y, x, sample = np.meshgrid(np.arange(8), np.arange(8), np.arange(4), indexing="ij")
    place = ((y // 4 * 2 + x // 4) * 64 + y % 4 * 8 + x % 4).reshape(-1)
    seen = np.broadcast_to(share(x, y), x.shape)
    spread = (sample + rng.random(x.shape)) / 4
    order = np.argsort(place, kind="stable")
    return (place[order], (spread < seen).astype(float).reshape(-1)[order, None], x.reshape(-1)[order],
            y.reshape(-1)[order])


def fitted(place, clear, plane=None, windows=blocks.BALANCED.windows, surprise=blocks.SURPRISE):
    """S (n,) of the kernel, NaN of receivers that it leaves."""
    n = len(place)
    S, partly, left = np.full((n, 1, 1), np.nan, np.float32), np.zeros((n, 1), np.uint64), np.arange(n, dtype=np.int32)
    plane = np.zeros(n, np.uint8) if plane is None else plane
    count = kernel("blocks_fitted")(
        EDGE, 1.0, surprise, np.array(windows, float), place, plane, np.arange(n, dtype=np.int32),
        np.zeros(n, np.int32), np.ones(n, np.uint8), clear, np.ones(n), left, S, partly)
    assert (np.isnan(S[:, 0, 0]) == np.isin(np.arange(n), left[:count])).all()
    assert ((partly[:, 0] == 1) == ~np.isnan(S[:, 0, 0])).all()
    return S[:, 0, 0]


def test_in_a_wide_penumbra_means_are_nearer_than_sixteen_rays_of_a_pixel():
    rng, off, found = np.random.default_rng(1), [], []
    for _ in range(40):
        place, clear, x, y = block_of(lambda x, y: 0.5 + 0.03 * (x - 4) + 0.02 * (y - 4), rng)
        S = fitted(place, clear)
        found.append(np.isfinite(S).mean())
        off.append((S - (0.5 + 0.03 * (x - 4) + 0.02 * (y - 4)))[np.isfinite(S)])
    off = np.concatenate(off)
    assert np.mean(found) > 0.9
    assert np.sqrt((off**2).mean()) < 0.06  # four rays have .125
    assert abs(off.mean()) < 0.005


def test_at_a_sharp_edge_each_pixel_is_for_itself():
    """Nothing is fitted across an edge, and what lies far enough from it is what its rays say."""
    place, clear, x, _ = block_of(lambda x, y: (x >= 4) * 1.0, np.random.default_rng(2))
    S = fitted(place, clear)
    assert np.isnan(S[(x == 3) | (x == 4)]).all()
    sure = np.isfinite(S)
    np.testing.assert_array_equal(S[sure], clear[sure, 0])


def test_planes_do_not_speak_for_each_other():
    """Of two planes in a block one sees the lamp and one does not."""
    place, clear, x, _ = block_of(lambda x, y: (x >= 4) * 1.0, np.random.default_rng(2))
    S = fitted(place, clear, (x >= 4).astype(np.uint8))
    np.testing.assert_array_equal(S, clear[:, 0])


@given(st.integers(0, 1000), st.sampled_from([(4, 2), (3, 1), (2, 1)]))
def test_a_fit_is_that_of_plain_sums(seed, window):
    """S at each pixel by loops over the pixels around, where any penumbra counts as wide."""
    rng, (look, reach) = np.random.default_rng(seed), window
    place, clear, x, y = block_of(lambda x, y: rng.random() * (0.3 + 0.05 * x), rng)
    keep = np.sort(rng.permutation(len(place))[:200])
    place, clear, x, y = place[keep], clear[keep, :], x[keep], y[keep]
    S = fitted(place, clear, windows=((look, reach, -1.0),), surprise=1e9)

    def near(x0, y0, far):
        wide = min(2 * far + 1, 8)
        left, top = (np.clip(at - far, 0, 8 - wide) for at in (x0, y0))
        return (x >= left) & (x < left + wide) & (y >= top) & (y < top + wide)

    for k in range(0, len(place), 17):
        wide, close = near(x[k], y[k], look), near(x[k], y[k], reach)
        terms = np.stack([np.ones(wide.sum()), x[wide], y[wide]], axis=1)
        slope = np.linalg.lstsq(terms, clear[wide, 0], rcond=None)[0][1:]
        mean = clear[close, 0].mean() + slope @ [x[k] - x[close].mean(), y[k] - y[close].mean()]
        assert S[k] == pytest.approx(np.clip(mean, 0, 1), abs=1e-6)


def test_no_seam_where_blocks_meet():
    """Between pixels of two blocks the picture steps hardly more from the truth than between pixels of one."""
    whole = scene(96)
    off = (combined(whole) - combined(whole.with_settings(shadows="AREA_SAMPLING", light_samples=64, seed=7))).mean(2)
    step = np.abs(np.diff(off, axis=1))
    at = (np.arange(step.shape[1]) + 1) % (2 * EDGE) == 0
    assert np.sqrt((step[:, at]**2).mean()) <= 1.3 * np.sqrt((step[:, ~at]**2).mean())
