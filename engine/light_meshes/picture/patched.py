"""How the rays of rough surfaces see matt surfaces: by the light of patches, which is known already because light is
gathered.

A rough surface shows its surroundings by many rays a pixel, each of which stands for a part of the lobe of its
microfacets. Lighting each hit like a hit of the camera's rays would take most of the time of a picture, and the lobe
blurs the result. So the light that arrives at a hit is the mean over a patch (`gathered.patches`) that is about as
large as this part of the lobe is there. The colour is that of the hit. Microfacets of plastics, and sheen, reflect this
light as if it came from everywhere alike: highlights of lamps are spread out. Metals, mirrors and glass are lit in
full.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..film.passes import Tile
from ..rays.geometry import Hits
from ..surface import albedo
from ..surface.shading import Materials
from .prepared import Prepared
from .reflections import LOBE
from .wave import Rays


def patched(ready: Prepared, rays: Rays, hits: Hits, came: NDArray[np.float64], tile: Tile,
            check: Callable[[], None]) -> tuple[Rays, Hits]:
    """Add the light of matt surfaces that rays of rough surfaces hit; return the rays and the hits that are left. came
    (n,3): the points from which the rays come.
    """
    assert rays.blur is not None and ready.lighting.everywhere is not None
    m, row = hits.table, hits.row
    seen = (rays.blur > 0) & _matt(m)[row]
    if ready.plan.transparent:
        seen &= ~ready.glass.passes[hits.triangle]
    rows = np.flatnonzero(seen)
    if not len(rows):
        return rays, hits
    some, own = rays.at(rows), hits.at(rows)
    size = np.sqrt(LOBE * ((own.P - came[rows])**2).sum(1)) * rays.blur[rows]**2
    lamps, around = ready.lighting.everywhere.nearly(own, some.direction, size, check)
    share = albedo.toward(own, some.direction, ready.world.textures)
    highlights = albedo.usual_gloss(own)
    light = (share.matt + highlights) * lamps + (share.matt + share.gloss) * around
    emission = own.table.emission[own.row]
    if ready.world.as_lamps is not None:  # rough surfaces have highlights of those lamps
        emission = np.where(ready.world.as_lamps[own.triangle][:, None], 0.0, emission)
    light += emission
    tile.add_light(some.pixel, some.part, some.weight, light, {}, ready.scene.settings.clamp_indirect)
    rest = np.flatnonzero(~seen)
    return rays.at(rest), hits.at(rest)


def _matt(m: Materials) -> NDArray[np.bool_]:
    """Return the rows (M,) of materials that are neither mirrors nor metals nor let light through, in any layer."""
    found = (m.metal == 0) & (m.mirror.max(1, initial=0) == 0) & (m.translucent.max(1, initial=0) == 0)
    if not (m.also >= 0).any():
        return found
    while True:
        both = found & ((m.also < 0) | found[m.also])
        if np.array_equal(both, found):
            return found
        found = both
