"""Find triangles that make every ray slow: they are long, thin and slanted, so that their boxes are almost empty.

Embree uses axis-aligned boxes to find what a ray may hit. A line through a box hits, on average, as many of the boxes
inside it as the ratio of the sum of their surfaces to its own (Cauchy and Crofton). Measured: 0.2 to 0.6 µs for a ray
in usual scenes, and 2 to 50 ns more for each needless box.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Scene
from ..support.native import kernel

_needless = kernel("slivers_needless")
# a sliver's box has more than this many times the surface of its triangle; the ratio is 2 to 6 for well-shaped
# triangles
THIN = 50.0
MANY = 300.0  # such boxes per ray; from here on rays are 5 to 50 times slower


def sliver_warnings(scene: Scene, vertices: NDArray[np.float32], triangles: NDArray[np.int32],
                    instance: NDArray[np.int32]) -> list[str]:
    """Return one sentence for each object whose slivers make rays slow that come near it.

    `vertices` (V,3) may be in any frame; `triangles` (T,3) must have an area; `instance` is (T,).
    """
    objects = len(scene.objects)
    area, count = np.zeros(objects), np.zeros(objects, np.int64)
    low, high = np.full((objects, 3), np.inf), np.full((objects, 3), -np.inf)
    owner = scene.geometry.instance_object[instance].astype(np.int32)
    _needless(vertices, triangles, owner, THIN, area, count, low, high)
    slow = np.flatnonzero(count >= MANY)
    x, y, z = (high[slow] - low[slow]).T
    share = area[slow] / (2 * (x * y + y * z + z * x))
    return [f"object '{scene.objects[o].name}': {count[o]:,} of its triangles are long, thin and slanted, and a ray "
            f"near it must test about {n:,.0f} of them: rendering is slow; cut them across into shorter pieces"
            for o, n in zip(slow.tolist(), share.tolist(), strict=True) if n >= MANY]
