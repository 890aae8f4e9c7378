"""Evaluated meshes and their instances → arrays."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .linking import identity
from .materials import Materials
from .report import Report

# What a picture should show and the engine cannot.
_NOT_TRANSLATED = {
    'CURVES': "hair curves", 'POINTCLOUD': "point clouds", 'VOLUME': "volumes",
}


@dataclass
class _Mesh:
    """Arrays of one mesh; the names are those of the engine's Geometry."""

    vertices: np.ndarray
    triangles: np.ndarray
    corner_normals: np.ndarray
    triangle_materials: np.ndarray
    uvs: np.ndarray | None


class Geometry:
    """Collects instances; every mesh once, however many instances it has."""

    def __init__(self, materials: Materials, report: Report, check: Callable[[], None], view_layer) -> None:
        self.objects: list[dict] = []
        self.owners: list[tuple[int, int]] = []  # of each object, as `linking` wants them
        self._materials, self._report, self._check = materials, report, check
        self._view_layer = view_layer
        self._meshes: list[_Mesh] = []
        self._mesh_of: dict[tuple, int | None] = {}  # None: nothing to see
        self._mesh_of_object: dict[tuple, int | None] = {}
        self._object_of: dict[tuple, int] = {}
        self._instance_mesh: list[int] = []
        self._instance_object: list[int] = []
        self._instance_matrix: list[tuple] = []

    def add(self, instance, ob) -> None:
        """Add an entry of depsgraph.object_instances; `ob` is its object."""
        data = ob.data
        # The triangles of a curve, a surface, a text or metaballs come as an entry of their own, of type MESH.
        if ob.type != 'MESH':
            if ob.type in _NOT_TRANSLATED:
                self._report.warn(f"Object '{ob.name}': {_NOT_TRANSLATED[ob.type]} are not translated; it is not seen")
            return
        # Blender lends the same temporary object for all instances: what tells them apart
        # is the object that they were made of, and the data.
        source = (instance.instance_object or ob) if instance.is_instance else ob
        key = (source.as_pointer(), data.as_pointer())
        if key not in self._mesh_of_object:
            self._mesh_of_object[key] = self._mesh(ob, data)
        mesh = self._mesh_of_object[key]
        if mesh is None:
            return
        parent = instance.parent
        key = (source.as_pointer(), parent.as_pointer() if parent else 0)
        if key not in self._object_of:
            self._object_of[key] = self._object(ob, parent)
            self.owners.append((identity(source), identity(parent) if parent else 0))
        m = instance.matrix_world
        self._instance_mesh.append(mesh)
        self._instance_object.append(self._object_of[key])
        self._instance_matrix.append((*m[0], *m[1], *m[2], *m[3]))

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays of the engine's Geometry."""
        meshes = self._meshes
        counts = np.array([(len(m.vertices), len(m.triangles)) for m in meshes], np.int64).reshape(-1, 2)
        starts = np.cumsum(counts, axis=0) - counts
        uvs = []
        if self._materials.images or self._materials.every_uv:
            uvs = [np.zeros((len(m.triangles), 3, 2), np.float32) if m.uvs is None else m.uvs for m in meshes]
        return {
            "vertices": _joined([m.vertices for m in meshes], (3,), np.float32),
            "triangles": _joined([m.triangles for m in meshes], (3,), np.int32),
            "corner_normals": _joined([m.corner_normals for m in meshes], (3, 3), np.float32),
            "uvs": _joined(uvs, (3, 2), np.float32),
            "triangle_materials": _joined([m.triangle_materials for m in meshes], (), np.int32),
            "meshes": np.stack([starts[:, 0], counts[:, 0], starts[:, 1], counts[:, 1]], axis=1),
            "instance_mesh": np.array(self._instance_mesh, np.int32),
            "instance_object": np.array(self._instance_object, np.int32),
            "instance_matrix": np.array(self._instance_matrix, np.float64).reshape(-1, 4, 4),
        }

    def _object(self, ob, parent) -> int:
        """Number of a new entry of `objects`: what is seen of `ob`, and of its instancer if it has one."""
        seen = [ob] if parent is None or parent == ob else [ob, parent]
        # Collections are holdouts, or for indirect light only, in a view layer; as in Cycles a hole shows either way.
        holdout = any(o.is_holdout or o.holdout_get(view_layer=self._view_layer) for o in seen)
        hidden = not holdout and any(o.indirect_only_get(view_layer=self._view_layer) for o in seen)
        self.objects.append({
            "name": ob.name,
            "visible_camera": all(o.visible_camera for o in seen) and not hidden,
            "visible_reflection": all(o.visible_glossy for o in seen),
            "visible_shadow": all(o.visible_shadow for o in seen),
            "holdout": holdout,
            "shadow_catcher": any(o.is_shadow_catcher for o in seen),
            "index": ob.pass_index,
            "cast_soft_shadows": all(o.light_meshes.cast_soft_shadows for o in seen),
            "receive_soft_shadows": all(o.light_meshes.receive_soft_shadows for o in seen),
        })
        return len(self.objects) - 1

    def _mesh(self, ob, data) -> int | None:
        """Number of the mesh of `ob`, new or shared; None if it has no triangle."""
        if any(p.settings.type == 'HAIR' and p.settings.render_type == 'PATH' for p in ob.particle_systems):
            self._report.warn(f"Object '{ob.name}': hair is not translated; it is not seen")
        materials = tuple(self._materials.index(slot.material) for slot in ob.material_slots)
        key = (data.as_pointer(), materials)
        if key not in self._mesh_of:
            self._mesh_of[key] = None
            mesh = ob.to_mesh()
            try:
                if mesh is not None:
                    mesh.calc_loop_triangles()
                    if len(mesh.loop_triangles):
                        self._mesh_of[key] = len(self._meshes)
                        self._meshes.append(self._extract(ob, mesh, materials))
            finally:
                ob.to_mesh_clear()
        return self._mesh_of[key]

    def _extract(self, ob, mesh, materials: tuple[int, ...]) -> _Mesh:
        nt = len(mesh.loop_triangles)
        vertices = self._got(mesh.vertices, "co", (len(mesh.vertices), 3), np.float32)
        triangles = self._got(mesh.loop_triangles, "vertices", (nt, 3), np.int32)
        loops = self._got(mesh.loop_triangles, "loops", (nt, 3), np.int32)
        normals = self._got(mesh.corner_normals, "vector", (len(mesh.loops), 3), np.float32)
        materials = materials or (self._materials.index(None),)
        if len(materials) == 1:
            triangle_materials = np.full(nt, materials[0], np.int32)
        else:
            slots = self._got(mesh.polygons, "material_index", (len(mesh.polygons),), np.int32)
            polygons = self._got(mesh.loop_triangle_polygons, "value", (nt,), np.int32)
            # A slot that does not exist means the last one, as in Blender.
            triangle_materials = np.array(materials, np.int32)[np.clip(slots, 0, len(materials) - 1)][polygons]
        return _Mesh(vertices, triangles, normals[loops], triangle_materials, self._uvs(ob, mesh, materials, loops))

    def _uvs(self, ob, mesh, materials: tuple[int, ...], loops: np.ndarray) -> np.ndarray | None:
        """(T,3,2) where a material has an image, or the UV pass is asked for."""
        name = self._materials.uv_map(materials)
        if name is None and not self._materials.every_uv:
            return None
        layers = mesh.uv_layers
        layer = layers.get(name) if name else next((a for a in layers if a.active_render), None)
        if layer is None and name is None:
            return None
        if layer is None:
            wanted = f"no UV map '{name}'" if name else "no UV map"
            self._report.warn(f"Object '{ob.name}' has {wanted}; its image texture shows a single point of the image")
            return np.zeros((len(loops), 3, 2), np.float32)
        return self._got(layer.uv, "vector", (len(mesh.loops), 2), np.float32)[loops]

    def _got(self, collection, name: str, shape: tuple[int, ...], dtype) -> np.ndarray:
        self._check()  # a large mesh takes longer than an artist who pressed ESC wants to wait
        flat = np.empty(math.prod(shape), dtype)
        collection.foreach_get(name, flat)
        return flat.reshape(shape)


def _joined(parts: list[np.ndarray], tail: tuple[int, ...], dtype) -> np.ndarray:
    return np.concatenate([np.empty((0, *tail), dtype), *parts])
