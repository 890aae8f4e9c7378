"""The engine as a child process: one JSON object a line on stdin and stdout, log on stderr.

First the child writes
    {"event": "ready", "version": "0.2.0", "folder": PATH}
where PATH is a new private folder (mode 0700) that parent and child share. The child owns the folder and removes it
when it ends: after "quit", when its stdin closes (so it never outlives the parent), and on SIGTERM or SIGHUP. When a
child starts, it removes the folders of children that were killed.

Parent → child (paths are absolute, or relative to the folder; a snapshot is a folder with a scene.json, or any one
of the scene files in a folder; passes.py lists the passes):
    {"command": "render", "id": 1, "snapshot": "scene", "framebuffer": "frame", "passes": ["Combined", "Depth"]}
        "keep": true: keep what was prepared (accelerator, nodes). The next command with keep uses the parts that are
        still valid, which it decides by comparing their contents; the picture is the same. Default: keep nothing
        "threads": 4: the number of threads, also for view and measure; null: one for each processor
    {"command": "view", "id": 7, "snapshot": "scene-12.json", "framebuffer": "view", "passes": ["Combined"],
        "camera": {…}, "steps": [[8, 1], [4, 1], [2, 1], [1, 1], [1, 4]], "direct": true}
        a picture that gets better in steps of (divisor of the resolution, samples per pixel). It implies "keep". The
        snapshot is not read again if it is that of the last command with keep. camera: the camera of the rays, as in
        scene.json; h is still measured with the snapshot's own camera. null: use the snapshot's camera for both.
        direct: pictures of direct light may come first, if all light takes long; then some steps are left out
    {"command": "measure", "id": 2, "snapshot": "scene"}     the h that `auto_h` would choose for this scene,
        and r of each light whose softness is LIGHT_SIZE; null for other lights, and if r cannot be measured
    {"command": "cancel", "id": 1}                           ends that command at its next batch, or before it starts
    {"command": "quit"}
Child → parent:
    {"event": "started", "id": 1, "width": w, "height": h, "passes": {"Combined": 4, "Depth": 1}}
        the framebuffer files PASS.npy exist now: float32 (h, w, channels), rows bottom-up, zero where not done
    {"event": "progress", "id": 1, "fraction": 0.25, "stage": "Rendering, 12 of 48 tiles done"}
    {"event": "tile", "id": 1, "box": [x0, y0, x1, y1]}      these pixels are drawn
    {"event": "picture", "id": 7, "step": 0, "width": w, "height": h, "passes": {"Combined": 4}}
        a step of a view is done; its passes are FRAMEBUFFER/STEP/PASS.npy. Steps are counted from 0, those of direct
        light, too. A coarser picture shows exactly the same view as the full one; its sides are rounded up
    {"event": "done", "id": 1, "statistics": {…}, "warnings": [sentence, …]}      for a view: those of its last step,
        and under "steps" a few figures of each step
    {"event": "measured", "id": 2, "h": 0.05, "radii": [0.12, null]}
    {"event": "cancelled", "id": 1}
    {"event": "error", "id": 1, "message": sentence}         the child goes on, unless the id is null
    {"event": "alive"}                                       every second, so that a stopped child is noticed
Each command ends with exactly one of done, measured, cancelled, error. A command that arrives while another one runs
waits.
"""

from __future__ import annotations

import contextlib
import errno
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
from typing import TYPE_CHECKING, Any

from .. import __version__
from ..support import allocation, processors, scratch
from ..support.sources import KernelError

if TYPE_CHECKING:
    from ..scene.description import Scene
    from .views import Kept

ALIVE_SECONDS = 1.0
_FIGURES = ("width", "height", "samples", "seconds", "nodes", "nodes_kept", "long_rays", "short_rays", "shadow_rays")


