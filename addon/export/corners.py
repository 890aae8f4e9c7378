"""Values at the corners of a mesh's triangles: attributes on any domain, and tangents of UV maps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .channels import Key, jenkins

_PROPERTY = {'FLOAT': ("value", 1), 'INT': ("value", 1), 'INT8': ("value", 1), 'BOOLEAN': ("value", 1),
             'FLOAT2': ("vector", 2), 'FLOAT_VECTOR': ("vector", 3), 'FLOAT_COLOR': ("color", 4),
             'BYTE_COLOR': ("color", 4)}


def channels(mesh: Any, wanted: Mapping[Key, int], arrays: dict[str, np.ndarray],
             corners: np.ndarray) -> np.ndarray | None:
    """Return the engine's attributes (T,3,A) of a mesh; None: nothing is wanted.

    arrays: its triangles and corner normals, as the engine has them; corners (T,3): of its triangles.
    """
    if not wanted:
        return None
    out = np.zeros((len(corners), 3, max(wanted.values()) + 1), np.float32)
    found: dict[tuple, np.ndarray] = {}
    for (kind, name, component), number in wanted.items():
        if (kind, name) not in found:
            found[kind, name] = (
                _tangents(mesh, name, arrays, corners) if kind == "tangent" else
                _numbers(mesh, _OF_VERTICES[kind](mesh), corners) if kind in _OF_VERTICES else
                _attribute(mesh, kind, name, corners))
        out[:, :, number] = found[kind, name][:, :, component]
    return out


def _attribute(mesh: Any, kind: str, name: str, corners: np.ndarray) -> np.ndarray:
    """Return (T,3,5): colour or vector, alpha, and the number that stands for all, as Cycles takes it; 0 without it."""
    out = np.zeros((len(corners), 3, 5), np.float32)
    if kind == "color" and not name:
        place = mesh.color_attributes.render_color_index
        attribute = mesh.color_attributes[place] if 0 <= place < len(mesh.color_attributes) else None
    else:
        if kind == "uv":
            name = next((a.name for a in mesh.uv_layers if a.active_render), "")
        attribute = mesh.attributes.get(name)
    if attribute is None or attribute.data_type not in _PROPERTY:
        out[:, :, 3] = kind != "color"  # as Cycles
        return out
    out[:, :, 3] = 1
    prop, width = _PROPERTY[attribute.data_type]
    stored: dict[str, type] = {'INT': np.int32, 'INT8': np.int32, 'BOOLEAN': np.bool_}
    flat: np.ndarray = np.empty(len(attribute.data) * width, stored.get(attribute.data_type, np.float32))
    attribute.data.foreach_get(prop, flat)
    values = _at_corners(mesh, attribute.domain, flat.astype(np.float32).reshape(-1, width), corners)
    if width == 1:
        out[:, :, :3] = out[:, :, 4:] = values
    elif width == 2:
        out[:, :, :2], out[:, :, 4] = values, values[:, :, 0]
    else:
        out[:, :, :width], out[:, :, 4] = values, values[:, :, :3].mean(2)
    return out


def _numbers(mesh: Any, values: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return a number for each vertex (V,), as attributes (T,3,5) have them."""
    return np.repeat(_at_corners(mesh, 'POINT', values.astype(np.float32)[:, None], corners), 5, axis=2)


def _edges(mesh: Any) -> np.ndarray:
    """Return the vertices (E,2) of edges."""
    edges = np.empty(2 * len(mesh.edges), np.int32)
    mesh.edges.foreach_get("vertices", edges)
    return edges.reshape(-1, 2)


def _pointiness(mesh: Any) -> np.ndarray:
    """Return (V,) the angle between the normal and the mean way to neighbours, over pi, and the mean of that over
    neighbours; vertices at one place count as one.
    """
    place = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", place.ravel())
    _, first, one = np.unique(place, axis=0, return_index=True, return_inverse=True)
    one, count = one.ravel(), len(first)
    edges = np.unique(np.sort(one[_edges(mesh)], axis=1), axis=0)
    edges = edges[edges[:, 0] != edges[:, 1]]

    def sums(values: np.ndarray, to: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(to, column, count) for column in values.T.astype(np.float64)], axis=1)

    own = np.empty((len(place), 3), np.float32)
    mesh.vertex_normals.foreach_get("vector", own.ravel())
    normal, at = _unit(sums(own, one)), place[first].astype(np.float64)
    way = _unit(at[edges[:, 1]] - at[edges[:, 0]])
    number = np.maximum(np.bincount(edges.ravel(), minlength=count), 1)
    mean = (sums(way, edges[:, 0]) - sums(way, edges[:, 1])) / number[:, None]
    angle = np.arccos(np.clip((normal * mean).sum(1), -1, 1)) / np.pi
    angle[np.bincount(edges.ravel(), minlength=count) == 0] = 0
    around = sum(np.bincount(edges[:, k], angle[edges[:, 1 - k]], count) for k in (0, 1))
    return ((angle + around) / (np.bincount(edges.ravel(), minlength=count) + 1))[one]


