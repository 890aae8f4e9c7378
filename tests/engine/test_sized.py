"""Lamps that light with their whole size: against sums over many small parts of the lamp (`sized_oracle`)."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from light_meshes import Scene, Shape, box, rectangle
from light_meshes.picture.render import Prepared, render_image
from light_meshes.rays.geometry import Hits
from light_meshes.scene.description import Light, Material
from light_meshes.scene.errors import SceneError
from light_meshes.scene.snapshot import read, write
from light_meshes.surface import shading
from scenes import WHITE, look_down, point, settings
from sized_oracle import all_of, matt, parts

ONE, DOWN = (1.0, 1.0, 1.0), (0.0, 0.0, -1.0)
SHINY = (5.0, 50.0, 400.0)
ROUND = {"radius": 0.5, "softness": "SIZE"}
CONE = {"direction": DOWN, "spot_angle": 1.3}
FLAT = {"direction": DOWN, "area_u": (0.5, 0.0, 0.0), "area_v": (0.0, 0.2, 0.0), "softness": "SIZE"}
LAMPS = {  # and how near receivers come to the lamp's middle
    "sphere": (Light("lamp", "POINT", ONE, **ROUND), 0.505),
    "facing disc": (Light("lamp", "POINT", ONE, facing_disc=True, **ROUND), 0.02),
    "sun": (Light("lamp", "SUN", ONE, direction=(0.6, 0.0, -0.8), angle=0.5, softness="SIZE"), 1.0),
    "spot": (Light("lamp", "SPOT", ONE, spot_blend=0.4, **ROUND, **CONE), 0.505),
    "hard spot": (Light("lamp", "SPOT", ONE, spot_blend=0.0, **ROUND, **CONE), 0.505),
    "spot, facing disc": (Light("lamp", "SPOT", ONE, spot_blend=0.4, facing_disc=True, **ROUND, **CONE), 0.1),
    "elliptic spot": (Light("lamp", "SPOT", ONE, spot_blend=0.8, **ROUND, **CONE,
                            axes=((1 / 1.7, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))), 0.505),
    "rectangle": (Light("lamp", "AREA", ONE, **FLAT), 0.02),
    "ellipse": (Light("lamp", "AREA", ONE, area_ellipse=True, **FLAT), 0.02),
    "disc": (Light("lamp", "AREA", ONE, area_ellipse=True, **FLAT | {"area_v": (0.0, 0.5, 0.0)}), 0.02),
    "rectangle of a spread": (Light("lamp", "AREA", ONE, spread=1.2, **FLAT), 0.02),
    "rectangle of a small spread": (Light("lamp", "AREA", ONE, spread=0.2, **FLAT), 0.02),
    "ellipse of a spread": (Light("lamp", "AREA", ONE, spread=1.2, area_ellipse=True, **FLAT), 0.02),
}


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def receivers(name, count, seed=7):
    """P, N and M (count,3) around the lamp at 0, from near to far: in front of lamps that have a front."""
    random = np.random.default_rng(seed)
    light, near = LAMPS[name]
    away = unit(random.normal(size=(count, 3)))
    if light.type in ("SPOT", "AREA"):
        away[:, 2] = -np.abs(away[:, 2]) - (0.5 if light.type == "SPOT" or light.spread < 2 else 0.0)
        away = unit(away)
    P = away * np.exp(random.uniform(np.log(near), np.log(20.0), count))[:, None]
    toward = np.broadcast_to(-np.array(light.direction), P.shape) if light.type == "SUN" else -away
    N = unit(toward + 0.8 * random.normal(size=P.shape))
    M = unit(toward + random.choice([0.05, 0.2, 0.6], (count, 1)) * random.normal(size=P.shape))
    below = (M * N).sum(1) < 0
    M[below] -= 2 * (M * N).sum(1, keepdims=True)[below] * N[below]
    return P, N, M, toward


def omega(light, P, N, M, n=50.0, everywhere=False):
    """Matt and glossy light (k,) of white surfaces, and whether the light counts as reaching them.

    everywhere: also where it does not.
    """
    k = len(P)
    none = np.zeros(k, np.int32)
    hits = Hits(P, N, N, np.zeros((k, 2), np.float32), none, none, np.ones(k, np.bool_), none)
    eye = 2 * (M * N).sum(1, keepdims=True) * N - M
    materials = shading.material_arrays((Material("white", Od=ONE, ks=1.0, nShiny=n),))
    lit = shading.Lit(shading.light_arrays((light,)), materials, hits, -eye, np.ones((k, 3)))
    active, colour, one, two = np.zeros((k, 1), np.uint64), *np.zeros((3, k, 3))
    shading.reaching(lit, False, active)
    reached = active[:, 0] > 0
    shading.gather(lit, (np.ones(k) if everywhere else reached).astype(np.float32)[:, None, None], colour, one, two)
    return one[:, 0], two[:, 0], reached


@cache
def summed(name):
    """The oracle's (k,) of each kind of surface: matt, and glossy with each n of SHINY."""
    P, N, M, _ = receivers(name, 40)
    rows = [all_of(LAMPS[name][0], *row, SHINY, grid=400) for row in zip(P, N, M, strict=True)]
    return dict(zip(("matt", *SHINY), np.array(rows).T, strict=True))


