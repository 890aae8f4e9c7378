"""Temporary folders that nobody leaves behind, however a process ends.

Each is locked by the process that made it. The system takes the lock back when that process ends, also when it is
killed, so a folder of ours without a lock is of a dead process, and the next start removes it. Where folders cannot be
locked (Windows, some network drives) none is removed: nobody there can tell a dead process from a living one.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import socket
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from . import interrupts

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# This machine's: what another one that shares the disk has locked may look free from here. Older releases locked none.
_PREFIX = f"light-meshes-of-{re.sub('[^A-Za-z0-9]', '', socket.gethostname())[:40]}-"
_held: dict[Path, int] = {}  # the locks of this process


def make(parent: Path, hidden: bool = False) -> Path:
    """A new folder in `parent`, locked as long as this process lives; what dead processes left there goes."""
    sweep(parent)
    while True:
        folder = Path(tempfile.mkdtemp(prefix="." * hidden + f"{_PREFIX}{os.getpid()}-", dir=parent))
        lock = _lock(folder, wait=True)
        if lock is not None and not folder.is_dir():  # somebody swept in between
            os.close(lock)
            continue
        if lock is not None:
            _held[folder] = lock
        return folder


def remove(folder: Path) -> None:
    """Remove a folder of this process."""
    for _ in range(20):  # what still writes into it may be about to end
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            break
        time.sleep(0.05)
    if folder in _held:
        os.close(_held.pop(folder))


@contextlib.contextmanager
def made(parent: Path, hidden: bool = False) -> Iterator[Path]:
    """As `make`, and removed at the end."""
    folder = None
    try:
        with interrupts.waiting():
            folder = make(parent, hidden)
        yield folder
    finally:
        if folder is not None:
            remove(folder)


def sweep(parent: Path) -> None:
    """Remove what dead processes of this user and machine left in `parent`."""
    for folder in _ours(parent):
        lock = _lock(folder)
        if lock is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(lock)


def end_owners(parent: Path, patience: float = 10.0) -> None:
    """Wait until all processes have ended that made folders in `parent`; those that do not are killed."""
    end = time.monotonic() + patience
    for folder in _ours(parent):
        while (lock := _lock(folder)) is None and folder.exists():
            if fcntl is None or folder in _held:
                return
            if time.monotonic() > end:
                with contextlib.suppress(OSError):  # it holds the lock, so the number is still its own
                    os.kill(int(folder.name.rsplit("-", 2)[1]), signal.SIGKILL)
            time.sleep(0.02)
        if lock is not None:
            os.close(lock)


def _ours(parent: Path) -> list[Path]:
    """Folders made by this user's processes here."""
    found = []
    with contextlib.suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if entry.name.lstrip(".").startswith(_PREFIX) and hasattr(os, "getuid"):
                with contextlib.suppress(OSError):
                    if entry.is_dir(follow_symlinks=False) and entry.stat(follow_symlinks=False).st_uid == os.getuid():
                        found.append(Path(entry.path))
    return found


def _lock(folder: Path, wait: bool = False) -> int | None:
    """The lock, to be closed; None where another process has it, or where there are no locks."""
    if fcntl is None:
        return None
    lock = -1
    try:
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        return lock
    except OSError:
        if lock >= 0:
            os.close(lock)
        return None
