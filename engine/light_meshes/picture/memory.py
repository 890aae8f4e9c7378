"""What a picture needs of memory, and what there is: a scene too large says so before it starts.

The bytes are measured (tests/support/load.py prints what was expected beside what it came to). An expectation may be
wrong by a quarter; what is refused needs more than that.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..film.images import crop_of
from ..film.passes import letters
from ..rays.camera import depth
from ..scene.description import Scene
from ..scene.errors import SceneError
from ..support import processors
from ..surface import textures

if TYPE_CHECKING:
    from .prepared import Prepared

BASE = 80 << 20  # Python and its libraries
MESH = 60  # a triangle as the snapshot has it, once for all its instances; what nobody looks at stays in the file
TRIANGLE, VERTEX = 60, 12  # of an instance
ACCELERATED, ACCELERATED_VERTEX = 84, 16  # the same again in each accelerator
RAYS = 1 << 16  # camera rays that a thread has under way
LARGER = 4  # times as many where tiles compute the points at their edges twice (`sparse`)
RAY, LIT, CANDIDATE = 700, 8, 24  # one of them; a receiver and a light; a receiver and a node
NODE = 16  # beside its values
DOUBT, CLOSE = 1.25, 0.8  # of what there is: from here on refused, or warned of


class Part(NamedTuple):
    """Something that takes memory."""

    size: float  # bytes
    what: str
    remedy: str


def before(scene: Scene, passes: Sequence[str]) -> list[Part]:
    """What is known before anything is made: all but the nodes."""
    x0, y0, x1, y1 = crop_of(scene)
    pixels, threads, lights = (x1 - x0) * (y1 - y0), processors.count(), len(scene.lights)
    glass = any(m.alpha < 1 or m.alpha_image >= 0 or any(m.kt) for m in scene.materials)
    most = RAYS * LARGER if scene.settings.shadow_rate > 1 else RAYS
    rays = min(most, pixels * scene.settings.samples / (4 * threads))
    shaded = min(rays * lights, 1 << 22)  # receivers × lights at once
    work = rays * RAY + shaded * (LIT + 8 * glass)
    if scene.settings.shadows == "LIGHT_MESHES":
        near = 2 * np.pi / 3 * scene.settings.kI**3  # nodes of a receiver; a batch shares most of them
        work += min(rays * near, 1 << 20) * CANDIDATE + 3 * shaded * (24 if glass else 0.5)
    return [
        Part(BASE, "the engine itself", "close other programs"),
        _triangles(scene, glass),
        *_textures(scene),
        Part(4.0 * pixels * sum(len(letters(name)) for name in passes),
             f"{x1 - x0:,} × {y1 - y0:,} pixels of {len(passes)} passes", "render a smaller picture, or fewer passes"),
        Part(threads * work,
             f"{threads} threads with {lights:,} lights", "use fewer threads: --threads, or Threads under Performance"),
    ]


def _textures(scene: Scene) -> list[Part]:
    """The images, as they are kept."""
    found = textures.layouts(scene.images, textures.alphas(scene))
    if not found:
        return []
    image, largest = max(found, key=lambda one: one[1].bytes)
    what = f"{len(found)} image {'textures' if len(found) > 1 else 'texture'}"
    return [Part(float(sum(layout.bytes for _, layout in found)),
                 f"{what}, the largest '{image.name}' of {largest.width:,} × {largest.height:,}", "scale images down")]


def _triangles(scene: Scene, glass: bool) -> Part:
    """The geometry, and an accelerator for each set of objects that a kind of ray meets."""
    g = scene.geometry
    _, vertices, _, triangles = g.meshes[g.instance_mesh].T if len(g.instance_mesh) else np.zeros((4, 1), np.int64)
    of_object = np.zeros(len(scene.objects))
    if len(g.instance_mesh):
        np.add.at(of_object, g.instance_object, triangles)
    seen = [tuple(getattr(o, f"visible_{kind}") for o in scene.objects) for kind in ("camera", "reflection", "shadow")]
    sets = [np.array(s, np.bool_) for s in set(seen)]
    sets += [np.array(seen[2], np.bool_)] * glass  # what lets light through, and what stops it
    sets += [np.isin(np.arange(len(of_object)), b) for b in {light.blockers for light in scene.lights} if b]
    count, vertex = float(triangles.sum()), float(vertices.sum())
    shape = ACCELERATED + ACCELERATED_VERTEX * vertex / max(1.0, count)
    accelerators = shape * sum(of_object[s].sum() for s in sets)
    return Part(MESH * len(g.triangles) + TRIANGLE * count + VERTEX * vertex + accelerators,
                f"{count:,.0f} triangles in {len(g.instance_mesh):,} instances",
                "hide objects, reduce subdivision, or scatter fewer instances, each of which counts")


def nodes(ready: Prepared) -> Part:
    """The nodes of light meshes around what the camera sees: by a coarse view, area·r/h³, or all that receivers reach.

    Those around what is seen in mirrors are left out.
    """
    scene, s, reach = ready.scene, ready.scene.settings, float(ready.soft.lattice.reach[-1])
    x0, y0, x1, y1 = crop_of(scene)
    lights = len(scene.lights)
    each = NODE + (4 * lights * ready.plan.channels if ready.plan.channels else lights / 8)
    reached = (x1 - x0) * (y1 - y0) * s.samples * 2 * np.pi / 3 * reach**3
    if reached * each > 16 << 20:
        direction, hits = ready.coarse_view()
        camera = ready.described.camera
        left, right, bottom, top = camera.window
        across = abs((right - left) * (top - bottom)) * (depth(camera, hits.P) ** 2 if camera.perspective else 1.0)
        slant = (direction @ -camera.matrix[:3, 2]) / np.maximum(np.abs((direction * hits.Ng).sum(1)), 1e-9)
        reached = np.minimum(across * slant * reach / s.h**2, reached).sum() / 64**2
    return Part(reached * each, f"about {reached:,.0f} nodes of light meshes with {lights:,} lights",
                f"take a larger step than h = {s.h:g}, or fewer lights with soft shadows")


def check(parts: Sequence[Part]) -> list[str]:
    """A warning where it will be close; raises SceneError where there is too little memory for all parts together."""
    need, there = expected(parts), available()
    if there is None or need < CLOSE * there:
        return []
    largest = max(parts, key=lambda part: part.size)
    said = (f"the picture needs about {need / 2**30:,.1f} GiB of memory, and there are {there / 2**30:,.1f}: "
            f"{largest.what} take {largest.size / 2**30:,.1f}; {largest.remedy}")
    if need > DOUBT * there:
        raise SceneError(said)
    return [f"{said}, if it fails"]


def expected(parts: Sequence[Part]) -> float:
    """Bytes of all parts together."""
    return sum(part.size for part in parts)


def available() -> int | None:
    """Bytes that this process may hold: what it has, and what is free, with swap; None: the system does not tell."""
    try:
        told = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        free = sum(int(told[name].split()[0]) for name in ("MemAvailable", "SwapFree")) * 1024
        has = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        groups = Path("/proc/self/cgroup").read_text()
    except (OSError, KeyError):
        return None
    return has + min([free, *left_in(groups)])


def left_in(groups: str, root: Path = Path("/sys/fs/cgroup")) -> Iterator[int]:
    """Bytes that the control groups around a process have left, where they have a limit: containers, batch jobs.

    groups: /proc/PID/cgroup. What only caches files can be had.
    """
    for line in groups.splitlines():
        _, kinds, path = line.split(":", 2)
        if not kinds:  # version 2
            top, limit, usage, cache = root, "memory.max", "memory.current", "inactive_file"
        elif "memory" in kinds.split(","):
            top, limit, usage, cache = (root / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes",
                                        "total_inactive_file")
        else:
            continue
        group = top / path.lstrip("/")
        for folder in (group, *group.parents):
            with contextlib.suppress(OSError, ValueError, KeyError):  # no limit, or not to be seen from a container
                most, taken = (int((folder / name).read_text()) for name in (limit, usage))
                told = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
                yield most - taken + int(told[cache])
            if folder == top:
                break
