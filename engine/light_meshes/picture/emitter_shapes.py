"""The shapes of surfaces that give light: balls, faces and pieces, for which lamps stand."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FEW = 24  # faces of one group of triangles, if that will do
# How finely a group is divided, from fine to coarse: the degrees that normals may differ from that of the largest
# triangle, and the share of its rectangle that a face must fill. The first is taken that gives no more than FEW faces.
FINENESS = ((15.0, 0.7), (20.0, 0.7), (20.0, 0.5), (30.0, 0.5))
PIECES = 48  # of a bent thing that would be more faces
BENT = 2.0  # how much a piece that is bent counts, compared with one that does not fill its rectangle
SAMPLE = 4096  # triangles, about, by which it is decided how pieces are divided
LOOSE = 0.15  # a sign fills at least this share of its outline
THICK = 0.3  # a face that is thicker than this share of its length is divided


class Emitting(NamedTuple):
    """Triangles that give light."""

    triangle: NDArray[np.int64]  # (n,)
    corners: NDArray[np.float64]  # (n,3,3) world
    normal: NDArray[np.float64]  # (n,3) unit, to the outside
    area: NDArray[np.float64]  # (n,)
    radiance: NDArray[np.float64]  # (n,3), the mean over the triangle

    def at(self, rows: NDArray) -> Emitting:
        """Return these triangles only."""
        return Emitting._make(a[rows] for a in self)


class Face(NamedTuple):
    """A flat group of triangles as a rectangle or an ellipse."""

    rows: NDArray[np.int64]  # of the group's triangles
    centre: NDArray[np.float64]  # (3,)
    normal: NDArray[np.float64]  # (3,)
    u: NDArray[np.float64]  # (3,) half-axes
    v: NDArray[np.float64]
    ellipse: bool


def _vertices(corners: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return numbers (n,3) of the corners (n,3,3) of triangles, which are equal where corners are."""
    bits = (corners.reshape(-1, 3).round(9) + 0.0).view(np.uint64)  # −0 is 0
    key = np.zeros(len(bits), np.uint64)
    for column in bits.T:
        key = (key ^ column) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    _, vertex = np.unique(key, return_inverse=True)  # of rows it would take ten times as long
    found: NDArray[np.int64] = vertex.reshape(-1, 3)
    return found


