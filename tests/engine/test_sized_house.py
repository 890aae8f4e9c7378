"""Lamps with a size in the house: kept nodes, sparse light, memory, passes, statistics, the plan."""

from dataclasses import replace

import numpy as np
import pytest
from kept import after, drawn, moved, with_camera, with_light, with_material, with_object
from light_meshes import Scene
from light_meshes.bench.targets import MAX_ADDED, RMSE_ADDED
from light_meshes.film.images import Framebuffer
from light_meshes.film.passes import DEBUG
from light_meshes.picture import measured, memory
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import draw, render_image
from light_meshes.shadows.method import Receivers
from light_meshes.shadows.ray_counts import most
from scenes import four_lights, with_lights
from sized_lamps import Seen, nodes_everywhere, rmse, scene_of  # noqa: F401


@pytest.fixture(scope="module")
def still_life() -> Scene:
    """Floor, ball and box under one lamp with a size of each type."""
    scene = four_lights(48)
    sizes = {"SUN": {"angle": 0.15}, "AREA": {}}
    return with_lights(scene, *(replace(light, softness="SIZE", **sizes.get(light.type, {"radius": 0.25}))
                                for light in scene.lights))


def test_the_same_picture_again_traces_no_node(still_life):
    kept, fresh, before, now = after(still_life, still_life)
    assert kept["long_rays"] == 0 < fresh["long_rays"] and kept["nodes_kept"] == kept["nodes"] == fresh["nodes"]
    levels = zip(before.shadowing.method.levels, now.shadowing.method.levels, strict=True)
    assert all(a.certificate is b.certificate is not None for a, b in levels)


def test_a_flight_is_made_of_the_same_pictures(still_life):
    ready = None
    for n in range(4):
        scene = with_camera(still_life, (2.5 + 0.1 * n, -4.5, 3.0 - 0.1 * n))
        kept, ready = drawn(scene, ready)
        fresh = render_image(scene)
        assert np.array_equal(kept.passes["Combined"], fresh.passes["Combined"])
        assert n == 0 or kept.statistics["long_rays"] < 0.5 * fresh.statistics["long_rays"]


@pytest.mark.parametrize("i", range(4))
def test_a_moved_lamp_drops_its_own_values_only(still_life, i):
    light = still_life.lights[i]
    change = {"direction": (0.0, 0.6, -0.8)} if light.type == "SUN" else {
        "position": tuple(np.add(light.position, (0.3, -0.2, 0.1)).tolist())}
    kept, fresh, *_ = after(still_life, with_light(still_life, i, **change))
    assert 0 < kept["long_rays"] < 0.6 * fresh["long_rays"]


@pytest.mark.parametrize("i", range(4))
def test_so_does_one_of_another_size(still_life, i):
    light = still_life.lights[i]
    change = {"SUN": {"angle": 0.1}, "AREA": {"area_u": tuple(np.multiply(light.area_u, 0.5).tolist())}}
    kept, fresh, *_ = after(still_life, with_light(still_life, i, **change.get(light.type, {"radius": 0.2})))
    assert 0 < kept["long_rays"] < 0.6 * fresh["long_rays"]


def test_lamps_may_come_go_and_change_places(still_life):
    a, b, c, d = still_life.lights
    for lights in ((d, b, a, c), (c, a)):
        kept, *_ = after(still_life, with_lights(still_life, *lights))
        assert kept["long_rays"] == 0
    kept, fresh, *_ = after(with_lights(still_life, c, a), still_life)
    assert 0 < kept["long_rays"] < fresh["long_rays"]
    many = with_lights(still_life, *still_life.lights, replace(a, name="e"), replace(b, name="f"))
    after(still_life, many)  # of so many other points count
    after(many, still_life)


@pytest.mark.parametrize("instance", range(3))
def test_a_caster_that_moves_drops_what_it_may_have_hidden_of_a_whole_lamp(still_life, instance):
    """Not only of its centre."""
    for by in ((0.05, 0.0, 0.0), (0.0, 0.0, 0.4)):
        kept, fresh, *_ = after(still_life, moved(still_life, instance, by))
        assert 0 < kept["long_rays"] <= fresh["long_rays"]


def test_a_small_caster_that_leaves_keeps_what_is_far_from_it(still_life):
    kept, fresh, *_ = after(still_life, with_object(still_life, 2, visible_shadow=False))
    assert kept["long_rays"] < fresh["long_rays"] and kept["nodes_kept"] > 0


def test_colours_and_kinds_of_lamps(still_life):
    kept, *_ = after(still_life, with_light(with_material(still_life, 0, kd=0.3), 0, intensity=(1.0, 5.0, 9.0)))
    assert kept["long_rays"] == 0
    after(still_life, with_light(still_life, 0, softness="SCENE"))
    after(with_light(still_life, 0, softness="SCENE"), still_life)
    after(still_life, with_light(still_life, 1, soft_shadows=False))


