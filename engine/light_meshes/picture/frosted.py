"""Rough glass: the rays of what is seen through it, and mirrored in it, blurred."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..glass.interfaces import Face
from ..rays.geometry import Hits
from ..surface.blurred import facets, unmasked
from .prepared import Prepared
from .reflections import going, mirrored, upwards
from .wave import Rays

BENDS = 64  # a ray through glass bends at up to this many surfaces and then goes straight on


def frosted(ready: Prepared, rays: Rays, through: Rays, hits: Hits, share: NDArray,
            face: Face) -> list[tuple[str, Rays]]:
    """Return the rays that rough glass sends on and back, one or more for each ray that hits it. The share of light
    that they carry is taken away from `face`.

    Each ray meets a microfacet, which is a smooth surface of glass. through: the rays (n,) as they are behind surfaces.
    share (n,3): the weight of their light.
    """
    assert rays.fan is not None and rays.blur is not None and rays.media is not None and rays.mirrored is not None
    roughness = hits.table.frosted[hits.row]
    rough = np.flatnonzero((roughness > 0) & face.real & face.bends & (rays.depth < BENDS))
    if not len(rough):
        return []
    found = facets(roughness[rough], hits.at(rough), rays.direction[rough], rays.fan[rough], rays.depth[rough],
                   upwards(ready), len(ready.offsets), ready.scene.settings.reflection_rays)
    rows = rough[found.hit]
    at = hits.at(rows)._replace(Ns=found.normal)
    own = ready.glass.interface(at, rays.direction[rows], rays.media[rows])
    weight = share[rows] * found.share[:, None]
    once = ~hits.table.fresnel[hits.row[rows]]  # of these light that is masked is lost
    weight[once] *= unmasked(roughness[rows[once]], -(rays.direction[rows[once]] * hits.Ns[rows[once]]).sum(1),
                             -(own.refracted[once] * hits.Ns[rows[once]]).sum(1))[:, None]
    # Lamps are seen through rough glass; in what it mirrors they have highlights.
    on = through.at(rows)._replace(media=own.media, fan=found.fan)
    children = going(ready, "reflection", on, at, weight * own.kt, own.refracted, 1)
    events = np.where(own.kt.any(1), rays.depth[rows], rays.mirrored[rows])
    may = (events < ready.scene.settings.max_depth) & ready.plan.reflections
    back = rays.at(rows)._replace(clear=np.zeros(len(rows), np.bool_), fan=found.fan,
                                  blur=np.maximum(rays.blur[rows], found.blur))
    children += mirrored(ready, back, at, weight * own.mirror, may)
    face.kt[rough] = face.mirror[rough] = 0.0
    return children
