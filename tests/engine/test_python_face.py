"""What `light_meshes` exports to programs: the page docs/python.md as it is printed, names, shapes, sentences."""

import ast
import re
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import light_meshes as lm
import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes.film.images import Framebuffer
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.validation import checked
from scenes import four_lights, look_down, project, tabletop

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^<!-- run -->\n```python\n(.*?)^```\n<!-- end -->$", PAGE, re.M | re.S)
NUMBERS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


# --- The page -----------------------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The folder in which the page's blocks were run, one after the other, and what they left."""
    folder = tmp_path_factory.mktemp("page")
    names = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for block in BLOCKS:
            exec(block, names)
            names.setdefault("first", names["scene"])
    return folder, names


def test_every_block_of_the_page_is_run():
    assert len(BLOCKS) == PAGE.count("```python") == 3
    assert sum(bool(line.strip()) for line in BLOCKS[0].splitlines()) <= 20


def floor_profile(file, scene, x):
    """Brightness of the picture's floor at (x, −.69, 0), over that of the first; between the pixels."""
    pixels = np.asarray(oiio.ImageBuf(str(file)).get_pixels(oiio.FLOAT))[::-1, :, :3].mean(2)
    linear = np.where(pixels > 0.04045, ((pixels + 0.055) / 1.055) ** 2.4, pixels / 12.92)
    columns, rows = np.array([project(scene, (v, -0.69, 0.0)) for v in x]).T * [[scene.camera.width],
                                                                             [scene.camera.height]]
    found = linear[rows.astype(int), columns.astype(int)]
    return found / found[0]


def test_the_pages_scene_has_a_soft_shadow_and_a_sharp_one(page):
    """The light at (1.5, −1.5, 4) throws the slab's upper left edge, x = −.4 and z = .9, to x = −.952 on the floor."""
    folder, names = page
    x = np.linspace(-1.4, -0.6, 161)
    soft, sharp = (floor_profile(folder / name, names["first"], x) for name in ("soft.png", "sharp.png"))
    for profile, off in ((soft, 0.1), (sharp, 0.03)):  # r/2; two pixels
        assert profile[-1] < 0.45  # the shadow, where ambient light is left
        half = (1 + profile[-1]) / 2
        assert x[np.argmax(profile < half)] == pytest.approx(-0.952, abs=off)

    def width(profile):
        share = (profile - profile[-1]) / (1 - profile[-1])
        return ((share > 0.1) & (share < 0.9)).mean() * (x[-1] - x[0])
    assert width(sharp) < 0.03 and 0.12 < width(soft) < 0.4  # r = .2
    inside = soft[(x > -1.05) & (x < -0.85)]
    assert (np.diff(inside) < 0.02).all()  # it falls without noise
    assert (names["shadow"].min(), names["shadow"].max()) == (0, 1)


def test_the_pages_other_blocks(page):
    folder, names = page
    assert max(names["shares"]) == 1 and names["depth"].shape == (320, 480) and 3 < names["depth"].min() < 6
    assert len(snapshot.read(folder / "wave").geometry.triangles) == 2 * 49**2


@pytest.mark.slow
def test_the_page_is_typed(tmp_path):
    """mypy --strict has nothing to say to the page, and something to say to wrong calls."""
    def said(code):
        (tmp_path / "page.py").write_text(code, encoding="utf-8")
        done = subprocess.run([sys.executable, "-m", "mypy", "--strict", "--config-file", ROOT / "pyproject.toml",
                               "--follow-imports", "silent", "--cache-dir", tmp_path / "cache", tmp_path / "page.py"],
                              cwd=tmp_path, capture_output=True, text=True, env={"MYPYPATH": str(ROOT / "engine")})
        return done.stdout + done.stderr
    assert said("\n".join(BLOCKS)).startswith("Success")
    wrong = said('import light_meshes as lm\nlm.rendr\nlm.sphere("large")\nlm.Settings(h="0.1")\n')
    assert wrong.count("page.py") == 3, wrong


# --- Names --------------------------------------------------------------------------------------------------

def test_all_names_are_there():
    assert lm.__all__ == sorted(lm.__all__, key=lambda name: (not name.isupper(), not name[0].isupper(), name))
    assert set(lm.__all__) <= set(dir(lm)) and all(getattr(lm, name) is not None for name in lm.__all__)
    with pytest.raises(AttributeError, match="rendr"):
        _ = lm.rendr


