"""What the artist controls (method §4): which lights, casters and receivers are soft, each light's radius and links."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Scene, Shape, box, rectangle, sphere, translate
from light_meshes.picture.render import Prepared, render_image
from light_meshes.scene.description import SHADOWS, WEIGHTS, Material
from light_meshes.scene.errors import SceneError
from oracle import Oracle
from scenes import (
    GREY,
    WHITE,
    all_lights,
    all_materials,
    all_objects,
    combined,
    four_lights,
    hall,
    look_down,
    point,
    settings,
    sun,
    tabletop,
    with_lights,
    with_objects,
)
from test_same_picture import same_bits
from test_semitransparent import glass, still_life

FLOOR, BALL, BOX = range(3)  # objects of four_lights
UP = np.array([[0.0, 0.0, 1.0]])
ALONE = {"world_color": (0.0, 0.0, 0.0)}  # no ambient light: pictures of single lights add up


# --- The paper's claims: lights -------------------------------------------------------------------------------

def test_switching_one_light_changes_only_that_lights_penumbrae():
    scene = replace(four_lights(80), **ALONE)
    P, N, triangle = Oracle(scene).places(4000, 0)
    soft = Prepared(scene).light_visibility(P, N, triangle)
    for n, light in enumerate(scene.lights):
        lights = list(scene.lights)
        lights[n] = replace(light, soft_shadows=False)
        switched = with_lights(scene, *lights)
        S = Prepared(switched).light_visibility(P, N, triangle)
        others = np.arange(len(lights)) != n
        np.testing.assert_array_equal(S[:, others], soft[:, others])
        assert set(np.unique(S[:, n])) == {0, 1} and len(np.unique(soft[:, n])) > 10
        alone = [combined(with_lights(scene, one)) for one in (light, lights[n])]
        np.testing.assert_allclose(combined(switched) - combined(scene), alone[1] - alone[0], rtol=0, atol=1e-6)


@pytest.mark.parametrize("weights", WEIGHTS)
def test_a_lights_radius_is_its_own(weights):
    """The picture of lights of four radii is the sum of pictures of one light each, whose kI says the radius."""
    scene = replace(four_lights(64, weights=weights), **ALONE)
    steps = (2.0, 3.0, 1.25, 4.5)
    lights = [replace(light, softness="RADIUS", soft_radius=0.08 * n)
              for light, n in zip(scene.lights, steps, strict=True)]
    lights[1] = replace(lights[1], softness="SCENE")
    apart = sum(combined(with_lights(scene, light).with_settings(kI=n))
                for light, n in zip(scene.lights, steps, strict=True))
    np.testing.assert_allclose(combined(with_lights(scene, *lights)), apart, rtol=1e-5, atol=1e-6)


def test_one_lattice_serves_all_radii():
    """A light's column is the same whatever its radius: nodes in both balls are traced once."""
    scene = with_lights(tabletop(100), point((2.2, -1.8, 4.0), 20.0), point((2.2, -1.8, 4.0), 20.0, name="again"))
    small, large = (replace(light, softness="RADIUS", soft_radius=r) for light, r in zip(scene.lights, (0.1, 0.2),
                                                                                     strict=True))
    both = render_image(with_lights(scene, small, large)).statistics
    one = render_image(with_lights(scene, large)).statistics
    assert both["nodes"] == one["nodes"]
    assert one["long_rays"] < both["long_rays"] <= 2 * one["long_rays"]
    assert both["short_rays"] <= 1.2 * one["short_rays"]


@pytest.mark.parametrize("weights", WEIGHTS)
def test_the_uniform_skip_changes_no_bit_with_many_radii(weights):
    scene = hall(9, width=64, weights=weights)
    lights = [replace(light, softness="RADIUS", soft_radius=0.02 * (1 + n % 5)) for n, light in enumerate(scene.lights)]
    on, off = (render_image(with_lights(scene, *lights).with_settings(uniform_skip=skip)) for skip in (True, False))
    same_bits(on, off)
    assert on.statistics["uniform_skips"] > 0 and on.statistics["short_rays"] < off.statistics["short_rays"]
    assert on.statistics["empty_sets"] > 0  # r = 0.4h: many balls hold no node


# --- The paper's claims: casters and receivers ------------------------------------------------------------------

