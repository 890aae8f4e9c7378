"""Triangles that make every ray slow: long, thin and slanted, so that their boxes are full of nothing.

Embree finds what a ray may hit by boxes along the axes. Of boxes within a box a line through it pierces, in the mean,
as many as their surface is times its own (Cauchy and Crofton). Measured: 0.2 to 0.6 µs a ray in usual scenes, and
2 to 50 ns more for each needless box.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Scene
from ..support.compiled import kernel

THIN = 50.0  # a box with so many times the surface of its triangle: 2 to 6 where triangles are well shaped
MANY = 300.0  # such boxes a ray: from here on rays are 5 to 50 times slower


@kernel
def _needless(vertices, triangles, owner, area, count, low, high):
    """Adds up, for each object, the surface of the boxes of its slivers, counts them, and widens low, high (O,3)."""
    for t in range(len(triangles)):
        o = owner[t]
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        e = np.float64(b[0]) - a[0], np.float64(b[1]) - a[1], np.float64(b[2]) - a[2]
        f = np.float64(c[0]) - a[0], np.float64(c[1]) - a[1], np.float64(c[2]) - a[2]
        x = max(e[0], f[0], 0.0) - min(e[0], f[0], 0.0)
        y = max(e[1], f[1], 0.0) - min(e[1], f[1], 0.0)
        z = max(e[2], f[2], 0.0) - min(e[2], f[2], 0.0)
        box = 2.0 * (x * y + y * z + z * x)
        u, v, w = e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]
        if box * box > THIN * THIN * (u * u + v * v + w * w):
            area[o] += box
            count[o] += 1
        for i in range(3):
            low[o, i] = min(low[o, i], a[i], b[i], c[i])
            high[o, i] = max(high[o, i], a[i], b[i], c[i])


def sliver_warnings(scene: Scene, vertices: NDArray[np.float32], triangles: NDArray[np.int32],
                    instance: NDArray[np.int32]) -> list[str]:
    """A sentence an object whose slivers make rays slow that come near it.

    vertices (V,3) in any frame; triangles (T,3) with an area; instance (T,).
    """
    objects = len(scene.objects)
    area, count = np.zeros(objects), np.zeros(objects, np.int64)
    low, high = np.full((objects, 3), np.inf), np.full((objects, 3), -np.inf)
    _needless(vertices, triangles, scene.geometry.instance_object[instance], area, count, low, high)
    slow = np.flatnonzero(count >= MANY)
    x, y, z = (high[slow] - low[slow]).T
    share = area[slow] / (2 * (x * y + y * z + z * x))
    return [f"object '{scene.objects[o].name}': {count[o]:,} of its triangles are long, thin and slanted, and a ray by "
            f"it must look at about {n:,.0f} of them: rendering is slow; cut them across into shorter pieces"
            for o, n in zip(slow.tolist(), share.tolist(), strict=True) if n >= MANY]
