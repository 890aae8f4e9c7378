"""Meshes in files that successive snapshots share, so that unchanged meshes are neither read nor written again.

A block is a subfolder with the arrays of some meshes. After it is written it is never changed. A mesh that changed goes
into a new block. The old block is dropped when no mesh in it is wanted any more; if only little of it is wanted, that
part is written into a new block.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .geometry import joined
from .mesh import Mesh
from .snapshot import write_arrays

FULL = 50_000  # triangles in a block; only a block with one larger mesh has more
MOST = 64  # the largest number of blocks in a snapshot


@dataclass(eq=False)
class Stored:
    """A mesh in a block."""

    triangles: int
    textured: bool
    block: str = ""
    place: int = 0  # index among the meshes of the block


@dataclass(eq=False)
class _Block:
    meshes: list[Stored] = field(default_factory=list)

    @property
    def triangles(self) -> int:
        return sum(m.triangles for m in self.meshes)


class Blocks:
    """The `Meshes` of successive snapshots.

    `make` calls a function that writes a path; it does so in another thread, one call after the other.
    """

    def __init__(self, folder: Path, make: Callable[[Path, Callable[[], None]], None]) -> None:
        self._folder, self._make = folder, make
        self._known: dict[tuple, tuple[Stored | None, set[int]]] = {}
        self._asked: set[tuple] = set()
        self._open: list[tuple[Stored, Mesh]] = []  # not written yet
        self._open_triangles = 0
        self._blocks: dict[str, _Block] = {}
        self._count = 0
        self.textured = False  # whether any mesh of the snapshot has UVs

    @property
    def names(self) -> set[str]:
        """Return the blocks of the last snapshot and those that were begun since."""
        return set(self._blocks)

    def begin(self) -> None:
        """Begin another snapshot."""
        self._asked = set()

    def forget(self, changed: set[int] | None) -> None:
        """Read the meshes of these owners again; None means all meshes."""
        self._known = {} if changed is None else {k: v for k, v in self._known.items() if not v[1] & changed}

    def get(self, key: tuple, owners: set[int], read: Callable[[], Mesh | None]) -> Stored | None:
        """Return the mesh with that key. It is read if it is not known, or if one of its owners changed."""
        if key not in self._known:
            mesh = read()
            stored = None if mesh is None else Stored(len(mesh.corners), mesh.uvs is not None)
            self._known[key] = stored, owners
            if stored and mesh:
                self._open.append((stored, mesh))
                self._open_triangles += stored.triangles
                if self._open_triangles >= FULL:
                    self._close()
        self._asked.add(key)
        return self._known[key][0]

    def end(self) -> tuple[list[str], dict[int, int]]:
        """Return the blocks of the snapshot in order, and the number of each mesh by its id. Meshes that were not asked
        for are dropped.
        """
        self._known = {k: v for k, v in self._known.items() if k in self._asked}
        wanted = {stored for stored, _ in self._known.values() if stored}
        self.textured = any(m.textured for m in wanted)
        self._open = [(s, m) for s, m in self._open if s in wanted]
        if self._open:
            self._close()
        self._tidy(wanted)
        numbers: dict[int, int] = {}
        names, n = [], 0
        for name, block in self._blocks.items():
            names.append(name)
            numbers |= {id(m): n + i for i, m in enumerate(block.meshes) if m in wanted}
            n += len(block.meshes)
        return names, numbers

    def _close(self) -> None:
        meshes = [mesh for _, mesh in self._open]
        self._put([stored for stored, _ in self._open], lambda: [mesh.arrays() for mesh in meshes])
        self._open, self._open_triangles = [], 0

    def _put(self, meshes: list[Stored], arrays: Callable[[], list[dict[str, np.ndarray]]]) -> None:
        self._count += 1
        name = f"mesh-{self._count}"
        path = self._folder / name
        for place, stored in enumerate(meshes):
            stored.block, stored.place = name, place
        self._blocks[name] = _Block(meshes)

        def write():
            parts = arrays()
            write_arrays(path, joined(parts, any("uvs" in p for p in parts)))
        self._make(path, write)

    def _tidy(self, wanted: set[Stored]) -> None:
        """Drop blocks that nobody wants. If little of a block is wanted, or there are many blocks, write the rest into
        new blocks.
        """
        live = {name: sum(m.triangles for m in b.meshes if m in wanted) for name, b in self._blocks.items()}
        self._blocks = {name: b for name, b in self._blocks.items() if any(m in wanted for m in b.meshes)}
        sizes = {name: b.triangles for name, b in self._blocks.items()}
        again = [n for n in self._blocks if 2 * live[n] < sizes[n]] \
            if sum(sizes.values()) > 2 * sum(live.values()) + FULL else []
        small = [n for n in self._blocks if sizes[n] < FULL]
        if len(small) > MOST:
            again = [n for n in self._blocks if n in again or n in small]
        parts: list[Stored] = []
        for name in again:
            parts += [m for m in self._blocks.pop(name).meshes if m in wanted]
            if sum(m.triangles for m in parts) >= FULL or name == again[-1]:
                self._move(parts)
                parts = []

    def _move(self, meshes: list[Stored]) -> None:
        places = [(m.block, m.place) for m in meshes]
        self._put(meshes, lambda: list(self._reread(places)))

    def _reread(self, places: list[tuple[str, int]]) -> Iterable[dict[str, np.ndarray]]:
        for block, place in places:
            arrays = {p.stem: np.load(p, mmap_mode="r" if p.stat().st_size > 4096 else None)
                      for p in (self._folder / block).glob("*.npy")}
            v0, nv, t0, nt = arrays.pop("meshes")[place]
            yield {name: a[v0:v0 + nv] if name == "vertices" else a[t0:t0 + nt] for name, a in arrays.items()
                   if name not in ("uvs", "attributes") or len(a)}
