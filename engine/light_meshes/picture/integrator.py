"""The wave of rays: hit, see, shade, reflect and pass through, for all rays of a tile at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..film.passes import REFLECTED, TRANSMITTED, Tile
from ..rays.camera import camera_rays, depth
from ..rays.geometry import Hits
from ..surface import shading
from .prepared import Prepared

BENDS = 64  # at which a ray through glass bends; at more surfaces it goes straight on
Rays = dict[str, NDArray]  # pixel, weight, origin, direction, …: the rows of each array belong together
Box = tuple[int, int, int, int]  # pixels x0, y0, x1, y1

# The passes of the first surface that a camera ray sees: (n, channels).
_AT_FIRST: dict[str, Callable[[Prepared, Hits], NDArray]] = {
    "Depth": lambda ready, hits: depth(ready.scene.camera, hits.P)[:, None],
    "Position": lambda ready, hits: hits.P,
    "Normal": lambda ready, hits: hits.Ns,
    "UV": lambda ready, hits: np.concatenate([hits.uv, np.ones((len(hits.uv), 1))], axis=1),
    "Object Index": lambda ready, hits: ready.object_index[ready.owner(hits.triangle), None],
    "Material Index": lambda ready, hits: ready.material_index[hits.material, None],
}


def radiance(ready: Prepared, box: Box, check: Callable[[], None]) -> dict[str, NDArray]:
    """All passes of the tile `box` (x0, y0, x1, y1): (height, width, channels)."""
    scene = ready.scene
    with ready.stats.stage("camera rays"):
        origin, direction, far = camera_rays(scene.camera, box, ready.offsets)
    reach: NDArray | None = far
    first: Box | None = box
    n = len(origin)
    tile = Tile(ready.passes, n)
    rays: Rays = {"pixel": np.arange(n), "weight": np.ones((n, 3)), "origin": origin, "direction": direction,
                  "depth": np.zeros(n, np.int16)}
    if ready.plan.transparent:
        # Straight through all surfaces so far; the bodies it is in, −1: none; of its bends (depth) those at mirrors.
        rays |= {"clear": np.ones(n, np.bool_), "media": ready.glass.around(origin),
                 "mirrored": np.zeros(n, np.int16)}
    if ready.glass.stacks is not None:  # where it began to go straight on, and the triangle that it met last
        rays |= {"start": origin, "last": np.full(n, -1, np.int32)}
    if tile.parts:
        rays["part"] = np.zeros(n, np.int8)  # DIRECT
    if tile.layers:
        rays["left"] = np.ones(n)  # of the sample, after what it saw so far and saw through
    ready.stats.add(camera_rays=n)
    waves: dict[str, Rays] = {"camera": rays}
    while waves:
        next_waves: dict[str, list[Rays]] = {}
        for kind, rays in waves.items():
            check()
            for child_kind, child in _wave(ready, kind, rays, reach, first, tile, check):
                next_waves.setdefault(child_kind, []).append(child)
                ready.stats.add(secondary_rays=len(child["pixel"]))
            reach = first = None
        waves = {kind: _joined(children) for kind, children in next_waves.items()}
    return {name: tile.developed(name, box, len(ready.offsets)) for name in ready.passes}


def _wave(ready: Prepared, kind: str, rays: Rays, reach: NDArray | None, first: Box | None,
          tile: Tile, check: Callable[[], None]) -> list[tuple[str, Rays]]:
    """Trace and shade rays of one kind; returns the rays that go on, by kind. first: the tile, where it begins."""
    settings, plan = ready.scene.settings, ready.plan
    with ready.stats.stage("camera rays" if kind == "camera" else "secondary rays"):
        hit, hits = ready.closest(kind, rays["origin"], rays["direction"], rays.get("normal"), reach,
                                  passed=(rays["start"], rays["last"]) if "last" in rays else None)
    rays = {name: a for name, a in rays.items() if name not in ("origin", "normal")}  # done with
    if not hit.all():
        miss = _rows({name: rays[name] for name in ("pixel", "weight", "clear", "part") if name in rays}, ~hit)
        if settings.film_transparent and kind == "camera":
            lost = miss["clear"] if "clear" in miss else np.ones(len(miss["pixel"]), np.bool_)
            tile.take_alpha(miss["pixel"][lost], miss["weight"][lost])
            miss = _rows(miss, ~lost)
        world = np.array(ready.scene.world_color)
        tile.add_light(miss, miss["weight"], world, {"Environment": world})
        rays = _rows(rays, hit)
    children: list[tuple[str, Rays]] = []
    if kind == "camera" and (plan.holdouts or plan.catchers):
        rays, hits, children = _not_there(ready, rays, hits, tile, check)
    if not plan.transparent:
        seen = _shade(ready, kind, rays, rays["weight"], hits, first, tile, check)
        if kind == "camera":
            _first(ready, tile, rays["pixel"], hits, seen)
            _layer(ready, tile, rays, hits, np.ones(len(hits.P)))
        if plan.reflections:
            bounced = rays["weight"] * ready.materials.mirror[hits.material]
            children += _going(ready, "reflection", _as(REFLECTED, rays), hits, bounced, None, 1)
        return children
    alpha = ready.glass.alpha(hits)
    face = ready.glass.interface(hits, rays)
    solid = np.flatnonzero((alpha > 0) & face.real)
    share = rays["weight"] * np.where(face.real, alpha, 0)[:, None]
    shadows = _shade(ready, kind, _rows(rays, solid), share[solid], hits.at(solid), first, tile, check)
    new = rays["clear"][solid] & (alpha[solid] >= 0.5) & ~tile.seen[rays["pixel"][solid]]
    _first(ready, tile, rays["pixel"][solid][new], hits.at(solid[new]),
           {name: values[new] for name, values in shadows.items()})
    through = _as(TRANSMITTED, rays) | {"media": face.media, "clear": np.zeros_like(rays["clear"])}
    if "left" in rays and kind == "camera":
        there = np.where(face.real, alpha, 0)
        behind = ready.glass.seen_through(hits.material)
        _layer(ready, tile, rays, hits, there * (1 - behind))
        through["left"] = rays["left"] * there * behind
        rays = rays | {"left": rays["left"] * (1 - there)}
    # What is not there: cut-outs, and interfaces inside a medium of higher priority.
    unseen = rays | {"media": np.where(face.real[:, None], rays["media"], face.media)}
    children += _going(ready, kind, unseen, hits, rays["weight"] - share, rays["direction"], 0)
    straight = ~face.bends | (rays["depth"] >= BENDS)
    passed = share * face.kt
    children += _going(ready, kind, through, hits, np.where(straight[:, None], passed, 0), rays["direction"], 0)
    children += _going(ready, "reflection", through, hits, np.where(straight[:, None], 0, passed), face.refracted, 1)
    if plan.reflections:
        # Where nothing passes, light divides no further: only mirrors count then.
        events = np.where(passed.any(1), rays["depth"], rays["mirrored"])
        reflected = _as(REFLECTED, rays) | {"clear": np.zeros_like(rays["clear"]), "events": events}
        children += _going(ready, "reflection", reflected, hits, share * face.mirror, None, 1)
    return children


def _shade(ready: Prepared, kind: str, rays: Rays, weight: NDArray, hits: Hits, first: Box | None, tile: Tile,
           check: Callable[[], None]) -> dict[str, NDArray]:
    """Add the light of surfaces that rays hit; returns the shadow passes there. first: as in `_wave`."""
    work = tile.work(len(weight))
    if first and ready.sparse:
        colour, terms, shadows = ready.sparse.direct(hits, rays["direction"], rays["pixel"], first, check, tile.parts,
                                                     work)
    else:
        colour, terms, shadows = ready.direct(hits, rays["direction"], check, tile.parts, kind == "camera", work)
    tile.add_light(rays, weight, colour, terms)
    tile.add_work(rays["pixel"], work)
    return shadows


def _not_there(ready: Prepared, rays: Rays, hits: Hits, tile: Tile,
               check: Callable[[], None]) -> tuple[Rays, Hits, list[tuple[str, Rays]]]:
    """Take out the camera rays that meet a holdout, and those that meet a shadow catcher, which go straight on, dimmed.

    Returns what is left, and the rays that go on.
    """
    owner, alpha = ready.owner(hits.triangle), ready.glass.alpha(hits)[:, None]
    holdout = ready.holdout[owner]
    catcher = np.flatnonzero(ready.catcher[owner] & ~holdout)
    tile.take_alpha(rays["pixel"][holdout], (rays["weight"] * alpha)[holdout])
    left = np.zeros_like(rays["weight"])
    if len(catcher):
        work = tile.work(len(catcher))
        left[catcher] = ready.shadow_ratio(hits.at(catcher), rays["direction"][catcher], check, work)
        tile.add_work(rays["pixel"][catcher], work)
    gone = ready.holdout[owner] | ready.catcher[owner]
    if "left" in rays:
        rays["left"] = np.where(holdout, rays["left"] * (1 - alpha[:, 0]), rays["left"])
    weight = rays["weight"] * (1 - alpha + alpha * left)  # cut-outs let pass
    children = _going(ready, "camera", _rows(rays, gone), hits.at(gone), weight[gone], rays["direction"][gone], 0)
    return _rows(rays, ~gone), hits.at(~gone), children


def _as(part: int, rays: Rays) -> Rays:
    """Rays that go on as `part`, if they have not been one yet."""
    return rays | {"part": np.where(rays["part"] == 0, np.int8(part), rays["part"])} if "part" in rays else rays


def _going(ready: Prepared, kind: str, rays: Rays, hits: Hits, weight: NDArray, direction: NDArray | None,
           step: int) -> list[tuple[str, Rays]]:
    """The rays that go on with `weight`: mirrored where direction is None, else through the surface.

    max_depth bounds what is mirrored, so that light does not divide for ever. What goes through glass goes on.
    """
    settings = ready.scene.settings
    on = weight.max(axis=1, initial=0) > settings.cutoff
    if direction is None:
        rays = dict(rays)
        on &= rays.pop("events", rays["depth"]) < settings.max_depth
    if not on.any():
        return []
    rays = _rows(rays, on)
    normal, P = hits.Ng[on], hits.P[on]
    if direction is None:
        turned = np.empty((len(normal), 3))
        if "mirrored" in rays:
            rays["mirrored"] = rays["mirrored"] + np.int16(1)
        shading.mirrored(rays["direction"], normal, hits.Ns[on], turned)
    else:
        turned, normal = direction[on], -normal
    if "last" in rays:
        straight = (turned == rays["direction"]).all(1, keepdims=True)
        rays |= {"start": np.where(straight, rays["start"], P), "last": hits.triangle[on]}
    return [(kind, rays | {"weight": weight[on], "origin": P, "normal": normal, "direction": turned,
                           "depth": rays["depth"] + np.int16(step)})]


def _first(ready: Prepared, tile: Tile, pixel: NDArray, hits: Hits, shadows: dict[str, NDArray]) -> None:
    """The passes of the first surface that a camera ray sees."""
    tile.seen[pixel] = True
    for name, samples in tile.samples.items():
        if name in _AT_FIRST:
            samples[pixel] = _AT_FIRST[name](ready, hits)
        elif name in shadows:
            samples[pixel] = shadows[name]


def _layer(ready: Prepared, tile: Tile, rays: Rays, hits: Hits, opacity: NDArray) -> None:
    """Add what camera rays see, of which `opacity` is there, to the passes that look through surfaces."""
    if not tile.layers:
        return
    coverage = rays["left"] * opacity
    for kind in tile.mattes.wanted:
        index = hits.material if kind == "CryptoMaterial" else ready.owner(hits.triangle)
        tile.mattes.add(kind, rays["pixel"], ready.cryptomatte[kind][index], coverage)
    if "Mist" in tile.samples:
        s = ready.scene.settings
        away = np.linalg.norm(hits.P - ready.scene.camera.matrix[:3, 3], axis=1)
        if not ready.scene.camera.perspective:
            away = depth(ready.scene.camera, hits.P)
        mist = np.clip((away - s.mist_start) / s.mist_depth, 0, 1) if s.mist_depth > 0 else np.zeros_like(away)
        mist = mist ** {"LINEAR": 1.0, "QUADRATIC": 2.0, "INVERSE_QUADRATIC": 0.5}[s.mist_falloff]
        tile.subtract("Mist", rays["pixel"], (1 - mist) * coverage)


def _rows(rays: Rays, rows: NDArray) -> Rays:
    """Of these rows, or where a mask is set."""
    index = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
    return {name: a.take(index, axis=0) for name, a in rays.items()}


def _joined(children: list[Rays]) -> Rays:
    if len(children) == 1:
        return children[0]
    return {name: np.concatenate([c[name] for c in children]) for name in children[0]}
