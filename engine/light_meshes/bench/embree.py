"""Compare the ray tracer's shadow stage with Embree alone on the same rays."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..film.images import crop_of
from ..picture.integrator import radiance
from ..picture.prepared import Prepared
from ..rays.embree import CHUNK, make_segments, room_for
from ..scene.description import Scene

Chunk = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]  # origins, directions, ends


class Recorder:
    """An accelerator that stores the shadow rays that it is called with."""

    def __init__(self, accelerator: Any) -> None:
        self.accelerator = accelerator
        self.made: list[Chunk] = []

    def occluded_of(self, *segments: Any) -> NDArray[np.bool_]:
        """Do the same as the accelerator's method, and store the rays."""
        self.made.append(room_for(len(segments[5])))
        make_segments(*segments, *self.made[-1])
        answer: NDArray[np.bool_] = self.accelerator.occluded_of(*segments)
        return answer


class ShadowRays:
    """The shadow rays of a picture with sharp shadows, in the order of its tiles and in the form that Embree needs."""

    def __init__(self, scene: Scene, tile: int) -> None:
        ready = Prepared(scene)
        self._embree, original = ready.tracer._embree["opaque", 0]
        recorder = Recorder(self._embree)
        ready.tracer._embree["opaque", 0] = recorder, original  # type: ignore[assignment]
        x0, y0, x1, y1 = crop_of(ready.scene)
        for y in reversed(range(y0, y1, tile)):
            for x in range(x0, x1, tile):
                radiance(ready, (x, y, min(x + tile, x1), min(y + tile, y1)), lambda: None)
        joined: list[NDArray[np.float32]] = [np.concatenate([c[k] for c in recorder.made]) for k in range(3)]
        self.count = len(joined[2])
        self._chunks = [(joined[0][i:i + CHUNK], joined[1][i:i + CHUNK], joined[2][i:i + CHUNK])
                        for i in range(0, self.count, CHUNK)]

    def trace(self, threads: int) -> float:
        """Return the thread seconds that Embree needs for all rays, in chunks on `threads` threads."""
        def run(chunk: Chunk) -> None:
            self._embree.occluded(*chunk)

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, self._chunks[:threads]))  # start the threads and warm the caches up
            started = time.perf_counter()
            list(pool.map(run, self._chunks))
            return (time.perf_counter() - started) * threads
