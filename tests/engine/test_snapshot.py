"""A scene as a folder: it is read back as it was written, and any error in a folder gives one sentence."""

import dataclasses
import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.description import (
    CAUSTICS,
    GLASS,
    HIGHLIGHTS,
    IMAGE_ALPHAS,
    LIGHT_TYPES,
    MODES,
    REFRACTIONS,
    SHADOWS,
    STORED_ALPHAS,
    Camera,
    Image,
    Light,
    Material,
    Object,
    Settings,
)
from light_meshes.scene.errors import SceneError
from scenes import four_lights, tabletop

number = st.floats(-1e6, 1e6)
positive = st.floats(0, 1e6)
triple = st.tuples(number, number, number)
share = st.tuples(*[st.floats(0, 1)] * 3)
name = st.text(max_size=20)
crops = st.one_of(st.none(), st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(10, 16), st.integers(10, 16)))
materials = st.builds(Material, name, Od=triple, ka=number, kd=number, ks=number, Os=triple, nShiny=positive,
                      mirror=triple, emission=triple, kt=triple, ior=st.floats(0.01, 100), priority=st.integers(0, 9),
                      fresnel=st.booleans(), alpha=st.floats(0, 1), highlight=st.sampled_from(HIGHLIGHTS),
                      roughness=st.floats(0, 1), metal=positive, F0=share, F90=share, F82=share, dielectric=positive,
                      dielectric_ior=st.floats(0.1, 100), layered=st.floats(0, 1), compensation=st.floats(0, 1),
                      transparent_shadow=st.booleans())
lights = st.builds(Light, name, st.sampled_from(LIGHT_TYPES), triple, position=triple, direction=triple,
                   spot_angle=number, spot_blend=number, spread=number, radius=positive, angle=number,
                   area_u=triple, area_v=triple, area_ellipse=st.booleans(), soft_shadows=st.booleans(),
                   axes=st.one_of(st.none(), st.tuples(triple, triple, triple)), diffuse=st.booleans(),
                   glossy=st.booleans(),
                   cast_shadow=st.booleans())
chosen = st.builds(
    Settings, mode=st.sampled_from(MODES), shadows=st.sampled_from(SHADOWS), h=st.floats(1e-9, 1e9),
    kI=st.floats(0.5, 8), auto_h=st.booleans(), samples=st.integers(1, 4096), max_depth=st.integers(0, 64),
    reflection_rays=st.integers(1, 1024), cutoff=st.floats(0, 1), ambient=positive, filter_size=st.floats(0, 10),
    refraction=st.sampled_from(REFRACTIONS),
    glass=st.sampled_from(GLASS), caustics=st.sampled_from(CAUSTICS), leak_free=st.booleans(),
    light_samples=st.integers(1, 65536), seed=st.integers(0, 2**31 - 1), film_transparent=st.booleans(),
    lattice_rotation=st.booleans(), lattice_origin=triple, uniform_skip=st.booleans())
images = st.builds(Image, name, st.just("textures/wood.png"), st.sampled_from(["sRGB", "LINEAR"]),
                   st.sampled_from(["LINEAR", "CLOSEST", "CUBIC"]),
                   st.sampled_from(["REPEAT", "EXTEND", "CLIP", "MIRROR"]),
                   st.tuples(triple, triple, triple), st.sampled_from(["", "config.ocio"]), st.just("scene_linear"),
                   st.sampled_from(IMAGE_ALPHAS), st.sampled_from(STORED_ALPHAS))


def as_data(item):
    """Nested plain values, so that arrays compare too."""
    if dataclasses.is_dataclass(item):
        return {f.name: as_data(getattr(item, f.name)) for f in dataclasses.fields(item)}
    if isinstance(item, tuple):
        return [as_data(i) for i in item]
    return item.tolist() if isinstance(item, np.ndarray) else item


@hypothesis_settings(suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(materials, min_size=4, max_size=6), st.lists(lights, max_size=5), st.lists(images, max_size=2),
       chosen, triple, crops, st.lists(name, max_size=3))
def test_what_is_written_is_read_again(tmp_path_factory, materials, lights, images, chosen, world, crop, warnings):
    folder = tmp_path_factory.mktemp("snapshot")
    scene = tabletop(16)
    scene = replace(
        scene, materials=tuple(materials), lights=tuple(lights), images=tuple(images), settings=chosen,
        world_color=world, warnings=tuple(warnings), objects=tuple(Object(w) for w in ("a", "ü", "c")),
        camera=replace(scene.camera, crop=crop))
    snapshot.write(scene, folder)
    found = snapshot.read(folder)
    expected = replace(scene, images=tuple(
        replace(i, path=str(folder / i.path), ocio=i.ocio and str(folder / i.ocio)) for i in images))
    assert as_data(found) == as_data(expected)


