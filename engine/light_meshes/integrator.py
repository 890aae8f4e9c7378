"""The wave of rays: hit, see, shade, reflect and pass through, for all rays of a tile at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from . import interfaces, shading
from .camera import camera_rays, depth
from .compiled import kernel
from .film import NO_DEPTH
from .prepared import Prepared

Rays = dict[str, NDArray]  # pixel, weight, origin, direction, …: the rows of each array belong together


def radiance(ready: Prepared, box: tuple[int, int, int, int], check: Callable[[], None]) -> dict[str, NDArray]:
    """All passes of the tile `box` (x0, y0, x1, y1): (height, width, channels)."""
    scene = ready.scene
    with ready.stats.stage("camera rays"):
        origin, direction, far = camera_rays(scene.camera, box, ready.offsets)
    reach: NDArray | None = far
    n = len(origin)
    film = {"Combined": np.zeros((n, 4)), "Depth": np.full((n, 1), NO_DEPTH), "Normal": np.zeros((n, 3)),
            "Shadow": np.zeros((n, 3))}
    film["Combined"][:, 3] = 1
    rays: Rays = {"pixel": np.arange(n), "weight": np.ones((n, 3)), "origin": origin, "direction": direction,
                  "depth": np.zeros(n, np.int16)}
    if ready.plan.transparent:
        # Straight through all surfaces so far; the media it is in, −1: none.
        rays |= {"clear": np.ones(n, np.bool_), "media": np.full((n, interfaces.MEDIA), -1, np.int32)}
    ready.stats.add(camera_rays=n)
    waves: dict[str, Rays] = {"camera": rays}
    while waves:
        next_waves: dict[str, list[Rays]] = {}
        for kind, rays in waves.items():
            check()
            for child_kind, child in _wave(ready, kind, rays, reach, film, check):
                next_waves.setdefault(child_kind, []).append(child)
                ready.stats.add(secondary_rays=len(child["pixel"]))
            reach = None
        waves = {kind: _joined(children) for kind, children in next_waves.items()}
    return {name: _developed(name, film[name], box, len(ready.offsets)) for name in ready.passes}


def _wave(ready: Prepared, kind: str, rays: Rays, reach: NDArray | None, film: dict[str, NDArray],
          check: Callable[[], None]) -> list[tuple[str, Rays]]:
    """Trace and shade rays of one kind; returns the rays that go on, by kind."""
    settings, combined = ready.scene.settings, film["Combined"]
    with ready.stats.stage("camera rays" if kind == "camera" else "secondary rays"):
        hit, hits = ready.closest(kind, rays["origin"], rays["direction"], rays.get("normal"), reach)
    rays = {name: a for name, a in rays.items() if name not in ("origin", "normal")}  # done with
    miss = _rows({name: rays[name] for name in ("pixel", "weight", "clear") if name in rays}, ~hit)
    if settings.film_transparent and kind == "camera":
        lost = miss["clear"] if "clear" in miss else np.ones(len(miss["pixel"]), np.bool_)
        _deposit(combined[:, 3:], miss["pixel"][lost], -miss["weight"][lost].mean(1, keepdims=True), np.ones(1))
        miss = _rows(miss, ~lost)
    _deposit(combined, miss["pixel"], miss["weight"], np.array(ready.scene.world_color))
    rays = _rows(rays, hit)
    if not ready.plan.transparent:
        colour, shadow = ready.direct(hits, rays["direction"], check)
        _deposit(combined, rays["pixel"], rays["weight"], colour)
        if kind == "camera":
            _first(ready, film, rays["pixel"], hits, shadow)
        if not ready.plan.reflections:
            return []
        bounced = rays["weight"] * ready.materials.mirror[hits.material]
        return _going(ready, "reflection", rays, hits, bounced, None, 1)
    alpha = ready.glass.alpha(hits)
    face = ready.glass.interface(hits, rays)
    solid = np.flatnonzero((alpha > 0) & face.real)
    colour, shadow = ready.direct(hits.at(solid), rays["direction"][solid], check)
    share = rays["weight"] * np.where(face.real, alpha, 0)[:, None]
    _deposit(combined, rays["pixel"][solid], share[solid], colour)
    seen = rays["clear"][solid] & (alpha[solid] >= 0.5) & (film["Depth"][rays["pixel"][solid], 0] == NO_DEPTH)
    _first(ready, film, rays["pixel"][solid][seen], hits.at(solid[seen]), shadow[seen])
    # What is not there: cut-outs, and interfaces inside a medium of higher priority.
    unseen = rays | {"media": np.where(face.real[:, None], rays["media"], face.media)}
    children = _going(ready, kind, unseen, hits, rays["weight"] - share, rays["direction"], 0)
    through = rays | {"media": face.media, "clear": np.zeros_like(rays["clear"])}
    straight = ~face.bends
    passed = share * face.kt
    children += _going(ready, kind, through, hits, np.where(straight[:, None], passed, 0), rays["direction"], 0)
    children += _going(ready, "reflection", through, hits, np.where(straight[:, None], 0, passed), face.refracted, 1)
    if ready.plan.reflections:
        bounced = rays | {"clear": np.zeros_like(rays["clear"])}
        children += _going(ready, "reflection", bounced, hits, share * face.mirror, None, 1)
    return children


def _going(ready: Prepared, kind: str, rays: Rays, hits, weight: NDArray, direction: NDArray | None,
           step: int) -> list[tuple[str, Rays]]:
    """The rays that go on with `weight`: mirrored where direction is None, else through the surface."""
    settings = ready.scene.settings
    on = (weight.max(axis=1, initial=0) > settings.cutoff) & (rays["depth"] + step <= settings.max_depth)
    if not on.any():
        return []
    rays = _rows(rays, on)
    normal = hits.Ng[on]
    if direction is None:
        turned = np.empty((len(normal), 3))
        shading.mirrored(rays["direction"], normal, hits.Ns[on], turned)
    else:
        turned, normal = direction[on], -normal
    return [(kind, rays | {"weight": weight[on], "origin": hits.P[on], "normal": normal, "direction": turned,
                           "depth": rays["depth"] + np.int16(step)})]


def _first(ready: Prepared, film: dict[str, NDArray], pixel: NDArray, hits, shadow: NDArray) -> None:
    """The passes of the first surface that a camera ray sees."""
    film["Depth"][pixel, 0] = depth(ready.scene.camera, hits.P)
    film["Normal"][pixel] = hits.Ns
    film["Shadow"][pixel] = shadow[:, None]


def _rows(rays: Rays, rows: NDArray) -> Rays:
    return {name: a[rows] for name, a in rays.items()}


def _joined(children: list[Rays]) -> Rays:
    if len(children) == 1:
        return children[0]
    return {name: np.concatenate([c[name] for c in children]) for name in children[0]}


def _deposit(film: NDArray, pixel: NDArray, weight: NDArray, colour: NDArray) -> None:
    """film[pixel] += weight·colour."""
    _add(film, pixel, weight, np.broadcast_to(colour, weight.shape))


@kernel
def _add(film, pixel, weight, colour):
    for n in range(len(pixel)):  # several rays may belong to one pixel: they add up in their order
        for c in range(weight.shape[1]):
            film[pixel[n], c] += weight[n, c] * colour[n, c]


def _developed(name: str, samples: NDArray, box: tuple[int, int, int, int], per_pixel: int) -> NDArray:
    """The mean of a pixel's samples, added in order; Depth is that of the sample nearest to the centre."""
    pixels = samples.reshape(-1, per_pixel, samples.shape[1])
    if name == "Depth":
        total = pixels[:, 0]
    else:
        total = pixels[:, 0].copy()
        for s in range(1, per_pixel):
            total += pixels[:, s]
        total /= per_pixel
    return total.reshape(box[3] - box[1], box[2] - box[0], -1)
