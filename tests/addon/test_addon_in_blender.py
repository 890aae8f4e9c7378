"""The extension works in a real `blender -b`, enabled as by a user."""

import os
import re
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from blender_scene import SCENE, read


def save_scene(run_blender, path, code=""):
    """Save a scene from inside the Blender that is tested: files of a newer bpy would be too new for it.

    A grey plane half as wide as the picture, under a sun, returns radiance 0.5.
    """
    code = SCENE + code + f"\nbpy.ops.wm.save_as_mainfile(filepath={str(path)!r})"
    done = run_blender("--python-exit-code", "3", "--python-expr", code)
    assert done.returncode == 0, done.stdout + done.stderr
    return path


SLOW = """
scene.render.resolution_x, scene.render.resolution_y = 640, 480
own = scene.light_meshes
own.shadows, own.samples, own.light_samples = 'AREA_SAMPLING', 256, 1024
"""


def test_manifest(run_blender, addon):
    done = run_blender("--command", "extension", "validate", Path(addon.__file__).parent)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Success" in done.stdout


def test_still(run_blender, tmp_path):
    """blender -b scene.blend -E LIGHT_MESHES -o … -f 1"""
    blend = save_scene(run_blender, tmp_path / "scene.blend", "\nscene.render.engine = 'CYCLES'")
    done = run_blender(blend, "-E", "LIGHT_MESHES", "-o", tmp_path / "f_####", "-F", "OPEN_EXR", "-f", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    pixels = read(tmp_path / "f_0001.exr")
    assert pixels.shape[:2] == (48, 64)
    assert pixels[24, 32, :3] == pytest.approx((0.5, 0.5, 0.5), abs=2e-3) and not pixels[24, 2, :3].any()
    assert len([line for line in done.stdout.splitlines() if line.startswith("Light Meshes:")]) == 1


def test_python_of_the_preferences(run_blender):
    done = run_blender("--python-expr", """
import bpy
bpy.context.preferences.addons["bl_ext.dev.light_meshes"].preferences.python = "/chosen/python"
bpy.context.scene.render.engine = 'LIGHT_MESHES'
bpy.ops.render.render()
""", LIGHT_MESHES_PYTHON="")
    assert "/chosen/python cannot be run" in done.stdout + done.stderr


@pytest.mark.slow
def test_animation_has_one_step(run_blender, tmp_path):
    """The automatic step is that of the file's first frame: in -a, in a later -f, and where -s says another."""
    blend = save_scene(run_blender, tmp_path / "scene.blend", """
scene.frame_start, scene.frame_end = 2, 4
for frame, z in ((2, 5), (4, 50)):
    scene.camera.location.z = z
    scene.camera.keyframe_insert("location", frame=frame)
scene.render.image_settings.file_format = 'PNG'
plane.scale = (100, 100, 1)
""")

    def steps(done):
        assert done.returncode == 0, done.stdout + done.stderr
        return re.findall(r"^Light Meshes: .*\bh ([\d.e+-]+)", done.stdout, re.M)

    whole = steps(run_blender(blend, "-o", tmp_path / "a_####", "-a"))
    single = steps(run_blender(blend, "-o", tmp_path / "b_####", "-f", "4"))
    other = steps(run_blender(blend, "-o", tmp_path / "c_####", "-s", "4", "-f", "4"))
    assert len(whole) == 3 and set(whole) == set(single) == set(other)
    assert sorted(p.name for p in tmp_path.glob("?_*.png")) == [
        "a_0002.png", "a_0003.png", "a_0004.png", "b_0004.png", "c_0004.png"]
    assert np.array_equal(read(tmp_path / "a_0004.png"), read(tmp_path / "b_0004.png"))


def test_errors_give_exit_code_1(run_blender, tmp_path):
    blend = save_scene(run_blender, tmp_path / "scene.blend")
    done = run_blender(blend, "-o", tmp_path / "f_####", "-f", "1", LIGHT_MESHES_PYTHON="/no/such/python")
    assert done.returncode == 1
    assert "/no/such/python cannot be run" in done.stdout + done.stderr
    assert not list(tmp_path.glob("f_*"))


def test_stereo_gives_exit_code_1(run_blender, tmp_path):
    blend = save_scene(run_blender, tmp_path / "scene.blend", "\nscene.render.use_multiview = True")
    done = run_blender(blend, "-o", tmp_path / "f_####", "-f", "1")
    assert done.returncode == 1
    assert "renders no stereo pictures: switch off Stereoscopy" in done.stdout + done.stderr


def test_previews(run_blender):
    """With the lights and the engine that the extension finds by itself."""
    done = run_blender("--python-exit-code", "3", "--python-expr", SCENE + """
material.node_tree or setattr(material, "use_nodes", True)
material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.8, 0.05, 0.05, 1)
material.light_meshes.override_Od = False
material.asset_mark()
material.asset_generate_preview()
pixels = list(material.preview.image_pixels_float)
print("MEAN", *(sum(pixels[c::4]) / len(pixels[::4]) for c in range(4)))
""")
    mean = re.search(r"^MEAN (.*)$", done.stdout, re.M)
    assert mean, done.stdout + done.stderr
    red, green, blue, alpha = map(float, mean[1].split())
    assert red > 2 * green > 0 and red > 2 * blue > 0 and 0.4 < alpha < 0.6


def test_ctrl_c(run_blender, tmp_path):
    """SIGINT is what ESC is in a window: within 0.2 s on an idle machine; generous here."""
    done = run_blender("--python-exit-code", "3", "--python-expr", SCENE + SLOW + f"""
import os, signal, threading, time
path = scene.render.filepath = {str(tmp_path / "f.png")!r}
times = []
import sys
observers = next(m for n, m in sys.modules.items() if n.endswith("light_meshes.observers")).observers
def see(event):
    if event["event"] == "progress" and event["fraction"] > 0 and not times:
        times.append(0)
        def later():
            time.sleep(0.3)
            times.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)
        threading.Thread(target=later).start()
observers.append(see)
result = bpy.ops.render.render(write_still=True)
print("TOOK", time.monotonic() - times[1], result, os.path.exists(path))
""")
    took = re.search(r"^TOOK ([\d.]+) \{'CANCELLED'\} False$", done.stdout, re.M)
    assert took, done.stdout + done.stderr
    print(f"cancel took {took[1]} s")
    assert float(took[1]) < 0.5


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX's")
def test_blender_outlives_an_engine_that_dies(run_blender):
    """Blender does not ignore SIGPIPE: a word to an engine that has ended would end it too."""
    done = run_blender("--python-exit-code", "3", "--python-expr", SCENE + SLOW + """
import os, signal, sys
addon = next(n for n in sys.modules if n.endswith("light_meshes.observers"))[:-len(".observers")]
session = sys.modules[addon + ".session"]
def see(event):
    if event["event"] == "progress" and event["fraction"] > 0 and "render" in session._sessions:
        os.kill(session._sessions["render"]._process.pid, signal.SIGKILL)
sys.modules[addon + ".observers"].observers.append(see)
try:
    bpy.ops.render.render()
except RuntimeError as e:
    print("SAID", e)
import time
time.sleep(1)
print("LIVES")
""")
    assert "has ended unexpectedly (killed by signal 9)" in done.stdout and "LIVES" in done.stdout, done.stdout
    assert done.returncode == 1


@pytest.mark.skipif(os.name == "nt", reason="signals are POSIX's")
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_no_child_outlives_blender(blender_path, blender_environment, run_blender, tmp_path, how):
    blend = save_scene(run_blender, tmp_path / "scene.blend", SLOW)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    process = subprocess.Popen([blender_path, "-b", blend, "-o", tmp_path / "f_####", "-f", "1"],
                               env=blender_environment | {"TMPDIR": str(temporary)}, stdout=subprocess.PIPE, text=True)
    try:
        for line in process.stdout:
            if "Rendering" in line:
                break
        else:
            pytest.fail("it did not begin to render")
        (child,) = children(process.pid)
        assert list(temporary.glob("light-meshes-*"))
        process.send_signal(how)
        process.wait(10)
        end = time.monotonic() + 10
        while time.monotonic() < end and (runs(child) or list(temporary.glob("light-meshes-*"))):
            time.sleep(0.05)
        assert not runs(child) and not list(temporary.glob("light-meshes-*"))
    finally:
        process.kill()
        process.stdout.close()
        process.wait()


def children(pid):
    """Processes started by `pid` that run the engine."""
    command = ["ps", "-A", "-ww", "-o", "pid=,ppid=,args="]  # whole lines, whatever COLUMNS says
    table = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    rows = [line.split(None, 2) for line in table.splitlines()]
    return [int(p) for p, parent, command in rows if int(parent) == pid and "light_meshes.frontends.service" in command]


def runs(pid):
    state = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True).stdout.strip()
    return bool(state) and not state.startswith("Z")