def _islands(mesh: Any) -> np.ndarray:
    """Return a random number (V,) for each connected part of the mesh, found in the same way as in Cycles."""
    parent, rank = list(range(len(mesh.vertices))), [0] * len(mesh.vertices)

    def root(x: int) -> int:
        while parent[x] != x:
            parent[x] = x = parent[parent[x]]
        return x

    for a, b in _edges(mesh).tolist():
        a, b = root(a), root(b)
        if a != b:
            if rank[a] < rank[b]:
                a, b = b, a
            parent[b] = a
            rank[a] += rank[a] == rank[b]
    roots = np.array([root(x) for x in range(len(parent))], np.int64)
    found, one = np.unique(roots, return_inverse=True)
    return np.array([jenkins(int(x)) / 0xFFFFFFFF for x in found])[one.ravel()]


# What Cycles works out for each vertex of a mesh.
_OF_VERTICES = {"Pointiness": _pointiness, "Random Per Island": _islands}


def _at_corners(mesh: Any, domain: str, values: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return values (n,k) of a domain at the corners of triangles (T,3,k)."""
    if domain == 'CORNER':
        return values[corners]
    if domain == 'FACE':
        polygon = np.empty(len(corners), np.int32)
        mesh.loop_triangle_polygons.foreach_get("value", polygon)
        return np.broadcast_to(values[polygon][:, None], (len(corners), 3, values.shape[1]))
    if domain == 'EDGE':  # the mean of a vertex's edges, as Cycles
        edges = _edges(mesh).ravel()
        total = np.zeros((len(mesh.vertices), values.shape[1]))
        np.add.at(total, edges, np.repeat(values, 2, axis=0))
        values = (total / np.maximum(np.bincount(edges, minlength=len(total)), 1)[:, None]).astype(np.float32)
    vertex = np.empty(len(mesh.loops), np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", vertex)
    return values[vertex[corners]]


def _tangents(mesh: Any, name: str, arrays: dict[str, np.ndarray], corners: np.ndarray) -> np.ndarray:
    """Return (T,3,4): tangents and their signs, of a UV map (empty: that for renders), as MikkTSpace has them for
    triangles.

    The tangent of a corner is the mean of those of all triangles that share its place, normal and UV and are not
    mirrored in the map, by their angles there (Mikkelsen, "Simulation of wrinkled surfaces revisited", 2008).
    """
    layers = mesh.uv_layers
    layer = layers.get(name) if name else next((a for a in layers if a.active_render), None)
    out = np.zeros((len(corners), 3, 4), np.float32)
    if layer is None:  # a sign of 0 says so
        return out
    uv = np.empty((len(mesh.loops), 2), np.float32)
    layer.uv.foreach_get("vector", uv.ravel())
    uv = uv[corners]
    place, normal = arrays["vertices"][arrays["triangles"]].astype(np.float64), arrays["corner_normals"]
    e, f = place[:, 1] - place[:, 0], place[:, 2] - place[:, 0]
    a, b = (uv[:, 1] - uv[:, 0]).astype(np.float64), (uv[:, 2] - uv[:, 0]).astype(np.float64)
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    along = (b[:, 1:] * e - a[:, 1:] * f) * np.where(area < 0, -1.0, 1.0)[:, None]
    n = normal.astype(np.float64)
    tangent = _unit(_flat(np.broadcast_to(along[:, None], n.shape), n))
    sides = [_unit(_flat(np.roll(place, -k, axis=1) - place, n)) for k in (1, 2)]
    angle = np.arccos(np.clip((sides[0] * sides[1]).sum(2), -1, 1)) * (area != 0)[:, None]
    key = np.concatenate([place.astype(np.float32), normal, uv, np.broadcast_to(
        np.sign(area)[:, None, None], (len(uv), 3, 1)).astype(np.float32)], axis=2).reshape(-1, 9) + np.float32(0)
    _, group = np.unique(np.ascontiguousarray(key).view(f"V{4 * 9}").ravel(), return_inverse=True)
    total = np.stack([np.bincount(group, (tangent[..., k] * angle).ravel()) for k in range(3)], axis=1)
    total = _unit(total)
    total[~total.any(1)] = (1, 0, 0)
    out[:, :, :3] = total[group].reshape(-1, 3, 3)
    out[:, :, 3] = np.where(area > 0, 1, -1)[:, None]
    return out


def _flat(a: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return vectors without their components along the normals."""
    return a - normal * (a * normal).sum(-1, keepdims=True)


def _unit(a: np.ndarray) -> np.ndarray:
    return a / np.maximum(np.linalg.norm(a, axis=-1, keepdims=True), 1e-30)
