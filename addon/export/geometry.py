"""Convert evaluated meshes and their instances to arrays."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from . import left_out
from .channels import instance_value
from .linking import Links, identity
from .materials import Materials
from .mesh import Mesh, Reader
from .report import Report

# Object types that a picture should show and the engine cannot.
_NOT_TRANSLATED = {
    'CURVES': "hair curves", 'POINTCLOUD': "point clouds", 'VOLUME': "volumes",
}


class MeshStore(Protocol):
    """Takes the meshes of a Geometry: `Meshes` of one snapshot, or `Blocks` that successive ones share."""

    def get(self, key: tuple, owners: set[int], read: Callable[[], Mesh | None]) -> Any:
        """Return an object that stands for the mesh that `read` returns, or None if there is nothing to see."""


class Geometry:
    """Collects instances. Each mesh is stored once, however many instances it has."""

    def __init__(self, materials: Materials, report: Report, check: Callable[[], None], view_layer,
                 meshes: MeshStore | None = None) -> None:
        self.objects: list[dict] = []
        self.owners: list[tuple[int, int]] = []  # of each object, in the form that `linking` needs
        self.links = Links()
        self.meshes: MeshStore = meshes or Meshes()
        self._materials, self._report, self._view_layer = materials, report, view_layer
        self._reader = Reader(check)
        self._mesh_of: dict[tuple, Any] = {}  # the result of `meshes` for each key; None if there is nothing to see
        self._mesh_of_object: dict[tuple, Any] = {}
        self._asked_of: dict[int, dict] = {}  # by a mesh's id: the channels of instances that its materials ask for
        self._object_of: dict[tuple, int] = {}
        self._instance_mesh: list = []
        self._instance_object = array("i")
        self._instance_matrix = array("d")
        self._instance_values: list[dict[int, float]] = []  # of each instance, by channel

    def add(self, instance, ob) -> None:
        """Add an entry of depsgraph.object_instances; `ob` is its object."""
        data = ob.data
        # The triangles of a curve, a surface, a text or metaballs come as a separate entry of type MESH.
        if ob.type != 'MESH':
            if ob.type in _NOT_TRANSLATED:
                self._report.warn(f"{_NOT_TRANSLATED[ob.type]} are not translated; it is not seen", "Object", ob.name)
            return
        # Blender reuses one temporary object for all instances. Instances are told apart by the object that they were
        # made from, and by the data.
        source = (instance.instance_object or ob) if instance.is_instance else ob
        key = (source.as_pointer(), data.as_pointer())
        if key not in self._mesh_of_object:
            self._mesh_of_object[key] = self._mesh(ob, data, source, instance.parent)
        mesh = self._mesh_of_object[key]
        if mesh is None:
            return
        parent = instance.parent
        key = (source.as_pointer(), parent.as_pointer() if parent else 0)
        if key not in self._object_of:
            self._object_of[key] = self._object(ob, parent)
            self.owners.append((identity(source), identity(parent) if parent else 0))
            self.links.add_object(source, parent)
        m = instance.matrix_world
        self._instance_mesh.append(mesh)
        self._instance_object.append(self._object_of[key])
        self._instance_matrix.extend((*m[0], *m[1], *m[2], *m[3]))
        self._instance_values.append({number: instance_value(key, instance, ob, source, self._materials.depsgraph)
                                      for key, number in self._asked_of[id(mesh)].items()})

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays of the engine's Geometry."""
        assert isinstance(self.meshes, Meshes)
        found, textured = self.meshes.found, self._materials.textured or self._materials.every_uv
        return joined([mesh.arrays() for mesh in found], textured) | self.instances({
            id(mesh): i for i, mesh in enumerate(found)})

    def instances(self, numbers: dict[int, int]) -> dict[str, np.ndarray]:
        """Return the arrays that place the meshes; `numbers` holds each mesh's number by its id."""
        return {
            "instance_mesh": np.array([numbers[id(mesh)] for mesh in self._instance_mesh], np.int32),
            "instance_object": np.array(self._instance_object, np.int32),
            "instance_matrix": np.array(self._instance_matrix, np.float64).reshape(-1, 4, 4),
            "instance_values": self._values(),
        }

    def _values(self) -> np.ndarray:
        """Return the engine's instance_values: 0 where a material of the instance does not ask."""
        count = max((number + 1 for values in self._instance_values for number in values), default=0)
        out = np.zeros((len(self._instance_values), count), np.float32)
        for row, values in zip(out, self._instance_values, strict=True):
            row[list(values)] = list(values.values())
        return out

    def _object(self, ob, parent) -> int:
        """Add an entry to `objects` for what is visible of `ob` (and of its instancer, if it has one); return its
        number.
        """
        seen = [ob] if parent is None or parent == ob else [ob, parent]
        # In a view layer a collection may be a holdout, or for indirect light only. As in Cycles, a hole is visible in
        # both cases.
        left_out.rays(ob, self._report)
        holdout = any(o.is_holdout or o.holdout_get(view_layer=self._view_layer) for o in seen)
        hidden = not holdout and any(o.indirect_only_get(view_layer=self._view_layer) for o in seen)
        self.objects.append({
            "name": ob.name,
            "visible_camera": all(o.visible_camera for o in seen) and not hidden,
            "visible_reflection": all(o.visible_glossy for o in seen),
            "visible_shadow": all(o.visible_shadow for o in seen),
            "visible_diffuse": all(o.visible_diffuse for o in seen),
            "holdout": holdout,
            "shadow_catcher": any(o.is_shadow_catcher for o in seen),
            "index": ob.pass_index,
            "cast_soft_shadows": all(o.light_meshes.cast_soft_shadows for o in seen),
            "receive_soft_shadows": all(o.light_meshes.receive_soft_shadows for o in seen),
        } | _terminator(ob) | _texture_space(ob.data))
        return len(self.objects) - 1

    def _mesh(self, ob, data, source, parent) -> Any:
        """Return the mesh of `ob`, which may be shared; None if it has no triangles."""
        if any(p.settings.type == 'HAIR' and p.settings.render_type == 'PATH' for p in ob.particle_systems):
            self._report.warn("hair is not translated; it is not seen", "Object", ob.name)
        materials = tuple(self._materials.index(slot.material) for slot in ob.material_slots)
        materials = materials or (self._materials.index(None),)
        if all(self._materials.is_nothing(i) for i in materials):
            return None
        wanted = self._materials.corners(materials)
        key = (data.as_pointer(), materials, self._materials.uv_maps(materials), tuple(wanted.values()))
        if key not in self._mesh_of:
            # Data that geometry nodes made exists as long as the evaluated data of the instancer.
            owners = {source, data} if parent is None or source.data == data else {source, data, parent}
            self._mesh_of[key] = self.meshes.get(
                (source.original.session_uid, *key), {o.original.session_uid for o in owners},
                lambda: self._read(ob, materials, wanted))
            if self._mesh_of[key] is not None:
                self._asked_of[id(self._mesh_of[key])] = self._materials.instances(materials)
        return self._mesh_of[key]

    def _read(self, ob, materials: tuple[int, ...], wanted: dict) -> Mesh | None:
        mesh = ob.to_mesh()
        try:
            if mesh is None:
                return None
            mesh.calc_loop_triangles()
            if not len(mesh.loop_triangles):
                return None
            return self._reader.read(mesh, materials, self._uvs(ob, mesh, materials), wanted)
        finally:
            ob.to_mesh_clear()

    def _uvs(self, ob, mesh, materials: tuple[int, ...]) -> list | None:
        """Return the layer of UVs that each of the slots' `materials` asks for, or None in its place if the mesh has no
        such layer; return None if neither a material nor the UV pass asks for UVs.
        """
        names = self._materials.uv_maps(materials)
        layers = mesh.uv_layers
        if all(name is None for name in names) and not (self._materials.every_uv and len(layers)):
            return None
        asked = next((name for name in names if name is not None), "")  # of slots without images, for the UV pass
        found = []
        for name in dict.fromkeys(names):
            wanted = asked if name is None else name
            layer = layers.get(wanted) if wanted else next((a for a in layers if a.active_render), None)
            found.append(layer)
            if layer is None and name is not None:
                what = f"no UV map '{name}'" if name else "no UV map"
                self._report.warn(f"it has {what}; its image texture shows a single point of the image", "Object",
                                  ob.name)
        by_name = dict(zip(dict.fromkeys(names), found, strict=True))
        return [by_name[name] for name in names]


