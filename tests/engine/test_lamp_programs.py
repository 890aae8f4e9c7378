"""Lamps with programs: the engine's side of lamps' nodes. Beside Cycles: tests/peers/test_lamp_nodes.py."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from light_meshes import Image, Material, Scene, SceneError, Shape, rectangle
from light_meshes.picture.render import Prepared, render_image
from light_meshes.scene import programs, snapshot
from light_meshes.scene.description import Light
from light_meshes.scene.profile import Profile, profile
from light_meshes.scene.validation import checked
from light_meshes.surface.faces import Faces
from light_meshes.surface.profiles import Lookup
from light_meshes.surface.sources import Sources, Spaces
from scenes import WHITE, look_down, point, settings

MATRIX = ((1.0, 0.0, 0.0, 0.3), (0.0, 1.0, 0.0, -0.2), (0.0, 0.0, 1.0, 1.5))


def lamp_program(operations, *emission):
    return programs.of_lamp({"operations": operations, "values": {"emission": list(emission)}}, "light")


def by_direction(factor):
    """A tint by the direction: its absolute values, times a number."""
    return lamp_program([["incoming"], ["absolute", [0]], ["absolute", [1]], ["absolute", [2]],
                         ["multiply", [3], factor]], [6], [4], [5])


def floor(*lights, size=2.0, pixels=24, **values):
    """A white floor from above: Combined is Σ S·I·cos·f_att."""
    more = {name: values.pop(name) for name in ("images", "profiles") if name in values}
    return Scene.from_shapes([Shape(rectangle((-10, -10), (10, 10), 0.0), WHITE, "floor")],
                             look_down(0, 0, size, pixels), lights, settings(shadows="SHARP", **values), **more)


def picture(scene):
    return render_image(scene).passes["Combined"][..., :3]


def test_without_programs_nothing_is_computed():
    lamps = Prepared(floor(point((0.0, 0.0, 1.0)))).world.lamps
    S = np.ones((3, 1, 1), np.float32)
    assert lamps(np.zeros((3, 3)), np.zeros((3, 3)), S) is S and not lamps.any and not lamps.varied.any()


def test_a_factor_is_a_factor():
    lamp = point((0.3, -0.2, 1.5))
    half = replace(lamp, program=lamp_program([], 0.5, 0.25, 1.0))
    expected = picture(floor(lamp)) * [0.5, 0.25, 1.0]
    np.testing.assert_allclose(picture(floor(half)), expected, rtol=1e-6)


@pytest.mark.parametrize("changed", [{"h": 0.1, "shadows": "LIGHT_MESHES"}, {"shadows": "AREA_SAMPLING"}])
def test_light_falls_off_as_it_says(changed):
    """Times the square of the distance: what is left is the cosine."""
    falloff = lamp_program([["ray_length"], ["multiply", [0], [0]]], [1], [1], [1])
    found = picture(floor(point((0.0, 0.0, 1.0), 1.0, program=falloff)).with_settings(**changed))
    x = (np.arange(24) + 0.5) / 12 - 1
    np.testing.assert_allclose(found[..., 0], 1 / np.sqrt(1 + x * x + (x * x)[:, None]), rtol=1e-5)


@hypothesis_settings(max_examples=10, deadline=None)
@given(st.lists(st.tuples(st.floats(0.1, 3.0), st.floats(-1, 1), st.sampled_from(["POINT", "SPOT", "AREA", "SUN"])),
                min_size=2, max_size=5))
def test_programs_that_run_as_one_give_what_each_gives(lamps):
    lights = [Light(f"{n}", kind, (1.0, 2.0, 3.0), position=(x, -x / 2, 1.5), direction=(0.0, 0.0, -1.0),
                    spot_angle=1.5, area_u=(0.2, 0.0, 0.0), area_v=(0.0, 0.1, 0.0), program=by_direction(factor),
                    matrix=MATRIX) for n, (factor, x, kind) in enumerate(lamps)]
    together = picture(floor(*lights, pixels=8))
    apart = np.sum([picture(floor(light, pixels=8)).astype(float) for light in lights], 0)
    assert together.max() > 0
    np.testing.assert_allclose(together, apart, rtol=1e-5, atol=1e-6)


def test_one_picture_whatever_the_batches(monkeypatch):
    lights = [point((x, 0.2, 1.0), program=by_direction(1.0 + x), matrix=MATRIX) for x in (-0.5, 0.0, 0.5)]
    whole = picture(floor(*lights))
    monkeypatch.setattr("light_meshes.surface.lamps.PAIRS", 7)
    monkeypatch.setattr("light_meshes.picture.lighting.SHADED", 30)
    assert (picture(floor(*lights)) == whole).all()


def test_images_and_profiles_of_lamps_that_run_as_one(tmp_path):
    """Each looks at its own."""
    rng = np.random.default_rng(2)
    images = []
    for n in range(2):
        (tmp_path / f"{n}.ppm").write_bytes(b"P6 4 4 255 " + rng.integers(0, 255, 48, np.uint8).tobytes())
        images.append(Image(f"{n}", str(tmp_path / f"{n}.ppm"), colorspace="LINEAR"))
    profiles = [Profile(f"{n}", (0.0, 3.0, 6.3), (0.0, 1.0, 2.0), tuple(rng.uniform(0, 2, 9))) for n in range(2)]
    lights = [point((n - 0.5, 0.0, 1.0), matrix=MATRIX, program=lamp_program(
        [["uv"], ["image", n, [0], [1]], ["ies", 1 - n, [0], [1]], ["multiply", [2], [6]]], [3], [4], [7]))
        for n in range(2)]
    more = {"images": tuple(images), "profiles": tuple(profiles)}
    together = picture(floor(*lights, **more))
    apart = sum(picture(floor(light, **more)).astype(float) for light in lights)
    np.testing.assert_allclose(together, apart, rtol=1e-5)
    assert not np.allclose(picture(floor(lights[0], **more)), picture(floor(replace(
        lights[0], program=lights[1].program), **more)))


def test_a_mirror_shows_the_same_light():
    """A floor that only mirrors, below one that is lit: from above the same as without, from below."""
    lamp = point((0.2, 0.1, 0.4), program=by_direction(1.0), matrix=MATRIX)
    ceiling = Shape(rectangle((-10, -10), (10, 10), 1.0), WHITE, "ceiling", flags={"visible_camera": False})
    glass = Material("mirror", Od=(0.0,) * 3, ka=0.0, kd=0.0, mirror=(1.0, 1.0, 1.0))
    mirror = Shape(rectangle((-10, -10), (10, 10), 0.0), glass, "mirror")
    seen = Scene.from_shapes([ceiling, mirror], look_down(0, 0, 2.0, 24), [lamp],
                             settings(shadows="SHARP", mode="WHITTED"))
    up = replace(look_down(0, 0, 2.0, 24), matrix=np.diag([1.0, -1.0, -1.0, 1.0]))
    alone = replace(Scene.from_shapes([replace(ceiling, flags={})], up, [lamp], settings(shadows="SHARP")))
    np.testing.assert_allclose(picture(seen), picture(alone)[::-1], rtol=1e-4)


def test_sparse_points_are_not_taken_where_a_lamp_paints(monkeypatch):
    """shadow_rate: a falloff is interpolated, a pattern is computed at each pixel."""
    falloff = lamp_program([["ray_length"], ["multiply", [0], 0.5]], [1], [1], [1])
    edge = lamp_program([["incoming"], ["greater", [0], 0.1]], [3], [3], [3])
    for name, program in (("falloff", falloff), ("edge", edge)):
        scene = floor(point((0.0, 0.0, 1.0), program=program, matrix=MATRIX), pixels=48).with_settings(
            shadows="LIGHT_MESHES", h=0.1)
        exact, sparse = picture(scene), picture(scene.with_settings(shadow_rate=8))
        np.testing.assert_allclose(sparse, exact, rtol=1e-6 if name == "edge" else 0.03)


def test_a_snapshot_holds_it(tmp_path):
    grid = Profile("lamp.ies", (0.0, 1.0), (0.0, 2.0), (1.0, 2.0, 3.0, 4.0))
    scene = floor(point((0.0, 0.0, 1.0), program=lamp_program([["ies", 0, 0.5, 0.5]], [0], [0], [0]), matrix=MATRIX),
                  profiles=(grid,))
    snapshot.write(scene, tmp_path)
    found = snapshot.read(tmp_path)
    assert found.lights == scene.lights and found.profiles == (grid,)
    assert (picture(found) == picture(scene)).all()


@pytest.mark.parametrize(("operations", "says"), [
    ([["corner_normal"]], "means nothing"), ([["attribute", 0]], "means nothing"), ([["instance", 0]], "means nothing"),
    ([["uv", 1, 0.1]], "beside"), ([["ies", 0.5, 1, 1]], "whole number"), ([["ies", 0, 1]], "takes 3"),
])
def test_what_no_lamp_has(operations, says):
    with pytest.raises(SceneError, match=says):
        lamp_program(operations, 1.0, 1.0, 1.0)


def test_what_no_surface_has():
    with pytest.raises(SceneError, match="means nothing"):
        programs.program({"operations": [["ray_length"]], "values": {"ka": 1.0}}, "material")
    with pytest.raises(SceneError, match="no parameter"):
        programs.of_lamp({"operations": [], "values": {"ka": 1.0}}, "light")


@pytest.mark.parametrize("what", ["image", "ies"])
def test_what_is_not_there(what):
    looks = [what, 0, 0.5, 0.5]
    lamp = point((0.0, 0.0, 1.0), program=lamp_program([looks], [0], [0], [0]))
    matt = Material("matt", program=programs.program({"operations": [looks], "values": {"ka": [0]}}, "matt"))
    for scene in (floor(lamp), replace(floor(point((0.0, 0.0, 1.0))), materials=(matt,))):
        with pytest.raises(SceneError, match="does not exist"):
            checked(scene)


@pytest.mark.parametrize(("change", "says"), [
    ({"horizontal": [0.0]}, "two or more"), ({"vertical": [1.0, 0.5]}, "rising"), ({"values": [1.0] * 5}, "5 values"),
    ({"values": [1.0, 2.0, 3.0, float("nan")]}, "finite"), ({"name": 3}, "object of name"), ({"more": 1}, "object of"),
])
def test_profiles_that_are_none(change, says):
    data = {"name": "a", "horizontal": [0.0, 1.0], "vertical": [0.0, 1.0], "values": [1.0, 2.0, 3.0, 4.0]}
    assert profile(data, "profile 0").values == (1.0, 2.0, 3.0, 4.0)
    with pytest.raises(SceneError, match=says):
        profile(data | change, "profile 0")


def test_a_profile_goes_through_its_values():
    rng = np.random.default_rng(3)
    across, up = np.linspace(0, 2 * np.pi, 7), np.linspace(0, np.pi, 5)
    values = rng.uniform(0, 1, (7, 5))
    found = Lookup(Profile("a", tuple(across), tuple(up), tuple(values.ravel())))
    x, y = np.meshgrid(across, up, indexing="ij")
    np.testing.assert_allclose(found(x.ravel(), y.ravel()), values.ravel(), atol=1e-12)
    assert found(np.array([1.0, 7.0, -0.1]), np.array([3.3, 1.0, 1.0])).tolist() == [0.0, 0.0, 0.0]
    flat = Lookup(Profile("a", tuple(across), tuple(up), (0.7,) * 35))
    np.testing.assert_allclose(flat(rng.uniform(0, 6, 50), rng.uniform(0, 3, 50)), 0.7)


def dense(light, run, P, N, side=300):
    """The mean over a face by very many points."""
    t = (np.arange(side) + 0.5) / side * 2 - 1
    a, b = (m.ravel() for m in np.meshgrid(t, t, indexing="ij"))
    u, v, axis = np.array(light.area_u), np.array(light.area_v), np.array(light.direction)
    place = light.position + a[:, None] * u + b[:, None] * v
    way = P - place
    far = np.linalg.norm(way, axis=1)
    cosine = np.maximum(way @ axis / far, 0)
    weight = cosine * np.maximum(-way @ N / far, 0) / far**2
    if light.spread < np.pi - 1e-3:
        weight *= np.maximum(np.tan(light.spread / 2) - np.sqrt(1 - cosine**2) / np.maximum(cosine, 1e-9), 0)
    if light.area_ellipse:
        weight *= a * a + b * b <= 1
    return np.average(run(place, way / far[:, None], np.stack([a, b], 1) / 2 + 0.5), axis=0, weights=weight)


@hypothesis_settings(max_examples=25, deadline=None)
@given(st.floats(0.5, 4.0), st.floats(-0.8, 0.8), st.floats(-0.8, 0.8), st.booleans(),
       st.sampled_from([np.pi, 1.5, 0.5]), st.booleans())
def test_the_mean_over_a_face(height, x, y, ellipse, spread, fixed):
    light = Light("a", "AREA", (1.0,) * 3, position=(0.0, 0.0, height), area_u=(0.5, 0.0, 0.0), area_v=(0.0, 0.3, 0.0),
                  area_ellipse=ellipse, spread=spread, program=lamp_program([["uv"]], [0], [0], [0]))
    P, N = np.array([[x, y, 0.0]]), np.array([[0.3, 0.0, 0.954]])
    if spread < 3 and np.hypot(max(abs(x) - 0.3, 0), max(abs(y) - 0.2, 0)) > 0.5 * height * np.tan(spread / 2):
        return  # out of its light, or nearly

    def run(place, way, uv):
        glow = 0.5 + 0.3 * np.sin(4 * uv[:, :1]) + 0.2 * uv[:, 1:] ** 2
        return np.repeat(glow if fixed else glow * (1 + way[:, :1]), 3, axis=1)

    spaces = Spaces([light], floor().camera, [])

    def of_points(points: Sources):
        return run(points.P, points.incoming, points.uv)
    found = Faces([light], spaces).mean(of_points, fixed, np.zeros(1, np.int64), P, N)
    np.testing.assert_allclose(found[0], dense(light, run, P[0], N[0]), rtol=0.02)
