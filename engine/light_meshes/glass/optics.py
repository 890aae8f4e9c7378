"""A light for the solver of refracted paths. `optics.h` computes what its rays do at glass."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel, needs_memory
from .media import Glass

_medium_at = kernel("optics_medium_at")

# optics.h has the same constants.
DEPTH = 64  # the largest number of bends of a path
BODIES = 64  # the largest number of bodies around one point
FAR = 8.0  # a sun's rays start at this many times the reach of the glass, and at least of the frame's box
# Counts of work that the kernels fill in.
SEEDS, UNCONVERGED, NEWTON, RAYS, REJECTED = range(5)


class Source(NamedTuple):
    """A light, for kernels that follow its rays. Each thread needs its own, because kernels count their work in it."""

    light: NDArray[np.float64]  # (3,) in the frame; for a sun the unit vector towards it
    sun: bool
    total: bool  # whether paths continue where light is totally reflected
    far: float  # all glass is nearer than this; a sun's rays start there
    around: NDArray[np.int64]  # (BODIES+1,2) bodies around the light: their number, then rows (body, how often)
    work: NDArray[np.int64]  # (5,) SEEDS .. REJECTED


def source(g: Glass, light: NDArray[np.float64], sun: bool, total: bool) -> Source:
    """Return a light for the kernels; `light` is in the frame. `total`: see `Source`."""
    far = FAR * max(1.0, float(np.abs(g.box).max(initial=0)))
    s = Source(np.ascontiguousarray(light, np.float64), bool(sun), bool(total), far,
               np.zeros((BODIES + 1, 2), np.int64), np.zeros(5, np.int64))
    if not sun and len(g.ior):
        needs_memory(_medium_at(*g[1:], s.light, s.around, s.work))
    return s
