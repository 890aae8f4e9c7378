"""The engine's process: start it, send commands, poll for events, cancel, end it. This module does not use Blender.

In each direction one line holds one JSON object; the protocol is described in the engine's `service` module. The
process is kept between renders. It owns the folder that both sides share. It ends by itself when its stdin closes, so
it never outlives Blender, whatever ends Blender.
"""

import collections
import contextlib
import ctypes
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

from . import console, engine_python, events

POLITENESS = 5  # POSIX niceness of a polite engine
LAST_EVENTS = events.LAST
# Likely reasons for a signal that ended the engine.
_REASONS = {getattr(signal, "SIGKILL", None): "The system may have run out of memory",
            getattr(signal, "SIGBUS", None): "The disk may be full",
            signal.SIGSEGV: "It crashed, perhaps for want of memory",
            signal.SIGABRT: "It crashed, perhaps for want of memory"}
_OUT_OF_MEMORY = re.compile(r"out of memory|MemoryError|bad_alloc|cannot allocate memory|failed to map segment",
                            re.IGNORECASE)
LISTENED_SECONDS = 2.0  # we must have listened for this long without a pause before an engine is called silent


class EngineError(Exception):
    """The engine could not carry out a command. The message is for the artist; `log` is the end of the engine's log."""

    def __init__(self, message: str, log: str = "") -> None:
        super().__init__(message)
        self.log = log


class EngineGone(EngineError):  # noqa: N818  what it says, not what to call it
    """The engine's process has ended or hangs. A new process may succeed."""


def timeout() -> float:
    """Return the seconds of silence after which an engine counts as hanging. A working engine says "alive" every
    second.
    """
    text = os.environ.get("LIGHT_MESHES_TIMEOUT", "60")
    with contextlib.suppress(ValueError):
        if float(text) > 0:
            return float(text)
    raise EngineError(f"LIGHT_MESHES_TIMEOUT is '{text}': it must be a number of seconds above 0")


