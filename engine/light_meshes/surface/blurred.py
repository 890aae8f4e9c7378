"""What rough surfaces reflect of what is around them: a few rays for each, spread over the lobe of their microfacets.

There are no random numbers. All samples of all pixels have the same set of directions around the ray that they come
along: the points of Sobol's sequence in a disk, which Heitz's method makes microfacets of. The samples of a pixel share
them out, each the next few of the sequence, so that together they are spread as evenly as each alone. A ray that was
spread out once goes on as one ray at the next rough surface, with a point of its own.

Rays are for what is seen: where a rough surface reflects little (a matt plastic seen from above), none is sent, and
`left` says what the lobe would reflect. It gets what records know of its directions (gathered/sectors.h), or, without
light from everywhere, the world's light as if nothing stood before it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits
from ..support.native import kernel

_count, _rays = kernel("blurred_count"), kernel("blurred_rays")
_glass_count, _glass = kernel("blurred_glass_count"), kernel("blurred_glass")


class Spread(NamedTuple):
    """The rays (m,) that hits reflect, and what of the light from everywhere around (n,3) is not followed by them."""

    hit: NDArray[np.int64]  # (m,) the hit that each leaves
    direction: NDArray[np.float64]  # (m,3) unit
    weight: NDArray[np.float64]  # (m,3) what of the light that it finds counts
    fan: NDArray[np.int32]  # (m,) as in `wave.Rays`
    blur: NDArray[np.float64]  # (m,) the roughness of the lobe; 0: as good as a mirror
    left: NDArray[np.float64]  # (n,3)
    rough: NDArray[np.float64]  # (n,) how rough the lobes of what is left are, a mean


def spread(hits: Hits, direction: NDArray[np.float64], weight: NDArray[np.float64], fan: NDArray[np.int32],
              depth: NDArray[np.integer], may: NDArray[np.bool_], up: NDArray[np.float64], samples: int,
              rays: int, cutoff: float, later: float) -> Spread:
    """Return what surfaces reflect of their surroundings whose material is `blurred`; nothing at all others.

    direction (n,3): of the rays that hit them, which count with weight (n,3), have met `depth` (n,) lobes before, and
    are those of `fan` (n,). may (n,): which may go on. up (3,): the camera's, unit. samples: of a pixel, and how many
    rays should follow a wide lobe from all of them. Rays with less weight than cutoff are not sent, nor with less than
    `later` those of rays that were spread out before.
    """
    ggx, tables = hits.table.facets()
    n, m = len(hits.P), hits.table
    matt = np.ascontiguousarray(m.kd[hits.row] * m.Od[hits.row].max(1, initial=0))
    count, left, rough = np.zeros((n, 2), np.int32), np.zeros((n, 3)), np.ones(n)
    if ggx is not None:
        _count(ggx, tables, hits.table.blurred, direction, hits.Ns, hits.row, fan, may, matt, weight, cutoff, later,
               samples, rays, count, left, rough)
    sent = int(count.sum())
    found = Spread(np.empty(sent, np.int64), np.empty((sent, 3)), np.empty((sent, 3)), np.empty(sent, np.int32),
                   np.empty(sent), left, rough)
    if sent:
        _rays(ggx, tables, direction, hits.Ng, hits.Ns, hits.row, fan, depth.astype(np.int32), matt, weight, up,
              samples, count, *found[:5])
    return found


def albedo(hits: Hits, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what lobes of microfacets and sheen reflect of light from everywhere around (n,3), for an eye from which
    rays along `direction` (n,3) come; 0 where the material is not `blurred`.
    """
    n = len(hits.P)
    fan, never, some = np.full(n, -1, np.int32), np.zeros(n, np.bool_), np.ones((n, 3))
    return spread(hits, direction, some, fan, fan, never, some[0], 1, 1, 0.0, 0.0).left


class Facets(NamedTuple):
    """The microfacets of rough glass that rays meet (m,)."""

    hit: NDArray[np.int64]  # (m,) the hit where each is
    normal: NDArray[np.float64]  # (m,3) unit
    fan: NDArray[np.int32]  # (m,) these two are as in `wave.Rays`
    blur: NDArray[np.float64]  # (m,)
    share: NDArray[np.float64]  # (m,) of the light at its hit


def facets(roughness: NDArray[np.float64], hits: Hits, direction: NDArray[np.float64], fan: NDArray[np.int32],
           depth: NDArray[np.integer], up: NDArray[np.float64], samples: int,
           rays: int) -> Facets:
    """Return the microfacets that rays of `direction` (n,3) meet at glass of this roughness (n,); see `spread`.

    All have the same share of a ray's light: what one masks others send on.
    """
    count = np.empty(len(fan), np.int32)
    _glass_count(roughness, fan, samples, rays, count)
    m = int(count.sum())
    hit, normal, number, blur = np.empty(m, np.int64), np.empty((m, 3)), np.empty(m, np.int32), np.empty(m)
    _glass(direction, hits.Ns, roughness, fan, depth.astype(np.int32), up, samples, count, hit, normal, number, blur)
    return Facets(hit, normal, number, blur, 1.0 / count[hit])


def unmasked(roughness: NDArray[np.float64], to: NDArray[np.float64], away: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what microfacets that an eye sees at the cosine `to` do not mask of the light at the cosine `away`, all
    (n,).
    """
    aa = roughness**4
    own, other = (np.sqrt(1 + aa * (1 / np.maximum(c, 1e-3)**2 - 1)) for c in (to, away))
    return np.where(away > 0, (1 + own) / (own + other), 0.0)
