"""Highlights of curved surfaces that are smaller than the distance of samples.

On a rim a fraction of a pixel wide the normal turns so fast that few samples, or none, meet the highlight of a lamp:
the picture has specks, which come and go in animations. Each sample stands for a part of its pixel, and there the
normals vary: so the microfacets are spread wider there, by as much (Kaplanyan, Hill, Patney and Lefohn, "Filtering
distributions of normals for shading antialiasing", 2016; Tokuyoshi and Kaplanyan 2019).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits, Surfaces
from ..scene.description import Camera
from ..support.native import kernel
from .shading import SMOOTHEST

_of = kernel("curvature_of")
MOST = 0.18  # of the variance: beyond it highlights would get too wide (Tokuyoshi and Kaplanyan)
STEEP = 0.1  # surfaces are seen at this cosine at least
LITTLE = 0.01  # less, as a share of the microfacets' own variance, is left out


def curvature(surfaces: Surfaces) -> NDArray[np.float32]:
    """Return how much the shading normal of each triangle (T,) turns along its surface, at most: radians a scene unit.
    """
    s, found = surfaces, np.empty(len(surfaces.triangles), np.float32)
    _of(s.scale, s.vertices, s.triangles, s.instance, s.source, s.corner_normals, s.normal_matrix, found)
    return found


def variance(curved: NDArray[np.float32], camera: Camera, share: float, hits: Hits,
             direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the variance (n,) of the slopes of surfaces in the part of a pixel for which a sample stands.

    curved (T,): from `curvature`. share: the width of that part, in pixels. hits (n,): those of rays along `direction`
    (n,3) from the camera.
    """
    left, right, _, _ = camera.window
    far = np.linalg.norm(hits.P - camera.matrix[:3, 3], axis=1) if camera.perspective else np.ones(len(hits.P))
    wide = far * (share * (right - left) / camera.width)
    cosine = np.maximum(np.abs(np.einsum("ni,ni->n", hits.Ng, direction)), STEEP)
    found: NDArray[np.float64] = np.minimum((curved[hits.triangle] * wide) ** 2 / (12 * cosine), MOST)
    return found


def widened(roughness: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the roughness (n,) of microfacets on surfaces whose own slopes have this variance (n,)."""
    square = np.maximum(roughness, SMOOTHEST)**4  # of the microfacets' alpha
    more = 2 * variance
    return np.where(more > LITTLE * square, np.sqrt(np.sqrt(square + more)), roughness)
