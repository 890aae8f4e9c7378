"""The engine's process: start, send, poll, cancel, end. Knows nothing of Blender.

One JSON object a line goes each way; the protocol is described in the engine's `service` module. The process is
kept between renders. It owns the folder that both sides share and ends by itself when its stdin closes, so it
does not outlive Blender, however Blender ends.
"""

import collections
import contextlib
import errno
import json
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from . import console, events

MODULE = "light_meshes.frontends.service"
# Nothing of the current folder is run, which Python's -m would put in front; every Python knows this, unlike -P.
_START = f"import sys; sys.path[:] = [p for p in sys.path if p]; import runpy; runpy.run_module({MODULE!r}, " \
    "run_name='__main__')"
# Blender's own Python looks for packages where Blender does. Blender's path alone has those of an extension, and none
# that the user has for another Python.
_OWN_START = f"import sys; sys.path[:] = dict.fromkeys(sys.argv[1:] + sys.path); {_START}"
POLITENESS = 5  # POSIX's niceness of a polite engine
LAST_EVENTS = events.LAST
# What may be behind the signal that ended an engine.
_REASONS = {getattr(signal, "SIGKILL", None): "The system may have run out of memory",
            getattr(signal, "SIGBUS", None): "The disk may be full",
            signal.SIGSEGV: "It crashed, perhaps for want of memory",
            signal.SIGABRT: "It crashed, perhaps for want of memory"}
_OUT_OF_MEMORY = re.compile(r"out of memory|MemoryError|bad_alloc|cannot allocate memory|failed to map segment",
                            re.IGNORECASE)
LISTENED_SECONDS = 2.0  # for which we must have listened without a pause before an engine is called silent


class EngineError(Exception):
    """The engine did not do it. The message is for the artist; `log` is the end of the engine's log."""

    def __init__(self, message: str, log: str = "") -> None:
        super().__init__(message)
        self.log = log


class EngineGone(EngineError):  # noqa: N818  what it says, not what to call it
    """The engine's process has ended, or hangs. Another one may do it."""


def timeout() -> float:
    """Seconds of silence after which an engine hangs: it says "alive" every second."""
    text = os.environ.get("LIGHT_MESHES_TIMEOUT", "60")
    with contextlib.suppress(ValueError):
        if float(text) > 0:
            return float(text)
    raise EngineError(f"LIGHT_MESHES_TIMEOUT is '{text}': it must be a number of seconds above 0")


