"""Cells of the contest: one picture, or one flight, by one method, in a Blender process of its own.

A cell that is done stays in its folder and is not rendered again. One that fails leaves error.txt there, and the others
go on. Memory is the sum of the largest resident memories of the process and of all that it started, looked at twice a
second, only on systems with /proc: an upper bound, as pages that two of them map count twice.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..frontends.blend import environment
from ..scene.errors import SceneError
from .scenes import blend_folder

EVERY = 0.5  # seconds between two looks at the memory, which cost processor time themselves
RESULT, ERROR, REQUEST = "result.json", "error.txt", "request.json"


@dataclass(frozen=True)
class Way:
    """A method with its settings: this engine at a level, or Cycles with so many samples."""

    engine: str  # LIGHT_MESHES, CYCLES, or GUIDES: Cycles' passes of what is seen
    level: str = ""  # of this engine: DRAFT, BALANCED or FINE
    samples: int = 1  # of Cycles
    denoise: bool = False
    reference: bool = False  # Cycles with another seed, and nothing clamped

    @property
    def name(self) -> str:
        """Return its name as a folder."""
        if self.engine != "CYCLES":
            return self.level.lower() or self.engine.lower()
        return f"{'reference' if self.reference else 'cycles'}_{self.samples}{'_denoised' * self.denoise}"

    @property
    def label(self) -> str:
        """Return its name in tables."""
        if self.engine == "LIGHT_MESHES":
            return f"Light Meshes, {self.level.capitalize()}"
        return f"Cycles {self.samples}{', denoised' * self.denoise}"


@dataclass(frozen=True)
class Cell:
    """A way on frames of a scene, at one size."""

    scene: str
    way: Way
    size: tuple[int, int]
    frames: tuple[int, ...]

    def folder(self, out: Path) -> Path:
        """Return where its pictures and its result are."""
        kind = f"{self.frames[0]}" if len(self.frames) == 1 else f"{self.frames[0]}-{self.frames[-1]}"
        return out / self.scene / f"{self.size[0]}x{self.size[1]}" / kind / self.way.name

    def picture(self, out: Path, frame: int, suffix: str = ".exr") -> Path:
        """Return the path of a frame's picture."""
        return self.folder(out) / f"frame_{frame:04}{suffix}"


def result(cell: Cell, out: Path) -> dict[str, Any] | None:
    """Return what a cell that is done has measured, or None."""
    path = cell.folder(out) / RESULT
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if all(cell.picture(out, n).is_file() for n in cell.frames) else None


def run(cell: Cell, out: Path, blender: str | None, threads: int, patience: float) -> dict[str, Any] | None:
    """Render a cell that is not done, and return its result; None if it failed, then error.txt in its folder says why.

    `blender`: the program, or None for bpy in this Python. `patience`: the seconds after which it is ended.
    """
    done = result(cell, out)
    if done is not None:
        return done
    folder = cell.folder(out)
    folder.mkdir(parents=True, exist_ok=True)
    for old in (RESULT, ERROR):
        (folder / old).unlink(missing_ok=True)
    width, height = cell.size
    request = {"file": str((out / "scenes" / f"{cell.scene}.blend").resolve()), "width": width, "height": height,
               "frames": cell.frames, "threads": threads, "output": str(folder.resolve()), "addon": str(addon()),
               "engine": cell.way.engine, "level": cell.way.level, "samples": cell.way.samples,
               "denoise": cell.way.denoise, "reference": cell.way.reference}
    (folder / REQUEST).write_text(json.dumps(request), encoding="utf-8")
    code, said, peak = _watched([*program(blender, "cell.py"), str((folder / REQUEST).resolve())], patience)
    done = result(cell, out)
    if done is None:
        why = f"not done after {patience:g} s" if code is None else f"exit code {code}"
        (folder / ERROR).write_text(f"{why}\n{said[-4000:]}", encoding="utf-8")
        return None
    done["memory"] = peak
    (folder / RESULT).write_text(json.dumps(done), encoding="utf-8")
    return done


def make_scenes(names: list[str], out: Path, blender: str | None) -> None:
    """Make those .blend files of the contest that are not in OUT/scenes yet."""
    folder = out / "scenes"
    folder.mkdir(parents=True, exist_ok=True)
    missing = [name for name in names if not (folder / f"{name}.blend").is_file()]
    if missing:
        _, said, _ = _watched([*program(blender, "make.py"), str(folder.resolve()), *missing], 600)
        if lost := [name for name in missing if not (folder / f"{name}.blend").is_file()]:
            raise SceneError(f"{', '.join(lost)}: not made by blend_scenes/contest/make.py: {said.strip()[-400:]}")


def program(blender: str | None, script: str) -> list[str]:
    """Return the command that runs a script of blend_scenes/contest; its arguments follow."""
    path = str(blend_folder() / "contest" / script)
    if blender:
        return [blender, "-b", "--factory-startup", "--python-exit-code", "1", "-P", path, "--"]
    if not importlib.util.find_spec("bpy"):
        raise SceneError("the contest needs Blender: install the 'blender' extra, or name one with --blender")
    return [sys.executable, "-P", path]


def addon() -> Path:
    """Return the folder of the add-on that is installed beside the engine."""
    found = importlib.util.find_spec("light_meshes_addon")
    if found is None or found.origin is None:
        raise SceneError("the add-on is not installed beside the engine: install the project with pip again")
    return Path(found.origin).resolve().parent


def _watched(command: list[str], patience: float) -> tuple[int | None, str, int | None]:
    """Run a command. Returns its exit code (None: it was ended), what it said, and the largest memory in bytes."""
    peaks: dict[int, int] = {}
    end = time.monotonic() + patience
    own = environment() | {"LIGHT_MESHES_PYTHON": sys.executable}
    child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                             text=True, errors="replace", env=own, start_new_session=os.name == "posix")
    try:
        while True:
            try:
                said, _ = child.communicate(timeout=min(EVERY, patience))
                return child.returncode, said, sum(peaks.values()) or None
            except subprocess.TimeoutExpired:
                peaks |= memory(child.pid)
                if time.monotonic() > end:
                    return None, "", None
    finally:
        if child.poll() is None:
            _end(child)


def _end(child: subprocess.Popen[str]) -> None:
    """End a process and what it started."""
    with contextlib.suppress(OSError):
        if os.name == "posix":
            os.killpg(child.pid, signal.SIGKILL)
        else:
            child.kill()
    child.wait()


def memory(process: int) -> dict[int, int]:
    """Return the largest resident memory that a process and each below it had so far, in bytes, by process id; nothing
    where the system does not tell.
    """
    parents: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError, IndexError, ValueError):
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    family = {process}
    while more := {child for child, parent in parents.items() if parent in family} - family:
        family |= more
    found = {}
    for one in family:
        with contextlib.suppress(OSError, IndexError, ValueError):
            status = Path(f"/proc/{one}/status").read_text()
            found[one] = int(status.partition("\nVmHWM:")[2].split()[0]) * 1024
    return found
