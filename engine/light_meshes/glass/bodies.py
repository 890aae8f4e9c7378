"""Bodies of glass: which triangles bound one, which of overlapping ones is there, and which are around a point.

View rays and shadow paths go by the same bodies and the same rank. Coordinates are the tracer's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Surfaces
from ..support.native import kernel

_winding = kernel("bodies_winding")

FLAT = 1e-4  # radians: a triangle whose corner normals all lie so near its own is flat-shaded
ROUND = np.radians(15)  # normals that differ more from a facet's own are no round surface's


class Bodies(NamedTuple):
    """Closed surfaces of one instance and one medium; the inside is counted by crossings, so that bubbles are holes."""

    of: NDArray[np.int32]  # (T,) the body that a triangle bounds, −1: none
    ior: NDArray[np.float64]  # (B,)
    priority: NDArray[np.int32]  # (B,)
    rank: NDArray[np.int64]  # (B,) of those around a point the highest is the medium
    inside_out: NDArray[np.bool_]  # (B,) its triangles face inwards
    low: NDArray[np.float64]  # (B,3)
    high: NDArray[np.float64]  # (B,3)

    def overlaps(self) -> NDArray[np.bool_]:
        """Which bodies (B,) of index 1 are a medium: in their box stands glass of lower priority."""
        out = self.ior != 1
        glass = np.flatnonzero(out)
        for b in np.flatnonzero(~out):
            beside = (self.low[glass] > self.high[b]) | (self.high[glass] < self.low[b])
            out[b] = (~beside.any(1) & (self.priority[glass] < self.priority[b])).any()
        return out


def bodies(surfaces: Surfaces, solid: NDArray[np.bool_], ior: NDArray[np.float64],
           priority: NDArray[np.int32]) -> Bodies:
    """The bodies that `solid` triangles bound, whose ior and priority (T,) are those of their materials.

    Where bodies overlap the one of highest priority is there, of equals the smaller one. A mesh that faces inwards
    inside a body of the same medium is a hole in that body; anywhere else it is taken for turned round.
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
    """Boxes (size,3) and signed volumes (size,) of bodies of triangles `index`, of which each is in body `number`."""
    low, high = np.full((size, 3), np.inf), np.full((size, 3), -np.inf)
    np.minimum.at(low, number, corners.min(1))
    np.maximum.at(high, number, corners.max(1))
    local = corners - ((low + high) / 2)[number][:, None]
    outward = np.where(surfaces.mirrored[surfaces.instance[index]], -1.0, 1.0)
    return low, high, np.bincount(number, outward * np.linalg.det(local) / 6, size)


def around(surfaces: Surfaces, b: Bodies, points: NDArray[np.float64], most: int) -> NDArray[np.int32]:
    """The bodies (n,most) that points (n,3), world, are in, −1: none; of more than `most` those of highest rank."""
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
        turns = np.empty(len(local) if meets else 1)  # no surface between the points: all are inside, or none is
        _winding(corners, sign, np.ascontiguousarray(local[:len(turns)]), turns)
        times = np.broadcast_to(np.rint(turns).astype(np.int64), len(local))
        for k in range(int(times.max())):
            rows = np.flatnonzero((times > k) & (out[:, -1] < 0))
            out[rows, (out[rows] >= 0).sum(1)] = body
    return out


def facets(surfaces: Surfaces, index: NDArray[np.intp]) -> NDArray[np.float64]:
    """What a facet of a round surface may add to the square of a ray's sine, (n,) factors; 1: flat-shaded.

    It lies too deep by up to the cosine of the angle between the normals at its corners and its own. Normals that
    Blender averages from facets err about as much again.
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
