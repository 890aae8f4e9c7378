"""The paper's claims on its own scene (S3): (a) equal away from shadows, (b) every edge blurred, (c) convergence."""

from functools import cache

import numpy as np
import pytest
import scenes
from light_meshes import box, cylinder
from light_meshes.picture.render import render_image
from oracle import camera_ray
from profiles import QUANTISATION
from scenes import S3_LIGHT, bar_shadow, tabletop
from shadow_volumes import first_hit, shadow_volume, uniform

SOLIDS = [box(*scenes.TABLETOP), cylinder(*scenes.CYLINDER), box(*scenes.BAR)]


@cache
def rendered(width, **values):
    return render_image(tabletop(width, **values), passes=("Combined", "Shadow"))


@cache
def seen(width):
    """(P, N, hit) of each pixel's middle, from exact geometry."""
    scene = tabletop(width)
    grid = [camera_ray(scene, x + 0.5, y + 0.5) for y in range(width) for x in range(width)]
    P, N, solid = first_hit(grid[0][0], np.array([g[1] for g in grid]), SOLIDS)
    return P, N, solid.reshape(width, width)


@cache
def penumbra(width, r):
    """(all lit, all dark, mixed) pixels."""
    P, N, solid = seen(width)
    volumes = [shadow_volume(s, np.array(S3_LIGHT)) for s in SOLIDS]
    lit, dark = (a.reshape(width, width) for a in uniform(P, N, r, volumes))
    away = (N * (np.array(S3_LIGHT) - P)).sum(1).reshape(width, width) <= 0  # ξ = 0: no light in either picture
    lit, dark = lit & (solid >= 0), (dark | away) & (solid >= 0)
    return lit, dark, (solid >= 0) & ~lit & ~dark


@pytest.mark.parametrize(("h", "kI"), [(0.05, 3.0), (0.02, 3.0), (0.05, 1.3), (0.01, 8.0)])
def test_a_away_from_shadow_edges_both_methods_give_the_same_bits(h, kI):
    soft = rendered(250, h=h, kI=kI).passes["Combined"]
    sharp = rendered(250, shadows="SHARP").passes["Combined"]
    differs = (soft != sharp).any(-1)
    _, _, mixed = penumbra(250, h * kI)
    assert not (differs & ~mixed).any()
    assert differs.any()
    assert 0.01 < mixed.mean() < 0.5  # the statement is neither empty nor about everything


def test_a_holds_with_exact_values_in_light_and_in_shadow():
    shadow = rendered(250).passes["Shadow"][..., 0]
    lit, dark, _ = penumbra(250, 0.15)
    assert (shadow[lit] == 1).all()
    assert (shadow[dark] == 0).all()


def test_b_every_sharp_shadow_edge_is_blurred():
    """Wherever V jumps between two neighbours on one face, S lies within (0, 1) and changes little."""
    width = 400
    sharp = rendered(width, shadows="SHARP").passes["Shadow"][..., 0]
    soft = rendered(width).passes["Shadow"][..., 0]
    _, N, solid = seen(width)
    N = N.reshape(width, width, 3)
    edges = 0
    for axis in (0, 1):
        a, b = (slice(None, -1), slice(1, None))
        first, second = ((a, slice(None)), (b, slice(None))) if axis == 0 else ((slice(None), a), (slice(None), b))
        same_face = (solid[first] == solid[second]) & (solid[first] >= 0) & (N[first] == N[second]).all(-1)
        jump = same_face & (sharp[first] != sharp[second])
        edges += jump.sum()
        assert (np.abs(soft[first] - soft[second])[jump] < 0.25).all()
        for side in (first, second):
            assert ((soft[side][jump] > 0) & (soft[side][jump] < 1)).all()
    assert edges > 300


def test_faces_edges_stay_as_sharp_as_they_were():
    """Only the shadow's edge is blurred: the tabletop's rim, in full light, has the same bits."""
    lit, _, _ = penumbra(250, 0.15)
    _, N, _ = seen(250)
    N = N.reshape(250, 250, 3)
    rim = lit[:, :-1] & lit[:, 1:] & (N[:, :-1] != N[:, 1:]).any(-1)
    soft, sharp = (rendered(250, **v).passes["Combined"] for v in ({}, {"shadows": "SHARP"}))
    assert rim.sum() > 20
    np.testing.assert_array_equal((soft[:, 1:] - soft[:, :-1])[rim], (sharp[:, 1:] - sharp[:, :-1])[rim])


@pytest.mark.slow
def test_c_the_image_converges_as_h_falls_at_a_constant_ratio():
    steps = np.array([0.04, 0.02, 0.01, 0.005])
    sharp = rendered(400, shadows="SHARP").passes["Combined"][..., :3].astype(float)
    errors = [rendered(400, h=float(h), kI=3.0).passes["Combined"][..., :3] - sharp for h in steps]
    mae = np.log([np.abs(e).mean() for e in errors])
    rmse = np.log([np.sqrt((e**2).mean()) for e in errors])
    assert np.polyfit(np.log(steps), mae, 1)[0] == pytest.approx(1.0, abs=0.15)
    assert np.polyfit(np.log(steps), rmse, 1)[0] == pytest.approx(0.5, abs=0.15)


def gradient(h, r):
    """S over the tabletop in the crop of Fig. 6."""
    return render_image(bar_shadow(h, r, 120), passes=("Shadow",)).passes["Shadow"][..., 0]


def test_r_sets_the_width_of_the_penumbra():
    """Fig. 6, right: at one h a larger r blurs more of the picture, and leaves less of it dark."""
    pictures = [gradient(0.05, r) for r in (0.075, 0.1, 0.15, 0.2)]
    mixed = [((S > 0) & (S < 1)).mean() for S in pictures]
    dark = [(S == 0).mean() for S in pictures]
    assert mixed == sorted(mixed) and mixed[-1] > 2 * mixed[0]
    assert dark == sorted(dark, reverse=True)


def test_h_sets_its_gradation():
    """Fig. 6, left: at one r a smaller h blurs the same place more finely."""
    fine = gradient(0.15 / 8, 0.15)
    pictures = [gradient(h, 0.15) for h in (0.1, 0.075, 0.05, 0.0375)]
    errors = [np.sqrt(((S - fine) ** 2).mean()) for S in pictures]
    assert errors == sorted(errors, reverse=True) and errors[0] > 3 * errors[-1]
    steps = [np.abs(np.diff(S, axis=1)).max() for S in pictures]
    assert steps[0] > 2 * steps[-1]
    penumbra = ((fine > 0) & (fine < 1)).mean()
    for S, kI in zip(pictures, (1.5, 2, 3, 4), strict=True):  # no lighter, no darker, but for both quantisations
        assert abs(S.mean() - fine.mean()) <= QUANTISATION * (kI**-2 + 8.0**-2) * penumbra


@pytest.mark.slow
def test_few_nodes_are_used_and_hardly_a_set_is_empty():
    statistics = render_image(tabletop(1000)).statistics
    assert 0.01 <= statistics["node_share"] <= 0.10
    assert statistics["empty_sets"] <= 12
