"""Triangle meshes as plain arrays, and the simple ones: rectangle, box, cylinder, sphere.

Use these to describe a scene in Python, with `description.Shape` and `description.Scene.from_shapes`. Lengths are in
scene units, and triangles are counter-clockwise seen from outside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..support.text import quoted
from .errors import SceneError


@dataclass(frozen=True, eq=False, init=False)
class Mesh:
    """The triangles of a surface, in coordinates of its own. Arrays of these types are kept, not copied."""

    vertices: NDArray[np.float64]  # (n,3)
    triangles: NDArray[np.int64]  # (t,3) indices of vertices
    normals: NDArray[np.float64] | None  # (t,3,3) unit, one for each corner, for shading; None: flat triangles
    uvs: NDArray[np.float64] | None  # (t,3,2) for materials with an image; None: without

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike, normals: ArrayLike | None = None,
                 uvs: ArrayLike | None = None) -> None:
        """Take the arrays; lists and tuples are converted. Raises SceneError if a shape, a number or an index is wrong.
        """
        points = numbers(vertices, "a mesh's vertices", (-1, 3))
        corners = _indices(triangles, len(points))
        object.__setattr__(self, "vertices", points)
        object.__setattr__(self, "triangles", corners)
        for name, values, size in (("normals", normals, 3), ("uvs", uvs, 2)):
            shape = (len(corners), 3, size)
            object.__setattr__(self, name, None if values is None else numbers(values, f"a mesh's {name}", shape))

    def corner_normals(self) -> NDArray[np.float64]:
        """Return the shading normals (t,3,3): the mesh's own, or each triangle's; 0 where a triangle has no area."""
        if self.normals is not None:
            return self.normals
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        with np.errstate(all="ignore"):
            n = np.cross(b - a, c - a)
            n /= np.linalg.norm(n, axis=1, keepdims=True)
        return np.repeat(np.nan_to_num(n)[:, None], 3, 1)


def numbers(values: ArrayLike, what: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return `values` as a float64 array of this shape, in which −1 stands for any length. Raises SceneError; `what`
    begins its sentence.
    """
    try:
        found = np.asarray(values, np.float64)
    except (ValueError, TypeError) as e:
        raise SceneError(f"{what} must be numbers: {e}") from e
    return _shaped(found, what, shape)


def at_least(least: int, count: int, what: str) -> None:
    """Raise SceneError unless `count` is a whole number of at least `least`; `what` begins its sentence."""
    if not isinstance(count, int | np.integer) or isinstance(count, bool) or count < least:
        raise SceneError(f"{what} must be a whole number from {least} up, not {quoted(count)}")


def _shaped(found: NDArray[Any], what: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return `found` if it has this shape. An empty list has lost its shape when it became an array, and gets it back.
    """
    if not found.size and shape and shape[0] in (-1, 0):
        found = found.reshape(0, *shape[1:])
    if found.ndim != len(shape) or any(n not in (-1, m) for n, m in zip(shape, found.shape, strict=True)):
        needed = ", ".join("n" if n == -1 else str(n) for n in shape) + "," * (len(shape) == 1)
        raise SceneError(f"{what} must have the shape ({needed}), not {found.shape}" if shape
                         else f"{what} must be one number, not {len(found)}")
    return found


def _indices(triangles: ArrayLike, vertices: int) -> NDArray[np.int64]:
    """Return `triangles` as an array (t,3) of indices below the number of `vertices`. Raises SceneError."""
    what = "a mesh's triangles"
    try:
        found = _shaped(np.asarray(triangles), what, (-1, 3))
    except ValueError as e:
        raise e if isinstance(e, SceneError) else SceneError(f"{what} must be numbers: {e}") from e
    if len(found) and found.dtype.kind not in "iu":
        raise SceneError(f"{what} must be whole numbers, which name vertices, not {found.dtype}")
    wrong = ((found < 0) | (found >= vertices)).any(1)
    if wrong.any():
        n = int(np.argmax(wrong))
        raise SceneError(f"triangle {n} of a mesh is {found[n].tolist()}, but the mesh has {vertices} vertices, and "
                         "the first is 0")
    return found.astype(np.int64, copy=False)


def rectangle(low: Sequence[float], high: Sequence[float], z: float = 0.0) -> Mesh:
    """Return a level rectangle between the corners low (x, y) and high (x, y), at height z; it faces +z."""
    (x0, y0), (x1, y1) = numbers(low, "low", (2,)), numbers(high, "high", (2,))
    return Mesh([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], [(0, 1, 2), (0, 2, 3)])


def box(low: Sequence[float], high: Sequence[float]) -> Mesh:
    """Return a closed box along the axes between the corners low (x, y, z) and high (x, y, z)."""
    ends = numbers(low, "low", (3,)), numbers(high, "high", (3,))
    corners = [(ends[i][0], ends[j][1], ends[k][2]) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def cylinder(radius: float, z0: float, z1: float, sides: int = 48, smooth: bool = False) -> Mesh:
    """Return a closed prism with `sides` sides around the z axis, from z0 to z1. smooth: shade the sides as one round
    surface. Raises SceneError with fewer than 3 sides.
    """
    at_least(3, sides, "a cylinder's sides")
    angle = 2 * np.pi * np.arange(sides) / sides
    around = np.stack([np.cos(angle), np.sin(angle)], 1)
    ring = radius * around
    bottom, top = np.c_[ring, np.full(sides, z0)], np.c_[ring, np.full(sides, z1)]
    vertices = np.vstack([bottom, top, [(0, 0, z0), (0, 0, z1)]])
    a, b = np.arange(sides), (np.arange(sides) + 1) % sides
    low, high = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    mesh = Mesh(vertices, np.vstack([
        np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1),
        np.stack([low, b, a], 1), np.stack([high, a + sides, b + sides], 1),
    ]))
    if not smooth:
        return mesh
    normals = mesh.corner_normals()
    outwards = np.c_[around, np.zeros(sides)]
    normals[:2 * sides] = outwards[mesh.triangles[:2 * sides] % sides]
    return Mesh(vertices, mesh.triangles, normals)


def sphere(radius: float, segments: int = 32, rings: int = 16, smooth: bool = True) -> Mesh:
    """Return a sphere around the origin with its poles on the z axis. It has `segments` meridians, and `rings` rings of
    faces from pole to pole. smooth: shade it as round, and not flat. Raises SceneError with fewer than 3 segments or 2
    rings.
    """
    at_least(3, segments, "a sphere's segments")
    at_least(2, rings, "a sphere's rings")
    theta = np.pi * np.arange(1, rings) / rings
    phi = 2 * np.pi * np.arange(segments) / segments
    t, p = np.meshgrid(theta, phi, indexing="ij")
    unit = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1).reshape(-1, 3)
    unit = np.vstack([unit, [(0, 0, 1), (0, 0, -1)]])
    here = np.arange(segments)
    there = (here + 1) % segments
    # Segment by segment, from the top down.
    north, south = np.full(segments, len(unit) - 2), np.full(segments, len(unit) - 1)
    faces = [np.stack([north, here, there], 1)]
    for ring in range(0, (rings - 2) * segments, segments):
        a, b, c, d = ring + here, ring + segments + here, ring + segments + there, ring + there
        faces += [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    last = (rings - 2) * segments
    faces.append(np.stack([south, last + there, last + here], 1))
    triangles = np.stack(faces, 1).reshape(-1, 3)
    return Mesh(unit * radius, triangles, unit[triangles] if smooth else None)
