"""How much memory a picture needs, and how much there is, so that a scene that is too large is refused before it
starts.

The bytes are measured (tests/support/load.py prints the expected and the real memory). An expectation may be wrong by a
quarter, so a scene is refused only if it needs a quarter more than there is.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..film.images import crop_of
from ..film.passes import letters
from ..rays.camera import depth
from ..scene.description import Scene
from ..scene.errors import SceneError
from ..shadows.meshes.lattice import above_a_plane
from ..shadows.method import Nodes
from ..shadows.psi import CANDIDATES
from ..shadows.registry import KINDS
from ..shadows.shares import FIRST
from ..support import processors
from ..surface import textures
from .lighting import SHADED
from .world import World

BASE = 50 << 20  # Python and its libraries
IMAGES = 30 << 20  # OpenImageIO, if there are images
MESH = 60  # for a triangle in the snapshot, once for all its instances; data that is not used stays in the file
TRIANGLE, VERTEX = 60, 12  # for an instance
ACCELERATED, ACCELERATED_VERTEX = 84, 16  # the same again for each accelerator
BATCH = 1 << 17  # camera rays of a tile, about: each thread has one under way
LARGER = 2  # how many times as many there are if tiles compute the points at their edges twice (`sparse`)
SPREAD = 8  # how many times fewer there are if surfaces spread them out
RAY, LIT, CANDIDATE = 400, 5, 6  # for a ray; for a receiver and a light; for a receiver and a node
NODE = 16  # for a node, in addition to its values
MIXED = 0.3  # share of the nodes that may be near a penumbra
# as shares of the available memory: above DOUBT a scene is refused, above CLOSE there is a warning
DOUBT, CLOSE = 1.25, 0.8


class Part(NamedTuple):
    """A part of a picture's data that takes memory."""

    size: float  # in bytes
    what: str
    remedy: str


def rays_of_tile(scene: Scene) -> int:
    """Return how many camera rays a tile has at most, about, if surfaces do not spread them out."""
    return BATCH * (LARGER if scene.settings.shadow_rate > 1 else 1)


def before(scene: Scene, passes: Sequence[str], copies: int = 1) -> list[Part]:
    """Return the parts that are known before anything is made: all but the nodes. `copies` of the picture are counted:
    2 if a parent process has one as well.
    """
    x0, y0, x1, y1 = crop_of(scene)
    pixels, threads, lights = (x1 - x0) * (y1 - y0), processors.count(), len(scene.lights)
    glass = any(m.alpha < 1 or m.alpha_image >= 0 or any(m.kt) for m in scene.materials)
    rays = min(rays_of_tile(scene), pixels * scene.settings.samples / (4 * threads))
    shaded = min(rays * lights, SHADED)
    painted = any(light.program for light in scene.lights)  # then each lamp's light has three channels
    work = rays * RAY + shaded * (LIT + 8 * glass + 12 * painted)
    if KINDS[scene.settings.shadows].lattice:
        work += shaded * (4 * any(light.softness == "SIZE" for light in scene.lights)  # what each lamp gives
                          + 12 * (scene.settings.light_threshold > 0))
        near = above_a_plane(scene.settings.kI)  # nodes of a receiver; the receivers of a batch share most of them
        # where surfaces let light through a candidate takes more, and there are fewer at once
        work += min(rays * near, CANDIDATES / (8 if glass else 1)) * CANDIDATE * (4 if glass else 1)
        work += 3 * shaded * (24 if glass else 0.5)
    return [
        Part(BASE, "the engine itself", "close other programs"),
        _triangles(scene, glass),
        *_textures(scene),
        Part(4.0 * copies * pixels * sum(len(letters(name)) for name in passes),
             f"{x1 - x0:,} × {y1 - y0:,} pixels of {len(passes)} passes", "render a smaller picture, or fewer passes"),
        Part(threads * work,
             f"{threads} threads with {lights:,} lights", "use fewer threads: --threads, or Threads under Performance"),
    ]


def _textures(scene: Scene) -> list[Part]:
    """Return the part of the images, as they are stored in memory."""
    found = textures.layouts(scene.images, textures.alphas(scene))
    if not found:
        return []
    image, largest = max(found, key=lambda one: one[1].bytes)
    what = f"{len(found)} image {'textures' if len(found) > 1 else 'texture'}"
    return [Part(float(IMAGES + textures.held([layout.bytes for _, layout in found])),
                 f"{what}, the largest '{image.name}' of {largest.width:,} × {largest.height:,}", "scale images down")]