def test_statistics_when_all_lamps_have_a_size(still_life):
    found = render_image(still_life).statistics
    assert found["h"] == still_life.settings.h and found["kI"] == still_life.settings.kI
    assert found["nodes"] > 0 < found["node_bytes"] and found["long_rays"] > 0
    automatic = render_image(still_life.with_settings(auto_h=True)).statistics
    assert automatic["h"] == automatic["measured_h"] > 0


def test_the_plan_says_for_each_lamp_how_many_receivers_took_rays(still_life):
    found = render_image(still_life).statistics
    rows = [found["plan"][f"lamp '{light.name}'"] for light in still_life.lights]
    shares = [float(row.split(": ")[1].split("%")[0]) / 100 for row in rows]
    assert all(row.startswith("shares at nodes: ") and row.endswith("of its receivers took rays") for row in rows)
    assert all(0 < share < 1 for share in shares)
    assert min(shares) <= found["ray_pairs"] / found["lamp_pairs"] <= max(shares)
    many = with_lights(still_life, *(replace(light, name=f"{light.name} {n}") for light in still_life.lights
                                     for n in range(3)))
    plan = render_image(many.with_settings(h=0.3)).statistics["plan"]
    assert sum(name.startswith("lamp '") for name in plan) == 8 and "of these 4 took rays" in plan[
        "other lamps with a size"]


@pytest.mark.parametrize("i", range(4))
def test_a_lamp_smaller_than_a_pixel_is_a_point(still_life, i):
    """Its shadow is sharp, its light the same, and the plan says so; area sampling stays a reference."""
    light = still_life.lights[i]
    tiny = {"SUN": {"angle": 2e-4}, "AREA": {"area_u": (1e-4, 0.0, 0.0), "area_v": (0.0, 1e-4, 0.0)}}
    light = replace(light, **tiny.get(light.type, {"radius": 1e-4}))
    scene = with_lights(still_life, light)
    done = render_image(scene)
    sharp = render_image(scene.with_settings(shadows="SHARP"))
    assert np.array_equal(done.passes["Combined"], sharp.passes["Combined"])
    assert done.statistics["plan"]["lamps smaller than a pixel"].startswith(f"sharp: '{light.name}': one ray says all")
    assert not Prepared(scene.with_settings(shadows="AREA_SAMPLING")).measured.pinpoints
    assert not Prepared(still_life).measured.pinpoints
    near = with_lights(still_life, light, replace(still_life.lights[0], name="large"))
    assert [*Prepared(near).measured.pinpoints] == [0]


@pytest.mark.parametrize("rate", [2, 4])
@pytest.mark.parametrize("count", [1, 4])
def test_sparse_light_adds_less_than_can_be_seen(still_life, rate, count):
    """As with lights of one width: the same bounds."""
    scene = with_lights(still_life, *still_life.lights[:count])
    scene = scene.with_settings(samples=4, filter_size=1.5, h=0.04, kI=3.0)
    scene = replace(scene, camera=replace(scene.camera, width=128, height=128))
    exact, sparse = render_image(scene), render_image(scene.with_settings(shadow_rate=rate))
    difference = np.abs(exact.passes["Combined"].astype(np.float64) - sparse.passes["Combined"])
    light = Prepared(scene.with_settings(shadow_rate=rate)).sparse.light
    assert np.sqrt((difference**2).mean()) <= RMSE_ADDED * max(1, light)
    assert 0 < difference.max() <= MAX_ADDED * max(1, light)
    shares = np.array([sparse.statistics[name] for name in ("interpolated", "refined", "computed")])
    assert shares[:2].sum() > 0.4 * shares.sum()


def test_no_block_bridges_a_contact(still_life):
    """Where rays answer for a lamp, only blocks of a pixel are interpolated."""
    scene = with_lights(still_life, still_life.lights[0])
    ready, n = Prepared(scene), 64
    x = np.linspace(-2.0, 2.0, n)
    P = np.stack([*np.meshgrid(x, x), np.zeros((n, n))], -1).reshape(-1, 3)
    down = np.tile([0.0, 0.0, -1.0], (len(P), 1))
    seen = Prepared(scene).world.closest("camera", P - 5 * down, down)[1]
    narrow, active = np.zeros((len(seen.P), 1), np.uint64), np.ones((len(seen.P), 1), np.uint64)
    at = Receivers(seen.P, seen.Ng, active, seen.triangle, None, narrow)
    S = ready.shadowing.method(at, lambda: None)[:, 0, 0]
    again = ready.shadowing.method(at._replace(narrow=None), lambda: None)[:, 0, 0]
    assert np.array_equal(S, again) and 0 < (narrow > 0).sum() < len(narrow)
    assert (narrow > 0).sum() == ready.stats.counts["ray_pairs"] / 2


