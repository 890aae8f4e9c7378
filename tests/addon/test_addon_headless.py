"""The driver behind the command line, run as a process: its pictures, its messages for programs, its exit codes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import light_meshes.scene.snapshot
import numpy as np
import pytest
from blender_scene import SCENE, read

MARK = "@light-meshes "


@pytest.fixture(scope="module")
def blend(tmp_path_factory):
    """A scene with an object that says its frame by its place, a glass, and #s in a folder's name."""
    path = tmp_path_factory.mktemp("files") / "scene.blend"
    code = "import bpy, light_meshes_addon, sys\nlight_meshes_addon.register()\n" + SCENE + """
scene.render.use_overwrite = False
for frame in (1, 5):
    plane.location.x = 100 * (frame != 1)
    plane.keyframe_insert("location", frame=frame)
scene.frame_set(5)
glass = bpy.data.materials.new("Glass")
if bpy.app.version < (5, 0):
    glass.use_nodes = True
tree = glass.node_tree
tree.nodes.clear()
tree.links.new(tree.nodes.new('ShaderNodeBsdfToon').outputs[0], tree.nodes.new('ShaderNodeOutputMaterial').inputs[0])
pane = add(plane.data.copy(), location=(500, 0, 0))
pane.data.materials[0] = glass
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
from light_meshes_addon.headless import leave
leave(0)
"""
    subprocess.run([sys.executable, "-c", code, path], check=True, capture_output=True, timeout=120)
    return path


@pytest.fixture
def drive(tmp_path):
    """(arguments) → exit code, events, everything printed."""
    def run(*arguments, command=(sys.executable, "-m", "light_meshes_addon.headless"), **environment):
        done = subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True, timeout=120,
                              cwd=tmp_path, env=os.environ | {"TMPDIR": str(tmp_path)} | environment)
        events = [json.loads(line[len(MARK):]) for line in done.stdout.splitlines() if line.startswith(MARK)]
        assert "Traceback" not in done.stderr, done.stderr
        assert not list(tmp_path.glob("light-meshes-*")) and not list(tmp_path.glob("blender_*"))
        return done.returncode, events, done.stdout + done.stderr
    return run


def kinds(events):
    assert events[-1]["event"] == "end"
    return {e["event"] for e in events[:-1]}


def the_error(events):
    (message,) = [e["message"] for e in events if e["event"] == "error"]
    assert "\n" not in message and len(message) < 400
    return message


def test_current_frame(blend, drive, tmp_path):
    code, events, said = drive("render", blend, "-o", "out.exr")
    assert code == 0, said
    assert kinds(events) == {"progress", "warning", "statistics", "wrote"}
    (wrote,) = [e for e in events if e["event"] == "wrote"]
    assert Path(wrote["path"]) == tmp_path / "out.exr" and wrote["frame"] == 5
    progress = [e for e in events if e["event"] == "progress"]
    assert progress[-1]["fraction"] == 1 and all(e["frame"] == 5 and e["stage"] for e in progress)
    assert sum("Glass" in e["message"] for e in events if e["event"] == "warning") == 1
    assert not read(tmp_path / "out.exr")[24, 32, :3].any()  # the plane is far away at frame 5


def test_frames_and_settings(blend, drive, tmp_path):
    code, _, said = drive("render", blend, "-o", "pic.png", "-f", "1,3..4", "--set", "resolution=40x20",
                          "--set", "resolution_percentage=50", "--set", "samples=2", "--set", "shadows=sharp")
    assert code == 0, said
    assert sorted(p.name for p in tmp_path.glob("*.png")) == ["pic_0001.png", "pic_0003.png", "pic_0004.png"]
    first = read(tmp_path / "pic_0001.png")
    assert first.shape[:2] == (10, 20) and first[5, 10, 0] > 0.3  # through the view transform
    code, _, said = drive("render", blend, "-o", "n##.exr", "-f", "1")
    assert code == 0 and (tmp_path / "n01.exr").exists(), said
    assert read(tmp_path / "n01.exr")[24, 32, 0] == pytest.approx(0.5, abs=2e-3)  # scene-linear


def test_overwrites(blend, drive, tmp_path):
    (tmp_path / "out.png").write_bytes(b"old")
    code, _, said = drive("render", blend, "-o", "out.png", "--set", "resolution=20x10")
    assert code == 0 and read(tmp_path / "out.png").shape[:2] == (10, 20), said


