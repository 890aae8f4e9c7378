"""Banding: the weights 1 − t² (t = |x−P|/r) for the nodes are better than the paper's uniform weights at equal cost.

`pytest -s tests/engine/test_penumbra_weights.py` prints figures along a penumbra of 60 pixels: the number of
distinct levels, the largest step between neighbours and the largest second difference (both also in the limit), and
the errors against the half-ball integral of the weight.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Settings
from profiles import QUANTISATION, half_ball, smootherstep, smoothstep, strip_minimum
from scenes import edge, strip, tabletop

LIMITS = {"UNIFORM": smoothstep, "SMOOTH": smootherstep}
RADII = [1.5, 2.0, 3.0, 4.0, 6.0]


class Banding(NamedTuple):
    """Of the rows of a picture that cross a penumbra."""

    levels: float  # distinct values between 0 and 1, a row
    step: float  # the largest difference of neighbours
    limit_step: float  # and that of the integral
    bend: float  # the largest second difference, mean of the rows: what the eye sees as Mach bands
    limit_bend: float
    mae: float
    rmse: float


@cache
def penumbra(weights: str, kI: float, pixels: int = 60) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x/r of each column, S (rows, columns) and its limit, over an upright edge whose penumbra has that many pixels."""
    size = 2 * 0.1 * kI * 64 / 60
    scene = edge(kI, pixels=pixels * 64 // 60, size=size, weights=weights)
    S = render_image(scene, passes=("Shadow",)).passes["Shadow"][..., 0].astype(float)
    u = (((np.arange(S.shape[1]) + 0.5) / S.shape[1] - 0.5) * size + scene.camera.matrix[0, 3]) / (0.1 * kI)
    return u, S, LIMITS[weights](u)


def banding(weights: str, kI: float) -> Banding:
    u, S, limit = penumbra(weights, kI)
    error = (S - limit)[:, np.abs(u) < 1]
    return Banding(
        np.mean([len(np.unique(row[(row > 0) & (row < 1)])) for row in S]), np.abs(np.diff(S)).max(),
        np.abs(np.diff(limit)).max(), np.abs(np.diff(S, 2)).max(1).mean(), np.abs(np.diff(limit, 2)).max(),
        np.abs(error).mean(), np.sqrt((error**2).mean()))


def test_the_paper_s_weight_is_the_engine_s_default():
    assert Settings().weights == "UNIFORM"


def test_figures():
    print("\n kI weights  levels  step (limit)   bend (limit)     MAE   RMSE   MAE·kI²")
    for kI in RADII:
        uniform, smooth = (banding(w, kI) for w in ("UNIFORM", "SMOOTH"))
        for name, b in (("uniform", uniform), ("smooth", smooth)):
            print(f"{kI:3} {name:8} {b.levels:6.1f}  {b.step:.3f} ({b.limit_step:.3f})  {b.bend:.4f} "
                  f"({b.limit_bend:.4f})  {b.mae:.4f} {b.rmse:.4f}  {b.mae * kI**2:.3f}")
        assert smooth.levels > uniform.levels
        assert smooth.step - smooth.limit_step < 0.3 * (uniform.step - uniform.limit_step)
        assert smooth.bend < 0.25 * uniform.bend
        assert smooth.rmse < 1.02 * uniform.rmse  # at equal cost the smoothness is not paid for with an error
    assert smooth.step < 1.1 * smooth.limit_step  # at kI = 6 what is left is the penumbra itself


@pytest.mark.parametrize("kI", RADII)
def test_the_error_is_the_quantisation_of_the_uniform_weight(kI):
    assert banding("SMOOTH", kI).mae <= 1.2 * QUANTISATION / kI**2


def test_on_a_plane_smooth_weights_leave_no_jump():
    """With four times the pixels the largest step is a quarter: S is continuous. A node's uniform 1/m stays 1/m."""
    steps = {w: [np.abs(np.diff(penumbra(w, 2.0, pixels)[1])).max() for pixels in (60, 240)] for w in LIMITS}
    assert steps["SMOOTH"][1] < 0.35 * steps["SMOOTH"][0]
    assert steps["UNIFORM"][1] > 0.5 * steps["UNIFORM"][0]


@pytest.mark.parametrize("degrees", [30, 60, 120, 150])
def test_oblique_edges_are_the_weighted_half_ball_integral(degrees):
    kI, beta = 4.0, np.radians(degrees)
    errors = {}
    for weights, weight in (("UNIFORM", np.ones_like), ("SMOOTH", lambda t: 1 - t * t)):
        scene = edge(kI, beta=beta, weights=weights)
        S = render_image(scene, passes=("Shadow",)).passes["Shadow"][..., 0].astype(float)
        left, right = scene.camera.window[:2]
        x = left + (right - left) * (np.arange(S.shape[1]) + 0.5) / S.shape[1] + scene.camera.matrix[0, 3]
        limit = half_ball(x, 0.1 * kI, beta, weight)  # the same ball, so the same ends:
        assert (S[:, limit < 1e-12] == 0).all() and (S[:, limit > 1 - 1e-12] == 1).all()
        errors[weights] = np.sqrt(((S - limit)[:, (limit > 0) & (limit < 1)] ** 2).mean())
    assert errors["SMOOTH"] < 1.1 * errors["UNIFORM"]
    assert errors["SMOOTH"] < 1.3 * QUANTISATION / kI**2


def test_the_weighted_half_ball_of_an_upright_edge_is_smootherstep():
    u = np.linspace(-1.2, 1.2, 101)
    np.testing.assert_allclose(half_ball(u, 1.0, np.pi / 2, lambda t: 1 - t * t), smootherstep(u), atol=1e-4)
    np.testing.assert_allclose(half_ball(u, 1.0, np.pi / 2), smoothstep(u), atol=1e-5)


@pytest.mark.parametrize("width", [0.1, 0.4, 0.8])
def test_a_strip_narrower_than_2r_gets_as_dark_as_the_weight_says(width):
    scene = strip(width, kI=6.0, weights="SMOOTH")
    S = render_image(scene, passes=("Shadow",)).passes["Shadow"][:, 31:33, 0]
    expected = strip_minimum(width, 0.6, smootherstep)
    assert S.mean() == pytest.approx(expected, abs=QUANTISATION / 6.0**2)
    assert abs(expected - strip_minimum(width, 0.6)) > QUANTISATION / 6.0**2  # so this is not the uniform weight's


def test_away_from_shadow_edges_smooth_weights_change_no_bit():
    """The same nodes see the same: where all agree any weights give 0 or 1, exactly."""
    pictures = [render_image(tabletop(120, weights=w), passes=("Combined", "Shadow")).passes for w in LIMITS]
    uniform, smooth = (p["Shadow"][..., 0] for p in pictures)
    same = (uniform == 0) | (uniform == 1)
    assert 0.5 < same.mean() < 1
    np.testing.assert_array_equal(pictures[1]["Combined"][same], pictures[0]["Combined"][same])
    assert (smooth[~same] != uniform[~same]).mean() > 0.9
