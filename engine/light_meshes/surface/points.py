"""Points of surfaces: everything that programs of materials may ask about them."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Surfaces
from ..scene.description import Camera, Scene
from .profiles import Lookup

# Kinds of rays that come to a point. LIGHTING is the world's: what lights surfaces.
CAMERA, SHADOW, REFLECTED, TRANSMITTED, LIGHTING = range(5)


class Around:
    """The values that are the same for all points: spaces of instances, attributes, the camera, profiles."""

    def __init__(self, scene: Scene, surfaces: Surfaces, camera: Camera) -> None:
        g = scene.geometry
        self.surfaces, self.attributes, self.instance_values = surfaces, g.attributes, g.instance_values
        self.to_object = np.linalg.pinv(g.instance_matrix)[:, :3]  # (I,3,4) world to the instance's own space
        size = np.array([o.texture_size for o in scene.objects], np.float64).reshape(-1, 3)[g.instance_object]
        place = np.array([o.texture_location for o in scene.objects], np.float64).reshape(-1, 3)[g.instance_object]
        scale = np.where(size != 0, 0.5 / np.where(size != 0, size, 1.0), 0.0)
        self.to_generated = self.to_object * scale[:, :, None]  # (I,3,4) world to the texture space of its mesh
        self.to_generated[:, :, 3] += 0.5 - place * scale
        self.camera, self.to_camera = camera, np.linalg.inv(camera.matrix)[:3]
        self.eye = np.zeros(3)  # from where points are seen that are directions: those of the world
        self.profiles = [Lookup(profile) for profile in scene.profiles]

    @cached_property
    def from_object(self) -> NDArray[np.float64]:
        """Return the ways back from instances' own spaces (I,3,3), made when a program first asks for them."""
        return np.linalg.pinv(self.to_object[:, :, :3])

    def pixel(self, P: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how wide (n,) a pixel is at points P (n,3), scene units, measured across the line of sight."""
        c = self.camera
        left, right, bottom, top = c.window
        wide, high = abs(right - left) / c.width, abs(top - bottom) / c.height
        if not c.perspective:
            return np.full(len(P), (wide + high) / 2)
        seen = np.einsum("ij,nj->ni", self.to_camera[:, :3], P) + self.to_camera[:, 3]
        far = np.maximum(np.linalg.norm(seen, axis=1), 1e-30)
        x, y, z = (seen / far[:, None]).T
        return far * np.abs(z) * (wide * np.sqrt(1 - x * x) + high * np.sqrt(1 - y * y)) / 2


class Points(NamedTuple):
    """Surface points (n,)."""

    P: NDArray[np.float64]  # (n,3) world
    Ns: NDArray[np.float64]  # (n,3) unit, to the side that the ray came from
    Ng: NDArray[np.float64]  # (n,3)
    incoming: NDArray[np.float64]  # (n,3) unit, to where the ray came from
    front: NDArray[np.bool_]  # (n,)
    uv: NDArray[np.floating]  # (n,2)
    triangle: NDArray[np.int32]  # (n,)
    ray: NDArray[np.int8]  # (n,) the kind of ray
    around: Around

    def at(self, rows: NDArray) -> Points:
        """Return these points only."""
        return Points._make([*(a[rows] for a in self[:-1]), self.around])

    @property
    def instance(self) -> NDArray[np.int32]:
        """Return the instances (n,) that they belong to."""
        return self.around.surfaces.instance[self.triangle]

    def at_corners(self, values: NDArray) -> NDArray[np.float64]:
        """Return values (n,k) that vary evenly over triangles, from those at their corners (scene triangles,3,k)."""
        s = self.around.surfaces
        a, b, c = np.moveaxis(s.vertices[s.triangles[self.triangle]].astype(np.float64), 1, 0)
        e, f, q = b - a, c - a, (self.P - s.centre) / s.scale - a
        normal = np.cross(e, f)
        square = np.maximum(np.einsum("ni,ni->n", normal, normal), 1e-300)
        u = np.einsum("ni,ni->n", np.cross(q, f), normal) / square
        v = np.einsum("ni,ni->n", np.cross(e, q), normal) / square
        weight = np.stack([1 - u - v, u, v], axis=1)
        return np.einsum("ni,nik->nk", weight, s.at_corners(values, self.triangle))

    @property
    def parametric(self) -> NDArray[np.float64]:
        """Return where on their triangles points are: the shares (n,2) of the first and of the second corner."""
        return self.at_corners(np.broadcast_to(np.eye(3), (len(self.around.surfaces.materials), 3, 3)))[:, :2]

    def steps(self, width: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return two steps (n,3) of `width` pixels on the surface, at right angles to each other, in the directions of
        Cycles.
        """
        x, y, z = self.Ng.T
        along = np.where(((x == y) & (x == z))[:, None], np.stack([z - y, x + z, -y - x], 1),
                         np.stack([z - y, x - z, y - x], 1))
        along *= (width * self.around.pixel(self.P) / np.linalg.norm(along, axis=1))[:, None]
        return along, np.cross(self.Ng, along)

    def shifted(self, direction: int, width: float) -> Points:
        """Return these points, moved by the first (1) or second (2) of `steps`; 0: not moved. Values at the corners of
        a triangle are continued evenly beyond its edges.
        """
        P = self.P + self.steps(width)[direction - 1] if direction else self.P
        moved = self._replace(P=P)
        uvs = self.around.surfaces.uvs
        return moved._replace(uv=moved.at_corners(uvs)) if len(uvs) else moved
