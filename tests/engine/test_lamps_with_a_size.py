"""Lamps with a size (softness SIZE): S is near that of very many rays, and right where the answer is known."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Light
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import render_image
from scenes import (
    all_lights,
    combined,
    edge,
    four_lights,
    light_leak,
    tabletop,
    wall,
    with_lights,
    with_objects,
)
from sized_lamps import Seen, nodes_everywhere, one_width, rmse, scene_of  # noqa: F401

QUICK = [("posts", "sphere"), ("boxes", "sun"), ("board", "rectangle"), ("ball", "disc")]


def check_near(name, lamp, pixels=100):
    """S is nearer to the truth than that of 16 rays, and at least twice as near as with one width."""
    seen = Seen(scene_of(name, lamp, pixels, h=0.0125))
    truth = seen.by("AREA_SAMPLING", 1024)
    sixteen, found = (rmse(S, truth) for S in (seen.by("AREA_SAMPLING", 16), seen.by("LIGHT_MESHES")))
    assert 0 < found <= sixteen
    assert found <= 0.5 * rmse(one_width(seen), truth)


@pytest.mark.parametrize(("name", "lamp"), QUICK)
def test_nearer_than_sixteen_rays(name, lamp):
    check_near(name, lamp)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "lamp"), [("thin posts", "rectangle"), ("tabletop", "spot"), ("plant", "sphere"),
                                            ("curved", "disc")])
def test_nearer_than_sixteen_rays_in_more_scenes(name, lamp):
    """`python tests/support/sized_lamps.py` shows all scenes under all lamps."""
    check_near(name, lamp, 64)


def widths(seen, S):
    """10–90 % widths of the shadow of the board's edge, at five places from its foot up."""
    lamp, found = np.array(seen.ready.scene.lights[0].position), []
    for s in (0.05, 0.2, 0.35, 0.5, 0.65):
        ends = [np.array([-0.8 + 1.4 * t, -0.3, 1.2 * t]) for t in (s, s + 0.01)]
        on, beyond = ((lamp + (p - lamp) * lamp[2] / (lamp[2] - p[2]))[:2] for p in ends)
        along = (beyond - on) / np.linalg.norm(beyond - on)
        d = seen.P[:, :2] - on
        x = d @ (along[1], -along[0])  # positive away from the board's shadow
        near = (np.abs(d @ along) < 0.015) & (np.abs(x) < 0.3)
        order = np.argsort(x[near])
        profile = np.maximum.accumulate(np.convolve(S[near][order], np.ones(5) / 5, "valid"))
        low, high = np.interp([0.1, 0.9], profile, x[near][order][2:-2])
        found.append(high - low)
    return np.array(found)


def test_a_leaning_boards_penumbra_has_the_width_of_the_truth():
    """Within 15 % or a pixel, from the foot, where it touches the floor, to the top."""
    pixels = 200
    seen = Seen(scene_of("board", "sphere", pixels, h=0.0125))
    true, found = (widths(seen, seen.by(*way)[:, 0]) for way in (("AREA_SAMPLING", 400), ("LIGHT_MESHES",)))
    assert (np.diff(true) > 0).all() and true[-1] > 8 * true[0]
    assert (np.abs(found - true) <= np.maximum(0.15 * true, 2 / pixels)).all(), (found, true)


def disc_over_edge(beta, radius=0.4, **values):
    """The edge of H12 under a level disc: the penumbra's half width is the disc's radius, whatever β."""
    scene = edge(beta=beta, light_radius=1.0, pixels=100, size=3 * radius, **values)
    lamp = Light("disc", "AREA", (1.0,) * 3, position=scene.lights[0].position, direction=(0.0, 0.0, -1.0),
                 area_u=(radius, 0.0, 0.0), area_v=(0.0, radius, 0.0), area_ellipse=True, softness="SIZE")
    return with_lights(scene, lamp)


@pytest.mark.parametrize("kI", [2.0, 3.0])
@pytest.mark.parametrize("degrees", [90, 45, 25, 15])
def test_a_straight_edge_has_the_profile_of_a_disc(degrees, kI):
    """The profile: the mean along the edge. Single points: half as far off as with 16 rays, where nodes answer."""
    radius, pixels = 0.4, 100
    seen = Seen(disc_over_edge(np.radians(degrees), radius, h=0.05, kI=kI))
    S, x = np.full(pixels**2, np.nan), np.zeros(pixels**2)
    S[seen.pixel], x[seen.pixel] = seen.by("LIGHT_MESHES")[:, 0], seen.P[:, 0]
    u = np.clip(x.reshape(pixels, pixels)[0] / radius, -1, 1)
    exact = 0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / np.pi
    S = S.reshape(pixels, pixels)
    assert np.isfinite(S).all() and rmse(S.mean(0), exact) <= (0.012 if degrees == 15 and kI == 2 else 0.01)
    middle = np.abs(u) < 0.3
    slope, at = np.polyfit(u[middle], S.mean(0)[middle] - 0.5, 1)
    assert abs(at / slope) <= 0.05  # of half the width: where S is ½
    if degrees > 20:  # else the lattice has too few nodes that do not slide too far, and points are those of rays
        assert rmse(S, exact) <= (0.015 if kI > 2 else 0.023)  # 16 rays: .030


