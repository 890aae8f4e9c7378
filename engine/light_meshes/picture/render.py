"""Render a picture, tile by tile, on all threads."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..film.images import Framebuffer, crop_of
from ..film.shared import Film, SharedFilm
from ..gathered.patches import SharedRecordsError
from ..scene.description import Camera, Scene
from ..shadows import blocks
from ..shadows.meshes.node_store import SharedNodesError
from ..support import processors
from ..support.rows import even
from ..support.statistics import peak_memory
from . import everywhere, reuse
from .integrator import Box, radiance
from .memory import BATCH, SPREAD, rays_of_tile
from .prepared import Before, Prepared

SHOWN = 8  # lamps of which the statistics tell one by one how their shadows were found


Progress = Callable[[float, str], None]  # is called with the share of the work that is done, and what is being done
# Stages of preparing, in their order, and the share of the progress that they are in all. How long they take is not
# known before.
STAGES = ("geometry", "textures", "sky", "accelerator", "emitters", "certificate", "gathered light: prepared")
PREPARING = 0.05
SAID_SECONDS = 0.5  # between two times when it is said what threads do


class Cancelled(Exception):  # noqa: N818  (it is no error)
    """The caller's `cancelled()` returned True."""


@dataclass(frozen=True)
class Result:
    """A finished picture."""

    frame: Framebuffer
    statistics: dict[str, Any]
    warnings: list[str]

    @property
    def passes(self) -> dict[str, NDArray[np.float32]]:
        """Return pass name → (height, width, channels), bottom row first."""
        return self.frame.passes


