"""The command can be cancelled in each of its phases by each signal, and leaves no file and no process behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from blender_scene import SCENE
from faults import found

pytestmark = pytest.mark.slow
COMMAND = Path(sys.executable).with_name("light-meshes")
QUICK = ("--set", "mode=LOCAL", "--set", "samples=1", "--set", "resolution=1600x1200")


@pytest.fixture(scope="module")
def blend(tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "scene.blend"
    code = "import bpy, light_meshes_addon, sys\nlight_meshes_addon.register()\n" + SCENE + """
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
from light_meshes_addon.headless import leave
leave(0)
"""
    subprocess.run([sys.executable, "-c", code, path], check=True, capture_output=True, timeout=120)
    return path


class Run:
    """The command renders frames without end, in folders of its own."""

    def __init__(self, blend, folder):
        self.temporary, self.out = folder / "tmp", folder / "out"
        self.mark = f"{folder.parent.name}/{folder.name}"
        for made in (self.temporary, self.out):
            made.mkdir(exist_ok=True)
        self.process = subprocess.Popen(
            [COMMAND, "render", blend, "-o", self.out / "f_####.exr", "-f", "1..9999", *QUICK],
            env=os.environ | {"TMPDIR": str(self.temporary)}, start_new_session=True, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True)

    def wait(self, happens, seconds=120):
        end = time.monotonic() + seconds
        while not happens():
            assert self.process.poll() is None and time.monotonic() < end, self.process.communicate()
            time.sleep(0.002)

    def processes(self):
        """All that have the temporary folder in their environment, or on their command line."""
        found = []
        for entry in Path("/proc").iterdir():
            try:
                if entry.name.isdigit() and str(self.temporary).encode() in (entry / "environ").read_bytes():
                    found.append(entry.name)
            except OSError:
                continue
        return found

    def left(self):
        return [p.name for p in (*self.temporary.iterdir(), *self.out.iterdir()) if not p.name.startswith("f_")]

    def gone(self, seconds=10):
        end = time.monotonic() + seconds
        while self.processes() and time.monotonic() < end:
            time.sleep(0.05)
        return not self.processes()


def _written(folder):
    """The hidden pictures that are begun; they, and their folder, may be gone the next moment."""
    try:
        return [p for p in folder.glob(".light-meshes-*/.*") if p.stat().st_size]
    except FileNotFoundError:
        return []


PHASES = {
    "starting": lambda run: found(run.temporary, "light-meshes-*"),
    "reading": lambda run: found(run.temporary, "*/blender_*"),
    "rendering": lambda run: found(run.temporary, "*/light-meshes-*/job-*/frame"),
    "writing": lambda run: _written(run.out),
}


@pytest.mark.parametrize(("phase", "ends", "group"), [
    ("starting", signal.SIGTERM, False), ("reading", signal.SIGINT, True), ("reading", signal.SIGHUP, False),
    ("rendering", signal.SIGTERM, True), ("rendering", signal.SIGHUP, True), ("rendering", signal.SIGINT, False),
    ("writing", signal.SIGTERM, False), ("writing", signal.SIGINT, True)])
def test_nothing_is_left(blend, tmp_path, phase, ends, group):
    run = Run(blend, tmp_path)
    run.wait(lambda: PHASES[phase](run))
    (os.killpg if group else os.kill)(run.process.pid, ends)
    said = run.process.communicate(timeout=30)[0]
    assert run.process.returncode == 1 and said.endswith("light-meshes: interrupted\n"), said
    assert run.processes() == [] and run.left() == []


def test_what_was_killed_is_swept_by_the_next_start(blend, tmp_path):
    """And only that: neither what lives, nor what others have there under names like ours."""
    run = Run(blend, tmp_path)
    others = [run.temporary / "light-meshes-abcdefgh", run.out / ".f_0001-12ab34cd.exr", run.out / ".light-meshes-mine"]
    for other in others:
        other.mkdir()
    run.wait(lambda: PHASES["writing"](run))
    os.killpg(run.process.pid, signal.SIGKILL)
    run.process.communicate(timeout=30)
    assert run.gone()
    assert len(run.left()) >= 5
    one = Run(blend, tmp_path)
    one.wait(lambda: PHASES["rendering"](one))
    assert len(one.left()) == 5  # its own two, and the others
    two = Run(blend, tmp_path)
    two.wait(lambda: found(two.temporary, f"*-{two.process.pid}-*/blender_*"))
    assert len(two.left()) == 7
    for run in (one, two):
        run.process.terminate()
        run.process.communicate(timeout=30)
    assert sorted(one.left()) == sorted(other.name for other in others)


def test_a_command_that_is_killed_takes_its_processes_along(blend, tmp_path):
    run = Run(blend, tmp_path)
    run.wait(lambda: PHASES["rendering"](run))
    run.process.kill()
    run.process.communicate(timeout=30)
    assert run.gone() and run.left() == []
