"""Surfaces that give light become lamps with a size: a lamp stands for a group of emitting triangles.

Light that is gathered at surfaces finds emitters with few rays only if they are large. A group that is nearly flat is a
rectangle or an ellipse of the same area, with the mean radiance of its triangles, so that its power is exact; a ball is
a sphere. The face of the lamp is in front of its triangles, which so cast no shadow in their own light. Flat things
with many edges are a face on each side, and closed bent ones many faces. The groups with most power become lamps; the
rest is gathered (docs/light.md).
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits
from ..scene.description import Light, Object, Scene
from ..support.statistics import Statistics
from ..surface.points import REFLECTED
from . import emitter_shapes as shapes
from .emitter_shapes import Emitting, Face
from .world import World, world

MOST = 64  # lamps in all, but for balls and what is bent
BALLS = 256  # things that are one lamp each, as bulbs are
TUBES = 4  # bent things
BALL, BENT, FLAT = "ball", "bent", "flat"
TRIED = 1024  # groups that are looked at
THINGS = 256  # that are looked for inside of one
SETS, BLOCKS = 8, 0.25  # see _past_themselves
SAMPLES = 1 << 18  # points where emission is looked at, of all triangles whose material has a program for it


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
    count = Counter[str]()  # of lamps, by what they stand for
    room = {BALL: BALLS, BENT: TUBES * shapes.PIECES, FLAT: MOST}
    rows_of = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
    owners = scene.geometry.instance_object[names // len(scene.materials)]
    linked = np.array([o.receivers is not None or o.blockers is not None for o in scene.objects], np.bool_)[owners]
    for g in np.lexsort((-power, ~linked))[:TRIED]:  # gathered light obeys no links
        of = found.at(rows_of[g])
        place = names[g] // len(scene.materials)
        owner, whole = int(owners[g]), len(of.triangle) == triangles[place]
        ob = scene.objects[owner]
        if count[FLAT] >= MOST and not (whole and shapes.ball(of)):  # most are neither, and this is faster
            continue
        kind, new = _group(of, ob, whole, _inside(bare, int(place), ob))
        if not new or count[kind] + len(new) > room[kind]:
            continue
        count[kind] += len(new)
        lamps += new if ob.receivers is None else [dataclasses.replace(lamp, receivers=ob.receivers) for lamp in new]
        objects += [owner] * len(new)
        taken.append(of.triangle)
    lamps = _past_themselves(lamps, np.array(objects, np.int64), scene)
    return lamps, np.concatenate(taken) if taken else np.zeros(0, np.int64), tuple(objects)


def _past_themselves(lamps: list[Light], owner: NDArray[np.int64], scene: Scene) -> list[Light]:
    """Return the lamps of objects (n,) so that no ball is in the way of the sphere that stands for it.

    Each set of blockers costs an accelerator, and each bulb's small shadow in the light of all others costs rays. So
    only objects that are large compared with the distance of the next lamp, SETS at most, have a set of their own; the
    others, if there are more, do not shade each other.
    """
    spheres = np.flatnonzero([lamp.type == "POINT" for lamp in lamps])
    own = np.unique(owner[spheres])
    place = np.array([lamp.position for lamp in lamps]).reshape(-1, 3)
    wide: dict[int, float] = {}
    for ob in own.tolist():
        mine = owner == ob
        middle = (place[mine].min(0) + place[mine].max(0)) / 2
        reach = (np.linalg.norm(place[mine] - middle, axis=1) + [lamps[i].radius for i in np.flatnonzero(mine)]).max()
        wide[ob] = reach / max(np.linalg.norm(place[~mine] - middle, axis=1).min(initial=np.inf), 1e-300)
    alone = [ob for ob in sorted(wide, key=lambda ob: -wide[ob])[:SETS] if wide[ob] > BLOCKS or len(own) <= SETS]
    sets = [*({ob} for ob in alone), set(own.tolist()) - set(alone)]
    out = list(lamps)
    for those in sets:
        blockers: dict[tuple[int, ...] | None, tuple[int, ...]] = {}
        for i in spheres[np.isin(owner[spheres], list(those))].tolist():
            every = lamps[i].blockers
            if every not in blockers:
                blockers[every] = tuple(o for o in (range(len(scene.objects)) if every is None else every)
                                        if o not in those)
            out[i] = dataclasses.replace(lamps[i], blockers=blockers[every])
    return out


class Group(NamedTuple):
    """The lamps of a group of triangles."""

    kind: str  # BALL, BENT or FLAT
    lamps: list[Light]


def _inside(bare: World, instance: int, ob: Object) -> NDArray[np.float64]:
    """Return points (n,3) of what is seen, if it is inside of this instance: the camera, and other things behind
    what the camera does not see.
    """
    eye = bare.camera.matrix[None, :3, 3]
    if ob.visible_camera:
        return eye
    s = bare.surfaces
    first = np.flatnonzero(np.diff(s.instance, prepend=-1))
    first = first[s.instance[first] != instance][:THINGS]
    return np.concatenate([eye, s.vertices[s.triangles[first, 0]].astype(np.float64) * s.scale + s.centre])


def _group(of: Emitting, ob: Object, whole: bool, inside: NDArray[np.float64]) -> Group:
    """Return the lamps of a group of triangles of an object; none for a room. whole: the object has no other
    triangles. inside (n,3): see `_inside`.
    """
    closed, middles = shapes.closed(of.corners), of.corners.mean(1)
    if closed and of.area @ np.einsum("ni,ni->n", of.normal, middles - middles[0]) < 0:
        of = of._replace(normal=-of.normal)  # the mesh is inside out
    if closed and shapes.around(of, inside):  # both sides shine, and so large a thing is gathered well
        return Group(FLAT, [])
    parts = shapes.parts(of, BALLS) if closed and whole else []
    balls = [(part, shapes.ball(part)) for part in parts]
    if balls and all(ball for _, ball in balls):
        return Group(BALL, [Light(f"{ob.name} (emission)", "POINT", _rgb((part.area @ part.radiance) / (4 * np.pi)),
                                  _rgb(ball[0]), radius=ball[1], softness="SIZE", blockers=ob.blockers)
                            for part, ball in balls if ball])
    faces = shapes.divided(of, shapes.FEW if closed else MOST)
    sign = shapes.sign(of) if len(faces) > shapes.FEW else None
    if sign is not None:
        return Group(FLAT, [lamp for side in (1.0, -1.0) for lamp in _faces(of, ob, [sign], side, closed)])
    if closed and len(faces) > shapes.FEW:
        return Group(BENT, list(_faces(of, ob, shapes.pieces(of, shapes.PIECES), 1.0)))
    return Group(FLAT, [lamp for side in ((1.0,) if closed else (1.0, -1.0)) for lamp in _faces(of, ob, faces, side)])


def _faces(of: Emitting, ob: Object, faces: Iterable[Face], side: float, half: bool = False) -> Iterator[Light]:
    """Return the lamps of faces; side: −1 for their backs. half: they have only half of the power."""
    for face in faces:
        part, N = of.at(face.rows), side * face.normal
        share = 0.5 if half else 1.0
        intensity = share * (part.area[:, None] * part.radiance).sum(0) / np.pi  # of all power, if it is bent, too
        front = float(((part.corners.reshape(-1, 3) - face.centre) @ N).max())
        front += 1e-4 * float(np.linalg.norm(face.u))
        yield Light(f"{ob.name} (emission)", "AREA", _rgb(intensity),
                    _rgb(face.centre + front * N), _rgb(N), area_u=_rgb(face.u), area_v=_rgb(side * face.v),
                    area_ellipse=face.ellipse, softness="SIZE", blockers=ob.blockers)


def _rgb(values: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
