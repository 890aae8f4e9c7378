"""Many lights, lights in unusual places, and the formula of each type."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Scene, Shape, rectangle
from light_meshes.picture.render import Prepared, render_image
from light_meshes.scene.description import Light, Material
from light_meshes.shadows import pairs
from scenes import WHITE, four_lights, hall, look_down, point, settings, with_lights

UP = np.array([0.0, 0.0, 1.0])


def floor(*lights, pixels=40, size=2.0, material=WHITE, **values):
    """A white floor from above: Combined is Σ S·I·cos·f_att."""
    return Scene.from_shapes([Shape(rectangle((-10, -10), (10, 10), 0.0), material, "floor")],
                             look_down(0, 0, size, pixels), lights, settings(**values))


def positions(scene):
    """(x, y) of the pixels on the floor."""
    left, right = scene.camera.window[:2]
    x = left + (right - left) * (np.arange(scene.camera.width) + 0.5) / scene.camera.width
    return np.meshgrid(x, x)


@pytest.mark.parametrize("count", [64, 65, 100, 256])
@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
def test_all_lights_together_are_the_sum_of_each(count, shadows):
    """H11."""
    scene = hall(count, columns=2, width=24).with_settings(shadows=shadows)
    together = render_image(scene).passes["Combined"][..., :3]
    apart = np.sum([render_image(with_lights(scene, light)).passes["Combined"][..., :3].astype(float)
                    for light in scene.lights], 0)
    assert together.max() > 0.1
    np.testing.assert_allclose(together, apart, rtol=1e-6, atol=1e-6)


def test_a_light_on_a_node_is_seen_from_it():
    """H3: the node is at the very light."""
    scene = floor(point((0.0, 0.0, 0.2)), h=0.1, lattice_rotation=False)
    nodes = Prepared(scene).soft
    start, kept = nodes.interpolation_set(np.zeros((1, 3)), UP[None])
    assert (0, 0, 2) in set(map(tuple, kept[start[0]:start[1]].tolist()))
    result = render_image(scene, passes=("Combined", "Shadow"))
    assert (result.passes["Shadow"] == 1).all()
    assert np.isfinite(result.passes["Combined"]).all()


def test_a_light_in_the_floors_plane_lights_nothing():
    """H3: exactly 0, sharp and soft."""
    for shadows in ("SHARP", "LIGHT_MESHES"):
        picture = render_image(floor(point((0.3, 0.1, 0.0)), shadows=shadows, h=0.1)).passes["Combined"]
        assert (picture[..., :3] == 0).all()


@pytest.mark.parametrize("rotated", [True, False])
def test_a_light_just_above_the_floor_lights_all_of_it(rotated):
    """H3: U/Ω = 1 everywhere."""
    scene = floor(point((0.3, 0.1, 1e-3)), h=0.1, lattice_rotation=rotated)
    result = render_image(scene, passes=("Combined", "Shadow"))
    assert (result.passes["Shadow"] == 1).all()
    assert (result.passes["Combined"][..., :3] > 0).all()


@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
def test_a_lamp_on_the_ceiling_is_not_shadowed_by_it(shadows):
    ceiling = Shape(rectangle((-3, -3), (3, 3), 1.3), WHITE, "ceiling")
    scene = Scene.from_shapes([Shape(rectangle((-3, -3), (3, 3), 0.0), WHITE, "floor"), ceiling],
                              look_down(0, 0, 2, 40, height=1.0), [point((0.37, -0.21, float(np.float32(1.3))))],
                              settings(h=0.1, shadows=shadows))
    assert (render_image(scene, passes=("Shadow",)).passes["Shadow"] == 1).all()


def test_a_point_light_falls_off_with_the_square():
    scene = floor(Light("lamp", "POINT", (3.0, 2.0, 1.0), position=(0.2, -0.1, 0.7)))
    x, y = positions(scene)
    square = (x - 0.2) ** 2 + (y + 0.1) ** 2 + 0.49
    expected = (0.7 / square**1.5)[..., None] * [3.0, 2.0, 1.0]
    np.testing.assert_allclose(render_image(scene).passes["Combined"][..., :3], expected, rtol=1e-5)


def test_a_sun_is_the_same_everywhere():
    scene = floor(Light("sun", "SUN", (3.0, 2.0, 1.0), direction=(0.6, 0.0, -0.8)))
    np.testing.assert_allclose(render_image(scene).passes["Combined"][..., :3],
                               np.broadcast_to([2.4, 1.6, 0.8], (40, 40, 3)), rtol=1e-6)


def test_a_spot_is_smooth_within_its_blend_and_dark_outside():
    half, blend = 0.6, 0.4
    scene = floor(Light("spot", "SPOT", (1.0, 1.0, 1.0), position=(0, 0, 1), direction=(0, 0, -1),
                        spot_angle=2 * half, spot_blend=blend))
    x, y = positions(scene)
    cosine = 1 / np.sqrt(x * x + y * y + 1)
    t = np.clip((cosine - np.cos(half)) / ((1 - np.cos(half)) * blend), 0, 1)
    found = render_image(scene).passes["Combined"][..., 0]
    np.testing.assert_allclose(found, cosine**3 * t * t * (3 - 2 * t), rtol=1e-5, atol=1e-7)
    assert (found[cosine < np.cos(half)] == 0).all()


def test_an_elliptic_spot_is_a_round_one_in_its_own_space():
    half, wide = 0.6, 1.7
    scene = floor(Light("spot", "SPOT", (1.0, 1.0, 1.0), position=(0, 0, 1), direction=(0, 0, -1), spot_angle=2 * half,
                        spot_blend=0.4, axes=((1 / wide, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))))
    x, y = positions(scene)
    turned = 1 / np.sqrt((x / wide) ** 2 + y * y + 1)
    t = np.clip((turned - np.cos(half)) / ((1 - np.cos(half)) * 0.4), 0, 1)
    found = render_image(scene).passes["Combined"][..., 0]
    np.testing.assert_allclose(found, (x * x + y * y + 1) ** -1.5 * t * t * (3 - 2 * t), rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("kind", ["SPOT", "AREA"])
def test_axes_of_a_plain_lamp_change_nothing(kind):
    lamp = Light("lamp", kind, (1.0, 1.0, 1.0), position=(0.2, 0, 1), direction=(0, 0.6, -0.8), spread=2.0,
                 spot_angle=1.4, spot_blend=0.5)
    plain = render_image(floor(lamp)).passes["Combined"]
    own = replace(lamp, axes=((1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, 0.6, -0.8)))
    np.testing.assert_allclose(render_image(floor(own)).passes["Combined"], plain, rtol=1e-5, atol=1e-7)
    assert plain[..., :3].max() > 0.1


@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
def test_lamps_may_light_only_the_matt_or_only_give_highlights(shadows):
    both = Material("both", Od=(0.5, 0.4, 0.3), ks=0.5, nShiny=8.0)
    lamps = [point((0.3, 0.1, 0.8)), replace(point((-0.4, 0.2, 0.6)), type="AREA")]

    def lit(**flags):
        scene = floor(*(replace(lamp, **flags) for lamp in lamps), material=both)
        return render_image(scene.with_settings(shadows=shadows)).passes["Combined"][..., :3]
    parts = [[lit(diffuse=d, glossy=g) for g in (True, False)] for d in (True, False)]
    np.testing.assert_allclose(parts[0][1] + parts[1][0], parts[0][0], rtol=1e-5)
    assert (parts[1][1] == 0).all() and parts[1][0].max() > 0.01


def test_an_area_light_shines_to_one_side():
    down = Light("area", "AREA", (1.0, 1.0, 1.0), position=(0, 0, 1), direction=(0, 0, -1))
    scene = floor(down)
    x, y = positions(scene)
    cosine = 1 / np.sqrt(x * x + y * y + 1)
    np.testing.assert_allclose(render_image(scene).passes["Combined"][..., 0], cosine**4, rtol=1e-5)
    up = replace(down, direction=(0.0, 0.0, 1.0))
    assert (render_image(floor(up)).passes["Combined"][..., :3] == 0).all()


def test_phongs_highlight_is_where_the_light_is_mirrored():
    """A camera straight above looks along −z: R·V is the cosine of the light's own angle."""
    shiny = Material("shiny", Od=(0, 0, 0), ks=0.5, Os=(1.0, 0.5, 0.25), nShiny=20.0)
    scene = floor(point((0.0, 0.0, 1.5), 2.0), material=shiny)
    x, y = positions(scene)
    square = x * x + y * y + 2.25
    expected = 2.0 / square * 0.5 * (1.5 / np.sqrt(square)) ** 20
    np.testing.assert_allclose(render_image(scene).passes["Combined"][..., :3],
                               expected[..., None] * [1.0, 0.5, 0.25], rtol=1e-4, atol=1e-9)