def test_the_picture_of_a_snapshot_is_the_scenes(tmp_path):
    scene = four_lights(32)
    snapshot.write(scene, tmp_path)
    np.testing.assert_array_equal(render_image(snapshot.read(tmp_path)).passes["Combined"],
                                  render_image(scene).passes["Combined"])


def test_defaults_may_be_left_out(tmp_path):
    snapshot.write(tabletop(16), tmp_path)
    data = json.loads((tmp_path / "scene.json").read_text())
    data["settings"] = {"kI": 2.0}
    data["lights"] = [{"name": "l", "type": "SUN", "intensity": [1, 2, 3]}]
    (tmp_path / "scene.json").write_text(json.dumps(data))
    scene = snapshot.read(tmp_path)
    assert scene.settings == Settings(kI=2.0)
    assert scene.lights == (Light("l", "SUN", (1.0, 2.0, 3.0)),)


# --- Bad folders ------------------------------------------------------------------------------------------

def change(*path, to):
    """Sets data[path[0]][path[1]]… to a value."""
    def apply(data):
        for key in path[:-1]:
            data = data[key]
        data[path[-1]] = to
    return apply


def drop(*path):
    def apply(data):
        for key in path[:-1]:
            data = data[key]
        del data[path[-1]]
    return apply


BAD_JSON = {
    "version": (change("version", to=99), "version 99"),
    "another format": (change("format", to="x"), "not a Light Meshes snapshot"),
    "unknown entry": (change("volumes", to=[]), "volumes"),
    "no camera": (drop("camera"), "camera"),
    "lights are no list": (change("lights", to={}), "lights"),
    "a light is a number": (change("lights", 0, to=3), "light 0"),
    "light type": (change("lights", 0, "type", to="LASER"), "light 0 'point'.*LASER"),
    "light without intensity": (drop("lights", 0, "intensity"), "intensity"),
    "two numbers for a colour": (change("lights", 0, "intensity", to=[1, 2]), "intensity must be 3"),
    "text for a colour": (change("lights", 0, "intensity", to="red"), "intensity must be 3"),
    "NaN": (change("lights", 0, "position", to=[0, float("nan"), 0]), "position is nan"),
    "infinity": (change("materials", 1, "kd", to=float("inf")), "material 1 'cylinder': kd is inf"),
    "true for a number": (change("settings", "h", to=True), "h is True"),
    "a number for true": (change("settings", "auto_h", to=1), "auto_h is 1"),
    "text for a number": (change("settings", "kI", to="3"), "kI is '3'"),
    "a fraction for a whole number": (change("settings", "samples", to=2.5), "samples is 2.5"),
    "kI too large": (change("settings", "kI", to=20), "kI is 20"),
    "kI too small": (change("settings", "kI", to=0.1), "kI is 0.1"),
    "h zero": (change("settings", "h", to=0), "h is 0"),
    "h below zero": (change("settings", "h", to=-1), "h is -1"),
    "no samples": (change("settings", "samples", to=0), "samples is 0"),
    "mode": (change("settings", "mode", to="PATH_TRACING"), "PATH_TRACING.*WHITTED"),
    "unknown setting": (change("settings", "hh", to=1), "hh"),
    "matrix": (change("camera", "matrix", to=[[1, 2], [3, 4]]), "matrix"),
    "matrix of text": (change("camera", "matrix", to="identity"), "matrix"),
    "window without area": (change("camera", "window", to=[1, 1, 0, 1]), "window"),
    "no pixels": (change("camera", "width", to=0), "width is 0"),
    "too many pixels": (change("camera", "height", to=10**9), "height"),
    "crop outside": (change("camera", "crop", to=[0, 0, 99, 9]), "crop"),
    "empty crop": (change("camera", "crop", to=[5, 5, 5, 9]), "crop"),
    "image of nothing": (change("materials", 0, "image", to=3), "material 'tabletop': image 3"),
    "no material": (change("materials", to=[]), "material"),
    "no object": (change("objects", to=[]), "object"),
    "warnings": (change("warnings", to=[1]), "warnings"),
    "a huge whole number": (change("settings", "seed", to=10**40), "seed"),
    "a whole number that is too long to print": (change("settings", "samples", to=10**400), "samples is 1000"),
    "a number that no float holds": (change("camera", "width", to=1e300), "width is 1e.300; it must be a whole"),
    "a number that no array holds": (change("materials", 0, "priority", to=2**63), "priority is 922"),
    "text without end": (change("settings", "mode", to="X" * 10**6), "mode is 'X.{,90}; choose"),
    "text of several lines": (change("materials", 0, "name", to=["a\nb\r\x1b[2J"]), r"name is \['a\\n"),
    "an object without end": (change("world_color", to=[[{"x" * 999: [0] * 99}] * 99] * 3),
                              r"world_color is \[.{,99}; it must be a finite number"),
    "a key without end": (change("settings", "x" * 10**6, to=1), "no property 'x.{,90}$"),
    "a path out of the folder": (change("images", to=[{"name": "i", "path": "a/../../passwd"}]), r"'i'.*\.\."),
    "blocks elsewhere": (change("blocks", to=["../mesh"]), "blocks names '../mesh'"),
    "instances elsewhere": (change("instances", to="/tmp"), "instances names '/tmp'"),
    "a huge number": (change("world_color", to=[10**400, 0, 0]), "world_color"),
}


