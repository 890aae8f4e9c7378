"""Light Threshold: one lamp of a group stands for the shadows of all. The bound holds, and 0 is as before."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from light_meshes.scene.errors import SceneError
from light_meshes.scene.snapshot import read, write
from light_meshes.shadows.grouped import _groups
from light_meshes.shadows.ray_counts import _counts
from light_meshes.surface import colours, shading
from scenes import point, with_lights
from sized_lamps import scene_of

LAMPS, SUN = 96, 40


def hall(seed=3, **values):
    """Boxes under many small lamps of different power and softness, one of which is a sun, in a picture of 40²."""
    random = np.random.default_rng(seed)
    place, power = random.uniform((-2, -2, 1), (2, 2, 2.5), (LAMPS, 3)), random.uniform(0.01, 0.3, LAMPS)
    lamps = [point(at, e, f"lamp {n}", radius=0.02, softness="SIZE" if n % 3 else "SCENE")
             for n, (at, e) in enumerate(zip(place.tolist(), power.tolist(), strict=True))]
    lamps[SUN] = replace(lamps[SUN], type="SUN", direction=(0.3, 0.2, -0.93), softness="SCENE")
    lamps[7] = replace(lamps[7], blockers=(0, 1, 2))
    return with_lights(scene_of("boxes", "sphere", 40, h=0.1, **values), *lamps)


def light(scene):
    """S (n,L) of what the camera sees, what is returned of each light (n,L), its bits, the places, and the method."""
    ready = Prepared(scene)
    direction, hits = ready.world.coarse_view()
    lighting = ready.lighting
    found = list(lighting.lit(lighting._surfaces(hits, direction, colours.matt(hits, ready.world.textures)), False,
                              lambda: None))
    S = np.concatenate([S[..., 0] for *_, S in found]).astype(float)
    e = np.concatenate([shading.each(lit, active) for _, lit, active, _ in found])
    return S, e, np.concatenate([active for *_, active, _ in found]), hits.P, ready


@pytest.mark.parametrize("threshold", [0.003, 0.02, 0.2])
def test_the_error_is_below_the_bound(threshold):
    exact, e, active, P, _ = light(hall())
    S, _, _, _, ready = light(hall(light_threshold=threshold))
    method = ready.shadowing.method
    group, weight, bound = np.empty(e.shape, np.int32), np.empty_like(e), np.empty(len(e))
    asked, several = np.empty_like(active), np.empty_like(active)
    assert _groups(P, active, e, threshold, method.order, method.together, group, asked, several, weight, bound) == 0
    error = np.abs((e * (S - exact)).sum(1))
    assert (error <= bound * (1 + 1e-6) + 1e-6).all() and error.max() > 0
    share = (bound / e.sum(1)).mean()
    counts = ready.stats.counts
    assert counts["grouped_light"] / counts["grouped_receivers"] == pytest.approx(share, rel=1e-3)
    for row in range(0, len(e), 97):
        for lamp in np.unique(group[row][group[row] >= 0]):
            members = np.flatnonzero(group[row] == lamp)
            assert lamp in members and (len(members) == 1 or e[row, members].sum() <= threshold * e[row].sum() * 1.001)
            assert len(members) == 1 or not {SUN, 7} & set(members)  # one direction, or other casters


@given(st.integers(0, 2**32 - 1), st.integers(1, 130), st.floats(0, 1))
def test_groups_are_the_largest_that_may_be(seed, count, threshold):
    """Every active lamp has one that stands for it, which is asked; weights add up to all light."""
    random = np.random.default_rng(seed)
    leaves = 1 << max(0, count - 1).bit_length()
    order = np.full(leaves, -1, np.int32)
    order[:count] = random.permutation(count)
    e = (random.exponential(1, (3, count)) * (random.random((3, count)) < 0.8)).astype(np.float32)
    words = (count + 63) // 64
    active = np.zeros((3, words), np.uint64)
    on = random.random((3, count)) < 0.9
    for i in range(count):
        active[:, i >> 6] |= on[:, i].astype(np.uint64) << np.uint64(i & 63)
    group, weight, bound = np.empty(e.shape, np.int32), np.empty_like(e), np.empty(3)
    asked, several = np.empty_like(active), np.empty_like(active)
    assert _groups(random.normal(size=(3, 3)), active, e, threshold, order, np.ones(2 * leaves, np.bool_), group, asked,
                   several, weight, bound) == 0
    bits = np.unpackbits(asked.view(np.uint8), axis=1, count=count, bitorder="little").astype(bool)
    for row in range(3):
        assert ((group[row] >= 0) == on[row]).all()
        chosen = np.unique(group[row][group[row] >= 0])
        assert set(chosen) == set(np.flatnonzero(bits[row])) and (group[row, chosen] == chosen).all()
        all_of_it = float(e[row, on[row]].sum(dtype=np.float64))
        assert weight[row, chosen].sum(dtype=np.float64) == pytest.approx(all_of_it, rel=1e-5, abs=1e-6)
        assert bound[row] == pytest.approx(all_of_it - e[row, chosen].sum(dtype=np.float64), rel=1e-4, abs=1e-5)


def test_a_threshold_that_nothing_is_below_changes_no_bit():
    exact, found = (render_image(hall(light_threshold=t)) for t in (0.0, 1e-9))
    assert np.array_equal(exact.passes["Combined"], found.passes["Combined"])
    assert "light_bound" not in exact.statistics and found.statistics["light_bound"] == 0


def test_it_takes_fewer_rays_and_says_so():
    exact, found = (render_image(hall(light_threshold=t)) for t in (0.0, 0.05))
    assert found.statistics["shadow_rays"] < 0.5 * exact.statistics["shadow_rays"]
    assert 0 < found.statistics["light_bound"] < 1 and "0.05" in found.statistics["plan"]["light threshold"]
    a, b = (x.passes["Combined"][..., :3].astype(float) for x in (exact, found))
    assert 0 < np.abs(a - b).mean() < 0.2 * found.statistics["light_bound"] * a.mean()  # as a rule far below it


def test_tiles_and_threads_change_nothing():
    a, b = (render_image(hall(light_threshold=0.05), threads=n, tile_size=size) for n, size in ((1, 64), (2, 8)))
    assert np.array_equal(a.passes["Combined"], b.passes["Combined"])


def test_it_is_kept_in_a_snapshot_and_is_a_share(tmp_path):
    write(hall(light_threshold=0.25), tmp_path)
    assert read(tmp_path).settings.light_threshold == 0.25
    document = tmp_path / "scene.json"
    document.write_text(document.read_text().replace("0.25", "1.25"))
    with pytest.raises(SceneError, match="light_threshold"):
        read(tmp_path)


@pytest.mark.parametrize("count", [1, 64, 300])
def test_rays_are_shared_out_by_what_lamps_give(count):
    """By the formula of `ray_counts`, lamp by lamp; lamps that are not asked for get none."""
    random, steps, mean = np.random.default_rng(count), np.array([2.0, 4.0, 8.0]), 7.5
    on = random.random((9, count)) < np.linspace(0, 1, 9)[:, None]
    active = np.zeros((9, (count + 63) // 64), np.uint64)
    for i in range(count):
        active[:, i >> 6] |= on[:, i].astype(np.uint64) << np.uint64(i & 63)
    e, shown = random.exponential(1, (9, count)).astype(np.float32), np.where(np.arange(9) % 2, 0.3, 0.0)
    out = np.full((9, count), 77, np.uint8)
    assert _counts(active, e, shown, mean, steps, out) == 0
    for row in range(9):
        given = np.where(on[row], e[row].astype(float), 0)
        share = given * given.sum() / max((given**2).sum(), 1e-300)
        wanted = mean * (share * (shown[row] * given.sum() if shown[row] else 1)) ** 0.8
        expected = np.where(on[row], np.where(wanted >= 8, 8, np.where(wanted >= 4, 4, 2)), 0)
        assert (out[row] == expected).all()
