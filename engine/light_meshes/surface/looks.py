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
from ..scene.material import Material
from ..scene.programs import LETS_THROUGH, Program, layer_of
from ..support.rows import taken
from .points import SHADOW, Around, Points
from .programs import run, unit
from .shading import LEAST_SIGHT, Materials, sent_out
from .textures import Texture

# Normals that are only dimmed by: the columns for the cosines of the eye to them.
_ON = {"coat_normal": "on_coat", "sheen_normal": "on_sheen"}


class Looks:
    """The programs of a scene's materials, ready to be run."""

    def __init__(self, scene: Scene, surfaces: Surfaces, textures: Sequence[Texture | None], camera: Camera) -> None:
        self._programs: tuple[Program, ...] = tuple(m.program for m in scene.materials)
        self._surfaces, self._textures = surfaces, textures
        self._varies = np.array([bool(p) for p in self._programs], np.bool_)
        # (M,) whether a program says how much light gets through
        self.cuts = np.array([bool(LETS_THROUGH & set(p.values)) for p in self._programs], np.bool_)
        self.any = bool(self._varies.any())
        # Materials with equal programs, and as many layers, are one group.
        groups: dict[tuple[Program, int], int] = {}
        self._group = np.array([groups.setdefault((m.program, len(m.layers)), len(groups)) for m in scene.materials])
        self._groups, self._chain = [program for program, _ in groups], _chains(scene.materials)
        if self.any:
            self._around = Around(scene, surfaces, camera)

    def __call__(self, table: Materials, hits: Hits, direction: NDArray[np.float64], ray: NDArray[np.int8],
                 flat: bool = False) -> Hits:
        """Return the hits of rays along `direction` (n,3) with rows of their own where their material has a program.

        Its normal, if it says one, becomes the shading normal Ns. ray (n,): kinds of rays, as `points` has them. flat:
        surfaces are without bumps.
        """
        rows = np.flatnonzero(self._varies[hits.material]) if self.any else np.zeros(0, np.int64)
        if not len(rows):
            return hits
        h = hits.at(rows)
        points = Points(h.P, h.Ns, h.Ng, -direction[rows], h.front, h.uv, h.triangle, ray[rows], self._around)
        row, bent = hits.material.copy(), dict[str, NDArray]()
        groups, longer = self._longer(table, h.material)
        for group, some, first in groups:
            own = points.at(some)
            program = self._groups[group]
            for name, values in run(program, own, self._textures, program.without_normals if flat else None).items():
                layer, name = layer_of(name)
                here = slice(first + layer * len(some), first + (layer + 1) * len(some))
                if name in ("normal", "displaced") and not layer:
                    bent[name] = hits.Ns.copy() if name not in bent else bent[name]
                    bent[name][rows[some]] = unit(values, own.Ns)
                    continue
                name, values = _known(name, values, own)
                getattr(longer, name)[here] = values
                if name == "Od":
                    longer.image[here] = -1
                elif name == "alpha":
                    longer.alpha_image[here] = -1
            row[rows[some]] = first + np.arange(len(some), dtype=np.int32)
        return hits._replace(row=row, table=longer, Ns=bent.get("normal", hits.Ns),
                             smooth=hits.Ns if "normal" in bent else None, displaced=bent.get("displaced"))

    def _longer(self, table: Materials,
                material: NDArray[np.int32]) -> tuple[list[tuple[int, NDArray[np.int64], int]], Materials]:
        """Return the groups of points of these materials (n,) that run one program, each with its points and its first
        row, and the table with rows for them: one a point, and behind them those of their layers, one layer after the
        other.
        """
        which, count = self._group[material], len(table.ka)
        groups, index, also = [], [np.arange(count)], [table.also]
        for group in np.unique(which):
            some = np.flatnonzero(which == group)
            groups.append((int(group), some, count))
            chain = self._chain[material[some]].T
            chain = chain[chain[:, 0] >= 0]
            count += chain.size
            index.append(chain.ravel())
            following = np.arange(count - chain.size, count, dtype=np.int32) + len(some)
            following[chain.size - len(some):] = -1
            also.append(following)
        of = np.concatenate(index)
        return groups, Materials._make(taken(column, of) for column in table)._replace(also=np.concatenate(also))

    def let_through(self, material: NDArray[np.int32], triangle: NDArray[np.int32], u: NDArray, v: NDArray,
                    uv: NDArray[np.float32], alpha: NDArray[np.float64], kt: NDArray[np.float64]) -> None:
        """Set alpha (n,) and kt (n,3) where shadow rays cross materials whose programs say them."""
        rows = np.flatnonzero(self.cuts[material]) if self.any else np.zeros(0, np.int64)
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
            found = run(self._programs[m], points.at(some), self._textures, LETS_THROUGH)
            if "alpha" in found:
                alpha[rows[some]] = found["alpha"]
            if "kt" in found:
                kt[rows[some]] = found["kt"]


def _known(name: str, values: NDArray[np.float64], points: Points) -> tuple[str, NDArray[np.float64]]:
    """Return the column of `Materials` that a program's values (n,) or (n,3) belong to, and what stands there."""
    if name == "normal":
        return "bent", unit(values, points.Ns)
    if name not in _ON:
        return name, values
    values = unit(values, points.Ns)
    if name == "coat_normal":
        values = sent_out(values, points.Ns, points.Ng, -points.incoming)
    return _ON[name], np.maximum((values * points.incoming).sum(1), LEAST_SIGHT)


def _chains(materials: Sequence[Material]) -> NDArray[np.int64]:
    """Return the rows of the layers of each material in `material_arrays`, a column a layer, its own first; −1: no
    further one.
    """
    found = np.full((len(materials), 1 + max((len(m.layers) for m in materials), default=0)), -1)
    found[:, 0], first = np.arange(len(materials)), len(materials)
    for n, m in enumerate(materials):
        found[n, 1:1 + len(m.layers)] = first + np.arange(len(m.layers))
        first += len(m.layers)
    return found
