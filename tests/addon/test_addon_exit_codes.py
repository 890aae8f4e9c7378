"""Faults without a window: exit code 1, one sentence, no picture, no process and no file left, the .blend untouched."""

import json
import os
import re
import subprocess
import sys
import time

import pytest
from faults import names, python, running

MARK = "@light-meshes "
SLOW = ["shadows=AREA_SAMPLING", "samples=256", "light_samples=1024", "resolution=640x480"]
# What is wrong with the engine's process, and what is said of it.
FAULTS = {
    "killed": ('(sleep 2; kill -KILL $$) & exec {python} "$@"', r"\(killed by signal 9\)\. The system may have run"),
    "stopped": ('(sleep 2; kill -STOP $$) & exec {python} "$@"', "does not answer any more: it was silent for 2.5 sec"),
    "little memory": ('ulimit -v 150000; exec {python} "$@"', r"\(exit code 1\)\. It ran out of memory: render fewer"),
    "garbage": ("""echo '{"event": "ready", "folder": "/"}'; exec sleep 60""", "of the same release"),
}


@pytest.fixture(scope="module")
def blend(tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "scene.blend"
    code = "import bpy, sys; bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])"
    subprocess.run([sys.executable, "-c", code, path], check=True, capture_output=True, timeout=120)
    return path


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_engine_is_exit_code_1(blend, tmp_path, fault):
    script, sentence = FAULTS[fault]
    engine = python(tmp_path, script)
    before = blend.read_bytes(), blend.stat().st_mtime_ns
    done = subprocess.run(
        [sys.executable, "-m", "light_meshes_addon.headless", "render", blend, "-o", tmp_path / "out.png",
         *(word for setting in SLOW for word in ("--set", setting))], capture_output=True, text=True, timeout=120,
        env=os.environ | {"TMPDIR": str(tmp_path), "LIGHT_MESHES_PYTHON": engine, "LIGHT_MESHES_TIMEOUT": "2.5"})
    assert done.returncode == 1, done.stdout + done.stderr
    events = [json.loads(line[len(MARK):]) for line in done.stdout.splitlines() if line.startswith(MARK)]
    (message,) = [e["message"] for e in events if e["event"] == "error"]
    assert re.search(sentence, message), done.stdout + done.stderr
    assert message.isprintable() and len(message) < 300
    end = time.monotonic() + 5
    while running(tmp_path) and time.monotonic() < end:
        time.sleep(0.05)
    assert not running(tmp_path)
    assert names(tmp_path) == {"python"}
    assert (blend.read_bytes(), blend.stat().st_mtime_ns) == before
    assert names(blend.parent) == {blend.name}
