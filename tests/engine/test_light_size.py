"""A light's r from its size (method §2): the formula, the measurement, and the largest r that the lattice supports."""

from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Camera, Scene, Shape, box, rectangle
from light_meshes.picture.render import Prepared, measure, render_image
from light_meshes.scene.description import Light
from light_meshes.shadows import radius as light_size
from scenes import GREY, WHITE, edge, four_lights, look_down, point, settings, sun, tabletop, with_lights
from test_penumbra import profile

AREA = Light("area", "AREA", (1.0,) * 3, position=(0, 0, 4))


def spread(light, n=20001):
    """Variance of a light's points along one axis, as the mean of the two."""
    random = np.random.default_rng(0)
    if light.area_ellipse:
        angle, share = random.uniform(0, 2 * np.pi, n), np.sqrt(random.random(n))
        a, b = share * np.cos(angle), share * np.sin(angle)
    else:
        a, b = random.uniform(-1, 1, (2, n))
    points = a[:, None] * np.array(light.area_u) + b[:, None] * np.array(light.area_v)
    return points.var(0).sum() / 2


@pytest.mark.parametrize("ellipse", [False, True])
@pytest.mark.parametrize("axes", [((0.5, 0, 0), (0, 0.5, 0)), ((1.0, 0, 0), (0, 0.2, 0)),
                                  ((0.3, 0.4, 0), (-0.4, 0.3, 0))])
def test_an_area_light_counts_as_the_disc_of_its_variance(axes, ellipse):
    light = replace(AREA, area_u=axes[0], area_v=axes[1], area_ellipse=ellipse)
    assert light_size.extent(light) ** 2 / 4 == pytest.approx(spread(light), rel=0.03)


def test_the_rule_in_numbers():
    lamp = point((0, 0, 4), radius=0.25)
    assert light_size.extent(lamp) == 0.25
    assert light_size.radius(lamp, 1.0 / 3.0, "UNIFORM") == pytest.approx(1.12 * 0.25 / 3, rel=0.005)
    day = sun((0, 0, -1), angle=0.1)
    assert light_size.radius(day, 2.0, "UNIFORM") == pytest.approx(1.12 * 2 * np.tan(0.05), rel=0.005)
    # Smooth weights blur less for the same r: the variance of (1 − t²) in the half-ball is r²/7, not r²/5.
    assert light_size.radius(lamp, 1.0, "SMOOTH") / light_size.radius(lamp, 1.0, "UNIFORM") == pytest.approx(
        np.sqrt(7 / 5), rel=0.01)


@pytest.mark.parametrize("weights", ["UNIFORM", "SMOOTH"])
def test_the_weights_have_the_variance_that_the_rule_counts_on(weights):
    x = np.random.default_rng(0).uniform(-1, 1, (1_000_000, 3))
    square = (x**2).sum(1)
    weight = (square < 1) * (1 - square if weights == "SMOOTH" else 1.0)
    assert (weight * x[:, 0] ** 2).sum() / weight.sum() == pytest.approx(light_size.VARIANCE[weights], rel=0.01)


def post(lights, camera=None, **values):
    """A floor and a plate at z = 1 over x < 0, seen from above but for the plate itself."""
    plate = Shape(box((-3, -3, 1.0), (0, 3, 1.01)), GREY, "plate", flags={"visible_camera": False})
    return Scene.from_shapes([Shape(rectangle((-3, -3), (3, 3), 0.0), WHITE, "floor"), plate],
                             camera or look_down(0, 0, 2, 32), lights, settings(h=0.1, kI=2.0, **values))


def radii(scene):
    """Those of lights whose size counts, by name."""
    found = zip(scene.lights, measure(scene)["radii"], strict=True)
    return {light.name: r for light, r in found if light.softness == "LIGHT_SIZE"}


def test_a_sun_is_measured_by_how_far_its_blockers_are():
    day = sun((0, 0, -1), angle=0.2, softness="LIGHT_SIZE")
    assert radii(post([day]))["sun"] == pytest.approx(np.sqrt(1.25) * np.tan(0.1), rel=0.01)
    slanted = sun((1, 0, -1), angle=0.2, softness="LIGHT_SIZE")
    assert radii(post([slanted]))["sun"] == pytest.approx(np.sqrt(2 * 1.25) * np.tan(0.1), rel=0.01)
    given = replace(day, reference_distance=0.3)
    assert radii(post([given]))["sun"] == pytest.approx(0.3 * np.sqrt(1.25) * np.tan(0.1), rel=0.01)


def test_a_lamp_is_measured_by_its_blockers_or_by_the_distance_given():
    lamp = point((0, 0, 5), radius=0.2, softness="LIGHT_SIZE", name="lamp")
    # Above the floor all ways are cut by z = 1 at the same share: a/(L − a) = 1/4.
    assert radii(post([lamp]))["lamp"] == pytest.approx(np.sqrt(1.25) * 0.2 / 4, rel=0.02)
    given = replace(lamp, reference_distance=2.0)
    median = np.median([np.sqrt(x * x + y * y + 25) for x in np.linspace(-1, 1, 64) for y in np.linspace(-1, 1, 64)])
    assert radii(post([given]))["lamp"] == pytest.approx(np.sqrt(1.25) * 0.2 * 2 / (median - 2), rel=0.01)


