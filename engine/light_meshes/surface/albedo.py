"""The share of light that surfaces return if the same light comes from everywhere: by their matt part, microfacets,
coat and sheen together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits
from . import blurred, colours, layers, shading
from .textures import Texture

# Cosines at which a surface is seen, and their shares of the light that it returns: Gauss's rule for the weight 2c.
_FACING = ((0.355051, 0.363917), (0.844949, 0.636083))


class Share(NamedTuple):
    """The share of light (n,3) that hits return in one direction."""

    matt: NDArray[np.float64]
    gloss: NDArray[np.float64]  # by microfacets, by sheen and as mirrors


def toward(hits: Hits, direction: NDArray[np.float64], textures: Sequence[Texture | None]) -> Share:
    """Return what hits return to where rays along `direction` (n,3) come from, by all layers."""
    found = _of_layer(hits, direction, textures)
    for rows, layer in _further(hits):
        for whole, more in zip(found, _of_layer(layer, direction[rows], textures), strict=True):
            whole[rows] += more
    return found


def mean(hits: Hits, textures: Sequence[Texture | None]) -> NDArray[np.float64]:
    """Return the share (n,3) that hits return to all directions together."""
    if not hits.table.blurred[hits.row].any():  # and so it is the same for all of them
        return np.add(*toward(hits, -hits.Ns, textures))
    found = np.zeros((len(hits.P), 3))
    for cosine, share in _FACING:
        found += share * np.add(*toward(hits, _leaning(hits.Ns, cosine), textures))
    return found


def usual_gloss(hits: Hits) -> NDArray[np.float64]:
    """Return `Share.gloss` (n,3) in a usual direction, at the mean cosine of light that comes from all around."""
    direction = _leaning(hits.Ns, 2 / 3)
    found = _gloss(hits, direction)
    for rows, layer in _further(hits):
        found[rows] += _gloss(layer, direction[rows])
    return found


def _further(hits: Hits) -> Sequence[tuple[NDArray[np.int64], Hits]]:
    return layers.further(hits) if (hits.table.also[hits.row] >= 0).any() else ()


def _of_layer(hits: Hits, direction: NDArray[np.float64], textures: Sequence[Texture | None]) -> Share:
    m, row, Od = hits.table, hits.row, colours.matt(hits, textures)
    shading.dim(m, hits, direction, Od)
    return Share(m.kd[row, None] * Od, _gloss(hits, direction))


def _gloss(hits: Hits, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    m, row = hits.table, hits.row
    found = np.maximum(m.mirror[row], m.metal[row, None] * m.F0[row])
    lobes = m.blurred[row]
    return np.where(lobes[:, None], blurred.albedo(hits, direction), found) if lobes.any() else found


def _leaning(N: NDArray[np.float64], cosine: float) -> NDArray[np.float64]:
    """Return unit directions (n,3) that come to surfaces with the unit normals N (n,3) at this cosine."""
    aside = np.zeros_like(N)
    aside[np.arange(len(N)), np.abs(N).argmin(1)] = 1
    aside -= (aside * N).sum(1, keepdims=True) * N
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    return np.asarray(np.sqrt(1 - cosine * cosine) * aside - cosine * N)
