"""Counts and stage times of a render, summed over threads."""

from __future__ import annotations

import sys
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


class Statistics:
    """Thread-safe sums. Stage times are thread seconds: two busy threads count double."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.counts: Counter[str] = Counter()
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.of_lights: dict[str, NDArray[np.int64]] = {}  # counts (L,) of each light
        self.told: Callable[[str], None] | None = None  # is called with the name of each stage that begins

    def add(self, **counts: int) -> None:
        """Add to the named counts."""
        with self._lock:
            for name, n in counts.items():
                self.counts[name] += int(n)

    def add_each(self, name: str, count: NDArray[np.int64]) -> None:
        """Add to a count (L,) of each light, and to their sum, which has the same name."""
        with self._lock:
            self.of_lights[name] = self.of_lights.get(name, 0) + count
            self.counts[name] += int(count.sum())

    def stage(self, name: str) -> Stage:
        """Measure the time of the enclosed work as part of stage `name`."""
        return Stage(self, name)


class Stage:
    """A stage that is being measured. It is a class and no generator, because there are dozens of stages for each tile.
    """

    __slots__ = ("_began", "_name", "_of")

    def __init__(self, of: Statistics, name: str) -> None:
        self._of, self._name = of, name

    def __enter__(self) -> None:
        if self._of.told:
            self._of.told(self._name)
        self._began = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        spent = time.perf_counter() - self._began
        with self._of._lock:
            self._of.seconds[self._name] += spent


def peak_memory() -> int | None:
    """Return the largest memory in bytes that this process has used; None if the system does not report it."""
    with suppress(OSError, StopIteration):  # on Linux, getrusage also counts the program that started this process
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) * 1024
    try:
        import resource
    except ImportError:  # on Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
