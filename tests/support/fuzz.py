"""Fuzzing: any content of a snapshot's folder or of a process's line must be read, or refused with one short sentence.

    python tests/support/fuzz.py snapshot --seconds 600      the reader of snapshots
    python tests/support/fuzz.py commands --seconds 600      the engine's reader of commands
    python tests/support/fuzz.py events --seconds 600        the add-on's reader of what the engine says

Atheris (the extra `test`, on Linux x86-64) records which branches an input reaches. An input that causes a failure is
written to `crash-…` in the current folder. To run it again: `python tests/support/fuzz.py snapshot crash-…`.
"""

import argparse
import copy
import importlib.util
import inspect
import io
import json
import math
import os
import shutil
import struct
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import atheris
import numpy as np
from light_meshes.frontends import service
from light_meshes.scene import arrays as snapshot_arrays
from light_meshes.scene import snapshot
from light_meshes.scene.description import Image, Material
from light_meshes.scene.errors import SceneError
from scenes import tabletop, with_lights

EVENTS = Path(__file__).parents[2] / "addon" / "events.py"

# Values that are put in place of the right ones.
ODD = [None, True, False, 0, -1, 1, 3, 0.5, -0.0, math.nan, math.inf, -math.inf, 1e300, 5e-324, 2**31, 2**63, -2**63,
       10**40, 10**400, "", "x", "\0", "\ud800", "a\nb", "../scene", "/", "..", "mesh-1", "é" * 300, "SUN",
       "AREA_SAMPLING", [], {}, [0], [[]], [0, 0, 0], [0, 0, 0, 0], [1e9] * 3, [None] * 3, ["x"] * 4,
       [[1, 0, 0, 0]] * 4, {"name": "x"}, ["mesh-1"], ["mesh-1", "mesh-1"], [2**70], {"x" * 500: 1}]


def follow(*places) -> None:
    """Record the branches in all functions of modules and classes."""
    for place in places:
        for function in vars(place).values():
            if inspect.isfunction(function) and function.__module__ == (getattr(place, "__module__", place.__name__)):
                atheris.instrument_func(function)


def odd(fdp):
    return copy.deepcopy(ODD[fdp.ConsumeIntInRange(0, len(ODD) - 1)])


def sentence(text: str) -> None:
    """Check that a message is short, one line, and not the name of an exception."""
    assert 0 < len(text) < 700 and text.isprintable(), ascii(text)
    assert not text.startswith("the engine failed"), text


# --- Snapshots --------------------------------------------------------------------------------------------------

def whole_snapshot(folder: Path) -> dict[str, bytes]:
    """Write a snapshot that uses every feature. Returns the names of its files and their contents."""
    scene = tabletop(8)
    scene = with_lights(scene, *(replace(scene.lights[0], type=t, receivers=(0, 1)) for t in ("SUN", "SPOT", "AREA")))
    scene = replace(scene, images=(Image("wood", "wood.png"),), warnings=("left out",),
                    materials=(*scene.materials, Material("image", image=-1)))
    snapshot.write(scene, folder)
    (folder / "mesh-1").mkdir()
    for name in ("vertices", "triangles", "corner_normals", "uvs", "triangle_materials", "meshes"):
        shutil.copy(folder / f"{name}.npy", folder / "mesh-1")
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*.*")) if p.is_file()}


def places(data, path=()):
    """Return all places in a JSON value."""
    yield path
    for key, value in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        yield from places(value, (*path, key))


def put(data, path, value):
    """Return `data` with `value` at `path`."""
    if not path:
        return value
    holder = data
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = value
    return data