def test_numbers_in_the_folders_name_stay(blend, drive, tmp_path):
    (tmp_path / "a##").mkdir()
    code, _, said = drive("render", blend, "-o", "a##/out.png", "--set", "resolution=20x10")
    assert code == 0 and (tmp_path / "a##" / "out.png").exists(), said


def test_snapshot(blend, drive, tmp_path):
    code, events, said = drive("snapshot", blend, "-o", "folder", "-f", "1", "--set", "kI=2.5")
    assert code == 0 and kinds(events) == {"warning", "wrote"}, said
    scene = light_meshes.scene.snapshot.read(tmp_path / "folder")
    assert scene.settings.kI == 2.5 and len(scene.geometry.triangles) == 4
    assert np.allclose(scene.geometry.instance_matrix[0][:3, 3], 0)


@pytest.mark.parametrize(("arguments", "word"), [
    (["--set", "colour=3"], "kI"), (["--set", "kI"], "kI"), (["--set", "kI=99"], "0.5 to 8"),
    (["--set", "samples=many"], "whole number"), (["--set", "mode=RADIOSITY"], "WHITTED"),
    (["--set", "auto_h=perhaps"], "true or false"), (["--set", "resolution=big"], "1920x1080"), (["-f", "x"], "1,3..8"),
    (["-f", "8..3"], "upwards"), (["--nonsense"], "nonsense"), (["--set", "kI=nan"], "0.5 to 8"),
])
def test_bad_usage(blend, drive, tmp_path, arguments, word):
    code, events, said = drive("render", blend, "-o", "out.png", *arguments)
    assert code == 2 and word in the_error(events), said
    assert not (tmp_path / "out.png").exists()


def test_bad_suffix_and_no_command(blend, drive):
    code, events, _ = drive("render", blend, "-o", "out.jpg")
    assert code == 2 and ".png or .exr" in the_error(events)
    code, events, _ = drive()
    assert code == 2 and the_error(events)


def test_bad_files(drive, blend, tmp_path):
    code, events, _ = drive("render", "nowhere.blend", "-o", "out.png")
    assert code == 1 and "nowhere.blend does not exist" in the_error(events)
    (tmp_path / "broken.blend").write_bytes(b"BLENDER-v402 and nothing more")
    code, events, _ = drive("render", "broken.blend", "-o", "out.png")
    assert code == 1 and "broken.blend cannot be opened" in the_error(events)
    code, events, _ = drive("render", blend, "-o", "no/such/out.png")
    assert code == 1 and "does not exist" in the_error(events)


def test_an_engine_that_cannot_start(blend, drive, tmp_path):
    code, events, _ = drive("render", blend, "-o", "out.png", LIGHT_MESHES_PYTHON="/no/such/python")
    assert code == 1 and "/no/such/python cannot be run" in the_error(events)
    assert not (tmp_path / "out.png").exists()


@pytest.mark.slow
def test_in_a_real_blender(blender_path, drive, tmp_path):
    """blender -b --factory-startup -P addon/headless.py -- …, with the folder's own add-on."""
    import light_meshes_addon

    script = Path(light_meshes_addon.__file__).with_name("headless.py")
    blender = (blender_path, "-b", "--factory-startup", "-P", str(script), "--")
    expression = "import bpy\n" + SCENE.replace("material.light_meshes", "#").replace("sun.light_meshes", "#").replace(
        "scene.light_meshes", "#") + \
        f"bpy.ops.wm.save_as_mainfile(filepath={str(tmp_path / 'here.blend')!r})"
    subprocess.run([blender_path, "-b", "--factory-startup", "--python-expr", expression.replace(
        "'LIGHT_MESHES'", "'CYCLES'")], check=True, capture_output=True, timeout=120)
    environment = {"LIGHT_MESHES_PYTHON": sys.executable}
    code, events, said = drive("render", "here.blend", "-o", "out.exr", command=blender, **environment)
    assert code == 0 and kinds(events) >= {"progress", "statistics", "wrote"}, said
    assert read(tmp_path / "out.exr")[24, 32, 0] > 0.3
    code, events, said = drive("snapshot", "here.blend", "-o", "folder", command=blender, **environment)
    assert code == 0 and (tmp_path / "folder" / "scene.json").exists(), said
    code, events, _ = drive("render", "here.blend", "-o", "out.exr", "--set", "x=1", command=blender, **environment)
    assert code == 2 and the_error(events)
    code, events, _ = drive("render", "nowhere.blend", "-o", "out.exr", command=blender, **environment)
    assert code == 1 and the_error(events)
