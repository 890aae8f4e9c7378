"""All instances as one list of triangles in the tracer's frame, and the surface at a hit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Camera, Scene
from ..scene.errors import SceneError
from ..support.native import kernel
from ..support.rows import taken, where
from .frame import FAR, Frame, cut, frame, too_large
from .slivers import sliver_warnings

_place, _usable, _surface = kernel("geometry_place"), kernel("geometry_usable"), kernel("geometry_surface")


class Surfaces(NamedTuple):
    """The geometry in the form that the kernels need. Arrays are indexed by triangle unless stated otherwise."""

    centre: NDArray[np.float64]  # (3,); centre, scale and reach: see `frame`
    scale: float
    reach: float
    vertices: NDArray[np.float32]  # (V,3) in the frame, sorted by instance
    triangles: NDArray[np.int32]  # (T,3)
    instance: NDArray[np.int32]  # (T,) ascending
    source: NDArray[np.int32]  # (T,) row in the scene's arrays of triangles
    normal_matrix: NDArray[np.float64]  # (I,3,3) local normals to world
    mirrored: NDArray[np.bool_]  # (I,) the scale is negative, so the winding is reversed
    corner_normals: NDArray[np.float32]  # (scene triangles,3,3) local
    uvs: NDArray[np.float32]  # (scene triangles,3,2), or (0,3,2)
    materials: NDArray[np.int32]  # (scene triangles,)
    piece: NDArray[np.int32]  # (T,) row of `cut`, −1 if the triangle is whole; (0,) if all are
    cut: NDArray[np.float64]  # (pieces,3,2) u, v of the corners of a piece on the scene's triangle

    def at_corners(self, values: NDArray, triangle: NDArray) -> NDArray[np.float64]:
        """Return values (n,3,k) at the corners of triangles (n,). `values` (scene triangles,3,k) are for the scene's
        triangles; pieces of cut triangles are interpolated.
        """
        out = values[self.source[triangle]].astype(np.float64)
        if len(self.piece):
            rows = np.flatnonzero(self.piece[triangle] >= 0)
            b = self.cut[self.piece[triangle[rows]]]
            weight = np.concatenate([1 - b.sum(2, keepdims=True), b], axis=2)
            out[rows] = np.einsum("nij,njk->nik", weight, out[rows])
        return out


class Hits(NamedTuple):
    """Surface points as arrays. The normals point to the side from which the ray came."""

    P: NDArray[np.float64]  # (n,3) world
    Ng: NDArray[np.float64]  # (n,3) unit, geometric
    Ns: NDArray[np.float64]  # (n,3) unit, shading
    uv: NDArray[np.float32]  # (n,2)
    material: NDArray[np.int32]  # (n,)
    triangle: NDArray[np.int32]  # (n,)
    front: NDArray[np.bool_]  # (n,) whether the ray came from the outside, as given by the winding
    row: NDArray[np.int32]  # (n,) of `table`, which says what the material is at this very point (see `looks`)
    table: Any = None
    smooth: Any = None  # (n,3) the shading normal before a program bent it; None: it is Ns
    displaced: Any = None  # (n,3) that with displacement, which is shown as bumps; None: it is `smooth`
    # Where the plan's nodes hold shares:
    apart: Any = None  # (n,) about how far the next hit is, scene units; inf: a rough surface sees it, by a few rays
    weight: Any = None  # (n,) what of the light that the hit returns counts in the picture
    sample: Any = None  # (n,2) of what the camera sees first: its pixel's number, and which sample of it
    block: Any = None  # (n,) of such hits: the block of the picture, ascending (see `shadows.blocks`)

    @property
    def unbent(self) -> Any:
        """Return the shading normals (n,3) before shaders bend them; None if they are Ns."""
        return self.smooth if self.displaced is None else self.displaced

    def at(self, rows: Any) -> Hits:
        """Return only these hits: a slice of them, those of an index, or those where a mask is set."""
        if isinstance(rows, slice):
            if rows.start == 0 and rows.stop == len(self.P):
                return self
            return Hits._make([*(a[rows] for a in self[:8]), self.table,
                               *(None if a is None else a[rows] for a in self[9:])])
        index = where(rows) if rows.dtype == np.bool_ else rows
        material = taken(self.material, index)
        row = material if self.row is self.material else taken(self.row, index)
        P, Ng, Ns, uv, _, triangle, front = (taken(a, index) for a in self[:7])
        return Hits(P, Ng, Ns, uv, material, triangle, front, row, self.table,
                    *(None if a is None else taken(a, index) for a in self[9:]))


class Placed(NamedTuple):
    """The triangles of all instances in the world."""

    world: NDArray[np.float64]  # (V,3)
    triangles: NDArray[np.int32]  # (T,3)
    instance: NDArray[np.int32]  # (T,)
    source: NDArray[np.int32]  # (T,)


def _placed(scene: Scene) -> Placed:
    g = scene.geometry
    meshes = g.meshes[g.instance_mesh] if len(g.instance_mesh) else np.zeros((0, 4), np.int64)
    first_vertex = np.concatenate([[0], np.cumsum(meshes[:, 1])])
    first_triangle = np.concatenate([[0], np.cumsum(meshes[:, 3])])
    if first_vertex[-1] >= 2**31 or first_triangle[-1] >= 2**31:
        raise SceneError(f"the scene has {first_triangle[-1]:,} triangles; the engine takes up to 2^31: "
                         "hide objects or reduce subdivision")
    world = np.empty((first_vertex[-1], 3))
    triangles = np.empty((first_triangle[-1], 3), np.int32)
    instance = np.empty(first_triangle[-1], np.int32)
    source = np.empty(first_triangle[-1], np.int32)
    vertices = np.ascontiguousarray(g.vertices, np.float32)
    matrix = np.ascontiguousarray(g.instance_matrix, np.float64)
    for i, (v0, nv, t0, nt) in enumerate(meshes.tolist()):
        v, t = first_vertex[i], first_triangle[i]
        _place(vertices[v0:v0 + nv], matrix[i], world[v:v + nv])
        np.add(g.triangles[t0:t0 + nt], np.int32(v), out=triangles[t:t + nt])
        instance[t:t + nt] = i
        source[t:t + nt] = np.arange(t0, t0 + nt, dtype=np.int32)
    traced = np.array([o.visible_camera or o.visible_reflection or o.visible_shadow for o in scene.objects], np.bool_)
    if not traced.all():
        kept = traced[g.instance_object[instance]]
        triangles, instance, source = triangles[kept], instance[kept], source[kept]
    return Placed(world, triangles, instance, source)


def _frame(scene: Scene, placed: Placed, camera: Camera) -> Frame:
    seen = np.array([o.visible_camera for o in scene.objects], np.bool_)
    return frame(placed.world, placed.triangles, seen[scene.geometry.instance_object[placed.instance]], camera)


def same_frame(surfaces: Surfaces, scene: Scene, camera: Camera) -> bool:
    """Return whether these surfaces of the scene have the frame that suits the camera."""
    new = _frame(scene, _placed(scene), camera)
    return (new.scale, new.reach) == (surfaces.scale, surfaces.reach) and bool((new.centre == surfaces.centre).all())


def flatten(scene: Scene, camera: Camera | None = None) -> tuple[Surfaces, list[str]]:
    """Return the triangles of all instances in the tracer's frame, and one warning for each object with bad triangles.

    Triangles are left out if they have no area, if a vertex is not finite, or if no ray may hit their object. `camera`
    is the camera to use instead of the scene's.
    """
    g, placed = scene.geometry, _placed(scene)
    frame = _frame(scene, placed, camera or scene.camera)
    world, triangles, instance, source = placed
    with np.errstate(invalid="ignore", over="ignore"):
        local = frame.to_frame(world)
        vertices = local.astype(np.float32)
    warnings = _beyond(scene, local, triangles, instance) if frame.reach == FAR else []
    usable = np.empty(len(triangles), np.bool_)
    _usable(vertices, triangles, usable)
    if not usable.all():
        warnings += _lost(scene, vertices, triangles[~usable], instance[~usable])
        triangles, instance, source = triangles[usable], instance[usable], source[usable]
    warnings += sliver_warnings(scene, vertices, triangles, instance)
    piece, corners = np.zeros(0, np.int32), np.zeros((0, 3, 2))
    if frame.reach > 1:
        large = too_large(local, triangles)
        if large.any():
            vertices, triangles, instance, source, piece, corners = _in_pieces(scene, local, triangles, instance,
                                                                               source, large)
    linear = np.ascontiguousarray(g.instance_matrix[:, :3, :3])
    determinant, normal_matrix = _cofactors(linear)
    return Surfaces(
        frame.centre, frame.scale, frame.reach, vertices, triangles, instance, source, normal_matrix, determinant < 0,
        np.ascontiguousarray(g.corner_normals, np.float32), np.ascontiguousarray(g.uvs, np.float32),
        np.ascontiguousarray(g.triangle_materials, np.int32), piece, corners,
    ), warnings


def _in_pieces(scene: Scene, local: NDArray[np.float64], triangles: NDArray[np.int32], instance: NDArray[np.int32],
               source: NDArray[np.int32], large: NDArray[np.bool_]) -> tuple[NDArray, ...]:
    """Return vertices (float32), triangles, instance, source, piece and cut, with large triangles (T,) cut into
    pieces.
    """
    pieces, uv, of = cut(local[triangles[large]])
    whole, count = ~large, np.count_nonzero(~large)
    g = scene.geometry
    owner = np.repeat(np.arange(len(g.instance_mesh), dtype=np.int32), g.meshes[g.instance_mesh, 1])
    owner = np.concatenate([owner, np.repeat(instance[large][of], 3)])
    own = (len(local) + np.arange(3 * len(pieces))).reshape(-1, 3)
    triangles = np.concatenate([triangles[whole], own])
    instance = np.concatenate([instance[whole], instance[large][of]])
    source = np.concatenate([source[whole], source[large][of]])
    piece = np.concatenate([np.full(count, -1), np.arange(len(pieces))])
    by_instance, moved = np.argsort(owner, kind="stable"), np.empty(len(owner), np.int32)
    moved[by_instance] = np.arange(len(owner), dtype=np.int32)
    with np.errstate(invalid="ignore", over="ignore"):
        vertices = np.concatenate([local, pieces.reshape(-1, 3)])[by_instance].astype(np.float32)
    order = np.argsort(instance, kind="stable")
    triangles = moved[triangles[order]]
    usable = np.empty(len(triangles), np.bool_)
    _usable(vertices, triangles, usable)
    order = order[usable]
    return vertices, triangles[usable], instance[order], source[order], piece[order].astype(np.int32), uv


def _cofactors(m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the determinants and the cofactor matrices (I,3,3). These are det·M⁻ᵀ; they transform normals and need no
    inverse.
    """
    a, b, c = m[:, 0], m[:, 1], m[:, 2]
    cofactor = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    determinant = (a * cofactor[:, 0]).sum(1)
    return determinant, cofactor * np.where(determinant < 0, -1.0, 1.0)[:, None, None]


