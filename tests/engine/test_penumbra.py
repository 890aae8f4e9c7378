"""Shadow edges whose blur has a formula: docs/method.md §2 (half-ball), §7 (quantisation)."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes.picture.render import render_image
from profiles import QUANTISATION, disc_share, half_ball, smoothstep, strip_minimum
from scenes import edge, strip


def profile(scene):
    """(x, S) of every pixel: the receiver's distance from the shadow's edge, positive in the light."""
    S = render_image(scene, passes=("Shadow",)).passes["Shadow"][..., 0].astype(float)
    left, right = scene.camera.window[:2]
    x = left + (right - left) * (np.arange(S.shape[1]) + 0.5) / S.shape[1] + scene.camera.matrix[0, 3]
    return np.broadcast_to(x, S.shape), S


@pytest.mark.parametrize("kI", [1.5, 2.0, 3.0, 4.0, 6.0])
def test_an_upright_edge_is_smoothstep_within_the_quantisation(kI):
    x, S = profile(edge(kI))
    penumbra = np.abs(x) < 0.1 * kI
    error = np.abs(S - smoothstep(x / (0.1 * kI)))[penumbra].mean()
    assert error <= QUANTISATION / kI**2


def test_the_quantisation_falls_with_kI_squared():  # noqa: N802
    kIs, errors = np.array([1.5, 2.0, 3.0, 4.0, 6.0]), []
    for kI in kIs:
        x, S = profile(edge(kI))
        errors.append(np.abs(S - smoothstep(x / (0.1 * kI)))[np.abs(x) < 0.1 * kI].mean())
    assert np.polyfit(np.log(kIs), np.log(errors), 1)[0] == pytest.approx(-2.0, abs=0.15)


@pytest.mark.parametrize("kI", [2.0, 3.0, 4.0, 6.0])
def test_oblique_edges_are_the_half_ball_integral(kI):
    """The quantisation differs a little from angle to angle, with how the lattice lies; its mean is the constant."""
    errors, r = [], 0.1 * kI
    for degrees in (30, 45, 60, 120, 135, 150):
        beta = np.radians(degrees)
        x, S = profile(edge(kI, beta=beta))
        expected = half_ball(x, r, beta)
        errors.append(np.abs(S - expected)[(expected > 0) & (expected < 1)].mean())
    assert np.mean(errors) <= QUANTISATION / kI**2


@pytest.mark.parametrize("degrees", [30, 60, 90, 120, 150])
def test_a_penumbra_ends_where_the_half_ball_leaves_the_edge(degrees):
    """Exactly 0 and 1 outside −r..r/sin β, or its mirror image; between them no plateau reaches the ends."""
    beta, r = np.radians(degrees), 0.4
    x, S = profile(edge(4.0, beta=beta))
    dark, lit = (-r, r / np.sin(beta)) if degrees <= 90 else (-r / np.sin(beta), r)
    assert (S[x <= dark] == 0).all()
    assert (S[x >= lit] == 1).all()
    assert (x <= dark).any() and (x >= lit).any()
    middle = (half_ball(x, r, beta) > 0.05) & (half_ball(x, r, beta) < 0.95)
    assert ((S[middle] > 0) & (S[middle] < 1)).all()


def test_the_width_does_not_depend_on_h():
    """r says how wide, h how fine: the same r in four steps (Fig. 6, left) gives the same edge."""
    for h in (0.1, 0.075, 0.05, 0.0375):
        x, S = profile(edge(0.15 / h, h=h, size=0.4))
        assert (S[x <= -0.15] == 0).all() and (S[x >= 0.15] == 1).all()
        error = np.abs(S - smoothstep(x / 0.15))[np.abs(x) < 0.15].mean()
        assert error <= QUANTISATION * (h / 0.15) ** 2


@pytest.mark.parametrize("width", [0.1, 0.4, 0.8])
def test_a_strip_narrower_than_2r_never_gets_dark(width):
    x, S = profile(strip(width, kI=6.0))
    middle = np.abs(x) < 0.02
    assert S[middle].mean() == pytest.approx(strip_minimum(width, 0.6), abs=QUANTISATION / 6.0**2)


def test_area_sampling_is_the_share_of_the_disc_that_is_seen():
    """A ball of radius ρ over a straight edge half way up: the lit share of its disc, x/ρ from the edge."""
    radius, errors = 0.2, []
    for samples in (16, 64, 256, 1024):
        x, S = profile(edge(shadows="AREA_SAMPLING", light_samples=samples, light_radius=radius, size=2.6 * radius))
        assert (S[x < -1.01 * radius] == 0).all() and (S[x > 1.01 * radius] == 1).all()
        errors.append(np.sqrt(np.mean((S - disc_share(x / radius)) ** 2)))
    assert errors[-1] < 0.01
    # Independent samples would fall as n^−½.
    assert np.polyfit(np.log([16, 64, 256, 1024]), np.log(errors), 1)[0] < -0.5


def test_a_sun_of_an_angle_is_a_disc_too():
    half = 0.05
    scene = edge(shadows="AREA_SAMPLING", light_samples=512, size=2.6 * 4 * np.tan(half))
    scene = replace(scene, lights=(replace(scene.lights[0], angle=2 * half),))
    x, S = profile(scene)
    assert np.sqrt(np.mean((S - disc_share(x / (4 * np.tan(half)))) ** 2)) < 0.015
