"""Points on lamps with a size. Nodes and receivers aim rays at them to find how much of a lamp they see.

A lamp is a sphere or a disc that turns to who looks (point, spot), a disc of the sky (sun), or a rectangle or ellipse
(area). It is divided into strata, equal parts of a face, or of the directions in which the others are seen. 16 points
have 16, and each point stands at random in its own. Points of a sphere are on its front, so what is inside of it is not
in the way. In the other axis the points follow van der Corput's sequence, which each receiver and node turns in its own
way, so that neighbours
complement each other. (These are Hammersley's points, jittered: of the patterns that were tried they had the least
error for straight edges, .037 of a disc at 16 points; Sobol's, turned, had .051 to .061.) The points do not depend on
tiles, threads or order.
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
from .lifts import Lift

_points, _rays = kernel("lamp_points"), kernel("lamp_rays")
_turns_of_nodes, _turns_of_points = kernel("lamp_turns_of_nodes"), kernel("lamp_turns_of_points")
FREE, RECTANGLE, ELLIPSE, BALL = 0, 1, 2, 3  # the same in shapes.h


class Shapes(NamedTuple):
    """The lamps' shapes."""

    shape: NDArray[np.uint8]  # (L,) FREE a disc that turns to who looks, or the sun; RECTANGLE; ELLIPSE; BALL a sphere
    size: NDArray[np.float64]  # (L,) FREE and BALL: the radius, of a sun that at distance 1
    u: NDArray[np.float64]  # (L,3) half-axes of the others, world
    v: NDArray[np.float64]  # (L,3)
    own: NDArray[np.uint64]  # (L,) by which each lamp's pattern differs from the others'

    @property
    def faces(self) -> NDArray[np.bool_]:
        """Return which lamps (L,) have a face that does not turn."""
        return (self.shape == RECTANGLE) | (self.shape == ELLIPSE)

    def alike(self, i: int) -> tuple:
        """Return everything on which the points of lamp i depend, besides its place."""
        return tuple(a[i].tobytes() for a in self)


def shapes(lights: tuple[Light, ...]) -> Shapes:
    """Return the shapes of `lights`."""
    found = [KINDS[light.type].shape(light) for light in lights]
    kinds = [(RECTANGLE if shape.rectangle else ELLIPSE) if shape.face else BALL if shape.ball else FREE
             for shape in found]
    return Shapes(np.array(kinds, np.uint8), np.array([shape.disc for shape in found], np.float64),
                  np.array([shape.u for shape in found], np.float64).reshape(-1, 3),
                  np.array([shape.v for shape in found], np.float64).reshape(-1, 3), _own(lights))


def _own(lights: tuple[Light, ...]) -> NDArray[np.uint64]:
    """Return a number for each lamp, made from its name and its place among the lamps of this name: it stays the same
    when other lamps are added or removed.
    """
    met: Counter[str] = Counter()
    out = np.empty(len(lights), np.uint64)
    for i, light in enumerate(lights):
        name = f"{met[light.name]} {light.name}".encode("utf-8", "surrogatepass")
        out[i] = int.from_bytes(hashlib.blake2b(name, digest_size=8).digest(), "little")
        met[light.name] += 1
    return out


def narrowest(shapes: Shapes) -> NDArray[np.float64]:
    """Return half of each lamp's least width (L,), which decides how narrow its narrowest penumbra is: scene units; for
    a sun at distance 1.
    """
    sides = np.minimum(np.sqrt((shapes.u**2).sum(1)), np.sqrt((shapes.v**2).sum(1)))
    return np.where(shapes.faces, sides, shapes.size)


def reaches(shapes: Shapes) -> NDArray[np.float64]:
    """Return how far from each lamp's middle its points may be (L,): scene units; for a sun at distance 1."""
    sides = np.sqrt((shapes.u**2).sum(1)) + np.sqrt((shapes.v**2).sum(1))
    return np.where(shapes.faces, sides, shapes.size)


class Patterns(NamedTuple):
    """How the pattern of points is turned for places, and who has a pattern in common."""

    turn: NDArray[np.float64]  # (m,2) for each place
    share: NDArray[np.int64] | None = None  # (m,) which of the sharers it is, from 0 on; None: each has its own pattern
    sharers: int = 1
    common: bool = False  # the sharers are four samples of a pixel, and four pixels of them have 16 points in common


def points(shapes: Shapes, targets: Targets, origin: NDArray[np.float64], patterns: Patterns, row: NDArray[np.int32],
           light: NDArray[np.int32], first: int, count: int) -> Targets:
    """Return the points first..first+count of light[k] for origin[row[k]], (k·count,3), pair after pair.

    origin (m,3): the places from which rays go, world.
    """
    out = np.empty((len(row) * count, 3))
    _points(first, count, origin, *patterns, row, light, *targets, *shapes, out)
    return Targets(out, np.repeat(targets.directional[light], count))


def rays(field: tuple, shapes: Shapes, targets: Targets, facing: NDArray[np.float64], P: NDArray[np.float64],
         N: NDArray[np.float64], up: NDArray[np.float64], patterns: Patterns, row: NDArray[np.int32],
         light: NDArray[np.int32], some: NDArray[np.int32], first: int, count: int, clear: NDArray[np.float64],
         whole: NDArray[np.float64], lift: Lift | None = None) -> int:
    """Add to clear (k,1) and whole (k,) of `some` pairs what points first..first+count of light[k] give P[row[k]]: what
    nothing opaque is in the way of, and all of it; up to a constant of the pair. Returns the number of rays.

    field: `Tracer.field`. P, N (m,3): points of surfaces with their normals. up
    (m,3): the normals above which points count. facing (L,3): see `Lamps`. lift: of receivers that rays are lifted
    from; None: they are not.
    """
    above, side, cutoff = lift or (None, None, None)
    return _rays(*field, first, count, P, N, up, *patterns, row, light, some, *targets, *shapes, facing, above, side,
                 cutoff, clear, whole)


def turns_of_nodes(nodes: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return how the patterns of nodes (n,3) are turned (n,2): the cosine and sine of an angle for each."""
    out = np.empty((len(nodes), 2))
    _turns_of_nodes(nodes, out)
    return out


def turns_of_points(P: NDArray[np.float64], sample: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
    """Return how the patterns of receivers (n,3) are turned (n,2). sample (n,2): see `Hits`; the samples of a pixel
    have one pattern.
    """
    out = np.empty((len(P), 2))
    _turns_of_points(P, sample, out)
    return out
