"""The light that surfaces reflect of their surroundings: mirrors by one ray, rough surfaces by a few rays, and an
estimate for the directions that no ray follows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..film.passes import REFLECTED, Tile
from ..gathered.records import Lobe
from ..rays.geometry import Hits
from ..support.rows import taken, where
from ..surface import curvature, shading
from ..surface.blurred import spread
from ..surface.shading import Materials
from .lighting import FAN
from .prepared import Prepared
from .wave import Rays, brightest

LOBE = np.pi / 8  # by α²: the solid angle of the sky for which a ray of a lobe stands, steradians


def reflected(ready: Prepared, rays: Rays, hits: Hits, weight: NDArray, mirror: NDArray, events: NDArray,
              tile: Tile) -> list[tuple[str, Rays]]:
    """Return the rays that surfaces reflect, of rays (n,) that count there with weight (n,3).

    mirror (n,3): the share that mirrors reflect. events (n,): how often rays were reflected, or bent, where that
    counts: max_depth bounds it, so that light does not divide for ever.
    """
    may = (events < ready.scene.settings.max_depth) & ready.plan.reflections
    if not ready.plan.blurred:
        return mirrored(ready, rays, hits, weight * mirror, may)
    lobes = hits.table.blurred[hits.row]
    rows = np.flatnonzero(lobes)
    children = mirrored(ready, rays, hits, np.where(lobes[:, None], 0.0, weight * mirror), may)
    return children + _blurred(ready, rays.at(rows), hits.at(rows), weight[rows], may[rows] & ready.plan.follows, tile)


def mirrored(ready: Prepared, rays: Rays, hits: Hits, weight: NDArray, may: NDArray) -> list[tuple[str, Rays]]:
    """Return the rays that mirrors reflect with weight (n,3), of those that may (n,) go on."""
    on = where((brightest(weight) > least(ready, rays)) & may)
    if not len(on):
        return []
    rays, (P, triangle, weight, normal, Ns) = rays.at(on), (
        taken(a, on) for a in (hits.P, hits.triangle, weight, hits.Ng, hits.Ns))
    turned = np.empty((len(normal), 3))
    shading.mirrored(rays.direction, normal, Ns, turned)
    rays = _once_more(rays.seen_as(REFLECTED))
    return [("reflection", leaving(rays, P, triangle, weight, normal, turned, 1))]


def least(ready: Prepared, rays: Rays) -> NDArray[np.float64] | float:
    """Return the weight below which rays that leave surfaces are not sent, one for each of rays (n,) if they differ.

    A ray of a rough surface is one of many, which together count as much as a mirror's one.
    """
    cutoff = ready.scene.settings.cutoff
    return cutoff if rays.fan is None else np.where(rays.fan < 0, cutoff, cutoff / FAN)


def upwards(ready: Prepared) -> NDArray[np.float64]:
    """Return the unit vector (3,) that goes up in the picture."""
    up = ready.scene.camera.matrix[:3, 1]
    return np.ascontiguousarray(up / np.linalg.norm(up))


def _blurred(ready: Prepared, rays: Rays, hits: Hits, weight: NDArray, may: NDArray,
             tile: Tile) -> list[tuple[str, Rays]]:
    """Return the rays that lobes of microfacets reflect. For what they do not follow the mean of what is around is
    added.
    """
    if not len(rays.pixel):
        return []
    settings = ready.scene.settings
    hits = hits._replace(Ns=shading.mirroring(hits, rays.direction))
    assert rays.fan is not None and rays.blur is not None
    found = spread(hits, rays.direction, weight, rays.fan, rays.depth, may, upwards(ready), len(ready.offsets),
                   settings.reflection_rays, settings.cutoff, settings.cutoff / FAN)
    rest = np.flatnonzero(found.left.any(1))
    if len(rest):
        light = found.left[rest] * _around(ready, hits.at(rest), rays.direction[rest], found.rough[rest])
        name = "Ambient" if ready.lighting.everywhere is None else "Glossy"
        part = None if rays.part is None else rays.part[rest]
        tile.add_light(rays.pixel[rest], part, weight[rest], light, {name: light})
    sent = where(brightest(found.weight) > 0)
    if not len(sent):
        return []
    rows, fan, blur, weight, turned = (taken(a, sent) for a in (
        found.hit, found.fan, found.blur, found.weight, found.direction))
    children = _once_more(rays.seen_as(REFLECTED).at(rows))
    assert children.blur is not None
    children = children._replace(fan=fan, blur=np.maximum(children.blur, blur))
    P, triangle, Ng = (taken(a, rows) for a in (hits.P, hits.triangle, hits.Ng))
    return [("reflection", leaving(children, P, triangle, weight, Ng, turned, 1))]


def _around(ready: Prepared, hits: Hits, direction: NDArray, roughness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the radiance (n,3) around hits of rays along `direction`, for what no ray follows: the mean of what is
    gathered there over the lobe of this roughness (n,), or else the world's light, as if nothing stood before it.
    """
    if ready.lighting.everywhere is not None:
        return ready.lighting.everywhere(hits, lambda: None, Lobe(direction, np.square(roughness))).light
    turned = np.empty_like(hits.P)
    shading.mirrored(direction, hits.Ng, hits.Ns, turned)
    settings = ready.scene.settings
    ambient = 1.0 if settings.by_sky else settings.ambient
    return ambient * np.broadcast_to(ready.world.sky.light(turned), turned.shape)


def _once_more(rays: Rays) -> Rays:
    """Return rays that are mirrored once more."""
    return rays if rays.mirrored is None else rays._replace(mirrored=rays.mirrored + np.int16(1))