def test_ambient_light_is_Ia_ka_Od():  # noqa: N802
    scene = floor(material=Material("m", Od=(0.5, 0.2, 0.1), ka=0.5), ambient=2.0)
    picture = render_image(replace(scene, world_color=(0.1, 0.2, 0.4))).passes["Combined"]
    np.testing.assert_allclose(picture, np.broadcast_to([0.05, 0.04, 0.04, 1], picture.shape), rtol=1e-6)


def test_local_mode_has_no_shadows_and_ray_casting_no_reflections():
    scene = four_lights(64)
    scene = replace(scene, materials=tuple(replace(m, mirror=(0.5, 0.5, 0.5)) for m in scene.materials))
    plain = replace(scene, materials=tuple(replace(m, mirror=(0.0, 0.0, 0.0)) for m in scene.materials))
    local, cast, whitted = (render_image(scene.with_settings(mode=m)).passes["Combined"]
                            for m in ("LOCAL", "RAY_CASTING", "WHITTED"))
    np.testing.assert_array_equal(local, render_image(plain.with_settings(mode="LOCAL")).passes["Combined"])
    np.testing.assert_array_equal(cast, render_image(plain).passes["Combined"])
    assert (local >= cast).all() and (local > cast).any()
    assert (whitted >= cast).all() and (whitted > cast).any()


@pytest.mark.parametrize("lights", [pairs.MANY, pairs.MANY + 70])
@pytest.mark.parametrize("share", [0.01, 0.5])
def test_pairs_are_listed_in_parts(monkeypatch, lights, share):
    """Each pair of a receiver and a light once, and no more at a time than there is room for: a word, or PAIRS."""
    monkeypatch.setattr(pairs, "PAIRS", 1000)
    wanted = np.random.default_rng(lights).random((300, lights)) < share
    words = -(-lights // 64)
    bits = np.packbits(np.pad(wanted, ((0, 0), (0, 64 * words - lights))), axis=1, bitorder="little")
    found = list(pairs.blocks(bits.view(np.uint64), lights))
    assert len(found) > 1 and max(len(row) for row, _ in found) <= max(1000, 300 * 64)
    listed = np.zeros(wanted.shape, int)
    for row, light in found:
        np.add.at(listed, (row, light), 1)
    np.testing.assert_array_equal(listed, wanted)
