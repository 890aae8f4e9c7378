"""Triangles that make every ray slow: long, thin and slanted, so that their boxes are full of nothing.

Embree finds what a ray may hit by boxes along the axes. Of boxes within a box a line through it pierces, in the mean,
as many as their surface is times its own (Cauchy and Crofton). Measured: 0.2 to 0.6 µs a ray in usual scenes, and
2 to 50 ns more for each needless box.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Scene
from ..support.native import kernel

_needless = kernel("slivers_needless")
THIN = 50.0  # a box with so many times the surface of its triangle: 2 to 6 where triangles are well shaped
MANY = 300.0  # such boxes a ray: from here on rays are 5 to 50 times slower


def sliver_warnings(scene: Scene, vertices: NDArray[np.float32], triangles: NDArray[np.int32],
                    instance: NDArray[np.int32]) -> list[str]:
    """A sentence an object whose slivers make rays slow that come near it.

    vertices (V,3) in any frame; triangles (T,3) with an area; instance (T,).
    """
    objects = len(scene.objects)
    area, count = np.zeros(objects), np.zeros(objects, np.int64)
    low, high = np.full((objects, 3), np.inf), np.full((objects, 3), -np.inf)
    owner = scene.geometry.instance_object[instance].astype(np.int32)
    _needless(vertices, triangles, owner, THIN, area, count, low, high)
    slow = np.flatnonzero(count >= MANY)
    x, y, z = (high[slow] - low[slow]).T
    share = area[slow] / (2 * (x * y + y * z + z * x))
    return [f"object '{scene.objects[o].name}': {count[o]:,} of its triangles are long, thin and slanted, and a ray by "
            f"it must look at about {n:,.0f} of them: rendering is slow; cut them across into shorter pieces"
            for o, n in zip(slow.tolist(), share.tolist(), strict=True) if n >= MANY]
