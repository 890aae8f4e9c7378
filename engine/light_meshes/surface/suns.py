"""Small and bright places of a world: suns, lamps of a studio. Each becomes a lamp, and is removed from the table.

A table of the sky gives soft light, but the shadow of a sun is as sharp as the sun is small. So a small part of the sky
that gives a good share of all light becomes a lamp of type SUN, with its direction, angle and colour. The table loses
exactly the light that this lamp gives.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Light
from .sky_table import Radiance, directions, inside

MOST, TRIES = 8, 24  # suns, and bright places that are looked at
SHARE = 0.01  # of all light that a sun gives at least
BRIGHTER = 16.0  # times the mean radiance is its brightest part at least
EDGE = 0.03  # where its radiance falls below this share of that, it ends
REACH = np.radians(12.0)  # how far from its middle it may go
LONGER = 3.0  # how many times as long as wide it may be
FINE = 4096  # directions along each side of the whole square, where a bright place is looked at closely


class _Spot(NamedTuple):
    """A bright place of the sky, looked at closely."""

    texels: NDArray[np.int64]  # (n,) in which it is
    left: NDArray[np.float64]  # (n,3) their radiance without it
    irradiance: NDArray[np.float64]  # (3,) that it gives to a surface that faces it
    direction: NDArray[np.float64]  # (3,) of its middle
    angle: float  # of the even disc that spreads as far
    compact: bool  # whether a disc stands for it


def suns(finest: NDArray[np.float64], radiance: Radiance) -> list[tuple[Light, float]]:
    """Return a lamp for each small and bright place, with its share of all light; their light is removed from `finest`.
    finest (size²,3): the table of `sky_table.tabulated`, of `radiance`.
    """
    size = round(len(finest) ** 0.5)
    level = finest.mean(1)
    everything, usual = float(level.mean()), float(level.mean())
    free = np.ones(len(level), np.bool_)
    j, i = np.divmod(np.arange(len(level)), size)
    toward = directions((i + 0.5) / size, (j + 0.5) / size)
    found: list[tuple[Light, float]] = []
    for _ in range(TRIES):
        brightest = int(np.argmax(np.where(free, level, -1.0)))
        if len(found) == MOST or not level[brightest] > BRIGHTER * usual:
            break
        near = np.flatnonzero(toward @ toward[brightest] > np.cos(REACH))
        spot = _spot(finest, near, brightest, toward, radiance)
        free[near] = False
        share = float(spot.irradiance.mean()) / (4 * np.pi * everything)
        if not spot.compact or share < SHARE:
            continue
        finest[spot.texels] = spot.left
        usual -= share * everything
        found.append((_lamp(spot, len(found)), share))
    return found


def _spot(finest: NDArray[np.float64], near: NDArray[np.int64], brightest: int, toward: NDArray[np.float64],
          radiance: Radiance) -> _Spot:
    """Return the bright place around the texel `brightest`, in the texels `near`."""
    size = round(len(finest) ** 0.5)
    level = finest[near].mean(1)
    edge = EDGE * float(finest[brightest].mean())
    around = finest[near[level < edge]]
    background = np.median(around, axis=0) if len(around) else np.zeros(3)
    fine = FINE // size
    texels = near[level >= edge / fine**2]
    asked = inside(texels, size, fine)
    seen = radiance(asked.reshape(-1, 3)).reshape(asked.shape)
    taken = np.where((seen.mean(2) >= edge)[..., None], np.maximum(seen - background, 0), 0.0)
    each = 4 * np.pi / (size * fine) ** 2  # steradians
    weight = taken.mean(2)
    total = max(float(weight.sum()), 1e-300)
    middle = np.einsum("nk,nkj->j", weight, asked) / total
    middle /= max(float(np.linalg.norm(middle)), 1e-300)
    # How it spreads over the plane that touches the sphere at its middle.
    u = np.cross(middle, np.eye(3)[np.argmin(np.abs(middle))])
    u /= np.linalg.norm(u)
    flat = np.stack([asked @ u, asked @ np.cross(middle, u)], axis=2)
    spread = np.einsum("nk,nki,nkj->ij", weight, flat, flat) / total
    narrow, wide = np.linalg.eigvalsh(spread)
    radius = float(np.sqrt(max(2 * (narrow + wide), 0.0)))
    outside = weight[asked @ toward[brightest] < np.cos(0.9 * REACH)].sum() / total
    return _Spot(texels, (seen - taken).mean(1), taken.sum((0, 1)) * each, middle,
                 2 * float(np.arcsin(min(radius, 1.0))),
                 bool(outside < 0.05 and wide <= LONGER**2 * max(narrow, 1e-300)))


def _lamp(spot: _Spot, number: int) -> Light:
    name = f"sun {number + 1} of the world" if number else "sun of the world"
    red, green, blue = (spot.irradiance / np.pi).tolist()
    x, y, z = (-spot.direction).tolist()
    return Light(name, "SUN", (red, green, blue), direction=(x, y, z), angle=spot.angle, softness="SIZE")
