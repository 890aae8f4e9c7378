"""How many threads this process uses: the number that it was told, or otherwise the number of its processors."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

MOST = 1024  # Blender's maximum
_told: int | None = None


def tell(threads: int | None) -> None:
    """Use this many threads from now on; None means as many as there are processors."""
    global _told
    _told = threads


def count() -> int:
    """Return how many threads to use. On a farm, a task may be given only a part of the machine: some processors, or a
    share of their time.
    """
    if _told is not None:
        return _told
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        groups = Path("/proc/self/cgroup").read_text()
    except OSError:
        return there
    return max(1, min([there, *map(math.ceil, allowed(groups))]))


def each(work: Callable[[int], object], parts: int) -> None:
    """Do work(0) … work(parts − 1) on all threads, and raise what one of them raises."""
    if parts == 1:
        work(0)
        return
    with ThreadPoolExecutor(min(parts, count())) as pool:
        for _ in pool.map(work, range(parts)):
            pass


def allowed(groups: str, root: Path = Path("/sys/fs/cgroup")) -> Iterator[float]:
    """Return how many processors' time the control groups of a process allow, or None if there is no limit.

    `groups` is the content of /proc/PID/cgroup.
    """
    for line in groups.splitlines():
        _, kinds, path = line.split(":", 2)
        if not kinds:  # version 2
            top, files = root, ["cpu.max"]
        elif "cpu" in kinds.split(","):
            top = root / kinds if (root / kinds).is_dir() else root / "cpu"
            files = ["cpu.cfs_quota_us", "cpu.cfs_period_us"]
        else:
            continue
        group = top / path.lstrip("/")
        for folder in (group, *group.parents):
            with contextlib.suppress(OSError, ValueError):  # there is none, or a container hides it
                quota, period = map(int, " ".join((folder / name).read_text() for name in files).split())
                if quota > 0 and period > 0:
                    yield quota / period
            if folder == top:
                break
