"""How far a light's soft shadows are smoothed: its r, by the scene, by hand, or from the light's size (method §2).

A light of radius ρ at distance L from a receiver, with what blocks it at distance a, has a penumbra as wide as a disc
of radius ρ·a/(L − a) on the receiver; the half-ball of radius r blurs by the same variance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Light, Settings
from ..scene.errors import SceneError
from ..support.bits import has
from ..surface import shading
from .meshes.averaging import VARIANCE

if TYPE_CHECKING:
    from ..picture.prepared import Prepared

MOST = 16.0  # steps: the largest r/h; the ball has some 8,600 nodes above a plane
EVEN = 1.5  # steps: the smallest r/h with even edges; below √1.5 some points of a plane have no node at all
UNSEEN = 1 / 20  # of a step that suits the view: an r of less than a 4,000th of the picture's width
LARGEST = 1e30  # scene units: of a light that is nearer than what blocks it


def extent(light: Light) -> float:
    """ρ: radius of the disc with the variance of the light, scene units; of a SUN tan δ, the radius at distance 1."""
    if light.type == "SUN":
        return float(np.tan(light.angle / 2))
    if light.type != "AREA":
        return light.radius
    square = float(np.square(light.area_u).sum() + np.square(light.area_v).sum())
    # Variances along the half-axes are a quarter of their squares, of a rectangle a third; of a disc ρ²/4.
    return float(np.sqrt(square / 2)) if light.area_ellipse else 2 * float(np.sqrt(square / 6))


def radius(light: Light, magnified: float, weights: str) -> float:
    """r ≈ 1.12·ρ·a/(L − a) for uniform weights; `magnified` is a/(L − a), for a SUN the length a. Three digits."""
    r = extent(light) * magnified / np.sqrt(4 * VARIANCE[weights])
    return min(float(f"{r:.2e}"), LARGEST)


def own_radii(ready: Prepared) -> dict[int, float]:
    """r, scene units, of lights (by number) that have one of their own; all others have the scene's, h·kI."""
    lights, weights = ready.scene.lights, ready.scene.settings.weights
    own = {i: light.soft_radius for i, light in enumerate(lights) if light.softness == "RADIUS"}
    sized = [i for i, light in enumerate(lights) if light.softness == "LIGHT_SIZE"]
    for i in list(sized):
        if lights[i].type == "SUN" and lights[i].reference_distance > 0:
            own[i] = radius(lights[i], lights[i].reference_distance, weights)
            sized.remove(i)
    if sized:
        for i, magnified in zip(sized, _measured(ready, sized), strict=True):
            if magnified is not None:
                own[i] = radius(lights[i], magnified, weights)
    return own


def check(settings: Settings) -> None:
    """Raises SceneError where the numbers of the lattice are none."""
    for name, value in (("h", settings.h), ("kI", settings.kI)):
        if not 0 < value < np.inf:
            raise SceneError(f"settings: {name} is {value:g}; it must be a finite number above 0")


def steps(ready: Prepared, own: dict[int, float]) -> tuple[NDArray[np.float64], list[str]]:
    """r/h (L,) of all lights, and a sentence a light that wants more than `MOST`."""
    settings, warnings = ready.scene.settings, []
    reach = np.full(len(ready.scene.lights), settings.kI)
    for i, r in own.items():
        reach[i] = min(r / settings.h, MOST)
        if r > MOST * settings.h:
            warnings.append(
                f"light '{ready.scene.lights[i].name}': its soft shadows want a radius of {r:.3g}, and get "
                f"{MOST * settings.h:.3g}, {MOST:g} steps of the lattice: take a step h of {r / MOST:.2g} or more, a "
                f"smaller light, or a shorter reference distance")
    return reach, warnings


def small(ready: Prepared, reach: NDArray[np.float64], suits: float) -> list[str]:
    """Sentences for the lights whose r is too small for the step, or to be seen at all. `suits`: what h the view asks.
    """
    h, auto = ready.scene.settings.h, ready.scene.settings.auto_h
    soft = [i for i in range(len(reach)) if any(has(group.lights, i) for group in ready.casters.soft)]
    unseen = [i for i in soft if h * reach[i] < UNSEEN * suits]
    ragged = [i for i in soft if i not in unseen and reach[i] < EVEN * (1 - 1e-9)]
    out = []
    for lights, sentence in (
        (unseen, f"too small to be seen: take a larger step h, such as {suits:.2g}, the automatic step, or sharp "
                 "shadows, which are faster"),
        (ragged, f"{{steps:.3g}} steps of the lattice; below {EVEN:g} their edges are ragged: take " + (
            "a larger radius or light" if auto else
            "a step h of {h:.2g} or less, the automatic step, or a larger radius, light or quality (kI)")),
    ):
        if lights:
            names = [f"'{ready.scene.lights[i].name}'" for i in lights[:3]]
            more = f" and {len(lights) - 3} more" if len(lights) > 3 else ""
            steps = float(min(reach[i] for i in lights))
            out.append(f"light{'s' * (len(lights) > 1)} {', '.join(names)}{more}: the radius of soft shadows is "
                       f"{h * steps:.3g}, " + sentence.format(steps=steps, h=h * steps / EVEN))
    return out


def _measured(ready: Prepared, numbers: list[int]) -> list[float | None]:
    """Median of a/(L − a), of a SUN of a, over what the camera sees on a coarse grid; None where nothing tells.

    With a reference distance it is a, and L the median way to the surfaces that the light shines on; else both are
    measured where something blocks the light.
    """
    scene = ready.scene
    lights = tuple(scene.lights[i] for i in numbers)
    arrays = shading.light_arrays(lights)
    targets = arrays.targets()
    direction, hits = ready.coarse_view()
    n, owner = len(hits.P), ready.owner(hits.triangle)
    shines = np.zeros((n, (len(lights) + 63) // 64), np.uint64)
    shading.reaching(shading.Lit(arrays, ready.materials, hits, direction, np.zeros((n, 3))), True, shines)
    found: list[float | None] = []
    for k, light in enumerate(lights):
        on = has(shines.T, k)
        if light.receivers is not None:
            on &= np.isin(owner, light.receivers)
        if ready.casters.receives is not None:
            on &= ready.casters.receives[hits.triangle]
        P, N = hits.P[on], hits.Ng[on]
        way = np.broadcast_to(targets.position[k], P.shape) - (0 if targets.directional[k] else P)
        length = np.sqrt((way * way).sum(1))
        if light.reference_distance > 0:
            values = np.array([_magnified(light.reference_distance, np.median(length))] if len(P) else [])
        elif (casters := _blockers(ready, numbers[k])) is None:
            values = np.zeros(0)
        else:
            hit, blocker = ready.closest("opaque", P, way / length[:, None], N,
                                         None if targets.directional[k] else length, casters)
            a = np.sqrt(((blocker.P - P[hit]) ** 2).sum(1))
            values = a if targets.directional[k] else _magnified(a, length[hit])
        found.append(float(np.median(values)) if len(values) else None)
    return found


def _magnified(a: NDArray[np.float64] | float, L: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """a/(L − a), infinite where the light is nearer than a."""
    rest = np.asarray(L, np.float64) - a
    with np.errstate(divide="ignore"):
        return np.where(rest > 0, a / np.maximum(rest, 0), np.inf)


def _blockers(ready: Prepared, light: int) -> int | None:
    """The casters of the light's soft shadows, of its shadows where none is soft; None where it has none."""
    groups = (*ready.casters.soft, *ready.casters.whole)
    return next((g.casters for g in groups if has(g.lights, light)), None)