def test_names_for_type_checkers_are_those_that_are_imported():
    tree = ast.parse(Path(lm.__file__).read_text(encoding="utf-8"))
    (both,) = (n for n in tree.body if isinstance(n, ast.If) and isinstance(n.test, ast.Name))
    typed = {n.module: tuple(a.name for a in n.names) for n in both.body}
    assert typed == lm._MODULES
    assert {name for names in typed.values() for name in names} | {"__version__"} == set(lm.__all__)


def test_every_name_stands_on_the_page():
    assert not {name for name in lm.__all__ if f"`{name}" not in PAGE} - {"__version__"}


@pytest.mark.parametrize(("use", "without"), [("__version__", {"numpy"}), ("Scene", {"embreex", "OpenImageIO"})])
def test_a_name_brings_no_more_than_it_needs(use, without):
    code = f"import sys, light_meshes; light_meshes.{use}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not without & set(done.stdout.split())


# --- Scenes -------------------------------------------------------------------------------------------------

def test_a_program_gets_the_picture_of_the_engine(tmp_path):
    scene = four_lights(48, shadows="LIGHT_MESHES", samples=2)
    heard = []
    picture = lm.render(scene, ["Combined", "Depth"], threads=1, progress=lambda share, stage: heard.append(share))
    expected = render_image(scene, ("Combined", "Depth"))
    for name in ("Combined", "Depth"):
        np.testing.assert_array_equal(picture.passes[name], expected.passes[name])
    assert heard[0] == 0 and heard[-1] == 1
    picture.save(str(tmp_path / "picture.exr"))
    read = np.asarray(oiio.ImageBuf(str(tmp_path / "picture.exr")).get_pixels(oiio.FLOAT))
    np.testing.assert_array_equal(read[::-1, :, :4], expected.passes["Combined"])


def test_a_render_can_be_cancelled():
    with pytest.raises(lm.Cancelled):
        lm.render(tabletop(64), cancelled=lambda: True)


def test_a_snapshot_is_the_scene(tmp_path):
    scene = four_lights(24)
    lm.write_snapshot(scene, str(tmp_path / "kept"))
    again = lm.read_snapshot(str(tmp_path / "kept"))
    np.testing.assert_array_equal(lm.render(again).passes["Combined"], lm.render(scene).passes["Combined"])


def test_lists_and_arrays_mean_what_tuples_do():
    tidy = four_lights(16)
    loose = replace(
        tidy, lights=[replace(light, position=np.float32(light.position), intensity=list(light.intensity))
                      for light in tidy.lights],
        materials=[replace(m, Od=np.array(m.Od)) for m in tidy.materials], world_color=np.array(tidy.world_color),
        settings=replace(tidy.settings, samples=np.int64(1), kI=np.float64(tidy.settings.kI)))
    assert checked(loose).materials == tidy.materials and checked(loose).settings == tidy.settings
    assert checked(loose).lights == tuple(
        replace(light, position=tuple(np.float32(light.position).tolist())) for light in tidy.lights)
    assert all(type(v) is tuple for v in (checked(loose).lights[0].position, checked(loose).world_color))


def test_meshes_are_shared_by_shapes_of_one_material():
    mesh, red, blue = lm.box((0, 0, 0), (1, 1, 1)), lm.Material("red"), lm.Material("blue")
    places = [lm.translate(2, 0, 0), lm.translate(4, 0, 0)]
    shapes = [lm.Shape(mesh, red, "a"), lm.Shape(mesh, red, "b", places), lm.Shape(mesh, blue, "c")]
    scene = lm.Scene.from_shapes(shapes, look_down(0, 0, 1, 8))
    g = scene.geometry
    assert scene.materials == (red, blue) and [o.name for o in scene.objects] == ["a", "b", "c"]
    assert g.instance_mesh.tolist() == [0, 0, 0, 1] and g.instance_object.tolist() == [0, 1, 1, 2]
    assert g.meshes.tolist() == [[0, 8, 0, 12], [8, 8, 12, 12]] and set(g.triangle_materials[12:]) == {1}
    np.testing.assert_array_equal(g.instance_matrix[1:3, 0, 3], [2, 4])


