"""How kernels are compiled: once, cached on disk, without the GIL, with IEEE arithmetic (no fast-math)."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from pathlib import Path
from typing import Any

import numba

KEPT = 4  # caches of other versions that stay, as an installed engine and a checkout may take turns


def _cache_folder() -> Path | None:
    """A private folder for this very source; None where none can be written, and kernels compile in each process.

    numba looks only at the file of a kernel itself: what it calls elsewhere may be older. So every version of the
    sources gets a folder of its own.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        root = Path(os.environ["NUMBA_CACHE_DIR"])
    elif sys.platform == "win32":
        root = Path(os.environ.get("LOCALAPPDATA", Path.home()))
    elif sys.platform == "darwin":
        root = Path.home() / "Library" / "Caches"
    else:
        root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    folder = root / "light-meshes" / digest.hexdigest()[:16]
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, mode=0o700)
            older = sorted(folder.parent.iterdir(), key=lambda f: f.stat().st_mtime)
            for old in older[:-1 - KEPT]:
                shutil.rmtree(old, ignore_errors=True)
        return folder if os.access(folder, os.W_OK | os.X_OK) else None
    except OSError:
        return None


_folder = _cache_folder()
if _folder:
    numba.config.CACHE_DIR = str(_folder)  # type: ignore[attr-defined]

# error_model: a division by zero gives IEEE's infinity instead of a Python exception.
_njit: Any = numba.njit
_options = {"cache": _folder is not None, "nogil": True, "error_model": "numpy"}
kernel = _njit(**_options)

# Called by kernels only. Without its two wrappers, which Python would call it by, it compiles faster.
part = _njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_options)

# Part of whatever calls it, so that loops around it become vectors.
inlined = _njit(inline="always", error_model="numpy")
