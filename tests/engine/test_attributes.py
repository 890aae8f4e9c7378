"""Attributes of triangles' corners and values of instances: in snapshots and blocks, and in programs."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from light_meshes import Scene, Shape, rectangle
from light_meshes.picture.render import render_image
from light_meshes.scene import programs, snapshot
from light_meshes.scene.description import Material, Settings
from light_meshes.scene.errors import SceneError
from scenes import look_down


@pytest.fixture
def scene():
    """A floor that shines as its corners' second channel and its instance's first say, and as one that is nowhere."""
    program = programs.program({
        "operations": [["attribute", 1], ["instance", 0], ["attribute", 7]],
        "values": {"emission": [[0], [1], [2]]}}, "material")
    material = Material("shining", kd=0.0, ka=0.0, program=program)
    plain = Scene.from_shapes([Shape(rectangle((0, 0), (1, 1), 0.0), material)], look_down(0.5, 0.5, 1.0, 16), [],
                              Settings(filter_size=0.0, samples=1))
    g = plain.geometry
    attributes = np.zeros((len(g.triangles), 3, 2), np.float32)
    attributes[:, :, 1] = g.vertices[g.triangles][:, :, 0]
    return replace(plain, geometry=replace(g, attributes=attributes, instance_values=np.float32([[0.25, 3.0]])))


def test_programs_read_them(scene):
    red, green, blue = np.moveaxis(render_image(scene).passes["Combined"][..., :3], 2, 0)
    assert np.allclose(red, (np.arange(16) + 0.5) / 16, atol=1e-5)
    assert np.allclose(green, 0.25) and (blue == 0).all()


def test_blocks_with_other_channels(scene, tmp_path):
    """Of two blocks with one and with two channels, the first gets a channel of zeros."""
    snapshot.write(scene, tmp_path)
    file = tmp_path / "scene.json"
    for name, channels in (("a", 1), ("b", 2)):
        (tmp_path / name).mkdir()
        for array in ("vertices", "triangles", "corner_normals", "uvs", "triangle_materials", "meshes"):
            shutil.copy(tmp_path / f"{array}.npy", tmp_path / name)
        np.save(tmp_path / name / "attributes.npy", scene.geometry.attributes[:, :, -channels:])
    file.write_text(json.dumps(json.loads(file.read_text()) | {"blocks": ["a", "b"]}))
    found = snapshot.read(file).geometry.attributes
    assert found.shape == (4, 3, 2)
    assert np.array_equal(found[:2, :, 0], found[2:, :, 1]) and (found[:2, :, 1] == 0).all()


def test_a_snapshot_keeps_them(scene, tmp_path):
    snapshot.write(scene, tmp_path)
    again = snapshot.read(tmp_path).geometry
    assert np.array_equal(again.attributes, scene.geometry.attributes)
    assert np.array_equal(again.instance_values, scene.geometry.instance_values)
    (tmp_path / "attributes.npy").unlink()  # as snapshots before had none
    assert snapshot.read(tmp_path).geometry.attributes.shape == (0, 3, 0)


@pytest.mark.parametrize(("name", "array"), [
    ("attributes", np.zeros((1, 3, 2), np.float32)), ("attributes", np.zeros((2, 4, 2), np.float32)),
    ("instance_values", np.zeros((99, 1), np.float32)), ("instance_values", np.zeros((1, 1), np.float64))])
def test_what_does_not_fit_is_said(scene, tmp_path, name, array):
    snapshot.write(scene, tmp_path)
    np.save(tmp_path / f"{name}.npy", array)
    with pytest.raises(SceneError, match=name):
        snapshot.read(tmp_path)


BAD = [["attribute", -1], ["attribute", 0.5], ["attribute", 0, 3, 1.0], ["attribute", 0, 1, 0.0], ["uv", 1],
       ["bump", 0, 0, 0, 0, 0, 1, 1, 1, 0], ["ray", 5], ["voronoi", 5, *[0] * 14]]


@pytest.mark.parametrize("operation", BAD)
def test_bad_operations_are_refused(operation):
    with pytest.raises(SceneError, match="operation 0"):
        programs.program({"operations": [operation], "values": {}}, "material")
