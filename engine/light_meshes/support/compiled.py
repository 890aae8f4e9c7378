"""How kernels are compiled: once, cached on disk, without the GIL, with IEEE arithmetic (no fast-math)."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

# numba obeys a .numba_config.yaml of the current folder, whoever put it there: now, and whenever it compiles.
with contextlib.chdir(Path(sys.executable).parent) if Path(".numba_config.yaml").exists() else contextlib.nullcontext():
    import numba
    from numba.core import config, event
    from numba.cpython.unsafe.numbers import trailing_zeros as trailing_zeros
config._config_fname = os.devnull

from . import kernel_files

KEPT = 4  # caches of other versions that stay, as an installed engine and a checkout may take turns
USUAL = 55  # kernels of a picture without glass


def _cache_folder() -> Path | None:
    """A private folder for this very source; None where none can be written, and kernels compile in each process.

    numba looks only at the file of a kernel itself: what it calls elsewhere may be older. So every version of the
    sources gets a folder of its own.
    """
    kept = KEPT
    if "LIGHT_MESHES_CACHE" in os.environ:  # of one installation, which an upgrade replaces
        root, kept = Path(os.environ["LIGHT_MESHES_CACHE"]), 0
    elif "NUMBA_CACHE_DIR" in os.environ:
        root = Path(os.environ["NUMBA_CACHE_DIR"])
    elif sys.platform == "win32":
        root = Path(os.environ.get("LOCALAPPDATA", Path.home()))
    elif sys.platform == "darwin":
        root = Path.home() / "Library" / "Caches"
    else:
        root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(source.read_bytes())
    folder = root / "light-meshes" / digest.hexdigest()[:16]
    try:
        if not folder.is_dir():
            kernel_files.new_folder(folder, kept)
        return folder if os.access(folder, os.W_OK | os.X_OK) and _private(folder) else None
    except OSError:
        return None


def _private(folder: Path) -> bool:
    """Whether nobody else may write there: what is loaded from there is run."""
    if not hasattr(os, "getuid"):  # Windows: the folder is in the user's own
        return True
    status = folder.stat()
    return status.st_uid == os.getuid() and not status.st_mode & 0o022


_folder = _cache_folder()
if _folder:
    numba.config.CACHE_DIR = str(_folder)  # type: ignore[attr-defined]

# error_model: a division by zero gives IEEE's infinity instead of a Python exception.
_njit: Any = numba.njit
_options = {"cache": _folder is not None, "nogil": True, "error_model": "numpy"}


def _kept(decorator: Any) -> Any:
    return (lambda function: kernel_files.keep(decorator(function))) if _folder else decorator


kernel = _kept(_njit(**_options))

# Called by kernels only. Without its two wrappers, which Python would call it by, it compiles faster.
part = _kept(_njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_options))

# Part of whatever calls it, so that loops around it become vectors.
inlined = _njit(inline="always", error_model="numpy")


class _Watch(event.Listener):
    """Counts the kernels that are compiled, and not loaded from the cache."""

    def __init__(self, tell: Callable[[float, str], None]) -> None:
        self._tell, self._count = tell, 0

    def on_start(self, event: Any) -> None:
        """A function begins to be compiled; most are numba's own."""
        if not event.data["dispatcher"].py_func.__module__.startswith("light_meshes."):
            return
        self._count += 1
        often = "once after an installation" if _folder else "each time, as there is no private folder to keep them in"
        of = f"of about {USUAL}" if self._count <= USUAL else "and more"
        self._tell(min(self._count / USUAL, 1.0), f"Compiling kernels ({often}): {self._count} {of}")

    def on_end(self, event: Any) -> None:
        """It is compiled."""


def watch(tell: Callable[[float, str], None]) -> None:
    """Have `tell(fraction, sentence)` called whenever a kernel is compiled, by the thread that needs it."""
    event.register("numba:compile", _Watch(tell))
