"""Highlights of GGX: the formula, the energy, and that nothing else notices. Beside Cycles: tests/peers/test_ggx.py."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Light, Scene, Shape, rectangle
from light_meshes.bench.targets import MAX_ADDED, RMSE_ADDED
from light_meshes.picture.render import render_image
from light_meshes.scene.description import Material
from light_meshes.scene.errors import SceneError
from light_meshes.scene.programs import program
from light_meshes.scene.snapshot import read, write
from light_meshes.surface.shading import _facet_tables
from scenes import four_lights, settings, sun
from test_shadow_rate import FINE, error

SUNS = 3000
WHITE = (1.0, 1.0, 1.0)


def metal(**values):
    return replace(Material("metal", Od=(0, 0, 0), kd=0.0, highlight="GGX", metal=1.0), **values)


def plastic(**values):
    return replace(Material("plastic", Od=WHITE, highlight="GGX", dielectric=1.0, layered=1.0), **values)


def directions(count=SUNS):
    """Unit vectors all over the upper hemisphere, each for the same part of it."""
    z = (np.arange(count) + 0.5) / count
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], 1)


def seen(material, cosine, lights):
    """The radiance of a floor to an eye at this cosine, which sees one point of it."""
    eye = 1e4 * np.array([np.sqrt(1 - cosine * cosine), 0.0, cosine])
    scene = Scene.from_shapes([Shape(rectangle((-10, -10), (10, 10), 0.0), material, "floor")],
                              Camera.look_at(tuple(eye), (0, 0, 0), 1e-3, 1, 1), lights, settings(mode="LOCAL"))
    return render_image(scene).passes["Combined"][0, 0, :3].astype(float)


def all_around():
    """Suns in a white sky of radiance 1."""
    return [sun(-d, 2 / SUNS) for d in directions()]


def shading(material, cosine, L):
    """π times what the formula gives of light from each L (n,3), without what is reflected several times, (n,3)."""
    V = np.array([np.sqrt(1 - cosine * cosine), 0.0, cosine])
    H = (L + V) / np.linalg.norm(L + V, axis=1, keepdims=True)
    a = max(material.roughness, 0.1) ** 4
    tan2 = [1 / x**2 - 1 for x in (L[:, 2], cosine)]
    G = 2 / sum(np.sqrt(1 + a * t) for t in tan2)
    D = a / (np.pi * (H[:, 2] ** 2 * (a - 1) + 1) ** 2)
    c = (H @ V)[:, None]
    F0, F90, n, tint = (np.array(x, float) for x in (
        material.F0, material.F90, material.dielectric_ior, material.dielectric_tint))
    at_82 = F0 + (F90 - F0) * (6 / 7) ** 5
    F = F0 + (F90 - F0) * (1 - c) ** 5 - at_82 * (1 - np.array(material.F82)) * c * (1 - c) ** 6 / (6 / 7) ** 6 * 7
    sine = np.sqrt(1 - (1 - c * c) / n**2 + 0j)  # of the refracted ray's angle to the surface; imaginary: none
    parallel, across = (n * c - sine) / (n * c + sine), (c - n * sine) / (c + n * sine)
    real, normal = (abs(parallel) ** 2 + abs(across) ** 2) / 2, ((n - 1) / (n + 1)) ** 2
    f0 = np.minimum(normal * tint, 1)
    F_dielectric = f0 + (1 - f0) * np.clip((real - normal) / (1 - normal), 0, 1)
    F = material.metal * np.maximum(F, 0) + material.dielectric * F_dielectric
    return np.pi * (D * G / (4 * cosine))[:, None] * F


CASES = [
    metal(roughness=0.05, F0=(0.9, 0.5, 0.1)), metal(roughness=0.1, F0=(0.9, 0.5, 0.1)), metal(roughness=0.5),
    metal(roughness=1.0, F0=(0.2, 0.3, 0.4), F90=(0.2, 0.3, 0.4)), metal(roughness=0.3, F82=(0.0, 0.5, 0.9)),
    plastic(kd=0.0, roughness=0.4), plastic(kd=0.0, roughness=0.6, dielectric_ior=0.6),
    plastic(kd=0.0, roughness=0.2, dielectric_ior=2.5, dielectric_tint=(0.3, 1.0, 2.0)),
    plastic(kd=0.0, roughness=0.7, metal=0.4, dielectric=0.6, F0=(0.9, 0.6, 0.2)),
]


@pytest.mark.parametrize("case", range(len(CASES)))
@pytest.mark.parametrize("cosine", [0.05, 0.4, 0.99])
def test_single_lamps_follow_the_formula(case, cosine):
    material = replace(CASES[case], compensation=0.0)
    for L in directions(7):
        expected = 0.5 * shading(material, cosine, L[None])[0]
        np.testing.assert_allclose(seen(material, cosine, [sun(-L, 0.5)]), expected, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("roughness", [0.4, 0.7, 1.0])
@pytest.mark.parametrize("cosine", [0.3, 0.6, 1.0])
def test_all_light_comes_back_from_a_white_metal(roughness, cosine):
    """In a white sky it is invisible; without the light that is reflected several times it is dark."""
    whole, single = (seen(metal(roughness=roughness, compensation=share), cosine, all_around()) for share in (1.0, 0.0))
    assert whole == pytest.approx(1.0, abs=0.01)
    expected = 2 / SUNS * shading(metal(roughness=roughness), cosine, directions()).sum(0)
    assert single == pytest.approx(expected, rel=1e-4) and (single < 0.99).all()


@pytest.mark.parametrize(("roughness", "ior"), [(0.4, 1.5), (0.8, 1.5), (0.6, 2.5), (1.0, 1.2)])
@pytest.mark.parametrize("cosine", [0.25, 0.7, 1.0])
def test_a_white_plastic_reflects_all_or_a_little_less(roughness, ior, cosine):
    light = seen(plastic(roughness=roughness, dielectric_ior=ior), cosine, all_around())
    assert light == pytest.approx(1.0, abs=0.015)
    bare = seen(plastic(roughness=roughness, dielectric_ior=ior, layered=0.0), cosine, all_around())
    expected = 2 / SUNS * shading(plastic(roughness=roughness, dielectric_ior=ior), cosine, directions()).sum(0)
    assert bare == pytest.approx(1 + expected, abs=0.02) and (bare > light).all()


def test_a_coat_is_a_dielectric_above_all_else():
    """The light of a coated surface is that of the coat alone, and what gets past it of the light of the bare one."""
    lamps = [sun(-d, 0.5) for d in directions(5)]
    base = metal(roughness=0.5, metal=0.5, F0=(0.9, 0.5, 0.1), Od=(0.2, 0.4, 0.6), kd=0.5)
    coated = replace(base, coat=1.0, coat_roughness=0.3, coat_ior=1.6)
    alone = plastic(kd=0.0, roughness=0.3, dielectric_ior=1.6)
    below = replace(alone, kd=1.0)  # white, dimmed by the coat
    for cosine in (0.1, 0.5, 0.95):
        light = {m: seen(m, cosine, lamps) for m in (base, coated, alone, below)}
        left = (light[below] - light[alone]) / (0.5 * directions(5)[:, 2].sum())
        assert light[coated] == pytest.approx(light[alone] + left * light[base], rel=1e-5)
        assert (left < 0.97).all()
        # Beer's law along the way in the coat.
        tinted = seen(replace(coated, coat_tint=(0.5, 1.0, 0.25)), cosine, lamps)
        way = 1 / np.sqrt(1 - (1 - cosine**2) / 1.6**2)
        expected = light[alone] + left * light[base] * np.array([0.5, 1.0, 0.25]) ** way
        assert tinted == pytest.approx(expected, rel=1e-5)


def test_half_of_the_diffuse_light_may_lie_bare():
    lamps = [replace(sun((0.3, 0.2, -1.0), 1.0), glossy=False)]
    under, bare, half = (seen(plastic(layered=share), 0.5, lamps) for share in (1.0, 0.0, 0.5))
    assert half == pytest.approx((under + bare) / 2, rel=1e-6) and (under < 0.97 * bare).all()


def test_the_tables_are_integrals():
    """E and the mean share of Fresnel's term, against sums over lights and over facets by other formulas."""
    E = _facet_tables()[:1024].reshape(32, 32)
    L = directions(400_000)
    for r, c in ((12, 8), (20, 31), (31, 2), (31, 31)):
        white = replace(metal(), roughness=r / 31)
        brute = 2 * shading(white, c / 31, L)[:, 0].mean()
        assert E[r, c] == pytest.approx(brute, abs=2e-3)
    means = _facet_tables()[1024:1056]
    mu = np.linspace(0, 1, 32)
    of_one = (mu[1:] * E[-1, 1:] + mu[:-1] * E[-1, :-1]).sum() / 31
    assert means[[0, -1]] == pytest.approx([1.0, of_one], abs=2e-3)


