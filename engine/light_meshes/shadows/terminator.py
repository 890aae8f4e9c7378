"""The shadow terminator: where shadow rays leave smooth surfaces that are made of facets.

Light that grazes such a surface finds facets that turn away from it though the shading normal does not, and facets in
the shadow of their neighbours: they would be black. What is meant is the surface that the normals describe, which lies
above the facets. So there a light counts where the shading normal faces it, and what it sees is asked above the facet
(Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021), where and as far as Cycles does it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits, Surfaces
from ..rays.tracer import Targets
from ..scene.description import Scene
from ..support.compiled import kernel, part


class Lift(NamedTuple):
    """What shadow methods want to know of receivers on such surfaces."""

    above: NDArray[np.float64]  # (n,3) world: the way from P to the smooth surface
    side: NDArray[np.float64]  # (n,3) unit: the shading normal where P may be lifted, else the geometric one
    cutoff: NDArray[np.float64]  # (n,) cosine to a light below which P is lifted; 0: never


class Terminator:
    """The surfaces of a scene whose receivers are lifted, or whose light fades early."""

    def __init__(self, scene: Scene, surfaces: Surfaces) -> None:
        self._surfaces, self._owner = surfaces, scene.geometry.instance_object
        self._geometry, self._normal, shading = (
            np.array([getattr(o, f"shadow_terminator_{what}_offset") for o in scene.objects], np.float64)
            for what in ("geometry", "normal", "shading"))
        corners = surfaces.corner_normals
        self._smooth = np.zeros(len(corners), np.bool_)
        if self._geometry.any():
            self._smooth = (corners[:, 1:] != corners[:, :1]).any((1, 2))
        self._lifts = bool(self._smooth.any())
        self._faster = 1 / (1 - 0.5 * np.minimum(shading, 1.999)) if shading.any() else None

    def lift(self, hits: Hits) -> Lift | None:
        """The lift of hits, as far as it goes where nothing is in the way; None: of none."""
        if not self._lifts:
            return None
        n = len(hits.P)
        lift = Lift(np.zeros((n, 3)), hits.Ng.copy(), np.zeros(n))
        some = _lift(self._surfaces, self._smooth, self._owner, self._geometry, self._normal, hits, *lift)
        return lift if some else None

    def clear(self, lift: Lift, hits: Hits, targets: Targets, active: NDArray[np.uint64],
              closest: Callable[..., tuple[NDArray[np.bool_], Hits]]) -> None:
        """Shorten `lift` to half of the way that is free, for the lights in `active`: never through a wall.

        closest: traces, as `Prepared.closest`.
        """
        rows = _grazing(lift, hits.P, hits.Ng, targets, active)
        length = np.sqrt((lift.above[rows] ** 2).sum(1))
        rows, length = rows[length > 0], length[length > 0]
        if len(rows):
            hit, wall = closest("shadow", hits.P[rows], lift.above[rows] / length[:, None], hits.Ng[rows], 2 * length)
            free = np.sqrt(((wall.P - hits.P[rows[hit]]) ** 2).sum(1))
            lift.above[rows[hit]] *= np.minimum(free / (2 * length[hit]), 1)[:, None]

    def fade(self, hits: Hits, targets: Targets, S: NDArray[np.float32]) -> None:
        """Dim S (n,L,C) where the artist has moved the terminator towards the light."""
        if self._faster is not None:
            _fade(self._faster[self._owner[self._surfaces.instance[hits.triangle]]], hits.P, hits.Ns, targets, S)


def starts(lift: Lift | None, P: NDArray, N: Any, targets: Targets, row: NDArray,
           light: NDArray[np.int32]) -> tuple[NDArray, Any, NDArray]:
    """Where shadow rays of P[row], with normals N or None, to target[light] start: origins, normals, rows of both."""
    if lift is None or N is None:
        return P, N, row
    origin = np.empty((len(row), 3))
    _starts(lift, P, N, targets, row, light, origin)
    return origin, N[row], np.arange(len(row), dtype=np.int32)


@kernel
def _lift(s, smooth, owner, geometry, normal, hits, above, side, cutoff):
    """Fill the arrays of Lift; returns whether any receiver has one.

    How high the smooth surface is: a parabola through the vertices with their normals, at least half as high as it
    and as high as the planes of all three normals.
    """
    some = False
    V, N, q, weight = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    for p in range(len(hits.P)):
        t = hits.triangle[p]
        i, k = s.instance[t], s.source[t]
        if not smooth[k] or geometry[owner[i]] == 0.0:
            continue
        m, turn = s.normal_matrix[i], 1.0 if hits.front[p] else -1.0
        whole = True
        for c in range(3):
            u, v = (1.0 if c == 1 else 0.0), (1.0 if c == 2 else 0.0)
            if len(s.piece) and s.piece[t] >= 0:
                u, v = s.cut[s.piece[t], c, 0], s.cut[s.piece[t], c, 1]
            for j in range(3):
                q[j] = (1.0 - u - v) * s.corner_normals[k, 0, j] + u * s.corner_normals[k, 1, j] + (
                    v * s.corner_normals[k, 2, j])
            length = 0.0
            for j in range(3):
                V[c, j] = s.vertices[s.triangles[t, c], j]
                N[c, j] = m[j, 0] * q[0] + m[j, 1] * q[1] + m[j, 2] * q[2]
                length += N[c, j] * N[c, j]
            length = np.sqrt(length)
            whole = whole and length > 0.0 and length < np.inf
            for j in range(3):
                N[c, j] *= turn / length
        if not whole:  # no usable normal in the mesh
            continue
        for j in range(3):
            q[j] = (hits.P[p, j] - s.centre[j]) / s.scale
        _barycentric(V, q, weight)
        u, v = weight[0], weight[1]
        least = np.inf
        for c in range(3):
            height = 0.0
            for d in range(3):
                height = max(height, _along(V[d], V[c], N[c]))
            least = min(least, max(height + _along(V[c], q, N[c]), 0.0))
        a = _along(V[0], V[2], N[2]) - _along(V[0], V[2], N[0])
        b = _along(V[1], V[2], N[2]) - _along(V[1], V[2], N[1])
        c = _along(V[1], V[0], N[1]) - _along(V[1], V[0], N[0])
        height = a * u * (u - 1.0) + (a + b + c) * u * v + b * v * (v - 1.0)
        height = s.scale * max(least, 0.5 * height)
        for j in range(3):
            along = weight[0] * N[0, j] + weight[1] * N[1, j] + weight[2] * N[2, j]
            above[p, j] = height * along + normal[owner[i]] * hits.Ns[p, j]
            side[p, j] = hits.Ns[p, j]
        cutoff[p] = geometry[owner[i]]
        some = True
    return some


@part
def _along(a, b, N):
    """N·(a − b)."""
    return N[0] * (a[0] - b[0]) + N[1] * (a[1] - b[1]) + N[2] * (a[2] - b[2])


@part
def _barycentric(V, q, weight):
    """Fill weight (3,) of the corners V at q, which lies in their plane."""
    ee, ef, ff, de, df = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(3):
        e, f, d = V[1, j] - V[0, j], V[2, j] - V[0, j], q[j] - V[0, j]
        ee, ef, ff, de, df = ee + e * e, ef + e * f, ff + f * f, de + d * e, df + d * f
    area = ee * ff - ef * ef
    weight[1] = min(max((ff * de - ef * df) / area, 0.0), 1.0)
    weight[2] = min(max((ee * df - ef * de) / area, 0.0), 1.0 - weight[1])
    weight[0] = 1.0 - weight[1] - weight[2]


@part
def amount(lift, P, N, targets, p, i):
    """How far receiver p is lifted for light i, 0 to 1: wholly where its facet turns away from it."""
    cutoff = lift.cutoff[p]
    if cutoff == 0.0:
        return 0.0
    square, facet, smooth = 0.0, 0.0, 0.0
    for j in range(3):
        x = targets.position[i, j] - (0.0 if targets.directional[i] else P[p, j])
        square += x * x
        facet += x * N[p, j]
        smooth += x * lift.side[p, j]
    length = np.sqrt(square)
    facet, smooth = facet / length, smooth / length
    most = 2.0 - (facet + smooth) / cutoff if smooth < cutoff else 1.0 - facet / cutoff
    return min(max(most, 0.0), 1.0)


@kernel
def _grazing(lift, P, N, targets, active):
    """The receivers that some active light lifts."""
    rows, count = np.empty(len(P), np.int64), 0
    for p in range(len(P)):
        some = False
        if lift.cutoff[p] > 0.0:
            for i in range(len(targets.directional)):
                if not some and active[p, i >> 6] >> np.uint64(i & 63) & np.uint64(1):
                    some = amount(lift, P, N, targets, p, i) > 0.0
        if some:
            rows[count] = p
            count += 1
    return rows[:count]


@kernel
def _starts(lift, P, N, targets, row, light, origin):
    for n in range(len(row)):
        p = row[n]
        share = amount(lift, P, N, targets, p, light[n])
        for j in range(3):
            origin[n, j] = P[p, j] + share * lift.above[p, j] if share > 0.0 else P[p, j]


@kernel
def split(lift, P, N, targets, soft, lifted):
    """Move lights of soft (n,W) to lifted (n,W) where P is lifted wholly; where in part, they are then in both."""
    for p in range(len(P)):
        if lift.cutoff[p] > 0.0:
            for i in range(len(targets.directional)):
                bit = np.uint64(1) << np.uint64(i & 63)
                if soft[p, i >> 6] & bit:
                    share = amount(lift, P, N, targets, p, i)
                    if share > 0.0:
                        lifted[p, i >> 6] |= bit
                    if share == 1.0:
                        soft[p, i >> 6] &= ~bit


@kernel
def merge(lift, P, N, targets, rows, lifted, answered, S_lifted, soft, S):
    """S of the lights in lifted (m,W), of receivers `rows`, where what P and the lifted P see is known.

    answered (m,W): where S_lifted (m,L,C) is known. soft (n,W): where S (n,L,C) is; made true of the result.
    """
    for n in range(len(rows)):
        p = rows[n]
        for i in range(len(targets.directional)):
            w, bit = i >> 6, np.uint64(1) << np.uint64(i & 63)
            if not lifted[n, w] & bit:
                continue
            share = amount(lift, P, N, targets, p, i)
            known = answered[n, w] & bit != 0 and (share == 1.0 or soft[p, w] & bit != 0)
            for c in range(S.shape[2]):
                S[p, i, c] = (1.0 - share) * S[p, i, c] + share * S_lifted[n, i, c] if known else 0.0
            if known:
                soft[p, w] |= bit
            else:
                soft[p, w] &= ~bit


@kernel
def _fade(faster, P, N, targets, S):
    """S times cos(faster·angle)/cos(angle), the angle between N and a light."""
    for p in range(len(P)):
        if faster[p] > 1.0:
            for i in range(S.shape[1]):
                square, cosine = 0.0, 0.0
                for j in range(3):
                    x = targets.position[i, j] - (0.0 if targets.directional[i] else P[p, j])
                    square += x * x
                    cosine += x * N[p, j]
                cosine = min(cosine / np.sqrt(square), 1.0)
                share = max(np.cos(np.arccos(cosine) * faster[p]), 0.0) / cosine if cosine > 0.0 else 0.0
                for c in range(S.shape[2]):
                    S[p, i, c] *= share