def closed(corners: NDArray[np.float64]) -> bool:
    """Return whether each edge of triangles (n,3,3) belongs to two of them, so that their insides are not seen."""
    vertex = _vertices(corners)
    edges = np.sort(np.concatenate([vertex[:, [0, 1]], vertex[:, [1, 2]], vertex[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges[:, 0] * (int(vertex.max(initial=0)) + 1) + edges[:, 1], return_counts=True)
    return bool((count == 2).all())


def around(of: Emitting, points: NDArray[np.float64]) -> bool:
    """Return whether a closed thing is around any of these points (n,3): whether it fills all directions there."""
    corners = of.corners.reshape(-1, 3)
    for point in points[((points > corners.min(0)) & (points < corners.max(0))).all(1)]:
        a, b, c = (of.corners - point).swapaxes(0, 1)  # solid angles by van Oosterom and Strackee (1983)
        A, B, C = (np.linalg.norm(to, axis=1) for to in (a, b, c))
        below = A * B * C + (a * b).sum(1) * C + (b * c).sum(1) * A + (c * a).sum(1) * B
        if abs(np.arctan2((a * np.cross(b, c)).sum(1), below).sum()) > np.pi:  # half of 4π, all around
            return True
    return False


def parts(of: Emitting, most: int) -> list[Emitting]:
    """Return the triangles of each part that does not touch the others, in the order of the mesh; none if there are
    more than `most` parts.
    """
    vertex = _vertices(of.corners)
    label = np.arange(vertex.max(initial=-1) + 1)  # of vertices: a smaller number of their part
    a, b = vertex[:, :2].ravel(), vertex[:, 1:].ravel()  # edges that may still join parts
    while len(a):
        low, high = np.minimum(label[a], label[b]), np.maximum(label[a], label[b])
        apart = low != high
        a, b = a[apart], b[apart]
        np.minimum.at(label, high[apart], low[apart])
        while (label != label[label]).any():
            label = label[label]
    names, part = np.unique(label[vertex[:, 0]], return_inverse=True)
    if len(names) > most:
        return []
    rows = np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1])
    return [of] if len(rows) == 1 else [of.at(r) for r in sorted(rows, key=lambda r: int(r[0]))]


def ball(of: Emitting) -> tuple[NDArray[np.float64], float] | None:
    """Return the centre and radius of the largest sphere within these triangles, if they are nearly a sphere: it is
    below the horizon everywhere on them, so that the lamp does not light what it stands for.
    """
    points = of.corners.reshape(-1, 3)
    centre = (points.min(0) + points.max(0)) / 2
    away = np.linalg.norm(points - centre, axis=1)
    middle = of.corners.mean(1) - centre
    outward = np.einsum("ni,ni->n", middle, of.normal) > 0.85 * np.linalg.norm(middle, axis=1)
    if len(of.area) < 20 or away.max() - away.min() > 0.05 * away.max() or not outward.all():
        return None
    depth = np.einsum("ni,ni->n", of.corners[:, 0] - centre, of.normal)
    return centre, float(depth.min()) * (1 - 1e-6)


def divided(of: Emitting, most: int) -> list[Face]:
    """Return the triangles as faces: as fine as possible without too many of them, or else the coarsest. The division
    stops as soon as there are more than `most`.
    """
    coarsest = list(islice(_faces(of, *FINENESS[-1]), most + 1))
    if len(coarsest) > most:  # finer, there are more
        return coarsest
    for fineness in FINENESS[:-1]:
        faces = list(islice(_faces(of, *fineness), most + 1))
        if len(faces) <= FEW:
            return faces
    return coarsest


def _faces(of: Emitting, flat: float, fills: float) -> Iterator[Face]:
    """Return the triangles as flat groups, each as a face of the same area to its front; see `FINENESS`."""
    left = np.arange(len(of.area))
    while len(left):
        largest = left[np.argmax(of.area[left])]
        near = of.normal[left] @ of.normal[largest] > np.cos(np.radians(flat))
        stack = [left[near]]
        left = left[~near]
        while stack:
            rows = stack.pop()
            face, full, thick, along = _face(of, rows)
            if len(rows) > 2 and ((full < fills and not face.ellipse) or thick > THICK):
                middles = of.corners[rows].mean(1) @ along
                split = middles > np.median(middles)
                if split.any() and not split.all():
                    stack += [rows[split], rows[~split]]
                    continue
            yield face


def _face(of: Emitting, rows: NDArray[np.int64]) -> tuple[Face, float, float, NDArray[np.float64]]:
    """Return the face of some triangles; how much of its rectangle they fill, how thick they are by its length, and its
    longer axis.
    """
    facing = (of.area[rows, None] * of.normal[rows]).sum(0)
    flat = float(np.linalg.norm(facing))  # the area that is seen from the front
    N = facing / flat
    points = of.corners[rows].reshape(-1, 3)
    edges = (np.roll(of.corners[rows], -1, 1) - of.corners[rows]).reshape(-1, 3)
    longest = edges[np.argsort(-np.einsum("ni,ni->n", edges, edges), kind="stable")[:8]]
    # The rectangle lies along one of the edges, or along all points: the longest edges of narrow strips are diagonals.
    us = np.concatenate([longest, np.linalg.eigh(np.cov(points.T))[1][:, 2:].T])
    us -= (us @ N)[:, None] * N
    us = us[us.any(1)]
    us /= np.linalg.norm(us, axis=1)[:, None]
    vs = np.cross(N, us)
    lows, highs = (np.stack([extreme(points @ axes.T, axis=0) for axes in (us, vs)], 1) for extreme in (np.min, np.max))
    sizes = (highs - lows).prod(1)
    best = int(np.argmin(sizes))
    size, u, v, low, high = float(sizes[best]), us[best], vs[best], lows[best], highs[best]
    half, middle = (high - low) / 2, (high + low) / 2
    at = (np.stack([points @ u, points @ v], 1) - middle) / half
    full = flat / size
    ellipse = abs(full - np.pi / 4) < 0.06 and len(rows) > 6 and float(np.einsum("ni,ni->n", at, at).max()) < 1.08
    height = points @ N
    scale = np.sqrt(flat / ((np.pi if ellipse else 4.0) * half.prod()))
    half = half * scale
    away = (of.area[rows] @ (of.corners[rows].mean(1) @ N)) / of.area[rows].sum()
    centre = middle[0] * u + middle[1] * v + away * N
    if full < 0.9 and not ellipse:
        centre = (of.area[rows, None] * of.corners[rows].mean(1)).sum(0) / of.area[rows].sum()
    along = u if half[0] >= half[1] else v
    thick = float(np.ptp(height)) / (2 * float(half.max()))
    return Face(rows, centre, N, half[0] * u, half[1] * v, ellipse), full, thick, along


def pieces(of: Emitting, count: int) -> list[Face]:
    """Return the triangles of a bent thing, such as a neon tube, in `count` pieces. The piece is divided next that a
    flat face stands for worst: by its normals if it is bent, or along it if it does not fill its rectangle.
    """
    size = float(np.ptp(of.corners.reshape(-1, 3), axis=0).max())
    waiting: list[tuple[float, int, NDArray[np.int64], NDArray[np.float64]]] = []
    made = 0

    def add(rows: NDArray[np.int64]) -> None:
        nonlocal made
        some, whole = rows[::len(rows) // SAMPLE + 1], float(of.area[rows].sum())
        area, normal = of.area[some], of.normal[some]
        mean = area @ normal / area.sum()
        bent, loose = BENT * (1 - float(np.linalg.norm(mean))), 0.0
        if bent < 0.99 * BENT:  # else it is closed, and no face
            face, full, _, along = _face(of, some)
            full *= whole / float(area.sum())
            long = float(np.ptp(of.corners[some].reshape(-1, 3) @ along))
            loose = 0.0 if face.ellipse else (1 - min(full, 1.0)) * long / size
        if bent >= loose:
            away = normal - mean
            by = of.normal[rows] @ np.linalg.eigh((area[:, None] * away).T @ away)[1][:, 2]
        else:
            by = of.corners[rows].mean(1) @ along
        worst, made = max(bent, loose) * whole if len(rows) > 2 else 0.0, made + 1
        heapq.heappush(waiting, (-worst, made, rows, by))

    add(np.arange(len(of.area)))
    while len(waiting) < count and waiting[0][0] < 0:
        _, _, rows, by = heapq.heappop(waiting)
        order = np.argsort(by, kind="stable")
        sums = np.cumsum(of.area[rows[order]])
        half = min(max(int(np.searchsorted(sums, sums[-1] / 2)), 1), len(order) - 1)
        add(rows[order[:half]])
        add(rows[order[half:]])
    return [_face(of, rows)[0] for _, _, rows, _ in waiting]


def sign(of: Emitting) -> Face | None:
    """Return one face for all triangles, if they are a flat thing with many edges, such as the letters of a sign: as
    large as its outline. All of their power goes to its two sides. None for other things.
    """
    largest = of.normal[np.argmax(of.area)]
    cap = np.flatnonzero(of.normal @ largest > np.cos(np.radians(FINENESS[-1][0])))
    face, full, _, _ = _face(of, cap)
    u, v = (a / np.linalg.norm(a) for a in (face.u, face.v))
    points = of.corners.reshape(-1, 3)
    at = np.stack([points @ u, points @ v, points @ face.normal], 1)
    half, middle = np.ptp(at, axis=0) / 2, (at.max(0) + at.min(0)) / 2
    if half[2] > THICK * half[:2].max() or full < LOOSE:
        return None
    return Face(np.arange(len(of.area)), middle @ np.stack([u, v, face.normal]), face.normal, half[0] * u, half[1] * v,
                False)