def test_a_mesh_may_have_several_materials_and_uvs():
    square = lm.rectangle((0, 0), (1, 1))
    uvs = square.vertices[square.triangles][..., :2]
    g = lm.Geometry.from_meshes([lm.Mesh(square.vertices, square.triangles, uvs=uvs), lm.box((0, 0, 0), (1, 1, 1))],
                                [np.array([2, 1]), 0], [(0, 0, np.eye(4)), (1, 0, lm.scale(1, 2, 3))])
    assert g.triangle_materials.tolist() == [2, 1] + [0] * 12
    np.testing.assert_array_equal(g.uvs, np.concatenate([uvs, np.zeros((12, 3, 2))]).astype(np.float32))
    plain = lm.Geometry.from_meshes([square, square])
    assert plain.instance_mesh.tolist() == plain.instance_object.tolist() == [0, 1] and not len(plain.uvs)


def test_an_empty_scene_is_one():
    world = lm.Scene.from_shapes([], look_down(0, 0, 1, 4), world_color=(0.25, 0.5, 0.75))
    np.testing.assert_allclose(lm.render(world).passes["Combined"][0, 0, :3], (0.25, 0.5, 0.75))


# --- Shapes and matrices ------------------------------------------------------------------------------------

SOLIDS = {"box": (lm.box((-1, -2, -3), (1, 2, 3)), 48.0),
          "cylinder": (lm.cylinder(1, 0, 2, 200, smooth=True), 2 * np.pi),
          "sphere": (lm.sphere(1, 200, 100), 4 * np.pi / 3), "tetrahedra": (lm.sphere(1, 3, 2), np.sqrt(3) / 2)}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_face_outwards(name):
    """Their volume by the divergence theorem; each edge is there once in each direction; normals stand on faces."""
    mesh, volume = SOLIDS[name]
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=1e-3)
    edges = {(i, j) for t in mesh.triangles.tolist() for i, j in zip(t, t[1:] + t[:1], strict=True)}
    assert len(edges) == 3 * len(mesh.triangles) and edges == {(j, i) for i, j in edges}
    normals, faces = mesh.corner_normals(), np.cross(b - a, c - a)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1)
    cosine = np.einsum("tkc,tc->tk", normals, faces / np.linalg.norm(faces, axis=1, keepdims=True))
    assert cosine.min() > (0.2 if name == "tetrahedra" else 0.99)


def test_rotations_turn_axis_to_axis():
    x, y, z = np.eye(3)
    for turn, start, end in ((lm.rotate_x, y, z), (lm.rotate_y, z, x), (lm.rotate_z, x, y)):
        np.testing.assert_allclose(turn(np.pi / 2)[:3, :3] @ start, end, atol=1e-15)
        np.testing.assert_allclose(turn(0.3) @ turn(-0.3), np.eye(4), atol=1e-15)


@pytest.mark.parametrize("eye", [(3, -4, 5), (0, 0, 9), (0, -7, 0), (0, 0, -2)])
@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, 2, 3)])
def test_cameras_look_where_they_are_told_and_stand_upright(eye, up):
    camera = lm.Camera.look_at(eye, (0.5, 0.25, 1), 40, 30, 20, up=up)
    turn = camera.matrix[:3, :3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1)
    way = np.array([0.5, 0.25, 1]) - eye
    np.testing.assert_allclose(-turn[:, 2], way / np.linalg.norm(way))
    assert turn[:, 1] @ up > 0 and abs(turn[:, 0] @ up) < 1e-12
    assert project(replace(tabletop(8), camera=camera), (0.5, 0.25, 1)) == pytest.approx((0.5, 0.5))