def test_lamps_with_neither_reach_nothing():
    lamp = sun((0, 0, -1.0), 1.0)
    nothing = metal(F0=(0, 0, 0), F90=(0, 0, 0))
    assert (seen(nothing, 0.7, [lamp]) == 0).all()
    assert (seen(metal(), 0.7, [replace(lamp, glossy=False)]) == 0).all()
    assert (seen(metal(), 0.7, [Light("off", "SUN", (0.0, 0.0, 0.0))]) == 0).all()


@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
def test_phongs_surfaces_keep_their_bits(shadows):
    scene = four_lights(96, shadows=shadows)
    box = replace(scene.materials[2], highlight="GGX", metal=1.0, kd=0.0)
    other = replace(scene, materials=(*scene.materials[:2], box))
    plain, changed = render_image(scene), render_image(other)
    a, b = plain.passes["Combined"], changed.passes["Combined"]
    same = (a == b).all(-1)
    assert 0.5 < same.mean() < 0.99  # all but the box


def test_sparse_light_of_shiny_surfaces():
    scene = four_lights(160, **FINE)
    floor, ball, box = scene.materials
    scene = replace(scene, materials=(replace(floor, highlight="GGX", roughness=0.7, dielectric=1.0, layered=1.0),
                                      replace(ball, highlight="GGX", roughness=0.4, metal=1.0, kd=0.0), box))
    difference, statistics = error(scene)
    assert np.sqrt((difference**2).mean()) <= RMSE_ADDED and difference.max() <= MAX_ADDED
    computed = statistics["computed"] / sum(statistics[name] for name in ("interpolated", "refined", "computed"))
    assert 0 < computed < 0.5


def test_a_program_sets_what_the_material_says_itself():
    plain = metal(roughness=0.3, F0=(0.9, 0.5, 0.1))
    says = {"operations": [["add", 0.1, 0.2]], "values": {"roughness": [0], "F0": [0.9, 0.5, 0.1]}}
    computed = metal(roughness=1.0, program=program(says, "material"))
    lamps = [sun((0.3, 0.2, -1.0), 1.0)]
    assert seen(computed, 0.8, lamps) == pytest.approx(seen(plain, 0.8, lamps), rel=1e-12)


@pytest.mark.parametrize(("values", "word"), [
    ({"highlight": "BLINN"}, "choose one of PHONG, GGX"), ({"roughness": 1.5}, "roughness is 1.5"),
    ({"F0": (2.0, 0.0, 0.0)}, "F0 is 2"), ({"metal": -1.0}, "metal is -1")])
def test_what_is_wrong_is_said(tmp_path, values, word):
    scene = four_lights(16)
    write(replace(scene, materials=(metal(**values), *scene.materials[1:])), tmp_path)
    with pytest.raises(SceneError, match=word):
        read(tmp_path)