class Session:
    """A running engine. Only one thread at a time may use it.

    See `make_polite` for a process that lets Blender go first.
    """

    def __init__(self, python: str) -> None:
        self.python, self.temporary = python, engine_python.temporary()
        self.folder: Path | None = None  # shared with the engine; known once the engine is ready
        self.keeps = False  # whether it keeps what it prepared for the last render, for the next one
        self._number = 0
        self._folders = 0
        self._changed = threading.Condition()  # guards the next two attributes
        self._unfinished: set[int] = set()
        self._closed = False  # no more output will come
        self._events: queue.Queue[dict | None] = queue.Queue()
        self._log: collections.deque[str] = collections.deque(maxlen=60)
        timeout()  # raises an error now if the variable is wrong
        console.keep_standard_streams()
        try:
            # No other process has the other ends of the pipes, because close_fds is subprocess's default.
            self._process = subprocess.Popen(
                engine_python.command(python), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                env=engine_python.environment(), text=True, encoding="utf-8", errors="replace",
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as e:
            raise EngineError(f"The Light Meshes engine cannot start: {python} cannot be run ({e.strerror}). "
                              "Choose another Python in the add-on's preferences") from e
        self._heard = self._looked = self._listens_since = time.monotonic()
        # Threads are used because Windows cannot wait for a pipe with a timeout.
        self._readers = [threading.Thread(target=f, daemon=True) for f in (self._read_events, self._read_log)]
        for reader in self._readers:
            reader.start()

    def make_polite(self) -> None:
        """Give the process a lower priority, so that Blender goes first if both need the processor."""
        if hasattr(os, "setpriority"):
            with contextlib.suppress(OSError):  # the process has ended; `poll` reports it
                os.setpriority(os.PRIO_PROCESS, self._process.pid, POLITENESS)
        elif sys.platform == "win32":
            ctypes.windll.kernel32.SetPriorityClass(int(self._process._handle), subprocess.BELOW_NORMAL_PRIORITY_CLASS)

    @property
    def alive(self) -> bool:
        """Return whether the process runs, and its shared folder still exists (a cleaner of temporary files may have
        removed it).
        """
        running = self._process.poll() is None and not self._closed
        return running and (self.folder is None or self.folder.is_dir())

    @property
    def usable(self) -> bool:
        """Return whether another command may be sent: the process is alive and answers, and no cancelled command is
        still running.
        """
        return self.alive and not self._unfinished and self._silence <= timeout()

    @property
    def _silence(self) -> float:
        """Return the seconds since the engine's last message; messages to the engine do not count."""
        return time.monotonic() - self._heard

    def ends_within(self, seconds: float) -> bool:
        """Return whether the process has ended, or ends within this many seconds."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return not self.alive

    def new_folder(self) -> Path:
        """Make a new folder inside the shared one, for the snapshots and the framebuffer of one job."""
        assert self.folder, "the engine is not ready yet"
        self._folders += 1
        folder = self.folder / f"job-{self._folders}"
        folder.mkdir()
        return folder

    def send(self, command: str, **arguments) -> int:
        """Send a command, and return the number that its events will carry."""
        self._number += 1
        with self._changed:
            self._unfinished.add(self._number)
        self._write(command=command, id=self._number, **arguments)
        return self._number

    def poll(self, seconds: float) -> dict | None:
        """Return the next event, or None if none arrived within `seconds`. Raises EngineGone if the engine has ended or
        hangs.
        """
        now = time.monotonic()
        if now - self._looked > 1:  # Blender was busy, or the machine asleep; there may be output that was not read yet
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
        """Ask the engine to cancel command `number`, and wait for this for at most `seconds`.

        An engine that is still busy after that is ended in the background.
        """
        if self._ended(number, 0):
            return
        self.ask_to_cancel(number)
        if not self._ended(number, seconds):
            in_background(lambda: self._ended(number, 10 * seconds) or self.kill())  # type: ignore[func-returns-value]

    def ask_to_cancel(self, number: int) -> None:
        """Ask the engine to cancel command `number`, without waiting."""
        self._write(command="cancel", id=number)

    def _ended(self, number: int, seconds: float) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: self._closed or number not in self._unfinished, seconds)

    @property
    def log(self) -> str:
        """Return the end of the engine's log."""
        return "\n".join(self._log)

    def end(self, patience: float = 2.0) -> None:
        """End the process, first by request and then by signal, and make sure that its folder is removed."""
        self._write(command="quit")
        with contextlib.suppress(OSError), _broken_pipe_survived():  # the rest cannot be sent
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
        # If it has ended, `poll` says so, together with the log.
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
        """Return the error that says why the process is not alive."""
        if self.folder and self._process.poll() is None and not self._closed:
            return EngineGone(f"The folder {self.folder} of the Light Meshes engine has been removed", self.log)
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:  # it closed its output but still runs
            self._process.kill()
            self._process.wait()
        self._readers[1].join(1.0)  # the last lines of the log give the reason
        log = self.log
        lacking = engine_python.lacks_package(self.python, log)
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
    """Yield the lines of a stream. A line that is too long comes in parts."""
    return iter(lambda: stream.readline(events.LONGEST), "")


@contextlib.contextmanager
def _broken_pipe_survived():
    """Ignore SIGPIPE meanwhile. Blender, unlike Python's own program, leaves it on, and writing to an engine that has
    died would end Blender.
    """
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


# The purposes of engines. Each purpose has its own engine, because different threads use them.
RENDER, PREVIEW = "render", "preview"

_sessions: dict[str, Session] = {}
_waiting: list[Session] = []  # at most one, which the next that needs an engine takes; threads take it by pop()
_enders: list[threading.Thread] = []
statistics: dict = {}  # of the last render: the engine's figures, and its "scene" and "frame"


def current(purpose: str = RENDER) -> Session:
    """Return the engine for `purpose`, and start it if necessary. It may not be ready yet; poll it."""
    python = engine_python.chosen()
    session = _sessions.get(purpose)
    if session and not _fits(session, python):
        discard(purpose)
    if purpose not in _sessions:
        _sessions[purpose] = ready()
    return _sessions[purpose]


def _fits(session: Session, python: str) -> bool:
    return session.usable and session.python == python and session.temporary == engine_python.temporary()


def ready() -> Session:
    """Return an engine that nobody else uses: the one that waits, or a new one."""
    python = engine_python.chosen()
    with contextlib.suppress(IndexError):  # none waits
        session = _waiting.pop()
        if _fits(session, python):
            return session
        in_background(session.kill)
    return Session(python)


def wait_for_work() -> bool:
    """Start an engine that waits, unless there is one. Return whether it could be started, and lives."""
    try:
        if not _waiting:
            _waiting.append(Session(engine_python.chosen()))
        return all(session.alive for session in list(_waiting))  # none: it has been taken since
    except EngineError:  # the one that is asked for says why
        return False


def end_waiting() -> None:
    """End the engine that waits, without waiting for its end."""
    with contextlib.suppress(IndexError):
        in_background(_waiting.pop().end)


def forget() -> None:
    """Drop what was kept between renders, when it is of no more use; it is large."""
    for purpose in [p for p, session in _sessions.items() if session.keeps]:
        discard(purpose)


def discard(purpose: str = RENDER) -> None:
    """Give up the engine for `purpose` without waiting; a thread ends it."""
    session = _sessions.pop(purpose, None)
    if session:
        in_background(session.kill)


def in_background(end_one: Callable[[], object]) -> None:
    """Run a function that ends an engine in a new thread."""
    _enders[:] = [thread for thread in _enders if thread.is_alive()]
    _enders.append(threading.Thread(target=end_one))
    _enders[-1].start()


def end() -> None:
    """End all engines in an orderly way, and wait until they are gone. Otherwise an uninstallation would find files in
    use.
    """
    end_waiting()
    while _sessions:
        _sessions.popitem()[1].end()
    for thread in _enders:
        thread.join()
