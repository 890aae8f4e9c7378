"""An animation rendered with the files for farms, by two workers at once, has the same bits as on one machine."""

import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from blender_scene import read
from faults import found
from slurm import Cluster

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent
TEMPLATE = ROOT / "docs" / "farm" / "light_meshes.openjd.yaml"
ENVIRONMENT = os.environ | {"PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}"}

MAKE = """
import sys
import time
import bpy, light_meshes_addon
from light_meshes_addon.headless import leave
light_meshes_addon.register()
bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
scene = bpy.context.scene
scene.render.engine = 'LIGHT_MESHES'
scene.light_meshes.world_light, scene.light_meshes.bounces = 'AMBIENT', 0
scene.render.resolution_x, scene.render.resolution_y = 48, 32
scene.frame_start, scene.frame_end = 1, 4
assert scene.light_meshes.auto_h and scene.light_meshes.shadows == 'LIGHT_MESHES'
def add(name, corners, z):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(x, y, z) for x, y in corners], [], [(0, 1, 2, 3)])
    made = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(made)
    return made
add("Floor", [(-9, -9), (9, -9), (9, 9), (-9, 9)], 0)
blocker = add("Blocker", [(-1, -1), (1, -1), (1, 1), (-1, 1)], 2)
light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", 'POINT'))
light.data.energy, light.location = 1000, (0, 0, 6)
camera = scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
for made in (light, camera):
    scene.collection.objects.link(made)
for frame, z in ((1, 9), (4, 18)):  # from farther away the automatic step would be another
    camera.location.z = z
    camera.keyframe_insert("location", frame=frame)
if hasattr(scene.render.image_settings, "media_type"):
    scene.render.image_settings.media_type = 'IMAGE'
scene.render.image_settings.file_format = 'OPEN_EXR'
scene.render.image_settings.color_depth, scene.render.image_settings.exr_codec = '32', 'NONE'
scene.render.filepath = sys.argv[2]
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
bpy.ops.render.render(animation=True)
leave(0)
"""


@pytest.fixture(scope="module")
def animation(tmp_path_factory):
    """A .blend, and its frames 1 to 4, rendered by Blender here."""
    folder = tmp_path_factory.mktemp("animation")
    subprocess.run([sys.executable, "-c", MAKE, folder / "scene.blend", folder / "frame_####"], check=True,
                   capture_output=True, timeout=300)
    frames = [read(folder / f"frame_{n:04}.exr") for n in range(1, 5)]
    assert not np.array_equal(frames[0], frames[1])
    return folder / "scene.blend", frames


def job(*arguments, **options):
    """`openjd run` of the template has begun."""
    return subprocess.Popen(
        [BIN / "openjd", "run", TEMPLATE, *(word for a in arguments for word in ("-p", a))], env=ENVIRONMENT,
        text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **options)


def same(folder, frames):
    """The pictures in `folder` are `frames`, and nothing else is there."""
    assert sorted(p.name for p in folder.iterdir()) == [f"frame_{n:04}.exr" for n in range(1, len(frames) + 1)]
    for n, frame in enumerate(frames, 1):
        np.testing.assert_array_equal(read(folder / f"frame_{n:04}.exr"), frame, err_msg=f"frame {n}")


def test_open_job_description(animation, tmp_path):
    """Two sessions at once; the second job leaves out what is there."""
    scene, frames = animation
    workers = [job(f"Scene={scene}", f"Output={tmp_path}", f"Frames={those}", "FramesPerTask=2")
               for those in ("1-2", "3-3,4-4")]
    said = [worker.communicate(timeout=300)[0] for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0], said
    same(tmp_path, frames)
    kept = (tmp_path / "frame_0001.exr").stat().st_mtime_ns
    (tmp_path / "frame_0002.exr").unlink()
    again = job(f"Scene={scene}", f"Output={tmp_path}", "Frames=1-2")
    said = again.communicate(timeout=300)[0]
    assert again.returncode == 0 and "frame_0001.exr is there already" in said, said
    assert (tmp_path / "frame_0001.exr").stat().st_mtime_ns == kept
    same(tmp_path, frames)


