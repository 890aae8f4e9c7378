"""Highlights of microfacets from lamps that light with their whole size: against sums over many parts of the lamp."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes.rays.geometry import Hits
from light_meshes.surface import shading
from light_meshes.surface.shading import _facet_tables
from sized_oracle import parts
from test_facets import metal, plastic
from test_facets import shading as formula
from test_sized import LAMPS, ONE, receivers, unit

MATERIALS = {
    "polished": metal(roughness=0.2, F0=(0.9, 0.5, 0.1)), "brushed": metal(roughness=0.3),
    "plastic": plastic(kd=0.0, roughness=0.5), "rough": metal(roughness=1.0, F0=(0.2, 0.3, 0.4)),
}

def highlight(light, material, P, N, M, everywhere=False):
    """What surfaces return to eyes that are mirrored to M (k,3), over I."""
    k, none = len(P), np.zeros(len(P), np.int32)
    hits = Hits(P, N, N, np.zeros((k, 2), np.float32), none, none, np.ones(k, np.bool_), none)
    eye = 2 * (M * N).sum(1, keepdims=True) * N - M
    lit = shading.Lit(shading.light_arrays((light,)), shading.material_arrays((replace(material, compensation=0.0),)),
                      hits, -eye, np.ones((k, 3)))
    active, colour = np.zeros((k, 1), np.uint64), np.zeros((k, 3))
    shading.reaching(lit, False, active)
    seen = np.ones(k) if everywhere else (active[:, 0] > 0)
    shading.gather(lit, seen.astype(np.float32)[:, None, None], colour)
    return colour


def truth(light, P, N, M, grid=320):
    """The same of one receiver (3,), of all MATERIALS (m,3), as a sum over grid² parts."""
    way, sent, _ = parts(light, P, grid)
    V = 2 * (M @ N) * N - M
    x = unit(V - (V @ N) * N + 1e-12 * np.cross(N, [0.3, 0.5, 0.8]))
    L = way @ np.stack([x, np.cross(N, x), N], 1)
    up = (L[:, 2] > 1e-9) & (sent > 0)
    return [(sent[up, None] * formula(material, V @ N, L[up])).sum(0) for material in MATERIALS.values()]


def peak_of(light, material, P):
    """The highlight's most at each receiver: it faces the lamp, and so does the eye."""
    plain = replace(light, type="POINT" if light.type == "SPOT" else light.type, spread=np.pi)
    toward = -np.broadcast_to(light.direction, P.shape) if light.type == "SUN" else unit(-P)
    toward = np.ascontiguousarray(toward)
    return highlight(plain, material, P, toward, toward, True).max(1)


@pytest.mark.parametrize("name", LAMPS)
def test_highlights_are_the_sum_over_the_lamp(name):
    """Median 1 %, 95 % 7 % (most lamps 3 %) of what is more than a hundredth of the highlight's peak, from touching to far."""
    light = LAMPS[name][0]
    P, N, M, _ = receivers(name, 10, seed=11)
    exact = np.array([truth(light, *row) for row in zip(P, N, M, strict=True)])
    found, shining = [], 0
    for of, sums in zip(MATERIALS.values(), exact.transpose(1, 0, 2), strict=True):
        peak = peak_of(light, of, P)
        error = np.abs(highlight(light, of, P, N, M) - sums).max(1) / np.maximum(sums.max(1), 0.05 * peak)
        bright = sums.max(1) > 0.01 * peak
        assert (error[~bright] < 0.05).all()
        found.append(error[bright])
    error = np.concatenate(found)
    print(f"{name}: median {np.median(error):.1e}, 95 % {np.quantile(error, 0.95):.1e}, {len(error)} of 40")
    assert len(error) > 10
    assert np.median(error) <= 0.012 and np.quantile(error, 0.95) <= 0.07


@pytest.mark.parametrize("name", LAMPS)
def test_from_far_it_is_the_points_highlight(name):
    light = LAMPS[name][0]
    small = replace(light, radius=1e-5, angle=1e-5, area_u=(1e-5, 0.0, 0.0), area_v=(0.0, 1e-5, 0.0))
    P, N, M, _ = receivers(name, 2000, seed=2)
    P *= np.maximum(1, 0.5 / np.linalg.norm(P, axis=1, keepdims=True))
    sized, plain = (highlight(lamp, MATERIALS["polished"], P, N, M).max(1)
                    for lamp in (small, replace(small, softness="SCENE")))
    error = np.abs(sized - plain) / np.maximum(plain, 0.01 * plain.max())
    assert np.quantile(error, 0.99) < 2e-3 and plain.max() > 0


def test_all_of_the_sky_reflects_what_the_surface_does():
    """In a sphere that shines everywhere the highlight is the energy that microfacets reflect: the table of it."""
    light = replace(LAMPS["sphere"][0], radius=30.0)
    P, N, _, _ = receivers("sphere", 30)
    for row, roughness in ((4, 4 / 31), (16, 16 / 31), (31, 1.0)):
        found = highlight(light, metal(roughness=roughness), P, N, N.copy()) * 30.0**2  # looked at from above
        np.testing.assert_allclose(found, _facet_tables()[32 * row + 31], rtol=0.03)
