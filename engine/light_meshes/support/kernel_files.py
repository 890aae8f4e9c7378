"""Compiled kernels on disk: a file for each kernel and signature, loaded only if it is whole and the right one.

In place of numba's own files, whose index counts them: of two processes that compile at once one could store its code
under the other's number, and a damaged file ended all later renders.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import secrets
import shutil
from pathlib import Path
from typing import Any

from numba.core.serialize import dumps

_MARK = ".made-by-light-meshes"  # in folders that are ours to remove


class KernelFiles:
    """The files of one kernel."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name

    def load(self, key: Any) -> Any:
        """What was saved for `key`, or None, where it is compiled anew."""
        path = self._path(key)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        check, data = content[:32], content[32:]
        if hashlib.sha256(data).digest() != check:
            with contextlib.suppress(OSError):
                path.unlink()
            return None
        return pickle.loads(data)

    def save(self, key: Any, data: Any) -> None:
        """Keep `data` for `key`. Where that cannot be done, it is compiled again the next time."""
        path = self._path(key)
        content = dumps(data)
        new = path.with_suffix(f".{secrets.token_hex(4)}")
        try:
            new.write_bytes(hashlib.sha256(content).digest() + content)
            new.replace(path)
        except OSError:
            with contextlib.suppress(OSError):
                new.unlink()

    def flush(self) -> None:
        """Forget all."""
        for path in self._folder.glob(f"{self._name}.*.kernel"):
            path.unlink(missing_ok=True)

    def _path(self, key: Any) -> Path:
        """Named by the signature, the processor and the kernel's code, all of which are in `key`."""
        return self._folder / f"{self._name}.{hashlib.sha256(repr(key).encode()).hexdigest()[:32]}.kernel"


def keep(dispatcher: Any) -> Any:
    """Have numba use these files for a kernel."""
    cache = dispatcher._cache
    cache._cache_file = KernelFiles(Path(cache.cache_path), cache._impl.filename_base)
    return dispatcher


def new_folder(folder: Path, kept: int) -> None:
    """Make a folder for kernels; of older ones beside it that we made, only `kept` stay."""
    folder.mkdir(parents=True, mode=0o700)
    (folder / _MARK).touch()
    ours = [f for f in folder.parent.iterdir() if not f.is_symlink() and (f / _MARK).is_file()]
    for old in sorted(ours, key=lambda f: f.stat().st_mtime)[:-1 - kept]:
        if old != folder and os.access(old, os.W_OK):
            shutil.rmtree(old, ignore_errors=True)
