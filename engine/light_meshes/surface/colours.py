"""The matt colour of surfaces, from their materials, images and programs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits
from .textures import MISSING, Texture


def matt(hits: Hits, textures: Sequence[Texture | None]) -> NDArray[np.float64]:
    """Return Od (n,3) of hits."""
    Od: NDArray[np.float64] = hits.table.Od.take(hits.row, axis=0)
    if textures:
        image = hits.table.image[hits.row]
        for i, texture in enumerate(textures):
            if texture is not None:
                texture.lookup(hits.uv, np.flatnonzero(image == i), Od)
            else:
                Od[image == i] = MISSING
    return Od
