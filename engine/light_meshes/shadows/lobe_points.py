"""The highlight of a lamp of which a receiver sees only a part: it is not dimmed by the same share as the matt light.

The reason: a smooth floor beside a wall mirrors one part of a window only, and that part may be hidden or not. So the
engine takes directions from the lobe of the receiver's facets (GGX), and sends shadow rays to the points of the lamp
that these directions meet. If only few of them meet the lamp, it is small compared with the lobe: then its highlight is
dimmed by the same share as its other light.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import Targets
from ..support.native import kernel
from .lamp_points import Shapes

DIRECTIONS = 32  # of a lobe
SMALL, WIDE = 0.5, 6.0  # lamps so large beside the slope of most facets matter, and so near to what is mirrored
PRIOR = 0.5  # directions that the share of the other light stands for, where none meets the lamp

_points = kernel("lobe_points")


def points(shapes: Shapes, targets: Targets, P: NDArray[np.float64], N: NDArray[np.float64], way: NDArray[np.float64],
           alpha: NDArray[np.float64], turn: NDArray[np.float64], row: NDArray[np.int32],
           light: NDArray[np.int32]) -> tuple[Targets, NDArray[np.float64]]:
    """Return DIRECTIONS points on light[k] that the lobe of receiver row[k] mirrors, pair after pair, and their
    weights. A weight of 0 means that the direction passes the lamp by.

    P, N, way (n,3): the receivers, their shading normals, and the directions of the eye's rays. alpha (n,): the square
    of their roughness. turn (n,2): how their patterns are turned.
    """
    out, weight = np.zeros((len(row) * DIRECTIONS, 3)), np.empty(len(row) * DIRECTIONS)
    _points(DIRECTIONS, P, N, way, alpha, turn, row, light, *targets, *shapes[:4], out, weight)
    return Targets(out, np.repeat(targets.directional[light], DIRECTIONS)), weight.reshape(-1, DIRECTIONS)


def matter(targets: Targets, reach: NDArray[np.float64], P: NDArray[np.float64], N: NDArray[np.float64],
           way: NDArray[np.float64], alpha: NDArray[np.float64], row: NDArray[np.int32],
           light: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return for which pairs the lobe of receiver row[k] is near light[k], and narrow enough that different parts of
    the lamp count differently. reach (L,): how far the lamps extend from their middles. The others are as in `points`.
    """
    d = targets.position[light] - np.where(targets.directional[light, None], 0.0, P[row])
    far = np.sqrt((d * d).sum(1))
    N, way = N[row], way[row]
    mirrored = way - 2 * (way * N).sum(1)[:, None] * N
    apart = np.arccos(np.clip((mirrored * d).sum(1) / np.maximum(far, 1e-300), -1, 1))
    size, wide = reach[light] / np.maximum(far, 1e-300), alpha[row]
    found: NDArray[np.bool_] = (size > SMALL * wide) & (apart < np.arctan(size) + WIDE * wide)
    return found


def turns(turn: NDArray[np.float64], sample: NDArray[np.int64], samples: int) -> NDArray[np.float64]:
    """Return how the patterns of lobes are turned (n,2), from how those of pixels are: the `samples` of a pixel have
    the directions that lie between those of the others. sample (n,2): see `Hits`.
    """
    steps = np.array([1 / (DIRECTIONS * samples), 0.6180339887498949])
    return turn + sample[:, 1:] * steps


def share(weight: NDArray[np.float64], visible: NDArray[np.float64],
          other: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the share (k,) of highlights that is left: the mean of `visible` (k,DIRECTIONS), weighted by `weight`, and
    mixed with the `other` light's share (k,), which counts more if fewer directions meet the lamp.
    """
    most = np.maximum(weight.max(1), 1e-300)
    prior = PRIOR * most * np.mean(weight == 0, axis=1)
    total = weight.sum(1) + prior
    found: NDArray[np.float64] = ((weight * visible).sum(1) + prior * other) / np.maximum(total, 1e-300)
    return np.where(total > 0, found, other)
