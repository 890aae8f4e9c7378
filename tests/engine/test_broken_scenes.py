"""H10, H13 and worlds far larger than h: a correct picture or a clear sentence, never a hang, a crash or a NaN."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from light_meshes import Camera, Mesh, Scene, Shape, box, rectangle, scale, sphere, translate
from light_meshes.picture.render import render_image
from light_meshes.scene.description import SHADOWS, Light
from light_meshes.scene.errors import SceneError
from scenes import GREY, WHITE, four_lights, joined, look_down, point, settings, sun, tabletop, with_lights

SUPPORT = Path(__file__).parents[1] / "support"

PASSES = ("Combined", "Depth", "Normal", "Shadow")


def finite(result):
    return all(np.isfinite(p).all() for p in result.passes.values())


def with_part(mesh, name="extra", **values):
    floor = Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor")
    return Scene.from_shapes([floor, Shape(mesh, GREY, name)], Camera.look_at((2, -3, 2), (0, 0, 0), 45, 32, 32),
                             [point((1, 1, 3))], settings(h=0.1, **values))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 3e38])
def test_an_object_with_a_vertex_that_is_no_number_is_named(bad):
    broken = sphere(0.5, 8, 6)
    broken.vertices[7, 1] = bad
    scene = with_part(broken, "broken ball")
    try:
        result = render_image(scene, PASSES)
    except SceneError as e:
        assert "broken ball" in str(e) or "unit" in str(e)
    else:
        assert finite(result)
        if not np.isfinite(bad):
            assert any("broken ball" in w for w in result.warnings)


@pytest.mark.parametrize(("vertices", "triangles"), [
    (np.zeros((0, 3)), np.zeros((0, 3), int)),
    (np.ones((1, 3)), np.zeros((0, 3), int)),
    (np.ones((1, 3)), np.array([(0, 0, 0)])),
    (np.ones((3, 3)), np.array([(0, 1, 2)])),
    (np.array([(0, 0, 1), (1, 0, 1), (2, 0, 1)], float), np.array([(0, 1, 2)])),
], ids=["no vertex", "one vertex", "a triangle of one vertex", "a triangle of one place", "a line"])
def test_meshes_without_an_area_change_nothing(vertices, triangles):
    there = render_image(with_part(Mesh(vertices, triangles)), PASSES)
    gone = render_image(with_part(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))), PASSES)
    assert finite(there)
    for name in PASSES:
        np.testing.assert_allclose(there.passes[name], gone.passes[name], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("shadows", SHADOWS)
def test_no_lights_leave_the_ambient_light(shadows):
    result = render_image(with_lights(tabletop(32, shadows=shadows, ambient=2.0)), PASSES)
    scene = tabletop(32, ambient=2.0)
    top = result.passes["Normal"][..., 2] == 1
    colours = {tuple(np.float32(2 * 0.05 * np.array(m.Od))) for m in scene.materials}
    assert {tuple(c) for c in result.passes["Combined"][top][:, :3]} <= colours
    assert finite(result)


@pytest.mark.parametrize("shadows", SHADOWS)
def test_lights_without_energy_add_nothing(shadows):
    scene = four_lights(32, shadows=shadows, light_samples=4)
    off = with_lights(scene, *scene.lights, *(replace(light, intensity=(0.0, 0.0, 0.0)) for light in scene.lights))
    np.testing.assert_array_equal(render_image(off).passes["Combined"], render_image(scene).passes["Combined"])


@pytest.mark.parametrize("shadows", SHADOWS)
def test_an_empty_scene_is_the_world(shadows):
    scene = Scene.from_shapes([], look_down(0, 0, 1, 16), [point((0, 0, 3))], settings(shadows=shadows, auto_h=True),
                              world_color=(0.25, 0.5, 0.75))
    result = render_image(scene, PASSES)
    assert (result.passes["Combined"] == np.float32([0.25, 0.5, 0.75, 1])).all()
    assert finite(result)


@pytest.mark.parametrize("auto_h", [True, False])
def test_a_scene_all_hidden_from_the_camera_is_the_world(auto_h):
    scene = tabletop(16, auto_h=auto_h)
    hidden = replace(scene, objects=tuple(replace(o, visible_camera=False) for o in scene.objects))
    assert (render_image(hidden).passes["Combined"] == np.float32([0.05, 0.05, 0.05, 1])).all()


def test_a_light_whose_size_nothing_opaque_tells_has_the_scenes_radius():
    """All that could block it is glass: there is nothing to measure its blur by."""
    scene = tabletop(16)
    scene = replace(scene, materials=tuple(replace(m, kt=(0.5, 0.5, 0.5)) for m in scene.materials))
    sized = with_lights(scene, replace(scene.lights[0], softness="LIGHT_SIZE", radius=0.1))
    np.testing.assert_array_equal(render_image(sized).passes["Combined"], render_image(scene).passes["Combined"])


@pytest.mark.parametrize("auto_h", [True, False])
def test_a_camera_that_looks_at_nothing_sees_the_world(auto_h):
    scene = tabletop(16, auto_h=auto_h)
    away = Camera.look_at((0, 0, 9), (0, 0, 20), 40, 16, 16)
    picture = render_image(replace(scene, camera=away)).passes["Combined"]
    assert (picture == np.float32([0.05, 0.05, 0.05, 1])).all()


def test_a_camera_inside_a_solid_sees_its_unlit_inside():
    scene = replace(tabletop(32), camera=Camera.look_at((0.01, 0.02, 1.0), (1, 0.3, 1.0), 40, 32, 32),
                    world_color=(0.0, 0.0, 0.0))
    result = render_image(scene, PASSES)
    assert finite(result)
    assert (result.passes["Combined"][..., :3] == 0).all()
    assert (result.passes["Depth"] < 0.7).all()


def test_a_light_inside_a_closed_box_stays_in_it():
    """H4 for opaque surfaces: 1 inside, 0 outside."""
    shell = box((-1, -1, 0.0), (1, 1, 2))
    parts = [Shape(rectangle((-6, -6), (6, 6), -0.5), WHITE, "floor"), Shape(shell, GREY, "box")]
    for shadows in ("SHARP", "LIGHT_MESHES"):
        outside = Scene.from_shapes(parts, Camera.look_at((4, -5, 4), (0, 0, 0), 45, 48, 48), [point((0.2, 0.1, 0.9))],
                                    settings(h=0.1, shadows=shadows))
        assert (render_image(outside).passes["Combined"][..., :3] == 0).all()
        inside = replace(outside, camera=Camera.look_at((-0.8, -0.7, 1.8), (0.5, 0.6, 0.2), 60, 48, 48))
        assert (render_image(inside, ("Shadow",)).passes["Shadow"] == 1).all()


@pytest.mark.parametrize("shadows", ["SHARP", "LIGHT_MESHES"])
def test_a_floor_of_slivers_is_a_floor(shadows):
    """H10: triangles of 10⁴:1 with faces of no area between them, under a light at a tenth of a degree."""
    x = np.linspace(-2, 2, 2001)
    rows = np.vstack([np.c_[x, np.full(2001, y), np.zeros(2001)] for y in (-20.0, 20.0)])
    a = np.arange(2000)
    slivers = np.vstack([np.c_[a, a + 1, a + 2002], np.c_[a, a + 2002, a + 2001], np.c_[a, a, a + 1]])
    low = np.tan(np.radians(0.1))
    pictures = [render_image(Scene.from_shapes(
        [Shape(mesh, WHITE, "floor"), Shape(box((0.2, -0.3, 0.0), (0.6, 0.3, 0.002)), GREY, "step")],
        look_down(0.3, 0, 3, 64), [sun((1, 0.3, -low))], settings(h=0.05, shadows=shadows)), PASSES)
        for mesh in (Mesh(rows, slivers), rectangle((-2, -20), (2, 20), 0.0))]
    assert finite(pictures[0])
    assert (pictures[0].passes["Depth"] < 11).all()  # no holes
    np.testing.assert_allclose(pictures[0].passes["Combined"], pictures[1].passes["Combined"], rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("kI", [0.5, 8.0])
def test_the_ends_of_kIs_range_render(kI):  # noqa: N802
    result = render_image(tabletop(48, kI=kI), PASSES)
    assert finite(result)
    assert 0 < result.passes["Shadow"].mean() < 1
    assert result.statistics["empty_sets"] > 0 if kI == 0.5 else result.statistics["empty_sets"] == 0


def test_a_singular_matrix_gives_a_flat_object_and_no_nan():
    scene = Scene.from_shapes([Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor"),
                               Shape(sphere(0.5, 12, 8), WHITE, "flat", [translate(0, 0, 1) @ scale(1, 1, 0)]),
                               Shape(box((0, 0, 0), (1, 1, 1)), WHITE, "gone", [scale(0, 0, 0)])],
                              Camera.look_at((2, -3, 2), (0, 0, 0), 45, 32, 32), [point((1, 1, 3))], settings(h=0.1))
    assert finite(render_image(scene, PASSES))


def test_an_instance_whose_matrix_is_no_number_is_named():
    scene = with_part(sphere(0.5, 8, 6), "lost ball")
    matrix = scene.geometry.instance_matrix.copy()
    matrix[1, 0, 3] = np.nan
    result = render_image(replace(scene, geometry=replace(scene.geometry, instance_matrix=matrix)), PASSES)
    assert finite(result)
    assert any("lost ball" in w for w in result.warnings)


@pytest.mark.parametrize("light", [
    Light("far", "POINT", (1e20, 1e20, 1e20), position=(1e10, 2e10, 3e10)),
    Light("lamp on the floor", "POINT", (1.0, 1.0, 1.0), position=(0.5, 0.5, 0.0)),
    Light("no way", "SUN", (1.0, 1.0, 1.0), direction=(0.0, 0.0, 0.0)),
    Light("closed", "SPOT", (1.0, 1.0, 1.0), position=(0, 0, 3), spot_angle=0.0),
    Light("open", "SPOT", (1.0, 1.0, 1.0), position=(0, 0, 3), spot_angle=np.pi, spot_blend=1.0),
], ids=lambda light: light.name)
def test_odd_lights_give_a_finite_picture(light):
    assert finite(render_image(with_lights(tabletop(32).with_settings(shadows="LIGHT_MESHES"), light), PASSES))


def test_a_distant_lamp_is_a_sun():
    far, way = 1e7, np.array([0.3, -0.4, 0.866])
    lamp = Light("lamp", "POINT", (far**2,) * 3, position=tuple((far * way / np.linalg.norm(way)).tolist()))
    scene = tabletop(64)
    pictures = [render_image(with_lights(scene, light)).passes["Combined"] for light in (lamp, sun(-way))]
    differs = np.abs(pictures[0] - pictures[1]).max(-1) > 1e-4
    assert differs.mean() < 1e-3  # a node at a shadow's edge may fall to either side


def test_a_world_of_a_hundred_thousand_steps_needs_no_more_memory():
    """No dense grid: a floor 10⁵·h across (10¹⁵ lattice nodes in its cube) against one of 10³·h."""
    def peak(size):
        code = f"""
