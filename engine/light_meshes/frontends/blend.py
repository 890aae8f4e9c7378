""".blend files for the command line. A separate Blender process reads them through the add-on.

Nothing here imports bpy, because it ends some processes badly (4.2 and 4.5 crash or hang at exit). A `blender` on the
PATH can be used as well.
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

MARK = "@light-meshes "  # a script in Blender puts this before each message to us
# The driver's events, and the entries of each that are used here.
_EVENTS: dict[str, dict[str, tuple[type, ...]]] = {
    "progress": {"fraction": (int, float), "frame": (int,), "stage": (str,)},
    "wrote": {"path": (str,)}, "kept": {"path": (str,)}, "warning": {"message": (str,)}, "error": {"message": (str,)},
    "found": {"path": (str,)}, "statistics": {"statistics": (dict,)}, "end": {},
}
_CRASHES = (-signal.SIGSEGV, -signal.SIGABRT, -9)  # 9: the system ends a process that uses too much memory
_LONGEST = 2**24  # characters in a line; a longer line arrives in parts, and none of these is an event
PATIENCE = 3.0  # the seconds in which a driver must end by itself
Changes = list[tuple[str, str]]


def driver() -> list[str]:
    """Return the command that runs the add-on's headless driver. Raises SceneError if there is no Blender."""
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
    """Return the `blender` on the PATH. Entries that mean the current folder are ignored."""
    folders = filter(os.path.isabs, os.get_exec_path())
    return next(filter(None, (shutil.which(str(Path(folder, "blender"))) for folder in folders)), None)


def environment() -> dict[str, str]:
    """Return the environment for a child process. Its PYTHONPATH has no empty entry or ".", which would mean the
    current folder.
    """
    folders = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    named = [folder for folder in folders if folder and os.path.normpath(folder) != os.curdir]
    return os.environ | {"PYTHONPATH": os.pathsep.join(named)}  # an empty value counts as not set


def render(file: Path, output: Path, frames: str | None, resume: bool, threads: int | None, changes: Changes,
           progress: Callable[[float, str], None], debug: bool) -> tuple[list[str], dict[Path, bool], dict[str, Any]]:
    """Render frames of a .blend in the same way as Blender. `resume` skips frames whose picture exists.

    Returns warnings, the pictures and whether each was rendered, and the statistics of the last frame.
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
    """Return the folder for pictures that are not complete yet, beside their final place."""
    try:
        return scratch.made(folder, hidden=True)
    except OSError as e:
        raise SceneError(f"the folder {folder} cannot be written: {e.strerror}") from e


def _events(arguments: list[str], changes: Changes, debug: bool) -> Generator[dict[str, Any]]:
    """Yield the events of the driver. Its error is raised as SceneError (UsageError for exit code 2)."""
    command = driver() + arguments + [word for key, value in changes for word in ("--set", f"{key}={value}")]
    # for this run only: no name in the file and no output of a script can contain it
    mark = f"@light-meshes-{secrets.token_hex(16)} "
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
    if code or not ended:  # a script in the file may have ended it
        words = " | ".join(filter(None, tail))
        why = ", perhaps for want of memory" if code in _CRASHES or console.OUT_OF_MEMORY.search(words) else ""
        raise SceneError(f"Blender ended with code {code}{why}; its last words: {words}")


@contextlib.contextmanager
def _running(command: list[str], mark: str) -> Iterator[Any]:
    """Run the driver's process with pipes to and from it. At the end the process, its engine and its temporary files
    are gone.

    The driver reads its stdin as long as it runs. When stdin closes, this process has ended, and then the driver ends
    too.
    """
    with scratch.made(Path(tempfile.gettempdir())) as temporary:
        # for Blender's and the engine's temporary files
        places = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary))
        # The engine runs in this Python, whatever Python Blender contains.
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
    with contextlib.suppress(OSError):  # it has ended; its stdout shows this
        child.stdin.write(f"{text}\n")
        child.stdin.flush()


def _event(text: str) -> dict[str, Any] | None:
    """Return the event in `text`, or None if it is none, because other output may come between."""
    try:
        event = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(event, dict) or not isinstance(event.get("event"), str):
        return None
    contents = _EVENTS.get(event["event"])
    right = contents is not None and all(type(event.get(key)) in kinds for key, kinds in contents.items())
    return event if right else None
