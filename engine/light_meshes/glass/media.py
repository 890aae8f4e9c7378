"""Semitransparent surfaces for the solver of refracted paths: solids, patches, and rays in float64.

Embree's hits are float32, which is not precise enough for Newton's method and for surfaces that touch. So the
semitransparent triangles are also kept in a small tree of boxes whose rays are float64. Opaque triangles are left to
Embree. Coordinates are those of the tracer's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.boxes import box_tree
from ..rays.geometry import Surfaces
from ..support.native import kernel, needs_memory
from .bodies import FLAT, bodies

_adjacent, _components = kernel("media_adjacent"), kernel("media_components")
_smooth_edges = kernel("media_smooth_edges")

CREASE = 5e-4  # radians: a patch ends at an edge across which normals differ by more


class Media(NamedTuple):
    """What light does at each triangle of `Surfaces`; each array is (T,)."""

    # light passes and is multiplied by t; all other triangles are opaque, and the solver ignores them
    transparent: NDArray[np.bool_]
    solid: NDArray[np.bool_]  # it bounds a body of index `ior`: it is part of a closed mesh; False for a sheet
    ior: NDArray[np.float64]
    t: NDArray[np.float64]  # (T,3) k_t, RGB
    priority: NDArray[np.int32]  # where bodies overlap, the one with the highest priority is the medium, see `bodies`


class Glass(NamedTuple):
    """The semitransparent triangles in the order of their tree ("slots"), and the bodies that they bound."""

    triangle: NDArray[np.int32]  # (M,) of Surfaces
    # (M,30) see media.h: a vertex, two edges from it and their duals, the unit normal out of the body, three corner
    # normals, t
    place: NDArray[np.float64]
    # (M,7) body (−1: a sheet), instance, patch (triangles joined by edges without a crease; −1: a sheet), whether the
    # normal is NG, slots across AB, BC, CA in the patch (−1: none)
    link: NDArray[np.int64]
    planar: NDArray[np.int64]  # (patches,) a slot in whose plane the patch lies, −1 if it is curved
    patch_size: NDArray[np.float64]  # (patches,) radius
    ior: NDArray[np.float64]  # (bodies,)
    rank: NDArray[np.int64]  # (bodies,) of the bodies around a point, the one with the highest rank is the medium
    ball: NDArray[np.float64]  # (bodies,4) centre and radius
    box: NDArray[np.float64]  # (nodes,6) low, high
    # (nodes,2) first of two children and 0, or first slot of a leaf and the number of its slots
    child: NDArray[np.int64]


def closed(surfaces: Surfaces, among: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark (T,) the triangles of closed meshes; only these have an IOR (method §3).

    A mesh is a set of triangles joined by edges; vertices at the same place count as one. It is closed if each edge
    belongs to two triangles that run along it in opposite directions. Only instances with a triangle in `among` are
    examined.
    """
    out = np.zeros(len(among), np.bool_)
    index = np.flatnonzero(np.isin(surfaces.instance, np.unique(surfaces.instance[among])))
    if len(index):
        corner = _merged(surfaces, index)
        neighbour = np.empty((len(index), 3), np.int32)
        label = np.empty(len(index), np.int32)
        _adjacent(corner, _edge_order(corner), neighbour)
        needs_memory(_components(neighbour, np.ones_like(neighbour, np.bool_), label))
        open_edges = np.bincount(label, weights=(neighbour < 0).any(1))
        out[index] = open_edges[label] == 0
    return out


def _merged(surfaces: Surfaces, index: NDArray[np.intp]) -> NDArray[np.int64]:
    """Return vertex numbers (n,3) of triangles, which are equal if instance and position are equal."""
    used, flat = np.unique(surfaces.triangles[index], return_inverse=True)
    owner = np.empty(len(used), np.int32)
    owner[flat.reshape(-1)] = np.repeat(surfaces.instance[index], 3)
    position = surfaces.vertices[used] + np.float32(0)  # −0 and 0 are the same place
    order = np.lexsort((position[:, 0], position[:, 1], position[:, 2], owner))
    p, o = position[order], owner[order]
    new = np.r_[False, (p[1:] != p[:-1]).any(1) | (o[1:] != o[:-1])]
    number = np.empty(len(used), np.int64)
    number[order] = np.cumsum(new)
    return number[flat.reshape(-1, 3)]