def test_a_frame_that_fails_fails_the_task(animation, tmp_path):
    scene, _ = animation
    failing = job(f"Scene={scene}", f"Output={tmp_path / 'nowhere'}", "Frames=1-2")
    said = failing.communicate(timeout=300)[0]
    assert failing.returncode == 1 and "nowhere does not exist" in said, said


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """A cluster of two nodes that find the command light-meshes."""
    installed = os.environ.get("LIGHT_MESHES_SLURM")
    if not installed:
        pytest.skip("LIGHT_MESHES_SLURM names no folder made by tests/support/install_slurm.sh")
    with Cluster(Path(installed), tmp_path_factory.mktemp("slurm"), BIN) as cluster:
        yield cluster


def test_slurm(animation, tmp_path, slurm):
    """An array of two tasks, one on each node; a task that fails is one that Slurm says has failed."""
    scene, frames = animation
    script, output = ROOT / "docs" / "farm" / "render.slurm", tmp_path / "frame_####.exr"
    done = slurm.array("--array=0-2", script, scene, output, 1, 4, 2)
    assert {task: (state, code) for task, (state, code, _) in done.items()} == dict.fromkeys(
        range(3), ("COMPLETED", "0:0")), slurm.logs()
    assert {done[0][2], done[1][2]} == {"one", "two"}
    same(tmp_path, frames)
    failed = slurm.array("--array=1,7", script, tmp_path / "nothing.blend", output, 1, 4, 2)
    assert [failed[task][:2] for task in (1, 7)] == [("FAILED", "1:0"), ("COMPLETED", "0:0")], slurm.logs()


def test_a_task_that_is_cancelled_leaves_nothing(animation, tmp_path):
    """As farms cancel, by SIGTERM."""
    scene, _ = animation
    (tmp_path / "tmp").mkdir()
    task = subprocess.Popen(
        [BIN / "light-meshes", "render", scene, "-o", tmp_path / "frame_####.exr", "-f", "1..4", "--set",
         "resolution=1920x1080", "--set", "samples=64"], text=True, stderr=subprocess.PIPE,
        env=os.environ | {"TMPDIR": str(tmp_path / "tmp")})
    try:
        wait(lambda: found(tmp_path, "tmp/light-meshes-*/light-meshes-*/job-1/frame"))  # it renders
    finally:
        task.terminate()
    said = task.communicate(timeout=60)[1]
    assert task.returncode == 1 and "interrupted" in said
    wait(lambda: not list(tmp_path.glob("tmp/light-meshes-*")))  # the engine has ended too
    assert [p.name for p in tmp_path.iterdir()] == ["tmp"]


def test_half_a_picture_is_none(animation, tmp_path):
    """The disk has room for what the engine says, and not for the picture's file, which is a little larger."""
    scene, _ = animation
    size = np.empty((32, 48, 4), np.float32).nbytes + 300
    before = tmp_path / "frame_0002.exr"
    before.write_bytes(b"the one before")
    done = subprocess.run([BIN / "light-meshes", "render", scene, "-o", before, "-f", "2"], text=True,
                          stderr=subprocess.PIPE, timeout=300,
                          preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)))
    assert done.returncode == 1 and "frame_0002.exr has not been written: is there room" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == [before.name] and before.read_bytes() == b"the one before"


def wait(happens, seconds=60):
    """Until it happens."""
    end = time.monotonic() + seconds
    while not happens():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_render_slurm_reads_decimal_numbers(animation, tmp_path):
    """Also without Slurm, which sets but the task's number."""
    scene, frames = animation
    script = ROOT / "docs" / "farm" / "render.slurm"

    def run(*arguments):
        return subprocess.run(["bash", script, scene, tmp_path / "frame_####.exr", *arguments], text=True,
                              env=ENVIRONMENT | {"SLURM_ARRAY_TASK_ID": "0"}, capture_output=True, timeout=300)
    for arguments, why in (("1 three", "LAST is"), ("0x1 3", "FIRST is '0x1'"), ("1 3 1.5", "FRAMES_PER_TASK is"),
                           ("1 3 0", "must be 1 or more"), ("1 3 -2", "must be 1 or more"), ("9 3", "go upwards"),
                           ("1 2000000 2000000", "Blender's frames go from -1048574 to 1048574")):
        failed = run(*arguments.split())
        assert failed.returncode == 2 and why in failed.stderr, failed.stderr
        assert len(failed.stderr.splitlines()) == 1, failed.stderr
    (tmp_path / "frame_0002.exr").touch()  # an empty one is none
    done = run("001", "0002", "08")
    assert done.returncode == 0, done.stderr
    same(tmp_path, frames[:2])
