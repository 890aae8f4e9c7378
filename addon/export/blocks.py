"""Meshes in files that successive snapshots share: what has not changed is neither read again nor written again.

A block is a subfolder with the arrays of some meshes, and is never written to again. A mesh that changed goes into
a new block; the old one is given up when no mesh in it is wanted, or written anew without what is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .geometry import joined
from .mesh import Mesh
from .snapshot import write_arrays

FULL = 50_000  # triangles of a block; only a larger mesh has more
MOST = 64  # blocks of a snapshot


@dataclass(eq=False)
class Stored:
    """A mesh in a block."""

    triangles: int
    textured: bool
    block: str = ""
    place: int = 0  # among the block's meshes


@dataclass(eq=False)
class _Block:
    meshes: list[Stored] = field(default_factory=list)

    @property
    def triangles(self) -> int:
        return sum(m.triangles for m in self.meshes)


class Blocks:
    """The `Meshes` of one snapshot after the other.

    `make` has a path made by a function in another thread, one after the other.
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
        """The blocks of the last snapshot and those begun since."""
        return set(self._blocks)

    def begin(self) -> None:
        """Another snapshot."""
        self._asked = set()

    def forget(self, changed: set[int] | None) -> None:
        """Read the meshes of these owners again, or (None) all."""
        self._known = {} if changed is None else {k: v for k, v in self._known.items() if not v[1] & changed}

    def get(self, key: tuple, owners: set[int], read: Callable[[], Mesh | None]) -> Stored | None:
        """The mesh of that key, read if it is not known or its owners changed."""
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
        """The snapshot's blocks in order, and each mesh's number by its id. What was not asked for is given up."""
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
        """Give up blocks that nobody wants; write the rest anew where little of it is wanted, or blocks are many."""
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
                   if name != "uvs" or len(a)}
