"""The arrays of a snapshot: where their files are, and the checks of their types, their values and whether they fit
together.

A snapshot without blocks has all arrays beside `scene.json`. If it says `"blocks": ["mesh-1", "mesh-4"]`, the meshes
are those of these subfolders, in this order, so that successive scenes share meshes that did not change; triangles
refer to materials of the scene. `"instances": "instances-12"` names the subfolder with the arrays of the instances.
"""

from __future__ import annotations

import dataclasses
import errno
import math
import re
import tokenize
from pathlib import Path
from typing import Any

import numpy as np

from ..support.text import quoted
from .errors import SceneError
from .geometry import Geometry

# Geometry field → (dtype, trailing shape); None: any number
ARRAYS: dict[str, tuple[str, tuple[int | None, ...]]] = {
    "vertices": ("float32", (3,)),
    "triangles": ("int32", (3,)),
    "corner_normals": ("float32", (3, 3)),
    "uvs": ("float32", (3, 2)),
    "triangle_materials": ("int32", ()),
    "meshes": ("int64", (4,)),
    "instance_mesh": ("int32", ()),
    "instance_object": ("int32", ()),
    "instance_matrix": ("float64", (4, 4)),
    "attributes": ("float32", (3, None)),
    "instance_values": ("float32", (None,)),
}
OPTIONAL = {"attributes", "instance_values"}  # without a file they are empty
_INSTANCES = tuple(name for name in ARRAYS if name.startswith("instance_"))
_MESHES = tuple(name for name in ARRAYS if name not in _INSTANCES)


def read_geometry(folder: Path, blocks: Any, instances: Any, mapped: bool) -> Geometry:
    """Read the arrays of the snapshot in `folder`, and check the type of each. `check_geometry` checks whether they fit
    together.
    """
    top = "" if instances is None else _plain_name(instances, "instances")
    arrays = {name: _read_array(folder, top, name, mapped) for name in _INSTANCES}
    if blocks is None:
        return Geometry(**arrays, **{name: _read_array(folder, "", name, mapped) for name in _MESHES})
    if not isinstance(blocks, list):
        raise SceneError("scene.json: blocks must be a list of folders' names")
    names = [_plain_name(name, "blocks") for name in blocks]
    return Geometry(**arrays, **_joined([_read_block(folder, name) for name in names]))


def _plain_name(name: Any, where: str) -> str:
    """Return `name` if it names a folder directly in the snapshot's folder; raise SceneError otherwise."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*", name):
        raise SceneError(f"scene.json: {where} names {quoted(name)}, which is no plain name of a folder: letters, "
                         "digits, '_', '-' and '.' only, and no '.' in front")
    return name


def _read_block(folder: Path, block: str) -> dict[str, np.ndarray]:
    """Read the mesh arrays of a block and check that they fit together; after blocks are joined this cannot be checked
    any more.
    """
    arrays = {name: _read_array(folder, block, name, True) for name in _MESHES}
    try:
        _check_meshes(arrays)
    except SceneError as e:
        raise SceneError(f"block {block}: {e}") from e
    return arrays


def _joined(blocks: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Join the mesh arrays of all blocks into one set. Blocks without uvs or attributes get zeros if others have some.
    """
    textured = any(len(b["uvs"]) for b in blocks)
    channels = max((b["attributes"].shape[2] for b in blocks), default=0)
    vertices = triangles = 0
    for b in blocks:
        if textured and not len(b["uvs"]):
            b["uvs"] = np.zeros((len(b["triangles"]), 3, 2), np.float32)
        had = b["attributes"]
        if had.shape[2] < channels:
            b["attributes"] = np.zeros((len(b["triangles"]), 3, channels), np.float32)
            b["attributes"][:len(had), :, :had.shape[2]] = had
        b["meshes"] = b["meshes"] + np.array([vertices, 0, triangles, 0])
        vertices += len(b["vertices"])
        triangles += len(b["triangles"])
    return {name: np.concatenate([np.zeros((0, *(channels if n is None else n for n in ARRAYS[name][1])),
                                           ARRAYS[name][0]), *(b[name] for b in blocks)]) for name in _MESHES}


def fits(shape: tuple[int, ...], tail: tuple[int | None, ...]) -> bool:
    """Return whether a shape is (n, *tail); None in `tail` is any length."""
    return len(shape) == 1 + len(tail) and all(a in (b, None) for a, b in zip(tail, shape[1:], strict=True))