def going(ready: Prepared, kind: str, rays: Rays, hits: Hits, weight: NDArray, direction: NDArray,
          step: int) -> list[tuple[str, Rays]]:
    """Return the rays that go on through the surface with `weight`; step: 1 where they bend."""
    on = where(brightest(weight) > least(ready, rays))
    if not len(on):
        return []
    P, triangle, weight, Ng, direction = (taken(a, on) for a in (hits.P, hits.triangle, weight, hits.Ng, direction))
    some, normal = rays.at(on), -Ng
    if step == 0 and some.behind is not None:  # beyond both surfaces
        P, normal = (np.where(some.behind[:, None], a, b) for a, b in ((some.origin, P), (direction, normal)))
    return [(kind, leaving(some, P, triangle, weight, normal, direction, step))]


def leaving(rays: Rays, P: NDArray, triangle: NDArray, weight: NDArray, normal: NDArray, direction: NDArray,
            step: int) -> Rays:
    """Return the rays that leave surfaces at P on the side of `normal`. step: 1 where they bend."""
    if rays.start is not None:
        straight = (direction == rays.direction).all(1, keepdims=True)
        rays = rays._replace(start=np.where(straight, rays.start, P), last=triangle)
    return rays._replace(weight=weight, origin=P, normal=normal, direction=direction, depth=rays.depth + np.int16(step),
                         behind=None)


def softened(ready: Prepared, rays: Rays, hits: Hits, seen: bool) -> Hits:
    """Return what rays (n,) hit, as the light of lamps is seen there: highlights are wider that few samples would miss.

    seen: by camera rays; then those where the surface turns much within a pixel. And of rays that a rough surface has
    spread out those that are smaller than the lobe; and there surfaces do not shine for which lamps stand, as these
    have highlights of their own.
    """
    m, row = hits.table, hits.row
    turns = None
    if seen and ready.curved is not None:
        share = min(1.0, ready.scene.settings.filter_size) / len(ready.offsets)**0.5
        turns = curvature.variance(ready.curved, ready.scene.camera, share, hits, rays.direction)
    if rays.blur is None and turns is None:
        return hits
    new = [r[row] for r in (m.roughness, m.coat_roughness)]
    if turns is not None:
        new = [curvature.widened(r, turns) for r in new]
    if rays.blur is not None:
        new = [np.maximum(r, rays.blur) for r in new]
    wider = m.ggx[row] & ((new[0] != m.roughness[row]) | ((new[1] != m.coat_roughness[row]) & (m.coat > 0)[row]))
    dark = np.zeros(len(row), np.bool_)
    if ready.world.as_lamps is not None and rays.blur is not None:
        dark = (rays.blur > 0) & ready.world.as_lamps[hits.triangle]
    rows = np.flatnonzero(wider | dark)
    if not len(rows):
        return hits
    blur = rays.blur[rows] if turns is None and rays.blur is not None else None
    table, own, at = _own_rows(m, row, rows, blur, dark[rows])
    if turns is not None:  # of the camera's rays: lobes as smooth as mirrors still show lamps as they are
        base, coat = (r[row] < shading.SMOOTHEST for r in (m.roughness, m.coat_roughness))
        table.mirroring[at] = (base + 2 * coat)[rows]
    table.roughness[at], table.coat_roughness[at] = new[0][rows], new[1][rows]
    table.emission[at[dark[rows]]] = 0.0
    return hits._replace(row=own, table=table)


def _own_rows(m: Materials, row: NDArray[np.int32], rows: NDArray[np.int64], blur: NDArray[np.float64] | None,
              dark: NDArray[np.bool_]) -> tuple[Materials, NDArray[np.int32], NDArray[np.int64]]:
    """Return a table of materials in which these of the hits (k,), which have the rows `row` (n,) of m, have rows that
    others do not use, which they may change; the rows (n,) of all hits there, and those of the chosen (k,).

    blur and dark (k,): hits of one material that agree in both are changed alike, and may share a row; no blur: none
    do. The table is small, as far as that goes: copying its many columns takes longer than most that is done with it.
    """
    own, count = row[rows].astype(np.int64), len(m.ka)
    if (np.bincount(row, minlength=count)[own] == 1).all():  # they have already, of a program
        return m._replace(roughness=m.roughness.copy(), coat_roughness=m.coat_roughness.copy(),
                          mirroring=m.mirroring.copy(), emission=m.emission.copy()), row, own
    index, number = own, np.arange(len(own))
    if blur is not None and 2 * len(values := np.unique(blur)) * count < len(own):
        key = (2 * np.searchsorted(values, blur) + dark) * count + own
        there = np.zeros(2 * len(values) * count, np.bool_)
        there[key] = True
        index, number = np.flatnonzero(there) % count, (np.cumsum(there) - 1)[key]
    of, at, row = np.concatenate([np.arange(count), index]), count + number, row.copy()
    row[rows] = at
    return Materials._make(taken(column, of) for column in m), row, at


def background(ready: Prepared, rays: Rays, ray: NDArray[np.int8]) -> NDArray[np.float64]:
    """Return the radiance (n,3), or one row (3,), that rays of these kinds (n,) see which miss all surfaces.

    Those of rough surfaces see what lights surfaces, as blurred as their rays are apart: lamps that stand for the
    world's suns have highlights of their own.
    """
    sky = ready.world.sky
    seen = sky.seen(rays.direction, ray)
    if not sky.varies or rays.blur is None or not (rays.blur > 0).any():
        return seen
    rows, seen = np.flatnonzero(rays.blur > 0), np.array(seen)
    seen[rows] = sky.light(rays.direction[rows], LOBE * rays.blur[rows]**4)
    return seen
