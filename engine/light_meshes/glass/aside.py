"""Straight rays of light through bodies of glass count in so far as the glass does not turn them aside.

With *Refraction: View* light goes straight on through glass. A body that bends it, such as a ball, would then have a
faint shadow, where in reality light goes elsewhere and the shadow is dark. Here the normals at the places where a
straight ray enters and leaves bodies say by how much they would bend it, and so how far from the lamp's middle it would
arrive. It counts as far as that is still the lamp. A pane with parallel faces bends nothing and has the shadow that it
had; light that a lens gathers elsewhere is missing. No further rays are traced. Fresnel's equations dim the ray, too.

This is an approximation of this project: the bent ray is followed in direction only, at the places of the straight one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits, Surfaces, surfacing
from ..support.native import kernel
from .bodies import Bodies

_cross, _dim = kernel("aside_cross"), kernel("aside_dim")

STATE = 12  # numbers for each ray; aside.c has what they are
LEAST = 0.03  # lamps count as at least so large, for their distance from the glass: the tangent of an angle


class Aside:
    """The bodies of a scene; see `rays.tracer.Turning`, which it is."""

    def __init__(self, surfaces: Surfaces, bodies: Bodies, ior: NDArray[np.float64], fresnel: NDArray[np.bool_],
                 radius: NDArray[np.float64]) -> None:
        """ior, fresnel (M,): of materials. radius (L,): half of the width of each lamp, of a sun at distance 1."""
        self._surfaces, self._bodies = surfaces, bodies
        self._ior, self._fresnel, self._radius = ior, fresnel, radius
        self._surface = surfacing(surfaces)
        # what the kernel `straight_light` needs to know to do the same
        self.arrays = bodies.of, bodies.inside_out, bodies.ior, ior, fresnel, radius, LEAST

    def begin(self, n: int) -> NDArray[np.float64]:
        """Return the states of n rays that have crossed nothing."""
        return np.full((n, STATE), -1.0)

    def cross(self, state: NDArray[np.float64], row: NDArray[np.int64], triangle: NDArray[np.int32],
              u: NDArray[np.float32], v: NDArray[np.float32], start: NDArray[np.float64], end: NDArray[np.float64],
              sun: NDArray[np.bool_]) -> None:
        """Take the rays `row` (n,) of `state` through a crossing each: the triangle, and where it is crossed.

        start, end (n,3): of the straight segments, in the frame. sun (n,): they go to a sun.
        """
        s, n = self._surfaces, len(row)
        way = end - start
        way /= np.linalg.norm(way, axis=1)[:, None]
        material = np.empty(n, np.int32)
        hits = Hits(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.zeros((n, 2), np.float32), material,
                    np.empty(n, np.int32), np.empty(n, np.bool_), material)
        self._surface(None, triangle, u, v, start * s.scale + s.centre, way, hits)
        left = np.where(sun, 1.0, np.linalg.norm(end * s.scale + s.centre - hits.P, axis=1))
        b = self._bodies
        _cross(b.of, b.inside_out, b.ior, self._ior, self._fresnel, triangle, material, hits.front, hits.Ns, way, left,
               row, state)

    def dim(self, state: NDArray[np.float64], light: NDArray[np.int32], through: NDArray[np.float32]) -> None:
        """Multiply `through` (n,3) of rays to lamps (n,) by what counts of them."""
        _dim(state, self._radius[light], LEAST, through)
