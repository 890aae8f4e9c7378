"""One evaluated mesh → arrays."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass
class Mesh:
    """A mesh as Blender stores it. Free of Blender: `arrays` may be asked for in any thread."""

    vertices: np.ndarray  # (V,3)
    corner_vertices: np.ndarray  # (C,)
    corners: np.ndarray  # (T,3) of the triangles
    normals: np.ndarray  # (V,3), (P,3) or (C,3)
    domain: str  # of the normals: POINT where all is smooth, FACE where all is flat, or CORNER
    polygons: np.ndarray | None  # (T,) of the triangles, where `normals` or `slots` want them
    materials: np.ndarray  # (S,) numbers of the slots' materials
    slots: np.ndarray | None  # (P,); None: all faces have the first
    uvs: np.ndarray | None  # (C,2), where a material has an image

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays of the engine's Geometry that describe triangles; "uvs" only where there are some."""
        triangles = self.corner_vertices[self.corners]
        if self.domain == 'POINT':
            normals = self.normals[triangles]
        elif self.domain == 'FACE':
            normals = np.broadcast_to(self.normals[self.polygons][:, None], (len(triangles), 3, 3))
        else:
            normals = self.normals[self.corners]
        if self.slots is None:
            materials = np.full(len(triangles), self.materials[0], np.int32)
        else:
            # A slot that does not exist means the last one, as in Blender.
            materials = self.materials[np.clip(self.slots, 0, len(self.materials) - 1)][self.polygons]
        uvs = {} if self.uvs is None else {"uvs": self.uvs[self.corners]}
        return {"vertices": self.vertices, "triangles": triangles, "corner_normals": normals,
                "triangle_materials": materials} | uvs


class Reader:
    """Reads a mesh array by array. When `check` raises, the next `read` of the same mesh goes on from there."""

    def __init__(self, check: Callable[[], None]) -> None:
        self._check = check
        self._parts: dict[str, np.ndarray] = {}

    def read(self, mesh, materials: tuple[int, ...], textured: bool, uv_layer) -> Mesh:
        """`mesh`, which has triangles, with its slots' `materials`; where `textured` with UVs: of a layer, or all 0."""
        attributes = mesh.attributes
        # Custom normals are those of corners, whatever else they are stored for.
        domain = 'CORNER' if "custom_normal" in attributes else mesh.normals_domain
        slots = attributes.get("material_index") if len(materials) > 1 else None
        normals, n = {
            'POINT': (mesh.vertex_normals, len(mesh.vertices)), 'FACE': (mesh.polygon_normals, len(mesh.polygons)),
            'CORNER': (mesh.corner_normals, len(mesh.loops)),
        }[domain]
        np_, nt = len(mesh.polygons), len(mesh.loop_triangles)
        # Of the ways to the same numbers the attributes are by far the fastest: they are copied as a whole.
        result = Mesh(
            vertices=self._got("vertices", attributes["position"].data, "vector", (len(mesh.vertices), 3)),
            corner_vertices=self._got("corner_vertices", attributes[".corner_vert"].data, "value",
                                      (len(mesh.loops),), np.int32),
            corners=self._part("corners", lambda: _corners(mesh)),
            normals=self._got("normals", normals, "vector", (n, 3)),
            domain=domain,
            polygons=self._got("polygons", mesh.loop_triangle_polygons, "value", (nt,), np.int32)
            if slots or domain == 'FACE' else None,
            materials=np.array(materials, np.int32),
            slots=self._got("slots", slots.data, "value", (np_,), np.int32) if slots else None,
            uvs=self._got("uvs", uv_layer.uv, "vector", (len(mesh.loops), 2)) if uv_layer
            else np.zeros((len(mesh.loops), 2), np.float32) if textured else None,
        )
        self._parts = {}
        return result

    def _got(self, part: str, collection, name: str, shape: tuple[int, ...], dtype=np.float32) -> np.ndarray:
        def get():
            flat = np.empty(math.prod(shape), dtype)
            collection.foreach_get(name, flat)
            return flat.reshape(shape)
        return self._part(part, get)

    def _part(self, part: str, get: Callable[[], np.ndarray]) -> np.ndarray:
        if part not in self._parts:
            self._parts[part] = get()
            self._check()  # a large mesh takes longer than an artist who pressed ESC wants to wait
        return self._parts[part]


def _corners(mesh) -> np.ndarray:
    """(T,3) corners of the triangles."""
    triangles = mesh.loop_triangles
    n = len(triangles)
    first = triangles[0].as_pointer()
    if triangles[n - 1].as_pointer() - first == 12 * (n - 1) and n > 1:
        # Three int32 a triangle, one after the other: foreach_get would go through them one by one and keep the
        # artist waiting, 0.2 s for a million.
        stored = np.ctypeslib.as_array((ctypes.c_int32 * (3 * n)).from_address(first)).reshape(n, 3).copy()
        if all(tuple(triangles[i].loops) == tuple(stored[i]) for i in (0, n // 2, n - 1)):
            return stored
    flat = np.empty(3 * n, np.int32)
    triangles.foreach_get("loops", flat)
    return flat.reshape(n, 3)
