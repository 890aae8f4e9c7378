"""Let the next tile use the memory that a tile of any thread has freed.

By default the C library on Linux keeps apart what each thread frees, and gives large arrays back to the system. With
these settings the engine's own programs need about a fifth less memory. They are settings of the whole process, so
other programs that import the engine are left as they are.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8  # malloc.h
KEPT = 128 << 20  # bytes that are kept at most, at the end of the heap
LARGE = 32 << 20  # bytes from which on an array has pages of its own


def keep() -> None:
    """Change the settings. Call this before there are threads. Without the GNU C library nothing happens."""
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError, AttributeError):
        ask = ctypes.CDLL(None).mallopt
        ask(_ARENA_MAX, 1)
        ask(_MMAP_THRESHOLD, LARGE)
        ask(_TRIM_THRESHOLD, KEPT)
