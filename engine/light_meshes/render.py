"""The wave of rays: hit, see, shade, reflect; tile by tile on all threads."""

from __future__ import annotations

import dataclasses
import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import shading, textures
from .camera import camera_rays, depth, filter_offsets
from .film import NO_DEPTH, Framebuffer, crop_of
from .geometry import Hits, flatten, surface
from .lattice import lattice
from .plan import plan
from .scene import Scene
from .statistics import Statistics, peak_memory
from .tracing import Tracer
from .visibility import AreaSampling, LightMeshes, Sharp, Unshadowed

BATCH = 32768  # camera rays a tile, about
SHADED = 1 << 22  # receivers × lights held at once, at most


class Cancelled(Exception):  # noqa: N818  (it is no error)
    """The caller's `cancelled()` said so."""


@dataclass(frozen=True)
class Result:
    """A finished picture."""

    frame: Framebuffer
    statistics: dict[str, Any]
    warnings: list[str]

    @property
    def passes(self) -> dict[str, NDArray[np.float32]]:
        """Pass name → (height, width, channels), rows bottom-up."""
        return self.frame.passes


class Prepared:
    """A scene made ready: triangles, accelerator, lights and the shadow method that its plan asks for."""

    def __init__(self, scene: Scene, passes: Sequence[str] = ("Combined",)) -> None:
        self.stats = Statistics()
        self.passes = tuple(passes)
        with self.stats.stage("geometry"):
            self.surfaces, self.warnings = flatten(scene)
        with self.stats.stage("accelerator"):
            self.tracer = Tracer(scene, self.surfaces)
        self.scene = scene
        if scene.settings.auto_h:
            settings = dataclasses.replace(scene.settings, h=measured_h(self))
            self.scene = dataclasses.replace(scene, settings=settings)
        self.plan = plan(scene, self.passes)
        self.lights = shading.light_arrays(scene.lights)
        self.materials = shading.material_arrays(scene.materials)
        self.textures: list[textures.Texture | None] = []
        if self.plan.textures:
            with self.stats.stage("textures"):
                self.textures, sentences = textures.load(scene.images)
                self.warnings += sentences
        self.visibility = self._visibility()
        self.offsets = filter_offsets(scene.settings.samples, scene.settings.filter_size)

    def _visibility(self) -> Unshadowed | Sharp | LightMeshes | AreaSampling:
        scene, s = self.scene, self.scene.settings
        if self.plan.shadows == "NONE":
            return Unshadowed(scene.lights)
        needed = scene.lights, self.lights.targets(), self.tracer, self.stats
        if self.plan.shadows == "SHARP":
            return Sharp(*needed)
        if self.plan.shadows == "AREA_SAMPLING":
            return AreaSampling(*needed, s.light_samples, s.seed)
        nodes = lattice(s.h, s.kI, s.lattice_rotation, s.lattice_origin)
        return LightMeshes(*needed, nodes, s.uniform_skip)

    @property
    def soft(self) -> LightMeshes:
        """The light meshes, where the plan has them."""
        assert isinstance(self.visibility, LightMeshes)
        return self.visibility

    def light_visibility(self, P: NDArray[np.float64], N: NDArray[np.float64]) -> NDArray[np.float32]:
        """S_i (n,L) of all lights in front of receivers P with unit geometric normals N, both (n,3)."""
        toward = self.lights.targets()
        away = np.where(toward.directional[None, :, None], toward.position[None], toward.position[None] - P[:, None])
        facing = (away * N[:, None]).sum(2) > 0
        active = np.zeros((len(P), max(1, (len(self.scene.lights) + 63) // 64)), np.uint64)
        for i in range(facing.shape[1]):
            active[:, i >> 6] |= facing[:, i].astype(np.uint64) << np.uint64(i & 63)
        return self.visibility(np.ascontiguousarray(P), np.ascontiguousarray(N), active, lambda: None)

    def closest(self, kind: str, origin: NDArray, direction: NDArray, normal: NDArray | None = None,
                reach: NDArray | None = None) -> tuple[NDArray[np.bool_], Hits]:
        """Which rays hit (n,), and the surface at those that do."""
        triangle, u, v = self.tracer.closest(kind, origin, direction, normal, reach)
        hit = triangle >= 0
        n = int(hit.sum())
        hits = Hits(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.zeros((n, 2), np.float32),
                    np.empty(n, np.int32))
        surface(self.surfaces, triangle[hit], u[hit], v[hit], origin[hit], direction[hit], *hits)
        return hit, hits

    def direct(self, hits: Hits, direction: NDArray, check: Callable[[], None]) -> tuple[NDArray, NDArray]:
        """Ia·ka·Od + Σ S·Ω + emission (n,3), and the mean S (n,), of hits of rays with `direction`."""
        m, settings, lights = self.materials, self.scene.settings, len(self.scene.lights)
        Od = m.Od[hits.material]
        if self.textures:
            image = m.image[hits.material]
            for i, texture in enumerate(self.textures):
                if texture is not None:
                    texture.lookup(hits.uv, np.flatnonzero(image == i), Od)
        ambient = settings.ambient * np.array(self.scene.world_color)
        colour = m.emission[hits.material] + m.ka[hits.material][:, None] * Od * ambient
        shadow = np.zeros(len(hits.P))
        step = max(64, SHADED // max(1, lights))
        for i in range(0, len(hits.P) if lights else 0, step):
            check()
            part = slice(i, min(i + step, len(hits.P)))
            n = part.stop - part.start
            out = np.empty((n, lights, 3), np.float32)
            active = np.zeros((n, (lights + 63) // 64), np.uint64)
            with self.stats.stage("shading"):
                shading.omega(self.lights, m, hits.P[part], hits.Ng[part], hits.Ns[part], direction[part], Od[part],
                              hits.material[part], "Shadow" in self.passes, out, active)
            S = self.visibility(hits.P[part], hits.Ng[part], active, check)
            with self.stats.stage("shading"):
                shading.gather(S, out, colour[part], shadow[part])
        return colour, shadow


def _radiance(ready: Prepared, box: tuple[int, int, int, int], check: Callable[[], None]) -> dict[str, NDArray]:
    """All passes of one tile: (height, width, channels)."""
    scene, m = ready.scene, ready.materials
    with ready.stats.stage("camera rays"):
        origin, direction, reach = camera_rays(scene.camera, box, ready.offsets)
        ready.stats.add(camera_rays=len(origin))
    n = len(origin)
    radiance = np.zeros((n, 4))
    first: dict[str, NDArray] = {"Depth": np.full((n, 1), NO_DEPTH), "Normal": np.zeros((n, 3)),
                                 "Shadow": np.zeros((n, 3))}
    pixel = np.arange(n)  # the sample that a ray belongs to
    weight = np.ones((n, 3))
    normal: NDArray | None = None
    bounds: NDArray | None = reach
    kind = "camera"
    for bounce in range(scene.settings.max_depth + 1 if ready.plan.reflections else 1):
        check()
        with ready.stats.stage("reflected rays" if bounce else "camera rays"):
            hit, hits = ready.closest(kind, origin, direction, normal, bounds)
        if bounce == 0:
            radiance[hit, 3] = 1
        if bounce or not scene.settings.film_transparent:
            miss = ~hit
            radiance[pixel[miss], :3] += weight[miss] * scene.world_color
            radiance[pixel[miss], 3] = 1
        pixel, weight, direction = pixel[hit], weight[hit], direction[hit]
        colour, shadow = ready.direct(hits, direction, check)
        radiance[pixel, :3] += weight * colour
        if bounce == 0:
            first["Depth"][pixel, 0] = depth(scene.camera, hits.P)
            first["Normal"][pixel] = hits.Ns
            first["Shadow"][pixel] = shadow[:, None]
        if not ready.plan.reflections:
            break
        weight = weight * m.mirror[hits.material]
        going = weight.max(axis=1, initial=0) > scene.settings.cutoff
        if not going.any():
            break
        pixel, weight, origin, normal = pixel[going], weight[going], hits.P[going], hits.Ng[going]
        reflected = np.empty((len(pixel), 3))
        shading.mirrored(direction[going], normal, hits.Ns[going], reflected)
        direction, kind, bounds = reflected, "reflection", None
        ready.stats.add(reflected_rays=len(pixel))
    first["Combined"] = radiance
    return {name: _developed(name, first[name], box, len(ready.offsets)) for name in ready.passes}


def _developed(name: str, samples: NDArray, box: tuple[int, int, int, int], per_pixel: int) -> NDArray:
    """The mean of a pixel's samples, added in order; Depth is that of the sample nearest to the centre."""
    pixels = samples.reshape(-1, per_pixel, samples.shape[1])
    if name == "Depth":
        total = pixels[:, 0]
    else:
        total = pixels[:, 0].copy()
        for s in range(1, per_pixel):
            total += pixels[:, s]
        total /= per_pixel
    return total.reshape(box[3] - box[1], box[2] - box[0], -1)


def _tiles(crop: tuple[int, int, int, int], size: int) -> list[tuple[int, int, int, int]]:
    """Tiles of at most size × size pixels, top rows first."""
    x0, y0, x1, y1 = crop
    rows = range(y0, y1, size)
    return [(x, y, min(x + size, x1), min(y + size, y1)) for y in reversed(rows) for x in range(x0, x1, size)]


def render(
    scene: Scene, frame: Framebuffer, *, threads: int | None = None, tile_size: int | None = None,
    cancelled: Callable[[], bool] = lambda: False, progress: Callable[[float, str], None] = lambda f, s: None,
    tile: Callable[[tuple[int, int, int, int]], None] = lambda box: None,
) -> Result:
    """Render `scene` into `frame`.

    `tile` hears of each finished box (x0, y0, x1, y1, relative to the crop). Raises Cancelled and SceneError. The
    picture does not depend on threads and tile_size.
    """
    started = time.perf_counter()

    def check() -> None:
        if cancelled() or stopped.is_set():
            raise Cancelled

    stopped = threading.Event()
    check()
    progress(0.0, "Preparing")
    ready = Prepared(scene, tuple(frame.passes))
    check()
    crop = crop_of(scene)
    if tile_size is None:
        tile_size = int(np.clip(2 ** np.round(np.log2(np.sqrt(BATCH / scene.settings.samples))), 8, 256))
    tiles = _tiles(crop, tile_size)
    threads = threads or os.cpu_count() or 1
    lock, done = threading.Lock(), 0

    def work(box: tuple[int, int, int, int]) -> None:
        nonlocal done
        check()
        passes = _radiance(ready, box, check)
        x0, y0, x1, y1 = box[0] - crop[0], box[1] - crop[1], box[2] - crop[0], box[3] - crop[1]
        for name, pixels in passes.items():
            frame.passes[name][y0:y1, x0:x1] = pixels
        with lock:
            done += 1
            tile((x0, y0, x1, y1))
            progress(done / len(tiles), "Rendering")

    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(work, box) for box in tiles]
        try:
            for future in futures:
                future.result()
        except BaseException:
            stopped.set()  # the other threads end at their next batch
            pool.shutdown(wait=True, cancel_futures=True)
            for f in futures:  # a thread that failed is the reason; those that were stopped are not
                e = None if f.cancelled() or not f.done() else f.exception()
                if e is not None and not isinstance(e, Cancelled):
                    raise e from None
            raise
    return Result(frame, _report(ready, frame, tiles, threads, time.perf_counter() - started), list(ready.warnings))


def render_image(scene: Scene, passes: Sequence[str] = ("Combined",), threads: int | None = None,
                 tile_size: int | None = None) -> Result:
    """Render into memory."""
    return render(scene, Framebuffer.create(scene, passes), threads=threads, tile_size=tile_size)


def measured_h(ready: Prepared) -> float:
    """A step h that suits what the camera sees: 1/200 of the picture's width at the median visible depth.

    The median over the picture is not moved by a far horizon or a large ground. Two digits, so that it reads well.
    """
    camera = dataclasses.replace(ready.scene.camera, width=64, height=64, crop=None)
    origin, direction, reach = camera_rays(camera, (0, 0, 64, 64), np.zeros((1, 2)))
    _, hits = ready.closest("camera", origin, direction, None, reach)
    left, right, bottom, top = camera.window
    width = max(abs(right - left), abs(top - bottom))
    if len(hits.P) == 0:  # nothing in view
        width = ready.surfaces.scale
    elif camera.perspective:
        width *= float(np.median(depth(camera, hits.P)))
    return float(f"{max(width / 200, 1e-30):.1e}")


def measure_h(scene: Scene) -> float:
    """`measured_h` of a scene that is not prepared yet."""
    return measured_h(Prepared(dataclasses.replace(scene, settings=dataclasses.replace(
        scene.settings, auto_h=False, shadows="SHARP"))))


def _report(ready: Prepared, frame: Framebuffer, tiles: list, threads: int, seconds: float) -> dict[str, Any]:
    """The statistics of a finished render."""
    s, counts = ready.scene.settings, ready.stats.counts
    report: dict[str, Any] = {
        "plan": ready.plan.reasons,
        "width": frame.width, "height": frame.height, "samples": s.samples,
        "triangles": len(ready.surfaces.triangles), "instances": len(ready.scene.geometry.instance_mesh),
        "lights": len(ready.scene.lights), "materials": len(ready.scene.materials),
        "threads": threads, "tiles": len(tiles),
        "seconds": round(seconds, 3),
        "stages": {k: round(v, 3) for k, v in ready.stats.seconds.items()},  # thread seconds
        "peak_memory": peak_memory(),
    }
    for name in ("camera_rays", "reflected_rays", "shadow_rays"):
        report[name] = counts[name]
    if ready.plan.shadows == "LIGHT_MESHES":
        lit = ready.soft
        vertices = ready.surfaces.vertices[np.isfinite(ready.surfaces.vertices).all(1)]
        box = np.ptp(vertices.astype(np.float64), axis=0) * ready.surfaces.scale if len(vertices) else np.zeros(3)
        lattice_nodes = float(np.prod((box + 2 * s.h * s.kI) / s.h))  # all that any receiver can reach
        report |= {
            "h": s.h, "kI": s.kI, "r": s.h * s.kI, "receivers": counts["receivers"],
            "candidates": counts["candidates"], "nodes": lit.store.count, "node_share": lit.store.count / lattice_nodes,
            "node_bytes": lit.store.bytes, "short_rays": counts["short_rays"], "long_rays": counts["long_rays"],
            "empty_sets": counts["empty_sets"], "uniform_skips": counts["uniform_skips"],
        }
    return report