class Snapshots:
    """Make a few changes to a good snapshot: to values in its JSON, to headers and contents of arrays, or to bytes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        follow(snapshot, snapshot_arrays, inspect.getmodule(np.lib.format.read_magic))
        self.files = whole_snapshot(folder)
        self.changed: set[str] = set()
        self.good = json.loads(self.files["scene.json"])
        self.places = list(places(self.good))

    def __call__(self, data: bytes) -> None:
        for name in self.changed:
            (self.folder / name).write_bytes(self.files[name])
        self.changed = set()
        fdp = atheris.FuzzedDataProvider(data)
        description = json.loads(self.files["scene.json"])
        for _ in range(fdp.ConsumeIntInRange(1, 3)):
            kind = fdp.ConsumeIntInRange(0, 5)
            if kind <= 2 and "scene.json" not in self.changed:
                value = odd(fdp) if kind else fdp.ConsumeInt(8)
                path = self.places[fdp.ConsumeIntInRange(0, len(self.places) - 1)] if kind < 2 else (
                    ("blocks", "instances", "camera", fdp.ConsumeUnicodeNoSurrogates(8))[fdp.ConsumeIntInRange(0, 3)],)
                try:
                    description = put(description, path, value)
                except (TypeError, KeyError, IndexError):  # an earlier change removed the place
                    continue
            else:
                name = sorted(self.files)[fdp.ConsumeIntInRange(0, len(self.files) - 1)]
                content = self.files[name]
                if kind == 3 and name.endswith(".npy"):
                    content = content[:content.index(b"{")] + fdp.ConsumeBytes(118) + b"\n" + content[128:]
                elif kind == 4 and name.endswith(".npy") and len(content) > 136:
                    at = 128 + fdp.ConsumeIntInRange(0, len(content) - 137)
                    content = content[:at] + struct.pack("<q", fdp.ConsumeInt(8)) + content[at + 8:]
                else:
                    at = fdp.ConsumeIntInRange(0, len(content))
                    content = content[:at] + fdp.ConsumeBytes(16) + content[at + fdp.ConsumeIntInRange(0, 64):]
                self.write(name, content)
        if "scene.json" not in self.changed:
            self.write("scene.json", json.dumps(description).encode())
        try:
            scene = snapshot.read(self.folder, mapped=fdp.ConsumeBool())
        except SceneError as e:
            sentence(str(e))
        else:
            self.check(scene)

    def write(self, name: str, content: bytes) -> None:
        (self.folder / name).write_bytes(content)
        self.changed.add(name)

    def check(self, scene) -> None:
        """Check everything on which the renderer relies."""
        g = scene.geometry
        for v0, nv, t0, nt in g.meshes.tolist():
            assert 0 <= v0 <= v0 + nv <= len(g.vertices) and 0 <= t0 <= t0 + nt <= len(g.triangles)
            assert ((g.triangles[t0:t0 + nt] >= 0) & (g.triangles[t0:t0 + nt] < nv)).all()
        assert ((g.instance_mesh >= 0) & (g.instance_mesh < len(g.meshes))).all()
        assert ((g.instance_object >= 0) & (g.instance_object < len(scene.objects))).all()
        assert ((g.triangle_materials >= 0) & (g.triangle_materials < len(scene.materials))).all()
        assert len(g.instance_mesh) == len(g.instance_object) == len(g.instance_matrix)
        assert len(g.triangles) == len(g.corner_normals) == len(g.triangle_materials)
        assert np.isfinite(scene.camera.matrix).all() and scene.camera.width * scene.camera.height > 0
        for item in (scene.camera, scene.settings, *scene.lights, *scene.materials):
            for value in vars(item).values():
                if isinstance(value, float | tuple):
                    assert np.isfinite(value).all(), value
        for image in scene.images:
            assert ".." not in Path(image.path).parts


# --- Messages ---------------------------------------------------------------------------------------------------

GOOD_COMMANDS = [
    {"command": "render", "id": 1, "snapshot": "scene", "framebuffer": "frame", "passes": ["Combined"], "keep": True},
    {"command": "view", "id": 2, "snapshot": "scene", "framebuffer": "view", "passes": ["Depth"], "steps": [[2, 1]],
     "camera": None},
    {"command": "measure", "id": "three", "snapshot": "scene"},
    {"command": "cancel", "id": 4},
    {"command": "measure", "id": 4, "snapshot": "nowhere"},
]
GOOD_EVENTS = [
    {"event": "started", "id": 1, "width": 8, "height": 8, "passes": {"Combined": 4}},
    {"event": "progress", "id": 1, "fraction": 0.25, "stage": "Rendering"},
    {"event": "tile", "id": 1, "box": [0, 0, 8, 8]},
    {"event": "picture", "id": 7, "step": 0, "width": 8, "height": 8, "passes": {"Combined": 4}},
    {"event": "done", "id": 1, "statistics": {"width": 8, "height": 8, "triangles": 4, "lights": 1, "seconds": 0.5},
     "warnings": ["left out"]},
    {"event": "measured", "id": 2, "h": 0.05, "radii": [0.12, None]},
    {"event": "cancelled", "id": 1}, {"event": "error", "id": None, "message": "no"}, {"event": "alive"},
]


def message(fdp, good: list[dict]) -> bytes:
    """Return a good message with up to three changes, or random bytes."""
    if fdp.ConsumeIntInRange(0, 3) == 0:
        return fdp.ConsumeBytes(fdp.ConsumeIntInRange(0, 60)).replace(b"\n", b"")
    data = json.loads(json.dumps(good[fdp.ConsumeIntInRange(0, len(good) - 1)]))
    for _ in range(fdp.ConsumeIntInRange(0, 3)):
        found = list(places(data))
        path = found[fdp.ConsumeIntInRange(0, len(found) - 1)]
        kind = fdp.ConsumeIntInRange(0, 2)
        value = (odd(fdp), fdp.ConsumeInt(8), fdp.ConsumeUnicode(12))[kind]
        data = put(data, path, value)
    line = bytearray(json.dumps(data).encode())
    if fdp.ConsumeIntInRange(0, 3) == 0:
        at = fdp.ConsumeIntInRange(0, len(line))
        line[at:at + fdp.ConsumeIntInRange(0, 8)] = fdp.ConsumeBytes(8).replace(b"\n", b"")
    return bytes(line)


class Commands:
    """Send some commands to the engine. Each must be answered as the protocol says, and good ones must be carried
    out.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        follow(service, service.Service, snapshot)
        snapshot.write(tabletop(8, samples=1, shadows="SHARP"), folder / "scene")
        for command in GOOD_COMMANDS:  # so that all modules are loaded
            service.Service(None, io.StringIO(), folder)._carry_out(command)

    def __call__(self, data: bytes) -> None:
        fdp = atheris.FuzzedDataProvider(data)
        events = io.StringIO()
        engine = service.Service(None, events, self.folder)
        for _ in range(fdp.ConsumeIntInRange(1, 4)):
            engine._take(message(fdp, GOOD_COMMANDS) + b"\n")
        refused = len(events.getvalue().splitlines())
        expected = []
        while not engine._queue.empty():
            command = engine._queue.get()
            # The parent may name any path and ask for any number of steps, so these are limited here.
            if "/" in str(command.get("framebuffer")) or ".." in str(command.get("framebuffer")) \
                    or len(str(command.get("steps"))) > 20:
                continue
            if command["command"] != "quit":
                engine._carry_out(command)
                expected.append(command.get("id"))
        said = [json.loads(line) for line in events.getvalue().splitlines()]
        assert all(e["event"] == "error" and e["id"] is None for e in said[:refused])
        ends = [e["id"] for e in said[refused:] if e["event"] in ("done", "measured", "cancelled", "error")]
        assert ends == expected, (ends, expected)
        for event in said:
            if event["event"] == "error":
                sentence(event["message"])


