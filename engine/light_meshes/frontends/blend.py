""".blend files for the command line: Blender reads them, in a process of its own, through the add-on.

Nothing here imports bpy: it ends some processes badly (4.2 and 4.5 crash or hang at exit), and a `blender` on the
PATH does as well.
"""

from __future__ import annotations

import collections
import contextlib
import importlib.util
import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

from ..film import images as film
from ..scene.errors import SceneError, UsageError
from ..support import console, interrupts, scratch

MARK = "@light-meshes "  # what a script in Blender says to us comes behind it
# What the driver says: its events, and what of them is used here.
_EVENTS: dict[str, dict[str, tuple[type, ...]]] = {
    "progress": {"fraction": (int, float), "frame": (int,), "stage": (str,)},
    "wrote": {"path": (str,)}, "kept": {"path": (str,)}, "warning": {"message": (str,)}, "error": {"message": (str,)},
    "found": {"path": (str,)}, "statistics": {"statistics": (dict,)}, "end": {},
}
_CRASHES = (-signal.SIGSEGV, -signal.SIGABRT, -9)  # 9: the system ends what takes too much
_LONGEST = 2**24  # characters of a line; what is longer comes in parts, of which none is an event
PATIENCE = 3.0  # seconds that a driver has to end by itself
Changes = list[tuple[str, str]]


def driver() -> list[str]:
    """The command that runs the add-on's headless driver. Raises SceneError where no Blender is to be had."""
    addon = importlib.util.find_spec("light_meshes_addon")
    if addon is None or addon.origin is None:
        raise SceneError("the add-on is not installed beside the engine: install the project with pip again")
    if importlib.util.find_spec("bpy"):
        return [sys.executable, "-P", "-m", "light_meshes_addon.headless"]
    found = blender()
    if found:
        script = Path(addon.origin).with_name("headless.py")
        return [found, "-b", "--factory-startup", "-P", str(script), "--"]
    raise SceneError(
        "a .blend file needs Blender to read it: install the 'blender' extra of this project with Python 3.11 or 3.13 "
        f"(bpy has wheels for no others; this is {sys.version_info.major}.{sys.version_info.minor}), or put a blender "
        "of version 4.2 or later on the PATH")


def blender() -> str | None:
    """The `blender` on the PATH, of which entries that mean the current folder do not count."""
    folders = filter(os.path.isabs, os.get_exec_path())
    return next(filter(None, (shutil.which(str(Path(folder, "blender"))) for folder in folders)), None)


def environment() -> dict[str, str]:
    """Ours for a child, whose PYTHONPATH does not mean the current folder by an empty entry or "."."""
    folders = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    named = [folder for folder in folders if folder and os.path.normpath(folder) != os.curdir]
    return os.environ | {"PYTHONPATH": os.pathsep.join(named)}  # an empty one counts as none


def render(file: Path, output: Path, frames: str | None, resume: bool, threads: int | None, changes: Changes,
           progress: Callable[[float, str], None], debug: bool) -> tuple[list[str], dict[Path, bool], dict[str, Any]]:
    """Render frames of a .blend as Blender would; `resume` leaves out those whose picture is there.

    Returns warnings, the pictures and whether each was rendered, and the last's statistics.
    """
    arguments = ["render", str(file), "-o", str(output), *(["--resume"] if resume else []),
                 *([f"--frames={frames}"] if frames else []), *([f"--threads={threads}"] if threads else [])]
    warnings, pictures = [], {}
    statistics: dict[str, Any] = {}
    with _work_folder(output.absolute().parent) as work, contextlib.closing(
            _events([*arguments, "--work", str(work)], changes, debug)) as events:
        for event in events:
            if event["event"] == "progress":
                progress(event["fraction"], f"frame {event['frame']}: {event['stage']}")
            elif event["event"] == "warning":
                warnings.append(event["message"])
            elif event["event"] in ("wrote", "kept"):
                pictures[Path(event["path"])] = event["event"] == "wrote"
            elif event["event"] == "statistics":
                statistics = event["statistics"]
    return warnings, pictures, statistics


def export(file: Path, folder: Path, changes: Changes, debug: bool) -> None:
    """Write the snapshot of a .blend's current frame into `folder`."""
    with contextlib.closing(_events(["snapshot", str(file), "-o", str(folder)], changes, debug)) as events:
        for _ in events:
            pass


def _work_folder(folder: Path) -> contextlib.AbstractContextManager[Path]:
    """Where pictures are written before they are whole, beside their place."""
    try:
        return scratch.made(folder, hidden=True)
    except OSError as e:
        raise SceneError(f"the folder {folder} cannot be written: {e.strerror}") from e


def _events(arguments: list[str], changes: Changes, debug: bool) -> Generator[dict[str, Any]]:
    """What the driver says, event by event; its error is raised as SceneError (UsageError for exit code 2)."""
    command = driver() + arguments + [word for key, value in changes for word in ("--set", f"{key}={value}")]
    mark = f"@light-meshes-{secrets.token_hex(16)} "  # of this run: no name in the file knows it, nor a script's output
    tail: collections.deque[str] = collections.deque(maxlen=5)
    error, ended = "", False
    with _running(command, mark) as child:
        for line in iter(lambda: child.stdout.readline(_LONGEST), ""):
            noise, _, text = line.partition(mark)  # Blender does not end each of its lines
            if debug and noise:
                console.say(noise.rstrip("\n"), sys.stderr)
            event = _event(text)
            if event is None:
                tail.append(line.strip()[:200])
            elif event["event"] == "error":
                error = event["message"]
            elif event["event"] == "end":
                ended = True
            elif event["event"] == "found":
                _answer(child, "whole" if film.whole(Path(event["path"])) else "broken")
            else:
                yield event
        code = child.wait()
    if error:
        raise UsageError(error) if code == 2 else SceneError(error)
    if code or not ended:  # a script may have ended it
        words = " | ".join(filter(None, tail))
        why = ", perhaps for want of memory" if code in _CRASHES or console.OUT_OF_MEMORY.search(words) else ""
        raise SceneError(f"Blender ended with code {code}{why}; its last words: {words}")


@contextlib.contextmanager
def _running(command: list[str], mark: str) -> Iterator[Any]:
    """The driver's process, with pipes to and from it. At the end it is gone, with its engine and temporary files.

    While it lives it reads its stdin: when that closes this process is gone, and so it goes, too.
    """
    with scratch.made(Path(tempfile.gettempdir())) as temporary:
        places = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary))  # Blender's and the engine's
        # Whatever Python Blender has inside, the engine runs in this one.
        own = {"LIGHT_MESHES_PYTHON": sys.executable, "LIGHT_MESHES_MARK": mark,
               "LIGHT_MESHES_TEMPORARY": str(temporary)}
        child = None
        try:
            with interrupts.waiting():
                child = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8",
                    errors="replace", env=environment() | places | own)
            yield child
        finally:
            if child is not None:
                _end(child)
            scratch.end_owners(temporary)


def _end(child: Any) -> None:
    child.terminate()
    try:
        child.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def _answer(child: Any, text: str) -> None:
    with contextlib.suppress(OSError):  # it has ended, which its stdout tells
        child.stdin.write(f"{text}\n")
        child.stdin.flush()


def _event(text: str) -> dict[str, Any] | None:
    """The event in `text`, or None where it is none: what others print may have come between."""
    try:
        event = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(event, dict) or not isinstance(event.get("event"), str):
        return None
    contents = _EVENTS.get(event["event"])
    right = contents is not None and all(type(event.get(key)) in kinds for key, kinds in contents.items())
    return event if right else None