class Service:
    """Reads commands in one thread and carries them out in the main thread."""

    def __init__(self, commands: Any, events: Any, folder: Path) -> None:
        self._commands, self._events, self._folder = commands, events, folder
        self._lock = threading.Lock()
        self._queue: queue.Queue[dict[str, Any]] = queue.Queue()
        self._cancelled: set[Any] = set()
        self._kept: Kept | None = None  # of the last command with keep
        self._snapshot: tuple[tuple, Scene] | None = None  # (file, its contents)

    def run(self) -> None:
        """Carry out commands until "quit"."""
        self._send(event="ready", version=__version__, folder=str(self._folder))
        threading.Thread(target=self._read, daemon=True).start()
        threading.Thread(target=self._alive, daemon=True).start()
        with contextlib.suppress(KernelError):  # the first command reports it
            from . import views  # noqa: F401  now, while the parent still writes its snapshot
        while True:
            try:
                message = self._queue.get(timeout=ALIVE_SECONDS)
            except queue.Empty:  # a signal that came just before this thread began to wait is handled now
                continue
            if message["command"] == "quit":
                return
            self._carry_out(message)

    def _carry_out(self, message: dict[str, Any]) -> None:
        number = message.get("id")
        try:
            from ..picture.render import Cancelled
        except KernelError as e:
            self._send(event="error", id=number, message=str(e))
            return
        from ..scene.errors import SceneError
        from ..support.text import quoted

        try:
            if number in self._cancelled:
                raise Cancelled
            processors.tell(_threads(message))
            if message["command"] == "render":
                self._render(number, message)
            elif message["command"] == "view":
                self._view(number, message)
            elif message["command"] == "measure":
                self._measure(number, message)
            else:
                raise SceneError(f"unknown command {quoted(message['command'])}")
        except Cancelled:
            self._send(event="cancelled", id=number)
        except SceneError as e:
            self._send(event="error", id=number, message=str(e))
        except MemoryError:
            self._kept = None
            self._send(event="error", id=number, message="the engine ran out of memory: render fewer pixels, "
                       "a larger h or fewer triangles")
        except OSError as e:
            self._send(event="error", id=number, message=_trouble(e, self._folder))
        except Exception as e:  # the last place to catch it: the parent must be told of every error
            traceback.print_exc()
            self._send(event="error", id=number, message=f"the engine failed: {type(e).__name__}: "
                       f"{str(e).strip().partition(chr(10))[0][:200]}")

    def _render(self, number: Any, message: dict[str, Any]) -> None:
        from ..film import images as film
        from ..picture import memory, render
        from ..scene import snapshot
        from .views import Kept

        keep = _checked(message, "keep", bool, False)
        if not keep:
            self._kept = self._snapshot = None
        scene = self._scene(message) if keep else snapshot.read(self._path(message, "snapshot"))
        passes = _passes(message)
        memory.check(memory.before(scene, passes, copies=2))
        frame = film.Framebuffer.create(scene, passes, self._path(message, "framebuffer"))
        self._send(event="started", id=number, width=frame.width, height=frame.height, passes=frame.channels)

        def progress(fraction: float, stage: str) -> None:
            self._send(event="progress", id=number, fraction=fraction, stage=stage)

        progress(0.0, "Preparing")
        ready = render.prepare(scene, passes, lambda: number in self._cancelled,
                               self._kept.before if self._kept else None, progress=progress)
        if keep:
            self._kept = Kept(whole=ready)
        done = render.draw(ready, frame, cancelled=lambda: number in self._cancelled, progress=progress,
                           tile=lambda box: self._send(event="tile", id=number, box=box))
        frame.flush()
        self._send(event="done", id=number, statistics=done.statistics, warnings=done.warnings)

    def _view(self, number: Any, message: dict[str, Any]) -> None:
        from ..scene import snapshot
        from . import views

        def progress(fraction: float, stage: str) -> None:
            self._send(event="progress", id=number, fraction=fraction, stage=stage)

        passes, steps, folder = _passes(message), _steps(message), self._path(message, "framebuffer")
        camera = None if message.get("camera") is None else snapshot.camera(message["camera"])
        scene, direct = self._scene(message), _checked(message, "direct", bool, False)
        self._kept = self._kept or views.Kept()
        figures = []
        for step, done in enumerate(views.pictures(
                self._kept, scene, camera, steps, passes, direct, lambda: number in self._cancelled, progress)):
            frame = done.frame
            frame.save(folder / str(step))
            self._send(event="picture", id=number, step=step, width=frame.width, height=frame.height,
                       passes=frame.channels)
            figures.append({name: done.statistics[name] for name in _FIGURES if name in done.statistics})
        self._send(event="done", id=number, statistics=done.statistics | {"steps": figures}, warnings=done.warnings)

    def _scene(self, message: dict[str, Any]) -> Scene:
        """Return the snapshot of a command with keep, in memory, because its files may change after the command has
        ended.
        """
        from ..scene import snapshot

        file = snapshot.scene_file(self._path(message, "snapshot"))
        version = file, file.stat().st_mtime_ns, file.stat().st_size
        if self._snapshot is None or self._snapshot[0] != version:
            self._snapshot = version, snapshot.read(file, mapped=False)
        return self._snapshot[1]

    def _measure(self, number: Any, message: dict[str, Any]) -> None:
        from ..picture import render
        from ..scene import snapshot

        scene = snapshot.read(self._path(message, "snapshot"))
        self._send(event="measured", id=number, **render.measure(scene))

    def _path(self, message: dict[str, Any], key: str) -> Path:
        from ..scene.errors import SceneError

        value: Any = message.get(key)
        try:
            if b"\0" not in os.fsencode(value):
                return self._folder / value
        except (TypeError, UnicodeEncodeError):
            pass
        raise SceneError(f"the command '{message['command']}' needs a path '{key}'")

    def _read(self) -> None:
        try:
            for line in self._commands:
                self._take(line)
        except MemoryError:  # without this thread the parent would hear nothing more
            os.write(sys.stderr.fileno(), b"out of memory\n")
            end(self._folder, 1)
        except (OSError, ValueError):
            pass
        end(self._folder)  # stdin is closed: the parent has ended

    def _take(self, line: bytes) -> None:
        try:
            message = json.loads(line)
            command, number = message["command"], message.get("id")
            if not isinstance(number, int | str | None):
                raise TypeError
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            self._send(event="error", id=None, message=f"not a command: {line.strip()[:80]!r}")
            return
        if command == "cancel":
            self._cancelled.add(number)
        else:
            self._queue.put(message)

    def _alive(self) -> None:
        wait = threading.Event()
        while not wait.wait(ALIVE_SECONDS):
            with contextlib.suppress(MemoryError):  # the next command may find enough memory
                self._send(event="alive")

    def _send(self, **message: Any) -> None:
        try:
            with self._lock:
                self._events.write(json.dumps(message) + "\n")
                self._events.flush()
        except OSError:
            end(self._folder)  # nobody reads the output


