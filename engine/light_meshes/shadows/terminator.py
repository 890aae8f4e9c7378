"""The shadow terminator: where shadow rays start on smooth surfaces that are made of facets.

At grazing light, such a surface has facets that turn away from the light although the shading normal does not, and
facets in the shadow of their neighbours; they would be black. The surface that the normals describe lies above the
facets. So a light counts there if the shading normal faces it, and its visibility is tested from a point above the
facet (Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021), under the same conditions and by the same
distance as in Cycles. Of a lamp with a size this goes for each point of it on its own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits, Surfaces
from ..rays.tracer import Targets
from ..scene.description import Scene
from ..support.native import kernel, needs_memory
from ..support.rows import taken, where
from .lamp_points import reaches, shapes
from .lifts import Lift

_lift, _grazing, _starts = kernel("terminator_lift"), kernel("terminator_grazing"), kernel("terminator_starts")
split, merge, _fade = kernel("terminator_split"), kernel("terminator_merge"), kernel("terminator_fade")
touched = kernel("terminator_touched")


class Terminator:
    """The surfaces of a scene whose receivers are lifted, or whose light fades early."""

    def __init__(self, scene: Scene, surfaces: Surfaces) -> None:
        self._surfaces, self._owner = surfaces, scene.geometry.instance_object
        self._geometry, self._normal, shading = (
            np.array([getattr(o, f"shadow_terminator_{what}_offset") for o in scene.objects], np.float64)
            for what in ("geometry", "normal", "shading"))
        whole = np.array([light.softness == "SIZE" for light in scene.lights], np.bool_)
        self._size = np.where(whole, reaches(shapes(scene.lights)), 0.0)
        corners = surfaces.corner_normals
        self._smooth = np.zeros(len(corners), np.bool_)
        if self._geometry.any():
            self._smooth = (corners[:, 1:] != corners[:, :1]).any((1, 2))
        self._lifts = bool(self._smooth.any())
        if self._lifts:
            s = surfaces
            self._lift = _lift.of(s.centre, s.scale, s.vertices, s.triangles, s.instance, s.source, s.normal_matrix,
                                  corners, s.piece, s.cut, self._smooth, self._owner, self._geometry, self._normal)
        self._faster = 1 / (1 - 0.5 * np.minimum(shading, 1.999)) if shading.any() else None

    def lift(self, hits: Hits) -> Lift | None:
        """Return the lift of hits as if nothing were in the way; None if no hit is lifted."""
        if not self._lifts:
            return None
        n = len(hits.P)
        lift = Lift(np.zeros((n, 3)), hits.Ng.copy(), np.zeros(n))
        Ns = hits.Ns if hits.smooth is None else hits.smooth  # bumps do not move the surface
        some = self._lift(hits.P, Ns, hits.triangle, hits.front, *lift)
        return lift if some else None

    def clear(self, lift: Lift, hits: Hits, targets: Targets, active: NDArray[np.uint64],
              closest: Callable[..., tuple[NDArray[np.bool_], Hits]]) -> None:
        """Shorten `lift` to half of the way that is free, for the lights in `active`: never through a wall.

        closest: traces, as `World.closest`.
        """
        rows = np.empty(len(hits.P), np.int64)
        count = _grazing(*lift, hits.P, hits.Ng, *targets, self._size, active, rows)
        needs_memory(int(count < 0))
        rows = rows[:count]
        length = np.sqrt((taken(lift.above, rows) ** 2).sum(1))
        some = where(length > 0)
        rows, length = rows.take(some), length.take(some)
        if len(rows):
            P, above, N = (taken(a, rows) for a in (hits.P, lift.above, hits.Ng))
            hit, wall = closest("shadow", P, above / length[:, None], N, 2 * length)
            met = where(hit)
            free = np.sqrt(((wall.P - taken(P, met)) ** 2).sum(1))
            lift.above[rows.take(met)] *= np.minimum(free / (2 * length.take(met)), 1)[:, None]

    def fade(self, hits: Hits, targets: Targets, S: NDArray[np.float32]) -> None:
        """Dim S (n,L,C) where the artist has moved the terminator towards the light."""
        if self._faster is not None:
            _fade(self._faster[self._owner[self._surfaces.instance[hits.triangle]]], hits.P, hits.Ns, *targets, S)


def starts(lift: Lift | None, P: NDArray, N: Any, targets: Targets, row: NDArray,
           light: NDArray[np.int32]) -> tuple[NDArray, Any, NDArray]:
    """Return where shadow rays from P[row], with normals N or None, to target[light] start: origins, normals, and the
    rows of both.
    """
    if lift is None or N is None:
        return P, N, row
    origin = np.empty((len(row), 3))
    _starts(*lift, P, N, *targets, np.asarray(row, np.int32), light, origin)
    return origin, N[row], np.arange(len(row), dtype=np.int32)
