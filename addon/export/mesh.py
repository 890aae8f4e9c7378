"""Convert one evaluated mesh to arrays."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .channels import Key
from .corners import channels


@dataclass
class Mesh:
    """A copy of a mesh in Blender's layout. It holds no Blender data, so `arrays` may be called in any thread."""

    vertices: np.ndarray  # (V,3)
    corner_vertices: np.ndarray  # (C,)
    corners: np.ndarray  # (T,3) of the triangles
    normals: np.ndarray  # (V,3), (P,3) or (C,3)
    domain: str  # of the normals: POINT if all is smooth, FACE if all faces or edges are sharp, otherwise CORNER
    polygons: np.ndarray | None  # (T,) polygon of each triangle, if `normals` or `slots` need it
    materials: np.ndarray  # (S,) numbers of the slots' materials
    slots: np.ndarray | None  # (P,); None: all faces have the first
    uvs: np.ndarray | None  # (C,2), where a material has an image
    attributes: np.ndarray | None = None  # (T,3,A), where a material's program asks for some
    flat: bool = False  # whether all faces are

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays of the engine's Geometry that describe triangles; "uvs" only if there are any."""
        triangles = self.corner_vertices[self.corners]
        if self.domain == 'POINT':
            normals = self.normals[triangles]
        elif self.domain == 'FACE':
            normals = np.broadcast_to(self._flat(triangles)[:, None], (len(triangles), 3, 3))
        else:
            normals = self.normals[self.corners]
        if self.slots is None:
            materials = np.full(len(triangles), self.materials[0], np.int32)
        else:
            # A slot that does not exist means the last one, as in Blender.
            materials = self.materials[np.clip(self.slots, 0, len(self.materials) - 1)][self.polygons]
        uvs = {} if self.uvs is None else {"uvs": self.uvs[self.corners]}
        if self.attributes is not None:
            uvs["attributes"] = self.attributes
        return {"vertices": self.vertices, "triangles": triangles, "corner_normals": normals,
                "triangle_materials": materials} | uvs

    def _flat(self, triangles: np.ndarray) -> np.ndarray:
        """Return the normals (T,3) of polygons; for a flat-shaded polygon that is not level those of its triangles, as
        in Cycles.
        """
        normals = self.normals[self.polygons]
        if not self.flat:
            return normals
        corners = self.vertices[triangles].astype(np.float64)
        own = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(own, axis=1, keepdims=True)
        np.divide(own, length, out=own, where=length > 0)
        bent = (length[:, 0] > 0) & (np.abs(own - normals).max(1) > 1e-4)
        return np.where(bent[:, None], own, normals).astype(np.float32)


class Reader:
    """Reads a mesh array by array. If `check` raises, the next `read` of the same mesh continues from there."""

    def __init__(self, check: Callable[[], None]) -> None:
        self._check = check
        self._parts: dict[str, np.ndarray] = {}

    def read(self, mesh, materials: tuple[int, ...], uv_layers: list | None, wanted: Mapping[Key, int]) -> Mesh:
        """Read `mesh`, which has triangles, and return a Mesh.

        materials: those of its slots. layers: the slots' layers of UVs (an entry None: all UVs are 0; None: no UVs are
        needed). wanted: the values that are needed at its corners.
        """
        attributes = mesh.attributes
        # Custom normals apply to corners, whatever domain they are stored on.
        domain = 'CORNER' if "custom_normal" in attributes else mesh.normals_domain
        slots = attributes.get("material_index") if len(materials) > 1 else None
        normals, n = {
            'POINT': (mesh.vertex_normals, len(mesh.vertices)), 'FACE': (mesh.polygon_normals, len(mesh.polygons)),
            'CORNER': (mesh.corner_normals, len(mesh.loops)),
        }[domain]
        np_, nt = len(mesh.polygons), len(mesh.loop_triangles)
        # There are several ways to get these numbers. Attributes are by far the fastest, because they are copied as a
        # whole.
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
            uvs=None if uv_layers is None else self._uvs(mesh, uv_layers, slots),
            flat=domain == 'FACE' and self._all_flat(mesh),
        )
        result.attributes = self._part("attributes", lambda: channels(
            mesh, wanted, result.arrays(), result.corners)) if wanted else None
        self._parts = {}
        return result

    def _all_flat(self, mesh) -> bool:
        sharp = mesh.attributes.get("sharp_face")
        return sharp is not None and bool(self._got("flat", sharp.data, "value", (len(mesh.polygons),), np.bool_).all())

    def _uvs(self, mesh, layers: list, slots: Any) -> np.ndarray:
        """Return UVs (C,2): each face's of the layer of its slot."""
        names = [layer.name if layer else "" for layer in layers]
        found = [self._got(f"uvs {name}", layers[names.index(name)].uv, "vector", (len(mesh.loops), 2)) if name
                 else np.zeros((len(mesh.loops), 2), np.float32) for name in dict.fromkeys(names)]
        if len(found) == 1 or slots is None:
            return found[0]
        size, slot = np.empty(len(mesh.polygons), np.int32), np.empty(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("loop_total", size)
        slots.data.foreach_get("value", slot)
        which = np.array([list(dict.fromkeys(names)).index(name) for name in names])
        return np.stack(found)[np.repeat(which[np.clip(slot, 0, len(which) - 1)], size), np.arange(len(mesh.loops))]

    def _got(self, part: str, collection, name: str, shape: tuple[int, ...], dtype=np.float32) -> np.ndarray:
        def get():
            flat = np.empty(math.prod(shape), dtype)
            collection.foreach_get(name, flat)
            return flat.reshape(shape)
        return self._part(part, get)

    def _part(self, part: str, get: Callable[[], Any]) -> Any:
        if part not in self._parts:
            self._parts[part] = get()
            self._check()  # a large mesh takes longer than an artist who pressed ESC wants to wait
        return self._parts[part]


def _corners(mesh) -> np.ndarray:
    """Return the corners of the triangles, shape (T,3)."""
    triangles = mesh.loop_triangles
    n = len(triangles)
    first = triangles[0].as_pointer()
    if triangles[n - 1].as_pointer() - first == 12 * (n - 1) and n > 1:
        # Three int32 for each triangle, in sequence. foreach_get would read them one by one, which takes 0.2 s for a
        # million and keeps the artist waiting.
        stored = np.ctypeslib.as_array((ctypes.c_int32 * (3 * n)).from_address(first)).reshape(n, 3).copy()
        if all(tuple(triangles[i].loops) == tuple(stored[i]) for i in (0, n // 2, n - 1)):
            return stored
    flat = np.empty(3 * n, np.int32)
    triangles.foreach_get("loops", flat)
    return flat.reshape(n, 3)
