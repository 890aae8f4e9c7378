"""The radius r by which a light's soft shadows are smoothed: from the scene, set by hand, or from the light's size
(method §2).

A light of radius ρ at the distance L from a receiver, with a blocker at the distance a from the receiver, has a
penumbra like a disc of radius ρ·a/(L − a) on the receiver. The half-ball of radius r blurs by the same variance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ..lights.registry import KINDS
from ..scene.description import Light, Settings
from ..scene.errors import SceneError
from ..support.bits import has
from .meshes.averaging import VARIANCE

MOST = 16.0  # in steps: the largest r/h; the ball then has about 8,600 nodes above a plane
EVEN = 1.5  # in steps: the smallest r/h with even edges; below √1.5 some points of a plane have no node
UNSEEN = 1 / 20  # of a step that suits the view: an r of less than a 4,000th of the picture's width cannot be seen
LARGEST = 1e30  # in scene units, for a light that is nearer than its blocker


def extent(light: Light) -> float:
    """Return ρ, the radius of a disc with the variance of the light, in scene units; for a SUN tan δ, the radius at
    distance 1.
    """
    return KINDS[light.type].extent(light)


def extents(lights: tuple[Light, ...]) -> NDArray[np.float64]:
    """Return `extent` of all lights (L,)."""
    return np.array([extent(light) for light in lights], np.float64)


def radius(light: Light, magnified: float, weights: str) -> float:
    """Return r ≈ 1.12·ρ·a/(L − a) for uniform weights, in three digits; `magnified` is a/(L − a), or for a SUN the
    length a.
    """
    r = extent(light) * magnified / np.sqrt(4 * VARIANCE[weights])
    return min(float(f"{r:.2e}"), LARGEST)


def check(settings: Settings) -> None:
    """Raise SceneError unless the numbers of the lattice are finite and above 0."""
    for name, value in (("h", settings.h), ("kI", settings.kI)):
        if not 0 < value < np.inf:
            raise SceneError(f"settings: {name} is {value:g}; it must be a finite number above 0")


def steps(lights: Sequence[Light], settings: Settings,
          own: Mapping[int, float]) -> tuple[NDArray[np.float64], list[str]]:
    """Return r/h (L,) of all lights, and a sentence for each light that needs more than `MOST`. own: r of those lights,
    by number, that have their own.
    """
    warnings = []
    reach = np.full(len(lights), settings.kI)
    for i, r in own.items():
        reach[i] = min(r / settings.h, MOST)
        if r > MOST * settings.h:
            warnings.append(
                f"light '{lights[i].name}': its soft shadows want a radius of {r:.3g}, and get "
                f"{MOST * settings.h:.3g}, {MOST:g} steps of the lattice: take a step h of {r / MOST:.2g} or more, a "
                f"smaller light, or a shorter reference distance")
    return reach, warnings


def small(lights: Sequence[Light], soft: NDArray[np.uint64], settings: Settings, reach: NDArray[np.float64],
          suits: float) -> list[str]:
    """Return sentences for the lights in soft (W,) whose r is too small for the step, or too small to be seen. reach
    (L,): r/h. suits: the step h that the view needs.
    """
    h, auto = settings.h, settings.auto_h
    some = [i for i in range(len(reach)) if has(soft, i)]
    unseen = [i for i in some if h * reach[i] < UNSEEN * suits]
    ragged = [i for i in some if i not in unseen and reach[i] < EVEN * (1 - 1e-9)]
    out = []
    for found, sentence in (
        (unseen, f"too small to be seen: take a larger step h, such as {suits:.2g}, the automatic step, or sharp "
                 "shadows, which are faster"),
        (ragged, f"{{steps:.3g}} steps of the lattice; below {EVEN:g} their edges are ragged: take " + (
            "a larger radius or light" if auto else
            "a step h of {h:.2g} or less, the automatic step, or a larger radius, light or quality (kI)")),
    ):
        if found:
            names = [f"'{lights[i].name}'" for i in found[:3]]
            more = f" and {len(found) - 3} more" if len(found) > 3 else ""
            steps = float(min(reach[i] for i in found))
            out.append(f"light{'s' * (len(found) > 1)} {', '.join(names)}{more}: the radius of soft shadows is "
                       f"{h * steps:.3g}, " + sentence.format(steps=steps, h=h * steps / EVEN))
    return out


def magnified(a: NDArray[np.float64] | float, L: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return a/(L − a); it is infinite where the light is nearer than a."""
    rest = np.asarray(L, np.float64) - a
    with np.errstate(divide="ignore"):
        return np.where(rest > 0, a / np.maximum(rest, 0), np.inf)