@cache
def measured(name, n):
    """Ours and the oracle's (k,), matt and glossy; what the whole lamp gives at most there."""
    light = LAMPS[name][0]
    P, N, M, toward = receivers(name, 40)
    ours = omega(light, P, N, M, n)
    truth = summed(name)["matt"], summed(name)[n]
    plain = replace(light, type="POINT" if light.type == "SPOT" else light.type, spread=np.pi)
    return ours, truth, omega(plain, P, np.ascontiguousarray(toward), np.ascontiguousarray(toward), n)


@pytest.mark.parametrize("name", LAMPS)
def test_matt_surfaces_get_the_sum_over_the_lamp(name):
    ours, truth, most = measured(name, 50.0)
    error = np.abs(ours[0] - truth[0]) / np.maximum(truth[0], 0.01 * most[0])
    print(f"{name}: median {np.median(error):.1e}, 99 % {np.quantile(error, 0.99):.1e}")
    assert (truth[0] > 0).mean() > 0.25
    assert np.median(error) <= 0.002 and np.quantile(error, 0.99) <= 0.02


# No receiver of these sees the sharpest highlight of the smallest spread.
HIGHLIGHTS = [(name, n) for name in LAMPS for n in SHINY
              if name != "elliptic spot" and (name, n) != ("rectangle of a small spread", 400.0)]


@pytest.mark.parametrize(("name", "n"), HIGHLIGHTS)
def test_highlights_are_the_sum_over_the_lamp(name, n):
    ours, truth, most = measured(name, n)
    error = np.abs(ours[1] - truth[1]) / np.maximum(truth[1], 0.05 * most[1])
    shining = truth[1] > 0.01 * most[1]
    assert shining.sum() > 1 and (error[~shining] < 0.05).all()
    error = error[shining]
    print(f"{name}, n = {n:g}: median {np.median(error):.1e}, 95 % {np.quantile(error, 0.95):.1e}, {len(error)}")
    assert np.median(error) <= 0.02 and np.quantile(error, 0.95) <= 0.05


@pytest.mark.parametrize("name", LAMPS)
def test_what_gets_light_is_said_to_be_reached(name):
    P, N, M, _ = receivers(name, 4000, seed=1)
    one, two, reached = omega(LAMPS[name][0], P, N, M, 20.0, everywhere=True)
    assert not ((one > 0) | (two > 0))[~reached].any()
    assert reached.mean() > 0.02
    assert np.isfinite(one).all() and np.isfinite(two).all() and (one >= 0).all() and (two >= 0).all()


@pytest.mark.parametrize("name", LAMPS)
def test_from_far_it_is_the_points_formula(name):
    light = LAMPS[name][0]
    small = replace(light, radius=1e-5, angle=1e-5, area_u=(1e-5, 0.0, 0.0), area_v=(0.0, 1e-5, 0.0))
    P, N, M, _ = receivers(name, 4000, seed=2)
    P *= np.maximum(1, 0.5 / np.linalg.norm(P, axis=1, keepdims=True))
    points = omega(replace(small, softness="SCENE"), P, N, M)
    for sized, plain in zip(omega(small, P, N, M)[:2], points[:2], strict=True):
        # Edges of a cone and of a spread are as wide as the lamp.
        error = np.abs(sized - plain) / np.maximum(plain, 0.01 * plain.max())
        assert np.quantile(error, 0.99) < 2e-3 and plain.max() > 0


def test_a_receiver_in_a_sphere_gets_light_from_everywhere():
    P, N, M, _ = receivers("sphere", 50)
    one, _, _ = omega(replace(LAMPS["sphere"][0], radius=30.0), P, N, M)
    np.testing.assert_allclose(one, 1 / 30.0**2, rtol=1e-12)


def test_lamps_of_no_size_are_points():
    P, N, M, _ = receivers("sphere", 500)
    for light in (Light("lamp", "POINT", ONE), Light("lamp", "SPOT", ONE, **CONE), Light("lamp", "SUN", ONE),
                  Light("lamp", "AREA", ONE, direction=DOWN)):
        for sized, plain in zip(omega(replace(light, softness="SIZE"), P, N, M), omega(light, P, N, M), strict=True):
            np.testing.assert_array_equal(sized, plain)


# --- Area sampling ------------------------------------------------------------------------------------------


