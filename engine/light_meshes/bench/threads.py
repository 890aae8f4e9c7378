"""Measure what keeps threads from running side by side: the part of the tile loop that holds Python's lock, and the
parts of preparing that use one thread only.
"""

from __future__ import annotations

import ctypes
import dataclasses
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ..film.images import Framebuffer
from ..picture.render import draw, prepare
from ..rays.embree import accelerator
from ..rays.geometry import flatten
from ..scene.description import Scene
from ..shadows.meshes.certificate import certificate
from ..support.native import kernel

_watched = kernel("lock_watched")


def lock_share(scene: Scene) -> float | None:
    """Return `lock_held` of one thread that draws what is prepared. As it is alone, it never waits for the lock."""
    ready = prepare(scene, ("Combined",))
    frame = Framebuffer.create(scene, ("Combined",))
    return lock_held(lambda: draw(ready, frame, threads=1))


def lock_held(work: Callable[[], object]) -> float | None:
    """Return the share of the time of work() in which some thread holds Python's lock; None if Python does not tell.

    A thread that never needs the lock asks Python about every microsecond which thread has it. While a kernel or a loop
    of numpy runs, no thread has it. No more than 1/share threads can be of use. Python 3.11 and 3.12 tell.
    """
    holder = getattr(ctypes.pythonapi, "_PyThreadState_UncheckedGet", None)
    if holder is None or sys.version_info >= (3, 13):  # where it answers for the thread that asks
        return None
    over, polls = np.zeros(1, np.uint8), np.zeros(2, np.int64)
    watcher = threading.Thread(target=_watched, args=(ctypes.cast(holder, ctypes.c_void_p).value, over, polls))
    watcher.start()
    try:
        work()
    finally:
        over[0] = 1
        watcher.join()
    return float(polls[1] / polls[0])


def preparing(scene: Scene) -> dict[str, Any]:
    """Return the seconds and the mean number of busy threads of two steps of preparing a scene, the accelerator and the
    certificate; and the seconds that preparing the same scene without lamps takes.
    """
    surfaces, _ = flatten(scene, scene.camera)
    everything = np.ones(len(surfaces.triangles), np.bool_)
    radius = scene.settings.h * scene.settings.kI
    dark = prepare(dataclasses.replace(scene, lights=()), ("Combined",))
    return {"triangles": len(surfaces.triangles),
            "accelerator": _busy(lambda: accelerator(surfaces.vertices, surfaces.triangles)),
            "certificate": _busy(lambda: certificate(surfaces, everything, radius)),
            "without_lamps": dark.stats.seconds.get("certificate", 0.0)}


def _busy(work: Callable[[], object]) -> dict[str, float]:
    """Return how many seconds the work takes, and how many threads are busy in this time, as a mean."""
    began, spent = time.perf_counter(), time.process_time()
    work()
    seconds = time.perf_counter() - began
    return {"seconds": seconds, "threads": (time.process_time() - spent) / seconds}