def test_memory_counts_shares(still_life):
    scene = replace(still_life, camera=replace(still_life.camera, width=160, height=160)).with_settings(h=0.03)
    ready, frame = Prepared(scene), Framebuffer.create(scene, ("Combined",))
    draw(ready, frame)
    part, = memory.shares(ready.scene, ready.world, ready.shadowing.method.nodes)
    held = sum(one.store.bytes for one in ready.shadowing.method.nodes)
    assert 0.3 < part.size / held < 3 and "nodes with shares of 4 lights" in part.what
    assert not memory.shares(ready.scene, ready.world, Prepared(four_lights(48)).shadowing.method.nodes)


def test_debug_passes(still_life):
    """Skipped where all lamps' nodes agree, Empty where some lamp needs rays, Candidates of the cell."""
    found = render_image(still_life, DEBUG).passes
    candidates, m, empty, skipped = (found[name][..., 0] for name in DEBUG)
    lit = candidates > 0
    assert lit.mean() > 0.3 and (skipped + empty)[lit].max() <= 1 and skipped.mean() > 0.1 < empty.mean()
    assert m.max() > 0 and m[skipped == 1].max() == 0


def test_two_points_of_quality_with_many_lamps():
    """Balanced is at least as near as 4 rays to each lamp, Fine as 16; both are the same method."""
    first = scene_of("boxes", "sphere", 56)
    places = ((1.0, 0.7, 2.5), (-0.9, 0.8, 2.2), (0.3, -1.1, 2.6), (-1.2, -0.6, 2.4), (0.1, 0.2, 2.8))
    scene = with_lights(first, *(replace(first.lights[0], name=str(n), position=at) for n, at in enumerate(places)))
    seen = Seen(scene)
    truth = seen.by("AREA_SAMPLING", 400)
    four, sixteen = (rmse(seen.by("AREA_SAMPLING", n), truth) for n in (4, 16))
    balanced, fine = (rmse(seen.by("LIGHT_MESHES", h=0.0375 / kI, kI=kI), truth) for kI in (3.0, 4.0))
    assert fine <= sixteen and fine < balanced <= 0.6 * four
    assert [most(kI, lamps)[:2] for kI, lamps in ((3.0, 5), (4.0, 5), (3.0, 4))] == [(8, 16), (16, 16), (16, 32)]


def test_rays_that_are_shared_out_are_as_near_as_four_to_each_lamp():
    """In pictures, where the method knows what each lamp gives: with few nodes, so that rays answer."""
    first = scene_of("boxes", "sphere", 48, h=0.0125, kI=3.0)
    places = ((1.0, 0.7, 2.5), (-0.9, 0.8, 2.2), (0.3, -1.1, 2.6), (-1.2, -0.6, 2.4), (3.1, 0.2, 2.8), (0.4, 4.0, 1.5))
    scene = with_lights(first, *(replace(first.lights[0], name=str(n), position=at) for n, at in enumerate(places)))
    pictures = {name: render_image(scene.with_settings(**values)) for name, values in (
        ("truth", {"shadows": "AREA_SAMPLING", "light_samples": 400}), ("fine", {"kI": 4.0}), ("balanced", {}),
        ("four", {"shadows": "AREA_SAMPLING", "light_samples": 4, "seed": 1}))}
    truth = pictures["truth"].passes["Combined"]
    error = {name: rmse(picture.passes["Combined"], truth) for name, picture in pictures.items()}
    assert error["fine"] < error["balanced"] <= error["four"]
    rays = {name: picture.statistics["shadow_rays"] for name, picture in pictures.items()}
    assert rays["balanced"] < 0.4 * rays["fine"]


@pytest.mark.parametrize("most", [False, True])
def test_many_lamps_are_measured_as_each_alone(still_life, most):
    """Blocks of lamps, and the few points that tell first which are wide, change no value."""
    lights = [replace(light, name=f"{light.name} {n}", softness="LIGHT_SIZE", **more)
              for light in still_life.lights for n, more in enumerate(
                  ({}, {"cast_shadow": False}, {"receivers": (0,)}, {"reference_distance": 2.0}))]
    world = Prepared(with_lights(still_life, *lights)).world
    together = measured._magnifications(world, [*range(len(lights))], most)
    assert together == [measured._magnifications(world, [i], most)[0] for i in range(len(lights))]
    assert len({*together}) > 4


def test_a_few_points_tell_first_which_lamps_are_wide(still_life, monkeypatch):
    small = [replace(light, **({"angle": 5e-3 * (n + 1)} if light.type == "SUN" else {"radius": 0.02 * (n + 1)}))
             for light in still_life.lights if light.type != "AREA" for n in range(6)]
    found = Prepared(with_lights(still_life, *small)).measured.pinpoints
    assert 0 < len(found) < len(small)
    monkeypatch.setattr(measured, "SPARSE", 1)
    assert Prepared(with_lights(still_life, *small)).measured.pinpoints == found