def _trouble(e: OSError, folder: Path) -> str:
    """Return a sentence for a file that could not be read or written."""
    if e.errno in (None, errno.ENOSPC, errno.EDQUOT, errno.EFBIG):  # numpy does not say why it wrote less
        return f"the disk is full: the engine writes to {folder}"
    return f"{e.filename or folder} cannot be used: {e.strerror}"


def _checked(message: dict[str, Any], key: str, kind: type, default: Any) -> Any:
    from ..scene.errors import SceneError
    from ..support.text import quoted

    value = message.get(key, default)
    if not isinstance(value, kind):
        raise SceneError(f"{key} is {quoted(value)}; it must be {'true or false' if kind is bool else 'a list'}")
    return value


def _passes(message: dict[str, Any]) -> list[str]:
    from ..scene.errors import SceneError

    passes = _checked(message, "passes", list, ["Combined"])
    if not all(isinstance(name, str) for name in passes):
        raise SceneError("passes must be a list of names")
    return list(passes)


def _threads(message: dict[str, Any]) -> int | None:
    from ..scene.errors import SceneError
    from ..support.text import quoted

    threads = message.get("threads")
    if threads is not None and not (type(threads) is int and 1 <= threads <= processors.MOST):
        raise SceneError(f"threads is {quoted(threads)}; it must be a whole number from 1 to {processors.MOST}")
    return threads


def _steps(message: dict[str, Any]) -> list[tuple[int, int]]:
    from ..scene.errors import SceneError
    from ..support.text import quoted

    steps = _checked(message, "steps", list, [[1, 1]])
    for step in steps:
        if not (isinstance(step, list) and len(step) == 2 and all(type(n) is int and 1 <= n <= 4096 for n in step)):
            raise SceneError(f"steps has {quoted(step)}; a step is a divisor of the resolution and a number of samples")
    if not steps:
        raise SceneError("steps is empty: a view needs at least one step")
    return [(divisor, samples) for divisor, samples in steps]


def end(folder: Path, code: int = 0) -> None:
    """Remove `folder` and end the process at once, from any thread."""
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(code)


def main() -> None:
    """Run the service on this process's stdin and stdout."""
    allocation.keep()
    events = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # a stray print must not break the protocol
    folder = scratch.make(Path(tempfile.gettempdir()))
    signal.signal(signal.SIGTERM, lambda *_: end(folder))
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, lambda *_: end(folder))
    # Ctrl-C reaches the whole process group; the parent decides what to do
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        Service(sys.stdin.buffer, events, folder).run()
    except BaseException:  # for example, a package cannot be loaded; the log shows it
        traceback.print_exc()
        end(folder, 1)
    end(folder)


if __name__ == "__main__":
    main()
