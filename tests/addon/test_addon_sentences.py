"""Wrong input gives one sentence and the right exit code."""

import os
import subprocess
import sys
from pathlib import Path

import bpy
import pytest
from blender_scene import SCENE

COMMAND = Path(sys.executable).parent / "light-meshes"


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 1, 0)])
def test_a_camera_of_no_size(scene, snapshot, add_plane, scale):
    add_plane()
    scene.camera.name = "Flat"
    scene.camera.scale = scale
    with pytest.raises(RuntimeError, match="Camera 'Flat' is scaled to 0"):
        snapshot(scene)
    scene.camera.scale = (1e-6, 1e6, -1)
    assert snapshot(scene).camera.width == 64


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "", "soon", "-inf"])
def test_timeouts_that_are_none(scene, monkeypatch, seconds):
    from light_meshes_addon import session

    session.discard()
    monkeypatch.setenv("LIGHT_MESHES_TIMEOUT", seconds)
    with pytest.raises(RuntimeError, match=f"TIMEOUT is '{seconds}': it must be a number of seconds above 0"):
        bpy.ops.render.render()
    monkeypatch.setenv("LIGHT_MESHES_TIMEOUT", "inf")
    bpy.ops.render.render()


def test_the_temporary_folder_of_the_preferences(scene, add_plane, tmp_path):
    from light_meshes_addon import observers, session

    add_plane()
    filepaths = bpy.context.preferences.filepaths
    before, seen = filepaths.temporary_directory, []
    observers.observers.append(lambda event: seen.append(session._sessions["render"].folder.parent)
                               if event["event"] == "progress" else None)
    try:
        bpy.ops.render.render()
        filepaths.temporary_directory = str(tmp_path)
        seen.append("changed")
        bpy.ops.render.render()  # in another engine: the one before has its folder elsewhere
    finally:
        filepaths.temporary_directory = before
        observers.observers.pop()
    later = seen[seen.index("changed") + 1:]
    assert later and set(later) == {tmp_path} and tmp_path not in seen[:seen.index("changed")]
    session.end()
    assert not [*tmp_path.glob("light-meshes-*")]


@pytest.fixture(scope="module")
def blend(tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "scene.blend"
    code = "import sys, bpy, light_meshes_addon\nlight_meshes_addon.register()\n" + SCENE + \
        "scene.light_meshes.samples = 1\nbpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])\n" \
        "from light_meshes_addon.headless import leave\nleave(0)"
    subprocess.run([sys.executable, "-P", "-c", code, path], check=True, capture_output=True, timeout=120)
    return path


LONG = "a" * 245
CASES = [
    (["-o", "o.png", "-f", ""], 2, "is not a frame"),
    (["-o", "o_##.png", "-f", "-2..-1"], 0, "o_-1.png"),
    (["-o", "o_##.png", "--frames", "-1"], 0, "o_-1.png"),
    (["-o", "o_##.png", "--frames=-1"], 0, "o_-1.png"),
    (["-o", f"{LONG}.png"], 0, f"{LONG}.png"),
    (["-o", f"{LONG}{LONG}.png"], 1, "a.png"),
    (["-o", ""], 2, "pictures are written as .png or .exr"),
    (["-o", "o.png", "--set", "h=1e308"], 2, "h cannot be '1e308'"),
    (["-o", "o.png", "--set", "h=\udc80"], 2, r"h cannot be '\udc80'"),
    (["-o", "o.png", "--set", "samples=" + "9" * 5000], 2, "samples cannot be"),
    (["-o", "\udcff.png"], 0, r"\udcff.png"),
]


@pytest.mark.parametrize(("arguments", "code", "words"), CASES, ids=range(len(CASES)))
def test_the_command(blend, tmp_path, arguments, code, words):
    done = subprocess.run([COMMAND, "render", blend, "--set", "resolution=8x8", *arguments], cwd=tmp_path,
                          capture_output=True, timeout=120)
    said = (done.stdout if code == 0 else done.stderr.splitlines()[-1]).decode()
    assert done.returncode == code and words in said, (done.stdout, done.stderr)
    assert b"Traceback" not in done.stderr and len(done.stderr) < 2000
    assert len([*tmp_path.iterdir()]) == (0 if code else 1 + (arguments[-1] == "-2..-1"))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems limit no address space")
@pytest.mark.parametrize("mebibytes", [200, 500, 900])
def test_a_limit_of_address_space(blend, tmp_path, mebibytes):
    done = subprocess.run(["bash", "-c", f'ulimit -v {mebibytes * 1024}; exec "$@"', "bash", COMMAND, "render", blend,
                           "-o", "o.png"], cwd=tmp_path, capture_output=True, text=True, timeout=120,
                          env=os.environ | {"TMPDIR": str(tmp_path)})
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr and done.stderr.startswith("light-meshes: "), done.stderr
    assert "memory" in done.stderr, done.stderr
