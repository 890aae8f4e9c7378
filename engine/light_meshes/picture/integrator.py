"""Tracing all rays of a tile at once, in waves: hit, shade, reflect and pass through."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..film.passes import TRANSMITTED, Tile
from ..rays.camera import camera_rays, depth
from ..rays.geometry import Hits
from ..rays.tracer import Pixels
from ..shadows import blocks
from ..support.rows import taken, where
from ..surface import points, shading
from ..surface.layers import further, lit
from .frosted import BENDS, frosted
from .patched import patched
from .prepared import Prepared
from .reflections import background, going, reflected, softened
from .wave import Rays, beside_each_other, brightest, joined

# Surfaces that a ray meets at most, also those that have no effect. Where two faces of a body meet, a ray along one of
# them could else, by rounding, meet both again and again.
LONGEST = 1024
PIECE = 1 << 16  # rays that are shaded at once where they spread out
Box = tuple[int, int, int, int]  # pixels x0, y0, x1, y1

# The passes of the first surface that a camera ray sees: (n, channels).
_AT_FIRST: dict[str, Callable[[Prepared, Hits], NDArray]] = {
    "Depth": lambda ready, hits: depth(ready.scene.camera, hits.P)[:, None],
    "Position": lambda ready, hits: hits.P,
    "Normal": lambda ready, hits: hits.Ns,
    "UV": lambda ready, hits: np.concatenate([hits.uv, np.ones((len(hits.uv), 1))], axis=1),
    "Object Index": lambda ready, hits: ready.numbers.object_index[ready.world.owner(hits.triangle), None],
    "Material Index": lambda ready, hits: ready.numbers.material_index[hits.material, None],
}


def radiance(ready: Prepared, box: Box, check: Callable[[], None]) -> tuple[Tile, Box]:
    """Return the samples of the pixels `box` (x0, y0, x1, y1), perhaps with some around, and which pixels they are."""
    scene, samples = ready.scene, len(ready.offsets)
    if ready.plan.blocks:
        box = blocks.whole(box, scene.camera.width, scene.camera.height, samples)
    with ready.stats.stage("camera rays"):
        origin, direction, far = camera_rays(scene.camera, box, ready.offsets)
        n = len(origin)
        pixel = np.arange(n)
        if ready.plan.blocks:
            pixel = blocks.ordered(box, samples)
            origin, direction, far = (taken(a, pixel) for a in (origin, direction, far))
    reach: NDArray | None = far
    first: Box | None = box
    tile = Tile(ready.passes, n)
    rays = Rays(pixel, np.ones((n, 3)), origin, direction, np.zeros(n, np.int16))
    if ready.plan.transparent:
        rays = rays._replace(clear=np.ones(n, np.bool_), media=ready.glass.around(origin),
                             mirrored=np.zeros(n, np.int16))
    if ready.glass.stacks is not None:
        rays = rays._replace(start=origin, last=np.full(n, -1, np.int32))
    spreads = ready.plan.blurred or ready.plan.frosted
    if spreads:
        rays = rays._replace(fan=(-1 - pixel % samples).astype(np.int32), blur=np.zeros(n))
    if tile.parts:
        rays = rays._replace(part=np.zeros(n, np.int8))  # DIRECT
    if tile.layers:
        rays = rays._replace(left=np.ones(n))
    ready.stats.add(camera_rays=n)
    waves: dict[str, Rays] = {"camera": rays}
    del rays, origin, direction, far
    for _ in range(LONGEST):  # until no ray is left, at most
        if not waves:
            break
        next_waves: dict[str, list[Rays]] = {}
        for kind in tuple(waves):
            pieces = [waves.pop(kind)]  # nothing else keeps rays that are traced, which are much of a tile's memory
            if spreads and first is None:
                pieces = pieces.pop().pieces(PIECE)
            while pieces:
                check()
                for child_kind, child in _wave(ready, kind, pieces.pop(0), reach, first, tile, check):
                    next_waves.setdefault(child_kind, []).append(child)
                    ready.stats.add(secondary_rays=len(child.pixel))
            reach = first = None
        waves = {kind: joined(children) for kind, children in next_waves.items()}
    return tile, box


def _wave(ready: Prepared, kind: str, rays: Rays, reach: NDArray | None, first: Box | None,
          tile: Tile, check: Callable[[], None]) -> list[tuple[str, Rays]]:
    """Trace and shade rays of one kind. Returns the rays that go on, by kind. `first` is the tile if these are its
    camera rays.
    """
    plan = ready.plan
    with ready.stats.stage("camera rays" if kind == "camera" else "secondary rays"):
        passed = None if rays.start is None or rays.last is None else (rays.start, rays.last)
        pixels = Pixels(rays.pixel, first[0], first[2] - first[0], len(ready.offsets)) if first else None
        hit, hits = ready.world.closest(kind, rays.origin, rays.direction, rays.normal, reach, passed=passed,
                                        pixels=pixels)
    _add_lamps(ready, kind, rays, hit, hits, tile)
    origin, leaves = rays.origin, rays.normal is not None
    if len(hits.P) < len(hit):
        _missed(ready, kind, rays.at(where(hit, False)), tile)
        rays = rays.met(where(hit), hits.P)
    else:
        rays = rays.met(None, hits.P)
    if plan.transparent and leaves:
        rays = rays.not_back(origin[hit])
    with ready.stats.stage("programs"):
        hits = ready.world.look(hits, rays.direction, _kinds(kind, rays))
    if plan.patches and rays.blur is not None and kind == "reflection":
        rays, hits = patched(ready, rays, hits, origin[hit], tile, check)
    if not first and ready.lighting.together:
        order = beside_each_other(hits.P, ready.surfaces.centre, ready.surfaces.scale)
        rays, hits = rays.at(order), hits.at(order)
    if plan.shares and first:
        hits = hits._replace(sample=_samples(ready, rays.pixel, first))
        if plan.blocks:
            samples = len(ready.offsets)
            hits = hits._replace(block=blocks.places(rays.pixel // samples, first, samples))
    children: list[tuple[str, Rays]] = []
    if kind == "camera" and (plan.holdouts or plan.catchers):
        rays, hits, children = _not_there(ready, rays, hits, tile, check)
    if not plan.transparent:
        seen = _shade(ready, kind, rays, rays.weight, hits, first, tile, check)
        if kind == "camera":
            _first(ready, tile, rays.pixel, hits, seen)
            _layer(ready, tile, rays, hits, np.ones(len(hits.P)))
        if plan.reflections or plan.blurred:
            mirror = taken(hits.table.mirror, hits.row.astype(np.int64))
            children += reflected(ready, rays, hits, rays.weight, mirror, rays.depth, tile)
            for rows, layer in further(hits) if plan.layers else ():
                own = rays.at(rows)
                children += reflected(ready, own, layer, own.weight, layer.table.mirror[layer.row], own.depth, tile)
        return children
    return children + _pass_through(ready, kind, rays, hits, first, tile, check)


def _missed(ready: Prepared, kind: str, miss: Rays, tile: Tile) -> None:
    """Add what rays that hit nothing see: the background, or nothing, where the picture stays transparent."""
    if ready.scene.settings.film_transparent and kind == "camera":
        lost = np.ones(len(miss.pixel), np.bool_) if miss.clear is None else miss.clear
        tile.take_alpha(miss.pixel[lost], miss.weight[lost])
        miss = miss.at(~lost)
    with ready.stats.stage("sky"):
        world = background(ready, miss, _kinds(kind, miss))
    most = _brightest_seen(ready, kind, miss)
    tile.add_light(miss.pixel, miss.part, miss.weight, world, {"Environment": world}, most)


def _pass_through(ready: Prepared, kind: str, rays: Rays, hits: Hits, first: Box | None, tile: Tile,
                  check: Callable[[], None]) -> list[tuple[str, Rays]]:
    """Shade where surfaces may let rays through; returns the rays that go on: past, through, and mirrored."""
    media, mirrored = rays.media, rays.mirrored
    assert rays.clear is not None and media is not None and mirrored is not None
    children: list[tuple[str, Rays]] = []
    alpha = ready.glass.alpha(hits)
    face = ready.glass.interface(hits, rays.direction, media)
    solid = np.flatnonzero((alpha > 0) & face.real)
    share = rays.weight * np.where(face.real, alpha, 0)[:, None]
    shadows = _shade(ready, kind, rays.at(solid), share[solid], hits.at(solid), first, tile, check)
    new = rays.clear[solid] & (alpha[solid] >= 0.5) & ~tile.seen[rays.pixel[solid]]
    _first(ready, tile, rays.pixel[solid][new], hits.at(solid[new]),
           {name: values[new] for name, values in shadows.items()})
    through = rays.seen_as(TRANSMITTED)._replace(media=face.media, clear=np.zeros_like(rays.clear))
    if rays.left is not None and kind == "camera":
        there = np.where(face.real, alpha, 0)
        behind = ready.glass.seen_through(hits)
        _layer(ready, tile, rays, hits, there * (1 - behind))
        through = through._replace(left=rays.left * there * behind)
        rays = rays._replace(left=rays.left * (1 - there))
    # These surfaces have no effect: cut-outs, and interfaces inside a medium of higher priority.
    unseen = rays._replace(media=np.where(face.real[:, None], media, face.media))
    children += going(ready, kind, unseen, hits, rays.weight - share, rays.direction, 0)
    if ready.plan.frosted:
        children += frosted(ready, rays, through, hits, share, face)
    straight = ~face.bends | (rays.depth >= BENDS)
    passed = share * face.kt
    children += going(ready, kind, through, hits, np.where(straight[:, None], passed, 0), rays.direction, 0)
    children += going(ready, "reflection", through, hits, np.where(straight[:, None], 0, passed), face.refracted, 1)
    if ready.plan.reflections or ready.plan.blurred:
        # If no light passes, light does not divide further, and only mirrors count for the depth.
        events = np.where(passed.any(1), rays.depth, mirrored)
        bounced, some, mirror = rays._replace(clear=np.zeros_like(rays.clear)), hits, face.mirror
        if len(solid) < len(share):  # what is not there reflects nothing
            bounced, some, (share, mirror, events) = bounced.at(solid), hits.at(solid), (
                taken(a, solid) for a in (share, mirror, events))
        children += reflected(ready, bounced, some, share, mirror, events, tile)
        for rows, layer in further(some) if ready.plan.layers else ():
            children += reflected(ready, bounced.at(rows), layer, share[rows], layer.table.mirror[layer.row],
                                  events[rows], tile)
    return children


def _add_lamps(ready: Prepared, kind: str, rays: Rays, hit: NDArray[np.bool_], hits: Hits, tile: Tile) -> None:
    """Add the light of lamps that rays see before the surface that they hit, if any."""
    lamps, kinds = ready.lamps, _kinds(kind, rays) if ready.lamps.by else None
    if kinds is None or not (np.left_shift(1, kinds) & lamps.by).any():
        return
    weight = rays.weight
    if rays.blur is not None:  # rough surfaces have highlights of lamps instead
        weight = np.where(rays.blur[:, None] > 0, 0.0, weight)
    far = np.full(len(hit), np.inf)
    far[hit] = np.einsum("ni,ni->n", hits.P - rays.origin[hit], rays.direction[hit])
    light = lamps.light(rays.origin, rays.direction, far, kinds)
    rows = np.flatnonzero(light.any(1) & weight.any(1))
    if len(rows):
        seen = rays.at(rows)
        tile.add_light(seen.pixel, seen.part, weight[rows], light[rows], {"Emission": light[rows]},
                       _brightest_seen(ready, kind, seen))


def _brightest_seen(ready: Prepared, kind: str, rays: Rays) -> NDArray[np.float64] | float:
    """Return the same for what gives light itself. As in Cycles this has no limit (0) where the first ray sees it that
    a smooth mirror or glass sends on; else highlights of glass and plastics, which reflect little, would be grey.
    """
    most = _brightest_shown(ready, kind)
    return np.where(_first_seen(rays), 0.0, most) if most > 0 else 0.0


def _first_seen(rays: Rays) -> NDArray[np.bool_]:
    """Return which rays (n,) come from a smooth mirror or glass that the camera sees."""
    first = rays.depth <= 1
    return first if rays.blur is None else first & (rays.blur == 0)


def _brightest_shown(ready: Prepared, kind: str) -> float:
    """Return how bright light may be that rays of this kind see: what mirrors and glass show has a limit."""
    return 0.0 if kind == "camera" else ready.scene.settings.clamp_indirect


def _kinds(kind: str, rays: Rays) -> NDArray[np.int8]:
    """Return what rays (n,) are to programs of materials."""
    if kind == "camera":
        return np.full(len(rays.pixel), points.CAMERA, np.int8)
    if rays.mirrored is not None:
        return np.where(rays.mirrored > 0, points.REFLECTED, points.TRANSMITTED).astype(np.int8)
    return np.full(len(rays.pixel), points.REFLECTED, np.int8)


def _shade(ready: Prepared, kind: str, rays: Rays, weight: NDArray, hits: Hits, first: Box | None, tile: Tile,
           check: Callable[[], None]) -> dict[str, NDArray]:
    """Add the light of the surfaces that rays hit. Returns the shadow passes there. `first` is as in `_wave`."""
    work = tile.work(len(weight))
    layers = [] if not ready.plan.layers else lit(
        [(rows, softened(ready, rays.at(rows), layer, kind == "camera")) for rows, layer in further(hits)],
        rays.direction, ready.world.textures)
    hits = softened(ready, rays, hits, kind == "camera")
    if ready.plan.shares:
        hits = hits._replace(apart=_apart(ready, rays, hits), weight=brightest(weight))
    if first and ready.sparse:
        light = ready.sparse.direct(hits, rays.direction, rays.pixel, first, check, tile.parts, work, layers)
    else:
        light = ready.lighting.direct(hits, rays.direction, check, tile.parts, kind == "camera", work, layers)
    most, colour = _brightest_shown(ready, kind), light.colour
    if most > 0:
        rows = np.flatnonzero(_first_seen(rays) & hits.table.emission[hits.row].any(1))
        if len(rows):
            own = hits.table.emission[hits.row[rows]]
            colour[rows] -= own
            tile.add_light(rays.pixel[rows], None if rays.part is None else rays.part[rows], weight[rows], own, {})
    tile.add_light(rays.pixel, rays.part, weight, colour, light.terms, most)
    tile.add_work(rays.pixel, work)
    if ready.plan.translucent:
        _shine_through(ready, kind, rays, weight, hits, tile, check)
        for layer in layers:
            _shine_through(ready, kind, rays.at(layer.rows), weight[layer.rows], layer.hits, tile, check)
    return light.shadows


def _apart(ready: Prepared, rays: Rays, hits: Hits) -> NDArray[np.float64]:
    """Return how far apart hits are, as in `Hits.apart`: the rays of neighbouring samples are as far apart, and mirrors
    do not change this.
    """
    camera = ready.scene.camera
    left, right, bottom, top = camera.window
    step = max((right - left) / camera.width, (top - bottom) / camera.height) / np.sqrt(len(ready.offsets))
    far = np.full(len(hits.P), step)
    if camera.perspective:
        far *= np.sqrt(((hits.P - camera.matrix[:3, 3])**2).sum(1))
    return far if rays.blur is None else np.where(rays.blur > 0, np.inf, far)


def _samples(ready: Prepared, pixel: NDArray[np.int64], box: Box) -> NDArray[np.int64]:
    """Return `Hits.sample` of the first surfaces that the samples `pixel` (n,) of a tile see."""
    number, sample = np.divmod(pixel, len(ready.offsets))
    y, x = np.divmod(number, box[2] - box[0])
    return np.stack([(box[1] + y) * ready.scene.camera.width + box[0] + x, sample], axis=1)


def _shine_through(ready: Prepared, kind: str, rays: Rays, weight: NDArray, hits: Hits, tile: Tile,
                   check: Callable[[], None]) -> None:
    """Add the light that comes through surfaces scattered: that of a matt surface on their other side."""
    rows = np.flatnonzero((hits.table.translucent[hits.row] > 0).any(1))
    if not len(rows):
        return
    some = hits.at(rows)
    Ns = shading.mirroring(some, rays.direction[rows])
    back = some._replace(Ng=-some.Ng, Ns=-Ns, front=~some.front, table=hits.table.behind(),
                         smooth=None if some.smooth is None else -some.smooth,
                         displaced=None if some.displaced is None else -some.displaced)
    work = tile.work(len(rows))
    light = ready.lighting.direct(back, rays.direction[rows], check, tile.parts, False, work)
    tile.add_light(rays.pixel[rows], None if rays.part is None else rays.part[rows], weight[rows], light.colour,
                   light.terms, _brightest_shown(ready, kind))
    tile.add_work(rays.pixel[rows], work)


def _not_there(ready: Prepared, rays: Rays, hits: Hits, tile: Tile,
               check: Callable[[], None]) -> tuple[Rays, Hits, list[tuple[str, Rays]]]:
    """Remove the camera rays that hit a holdout, and those that hit a shadow catcher; the latter see the background,
    dimmed, and nothing that is behind the catcher.

    Returns the remaining hits, and the rays that go on: through cut-outs.
    """
    owner, alpha = ready.world.owner(hits.triangle), ready.glass.alpha(hits)[:, None]
    holdout = ready.numbers.holdout[owner]
    catcher = np.flatnonzero(ready.numbers.catcher[owner] & ~holdout)
    tile.take_alpha(rays.pixel[holdout], (rays.weight * alpha)[holdout])
    if len(catcher):
        assert ready.alone is not None
        work, caught = tile.work(len(catcher)), rays.at(catcher)
        share = ready.alone.ratio(ready.lighting, hits.at(catcher), caught.direction, check, work)
        tile.add_work(caught.pixel, work)
        _missed(ready, "camera", caught._replace(weight=caught.weight * alpha[catcher] * share), tile)
    gone = ready.numbers.holdout[owner] | ready.numbers.catcher[owner]
    if rays.left is not None:
        rays = rays._replace(left=np.where(holdout, rays.left * (1 - alpha[:, 0]), rays.left))
    weight = (rays.weight * (1 - alpha))[gone]
    children = going(ready, "camera", rays.at(gone), hits.at(gone), weight, rays.direction[gone], 0)
    return rays.at(~gone), hits.at(~gone), children


def _first(ready: Prepared, tile: Tile, pixel: NDArray, hits: Hits, shadows: dict[str, NDArray]) -> None:
    """Fill the passes of the first surface that a camera ray sees."""
    if ready.plan.transparent:
        tile.seen[pixel] = True
    for name, samples in tile.samples.items():
        if name in _AT_FIRST:
            samples[pixel] = _AT_FIRST[name](ready, hits)
        elif name in shadows:
            samples[pixel] = shadows[name]


def _layer(ready: Prepared, tile: Tile, rays: Rays, hits: Hits, opacity: NDArray) -> None:
    """Add what camera rays see, weighted by `opacity`, to the passes that look through surfaces."""
    if not tile.layers:
        return
    assert rays.left is not None
    coverage = rays.left * opacity
    for kind in tile.mattes.wanted:
        index = hits.material if kind == "CryptoMaterial" else ready.world.owner(hits.triangle)
        tile.mattes.add(kind, rays.pixel, ready.numbers.cryptomatte[kind][index], coverage)
    if "Mist" in tile.samples:
        s = ready.scene.settings
        away = np.linalg.norm(hits.P - ready.scene.camera.matrix[:3, 3], axis=1)
        if not ready.scene.camera.perspective:
            away = depth(ready.scene.camera, hits.P)
        mist = np.clip((away - s.mist_start) / s.mist_depth, 0, 1) if s.mist_depth > 0 else np.zeros_like(away)
        mist = mist ** {"LINEAR": 1.0, "QUADRATIC": 2.0, "INVERSE_QUADRATIC": 0.5}[s.mist_falloff]
        tile.subtract("Mist", rays.pixel, (1 - mist) * coverage)