def test_a_sharp_casters_edge_is_exactly_the_sharp_one():
    """V = V_sharp casters · S_soft casters, each as it is without the other."""
    scene = four_lights(48)
    mixed = with_objects(scene, ball={"cast_soft_shadows": False})
    x, y = np.random.default_rng(0).uniform(-2.5, 2.5, (2, 8000))
    P = np.stack([x, y, np.zeros(8000)], 1)
    P = P[np.hypot(x + 0.6, y - 0.3) > 0.6]  # the ball's neighbourhood has other nodes without it
    N = np.repeat(UP, len(P), 0)
    edge = Prepared(all_lights(scene, blockers=(BALL,)).with_settings(shadows="SHARP")).light_visibility(P, N)
    soft = Prepared(with_objects(scene, ball={"visible_shadow": False})).light_visibility(P, N)
    S = Prepared(mixed).light_visibility(P, N)
    np.testing.assert_array_equal(S, edge * soft)
    both = Prepared(scene).light_visibility(P, N)
    assert ((S == 0) & (both > 0)).any() and ((S > 0) & (S < 1)).any()
    material = replace(scene, materials=tuple(
        replace(m, cast_soft_shadows=m.name != "ball") for m in scene.materials))
    np.testing.assert_array_equal(Prepared(material).light_visibility(P, N), S)


@pytest.mark.parametrize("shadows", ["LIGHT_MESHES", "AREA_SAMPLING"])
def test_a_sharp_receiver_is_exactly_sharp_there_and_nothing_else_changes(shadows):
    scene = four_lights(64, shadows=shadows, light_samples=16)
    sharp = combined(scene.with_settings(shadows="SHARP"))
    soft = combined(scene)
    mixed = combined(with_objects(scene, floor={"receive_soft_shadows": False}))
    floor = combined(replace(scene, lights=(), materials=(  # the floor is the only grey thing
        replace(GREY, emission=(1, 0, 0)), *scene.materials[1:])))[..., 0] > 0.5
    assert 0.2 < floor.mean() < 0.9
    np.testing.assert_array_equal(mixed[floor], sharp[floor])
    np.testing.assert_array_equal(mixed[~floor], soft[~floor])
    assert (soft[floor] != sharp[floor]).any() and (soft[~floor] != sharp[~floor]).any()


@pytest.mark.parametrize("shadows", ["LIGHT_MESHES", "AREA_SAMPLING"])
@pytest.mark.parametrize("off", [
    lambda s: all_lights(s, soft_shadows=False), lambda s: all_objects(s, cast_soft_shadows=False),
    lambda s: all_materials(s, cast_soft_shadows=False), lambda s: all_objects(s, receive_soft_shadows=False),
    lambda s: all_materials(s, receive_soft_shadows=False),
], ids=["lights", "casting objects", "casting materials", "receiving objects", "receiving materials"])
def test_all_off_is_the_sharp_picture(off, shadows):
    scene = four_lights(64, shadows=shadows, light_samples=4)
    switched = render_image(off(scene), ("Combined", "Shadow"))
    same_bits(switched, render_image(scene.with_settings(shadows="SHARP"), ("Combined", "Shadow")))
    assert switched.statistics["plan"]["shadows"].startswith("sharp")
    same_bits(render_image(off(still_life(glass(0.5), shadows=shadows))),
              render_image(still_life(glass(0.5), shadows="SHARP")))


def test_a_half_sharp_scene_needs_two_occlusion_scenes_and_a_soft_one_needs_one():
    scene = four_lights(16)
    assert Prepared(scene).tracer.embree_scenes == Prepared(all_objects(scene, cast_soft_shadows=False)
                                                            ).tracer.embree_scenes
    mixed = Prepared(with_objects(scene, ball={"cast_soft_shadows": False}))
    assert mixed.tracer.embree_scenes == Prepared(scene).tracer.embree_scenes + 2
    assert "come apart" in mixed.plan.reasons["casters"]


def test_no_neighbourhood_reaches_through_a_sharp_wall():
    wall = box((-0.01, -5, -1), (0.01, 5, 3))
    scene = Scene.from_shapes([Shape(rectangle((-5, -5), (5, 5), 0.0), WHITE, "floor"),
                               Shape(wall, WHITE, "wall", flags={"cast_soft_shadows": False})],
                              look_down(0, 0, 2, 64), [point((-2, 0, 1))], settings(h=0.1))
    x = np.linspace(-0.4, 0.4, 41)
    x = x[np.abs(x) > 0.011]
    P = np.stack([x, 0 * x, 0 * x], 1)
    S = Prepared(scene).light_visibility(P, np.repeat(UP, len(P), 0))[:, 0]
    np.testing.assert_array_equal(S, x < 0)


# --- Linking ------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("shadows", SHADOWS)
def test_a_light_lights_only_its_receivers(shadows):
    scene = replace(four_lights(64, shadows=shadows, light_samples=4), **ALONE)
    first = scene.lights[0]
    lit = [combined(with_lights(scene, replace(first, receivers=objects)))
           for objects in ((FLOOR,), (BALL, BOX), (), None)]
    np.testing.assert_allclose(lit[0] + lit[1], lit[3], rtol=1e-6)
    assert lit[0].any() and lit[1].any() and not lit[2].any()
    pixels = lit[0].any(-1), lit[1].any(-1)
    assert (pixels[0] & pixels[1]).mean() < 0.1  # one sample a pixel: none is both