def test_a_camera_that_looks_along_up_is_told_another():
    for up in NUMBERS[1:]:
        turn = lm.Camera.look_at(up, (0, 0, 0), 40, 8, 8, up=up).matrix[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    np.testing.assert_array_equal(lm.Camera.look_at((0, 0, 5), (0, 0, 0), 40, 8, 8).matrix[:3, :3], np.eye(3))


def test_fields_of_view_are_those_of_the_longer_side():
    for width, height in ((40, 20), (20, 40)):
        left, right, bottom, top = lm.Camera.look_at((0, 0, 5), (0, 0, 0), 90, width, height).window
        assert sorted([right - left, top - bottom]) == pytest.approx([1, 2])
        left, right, bottom, top = lm.Camera.orthographic((0, 0, 5), (0, 0, 0), 6.0, width, height).window
        assert sorted([right - left, top - bottom]) == [3, 6]


# --- Sentences ----------------------------------------------------------------------------------------------

SQUARE, CAMERA = lm.rectangle((0, 0), (1, 1)), look_down(0, 0, 1, 4)
GOOD = lm.Scene.from_shapes([lm.Shape(SQUARE)], CAMERA, [lm.Light("lamp", "POINT", (1.0, 1.0, 1.0))])


def scene(**changes):
    return lambda: lm.render(replace(GOOD, **changes))


def geometry(**changes):
    return scene(geometry=replace(GOOD.geometry, **changes))


def light(**changes):
    return scene(lights=[replace(GOOD.lights[0], **changes)])


WRONG = {
    "vertices of two numbers": (lambda: lm.Mesh([(0, 0), (1, 1)], []), r"vertices must have the shape \(n, 3\), not"),
    "vertices of words": (lambda: lm.Mesh([("a", "b", "c")], []), "vertices must be numbers"),
    "ragged vertices": (lambda: lm.Mesh([(0, 0, 0), (1, 1)], []), "vertices must be numbers"),
    "quads": (lambda: lm.Mesh(np.zeros((4, 3)), [(0, 1, 2, 3)]),
              r"triangles must have the shape \(n, 3\), not \(1, 4\)"),
    "ragged triangles": (lambda: lm.Mesh(np.zeros((4, 3)), [(0, 1, 2), (0, 1)]), "triangles must be numbers"),
    "triangles of floats": (lambda: lm.Mesh(NUMBERS, [(0.0, 1.0, 2.0)]),
                            "whole numbers, which name vertices, not float"),
    "no such vertex": (lambda: lm.Mesh(NUMBERS, [(0, 1, 2), (1, 2, 3)]),
                       r"triangle 1 of a mesh is \[1, 2, 3\], but the mesh has 3 vertices"),
    "a vertex below 0": (lambda: lm.Mesh(NUMBERS, [(0, 1, -1)]), r"triangle 0 of a mesh is \[0, 1, -1\]"),
    "normals of vertices": (lambda: lm.Mesh(NUMBERS, [(0, 1, 2)], normals=NUMBERS),
                            r"normals must have .* \(1, 3, 3\)"),
    "uvs of vertices": (lambda: lm.Mesh(NUMBERS, [(0, 1, 2)], uvs=np.zeros((3, 2))), r"uvs must have .* \(1, 3, 2\)"),
    "a flat box": (lambda: lm.box((0, 0), (1, 1)), r"low must have the shape \(3,\), not \(2,\)"),
    "two sides": (lambda: lm.cylinder(1, 0, 1, 2), "sides must be a whole number from 3 up, not 2"),
    "half a segment": (lambda: lm.sphere(1, 3.5), "segments must be a whole number from 3 up, not 3.5"),
    "no matrix": (lambda: lm.Scene.from_shapes([lm.Shape(SQUARE, matrices=np.eye(4))], CAMERA),
                  r"matrix of instance 0 must have the shape \(4, 4\), not \(4,\)"),
    "a mesh for a shape": (lambda: lm.Scene.from_shapes([SQUARE], CAMERA),
                           "shape 0 is of type Mesh; a Shape holds a mesh"),
    "a name for a material": (lambda: lm.Scene.from_shapes([lm.Shape(SQUARE, "red", "floor")], CAMERA),
                              "shape 0 'floor': its material is of type str; it must be of type Material"),
    "a colour that is a list": (lambda: lm.Scene.from_shapes([lm.Shape(SQUARE, lm.Material("m", [1, 0, 0]))], CAMERA),
                                "colours of its material must be tuples"),
    "an unknown flag": (lambda: lm.Scene.from_shapes([lm.Shape(SQUARE, flags={"visible": True})], CAMERA),
                        "an object has no 'visible'; it has name, visible_camera"),
    "too few materials": (lambda: lm.Geometry.from_meshes([SQUARE, SQUARE], [0]), "2 meshes, but materials for 1"),
    "materials of other triangles": (lambda: lm.Geometry.from_meshes([SQUARE], [np.zeros(3, int)]),
                                     "one material, or one for each of its triangles"),
    "eye and target in one place": (lambda: lm.Camera.look_at((1, 2, 3), (1, 2, 3), 40, 8, 8), "must be two points"),
    "a wide view": (lambda: lm.Camera.look_at((1, 2, 3), (0, 0, 0), 180, 8, 8), "180 degrees; .* between 0 and 180"),
    "a view of a word": (lambda: lm.Camera.look_at((1, 2, 3), (0, 0, 0), "wide", 8, 8),
                         "field of view must be numbers"),
    "half a pixel": (lambda: lm.Camera.look_at((1, 2, 3), (0, 0, 0), 40, 8.5, 8), "width in pixels must be a whole"),
    "an eye of two numbers": (lambda: lm.Camera.look_at((1, 2), (0, 0, 0), 40, 8, 8),
                              r"eye must have the shape \(3,\)"),
    "no scene": (lambda: lm.render(SQUARE), "what is rendered must be of type Scene, not Mesh"),
    "no pass": (lambda: lm.render(GOOD, ["Fog"]), "there is no pass 'Fog'; there are Combined, "),
    "a pass for a list": (lambda: lm.render(GOOD, "Combined"), "passes must be a list of names, not 'Combined'"),
    "no threads": (lambda: lm.render(GOOD, threads=0), "threads are 0; they must be a whole number from 1 up"),
    "no camera": (scene(camera=None), "scene: camera must be of type Camera, not NoneType"),
    "a light for lights": (scene(lights=GOOD.lights[0]), "scene: lights must be of type tuple, not Light"),
    "a word for a light": (scene(lights=["lamp"]), "light 0 must be of type Light, not str"),
    "a lamp of no type": (light(type="LASER"), "light 0 'lamp': type is 'LASER'; choose one of POINT, SUN"),
    "a grey intensity": (light(intensity=3.0), "light 0 'lamp': intensity must be 3 numbers"),
    "a place nowhere": (light(position=(0.0, np.nan, 0.0)), "light 0 'lamp': position is nan"),
    "receivers that are none": (light(receivers=(7,)), "light 'lamp' has a receiver that does not exist"),
    "blockers that are none": (scene(objects=tuple(replace(ob, blockers=(-1,)) for ob in GOOD.objects)),
                               "has a blocker that does not exist"),
    "h of 0": (lambda: lm.render(GOOD.with_settings(h=0.0)), "settings: h is 0; it must lie between"),
    "h of a word": (lambda: lm.render(GOOD.with_settings(h="fine")),
                    "settings: h is 'fine'; it must be a finite number"),
    "no such setting": (lambda: GOOD.with_settings(hh=1), "there is no setting 'hh'; there are mode, shadows, h, "),
    "a flat camera": (scene(camera=replace(CAMERA, matrix=np.zeros((4, 4)))), "camera: its matrix is flat"),
    "a camera of three rows": (scene(camera=replace(CAMERA, matrix=np.eye(3))), "camera: matrix must be 4 rows of 4"),
    "vertices in float64": (geometry(vertices=SQUARE.vertices),
                            r"geometry: vertices is float64 \(4, 3\); needed: float32 \(n, 3\)"),
    "vertices in a list": (geometry(vertices=[(0, 0, 0)]), "geometry: vertices must be of type ndarray, not list"),
    "normals too few": (geometry(corner_normals=GOOD.geometry.corner_normals[:1]),
                        "corner_normals has 1 rows; needed: 2"),
    "a material that is none": (geometry(triangle_materials=np.full(2, 3, np.int32)),
                                "triangle_materials names a material that does not exist"),
    "a missing image": (scene(materials=(lm.Material("m", image=0),)), "material 'm': image 0 does not exist"),
    "a snapshot of nothing": (lambda: lm.write_snapshot(None, "nowhere"), "must be of type Scene, not NoneType"),
    "a snapshot nowhere": (lambda: lm.read_snapshot("nowhere"), "nowhere is no snapshot"),
    "a picture of no kind": (lambda: lm.render(GOOD).save("picture.gif"), "pictures are written as .png or .exr"),
    "a picture nowhere": (lambda: lm.render(GOOD).save("nowhere/picture.png"), "the folder nowhere does not exist"),
    "a png of depths": (lambda: lm.render(GOOD, ["Depth"]).save("depth.png"), "a .png shows the pass Combined"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_calls_are_told_in_a_sentence(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, sentence = WRONG[case]
    with pytest.raises(lm.SceneError, match=sentence):
        call()
    assert not list(tmp_path.iterdir())


def test_a_picture_has_all_that_a_result_has():
    result = render_image(GOOD)
    picture = lm.render(GOOD)
    assert isinstance(picture, type(result)) and isinstance(picture.frame, Framebuffer)
    assert {f.name for f in fields(picture)} == {f.name for f in fields(result)} | {"to_rec709"}
