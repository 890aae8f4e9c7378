"""Snapshots whose meshes are in blocks, and folders with several scenes, as the viewport writes them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from light_meshes.scene import snapshot
from light_meshes.scene.description import Scene
from light_meshes.scene.errors import SceneError
from scenes import tabletop
from test_snapshot import as_data, put, resave, rewrite

MESHES = ("vertices", "triangles", "corner_normals", "uvs", "triangle_materials", "meshes")
INSTANCES = ("instance_mesh", "instance_object", "instance_matrix")


def in_blocks(folder: Path, scene: Scene, names=("mesh-1", "mesh-4", "x_2"), instances="instances-12"):
    """`scene` as the add-on's viewport writes it: a block a mesh, and a scene file beside others."""
    snapshot.write(scene, folder)
    g = scene.geometry
    for block, (v0, nv, t0, nt) in zip(names, g.meshes.tolist(), strict=True):
        (folder / block).mkdir()
        for name in MESHES:
            part = slice(v0, v0 + nv) if name == "vertices" else slice(t0, t0 + nt)
            array = np.array([[0, nv, 0, nt]]) if name == "meshes" else getattr(g, name)[part]
            np.save(folder / block / f"{name}.npy", array)
    (folder / instances).mkdir()
    for name in INSTANCES:
        (folder / f"{name}.npy").rename(folder / instances / f"{name}.npy")
    for name in MESHES:
        (folder / f"{name}.npy").unlink()
    data = json.loads((folder / "scene.json").read_text()) | {"blocks": list(names), "instances": instances}
    (folder / "scene.json").unlink()
    (folder / "scene-12.json").write_text(json.dumps(data))
    return folder / "scene-12.json"


@pytest.mark.parametrize("mapped", [True, False])
def test_a_scene_in_blocks_is_the_scene(tmp_path, mapped):
    scene = tabletop(16)
    assert as_data(snapshot.read(in_blocks(tmp_path, scene), mapped)) == as_data(scene)


def test_one_folder_holds_successive_scenes_that_share_blocks(tmp_path):
    first = in_blocks(tmp_path, tabletop(16))
    data = json.loads(first.read_text()) | {"blocks": ["x_2", "mesh-1"], "instances": "instances-13"}
    (tmp_path / "instances-13").mkdir()
    for name in INSTANCES:
        array = np.load(tmp_path / "instances-12" / f"{name}.npy")[:2]
        np.save(tmp_path / "instances-13" / f"{name}.npy", array)
    (tmp_path / "scene-13.json").write_text(json.dumps(data))
    g, whole = snapshot.read(tmp_path / "scene-13.json").geometry, tabletop(16).geometry
    assert len(g.instance_mesh) == 2 and len(g.meshes) == 2
    for mine, theirs in ((0, 2), (1, 0)):
        (v0, nv, t0, nt), (w0, _, s0, _) = g.meshes[mine], whole.meshes[theirs]
        np.testing.assert_array_equal(g.vertices[v0:v0 + nv], whole.vertices[w0:w0 + nv])
        np.testing.assert_array_equal(g.triangles[t0:t0 + nt], whole.triangles[s0:s0 + nt])
    assert as_data(snapshot.read(first)) == as_data(tabletop(16))


def test_no_block_is_no_mesh(tmp_path):
    file = in_blocks(tmp_path, tabletop(16))
    data = json.loads(file.read_text()) | {"blocks": []}
    for name in INSTANCES:
        np.save(tmp_path / "instances-12" / f"{name}.npy", np.load(tmp_path / "instances-12" / f"{name}.npy")[:0])
    file.write_text(json.dumps(data))
    g = snapshot.read(file).geometry
    assert g.vertices.shape == (0, 3) and g.vertices.dtype == np.float32 and len(g.meshes) == 0