def _terminator(ob) -> dict[str, float]:
    """Return Blender's offsets at the shadow terminator, which belong to the object. Before 4.3 they belonged to
    Cycles, and there was one less.
    """
    names = [f"shadow_terminator_{what}_offset" for what in ("geometry", "normal", "shading")]
    if hasattr(ob, names[0]):
        return {name: getattr(ob, name) for name in names}
    cycles = getattr(ob, "cycles", None)  # it belongs to another add-on, which may be switched off
    return {"shadow_terminator_geometry_offset": getattr(cycles, "shadow_terminator_geometry_offset", 0.1),
            "shadow_terminator_shading_offset": getattr(cycles, "shadow_terminator_offset", 0.0)}


def _texture_space(mesh) -> dict[str, list[float]]:
    """Return the box of a mesh over which Generated coordinates go from 0 to 1, where it is not the engine's default.
    """
    place, size = list(mesh.texspace_location), list(mesh.texspace_size)
    if place == [0.0] * 3 and size == [1.0] * 3:
        return {}
    return {"texture_location": place, "texture_size": size}


class Meshes:
    """The meshes of a snapshot, each once, in the order in which they were found."""

    def __init__(self) -> None:
        self.found: list[Mesh] = []

    def get(self, key: tuple, owners: set[int], read: Callable[[], Mesh | None]) -> Any:
        """Return the result of `read`. `key` and `owners` (session numbers of data blocks) are used by subclasses that
        keep meshes.
        """
        mesh = read()
        if mesh is not None:
            self.found.append(mesh)
        return mesh