@pytest.fixture
def folder(tmp_path):
    snapshot.write(tabletop(16), tmp_path)
    return tmp_path


@pytest.mark.parametrize("case", BAD_JSON)
def test_bad_json_is_named(folder, case):
    edit, sentence = BAD_JSON[case]
    data = json.loads((folder / "scene.json").read_text())
    edit(data)
    (folder / "scene.json").write_text(json.dumps(data))
    with pytest.raises(SceneError, match=sentence) as error:
        snapshot.read(folder)
    assert len(str(error.value)) < 700 and str(error.value).isprintable()


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '"scene"', "\x00", "[" * 100_000, '{"format": 1e999}'])
def test_what_is_no_scene_json_is_said(folder, text):
    (folder / "scene.json").write_text(text)
    with pytest.raises(SceneError, match=r"scene\.json"):
        snapshot.read(folder)


def test_bytes_that_are_no_text_are_said(folder):
    (folder / "scene.json").write_bytes(b"\xff\xfe\x00{")
    with pytest.raises(SceneError, match=r"scene\.json"):
        snapshot.read(folder)


@pytest.mark.parametrize("where", ["nowhere", "vertices.npy", "nowhere.json", "uvs"])
def test_a_folder_without_a_scene_is_no_snapshot(folder, where):
    with pytest.raises(SceneError, match="no snapshot"):
        snapshot.read(folder / where)


def resave(name, edit):
    def apply(folder: Path):
        np.save(folder / name, edit(np.load(folder / name)))
    return apply


def rewrite(name, edit):
    def apply(folder: Path):
        (folder / name).write_bytes(edit((folder / name).read_bytes()))
    return apply


def put(index, value):
    def apply(array):
        array[index] = value
        return array
    return apply


BAD_ARRAYS = {
    "missing": (lambda f: (f / "triangles.npy").unlink(), "triangles.npy"),
    "a pipe": (lambda f: ((f / "uvs.npy").unlink(), os.mkfifo(f / "uvs.npy")), "uvs.npy.*no such file"),
    "a folder": (lambda f: ((f / "uvs.npy").unlink(), (f / "uvs.npy").mkdir()), "uvs.npy"),
    "empty file": (rewrite("vertices.npy", lambda b: b""), "vertices.npy"),
    "cut short": (rewrite("vertices.npy", lambda b: b[:-4]), "vertices.npy is cut short"),
    "too long": (rewrite("vertices.npy", lambda b: b + b"1234"), "vertices.npy"),
    "not numpy": (rewrite("meshes.npy", lambda b: b"PK" + b[2:]), "meshes.npy"),
    "broken header": (rewrite("meshes.npy", lambda b: b[:12] + b"}" * 40 + b[52:]), "meshes.npy"),
    "huge counts": (rewrite("vertices.npy", lambda b: b.replace(b", 3), }           ", b"999999999999, 3), }")),
                    r"vertices.npy is cut short: \d+ of \d{13,} bytes"),
    "float64": (resave("vertices.npy", lambda a: a.astype(np.float64)), "vertices.npy is float64"),
    "big-endian": (resave("vertices.npy", lambda a: a.astype(">f4")), "vertices.npy"),
    "Fortran's order": (resave("vertices.npy", np.asfortranarray), "vertices.npy"),
    "flat": (resave("vertices.npy", lambda a: a.ravel()), "vertices.npy"),
    "two columns": (resave("vertices.npy", lambda a: np.ascontiguousarray(a[:, :2])), "vertices.npy"),
    "fewer normals": (resave("corner_normals.npy", lambda a: a[:-1]), "corner_normals has"),
    "fewer materials": (resave("triangle_materials.npy", lambda a: a[:-1]), "triangle_materials has"),
    "some uvs": (resave("uvs.npy", lambda a: np.zeros((5, 3, 2), np.float32)), "uvs has 5"),
    "fewer matrices": (resave("instance_matrix.npy", lambda a: a[:-1]), "instance_matrix has"),
    "vertex of nothing": (resave("triangles.npy", put((3, 1), 999)), "mesh 0.*vertex"),
    "vertex below zero": (resave("triangles.npy", put((0, 0), -1)), "mesh 0.*vertex"),
    "mesh outside": (resave("meshes.npy", put((2, 1), 10**9)), "mesh 2"),
    "mesh below zero": (resave("meshes.npy", put((1, 2), -1)), "mesh 1"),
    "mesh that wraps": (resave("meshes.npy", put((1, 0), 2**63 - 2)), "mesh 1"),
    "instance of nothing": (resave("instance_mesh.npy", put(0, 3)), "instance_mesh names a mesh"),
    "object of nothing": (resave("instance_object.npy", put(0, -1)), "instance_object names a object"),
    "material of nothing": (resave("triangle_materials.npy", put(0, 77)), "triangle_materials names a material"),
}


