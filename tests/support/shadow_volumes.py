"""Find where a picture's penumbra is, from exact geometry: shadow volumes of convex solids in float64.

The volume from which a convex solid blocks a point light is convex itself. It lies behind the solid's lit faces, and
inside the planes through the light and the solid's silhouette. So the tests "the half-ball at P is fully lit" and
"fully dark" only compare distances to planes, without a ray or a lattice.
"""

from __future__ import annotations

import numpy as np
from light_meshes import Mesh


def shadow_volume(solid: Mesh, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return planes (n, c): the shadow is where n·x ≤ c for every plane, with n unit and outward."""
    corners = solid.vertices[solid.triangles]
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    c = np.einsum("ti,ti->t", n, corners[:, 0])
    lit = n @ light > c
    owner = {(t[k], t[(k + 1) % 3]): f for f, t in enumerate(solid.triangles.tolist()) for k in range(3)}
    middle = solid.vertices.mean(0)
    planes = [(n[f], c[f]) for f in np.flatnonzero(lit)]
    for (a, b), face in owner.items():
        if lit[face] and not lit[owner[b, a]]:
            m = np.cross(solid.vertices[a] - light, solid.vertices[b] - light)
            m /= np.linalg.norm(m)
            if m @ (middle - light) > 0:
                m = -m
            planes.append((m, m @ light))
    return np.array([p[0] for p in planes]), np.array([p[1] for p in planes])


def uniform(P: np.ndarray, N: np.ndarray, r: float, volumes: list[tuple[np.ndarray, np.ndarray]]
            ) -> tuple[np.ndarray, np.ndarray]:
    """Return (lit, dark) for each half-ball at P (n,3) above N (n,3): whether all of it surely is so. If neither, it is
    penumbra.

    It is surely lit if for every solid one plane has all of the half-ball outside, and surely dark if for one solid
    every plane has it inside. Cases in between count as penumbra.
    """
    lit, dark = np.ones(len(P), bool), np.zeros(len(P), bool)
    for n, c in volumes:
        height = P @ n.T - c
        lean = np.clip(N @ n.T, -1, 1)
        rim = r * np.sqrt(1 - lean**2)  # extent of the flat side of the half-ball
        lowest = height - np.where(lean > 0, rim, r)
        highest = height + np.where(lean > 0, r, rim)
        guard = 1e-6 * r  # P may lie on the solid's own face, where the height is 0 except for rounding
        lit &= (lowest >= -guard).any(1)
        dark |= (highest <= guard).all(1)
    return lit, dark


def first_hit(eye: np.ndarray, directions: np.ndarray, solids: list[Mesh]
              ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (P, N, solid) of rays from outside onto convex solids, each clipped by its planes; solid is −1 for a
    miss.
    """
    best = np.full(len(directions), np.inf)
    N, solid = np.zeros_like(directions), np.full(len(directions), -1)
    for number, mesh in enumerate(solids):
        corners = mesh.vertices[mesh.triangles]
        n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        n = np.unique(np.round(n / np.linalg.norm(n, axis=1, keepdims=True), 12), axis=0)
        height = (eye @ n.T) - (mesh.vertices @ n.T).max(0)
        enter, leave = np.full(len(directions), -np.inf), np.full(len(directions), np.inf)
        face = np.zeros(len(directions), int)
        for k in range(len(n)):
            slope = directions @ n[k]
            with np.errstate(divide="ignore", invalid="ignore"):
                t = -height[k] / slope
            later = (slope < 0) & (t > enter)
            enter, face = np.where(later, t, enter), np.where(later, k, face)
            leave = np.where(slope > 0, np.minimum(leave, t), leave)
            if height[k] > 0:
                leave = np.where(slope == 0, -np.inf, leave)
        nearer = (enter < leave) & (enter > 0) & (enter < best)
        best = np.where(nearer, enter, best)
        N[nearer], solid[nearer] = n[face[nearer]], number
    return eye + np.where(solid >= 0, best, 0)[:, None] * directions, N, solid