@pytest.mark.parametrize("shadows", SHADOWS)
def test_only_its_blockers_shadow_a_light(shadows):
    scene = four_lights(64, shadows=shadows, light_samples=4)
    open_ = render_image(all_lights(scene, blockers=()))
    same_bits(open_, render_image(all_lights(scene, cast_shadow=False)))
    every = render_image(all_lights(scene, blockers=(FLOOR, BALL, BOX)))
    same_bits(every, render_image(scene))
    assert every.statistics["plan"] == render_image(scene).statistics["plan"]  # nothing comes apart
    x, y = np.random.default_rng(0).uniform(-2.5, 2.5, (2, 3000))
    P = np.stack([x, y, np.zeros(3000)], 1)
    N = np.repeat(UP, len(P), 0)
    S = Prepared(with_lights(scene, *(replace(light, blockers=(b,)) for light, b in
                                      zip(scene.lights, (BALL, BOX, BALL, BOX), strict=True)))).light_visibility(P, N)
    both = Prepared(scene).light_visibility(P, N)
    away = (np.hypot(x + 0.6, y - 0.3) > 0.3) & ((np.abs(x - 0.6) > 0.6) | (np.abs(y) > 0.7))
    assert (both <= S).all() and (S[away] > both[away]).any()
    alone = Prepared(with_objects(scene, box={"visible_shadow": False})).light_visibility(P, N)
    np.testing.assert_array_equal(S[away][:, [0, 2]], alone[away][:, [0, 2]])


def test_too_many_different_links_are_refused_with_a_sentence():
    ball = sphere(0.1, 6, 3)
    parts = [Shape(ball, GREY, f"ball {n}", [translate(n, 0, 0)]) for n in range(110)]
    lights = [point((0, 0, 5), blockers=(n,)) for n in range(110)]
    scene = Scene.from_shapes(parts, look_down(0, 0, 4, 8), lights, settings())
    with pytest.raises(SceneError, match=r"100 different sets .* share a collection"):
        Prepared(scene)
    shared = with_lights(scene, *(replace(light, blockers=(n % 3,)) for n, light in enumerate(lights)))
    one = with_lights(scene, lights[0])
    assert Prepared(shared).tracer.embree_scenes == Prepared(one).tracer.embree_scenes + 2


# --- Independence -------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("weights", WEIGHTS)
def test_tiles_and_threads_change_no_bit(weights):
    scene = four_lights(64, weights=weights)
    lights = [replace(light, softness="RADIUS", soft_radius=0.1 * (1 + n), blockers=(n % 3, 2), receivers=(0, n % 2))
              for n, light in enumerate(scene.lights)]
    scene = with_objects(with_lights(scene, *lights), ball={"cast_soft_shadows": False},
                         box={"receive_soft_shadows": False})
    first = render_image(scene, threads=1, tile_size=64)
    for threads, tile in ((2, 64), (2, 7), (1, 16)):
        same_bits(first, render_image(scene, threads=threads, tile_size=tile))


def test_smooth_weights_fall_to_nothing_at_r():
    """No jump where a node enters the ball: neighbouring receivers differ by little."""
    scene = Scene.from_shapes([Shape(rectangle((-60, -60), (60, 60), 0.0), WHITE, "floor"),
                               Shape(rectangle((-60, -60), (0, 60), 4.0), WHITE, "occluder")],
                              look_down(0, 0, 1, 8), [sun((0, 0, -1))], settings(h=0.1))
    x = np.linspace(-0.35, 0.35, 20001)
    P = np.stack([x, 0 * x, 0 * x], 1)
    jumps = {}
    for weights in WEIGHTS:
        S = Prepared(scene.with_settings(weights=weights)).light_visibility(P, np.repeat(UP, len(P), 0))[:, 0]
        assert S[0] == 0 and S[-1] == 1
        jumps[weights] = np.sort(np.abs(np.diff(S.astype(float))))[-10:]
    assert jumps["SMOOTH"].mean() < 0.7 * jumps["UNIFORM"].mean()


def test_links_and_flags_of_instances_and_of_a_shared_material():
    """An object's flag counts for all its instances; a material's for every object that has it."""
    ball = sphere(0.2, 12, 6)
    shade = Material("shade", cast_soft_shadows=False)
    parts = [Shape(rectangle((-9, -9), (9, 9), 0.0), WHITE, "floor"),
             Shape(ball, shade, "balls", [translate(-1, 0, 1.0), translate(1, 0, 1.0)])]
    scene = Scene.from_shapes(parts, look_down(0, 0, 4, 8), [sun((0, 0, -1))], settings(h=0.1))
    x = np.concatenate([np.linspace(-1.5, -0.5, 300), np.linspace(0.5, 1.5, 300)])
    P = np.stack([x, 0 * x, 0 * x], 1)
    S = Prepared(scene).light_visibility(P, np.repeat(UP, len(P), 0))[:, 0]
    assert set(np.unique(S)) == {0, 1}
