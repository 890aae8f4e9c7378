"""Triangles that make every ray slow: long, thin and slanted, so that their boxes are full of nothing.

Embree finds what a ray may hit by boxes along the axes. Of boxes in a convex scene a ray pierces, in the mean, as many
as their surface area is times the scene's (Cauchy and Crofton). Measured: 0.2 to 0.6 µs a ray in usual scenes, and
2 to 50 ns more for each needless box.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .compiled import kernel
from .scene import Scene

THIN = 50.0  # a box with so many times the surface of its triangle: 2 to 6 where triangles are well shaped
MANY = 300.0  # such boxes a ray: from here on rendering is about ten times slower


@kernel
def _needless(vertices, triangles, instance, area, count):
    """Adds up, for each instance, the surface of the boxes of its slivers, and counts them."""
    for t in range(len(triangles)):
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        e = np.float64(b[0]) - a[0], np.float64(b[1]) - a[1], np.float64(b[2]) - a[2]
        f = np.float64(c[0]) - a[0], np.float64(c[1]) - a[1], np.float64(c[2]) - a[2]
        x = max(e[0], f[0], 0.0) - min(e[0], f[0], 0.0)
        y = max(e[1], f[1], 0.0) - min(e[1], f[1], 0.0)
        z = max(e[2], f[2], 0.0) - min(e[2], f[2], 0.0)
        box = 2.0 * (x * y + y * z + z * x)
        u, v, w = e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]
        if box * box > THIN * THIN * (u * u + v * v + w * w):
            area[instance[t]] += box
            count[instance[t]] += 1


def sliver_warnings(scene: Scene, vertices: NDArray[np.float32], triangles: NDArray[np.int32],
                    instance: NDArray[np.int32]) -> list[str]:
    """A sentence where slivers make rays slow, with the object that has most of them.

    vertices (V,3) in any frame; triangles (T,3) with an area; instance (T,).
    """
    if len(triangles) < MANY:
        return []
    area, count = np.zeros(len(scene.geometry.instance_mesh)), np.zeros(len(scene.geometry.instance_mesh), np.int64)
    _needless(vertices, triangles, instance, area, count)
    finite = vertices[np.isfinite(vertices).all(1)]
    x, y, z = np.ptp(finite, axis=0).astype(np.float64)
    boxes = area / (2 * (x * y + y * z + z * x))
    if boxes.sum() < MANY:
        return []
    owner = scene.geometry.instance_object
    share = np.bincount(owner, boxes, len(scene.objects))
    worst = int(share.argmax())
    number = int(np.bincount(owner, count, len(scene.objects))[worst])
    return [f"object '{scene.objects[worst].name}': {number:,} of its triangles are long, thin and slanted, and a ray "
            f"must look at about {share[worst]:,.0f} of them: rendering is slow; cut them across into shorter pieces"]
