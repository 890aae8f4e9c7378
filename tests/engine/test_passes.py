"""Render passes: they add up to Combined, and each shows what its name says."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.film.passes import DEBUG, LIGHT, NO_DEPTH, PASSES
from light_meshes.picture.render import render_image
from light_meshes.scene.description import SHADOWS, Material
from light_meshes.scene.errors import SceneError
from scenes import GREY, four_lights, hall, look_down, point, settings, sun, tabletop, with_lights

ALL = tuple(PASSES)


def everything(**values):
    """Mirror, bending glass, a coloured pane, a half cut-out, a glow, a shadow catcher and a holdout."""
    scene = four_lights(48, **({"mode": "WHITTED", "samples": 3, "filter_size": 1.5, "light_samples": 8} | values))
    more = [
        Shape(sphere(0.35, 16, 8), Material("glass", kd=0.1, ka=0.2, kt=(0.8, 0.9, 0.7), ior=1.5, fresnel=True), "lens",
              [translate(0.5, -1.2, 0.5)]),
        Shape(box((-1.6, -1.3, 0.2), (-0.9, -1.28, 0.9)), Material("pane", kd=0.2, kt=(0.7, 0.2, 0.2), ks=0.2), "pane"),
        Shape(box((-0.5, -1.5, 0.0), (-0.1, -1.4, 0.4)), Material("leaf", Od=(0.1, 0.6, 0.1), alpha=0.4), "leaf"),
        Shape(box((1.2, 0.6, 0.0), (1.5, 0.9, 0.9)), Material("glow", emission=(0.5, 0.2, 0.1)), "glow"),
        Shape(box((1.3, -1.2, 0.0), (2.0, -0.6, 0.05)), GREY, "catcher", flags={"shadow_catcher": True}),
        Shape(box((-1.7, 0.8, 0.0), (-1.3, 1.2, 0.6)), GREY, "hole", flags={"holdout": True}),
    ]
    things = [Shape(rectangle((-3, -3), (3, 3), 0.0), Material("floor", ks=0.3, mirror=(0.1, 0.1, 0.2)), "floor"),
              Shape(sphere(0.6, 24, 12), Material("ball", Od=(0.2, 0.5, 0.7), ks=0.4, mirror=(0.3, 0.3, 0.4)), "ball",
                    [translate(-0.6, 0.3, 0.65)]),
              Shape(box((0.3, -0.4, 0.0), (0.9, 0.4, 1.1)), Material("box", Od=(0.7, 0.3, 0.2)), "box")]
    return Scene.from_shapes(things + more, scene.camera, scene.lights, scene.settings, world_color=scene.world_color)


@pytest.mark.parametrize("values", [
    *({"shadows": shadows} for shadows in SHADOWS), {"mode": "RAY_CASTING"}, {"mode": "LOCAL"},
    {"film_transparent": True}, {"bounces": 1}, {"refraction": "FULL"}, {"refraction": "NONE", "glass": "PAPER"}],
    ids=lambda values: " ".join(map(str, values.values())))
def test_the_parts_of_light_add_up_to_combined(values):
    passes = render_image(everything(**values), ALL).passes
    total = sum(passes[name] for name in LIGHT)
    np.testing.assert_allclose(total, passes["Combined"][..., :3], rtol=0, atol=1e-6)
    empty = {name for name in LIGHT if not passes[name].any()}
    assert empty == (({"Environment"} if values.get("film_transparent") else set())
                     | (set() if "bounces" in values else {"Diffuse Indirect"}))


@pytest.mark.parametrize("opaque", [True, False])
def test_more_passes_change_no_bit_of_the_others(opaque):
    scene = hall(9, width=48) if opaque else everything()
    found = render_image(scene, ALL).passes
    for name in ("Combined", "Shadow", "Glossy", "Position"):
        np.testing.assert_array_equal(render_image(scene, (name,)).passes[name], found[name], err_msg=name)


def test_diffuse_and_glossy_are_the_pictures_of_half_the_material():
    """Without mirrors: Ω is a sum of a diffuse term and a highlight, and so is the picture."""
    scene = four_lights(64)
    scene = replace(scene, materials=tuple(replace(m, ks=0.5, emission=(0.1, 0.2, 0.3)) for m in scene.materials))
    passes = render_image(scene, ALL).passes
    for name, changes in (("Diffuse", {"ks": 0.0}), ("Glossy", {"kd": 0.0})):
        half = tuple(replace(m, ka=0.0, emission=(0.0, 0.0, 0.0), **changes) for m in scene.materials)
        expected = render_image(replace(scene, materials=half)).passes["Combined"][..., :3]
        expected = np.where(passes["Depth"] < NO_DEPTH, expected, 0)  # without the background
        np.testing.assert_allclose(passes[name], expected, rtol=0, atol=2e-6, err_msg=name)
        assert (passes[name] > 0.01).mean() > 0.02


def test_ambient_emission_and_environment_are_numbers():
    material = Material("m", Od=(0.5, 0.25, 1.0), ka=0.4, emission=(3.0, 0.0, 0.5))
    scene = Scene.from_shapes([Shape(rectangle((-1, -1), (1, 1), 0.0), material, "sheet")], look_down(0, 0, 4, 16),
                              [point((0, 0, 2))], settings(ambient=2.0), world_color=(0.1, 0.2, 0.3))
    passes = render_image(scene, ALL).passes
    inside = (slice(5, 11), slice(5, 11))
    np.testing.assert_allclose(passes["Ambient"][inside] - np.float32([0.04, 0.04, 0.24]), 0, atol=1e-7)
    np.testing.assert_array_equal(passes["Emission"][inside] - np.float32([3.0, 0.0, 0.5]), 0)
    assert not passes["Environment"][inside].any()
    np.testing.assert_array_equal(passes["Environment"][0] - np.float32([0.1, 0.2, 0.3]), 0)
    assert not any(passes[name][0].any() for name in ALL if name not in ("Combined", "Environment", "Depth", "Mist"))


@pytest.mark.parametrize(("name", "material"), [
    ("Glossy", Material("mirror", Od=(0, 0, 0), kd=0.0, ka=0.0, mirror=(0.5, 0.4, 0.3))),
    ("Transmission", Material("pane", Od=(0, 0, 0), kd=0.0, ka=0.0, kt=(0.5, 0.4, 0.3))),
    ("Transmission", Material("lens", Od=(0, 0, 0), kd=0.0, ka=0.0, kt=(0.5, 0.4, 0.3), ior=1.2))])
def test_what_is_seen_in_a_mirror_is_glossy_and_through_glass_transmission(name, material):
    """Whatever it is there: lit, glowing, a highlight, the background."""
    glow = Material("glow", ks=0.5, nShiny=2.0, emission=(0.3, 0.3, 0.3))
    scene = Scene.from_shapes([Shape(box((-9, -9, 0), (9, 9, 1)), material, "surface"),
                               Shape(sphere(1.0), glow, "above", [translate(0.5, 0, 3)]),
                               Shape(sphere(1.0), glow, "below", [translate(0.5, 0, -3)])],
                              Camera.look_at((0.2, -6, 5), (0.2, 0, 1), 45, 24, 24), [point((3, -2, 6))],
                              settings(mode="WHITTED", max_depth=6), world_color=(0.2, 0.2, 0.2))
    surface, above, below = scene.objects
    scene = replace(scene, objects=(surface, replace(above, visible_camera=False), below))
    passes = render_image(scene, ALL).passes
    on = passes["Position"][..., 2] > 0.99
    assert on.mean() > 0.6 and passes["Emission"].max() == 0
    np.testing.assert_array_equal(passes[name][on], passes["Combined"][..., :3][on])
    assert np.ptp(passes[name][on][:, 0]) > 0.05


def test_position_uv_and_indices():
    """Position and indices are those of one surface, also at an edge; Normal and UV are means."""
    scene = four_lights(48, samples=9, filter_size=1.5)
    scene = replace(scene, objects=tuple(replace(o, index=7 * n) for n, o in enumerate(scene.objects)),
                    materials=tuple(replace(m, index=100 + n) for n, m in enumerate(scene.materials)))
    g = scene.geometry
    corners = g.vertices[g.triangles]  # (T,3,3) of all meshes: where they stand does not matter to UV
    first = g.meshes[0][3]
    uvs = np.zeros((len(g.triangles), 3, 2), np.float32)
    uvs[:first] = corners[:first, :, :2] / 6 + 0.5  # the floor is the first mesh
    passes = render_image(replace(scene, geometry=replace(g, uvs=uvs)), ALL).passes
    thing, position = passes["Object Index"][..., 0], passes["Position"]
    assert set(np.unique(thing)) == {0, 7, 14} and set(np.unique(passes["Material Index"])) == {0, 100, 101, 102}
    nothing = passes["Depth"][..., 0] == NO_DEPTH
    np.testing.assert_array_equal(passes["Material Index"][..., 0], np.where(nothing, 0, 100 + thing / 7))
    assert (position[nothing] == 0).all() and nothing.mean() > 0.05
    np.testing.assert_allclose(np.linalg.norm(position[thing == 7] - (-0.6, 0.3, 0.65), axis=-1), 0.6, atol=0.02)
    floor = (thing == 0) & ~nothing
    assert abs(position[floor][:, 2]).max() < 1e-6
    whole = floor & (passes["UV"][..., 2] == 1) & (passes["Normal"][..., 2] > 1 - 1e-6)
    # The mean of nine places in the pixel lies within it.
    np.testing.assert_allclose(passes["UV"][whole][:, :2], position[whole][:, :2] / 6 + 0.5, atol=0.02)
    edge = (passes["UV"][..., 2] > 0) & (passes["UV"][..., 2] < 1)
    assert edge.sum() > 10 and whole.sum() > 400
    left, right, *_ = scene.camera.window
    x, y = np.meshgrid(*[np.linspace(left, right, 97)[1::2]] * 2)
    ray = np.stack([x, y, -np.ones_like(x)], -1) @ scene.camera.matrix[:3, :3].T
    seen = scene.camera.matrix[:3, 3] + passes["Depth"] * ray
    assert np.median(np.abs(seen - position)[~nothing]) < 0.02  # the sample is next to the pixel's centre, not in it


@pytest.mark.parametrize("scene", [four_lights(64), four_lights(64, shadows="SHARP"), everything(),
                                   everything(refraction="FULL")], ids=["soft", "sharp", "glass", "caustics"])
def test_the_shadow_pass_of_a_light_is_that_of_the_light_alone(scene):
    numbered = with_lights(scene, *(replace(light, shadow_pass=n // 2) for n, light in enumerate(scene.lights)))
    found = render_image(numbered, ("Shadow", "Shadow 0", "Shadow 1", "Shadow 2")).passes
    alone = [render_image(with_lights(scene, light), ("Shadow",)).passes["Shadow"] for light in scene.lights]
    for n in (0, 1):  # lights that share a number share a pass, which has their mean
        np.testing.assert_allclose(found[f"Shadow {n}"], (alone[2 * n] + alone[2 * n + 1]) / 2, rtol=3e-7)
    np.testing.assert_allclose(found["Shadow"], sum(alone) / 4, rtol=0, atol=1e-6)
    assert not found["Shadow 2"].any()  # of no light in the scene
    one = with_lights(scene, *(replace(light, shadow_pass=n) for n, light in enumerate(scene.lights)))
    for n, (name, shadow) in enumerate(render_image(one, [f"Shadow {n}" for n in range(4)]).passes.items()):
        np.testing.assert_array_equal(shadow, alone[n], err_msg=name)
        assert 0.02 < shadow.mean() < 0.98


def test_a_light_through_coloured_glass_casts_a_coloured_shadow():
    pane = Material("pane", kt=(0.9, 0.5, 0.1))
    parts = [Shape(rectangle((-5, -5), (5, 5), 0.0), GREY, "floor"),
             Shape(rectangle((-5, -5), (0, 5), 2.0), pane, "pane")]
    scene = Scene.from_shapes(parts, look_down(0, 0, 2, 32, height=1.5), [replace(sun((0, 0, -1)), shadow_pass=0)],
                              settings(h=0.05))
    shadow = render_image(scene, ("Shadow 0",)).passes["Shadow 0"]
    np.testing.assert_allclose(shadow[:, :4], np.broadcast_to(np.float32([0.9, 0.5, 0.1]), (32, 4, 3)), rtol=1e-6)
    np.testing.assert_array_equal(shadow[:, -4:], 1)


@pytest.mark.parametrize("scene", [tabletop(48, h=0.1, kI=1.3).with_settings(samples=2, filter_size=1.0),
                                   hall(9, width=48, mode="WHITTED", kI=0.9), everything()],
                         ids=["tabletop", "small balls", "everything"])
@pytest.mark.parametrize("skip", [True, False])
def test_the_debug_passes_add_up_to_the_statistics(scene, skip):
    done = render_image(scene.with_settings(uniform_skip=skip), DEBUG)
    samples = scene.settings.samples
    total = {name: done.passes[name].sum(dtype=np.float64) * samples for name in DEBUG}
    for name, count in (("Candidates", "candidates"), ("Empty", "empty_sets"), ("Skipped", "uniform_skips")):
        assert total[f"Debug {name}"] == pytest.approx(done.statistics[count], rel=1e-5), name
    assert (total["Debug Skipped"] > 0) == skip
    assert 0 < total["Debug m"] < total["Debug Candidates"]


def test_m_is_what_the_method_says():
    """(2π/3)·kI³ nodes on a plane, half of them beside a wall; none where kI is too small is an empty set."""
    parts = [Shape(rectangle((-5, -5), (5, 5), 0.0), GREY, "floor"), Shape(box((1, -5, 0), (2, 5, 3)), GREY, "wall")]
    scene = Scene.from_shapes(parts, look_down(0.5, 0, 2, 64), [point((-3, 0, 3))],
                              settings(h=0.1, kI=3.0, uniform_skip=False))
    m = render_image(scene, DEBUG).passes["Debug m"][..., 0]
    assert m[:, 8:32].mean() == pytest.approx(2 * np.pi / 3 * 27, rel=0.02)  # more than r from the wall at x = 1
    beside = slice(46, 48)  # 0.03 from it, on the average
    assert m[:, beside].mean() == pytest.approx(np.pi / 3 * 27, rel=0.15)
    few = render_image(scene.with_settings(kI=0.7), DEBUG).passes
    counted = m > 0  # where the light shines on
    np.testing.assert_array_equal((few["Debug m"][..., 0] == 0) & counted, (few["Debug Empty"][..., 0] == 1) & counted)
    assert 0.05 < (few["Debug Empty"][..., 0])[counted].mean() < 0.95


def test_a_pass_that_does_not_exist_is_named():
    for name in ("Beauty", "Shadow x", "Shadow 01", "Shadow -1", "../Shadow 1", "Shadow 1\n"):
        with pytest.raises(SceneError, match="there is no pass"):
            render_image(tabletop(8), (name,))