@pytest.mark.parametrize("case", BAD_ARRAYS)
def test_bad_arrays_are_named(folder, case):
    edit, sentence = BAD_ARRAYS[case]
    edit(folder)
    with pytest.raises(SceneError, match=sentence):
        snapshot.read(folder)


class Trap:
    """Unpickling it would run code."""

    def __reduce__(self):
        return (Path.touch, (Path("unpickled"),))


def test_pickles_are_not_loaded(folder, monkeypatch):
    monkeypatch.chdir(folder)
    np.save(folder / "vertices.npy", np.array([Trap()], object), allow_pickle=True)
    with pytest.raises(SceneError, match=r"vertices\.npy"):
        snapshot.read(folder)
    assert not (folder / "unpickled").exists()


@hypothesis_settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_happens_to_the_bytes_it_is_read_or_refused(folder, data):
    """Fuzzing: a few bytes of one file changed, or its end cut off."""
    snapshot.write(tabletop(16), folder)
    file = data.draw(st.sampled_from(sorted(p.name for p in folder.glob("*.*"))))
    content = bytearray((folder / file).read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    content = content[:data.draw(st.one_of(st.just(len(content)), st.integers(0, len(content))))]
    (folder / file).write_bytes(content)
    try:
        scene = snapshot.read(folder)
    except SceneError as e:
        assert str(e)
    else:
        assert isinstance(scene.camera, Camera)


@pytest.mark.parametrize(("change", "words"), [
    (lambda d: d["lights"][0].update(intensity=[1e308, 0, 0]), "is 1e+308; it must lie between -1e+30 and 1e+30"),
    (lambda d: d["lights"][0].update(position=[0, -1e31, 0]), "position is -1e+31"),
    (lambda d: d["materials"][0].update(emission=[0, 0, 1e300]), "emission is 1e+300"),
    (lambda d: d["materials"][0].update(kd=1e300), "kd is 1e+300"),
    (lambda d: d.update(world_color=[1e308, 0, 0]), "world_color is 1e+308"),
    (lambda d: d["camera"].update(matrix=[[0, 0, 0, 0]] * 3 + [[0, 0, 0, 1]]), "its matrix is flat"),
    (lambda d: d["camera"]["matrix"][0].__setitem__(0, 1e308), "none beyond 1e+30"),
], ids=range(7))
def test_numbers_that_single_precision_does_not_take(tmp_path, change, words):
    snapshot.write(tabletop(8), tmp_path)
    data = json.loads((tmp_path / "scene.json").read_text())
    change(data)
    (tmp_path / "scene.json").write_text(json.dumps(data))
    with pytest.raises(SceneError, match=re.escape(words)):
        snapshot.read(tmp_path)


@pytest.mark.parametrize("shape", ["(True, 4, 4)", "(-1, 4, 4)", "(1, True, 4)", "(1.0, 4, 4)", "(None,)", "True"])
def test_shapes_that_are_none(tmp_path, shape):
    snapshot.write(tabletop(8), tmp_path)
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(128)
    (tmp_path / "instance_matrix.npy").write_bytes(content)
    with pytest.raises(SceneError, match=r"instance_matrix\.npy") as e:
        snapshot.read(tmp_path)
    assert len(str(e.value)) < 300