def _lost(scene: Scene, vertices: NDArray[np.float32], triangles: NDArray[np.int32],
          instance: NDArray[np.int32]) -> list[str]:
    """Return one sentence for each object whose triangles have vertices that are not finite. (Triangles without area
    are no error.)
    """
    broken = ~np.isfinite(vertices[triangles]).all((1, 2))
    owner = scene.geometry.instance_object[instance[broken]]
    objects, counts = np.unique(owner, return_counts=True)
    return [
        f"object '{scene.objects[o].name}': {n} triangles have a vertex that is not finite and are left out"
        for o, n in zip(objects.tolist(), counts.tolist(), strict=True)
    ]


def _beyond(scene: Scene, local: NDArray[np.float64], triangles: NDArray[np.int32],
            instance: NDArray[np.int32]) -> list[str]:
    """Return one sentence for each object that reaches farther than the tracer can."""
    far = ((np.abs(local) > FAR) & np.isfinite(local)).any(1)[triangles].any(1)
    objects = np.unique(scene.geometry.instance_object[instance[far]])
    return [f"object '{scene.objects[o].name}': parts of it are more than a hundred thousand million views away and "
            "are left out: look for a mistyped location or scale" for o in objects.tolist()]


def surfacing(s: Surfaces) -> Callable[..., None]:
    """Return a function that fills `hits` for the triangles that rays hit; u, v (n,) are Embree's, in float32.

    Of the rays (n,) only those of `rows` count; None: all. The intersection is computed again in float64 (Möller and
    Trumbore, 1997) and clamped to the triangle, so that P lies in its plane and on the ray.
    """
    kernel_of = _surface.of(s.centre, s.scale, *s[3:])

    def surface(rows: NDArray[np.int64] | None, triangle: NDArray[np.int32], u: NDArray[np.float32],
                v: NDArray[np.float32], origin: NDArray[np.float64], direction: NDArray[np.float64],
                hits: Hits) -> None:
        kernel_of(rows, triangle, u, v, origin, direction, *hits[:7])

    return surface