import numpy as np
from light_meshes.picture.render import render_image
from light_meshes.support.statistics import peak_memory
from light_meshes import Camera, Scene, Shape, box, rectangle
from scenes import GREY, point, settings
parts = [Shape(rectangle((-{size}, -{size}), ({size}, {size}), 0.0), GREY, "floor"),
         Shape(box((-.2, -.2, 0), (.2, .2, .6)), GREY, "post"),
         Shape(box(({size} - 1, 0, 0), ({size}, 1, {size})), GREY, "tower")]
camera = Camera.look_at((2, -3, 2), (0, 0, 0), 60, 128, 128)
scene = Scene.from_shapes(parts, camera, [point((1, 1, 3))], settings(h=0.05))
picture = render_image(scene).passes["Combined"]
assert np.isfinite(picture).all() and (picture[..., 0] > 0).mean() > .3
print(peak_memory())
"""
        done = subprocess.run([sys.executable, "-c", code], cwd=SUPPORT, text=True,
                              capture_output=True, timeout=120)
        assert done.returncode == 0, done.stderr
        return int(re.findall(r"\d+", done.stdout)[-1])

    assert peak(2500.0) < peak(25.0) + 100_000_000  # bytes; only what the camera sees has nodes


def test_auto_h_is_not_moved_by_a_kilometre_of_ground():
    near = tabletop(64, auto_h=True)
    ground = Shape(rectangle((-1000, -1000), (1000, 1000), -0.3), GREY, "ground")
    both = Scene.from_shapes([ground], near.camera, near.lights, near.settings)
    h = {name: render_image(s).statistics["h"] for name, s in (("table", near), ("ground", joined(near, both)))}
    assert h["ground"] == pytest.approx(h["table"], rel=0.5)
    small = replace(near, geometry=replace(near.geometry, instance_matrix=scale(1e-3, 1e-3, 1e-3)
                                           @ near.geometry.instance_matrix))
    camera = np.array(near.camera.matrix)
    camera[:3, 3] *= 1e-3
    small = replace(small, camera=replace(near.camera, matrix=camera, clip_start=1e-6))
    assert render_image(small).statistics["h"] == pytest.approx(h["table"] * 1e-3, rel=0.05)


def test_a_pass_that_does_not_exist_is_named():
    with pytest.raises(SceneError, match="Glossiness"):
        render_image(tabletop(8), ("Combined", "Glossiness"))


def test_one_pixel_is_a_picture():
    camera = Camera(translate(0, 0, 5), (-0.1, 0.1, -0.1, 0.1), 1, 1)
    assert render_image(replace(tabletop(8), camera=camera)).passes["Combined"].shape == (1, 1, 4)
