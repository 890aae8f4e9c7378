"""Bodies of glass: which triangles bound them, which one counts where they overlap, and which ones contain a point.

View rays and shadow paths use the same bodies and the same ranks. Coordinates are those of the tracer's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Surfaces
from ..support.native import kernel

_winding = kernel("bodies_winding")

FLAT = 1e-4  # radians: a triangle is flat-shaded if all its corner normals differ by less from its own
ROUND = np.radians(15)  # if normals differ by more from a facet's own, the surface is not round


class Bodies(NamedTuple):
    """Each body is all closed surfaces of one instance with one medium. Its inside is found by counting crossings, so
    bubbles are holes.
    """

    of: NDArray[np.int32]  # (T,) the body that a triangle bounds, −1 if none
    ior: NDArray[np.float64]  # (B,)
    priority: NDArray[np.int32]  # (B,)
    rank: NDArray[np.int64]  # (B,) of the bodies around a point, the one with the highest rank is the medium
    inside_out: NDArray[np.bool_]  # (B,) its triangles face inwards
    low: NDArray[np.float64]  # (B,3)
    high: NDArray[np.float64]  # (B,3)

    def overlaps(self) -> NDArray[np.bool_]:
        """Return which bodies (B,) are a medium. A body of index 1 is one only if glass of lower priority overlaps its
        box.
        """
        out = self.ior != 1
        glass = np.flatnonzero(out)
        for b in np.flatnonzero(~out):
            beside = (self.low[glass] > self.high[b]) | (self.high[glass] < self.low[b])
            out[b] = (~beside.any(1) & (self.priority[glass] < self.priority[b])).any()
        return out


def bodies(surfaces: Surfaces, solid: NDArray[np.bool_], ior: NDArray[np.float64],
           priority: NDArray[np.int32]) -> Bodies:
    """Return the bodies that the `solid` triangles bound; ior and priority (T,) are those of the triangles' materials.

    Where bodies overlap, the one with the highest priority counts, or the smaller one if priorities are equal. A mesh
    that faces inwards and lies inside a body of the same medium is a hole in that body; elsewhere it counts as a body
    with reversed faces.
    """
    index = np.flatnonzero(solid)
    owner = surfaces.instance[index]
    key = np.stack([owner, ior[index].view(np.int64), priority[index]], 1)
    keys, number = np.unique(key, axis=0, return_inverse=True)
    number = number.reshape(-1)
    corners = surfaces.vertices[surfaces.triangles[index]].astype(np.float64)
    low, high, volume = _extent(surfaces, index, corners, number, len(keys))
    merged = np.arange(len(keys))
    for b in np.flatnonzero(volume < 0):
        holds = (low <= low[b]).all(1) & (high >= high[b]).all(1) & (keys[:, 1:] == keys[b, 1:]).all(1)
        outer = np.flatnonzero(holds & (volume > 0))
        if len(outer):
            merged[b] = outer[volume[outer].argmin()]
    if (merged != np.arange(len(keys))).any():
        used, number = np.unique(merged[number], return_inverse=True)
        keys = keys[used]
        low, high, volume = _extent(surfaces, index, corners, number, len(keys))
    rank = np.empty(len(keys), np.int64)
    rank[np.lexsort((np.arange(len(keys)), -np.abs(volume), keys[:, 2]))] = np.arange(len(keys))
    of = np.full(len(solid), -1, np.int32)
    of[index] = number
    return Bodies(of, keys[:, 1].copy().view(np.float64), keys[:, 2].astype(np.int32), rank, volume < 0, low, high)


def _extent(surfaces: Surfaces, index: NDArray[np.intp], corners: NDArray[np.float64], number: NDArray[np.intp],
            size: int) -> tuple[NDArray, NDArray, NDArray]:
    """Return the boxes (size,3) and the signed volumes (size,) of bodies; `number` says to which body each of the
    triangles `index` belongs.
    """
    low, high = np.full((size, 3), np.inf), np.full((size, 3), -np.inf)
    np.minimum.at(low, number, corners.min(1))
    np.maximum.at(high, number, corners.max(1))
    local = corners - ((low + high) / 2)[number][:, None]
    outward = np.where(surfaces.mirrored[surfaces.instance[index]], -1.0, 1.0)
    return low, high, np.bincount(number, outward * np.linalg.det(local) / 6, size)


def around(surfaces: Surfaces, b: Bodies, points: NDArray[np.float64], most: int) -> NDArray[np.int32]:
    """Return the bodies (n,most) that contain the points (n,3), in the world; −1 if none. If there are more than
    `most`, those of highest rank.
    """
    out = np.full((len(points), most), -1, np.int32)
    local = (points - surfaces.centre) / surfaces.scale
    if not len(b.rank) or not len(local):
        return out
    low, high = local.min(0), local.max(0)
    near = np.flatnonzero(((b.low <= high) & (b.high >= low)).all(1))
    for body in near[np.argsort(-b.rank[near])]:
        index = np.flatnonzero(b.of == body)
        corners = surfaces.vertices[surfaces.triangles[index]].astype(np.float64)
        meets = ((corners.min(1) <= high) & (corners.max(1) >= low)).all(1).any()
        sign = np.where(surfaces.mirrored[surfaces.instance[index]], -1.0, 1.0)
        turns = np.empty(len(local) if meets else 1)  # if no surface lies between the points, all are inside or none is
        _winding(corners, sign, np.ascontiguousarray(local[:len(turns)]), turns)
        times = np.broadcast_to(np.rint(turns).astype(np.int64), len(local))
        for k in range(int(times.max())):
            rows = np.flatnonzero((times > k) & (out[:, -1] < 0))
            out[rows, (out[rows] >= 0).sum(1)] = body
    return out


def facets(surfaces: Surfaces, index: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return factors (n,) for the square of a ray's sine, by which a facet of a round surface may be wrong; 1 if it is
    flat-shaded.

    The error is up to the cosine of the angle between a facet's normal and the normals at its corners. Normals that
    Blender averages from facets have about the same error again.
    """
    corners = surfaces.vertices[surfaces.triangles[index]].astype(np.float64)
    owner = surfaces.instance[index]
    Ng = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    Ng *= np.where(surfaces.mirrored[owner], -1.0, 1.0)[:, None]
    Ns = np.einsum("nij,nkj->nki", surfaces.normal_matrix[owner],
                   surfaces.corner_normals[surfaces.source[index]].astype(np.float64))
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.einsum("nkj,nj->nk", Ns, Ng) / np.linalg.norm(Ns, axis=2) / np.linalg.norm(Ng, axis=1)[:, None]
    least = np.where(np.isfinite(cosine), cosine, 1).min(1)
    return np.where(least > np.cos(FLAT), 1.0, 2 / np.maximum(least, np.cos(ROUND)) ** 2 - 1)
