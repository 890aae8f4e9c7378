"""Temporary folders that are always removed in the end, however a process ends.

Each folder is locked by the process that made it. The system releases the lock when that process ends, even if it is
killed. So one of our folders without a lock belongs to a process that has ended, and the next start removes it. Where
folders cannot be locked (Windows, some network drives) none is removed, because it is not known whether its process
still runs.
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
except ImportError:  # on Windows
    fcntl = None  # type: ignore[assignment]

# Names of folders made on this machine: folders that another machine has locked on a shared disk may look unlocked
# here. Older releases did not lock folders.
_PREFIX = f"light-meshes-of-{re.sub('[^A-Za-z0-9]', '', socket.gethostname())[:40]}-"
_held: dict[Path, int] = {}  # the locks of this process


def make(parent: Path, hidden: bool = False) -> Path:
    """Make a new folder in `parent`, locked as long as this process runs. Folders of ended processes there are
    removed.
    """
    sweep(parent)
    while True:
        folder = Path(tempfile.mkdtemp(prefix="." * hidden + f"{_PREFIX}{os.getpid()}-", dir=parent))
        lock = _lock(folder, wait=True)
        if not folder.is_dir():  # another process removed it meanwhile as unlocked
            if lock is not None:
                os.close(lock)
            continue
        if lock is not None:
            _held[folder] = lock
        return folder


def remove(folder: Path) -> None:
    """Remove a folder of this process."""
    for _ in range(20):  # a process that still writes into it may be about to end
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            break
        time.sleep(0.05)
    if folder in _held:
        os.close(_held.pop(folder))


@contextlib.contextmanager
def made(parent: Path, hidden: bool = False) -> Iterator[Path]:
    """Do the same as `make`, and remove the folder at the end."""
    folder = None
    try:
        with interrupts.waiting():
            folder = make(parent, hidden)
        yield folder
    finally:
        if folder is not None:
            remove(folder)


def sweep(parent: Path) -> None:
    """Remove the folders in `parent` that ended processes of this user on this machine left behind."""
    for folder in _ours(parent):
        lock = _lock(folder)
        if lock is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(lock)


def end_owners(parent: Path, patience: float = 10.0) -> None:
    """Wait until all processes that made folders in `parent` have ended; kill those that do not end within `patience`
    seconds.
    """
    end = time.monotonic() + patience
    for folder in _ours(parent):
        while (lock := _lock(folder)) is None and folder.exists():
            if fcntl is None or folder in _held:
                return
            if time.monotonic() > end:
                with contextlib.suppress(OSError):  # it holds the lock, so the process number still belongs to it
                    os.kill(int(folder.name.rsplit("-", 2)[1]), signal.SIGKILL)
            time.sleep(0.02)
        if lock is not None:
            os.close(lock)


def _ours(parent: Path) -> list[Path]:
    """Return the folders here that processes of this user made."""
    found = []
    with contextlib.suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if entry.name.lstrip(".").startswith(_PREFIX) and hasattr(os, "getuid"):
                with contextlib.suppress(OSError):
                    if entry.is_dir(follow_symlinks=False) and entry.stat(follow_symlinks=False).st_uid == os.getuid():
                        found.append(Path(entry.path))
    return found


def _lock(folder: Path, wait: bool = False) -> int | None:
    """Return the lock as a file descriptor, to be closed later; None if another process has it, or if there are no
    locks.
    """
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