def _edge_order(corner: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return the order of the 3n edges (3·triangle + k: from corner k to k+1) in which equal edges are adjacent."""
    a, b = corner.reshape(-1), np.roll(corner, -1, axis=1).reshape(-1)
    return np.argsort(np.minimum(a, b) * (corner.max(initial=0) + 1) + np.maximum(a, b), kind="stable")


def glass(surfaces: Surfaces, media: Media) -> Glass:
    """Return the semitransparent triangles, ready for `closest` in media.h."""
    index = np.flatnonzero(media.transparent)
    solid = media.solid[index]
    corners = surfaces.vertices[surfaces.triangles[index]].astype(np.float64)
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    owner = surfaces.instance[index]
    sign = np.where(surfaces.mirrored[owner], -1.0, 1.0)[:, None]
    normal = np.cross(ab, ac) * sign
    Ng, Ns, flat = _unit_normals(surfaces, index, normal)

    found = bodies(surfaces, media.solid & media.transparent, media.ior, media.priority)
    body = found.of[index]
    if len(found.rank):
        inside_out = solid & found.inside_out[body]
        Ng[inside_out] *= -1
        Ns[inside_out] *= -1
    label, patches, neighbour = _patches(surfaces, index, body, solid, Ns)

    order, box, child = box_tree(np.concatenate([corners.min(1), corners.max(1)], 1))
    back = np.empty(len(order), np.int32)
    back[order] = np.arange(len(order))
    planar = np.full(patches, -1, np.int64)
    planar[label[solid]] = back[solid]
    planar[label[solid & ~flat]] = -1
    square = (normal**2).sum(1, keepdims=True)
    u, v = np.cross(ac, sign * normal) / square, np.cross(sign * normal, ab) / square
    link = np.concatenate([np.stack([body, owner, label, flat], 1), np.where(neighbour >= 0, back[neighbour], -1)], 1)
    place = np.concatenate([corners[:, 0], ab, ac, u, v, Ng, Ns.reshape(-1, 9), media.t[index]], 1)
    return Glass(
        index[order].astype(np.int32), np.ascontiguousarray(place[order], np.float64),
        np.ascontiguousarray(link[order], np.int64), planar, _radii(corners[solid], label[solid], patches), found.ior,
        found.rank, _balls(corners[solid], body[solid], len(found.rank)), box, child,
    )


def _unit_normals(surfaces: Surfaces, index: NDArray[np.intp], normal: NDArray[np.float64],
                  ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return NG (n,3), NS at the corners (n,3,3), and whether the triangle is flat (n,); then NS is NG."""
    Ng = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    Ns = np.einsum("nij,nkj->nki", surfaces.normal_matrix[surfaces.instance[index]],
                   surfaces.at_corners(surfaces.corner_normals, index))
    # The lengths are kept, as in `geometry.surface`, except for one common factor.
    length = np.linalg.norm(Ns, axis=2)
    usable = ((length > 0) & np.isfinite(length)).all(1)
    Ns = np.where(usable[:, None, None], Ns / np.where(usable, length.max(1, initial=0), 1)[:, None, None],
                  Ng[:, None])
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.einsum("nkj,nj->nk", Ns, Ng) / np.linalg.norm(Ns, axis=2)
        sine = np.linalg.norm(np.cross(Ns, Ng[:, None]), axis=2) / np.linalg.norm(Ns, axis=2)
    flat = ~((sine > FLAT) | (cosine < 0)).any(1)
    Ns[flat] = Ng[flat][:, None]
    return Ng, Ns, flat


def _patches(surfaces: Surfaces, index: NDArray[np.intp], body: NDArray[np.int32], solid: NDArray[np.bool_],
             Ns: NDArray[np.float64]) -> tuple[NDArray[np.int32], int, NDArray[np.int32]]:
    """Return the patch of each triangle (n,), −1 for a sheet; the number of patches; and the neighbours across its
    edges in the patch (n,3).
    """
    corner = _merged(surfaces, index) if len(index) else np.zeros((0, 3), np.int64)
    neighbour = np.empty((len(index), 3), np.int32)
    joined = np.zeros((len(index), 3), np.bool_)
    label = np.empty(len(index), np.int32)
    _adjacent(corner, _edge_order(corner), neighbour)
    _smooth_edges(corner, neighbour, np.ascontiguousarray(Ns), np.cos(CREASE), joined)
    joined &= (body[:, None] == body[neighbour]) & solid[:, None]
    needs_memory(_components(neighbour, joined, label))
    names, patch = np.unique(label[solid], return_inverse=True)
    label[:] = -1
    label[solid] = patch
    neighbour[~joined] = -1
    return label, len(names), neighbour


def _balls(corners: NDArray[np.float64], body: NDArray[np.integer], size: int) -> NDArray[np.float64]:
    """Return centre and radius (size,4) of a ball around each body, from the corners (n,3,3) of its triangles."""
    middle, radius = np.zeros((size, 3)), np.zeros(size)
    for j in range(3):
        middle[:, j] = np.bincount(body, corners[:, 0, j], size)
    middle /= np.maximum(np.bincount(body, None, size), 1)[:, None]
    if size:
        np.maximum.at(radius, body, np.linalg.norm(corners - middle[body][:, None], axis=2).max(1))
    return np.concatenate([middle, radius[:, None]], 1)


def _radii(corners: NDArray[np.float64], patch: NDArray[np.integer], size: int) -> NDArray[np.float64]:
    """Return half the diagonal (size,) of each patch's box."""
    lower, upper = np.full((size, 3), np.inf), np.full((size, 3), -np.inf)
    np.minimum.at(lower, patch, corners.min(1))
    np.maximum.at(upper, patch, corners.max(1))
    return np.linalg.norm(upper - lower, axis=1) / 2
