"""Programs of area lamps: their mean over the face, as a receiver sees it.

Where a program only asks where on the face a point is, it is run once for a grid of points, and sums from a corner give
the mean over any rectangle. Else it is run for a few points for each receiver. Either way a receiver weighs what it
gets from the cells of Gauss's rule, by its cosine, the lamp's, and the spread. Of a spread only the part of the face
counts that a receiver gets light from.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..lights import registry
from ..scene.description import Light
from .sources import CELLS, DISC, FEW, Cells, Sources, Spaces

FINE, SOME, COARSE = 256, 16, 64  # points along a side of the grid; of up to SOME lamps it is FINE
MANY = Cells(8)  # where the program was run before
Run = Callable[[Sources], NDArray[np.float64]]  # the light (n,3) of points of lamps


class Faces:
    """The faces of area lamps."""

    def __init__(self, lights: Sequence[Light], spaces: Spaces) -> None:
        def column(name: str) -> NDArray[np.float64]:
            return np.array([getattr(light, name) for light in lights], np.float64).reshape(-1, 3)

        self._spaces = spaces
        u, v = column("area_u"), column("area_v")
        self._half = np.stack([np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1)], axis=1)  # (L,2)
        self._u, self._v = u / np.maximum(self._half[:, :1], 1e-300), v / np.maximum(self._half[:, 1:], 1e-300)
        axis = column("direction")
        self._axis = axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-300)
        self._round = np.array([light.area_ellipse for light in lights], np.bool_)
        of_area = [registry.KINDS["AREA"].numbers(light) if light.type == "AREA" else (0.0, 0.0) for light in lights]
        self._edge, self._slope = np.array(of_area, np.float64).reshape(-1, 2).T
        self._sums: dict[int, NDArray[np.float64]] = {}  # of each lamp on a grid
        self._side = FINE if sum(light.type == "AREA" and bool(light.program) for light in lights) <= SOME else COARSE

    def mean(self, run: Run, fixed: bool, lamp: NDArray[np.int64], P: NDArray[np.float64],
             N: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what `run` gives (n,3) in the mean for receivers at P with normals N (n,3). lamp (n,): the lamp of
        each.

        fixed: it asks only for the place on the face.
        """
        low, high = self._seen(lamp, P)
        cells = MANY if fixed else FEW
        x, y = (low[:, k, None] + (high - low)[:, k, None] * cells.at for k in range(2))
        at = np.stack(np.broadcast_arrays(x[:, :, None], y[:, None, :]), axis=3)  # (n,k,k,2)
        if not fixed:
            whole = self._round[lamp] & (self._slope[lamp] <= 0)
            at = np.where(whole[:, None, None, None], DISC * self._half[lamp][:, None, None], at)
        place, way, weight = self._weighed(lamp, at, cells, P, N)
        if fixed:
            return self._from_sums(run, lamp, low, high, weight)
        half = np.maximum(self._half[lamp], 1e-300)[:, None, None]
        inside = ~self._round[lamp][:, None, None] | ((np.square(at / half)).sum(3) <= 1)
        weight = np.where(inside.any((1, 2), keepdims=True), weight * inside, weight)
        weight = np.where(weight.any((1, 2), keepdims=True), weight, 1.0)
        n = len(lamp)
        each = np.repeat(lamp, CELLS * CELLS)
        far = np.linalg.norm(way, axis=-1)
        points = Sources(self._spaces, each, place.reshape(-1, 3), self._axis[each],
                          (way / np.maximum(far, 1e-300)[..., None]).reshape(-1, 3), far.reshape(-1),
                          self._uv(each, at.reshape(-1, 2)))
        light = run(points).reshape(n, CELLS * CELLS, 3)
        return np.einsum("nk,nkj->nj", weight.reshape(n, -1), light) / weight.reshape(n, -1).sum(1)[:, None]

    def met(self, lamp: NDArray[np.int64], origin: NDArray[np.float64], direction: NDArray[np.float64]) -> Sources:
        """Return the points of faces that rays see, from origin along unit direction, both (n,3). lamp (n,): whose
        face.
        """
        axis, centre = self._axis[lamp], self._spaces.centre[lamp]
        facing = np.einsum("ni,ni->n", direction, axis)
        far = np.einsum("ni,ni->n", centre - origin, axis) / np.where(facing != 0, facing, 1.0)
        place = origin + far[:, None] * direction
        at = np.stack([np.einsum("ni,ni->n", place - centre, side[lamp]) for side in (self._u, self._v)], axis=1)
        return Sources(self._spaces, lamp, place, axis, -direction, far, self._uv(lamp, at))

    def _seen(self, lamp: NDArray[np.int64], P: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """Return the rectangle, low and high (n,2) along the half-axes, in which all is from where a receiver gets
        light.
        """
        way, half = P - self._spaces.centre[lamp], self._half[lamp]
        under = np.stack([np.einsum("ni,ni->n", way, self._u[lamp]), np.einsum("ni,ni->n", way, self._v[lamp])], 1)
        reach = np.maximum(np.einsum("ni,ni->n", way, self._axis[lamp]), 0) * self._edge[lamp]
        reach = np.where(self._slope[lamp] > 0, reach, np.inf)[:, None]
        return np.clip(under - reach, -half, half), np.clip(under + reach, -half, half)

    def _weighed(self, lamp: NDArray[np.int64], at: NDArray[np.float64], cells: Cells, P: NDArray[np.float64],
                 N: NDArray[np.float64]) -> tuple[NDArray, NDArray, NDArray]:
        """Return the points (n,k,k,3) of faces at `at`, the ways from there to the receivers, and what each adds
        (n,k,k).
        """
        place = (self._spaces.centre[lamp][:, None, None] + at[..., :1] * self._u[lamp][:, None, None]
                 + at[..., 1:] * self._v[lamp][:, None, None])
        way = P[:, None, None] - place
        square = np.maximum(np.einsum("nabi,nabi->nab", way, way), 1e-300)
        height = np.maximum(np.einsum("nabi,ni->nab", way, self._axis[lamp]), 0)
        facing = np.maximum(-np.einsum("nabi,ni->nab", way, N), 0)
        slope, edge = self._slope[lamp][:, None, None], self._edge[lamp][:, None, None]
        with np.errstate(all="ignore"):
            tangent = np.sqrt(np.maximum(square - height * height, 0)) / height
        spread = np.where(slope > 0, np.maximum(np.nan_to_num(edge - tangent, nan=0.0, neginf=0.0), 0), 1.0)
        share = cells.area / (square * square)
        weight = height * facing * spread * share
        for otherwise in (height * share, np.ones_like(weight)):
            none = ~(weight.sum((1, 2)) > 0)  # of no matt surface, or of none at all: a highlight may come from there
            weight = np.where(none[:, None, None], otherwise, weight)
        return place, way, weight / weight.max((1, 2), keepdims=True)

    def _uv(self, lamp: NDArray[np.int64], at: NDArray[np.float64]) -> NDArray[np.float64]:
        return 0.5 + 0.5 * at / np.maximum(self._half[lamp], 1e-300)

    def _from_sums(self, run: Run, lamp: NDArray[np.int64], low: NDArray[np.float64], high: NDArray[np.float64],
                   weight: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean from sums over a grid; weight (n,k,k): of the cells of MANY between low and high (n,2)."""
        out = np.empty((len(lamp), 3))
        for i in np.unique(lamp):
            rows = np.flatnonzero(lamp == i)
            if i not in self._sums:
                self._sums[int(i)] = self._summed(run, int(i))
            sums, side = self._sums[int(i)], self._side
            # At least a texel wide, so that there is something to take the mean of.
            middle = self._uv(lamp[rows], (low + high)[rows] / 2) * side
            wide = np.maximum((high - low)[rows] / np.maximum(self._half[i], 1e-300) * 0.5 * side, 1.0)
            edges = middle[:, None] + wide[:, None] * (MANY.edges - 0.5)[:, None]
            corner = _interpolated(sums, edges[:, :, 0], edges[:, :, 1])
            cell = corner[:, 1:, 1:] - corner[:, :-1, 1:] - corner[:, 1:, :-1] + corner[:, :-1, :-1]
            w = weight[rows][..., None] / MANY.area[..., None]
            total, mean = (w * cell[..., 3:]).sum((1, 2)), (w * cell[..., :3]).sum((1, 2))
            whole = sums[-1, -1, :3] / max(sums[-1, -1, 3], 1e-9)
            some = total > 1e-9 * w.sum((1, 2))
            out[rows] = np.where(some, mean / np.where(some, total, 1.0), whole)
        return np.maximum(out, 0.0)

    def _summed(self, run: Run, i: int) -> NDArray[np.float64]:
        """Return the sums (side+1,side+1,4) of colours and of the inside of the face, from its first corner on."""
        side = self._side
        at = np.stack(np.meshgrid(*[(np.arange(side) + 0.5) / side * 2 - 1] * 2, indexing="ij"), axis=2).reshape(-1, 2)
        place = self._spaces.centre[i] + (at * self._half[i]) @ np.stack([self._u[i], self._v[i]])
        lamp = np.full(len(at), i, np.int64)
        axis = np.broadcast_to(self._axis[i], place.shape)
        light = run(Sources(self._spaces, lamp, place, axis, axis, np.zeros(len(at)), (at + 1) / 2))
        inside = np.square(at).sum(1, keepdims=True) <= 1 if self._round[i] else np.ones((len(at), 1), np.bool_)
        sums = np.zeros((side + 1, side + 1, 4))
        sums[1:, 1:] = np.concatenate([light * inside, inside], axis=1).reshape(side, side, 4).cumsum(0).cumsum(1)
        return sums


def _interpolated(sums: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sums at places between those of the grid: (n,k) along each axis → (n,k,k,4)."""
    most = len(sums) - 1
    x, y = np.clip(x, 0, most), np.clip(y, 0, most)
    i, j = np.minimum(x.astype(np.int64), most - 1), np.minimum(y.astype(np.int64), most - 1)
    fx, fy = (x - i)[:, :, None, None], (y - j)[:, None, :, None]
    a, b = i[:, :, None], j[:, None, :]
    return ((1 - fx) * ((1 - fy) * sums[a, b] + fy * sums[a, b + 1])
            + fx * ((1 - fy) * sums[a + 1, b] + fy * sums[a + 1, b + 1]))
