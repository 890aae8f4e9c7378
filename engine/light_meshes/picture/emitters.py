"""Surfaces that give light become lamps with a size: a lamp stands for a group of emitting triangles.

Light that is gathered at surfaces finds emitters with few rays only if they are large. A group that is nearly flat is a
rectangle or an ellipse of the same area, with the mean radiance of its triangles, so that its power is exact; a ball is
a sphere. The face of the lamp is in front of its triangles, which so cast no shadow in their own light. Flat things
with many edges are a face on each side, and bent ones a row of spheres. The groups with most power become lamps, `MOST`
in all; the rest is gathered (docs/light.md).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits
from ..scene.description import Light, Object, Scene
from ..support.statistics import Statistics
from ..surface.points import REFLECTED
from .world import World, world

MOST = 64  # lamps in all
FEW = 24  # of one group of triangles, if that will do
# How finely a group is divided, from fine to coarse: the degrees that normals may differ from that of the largest
# triangle, and the share of its rectangle that a face must fill. The first is taken that gives no more than FEW lamps.
FINENESS = ((15.0, 0.7), (20.0, 0.7), (20.0, 0.5), (30.0, 0.5))
PIECES = 16  # of a bent thing that would be more than MOST faces
LOOSE = 0.15  # a sign fills at least this share of its outline
THICK = 0.3  # a face that is thicker than this share of its length is divided
SAMPLES = 1 << 18  # points where emission is looked at, of all triangles whose material has a program for it


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


def lit(bare: World, scene: Scene, stats: Statistics, check: Callable[[], None]) -> World:
    """Return the world with lamps for surfaces that give light, where its settings gather light from everywhere; else
    `bare`.
    """
    settings = scene.settings
    if not settings.gathers:
        return bare
    with stats.stage("emitters"):
        found = emitting(bare)
        lamps, taken, objects = lamps_of(bare, found) if len(found.triangle) else ([], np.zeros(0, np.int64), ())
    if not lamps:
        return bare
    as_lamps = np.zeros(len(bare.surfaces.triangles), np.bool_)
    as_lamps[taken] = True
    with_lamps = world(scene, bare.camera, stats, check, bare, tuple(lamps), bare.glass.whole)
    return dataclasses.replace(with_lamps, as_lamps=as_lamps, lamp_objects=objects)


def emitting(bare: World) -> Emitting:
    """Return all triangles that give light, but for objects that diffuse rays do not see, which light nothing."""
    s, scene = bare.surfaces, bare.scene
    gives = np.array([m.emits for m in scene.materials], np.bool_)
    material = s.materials[s.source]
    triangle = np.flatnonzero(gives[material])
    lights = np.array([o.visible_diffuse for o in scene.objects], np.bool_)
    triangle = triangle[lights[bare.owner(triangle.astype(np.int32))]]
    corners = s.vertices[s.triangles[triangle]].astype(np.float64) * s.scale + s.centre
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1)
    mirrored = s.mirrored[s.instance[triangle]]
    normal = np.where(mirrored[:, None], -cross, cross) / np.maximum(double, 1e-300)[:, None]
    radiance = bare.materials.emission[material[triangle]].astype(np.float64)
    varies = np.flatnonzero(np.array(["emission" in m.program.values for m in scene.materials])[material[triangle]])
    found = Emitting(triangle, corners, normal, double / 2, radiance)
    if len(varies):
        radiance[varies] = _looked_at(bare, found.at(varies))
    kept = np.flatnonzero(radiance.any(1) & (double > 0))
    return found if len(kept) == len(triangle) else found.at(kept)


def _looked_at(bare: World, of: Emitting) -> NDArray[np.float64]:
    """Return the mean radiance (n,3) of triangles by the programs of their materials."""
    m = int(np.clip(np.sqrt(SAMPLES / max(len(of.triangle), 1)), 1, 32))
    i, j = (a.ravel() for a in np.meshgrid(np.arange(m), np.arange(m), indexing="ij"))
    up = i + j < m  # the middles of the m² small triangles
    uv = np.concatenate([np.stack([i[up] + 1 / 3, j[up] + 1 / 3], 1),
                         np.stack([i[i + j < m - 1] + 2 / 3, j[i + j < m - 1] + 2 / 3], 1)]) / m
    total = np.zeros((len(of.triangle), 3))
    s = bare.surfaces
    triangle = of.triangle.astype(np.int32)
    material = s.materials[s.source[triangle]]
    uvs = s.at_corners(s.uvs, triangle) if len(s.uvs) else np.zeros((len(triangle), 3, 2))
    for u, v in uv:
        weight = np.array([1 - u - v, u, v])
        hits = Hits(weight @ of.corners, of.normal, of.normal, (weight @ uvs).astype(np.float32), material, triangle,
                    np.ones(len(triangle), np.bool_), material, bare.materials)
        hits = bare.look(hits, -of.normal, np.full(len(triangle), REFLECTED, np.int8))
        total += hits.table.emission[hits.row]
    return total / len(uv)


def lamps_of(bare: World, found: Emitting) -> tuple[list[Light], NDArray[np.int64], tuple[int, ...]]:
    """Return the lamps for the groups with most power, the triangles for which they stand, and each lamp's object."""
    s, scene = bare.surfaces, bare.scene
    instance, material = s.instance[found.triangle], s.materials[s.source[found.triangle]]
    key = instance.astype(np.int64) * len(scene.materials) + material
    names, group = np.unique(key, return_inverse=True)
    power = np.bincount(group, found.area * found.radiance.sum(1))
    triangles = np.bincount(s.instance)  # of each instance
    lamps: list[Light] = []
    objects: list[int] = []
    taken: list[NDArray[np.int64]] = []
    owners = scene.geometry.instance_object[names // len(scene.materials)]
    linked = np.array([o.receivers is not None or o.blockers is not None for o in scene.objects], np.bool_)[owners]
    for g in np.lexsort((-power, ~linked)):  # gathered light obeys no links
        if len(lamps) == MOST:
            break
        of = found.at(np.flatnonzero(group == g))
        place = names[g] // len(scene.materials)
        owner, whole = int(owners[g]), len(of.triangle) == triangles[place]
        ob = scene.objects[owner]
        new = [lamp if ob.receivers is None else dataclasses.replace(lamp, receivers=ob.receivers)
               for lamp in _group(of, ob, owner if whole else None, len(scene.objects))]
        if len(lamps) + len(new) > MOST:
            continue
        lamps += new
        objects += [owner] * len(new)
        taken.append(of.triangle)
    return lamps, np.concatenate(taken) if taken else np.zeros(0, np.int64), tuple(objects)


def _group(of: Emitting, ob: Object, alone: int | None, objects: int) -> Iterator[Light]:
    """Return the lamps of a group of triangles of an object. alone: its number, if it has no other triangles. objects:
    how many there are.
    """
    name = ob.name
    closed = _closed(of.corners)
    middles = of.corners.mean(1)
    if closed and of.area @ np.einsum("ni,ni->n", of.normal, middles - middles[0]) < 0:
        of = of._replace(normal=-of.normal)  # the mesh is inside out
    ball = _ball(of) if closed and alone is not None else None
    faces = _divided(of) if ball is None else []
    sign = _sign(of) if len(faces) > FEW else None
    balls = [(np.arange(len(of.area)), *ball)] if ball else (
        _balls(of) if closed and alone is not None and len(faces) > MOST and sign is None else [])
    for rows, centre, radius in balls:
        intensity = (of.area[rows, None] * of.radiance[rows]).sum(0) / (4 * np.pi)
        yield Light(f"{name} (emission)", "POINT", _rgb(intensity), _rgb(centre), radius=radius, softness="SIZE",
                    blockers=tuple(i for i in (range(objects) if ob.blockers is None else ob.blockers)
                                   if i != alone))
    if balls:
        return
    for face in faces if sign is None else [sign]:
        part = of.at(face.rows)
        for side in (1.0,) if closed and sign is None else (1.0, -1.0):
            N = side * face.normal
            share = 0.5 if closed and sign is not None else 1.0
            intensity = share * (part.area[:, None] * part.radiance).sum(0) / np.pi  # of all power, if it is bent, too
            front = float(((part.corners.reshape(-1, 3) - face.centre) @ N).max())
            front += 1e-4 * float(np.linalg.norm(face.u))
            yield Light(f"{name} (emission)", "AREA", _rgb(intensity),
                        _rgb(face.centre + front * N), _rgb(N), area_u=_rgb(face.u), area_v=_rgb(side * face.v),
                        area_ellipse=face.ellipse, softness="SIZE", blockers=ob.blockers)


def _balls(of: Emitting) -> list[tuple[NDArray[np.int64], NDArray[np.float64], float]]:
    """Return the triangles of a bent thing, such as a neon tube, in PIECES parts, each with a ball of the same area for
    it: its triangles, centre and radius.
    """
    middles = of.corners.mean(1)
    parts = [np.arange(len(of.area))]
    while len(parts) < PIECES:
        sizes = [np.ptp(middles[rows], axis=0).max() for rows in parts]
        rows = parts.pop(int(np.argmax(sizes)))
        along = middles[rows, int(np.ptp(middles[rows], axis=0).argmax())]
        order = np.argsort(along, kind="stable")
        half = int(np.searchsorted(np.cumsum(of.area[rows[order]]), of.area[rows].sum() / 2))
        half = min(max(half, 1), len(rows) - 1)
        parts += [rows[order[:half]], rows[order[half:]]]
    weight = [of.area[rows, None] / of.area[rows].sum() for rows in parts]
    return [(rows, (w * middles[rows]).sum(0), float(np.sqrt(of.area[rows].sum() / (4 * np.pi))))
            for rows, w in zip(parts, weight, strict=True)]


def _sign(of: Emitting) -> Face | None:
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


def _rgb(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _closed(corners: NDArray[np.float64]) -> bool:
    """Return whether each edge of triangles (n,3,3) belongs to two of them, so that their insides are not seen."""
    _, vertex = np.unique(corners.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    edges = np.sort(np.concatenate([vertex[:, [0, 1]], vertex[:, [1, 2]], vertex[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    return bool((count == 2).all())


def _ball(of: Emitting) -> tuple[NDArray[np.float64], float] | None:
    """Return the centre and radius of the sphere with the area of these triangles, if they are nearly a sphere."""
    points = of.corners.reshape(-1, 3)
    centre = (points.min(0) + points.max(0)) / 2
    away = np.linalg.norm(points - centre, axis=1)
    middle = of.corners.mean(1) - centre
    outward = np.einsum("ni,ni->n", middle, of.normal) > 0.85 * np.linalg.norm(middle, axis=1)
    if len(of.area) < 20 or away.max() - away.min() > 0.05 * away.max() or not outward.all():
        return None
    return centre, float(np.sqrt(of.area.sum() / (4 * np.pi)))


def _divided(of: Emitting) -> list[Face]:
    """Return the triangles as faces: as fine as possible without too many of them, or else the coarsest. The division
    stops as soon as there are too many.
    """
    faces: list[Face] = []
    for flat, full in FINENESS:
        faces = list(islice(_faces(of, flat, full), MOST + 1))
        if len(faces) <= FEW:
            break
    return faces


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
    best: tuple[float, NDArray, NDArray, NDArray, NDArray] | None = None
    # The rectangle lies along one of the edges, or along all points: the longest edges of narrow strips are diagonals.
    for edge in (*longest, np.linalg.eigh(np.cov(points.T))[1][:, 2]):
        u = edge - (edge @ N) * N
        if not u.any():
            continue
        u /= np.linalg.norm(u)
        v = np.cross(N, u)
        at = np.stack([points @ u, points @ v], 1)
        low, high = at.min(0), at.max(0)
        size = float(np.prod(high - low))
        if best is None or size < best[0]:
            best = size, u, v, low, high
    assert best is not None
    size, u, v, low, high = best
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