def table(light, samples):
    """A small box over a floor, the lamp near it; seen from above, past the box."""
    shade = Shape(box((-0.2, -0.3, 0.3), (0.1, 0.2, 0.4)), WHITE, "box", flags={"visible_camera": False})
    return Scene.from_shapes([Shape(rectangle((-4, -4), (4, 4), 0.0), WHITE, "floor"), shade],
                             look_down(0, 0, 1.6, 12, height=3.0), [replace(light, position=(0.1, 0.05, 0.9))],
                             settings(shadows="AREA_SAMPLING", light_samples=samples))


def past_the_box(light, P, grid=200):
    """Σ V_j·Ω_j over the parts of the lamp, by slabs."""
    way, sent, where = parts(light, P, grid)
    with np.errstate(divide="ignore"):
        ends = np.stack([(np.array(corner) - P) / way for corner in ((-0.2, -0.3, 0.3), (0.1, 0.2, 0.4))])
    into, out = ends.min(0).max(1), ends.max(0).min(1)
    end = np.inf if light.type == "SUN" else np.linalg.norm(where - P, axis=1)
    blocked = (into < out) & (out > 0) & (into < end)
    return float((sent * ~blocked * np.maximum(way[:, 2], 0)).sum())


SHADED = {name: LAMPS[name][0] for name in ("sphere", "facing disc", "sun", "spot", "rectangle", "disc",
                                           "rectangle of a spread")}


@pytest.mark.parametrize("name", SHADED)
def test_area_sampling_converges_to_the_lamp_past_its_blockers(name):
    scene = table(SHADED[name], 16)
    light, left, right = scene.lights[0], *scene.camera.window[:2]
    x = left + (right - left) * (np.arange(12) + 0.5) / 12
    truth = np.array([[past_the_box(light, np.array([a, b, 0.0])) for a in x] for b in x])
    full = max(matt(light, np.array([a, b, 0.0]), np.array([0, 0, 1.0]), 100) for a in x for b in x)
    errors = []
    for samples in (16, 256):
        picture = render_image(scene.with_settings(light_samples=samples)).passes["Combined"][..., 0].astype(float)
        errors.append(np.sqrt(np.mean((picture - truth) ** 2)) / full)
    print(name, errors)
    assert errors[1] < 0.01 and errors[1] < 0.5 * errors[0]


def test_the_same_samples_at_any_size_of_batch():
    scene = table(SHADED["rectangle"], 8)
    ready = Prepared(scene)
    P = np.random.default_rng(3).uniform(-0.8, 0.8, (200, 3)) * [1, 1, 0]
    N = np.tile([0.0, 0.0, 1.0], (200, 1))
    whole = ready.lighting.light_visibility(P, N)
    pieces = np.concatenate([ready.lighting.light_visibility(P[i:i + 7], N[i:i + 7]) for i in range(0, 200, 7)])
    np.testing.assert_array_equal(whole, pieces)
    assert ((whole > 0) & (whole < 1)).any()


def test_a_snapshot_keeps_that_a_lamp_is_a_facing_disc(tmp_path):
    scene = table(SHADED["facing disc"], 1)
    write(scene, tmp_path)
    assert read(tmp_path).lights[0] == scene.lights[0] and scene.lights[0].facing_disc
    text = (tmp_path / "scene.json").read_text()
    (tmp_path / "scene.json").write_text(text.replace('"facing_disc": true', '"facing_disc": 1'))
    with pytest.raises(SceneError, match="facing_disc is 1; it must be true or false"):
        read(tmp_path)


def test_a_lamp_that_is_not_sized_is_what_it_was():
    lamp = point((0.1, 0.2, 0.9), radius=0.3)
    scene = table(lamp, 16)
    other = replace(scene, lights=(replace(scene.lights[0], facing_disc=True),))
    np.testing.assert_array_equal(render_image(scene).passes["Combined"], render_image(other).passes["Combined"])


def test_spots_reach_no_fewer_receivers_side_by_side():
    """Cones pass blocks of receivers by, and receivers in them, only where each alone is not reached either."""
    random = np.random.default_rng(11)
    reached = 0
    for n in range(60):
        angle, radius = random.uniform(0.05, 3.0), random.choice([0.01, 0.3])
        light = Light("lamp", "SPOT", ONE, direction=tuple(unit(random.normal(size=3)).tolist()), spot_angle=angle,
                      radius=radius, facing_disc=bool(n % 2), softness="SIZE", spot_blend=0.5)
        P = random.normal(size=3) * 2 + random.choice([0.01, 0.5]) * random.normal(size=(64, 3))
        N = unit(-P + random.normal(size=P.shape))
        found = omega(light, P, N, N)[2]
        far = np.linalg.norm(P, axis=1)
        off = np.arccos(np.clip((P / far[:, None]) @ np.array(light.direction), -1, 1))
        off = off - np.where(far > radius, np.arcsin(np.minimum(radius / far, 1)), np.pi)
        assert (found == ((off < angle / 2) & (-(P * N).sum(1) + radius > 0)))[np.abs(off - angle / 2) > 1e-6].all()
        reached += found.sum()
    assert 500 < reached < 3000
