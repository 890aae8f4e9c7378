"""The materials at the points that rays hit: the table of materials, with one more row for each point of a program.

Every hit names its row of a table (`Hits.row`, `Hits.table`). Where no material has a program, the table is the scene's
own and the row is the material's number; then nothing is computed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits, Surfaces
from ..scene.description import Camera, Scene
from ..scene.programs import Program, layer_of
from .points import SHADOW, Around, Points
from .programs import run, unit
from .shading import Materials
from .textures import Texture

_LETS_THROUGH = {"alpha", "kt"}


class Looks:
    """The programs of a scene's materials, ready to be run."""

    def __init__(self, scene: Scene, surfaces: Surfaces, textures: Sequence[Texture | None], camera: Camera) -> None:
        self._programs: tuple[Program, ...] = tuple(m.program for m in scene.materials)
        self._surfaces, self._textures = surfaces, textures
        self._varies = np.array([bool(p) for p in self._programs], np.bool_)
        self._cuts = np.array([bool(_LETS_THROUGH & set(p.values)) for p in self._programs], np.bool_)
        self.any = bool(self._varies.any())
        if self.any:
            self._around = Around(scene, surfaces, camera)

    def __call__(self, table: Materials, hits: Hits, direction: NDArray[np.float64], ray: NDArray[np.int8]) -> Hits:
        """Return the hits of rays along `direction` (n,3) with rows of their own where their material has a program.

        Its normal, if it says one, becomes the shading normal Ns. ray (n,): kinds of rays, as `points` has them.
        """
        rows = np.flatnonzero(self._varies[hits.material]) if self.any else np.zeros(0, np.int64)
        if not len(rows):
            return hits
        h = hits.at(rows)
        points = Points(h.P, h.Ns, h.Ng, -direction[rows], h.front, h.uv, h.triangle, ray[rows], self._around)
        row, Ns, displaced = hits.material.copy(), None, None
        made, count = [table], len(table.ka)  # tables, and the rows in them
        for m in np.unique(h.material):
            some = np.flatnonzero(h.material == m)
            layers, bent = _rows(table, int(m), len(some), count), {}
            for name, values in run(self._programs[m], points.at(some), self._textures).items():
                layer, name = layer_of(name)
                if name in ("normal", "displaced"):
                    values = unit(values, h.Ns[some])
                    if not layer:
                        bent[name] = values
                        continue
                    name = "bent"
                getattr(layers[layer], name)[:] = values
                if name == "Od":
                    layers[layer].image[:] = -1
                elif name == "alpha":
                    layers[layer].alpha_image[:] = -1
            if "normal" in bent:
                Ns = hits.Ns.copy() if Ns is None else Ns
                Ns[rows[some]] = bent["normal"]
            if "displaced" in bent:
                displaced = hits.Ns.copy() if displaced is None else displaced
                displaced[rows[some]] = bent["displaced"]
            row[rows[some]] = count + np.arange(len(some), dtype=np.int32)
            made, count = [*made, *layers], count + len(layers) * len(some)
        longer = (np.concatenate(columns) for columns in zip(*made, strict=True))
        return hits._replace(row=row, table=Materials(*longer), Ns=hits.Ns if Ns is None else Ns,
                             smooth=None if Ns is None else hits.Ns, displaced=displaced)

    def let_through(self, material: NDArray[np.int32], triangle: NDArray[np.int32], u: NDArray, v: NDArray,
                    uv: NDArray[np.float32], alpha: NDArray[np.float64], kt: NDArray[np.float64]) -> None:
        """Set alpha (n,) and kt (n,3) where shadow rays cross materials whose programs say them."""
        rows = np.flatnonzero(self._cuts[material]) if self.any else np.zeros(0, np.int64)
        if not len(rows):
            return
        s, of = self._surfaces, triangle[rows]
        weight = np.stack([1 - u[rows] - v[rows], u[rows], v[rows]], axis=1)
        corners = s.vertices[s.triangles[of]].astype(np.float64)
        P = np.einsum("nk,nkj->nj", weight, corners) * s.scale + s.centre
        N = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        N /= np.maximum(np.linalg.norm(N, axis=1, keepdims=True), 1e-300)
        points = Points(P, N, N, N, np.ones(len(rows), np.bool_), uv[rows], of, np.full(len(rows), SHADOW, np.int8),
                        self._around)
        for m in np.unique(material[rows]):
            some = np.flatnonzero(material[rows] == m)
            found = run(self._programs[m], points.at(some), self._textures, _LETS_THROUGH)
            if "alpha" in found:
                alpha[rows[some]] = found["alpha"]
            if "kt" in found:
                kt[rows[some]] = found["kt"]


def _rows(table: Materials, material: int, n: int, first: int) -> list[Materials]:
    """Return n rows for a material and for each of its layers, for a table in which they begin at row `first`."""
    made, row = [], material
    while row >= 0:
        one = Materials._make(np.repeat(column[row:row + 1], n, axis=0) for column in table)
        row = int(table.also[row])
        first += n
        if row >= 0:
            one.also[:] = first + np.arange(n, dtype=np.int32)
        made.append(one)
    return made