def test_no_seams():
    """From pixel to pixel S jumps by no more than the truth and 1/64, along a penumbra that grows across four levels.

    Where it is narrower than the finest r there are rays, which have grain: there the bound does not hold.
    """
    seen = Seen(scene_of("board", "sphere", 128, h=0.0125, kI=3.0))
    values = seen.by("LIGHT_MESHES")[:, 0], seen.by("AREA_SAMPLING", 1024)[:, 0], seen.P[:, 0] > 0
    S, truth, wide = np.full((3, 128 * 128), np.nan)
    S[seen.pixel], truth[seen.pixel], wide[seen.pixel] = values
    S, truth, wide = (a.reshape(128, 128) for a in (S, truth, wide))
    for axis in (0, 1):
        step, true = np.abs(np.diff(S, axis=axis)), np.abs(np.diff(truth, axis=axis))
        excess = (step - true)[(np.minimum(*(np.take(wide, range(k, 127 + k), axis) for k in (0, 1))) > 0)]
        assert len(excess) > 3000 and np.nanmax(excess) <= 1 / 64 + 4 / 1024**0.5 / 4  # and the truth's own noise


def test_finer_is_nearer():
    """RMSE falls with the step, and with kI, which is how many nodes are averaged."""
    def error(h, kI):
        seen = Seen(disc_over_edge(np.pi / 2, 0.4, h=h, kI=kI))
        u = np.clip(seen.P[:, 0] / 0.4, -1, 1)
        return rmse(seen.by("LIGHT_MESHES")[:, 0], 0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / np.pi)

    steps = [error(h, 2.0) for h in (0.2, 0.1, 0.05)]
    assert steps[0] > 1.3 * steps[1] > 1.3**2 * steps[2]
    nodes = [error(0.05, kI) for kI in (1.5, 2.0, 3.0)]
    assert nodes == sorted(nodes, reverse=True)


@pytest.mark.parametrize("kind", ["POINT", "SPOT", "AREA", "SUN"])
def test_without_a_size_shadows_are_sharp(kind):
    light = next(light for light in four_lights().lights if light.type == kind)
    light = replace(light, radius=0.0, angle=0.0, area_u=(0.0,) * 3, area_v=(0.0,) * 3, softness="SIZE")
    scene = with_lights(four_lights(48), light)
    assert np.array_equal(combined(scene), combined(scene.with_settings(shadows="SHARP")))


def test_a_vanishing_size_tends_to_sharp_shadows():
    scene = all_lights(tabletop(64), softness="SIZE", radius=1e-6)
    sharp = combined(scene.with_settings(shadows="SHARP"))
    assert np.mean(combined(scene) != sharp) < 1e-3


def test_tiles_and_threads_do_not_matter():
    scene = all_lights(tabletop(48, h=0.05, kI=2.0), softness="SIZE", radius=0.3)
    whole = render_image(scene, threads=1, tile_size=64).passes["Combined"]
    assert np.array_equal(whole, render_image(scene, threads=2, tile_size=7).passes["Combined"])


def test_other_lights_keep_their_bits():
    """A lamp of one width has the same S beside a lamp with a size, and that has the same alone."""
    scene = four_lights(48)
    sized = replace(scene.lights[0], softness="SIZE")
    both, one, other = (Seen(with_lights(scene, *lights)).by("LIGHT_MESHES") for lights in (
        (sized, scene.lights[2]), (scene.lights[2],), (sized,)))
    assert np.array_equal(both[:, 1], one[:, 0]) and np.array_equal(both[:, 0], other[:, 0])
    assert ((both > 0.05) & (both < 0.95)).any(0).all()


@pytest.mark.parametrize("radius", [0.01, 0.3])
def test_no_light_leaks_through_a_wall(radius):
    """H1: the floor behind the wall gets nothing of the lamp."""
    scene = all_lights(wall(), softness="SIZE", radius=radius)
    behind = combined(scene)[:, 34:].max()  # pixels right of the wall
    assert behind == 0 and combined(scene).max() > 0


