"""The engine as a child process: one JSON object a line on stdin and stdout, log on stderr.

The child says first
    {"event": "ready", "version": "0.1.0", "folder": PATH}
where PATH is a new private folder (mode 0700) that parent and child share; the child owns it and removes it when
it ends: on "quit", on a closed stdin (so nothing outlives the parent, however it died), on SIGTERM.

Parent → child (paths are relative to the folder, or absolute):
    {"command": "render", "id": 1, "snapshot": "scene", "framebuffer": "frame", "passes": ["Combined", "Depth"]}
    {"command": "measure", "id": 2, "snapshot": "scene"}     h that `auto_h` would take for this scene,
        and r of each light whose softness is LIGHT_SIZE
    {"command": "cancel", "id": 1}                           ends that command at its next batch, or before it starts
    {"command": "quit"}
Child → parent:
    {"event": "started", "id": 1, "width": w, "height": h, "passes": {"Combined": 4, "Depth": 1}}
        the framebuffer files PASS.npy exist now: float32 (h, w, channels), rows bottom-up, zero where not done
    {"event": "progress", "id": 1, "fraction": 0.25, "stage": "Rendering"}
    {"event": "tile", "id": 1, "box": [x0, y0, x1, y1]}      these pixels are final
    {"event": "done", "id": 1, "statistics": {…}, "warnings": [sentence, …]}
    {"event": "measured", "id": 2, "h": 0.05, "radii": {"Sun": 0.12}}
    {"event": "cancelled", "id": 1}
    {"event": "error", "id": 1, "message": sentence}         the child lives on, unless the id is null
    {"event": "alive"}                                       every second, so that a stopped child is noticed
Each command ends with exactly one of done, measured, cancelled, error. A command while one runs waits its turn.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import shutil
import signal
import sys
import tempfile
import threading
import traceback
from pathlib import Path
from typing import Any

from . import __version__

ALIVE_SECONDS = 1.0


class Service:
    """Reads commands in one thread, carries them out in the main one."""

    def __init__(self, commands: Any, events: Any, folder: Path) -> None:
        self._commands, self._events, self._folder = commands, events, folder
        self._lock = threading.Lock()
        self._queue: queue.Queue[dict[str, Any]] = queue.Queue()
        self._cancelled: set[Any] = set()

    def run(self) -> None:
        """Carry out commands until "quit"."""
        self._send(event="ready", version=__version__, folder=str(self._folder))
        threading.Thread(target=self._read, daemon=True).start()
        threading.Thread(target=self._alive, daemon=True).start()
        while True:
            message = self._queue.get()
            if message["command"] == "quit":
                return
            self._carry_out(message)

    def _carry_out(self, message: dict[str, Any]) -> None:
        from .render import Cancelled  # late: "ready" must not wait for numba
        from .scene import SceneError

        number = message.get("id")
        try:
            if number in self._cancelled:
                raise Cancelled
            if message["command"] == "render":
                self._render(number, message)
            elif message["command"] == "measure":
                self._measure(number, message)
            else:
                self._send(event="error", id=number, message=f"unknown command '{message['command']}'")
        except Cancelled:
            self._send(event="cancelled", id=number)
        except SceneError as e:
            self._send(event="error", id=number, message=str(e))
        except MemoryError:
            self._send(event="error", id=number, message="the engine ran out of memory: render fewer pixels, "
                       "a larger h or fewer triangles")
        except Exception as e:  # the boundary: whatever it is, the parent hears of it
            traceback.print_exc()
            self._send(event="error", id=number, message=f"the engine failed: {type(e).__name__}: "
                       f"{str(e).strip().partition(chr(10))[0][:200]}")

    def _render(self, number: Any, message: dict[str, Any]) -> None:
        from . import film, render, snapshot
        from .scene import SceneError

        scene = snapshot.read(self._path(message, "snapshot"))
        passes = message.get("passes", ["Combined"])
        if not isinstance(passes, list) or not all(isinstance(name, str) for name in passes):
            raise SceneError("passes must be a list of names")
        frame = film.Framebuffer.create(scene, passes, self._path(message, "framebuffer"))
        self._send(event="started", id=number, width=frame.width, height=frame.height, passes=frame.channels)
        done = render.render(
            scene, frame, cancelled=lambda: number in self._cancelled,
            progress=lambda fraction, stage: self._send(event="progress", id=number, fraction=fraction, stage=stage),
            tile=lambda box: self._send(event="tile", id=number, box=box),
        )
        frame.flush()
        self._send(event="done", id=number, statistics=done.statistics, warnings=done.warnings)

    def _measure(self, number: Any, message: dict[str, Any]) -> None:
        from . import render, snapshot

        scene = snapshot.read(self._path(message, "snapshot"))
        self._send(event="measured", id=number, **render.measure(scene))

    def _path(self, message: dict[str, Any], key: str) -> Path:
        from .scene import SceneError

        value = message.get(key)
        if not isinstance(value, str):
            raise SceneError(f"the command '{message['command']}' needs a path '{key}'")
        return self._folder / value

    def _read(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            for line in self._commands:
                try:
                    message = json.loads(line)
                    command, number = message["command"], message.get("id")
                    if not isinstance(number, int | str | None):
                        raise TypeError
                except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
                    self._send(event="error", id=None, message=f"not a command: {line.strip()[:80]!r}")
                    continue
                if command == "cancel":
                    self._cancelled.add(number)
                else:
                    self._queue.put(message)
        end(self._folder)  # stdin is closed: the parent is gone

    def _alive(self) -> None:
        wait = threading.Event()
        while not wait.wait(ALIVE_SECONDS):
            self._send(event="alive")

    def _send(self, **message: Any) -> None:
        try:
            with self._lock:
                self._events.write(json.dumps(message) + "\n")
                self._events.flush()
        except OSError:
            end(self._folder)  # nobody listens


def end(folder: Path) -> None:
    """Remove `folder` and end the process at once, from any thread."""
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(0)


def main() -> None:
    """Run the service on this process's stdin and stdout."""
    events = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # a stray print must not break the protocol
    folder = Path(tempfile.mkdtemp(prefix="light-meshes-"))
    signal.signal(signal.SIGTERM, lambda *_: end(folder))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the group; the parent decides
    try:
        Service(sys.stdin.buffer, events, folder).run()
    finally:
        end(folder)


if __name__ == "__main__":
    main()