def test_only_what_the_light_shines_on_and_what_blocks_it_is_measured():
    wide = Camera.look_at((0, -6, 5), (0, 0, 0), 40, 32, 32)
    lamp = point((0, 0, 5), radius=0.2, softness="LIGHT_SIZE", name="lamp")
    scene = post([lamp], wide)
    low = Shape(rectangle((0.5, -3), (3, 3), 0.1), GREY, "low", flags={"visible_camera": False})
    both = replace(Scene.from_shapes([*_parts(), low], wide, [lamp], scene.settings))
    near = radii(with_lights(both, replace(lamp, blockers=(2,))))["lamp"]
    assert near == pytest.approx(np.sqrt(1.25) * 0.2 * 0.1 / 4.9, rel=0.02)
    assert radii(with_lights(both, replace(lamp, blockers=(1,))))["lamp"] == pytest.approx(
        np.sqrt(1.25) * 0.2 / 4, rel=0.02)
    soft_only = replace(both, objects=(*both.objects[:1], replace(both.objects[1], cast_soft_shadows=False),
                                       both.objects[2]))
    assert radii(soft_only)["lamp"] == near  # sharp casters have no width
    assert radii(with_lights(both, replace(lamp, receivers=())))["lamp"] is None  # the scene's


def _parts():
    return [Shape(rectangle((-3, -3), (3, 3), 0.0), WHITE, "floor"),
            Shape(box((-3, -3, 1.0), (0, 3, 1.01)), GREY, "plate", flags={"visible_camera": False})]


def test_nothing_in_the_way_leaves_the_scenes_radius():
    lamp = point((0, 0, 5), radius=0.2, softness="LIGHT_SIZE", name="lamp")
    scene = with_lights(post([lamp]), replace(lamp, blockers=()))
    assert radii(scene)["lamp"] is None
    away = replace(post([lamp]), camera=Camera.look_at((0, 0, 20), (0, 0, 40), 40, 32, 32))
    assert radii(away)["lamp"] is None
    assert render_image(away).warnings == []


def test_what_is_measured_is_what_is_rendered():
    """The add-on measures once for an animation and gives the radii back: no bit of the picture changes."""
    scene = tabletop(48)
    lamp = replace(scene.lights[0], radius=0.3, softness="LIGHT_SIZE")
    found = measure(with_lights(scene, lamp))
    fixed = replace(lamp, softness="RADIUS", soft_radius=found["radii"][0])
    a, b = (render_image(with_lights(scene, light)).passes["Combined"] for light in (lamp, fixed))
    np.testing.assert_array_equal(a, b)
    assert (a != render_image(scene).passes["Combined"]).any()
    again = measure(with_lights(scene, lamp).with_settings(auto_h=True))
    assert again == found and measure(with_lights(scene, lamp).with_settings(shadows="SHARP")) == found
    cropped = replace(scene, camera=replace(scene.camera, width=96, crop=(3, 5, 20, 30)))
    assert measure(with_lights(cropped, lamp))["radii"] == found["radii"]


def test_lights_of_one_name_have_radii_of_their_own():
    """As the instances of one lamp have."""
    near, far = (point((x, 0, z), radius=0.2, softness="LIGHT_SIZE", name="lamp") for x, z in ((-1, 2), (1, 5)))
    other = replace(near, softness="SCENE")
    found = measure(post([near, other, far]))["radii"]
    assert found[0] > 2 * found[2] > 0 and found[1] is None


@pytest.mark.parametrize("weights", ["UNIFORM", "SMOOTH"])
def test_the_blur_is_the_lights(weights):
    """A sun's penumbra by its size, a measured, beside the one that area sampling finds: as wide, to 2 %."""
    half = 0.1
    values = {"h": 0.05, "weights": weights, "size": 2.2}
    scene = edge(**values)  # the occluder is 4 above
    scene = with_lights(scene, replace(scene.lights[0], angle=2 * half, softness="LIGHT_SIZE", reference_distance=4.0))
    widths = []
    for shadows in ("LIGHT_MESHES", "AREA_SAMPLING"):
        x, S = profile(scene.with_settings(shadows=shadows, light_samples=256))
        x, S = x[0], S.mean(0)
        density = np.gradient(S, x)
        widths.append(np.sqrt((density * x**2).sum() / density.sum()))
    assert widths[0] == pytest.approx(widths[1], rel=0.02)


def test_a_radius_of_many_steps_is_cut_and_said():
    scene = four_lights(24, h=0.02)
    lights = [replace(light, softness="RADIUS", soft_radius=0.4) for light in scene.lights[:2]]
    cut = render_image(with_lights(scene, *lights))
    assert len(cut.warnings) == 2 and "'point'" in cut.warnings[0] and "0.32" in cut.warnings[0]
    same = [replace(light, soft_radius=16 * 0.02) for light in lights]
    full = render_image(with_lights(scene, *same))
    assert full.warnings == []
    np.testing.assert_array_equal(cut.passes["Combined"], full.passes["Combined"])
    behind = point((0, 0, 3), radius=0.1, softness="LIGHT_SIZE", reference_distance=9.0, name="behind")
    assert "'behind'" in render_image(with_lights(scene, behind)).warnings[0]


def test_a_light_without_a_size_is_sharp():
    scene = four_lights(48)
    sizes = [replace(light, softness=softness, radius=0.0, angle=0.0, area_u=(0.0,) * 3, area_v=(0.0,) * 3)
             for light, softness in zip(scene.lights, ("RADIUS", "LIGHT_SIZE", "LIGHT_SIZE", "LIGHT_SIZE"),
                                        strict=True)]
    picture = render_image(with_lights(scene, *sizes))
    np.testing.assert_array_equal(picture.passes["Combined"],
                                  render_image(scene.with_settings(shadows="SHARP")).passes["Combined"])
    assert Prepared(with_lights(scene, *sizes)).plan.shadows == "SHARP"