def test_no_light_leaks_through_a_plate():
    """S2: the low lamp, as small as it is in truth, lights nothing that no point of it sees."""
    scene = all_lights(light_leak(64, h=0.1, kI=2.0), softness="SIZE", radius=0.05)
    seen = Seen(scene)
    truth, found = seen.by("AREA_SAMPLING", 1024), seen.by("LIGHT_MESHES")
    assert found[truth == 0].max() == 0 and (truth == 0).sum() > 100


SUNK = {"sphere": {"position": (3.0, 0.0, 0.05)}, "sun": {"direction": (-1.0, 0.0, -0.05)},
        "rectangle": {"position": (3.0, 0.0, 0.05), "direction": (-1.0, 0.0, 0.0), "area_u": (0.0, 0.0, 0.3)}}


@pytest.mark.parametrize("lamp", SUNK)
def test_the_horizon_is_no_shadow(lamp):
    """Where the floor cuts the lamp, and nothing else is in the way, all is seen that Ω counts."""
    scene = scene_of("posts", lamp, 48)
    scene = with_objects(scene, **{o.name: {"visible_shadow": False} for o in scene.objects if o.name != "floor"})
    seen = Seen(with_lights(scene, replace(scene.lights[0], **SUNK[lamp])))
    S = seen.by("LIGHT_MESHES")
    assert len(S) > 1000 and (S == 1).all()


def test_sharp_casters_shadow_sharply():
    """V of sharp casters times S of the others; and receivers that take no soft shadows have sharp ones."""
    scene = all_lights(tabletop(64, h=0.05, kI=2.0), softness="SIZE", radius=0.3)
    seen = Seen(with_objects(scene, bar={"cast_soft_shadows": False}))
    bar, cylinder = (Seen(with_objects(scene, **{other: {"visible_shadow": False}})) for other in ("cylinder", "bar"))
    product, top = bar.by("SHARP") * cylinder.by("LIGHT_MESHES"), seen.at.N[:, 2] > 0.5
    assert rmse(seen.by("LIGHT_MESHES")[top], product[top]) < 0.01
    hard = Seen(with_objects(scene, tabletop={"receive_soft_shadows": False}))
    assert np.array_equal(hard.by("LIGHT_MESHES"), hard.by("SHARP"))


def test_blockers_of_a_lamp():
    """A lamp that only some objects shadow."""
    scene = all_lights(tabletop(64, h=0.05, kI=2.0), softness="SIZE", radius=0.3)
    without = Seen(with_objects(scene, bar={"visible_shadow": False}))
    linked = Seen(all_lights(scene, blockers=(0, 1)))
    assert rmse(linked.by("LIGHT_MESHES"), without.by("LIGHT_MESHES")) < 0.01
    assert rmse(linked.by("LIGHT_MESHES"), Seen(scene).by("LIGHT_MESHES")) > 0.02


def test_through_glass_every_ray_counts_what_it_passes():
    """Where surfaces let light through S is by rays: what 1,024 of them say, as near as 16 do."""
    scene = all_lights(tabletop(64, h=0.05, kI=2.0), softness="SIZE", radius=0.3)
    clear = tuple(replace(m, kt=(0.5, 0.4, 0.3)) if m.name == "bar" else m for m in scene.materials)
    seen = Seen(replace(scene, materials=clear))

    def mean(way, samples):
        ready = Prepared(seen.ready.scene.with_settings(shadows=way, light_samples=samples))
        return ready.shadowing.method(seen.at, lambda: None).astype(float)

    truth = mean("AREA_SAMPLING", 1024)
    assert truth.shape[2] == 3 and (np.ptp(truth[:, 0], axis=1) > 0.01).any()
    assert rmse(mean("LIGHT_MESHES", 1), truth) <= rmse(mean("AREA_SAMPLING", 16), truth)


def test_the_plan_says_how_each_lamp_gets_its_shadow():
    lights = (replace(four_lights().lights[0], softness="SIZE", name="lamp"),
              replace(four_lights().lights[1], softness="SIZE", angle=0.0, name="dot"))
    done = render_image(with_lights(four_lights(48), *lights).with_settings(shadow_rate=2))
    reasons = done.statistics["plan"]
    assert reasons["lamps with a size"].startswith("shares at nodes: 'lamp': 4 lattices, of h = 0.08 to 0.64")
    assert reasons["lamps without a size"].startswith("sharp: 'dot'")
    assert reasons["shadow rate"].startswith("2: ")
    counts = [done.statistics[name] for name in ("lamp_pairs", "mixed_pairs", "ray_pairs")]
    assert counts[0] > counts[1] >= counts[2] > 0