def _triangles(scene: Scene, glass: bool) -> Part:
    """Return the parts of the geometry, and of an accelerator for each set of objects that a kind of ray can hit."""
    g = scene.geometry
    _, vertices, _, triangles = g.meshes[g.instance_mesh].T if len(g.instance_mesh) else np.zeros((4, 1), np.int64)
    of_object = np.zeros(len(scene.objects))
    if len(g.instance_mesh):
        np.add.at(of_object, g.instance_object, triangles)
    seen = [tuple(getattr(o, f"visible_{kind}") for o in scene.objects) for kind in ("camera", "reflection", "shadow")]
    sets = [np.array(s, np.bool_) for s in set(seen)]
    sets += [np.array(seen[2], np.bool_)] * glass  # the triangles that let light through, and those that stop it
    sets += [np.isin(np.arange(len(of_object)), b) for b in {light.blockers for light in scene.lights} if b]
    count, vertex = float(triangles.sum()), float(vertices.sum())
    shape = ACCELERATED + ACCELERATED_VERTEX * vertex / max(1.0, count)
    accelerators = shape * sum(of_object[s].sum() for s in sets)
    return Part(MESH * len(g.triangles) + TRIANGLE * count + VERTEX * vertex + accelerators,
                f"{count:,.0f} triangles in {len(g.instance_mesh):,} instances",
                "hide objects, reduce subdivision, or scatter fewer instances, each of which counts")


def nodes(scene: Scene, world: World, radii: NDArray[np.float64], channels: int) -> Part:
    """Return the nodes of light meshes around what the camera sees: by a coarse view, area·r/h³, or all that receivers
    reach.

    radii (K,): of their balls in steps, ascending. channels: of a node's value, as `Plan.channels`. Those around what
    is seen in mirrors are left out.
    """
    s, lights = scene.settings, len(scene.lights)
    each = NODE + (4 * lights * channels if channels else lights / 8)
    reached = _reached(scene, world, float(radii[-1]), s.h, each)
    return Part(reached * each, f"about {reached:,.0f} nodes of light meshes with {lights:,} lights",
                f"take a larger step than h = {s.h:g}, or fewer lights with soft shadows")


def shares(scene: Scene, world: World, nodes: Sequence[Nodes]) -> list[Part]:
    """Return the nodes that hold shares of lamps with a size, in the same way; none where there are no such lamps."""
    size = count = 0.0
    for one in nodes:
        if one.points:
            each = NODE + one.store.bytes_of_a_node
            reached = _reached(scene, world, float(one.lattice.reach[-1]), one.lattice.h, each)
            size += reached * each * (1.0 if one.points == FIRST else MIXED)
            count += reached * (one.points == FIRST)
    what = f"about {count:,.0f} nodes with shares of {len(scene.lights):,} lights"
    return [Part(size, what, f"take a larger step than h = {scene.settings.h:g}, or fewer lamps of softness Lamp Shape")
            ] if size else []


def _reached(scene: Scene, world: World, reach: float, h: float, each: float) -> float:
    """Return how many nodes of a lattice of step h the camera's receivers reach, so many steps far.

    each: bytes of a node; where all can not be many, no view is looked at.
    """
    x0, y0, x1, y1 = crop_of(scene)
    reached = (x1 - x0) * (y1 - y0) * scene.settings.samples * above_a_plane(reach)
    if reached * each > 16 << 20:
        direction, hits = world.coarse_view()
        camera = world.scene.camera
        left, right, bottom, top = camera.window
        across = abs((right - left) * (top - bottom)) * (depth(camera, hits.P) ** 2 if camera.perspective else 1.0)
        slant = (direction @ -camera.matrix[:3, 2]) / np.maximum(np.abs((direction * hits.Ng).sum(1)), 1e-9)
        reached = np.minimum(across * slant * reach / h**2, reached).sum() / 64**2
    return float(reached)


def check(parts: Sequence[Part]) -> list[str]:
    """Return a warning if the memory may just be enough; raise SceneError if all parts together need too much."""
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
    """Return the bytes of all parts together."""
    return sum(part.size for part in parts)


def available() -> int | None:
    """Return how many bytes this process may use: what it has and what is free, including swap. None if the system does
    not tell.
    """
    try:
        told = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        free = sum(int(told[name].split()[0]) for name in ("MemAvailable", "SwapFree")) * 1024
        has = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        groups = Path("/proc/self/cgroup").read_text()
    except (OSError, KeyError):
        return None
    return has + min([free, *left_in(groups)])


def left_in(groups: str, root: Path = Path("/sys/fs/cgroup")) -> Iterator[int]:
    """Return how many bytes the control groups around a process (containers, batch jobs) have left; None if they have
    no limit.

    `groups` is the content of /proc/PID/cgroup. Memory that only caches files counts as free.
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
            with contextlib.suppress(OSError, ValueError, KeyError):  # there is no limit, or a container hides it
                most, taken = (int((folder / name).read_text()) for name in (limit, usage))
                told = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
                yield most - taken + int(told[cache])
            if folder == top:
                break
