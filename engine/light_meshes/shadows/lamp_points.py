"""Points on lamps with a size: what nodes and receivers aim at, when they ask how much of a lamp they see.

A lamp is a sphere (point, spot), a disc of the sky (sun), or a rectangle or ellipse (area). Of any 16 points each has
a stratum of its own, of equal area, where it stands at random; in the other axis they follow van der Corput's sequence,
turned by whoever asks, so that neighbours complement each other. (Hammersley's points, jittered: of the patterns that
were tried they had the least error for straight edges, .037 of a disc at 16 points; Sobol's, turned, had .051 to .061.)
They depend on nothing else: the same for any tiles, threads and order.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lights.registry import KINDS
from ..rays.tracer import Targets
from ..scene.description import Light
from ..support.native import kernel

_points = kernel("lamp_points")
_turns_of_nodes, _turns_of_points = kernel("lamp_turns_of_nodes"), kernel("lamp_turns_of_points")
FREE, RECTANGLE, ELLIPSE = 0, 1, 2  # the same in lamp_points.c


class Shapes(NamedTuple):
    """The lamps' shapes."""

    shape: NDArray[np.uint8]  # (L,) FREE turns to who looks: a sphere, or the sun; RECTANGLE, ELLIPSE
    size: NDArray[np.float64]  # (L,) FREE: the radius, of a sun that at distance 1
    u: NDArray[np.float64]  # (L,3) half-axes of the others, world
    v: NDArray[np.float64]  # (L,3)
    own: NDArray[np.uint64]  # (L,) by which each lamp's pattern differs from the others'

    def alike(self, i: int) -> tuple:
        """Return what else than its place the points of lamp i depend on."""
        return tuple(a[i].tobytes() for a in self)


def shapes(lights: tuple[Light, ...]) -> Shapes:
    """The shapes of `lights`."""
    found = [KINDS[light.type].shape(light) for light in lights]
    kinds = [FREE if not shape.face else RECTANGLE if shape.rectangle else ELLIPSE for shape in found]
    return Shapes(np.array(kinds, np.uint8), np.array([shape.disc for shape in found], np.float64),
                  np.array([shape.u for shape in found], np.float64).reshape(-1, 3),
                  np.array([shape.v for shape in found], np.float64).reshape(-1, 3), _own(lights))


def _own(lights: tuple[Light, ...]) -> NDArray[np.uint64]:
    """A number a lamp, by its name, and its place among those of the same name: it stays when others come and go."""
    met: Counter[str] = Counter()
    out = np.empty(len(lights), np.uint64)
    for i, light in enumerate(lights):
        name = f"{met[light.name]} {light.name}".encode("utf-8", "surrogatepass")
        out[i] = int.from_bytes(hashlib.blake2b(name, digest_size=8).digest(), "little")
        met[light.name] += 1
    return out


def narrowest(shapes: Shapes) -> NDArray[np.float64]:
    """Half of each lamp's least width (L,), by which its narrowest penumbra goes: scene units; of a sun at distance 1.
    """
    sides = np.minimum(np.sqrt((shapes.u**2).sum(1)), np.sqrt((shapes.v**2).sum(1)))
    return np.where(shapes.shape == FREE, shapes.size, sides)


def reaches(shapes: Shapes) -> NDArray[np.float64]:
    """How far from each lamp's middle its points may be (L,): scene units; of a sun at distance 1."""
    sides = np.sqrt((shapes.u**2).sum(1)) + np.sqrt((shapes.v**2).sum(1))
    return np.where(shapes.shape == FREE, shapes.size, sides)


def points(shapes: Shapes, targets: Targets, origin: NDArray[np.float64], turn: NDArray[np.float64],
           row: NDArray[np.int32], light: NDArray[np.int32], first: int, count: int,
           share: NDArray[np.int64] | None = None, sharers: int = 1) -> Targets:
    """Points first..first+count (k·count,3) of light[k] as origin[row[k]] has them, pair after pair.

    origin (m,3): who looks, world; turn (m,2): how its pattern is turned; share (m,): which it is, from 0 on, of the
    `sharers` that have a pattern in common; None: it is alone.
    """
    out = np.empty((len(row) * count, 3))
    _points(first, count, origin, turn, share, sharers, row, light, *targets, *shapes, out)
    return Targets(out, np.repeat(targets.directional[light], count))


def turns_of_nodes(nodes: NDArray[np.int32]) -> NDArray[np.float64]:
    """How the patterns (n,2) of nodes (n,3) are turned."""
    out = np.empty((len(nodes), 2))
    _turns_of_nodes(nodes, out)
    return out


def turns_of_points(P: NDArray[np.float64], sample: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
    """How the patterns (n,2) of receivers (n,3) are turned. sample (n,2): see `Hits`; the samples of a pixel have one
    pattern.
    """
    out = np.empty((len(P), 2))
    _turns_of_points(P, sample, out)
    return out