class Session:
    """A running engine. Made and used by one thread at a time.

    `polite`: it lets Blender go first where both want the processor.
    """

    def __init__(self, python: str, polite: bool = False) -> None:
        self.python, self.temporary = python, _temporary
        self.folder: Path | None = None  # shared with the engine, known once it is ready
        self.keeps = False  # what it prepared for the last render, for the next one
        self._number = 0
        self._folders = 0
        self._changed = threading.Condition()  # guards the next two
        self._unfinished: set[int] = set()
        self._closed = False  # nothing more will come
        self._events: queue.Queue[dict | None] = queue.Queue()
        self._log: collections.deque[str] = collections.deque(maxlen=60)
        timeout()  # raises where it is none
        console.keep_standard_streams()
        try:
            # Only this process holds the other ends of the pipes: close_fds is subprocess's default.
            self._process = subprocess.Popen(
                _command(python), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                env=_environment(), text=True, encoding="utf-8", errors="replace",
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0)
                | (getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0) if polite else 0),
            )
        except OSError as e:
            raise EngineError(f"The Light Meshes engine cannot start: {python} cannot be run ({e.strerror}). "
                              "Choose another Python in the add-on's preferences") from e
        if polite and hasattr(os, "setpriority"):
            with contextlib.suppress(OSError):  # it ended at once; poll says so
                os.setpriority(os.PRIO_PROCESS, self._process.pid, POLITENESS)
        self._heard = self._looked = self._listens_since = time.monotonic()
        # Threads, because Windows cannot wait for a pipe with a timeout.
        self._readers = [threading.Thread(target=f, daemon=True) for f in (self._read_events, self._read_log)]
        for reader in self._readers:
            reader.start()

    @property
    def alive(self) -> bool:
        """Whether it runs, and no cleaner of temporary files took the shared folder away."""
        running = self._process.poll() is None and not self._closed
        return running and (self.folder is None or self.folder.is_dir())

    @property
    def usable(self) -> bool:
        """Whether another command may be sent: it lives and is heard of, and nothing is left that was cancelled but
        goes on.
        """
        return self.alive and not self._unfinished and self._silence <= timeout()

    @property
    def _silence(self) -> float:
        """Seconds since the engine's last word; what we say to it does not count."""
        return time.monotonic() - self._heard

    def ends_within(self, seconds: float) -> bool:
        """Whether it is not alive, or not any more in so many seconds."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return not self.alive

    def new_folder(self) -> Path:
        """A new folder in the shared one, for the snapshots and the framebuffer of one job."""
        assert self.folder, "the engine is not ready yet"
        self._folders += 1
        folder = self.folder / f"job-{self._folders}"
        folder.mkdir()
        return folder

    def send(self, command: str, **arguments) -> int:
        """Send a command; the number that its events will carry."""
        self._number += 1
        with self._changed:
            self._unfinished.add(self._number)
        self._write(command=command, id=self._number, **arguments)
        return self._number

    def poll(self, seconds: float) -> dict | None:
        """The next event, or None if there was none for `seconds`. Raises EngineGone when the engine is gone."""
        now = time.monotonic()
        if now - self._looked > 1:  # Blender was busy, or the machine asleep: what was said may not be read yet
            self._listens_since = now
        self._looked = now
        try:
            event = self._events.get(timeout=seconds)
        except queue.Empty:
            if self._silence > timeout() and time.monotonic() - self._listens_since > LISTENED_SECONDS:
                raise EngineGone(f"The Light Meshes engine does not answer any more: "
                                 f"it was silent for {timeout():g} seconds and has been ended", self.log) from None
            return None
        if event is None:
            raise self.gone()
        return event

    def cancel(self, number: int, seconds: float) -> None:
        """Ask the engine to give command `number` up and wait for it, but no longer than `seconds`.

        An engine that goes on after that is ended in the background.
        """
        if self._ended(number, 0):
            return
        self.ask_to_cancel(number)
        if not self._ended(number, seconds):
            in_background(lambda: self._ended(number, 10 * seconds) or self.kill())  # type: ignore[func-returns-value]

    def ask_to_cancel(self, number: int) -> None:
        """Ask the engine to give command `number` up, and go on without waiting."""
        self._write(command="cancel", id=number)

    def _ended(self, number: int, seconds: float) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: self._closed or number not in self._unfinished, seconds)

    @property
    def log(self) -> str:
        """The end of the engine's log."""
        return "\n".join(self._log)

    def end(self, patience: float = 2.0) -> None:
        """End the process by request, then by signal, and see that its folder is gone."""
        self._write(command="quit")
        with contextlib.suppress(OSError), _broken_pipe_survived():  # what was not sent cannot be
            self._process.stdin.close()  # type: ignore[union-attr]  # a request too, which waits for no render to end
        for insist in (self._process.terminate, self._process.kill):
            try:
                self._process.wait(patience)
                break
            except subprocess.TimeoutExpired:
                insist()
        self._process.wait()
        if self.folder:
            shutil.rmtree(self.folder, ignore_errors=True)

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self.end()

    def _write(self, **message) -> None:
        # When it has ended, poll says so, with the log.
        with contextlib.suppress(OSError, ValueError), _broken_pipe_survived():
            print(json.dumps(message), file=self._process.stdin, flush=True)

    def _read_events(self) -> None:
        for line in _lines(self._process.stdout):
            event = events.read(line)
            if event is None:
                self._log.append(line[:1000].rstrip())
                continue
            self._heard = time.monotonic()
            kind = event["event"]
            if kind == "alive" or (kind == "ready" and self.folder):
                continue
            if kind == "ready":
                self.folder = Path(event["folder"])
            if kind in LAST_EVENTS:
                with self._changed:
                    self._unfinished.discard(event["id"])
                    self._changed.notify_all()
            self._events.put(event)
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._events.put(None)

    def _read_log(self) -> None:
        for line in _lines(self._process.stderr):
            self._log.append(line[:1000].rstrip())

    def gone(self) -> EngineError:
        """Why it is not alive."""
        if self.folder and self._process.poll() is None and not self._closed:
            return EngineGone(f"The folder {self.folder} of the Light Meshes engine has been removed", self.log)
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:  # it closed its output, and lives
            self._process.kill()
            self._process.wait()
        self._readers[1].join(1.0)  # the log's last lines say why
        log = self.log
        lacking = lacks_package(self.python, log)
        if lacking:
            return EngineError(lacking, log)
        code = self._process.returncode
        how = f"killed by signal {-code}" if code < 0 else f"exit code {code}"
        when = "has ended unexpectedly" if self.folder else "cannot start"
        reason = _REASONS.get(-code, "")
        if _OUT_OF_MEMORY.search(log):
            reason = "It ran out of memory: render fewer pixels, a larger h or fewer triangles"
        return EngineGone(f"The Light Meshes engine {when} ({how})" + (reason and f". {reason}"), log)