def test_blocks_with_and_without_uvs(tmp_path):
    file = in_blocks(tmp_path, tabletop(16))
    n = len(np.load(tmp_path / "x_2" / "triangles.npy"))
    np.save(tmp_path / "x_2" / "uvs.npy", np.ones((n, 3, 2), np.float32))
    uvs = snapshot.read(file).geometry.uvs
    assert (uvs[-n:] == 1).all() and (uvs[:-n] == 0).all() and len(uvs) == len(snapshot.read(file).geometry.triangles)


def test_arrays_that_are_not_mapped_do_not_change_with_their_files(tmp_path):
    snapshot.write(tabletop(16), tmp_path)
    scene = snapshot.read(tmp_path, mapped=False)
    before = scene.geometry.vertices.copy()
    with (tmp_path / "vertices.npy").open("r+b") as f:
        f.seek(200)
        f.write(bytes(40))
    np.testing.assert_array_equal(scene.geometry.vertices, before)
    assert not np.array_equal(snapshot.read(tmp_path).geometry.vertices, before)


@pytest.mark.parametrize("name", ["..", "../scene", "a/b", "a\\b", "/tmp", "", ".", ".hidden", "mesh\n", "C:x", 3, None,
                                  ["mesh-1"], "ü", "mesh-1/"], ids=repr)
@pytest.mark.parametrize("key", ["blocks", "instances"])
def test_a_name_that_leads_elsewhere_is_refused(tmp_path, key, name):
    file = in_blocks(tmp_path, tabletop(16))
    data = json.loads(file.read_text())
    data[key] = [name] if key == "blocks" else name
    file.write_text(json.dumps(data))
    if key == "instances" and name is None:
        with pytest.raises(SceneError, match=r"instance_mesh\.npy"):  # as where there is no such entry
            snapshot.read(file)
        return
    with pytest.raises(SceneError, match=f"{key} names .* plain name"):
        snapshot.read(file)


BAD_BLOCKS = {
    "gone": (lambda f: shutil.rmtree(f / "mesh-4"), r"mesh-4/.*npy"),
    "cut short": (rewrite("mesh-4/vertices.npy", lambda b: b[:-4]), r"mesh-4/vertices\.npy is cut short"),
    "of another kind": (resave("mesh-1/meshes.npy", lambda a: a.astype(np.int32)), r"mesh-1/meshes\.npy is int32"),
    "a row too many here": (resave("mesh-1/corner_normals.npy", lambda a: np.concatenate([a, a[:1]])),
                            r"block mesh-1: corner_normals has"),
    "a mesh in its neighbour": (resave("mesh-4/meshes.npy", put((0, 0), -5)), r"block mesh-4: mesh 0"),
    "a mesh that reaches over": (resave("mesh-1/meshes.npy", put((0, 1), 20)), r"block mesh-1: mesh 0"),
    "no such vertex": (resave("x_2/triangles.npy", put((0, 0), 99)), r"block x_2: mesh 0.*vertex"),
    "no such material": (resave("x_2/triangle_materials.npy", put(0, 99)), r"names a material"),
    "no such mesh": (resave("instances-12/instance_mesh.npy", put(0, 3)), r"instance_mesh names a mesh"),
    "instances gone": (lambda f: shutil.rmtree(f / "instances-12"), r"instances-12/instance_mesh\.npy"),
}


@pytest.mark.parametrize("case", BAD_BLOCKS)
def test_bad_blocks_are_named(tmp_path, case):
    edit, sentence = BAD_BLOCKS[case]
    file = in_blocks(tmp_path, tabletop(16))
    edit(tmp_path)
    with pytest.raises(SceneError, match=sentence):
        snapshot.read(file)


def test_blocks_must_be_a_list(tmp_path):
    file = in_blocks(tmp_path, tabletop(16))
    file.write_text(json.dumps(json.loads(file.read_text()) | {"blocks": "mesh-1"}))
    with pytest.raises(SceneError, match="blocks must be a list"):
        snapshot.read(file)
