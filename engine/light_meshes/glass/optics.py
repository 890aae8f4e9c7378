"""One light as the solver of refracted paths sees it. What its rays do at glass is in `optics.h`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel, needs_memory
from .media import Glass

_medium_at = kernel("optics_medium_at")

# The same in optics.h.
DEPTH = 64  # interfaces at which a path may bend
BODIES = 64  # bodies around one point
FAR = 8.0  # times the reach of the glass, and at least of the frame's box: so far away a sun's rays start
# Work of a call, counted by the kernels.
SEEDS, UNCONVERGED, NEWTON, RAYS, REJECTED = range(5)


class Source(NamedTuple):
    """A light, for kernels that follow its rays; one a thread, as they count their work in it."""

    light: NDArray[np.float64]  # (3,) frame; of a sun the unit vector towards it
    sun: bool
    total: bool  # whether paths go on where light is reflected totally
    far: float  # what all glass is nearer than, a sun's rays' start
    around: NDArray[np.int64]  # (BODIES+1,2) bodies around the light: their number, then (body, how often)
    work: NDArray[np.int64]  # (5,) SEEDS .. REJECTED


def source(g: Glass, light: NDArray[np.float64], sun: bool, total: bool) -> Source:
    """A light for the kernels; `light` in the frame. total: see `Source`."""
    far = FAR * max(1.0, float(np.abs(g.box).max(initial=0)))
    s = Source(np.ascontiguousarray(light, np.float64), bool(sun), bool(total), far,
               np.zeros((BODIES + 1, 2), np.int64), np.zeros(5, np.int64))
    if not sun and len(g.ior):
        needs_memory(_medium_at(*g[1:], s.light, s.around, s.work))
    return s