def _lines(stream) -> Iterator[str]:
    """The lines of a stream; what never ends one comes in parts."""
    return iter(lambda: stream.readline(events.LONGEST), "")


@contextlib.contextmanager
def _broken_pipe_survived():
    """Blender leaves SIGPIPE as it is, unlike Python's own program: writing to an engine that died would end it."""
    if not hasattr(signal, "SIGPIPE"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGPIPE})
    try:
        yield
    finally:
        if signal.SIGPIPE in signal.sigpending() and signal.SIGPIPE not in before:
            signal.sigwait({signal.SIGPIPE})
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def lacks_package(python: str, text: str) -> str:
    """The sentence for an import that failed, if `text` tells of one, or an empty string."""
    found = re.search(r"No module named '?([\w.]+)'?", text)
    if not found:
        return ""
    how = f"Install the engine with '{python} -m pip install light-meshes'"
    if _installed and python == sys.executable:
        how = f"Install the add-on's zip for this system and Python {sys.version_info[0]}.{sys.version_info[1]}"
    return (f"The Light Meshes engine cannot start: {python} has no package '{found[1].split('.')[0]}'. {how}, "
            "or choose another Python in the add-on's preferences")


# What an engine is for; each has its own, as they are used by several threads.
RENDER, PREVIEW, MEASURE = "render", "preview", "measure"

_python = ""
_installed = False
_temporary = ""
_sessions: dict[str, Session] = {}
_enders: list[threading.Thread] = []
statistics: dict = {}  # of the last render: its "scene" and "frame", and what the engine gave


def set_python(python: str) -> None:
    """Remember the Python that the artist chose; an empty string means this one."""
    global _python
    _python = python


def engine_python() -> str:
    """The Python that runs the engine."""
    return os.environ.get("LIGHT_MESHES_PYTHON") or _python or sys.executable


def set_installed(installed: bool) -> None:
    """Remember whether the add-on came as a zip, which holds the engine as well."""
    global _installed
    _installed = installed


def set_temporary(folder: str) -> None:
    """Remember the folder where the next engines make theirs, the one that Blender's preferences name."""
    global _temporary
    _temporary = folder


def _command(python: str) -> list[str]:
    if python != sys.executable:
        return [_program(python), "-c", _START]
    named, here = _python_path(), os.path.realpath(_current_folder())
    paths = [p for p in sys.path if p and Path(p).exists() and (p in named or os.path.realpath(p) != here)]
    return [python, "-I", "-c", _OWN_START, *(str(Path(p).absolute()) for p in paths)]


def _program(name: str) -> str:
    """The program that `name` means, which is never one of the current folder, unless its path is given."""
    if Path(name).name != name:
        return name
    for folder in os.get_exec_path():
        found = Path(folder).is_absolute() and shutil.which(str(Path(folder, name)))
        if found:
            return found
    raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))


def _current_folder() -> str:
    try:
        return os.getcwd()  # noqa: PTH109
    except OSError:  # it was removed
        return ""


def _python_path() -> list[str]:
    """The folders that PYTHONPATH names; an empty entry or "." would be the current one."""
    return [p for p in os.environ.get("PYTHONPATH", "").split(os.pathsep) if p and os.path.normpath(p) != os.curdir]


def _environment() -> dict[str, str]:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(_python_path())}  # an empty one counts as none
    if _temporary:
        environment["TMPDIR"] = _temporary  # on Windows, too, it comes before TEMP
    return environment


def current(purpose: str = RENDER) -> Session:
    """The engine for `purpose`, started if need be. It may not be ready yet: poll it."""
    python = engine_python()
    session = _sessions.get(purpose)
    if session and not (session.usable and session.python == python and session.temporary == _temporary):
        discard(purpose)
    if purpose not in _sessions:
        _sessions[purpose] = Session(python)
    return _sessions[purpose]


def forget() -> None:
    """What was kept between renders is of no use any more, and large."""
    for purpose in [p for p, session in _sessions.items() if session.keeps]:
        discard(purpose)


def discard(purpose: str = RENDER) -> None:
    """Give the engine for `purpose` up without waiting: a thread ends it."""
    session = _sessions.pop(purpose, None)
    if session:
        in_background(session.kill)


def in_background(end_one: Callable[[], object]) -> None:
    """Have an engine ended by a thread."""
    _enders[:] = [thread for thread in _enders if thread.is_alive()]
    _enders.append(threading.Thread(target=end_one))
    _enders[-1].start()


def end() -> None:
    """End all engines in good order, and wait until all are gone: an uninstallation is to find no file in use."""
    while _sessions:
        _sessions.popitem()[1].end()
    for thread in _enders:
        thread.join()