def joined(meshes: list[dict[str, np.ndarray]], textured: bool) -> dict[str, np.ndarray]:
    """Join the triangle arrays of several meshes into one set, with UVs if they are `textured`, and attributes."""
    counts = np.array([(len(m["vertices"]), len(m["triangles"])) for m in meshes], np.int64).reshape(-1, 2)
    starts = np.cumsum(counts, axis=0) - counts
    uvs = []
    if textured:
        uvs = [m["uvs"] if "uvs" in m else np.zeros((len(m["triangles"]), 3, 2), np.float32) for m in meshes]
    channels = max((m["attributes"].shape[2] for m in meshes if "attributes" in m), default=0)
    attributes = [np.zeros((len(m["triangles"]), 3, channels), np.float32) for m in meshes] if channels else []
    for m, out in zip(meshes, attributes, strict=False):
        if "attributes" in m:
            out[:, :, :m["attributes"].shape[2]] = m["attributes"]
    return {
        "attributes": _joined(attributes, (3, channels), np.float32),
        "vertices": _joined([m["vertices"] for m in meshes], (3,), np.float32),
        "triangles": _joined([m["triangles"] for m in meshes], (3,), np.int32),
        "corner_normals": _joined([m["corner_normals"] for m in meshes], (3, 3), np.float32),
        "uvs": _joined(uvs, (3, 2), np.float32),
        "triangle_materials": _joined([m["triangle_materials"] for m in meshes], (), np.int32),
        "meshes": np.stack([starts[:, 0], counts[:, 0], starts[:, 1], counts[:, 1]], axis=1),
    }


def _joined(parts: list[np.ndarray], tail: tuple[int, ...], dtype) -> np.ndarray:
    return np.concatenate([np.empty((0, *tail), dtype), *parts])
