"""Layers: further surfaces that reflect light at the same points, for shaders that are mixed and differ in roughness.

A hit names the row of its first layer; the table of materials says which row the next one is (`Materials.also`), and
its own normal. All layers of a point have one visibility of each lamp, and each returns light by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits
from . import colours, shading
from .textures import Texture


class Layer(NamedTuple):
    """A further layer of some of a batch of hits."""

    rows: NDArray[np.int64]  # (k,) which hits of the batch have it, ascending
    hits: Hits  # (k,) those, as this layer is
    direction: NDArray[np.float64]  # (k,3) of the rays
    Od: NDArray[np.float64]  # (k,3) its diffuse colour, as lights see it

    def at(self, part: slice) -> Layer:
        """Return the layer for the hits `part` of the batch, which become a batch of their own."""
        low, high = np.searchsorted(self.rows, [part.start, part.stop])
        own = slice(int(low), int(high))
        return Layer(self.rows[own] - part.start, self.hits.at(own), self.direction[own], self.Od[own])

    def among(self, rows: NDArray[np.int64]) -> Layer:
        """Return the layer for the hits `rows` of the batch, ascending, which become a batch of their own."""
        own = np.flatnonzero(np.isin(self.rows, rows))
        return Layer(np.searchsorted(rows, self.rows[own]), self.hits.at(own), self.direction[own], self.Od[own])


def further(hits: Hits) -> list[tuple[NDArray[np.int64], Hits]]:
    """Yield the further layers of hits: each with the rows (k,) of the hits that have it, ascending, and its surfaces
    there.
    """
    found, m = [], hits.table
    rows, row = np.flatnonzero(m.also[hits.row] >= 0), hits.row
    smooth = hits.Ns if hits.smooth is None else hits.smooth
    while len(rows):
        row = m.also[row[rows]] if row is hits.row else m.also[row]
        kept = np.flatnonzero(row >= 0)
        rows, row = rows[kept], row[kept]
        if len(rows):
            own, unbent = m.bent[row], smooth[rows]
            Ns = np.where(np.isfinite(own[:, :1]), own, unbent)
            found.append((rows, hits.at(rows)._replace(row=row, Ns=np.ascontiguousarray(Ns), smooth=unbent)))
    return found


def lit(layers: Sequence[tuple[NDArray[np.int64], Hits]], direction: NDArray[np.float64],
        textures: Sequence[Texture | None]) -> list[Layer]:
    """Return these layers of hits of rays along `direction` (n,3), in the form in which lights see them."""
    made = []
    for rows, hits in layers:
        way, Od = direction[rows], colours.matt(hits, textures)
        shading.dim(hits.table, hits, way, Od)
        made.append(Layer(rows, hits, way, Od))
    return made