def _tiles(crop: Box, size: int, step: int = 1) -> list[Box]:
    """Return the fewest tiles of at most size × size pixels, almost equally large, top rows first, that begin at
    multiples of `step` inside the crop. size is a multiple of `step`.
    """
    x0, y0, x1, y1 = crop
    x, y = x0 - x0 % step, y0 - y0 % step
    width, height = (step * -(-even(n, size) // step) for n in (x1 - x, y1 - y))
    rows, columns = range(y, y1, height), range(x, x1, width)
    return [(max(x, x0), max(y, y0), min(x + width, x1), min(y + height, y1)) for y in reversed(rows) for x in columns]


def _tile_size(pixels: int, samples: int, threads: int, rays: int = BATCH) -> int:
    """Return a tile size, a multiple of 8, for about `rays` rays per tile; it is smaller in a small picture, so that
    every thread has work.
    """
    batch = min(rays / samples, pixels / (4 * threads))
    return int(np.clip(8 * np.round(np.sqrt(batch) / 8), 8, 256))


def film_of(ready: Prepared, crop: Box, tiles: Sequence[Box]) -> Film:
    """Return the film of a picture whose crop is drawn in tiles."""
    s, camera = ready.scene.settings, ready.scene.camera
    if not ready.plan.shares_samples:
        return Film(ready.passes, s.samples)
    return SharedFilm(ready.passes, ready.offsets, s.filter_size, (camera.width, camera.height), crop, tiles)


def prepare(scene: Scene, passes: Sequence[str], cancelled: Callable[[], bool] = lambda: False,
            previous: Before | None = None, camera: Camera | None = None, quick: bool = False,
            progress: Progress = lambda f, s: None) -> Prepared:
    """Return `Prepared`. Raises Cancelled when cancelled() returns True."""
    def check() -> None:
        if cancelled():
            raise Cancelled

    def told(stage: str) -> None:
        check()
        if stage in STAGES:
            progress(PREPARING * STAGES.index(stage) / len(STAGES), f"Preparing: {stage.partition(':')[0]}")

    progress(0.0, "Preparing")
    check()
    return Prepared(scene, passes, previous=previous, camera=camera, check=check, quick=quick, told=told)


def render(
    scene: Scene, frame: Framebuffer, *, threads: int | None = None, tile_size: int | None = None,
    cancelled: Callable[[], bool] = lambda: False, progress: Progress = lambda f, s: None,
    tile: Callable[[Box], None] = lambda box: None,
) -> Result:
    """Prepare and draw `scene`; see `draw`."""
    ready = prepare(scene, tuple(frame.passes), cancelled, progress=progress)
    return draw(ready, frame, threads=threads, tile_size=tile_size, cancelled=cancelled, progress=progress, tile=tile)


def draw(
    ready: Prepared, frame: Framebuffer, *, threads: int | None = None, tile_size: int | None = None,
    cancelled: Callable[[], bool] = lambda: False, progress: Progress = lambda f, s: None,
    tile: Callable[[Box], None] = lambda box: None,
) -> Result:
    """Draw a prepared scene into `frame`.

    `tile` is called with each finished box (x0, y0, x1, y1, relative to the crop). Raises Cancelled and SceneError. The
    picture does not depend on threads and tile_size.
    """
    started = time.perf_counter()

    def check() -> None:
        if cancelled() or stopped.is_set():
            raise Cancelled
        saying.now_and_then(done)

    stopped = threading.Event()
    if cancelled():
        raise Cancelled
    crop = crop_of(ready.scene)
    threads = threads or processors.count()
    if tile_size is None:
        batch = rays_of_tile(ready.scene) // (SPREAD if ready.plan.spreads else 1)
        tile_size = _tile_size(frame.width * frame.height, ready.scene.settings.samples, threads, batch)
    step = 2 * blocks.edge(ready.scene.settings.samples) if ready.plan.blocks else 1  # no block is drawn twice
    tiles = _tiles(crop, max(step, tile_size - tile_size % step), step)
    film = film_of(ready, crop, tiles)
    lock, done, left, saying = threading.Lock(), 0, iter(tiles), Saying(ready, len(tiles), progress)

    def work(box: Box) -> None:
        nonlocal done
        check()
        for part, passes in film.developed(*radiance(ready, film.needs(box), check), box):
            for name, pixels in passes.items():
                frame.passes[name][part[1] - crop[1]:part[3] - crop[1], part[0] - crop[0]:part[2] - crop[0]] = pixels
        with lock:
            done += 1
            tile((box[0] - crop[0], box[1] - crop[1], box[2] - crop[0], box[3] - crop[1]))
            saying(done)

    def work_on() -> None:
        for box in left:  # threads share it, and a list's iterator gives each box to one of them
            work(box)

    def ahead(part: int) -> None:
        if ready.everywhere is not None:
            everywhere.ahead(ready.world, ready.everywhere.records, ready.scene.camera, ready.offsets, part, threads,
                             check)

    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(ahead, part) for part in range(threads)] if ready.plan.gathers else []
        futures += [pool.submit(work_on) for _ in range(min(threads, len(tiles)))]
        _finish(pool, futures, stopped)
    return Result(frame, _report(ready, frame, tiles, threads, ready.seconds + time.perf_counter() - started),
                  [*ready.warnings, *ready.shadowing.path_warnings()])


def _finish(pool: ThreadPoolExecutor, futures: Sequence[Future[None]], stopped: threading.Event) -> None:
    """Wait until all is done, or end what is under way where a thread fails or is cancelled. `stopped` tells them."""
    try:
        for future in futures:
            future.result()
    except BaseException as failure:
        stopped.set()  # the other threads end at their next batch
        pool.shutdown(wait=True, cancel_futures=True)
        reasons = [f.exception() for f in futures if f.done() and not f.cancelled()]
        for e in reasons:  # report a thread that failed, not those that were stopped or waited for it
            if e is not None and not isinstance(e, Cancelled | SharedNodesError | SharedRecordsError):
                raise e from None
        # and it was no Ctrl-C
        if isinstance(failure, Exception) and any(isinstance(e, Cancelled) for e in reasons):
            raise Cancelled from None
        raise


class Saying:
    """Reports how much of a picture is done, and whether threads mostly gather light or do the rest."""

    def __init__(self, ready: Prepared, tiles: int, progress: Progress) -> None:
        self._seconds, self._tiles, self._progress = ready.stats.seconds, tiles, progress
        self._gathers, self._said, self._stage = ready.plan.gathers, time.monotonic(), "Rendering"
        self._spent = 0.0, 0.0

    def __call__(self, done: int) -> None:
        """Report that so many tiles are done."""
        share = 1 - (1 - PREPARING) * (1 - done / self._tiles)  # which is 1 in the end
        self._progress(share, f"{self._stage}, {done} of {self._tiles} tiles done")

    def now_and_then(self, done: int) -> None:
        """Report the progress, if it was not reported for a while. Threads may call this often."""
        now = time.monotonic()
        if now - self._said < SAID_SECONDS:
            return
        self._said = now
        if self._gathers:
            spent = list(self._seconds.items())
            gathered, before = sum(s for name, s in spent if name.startswith("gathered light")), self._spent
            self._spent = gathered, sum(s for _, s in spent)
            most = self._spent[0] - before[0] > (self._spent[1] - before[1]) / 2
            self._stage = "Gathering light" if most else "Rendering"
        self(done)


def render_image(scene: Scene, passes: Sequence[str] = ("Combined",), threads: int | None = None,
                 tile_size: int | None = None) -> Result:
    """Render into memory and return the result."""
    return render(scene, Framebuffer.create(scene, passes), threads=threads, tile_size=tile_size)


def measure(scene: Scene) -> dict[str, Any]:
    """Return the h that `auto_h` takes from the camera, and r of the lights whose softness is LIGHT_SIZE; None for a
    light with the scene's r.
    """
    # No more pixels are rendered, so data that speeds up large pictures is not needed.
    ready = Prepared(replace(scene, camera=replace(scene.camera, width=64, height=64, crop=None)))
    radii = [ready.measured.own_radii.get(i) if light.softness == "LIGHT_SIZE" else None
             for i, light in enumerate(scene.lights)]
    return {"h": ready.measured.h, "radii": radii}


def _lamps(ready: Prepared) -> dict[str, str]:
    """Return the plan's decisions for lamps with a size, as further reasons: a row for each of the first SHOWN lamps.
    """
    pairs, rays = (ready.stats.of_lights.get(name) for name in ("lamp_pairs", "ray_pairs"))
    if pairs is None or rays is None:
        return {}
    how = ready.plan.reasons.get("lamps with a size", "").split(":")[0]
    found = [i for i, n in enumerate(pairs) if n]
    rows = {f"lamp '{ready.scene.lights[i].name}'": f"{how}: {rays[i] / pairs[i]:.1%} of its receivers took rays"
            for i in found[:SHOWN]}
    rest = found[SHOWN:]
    if rest:
        share = rays[rest].sum() / pairs[rest].sum()
        rows["other lamps with a size"] = f"{how}: {share:.1%} of the receivers of these {len(rest)} took rays"
    return rows


def _report(ready: Prepared, frame: Framebuffer, tiles: list, threads: int, seconds: float) -> dict[str, Any]:
    """Return the statistics of a finished render."""
    s, counts = ready.scene.settings, ready.stats.counts
    report: dict[str, Any] = {
        "plan": ready.plan.reasons | _lamps(ready),
        "width": frame.width, "height": frame.height, "samples": s.samples,
        "triangles": len(ready.surfaces.triangles), "instances": len(ready.scene.geometry.instance_mesh),
        "lights": len(ready.scene.lights), "materials": len(ready.scene.materials),
        "threads": threads, "tiles": len(tiles),
        "seconds": round(seconds, 3),
        "stages": {k: round(v, 3) for k, v in ready.stats.seconds.items()},  # in thread seconds
        "peak_memory": peak_memory(), "memory_expected": round(ready.memory),
    }
    for name in ("camera_rays", "secondary_rays", "shadow_rays"):
        report[name] = counts[name]
    if counts["lamp_pairs"]:  # of a receiver and a lamp with a size
        report |= {name: counts[name] for name in ("lamp_pairs", "mixed_pairs", "ray_pairs")}
    if counts["grouped_receivers"]:
        report["light_bound"] = counts["grouped_light"] / counts["grouped_receivers"]
    if ready.plan.gathers:
        for name in ("records", "gathered_rays", "gathered_short_rays"):
            report[name] = counts[name]
    nodes = ready.shadowing.method.nodes
    if nodes:
        vertices = ready.surfaces.vertices
        finite = np.isfinite(vertices).all(1)[:, None]
        low, high = vertices.min(0, where=finite, initial=1), vertices.max(0, where=finite, initial=-1)
        box = np.maximum(high.astype(np.float64) - low, 0) * ready.surfaces.scale
        radii = (s.h * ready.soft.lattice.reach).tolist() if ready.soft else [s.h * s.kI]
        found = reuse.count(nodes)
        lattice_nodes = float(np.prod((box + 2 * radii[-1]) / s.h))  # all nodes that any receiver can reach
        report |= {
            "h": s.h, "kI": s.kI, "r": s.h * s.kI, "measured_h": ready.measured_h, "radii": radii,
            "receivers": counts["receivers"], "candidates": counts["candidates"],
            "nodes": found, "node_share": found / lattice_nodes,
            "nodes_kept": ready.nodes_kept, "node_bytes": sum(one.store.bytes for one in nodes),
            "short_rays": counts["short_rays"], "long_rays": counts["long_rays"],
            "empty_sets": counts["empty_sets"], "uniform_skips": counts["uniform_skips"],
            "certified": counts["certified"], "spared_rays": counts["spared_rays"],
        }
        if ready.sparse:
            report |= {"shadow_rate": ready.plan.shadow_rate} | {name: counts[name] for name in (
                "points", "interpolated", "refined", "computed")}
        own = ready.shadowing.radii.items()
        report["sized_lamps"] = sum(light.softness == "SIZE" for light in ready.scene.lights)
        report["light_radii"] = {ready.scene.lights[i].name: r for i, r in own}  # of those that have one of their own
    if ready.plan.paths:
        for name in ("refracted_paths", "path_seeds", "path_seeds_not_converged", "paths_rejected", "path_rays"):
            report[name] = counts[name]
    return report
