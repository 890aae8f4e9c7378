"""Cause real faults: run Blender in a separate process, and list what it leaves behind."""

import os
import re
import subprocess
import sys
import textwrap
import time
from pathlib import Path

# A scene that takes minutes; `first_progress(act)`, which calls `act` when the render has begun; and `render()`.
PRELUDE = """
import os, signal, sys, threading, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have had it ignored
from pathlib import Path
import bpy
import light_meshes_addon
from light_meshes_addon import observers, session
light_meshes_addon.register()
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
blend = Path(sys.argv[1]).read_bytes(), os.stat(sys.argv[1]).st_mtime_ns
scene = bpy.context.scene
own = scene.light_meshes
scene.render.engine = 'LIGHT_MESHES'

def slow():
    scene.render.resolution_x, scene.render.resolution_y = 640, 480
    own.shadows, own.samples, own.light_samples = 'AREA_SAMPLING', 256, 1024

def fast():
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    own.shadows, own.samples = 'SHARP', 1

def first_progress(act):
    def see(event):
        if event["event"] == "progress" and event["fraction"] > 0:
            observers.observers.remove(see)
            see.process = session._sessions["render"]._process
            act()
    observers.observers.append(see)
    return see

def child():
    return session._sessions["render"]._process.pid

def render():
    scene.render.filepath = sys.argv[2]
    Path(sys.argv[2]).unlink(missing_ok=True)
    try:
        result = bpy.ops.render.render(write_still=True)
        print("RESULT", result, Path(sys.argv[2]).exists(), flush=True)
    except RuntimeError as e:
        print("ERROR", " | ".join(sorted(set(str(e).strip().splitlines()))), Path(sys.argv[2]).exists(), flush=True)

def leave():
    light_meshes_addon.unregister()
    assert blend == (Path(sys.argv[1]).read_bytes(), os.stat(sys.argv[1]).st_mtime_ns)
    sys.stdout.flush()
    os._exit(0)
"""
MADE = {"scene.blend", "picture.png"}  # made by PRELUDE


def go(folder: Path, script: str, prefix=(), timeout=120, **environment) -> tuple[list[str], str]:
    """Run PRELUDE and `script`. Returns the printed lines that begin with a word in capitals, and the whole output.

    `folder` is for temporary files. `prefix` is a command that runs it, such as `env`.
    """
    before = names(folder)
    done = subprocess.run(
        [*prefix, sys.executable, "-c", PRELUDE + textwrap.dedent(script), folder / "scene.blend",
         folder / "picture.png"],
        env=os.environ | {"TMPDIR": str(folder)} | environment, capture_output=True, text=True, timeout=timeout)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert names(folder) - before <= MADE, "a file is left"
    end = time.monotonic() + 5
    while running(folder) and time.monotonic() < end:
        time.sleep(0.05)
    assert not running(folder), "an engine is left"
    return re.findall(r"^[A-Z]{4,} .*$", done.stdout, re.M), done.stdout + done.stderr


def names(folder: Path) -> set[str]:
    """Return the contents of `folder`, without Blender's own temporary files."""
    return {p.name for p in folder.iterdir() if not p.name.startswith("blender_")}


def found(folder: Path, pattern: str) -> list[Path]:
    """Return what is in `folder` under names of `pattern`, for use in a loop that waits.

    A folder on the way may be removed while it is looked into; the answer is then "nothing yet".
    """
    try:
        return list(folder.glob(pattern))
    except FileNotFoundError:
        return []


def running(folder: Path) -> list[int]:
    """Return the processes whose temporary files go to `folder`."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if f"TMPDIR={folder}\0".encode() in (process / "environ").read_bytes():
                found.append(int(process.name))
        except OSError:  # the process has ended, or belongs to somebody else
            continue
    return found


def python(folder: Path, script: str) -> str:
    """Return a Python for the engine that first runs the shell `script`; this may end with `exec {python} "$@"`."""
    path = folder / "python"
    path.write_text(f"#!/bin/sh\n{script.replace('{python}', sys.executable)}\n")
    path.chmod(0o755)
    return str(path)
