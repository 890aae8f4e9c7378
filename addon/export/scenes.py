"""Successive snapshots for a viewport, in one folder; only changes are exported again.

    scene-3.json        the description, which refers to the next two
    instances-2/        the arrays that place the meshes
    mesh-1/, mesh-4/    the blocks with the meshes

Blender's data is read in slices, so that Blender stays responsive; another thread writes the files.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .blocks import Blocks
from .geometry import Geometry
from .materials import Materials
from .report import Report
from .snapshot import handing_over, write_arrays, write_description
from .walk import Walk


class _TimeIsUp(Exception):  # noqa: N818  no error
    pass


class Scenes:
    """Successive snapshots of one depsgraph in `folder`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._writer = ThreadPoolExecutor(1)
        self._jobs: list[Future] = []
        self._blocks = Blocks(folder, self._make)
        self._materials: Materials | None = None
        self._depsgraph = 0
        self._walk: Walk | None = None
        self._changed: set[int] | None = None  # session_uids of the owners of meshes that must be read again; None: all
        self._materials_changed = self._images_changed = True
        self._deadline = 0.0
        self._numbers = {"scene": 0, "instances": 0}
        self._description: dict = {}
        self._arrays: dict[str, np.ndarray] = {}
        self._made: set[str] = set()  # names of the files and folders that exist
        self._needs: dict[int, set[str]] = {}  # number of a scene → names of the files that it needs

    def note(self, depsgraph) -> None:
        """Record what an update of `depsgraph` changed. The next `advance` starts again."""
        self._walk = None
        for update in depsgraph.updates:
            if update.is_updated_geometry and self._changed is not None:
                self._changed.add(update.id.original.session_uid)
            if isinstance(update.id, bpy.types.Material | bpy.types.NodeTree | bpy.types.Texture):
                self._materials_changed = True
            elif isinstance(update.id, bpy.types.Image):
                self._images_changed = True
        if depsgraph.as_pointer() != self._depsgraph:
            self._depsgraph = depsgraph.as_pointer()
            self._changed = None

    def advance(self, depsgraph, seconds: float, camera: Callable[[Report], dict],
                seen: Callable[[Any], bool]) -> Path | None:
        """Continue the export for about `seconds`. Returns None if it is not finished yet, otherwise the scene file;
        wait for it with `written`.

        It is the same file as before if nothing has changed. `camera` and `seen` are as in `Walk`.
        """
        self._deadline = time.monotonic() + seconds
        walk = self._walk or self._begin(depsgraph)
        try:
            walk.go(depsgraph, seen)
        except _TimeIsUp:
            return None
        self._walk = None
        blocks, numbers = self._blocks.end()
        arrays = self._geometry.instances(numbers)
        description = walk.description(depsgraph, camera(self._report)) | {"blocks": blocks}
        if not self._blocks.textured:  # images without triangles would need UVs
            description["materials"] = [m | {"image": -1, "alpha_image": -1} for m in description["materials"]]
        return self._save(arrays, description)

    def written(self, seconds: float = 0.0) -> bool:
        """Return whether all files are written, or are within this many seconds. Raises ExportError if one could not be
        written.
        """
        if seconds and self._jobs:
            wait(self._jobs, seconds)
        while self._jobs and self._jobs[0].done():
            with handing_over():
                self._jobs.pop(0).result()
        return not self._jobs

    def only(self, scene: Path) -> None:
        """Remove files that only older scenes need. Call this when the engine has read `scene`."""
        number = int(scene.stem[6:])
        self._needs = {n: needs for n, needs in self._needs.items() if n >= number}
        needed = self._blocks.names.union(*self._needs.values())
        if self._materials:
            images = _images(self._materials.images)
            needed |= images
            self._materials.forget_files({i for i in self._made if i.startswith("image-")} - needed)
        gone = [self._folder / name for name in self._made - needed]
        self._made &= needed
        if gone:
            self._jobs.append(self._writer.submit(lambda: list(map(_remove, gone))))

    def close(self) -> None:
        """Write nothing more, and wait for files that are being written."""
        self._writer.shutdown(cancel_futures=True)

    def _begin(self, depsgraph) -> Walk:
        self._report = Report()
        if self._materials is None:
            self._materials = Materials(self._report, self._folder, depsgraph)
        self._materials.begin(self._report, depsgraph, self._materials_changed, self._images_changed)
        self._blocks.forget(self._changed)
        self._blocks.begin()
        self._changed, self._materials_changed, self._images_changed = set(), False, False
        self._geometry = Geometry(
            self._materials, self._report, self._check, depsgraph.view_layer_eval, self._blocks)
        self._walk = Walk(self._materials, self._geometry, self._report, self._check)
        return self._walk

    def _check(self) -> None:
        if time.monotonic() > self._deadline:
            raise _TimeIsUp

    def _save(self, arrays: dict[str, np.ndarray], description: dict) -> Path:
        if not (self._arrays and all(np.array_equal(a, self._arrays[name]) for name, a in arrays.items())):
            self._arrays = arrays
            folder = self._folder / self._next("instances")
            self._make(folder, lambda: write_arrays(folder, arrays))
        description["instances"] = f"instances-{self._numbers['instances']}"
        if description != self._description:
            self._description = description
            path = self._folder / f"{self._next('scene')}.json"
            images = _images(description["images"])
            self._needs[self._numbers["scene"]] = {
                path.name, description["instances"], *description["blocks"], *images}
            self._made |= images
            self._make(path, lambda: write_description(path, description))
        return self._folder / f"scene-{self._numbers['scene']}.json"

    def _next(self, what: str) -> str:
        self._numbers[what] += 1
        return f"{what}-{self._numbers[what]}"

    def _make(self, path: Path, job: Callable[[], object]) -> None:
        self._made.add(path.name)
        self._jobs.append(self._writer.submit(job))


def _images(images: list[dict]) -> set[str]:
    """Return the images that are files in the snapshot's folder."""
    return {i["path"] for i in images if not Path(i["path"]).is_absolute()}


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