class Events:
    """Read a line that the engine may have written. The result must be a valid event, or None."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "light-meshes-x"
        self.folder.mkdir()
        self.good = [{"event": "ready", "folder": str(self.folder)}, *GOOD_EVENTS]
        # Loaded by its path, because the package itself imports bpy.
        spec = importlib.util.spec_from_file_location("events", EVENTS)
        self.module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.module)
        follow(self.module)
        for event in self.good:
            assert self.module.read(json.dumps(event)) == event

    def __call__(self, data: bytes) -> None:
        fdp = atheris.FuzzedDataProvider(data)
        event = self.module.read(message(fdp, self.good).decode("utf-8", "replace"))
        if event is None:
            return
        kind = event["event"]
        if kind == "ready":
            assert Path(event["folder"]) == self.folder
        elif kind == "done":
            assert event["id"] >= 0 and all(isinstance(w, str) for w in event["warnings"])
            "{width}×{height} {triangles:,} {lights} {seconds:.2f}".format_map(event["statistics"])
        elif kind == "progress":
            assert 0 <= float(event["fraction"]) <= 1 and len(event["stage"]) >= 0
        elif kind == "measured":
            assert all(math.isfinite(x) for x in [event["h"], *event["radii"]] if x is not None)
        elif kind == "error":
            assert event["id"] is None or event["id"] >= 0
            assert isinstance(event["message"], str)
        elif kind != "alive":
            assert event["id"] >= 0


TARGETS = {"snapshot": Snapshots, "commands": Commands, "events": Events}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("inputs", nargs="*", help="give these files again, and no others")
    parser.add_argument("--seconds", type=int, default=0, help="end after so long")
    parser.add_argument("--runs", type=int, default=-1, help="end after so many inputs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--corpus", help="a folder that keeps what reached new branches, for the next time")
    options = parser.parse_args()
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # files there are fast
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=memory) as folder:
        if child := os.fork():  # libFuzzer ends its process, which would leave the folder behind
            return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        target = TARGETS[options.target](Path(folder))
        inputs = options.inputs or [c for c in (options.corpus,) if c]
        atheris.Setup([sys.argv[0], *inputs, f"-max_total_time={options.seconds}", f"-runs={options.runs}",
                       f"-seed={options.seed}", "-max_len=400", "-len_control=0", "-timeout=60",
                       "-print_final_stats=1"], target)
        atheris.Fuzz()
        return 0


if __name__ == "__main__":
    sys.exit(main())