def shape_of(tail: tuple[int | None, ...]) -> str:
    """Return the shape (n, *tail) for a sentence."""
    return ", ".join(["n", *("k" if n is None else str(n) for n in tail)])


def _read_array(folder: Path, block: str, name: str, mapped: bool) -> np.ndarray:
    path = folder / block / f"{name}.npy"
    shown = f"{block}/{name}.npy" if block else f"{name}.npy"
    dtype, tail = ARRAYS[name]
    if name in OPTIONAL and not path.exists():
        return np.zeros((0, *(n or 0 for n in tail)), dtype)
    try:
        if not path.is_file():  # reading a pipe, for example, would block
            raise FileNotFoundError("there is no such file")
        # An empty file cannot be mapped.
        with path.open("rb") as f:
            version = np.lib.format.read_magic(f)
            header = np.lib.format.read_array_header_1_0 if version == (1, 0) \
                else np.lib.format.read_array_header_2_0
            shape, fortran, found = header(f)
            start = f.tell()
        if not all(type(n) is int and n >= 0 for n in shape):
            raise SceneError(f"{shown} has the shape {quoted(shape)}, which is none: write the snapshot again")
        size = math.prod(shape) * found.itemsize
        if fortran or found != np.dtype(dtype) or not fits(shape, tail):
            raise SceneError(f"{shown} is {found} {quoted(shape)}; needed: {dtype} ({shape_of(tail)})")
        if path.stat().st_size - start != size:
            raise SceneError(f"{shown} is cut short: {path.stat().st_size - start} of {size} bytes")
        # "c": mapped, but kernels may treat it like an array in memory; nothing is ever written to the file.
        return np.asarray(np.load(path, mmap_mode="c" if size and mapped else None, allow_pickle=False))
    except SceneError:
        raise
    except OSError as e:
        if e.errno == errno.ENOMEM:
            raise MemoryError from e
        raise SceneError(f"{shown} in the snapshot cannot be read: {e.strerror or e}") from e
    except (ValueError, TypeError, EOFError, OverflowError, SyntaxError, tokenize.TokenError) as e:
        raise SceneError(f"{shown} in the snapshot cannot be read: {quoted(str(e))}") from e


def check_geometry(g: Geometry, objects: int, materials: int) -> None:
    """Raise SceneError unless all arrays fit together, for a scene with this many objects and materials."""
    _check_meshes({f.name: getattr(g, f.name) for f in dataclasses.fields(g)})
    _check_rows(g.instance_object, "instance_object", len(g.instance_mesh))
    _check_rows(g.instance_matrix, "instance_matrix", len(g.instance_mesh))
    if g.instance_values.shape[1]:
        _check_rows(g.instance_values, "instance_values", len(g.instance_mesh))
    for name, count, what in (("instance_mesh", len(g.meshes), "mesh"), ("instance_object", objects, "object"),
                              ("triangle_materials", materials, "material")):
        values = getattr(g, name)
        if len(values) and not (values.min() >= 0 and values.max() < count):
            raise SceneError(f"{name} names a {what} that does not exist")


def _check_meshes(g: dict[str, np.ndarray]) -> None:
    vertices, triangles = len(g["vertices"]), len(g["triangles"])
    _check_rows(g["corner_normals"], "corner_normals", triangles)
    _check_rows(g["triangle_materials"], "triangle_materials", triangles)
    if len(g["uvs"]) not in (0, triangles):
        raise SceneError(f"uvs has {len(g['uvs'])} rows; needed: {triangles}, or none")
    if g["attributes"].shape[2]:
        _check_rows(g["attributes"], "attributes", triangles)
    for m, (v0, mv, t0, mt) in enumerate(g["meshes"].tolist()):
        if min(v0, mv, t0, mt) < 0 or v0 + mv > vertices or t0 + mt > triangles:
            raise SceneError(f"mesh {m} points outside vertices or triangles")
        part = g["triangles"][t0:t0 + mt]
        if mt and not (part.min() >= 0 and part.max() < mv):
            raise SceneError(f"mesh {m} has a triangle whose vertex does not exist")


def _check_rows(array: np.ndarray, name: str, rows: int) -> None:
    if len(array) != rows:
        raise SceneError(f"{name} has {len(array)} rows; needed: {rows}")
