"""All triangles of a scene in one set of arrays, and the places where its meshes stand.

A frontend that has its meshes one by one makes it by `Geometry.from_meshes`; `arrays.py` reads it from a folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import SceneError
from .mesh import Mesh, numbers


@dataclass(frozen=True)
class Geometry:
    """All meshes in one set of arrays, and their instances.

    Mesh m has vertices[v0 : v0+nv] and triangles[t0 : t0+nt], with (v0, nv, t0, nt) = meshes[m].
    """

    vertices: NDArray[np.float32]  # (V,3) local
    triangles: NDArray[np.int32]  # (T,3) indices from 0 within the mesh, counter-clockwise from outside
    corner_normals: NDArray[np.float32]  # (T,3,3) local, unit; the shading normals
    uvs: NDArray[np.float32]  # (T,3,2), or (0,3,2) where no material has an image
    triangle_materials: NDArray[np.int32]  # (T,) index into Scene.materials
    meshes: NDArray[np.int64]  # (M,4) v0, nv, t0, nt
    instance_mesh: NDArray[np.int32]  # (I,)
    instance_object: NDArray[np.int32]  # (I,) index into Scene.objects
    instance_matrix: NDArray[np.float64]  # (I,4,4) local to world
    # What programs of materials ask for by channel (operations "attribute" and "instance"): at triangles' corners, and
    # of instances. Of no triangles, or no channels, where nothing asks.
    attributes: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3, 0), np.float32))  # (T,3,A)
    instance_values: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 0), np.float32))  # (I,K)

    @classmethod
    def from_meshes(cls, meshes: Sequence[Mesh], materials: Sequence[int | NDArray[np.integer[Any]]] | None = None,
                    instances: Sequence[tuple[int, int, ArrayLike]] | None = None) -> Geometry:
        """Return all `meshes` in one set of arrays. `Scene.from_shapes` is simpler where each has one material.

        materials: of each mesh the index of its material, or those (t,) of its triangles; None: all have material 0.
        instances: (mesh, object, matrix) for each place where a mesh stands, matrix (4,4) local to world; None: each
        mesh stands once, where its vertices are, as the object of its own number. Raises SceneError.
        """
        if materials is None:
            materials = [0] * len(meshes)
        if instances is None:
            instances = [(n, n, np.eye(4)) for n in range(len(meshes))]
        if len(materials) != len(meshes):
            raise SceneError(f"there are {len(meshes)} meshes, but materials for {len(materials)}")
        counts = np.array([(len(m.vertices), len(m.triangles)) for m in meshes], int).reshape(-1, 2)
        starts = np.cumsum(counts, 0) - counts
        uvs = [np.zeros((len(m.triangles), 3, 2)) if m.uvs is None else m.uvs for m in meshes]
        places = [numbers(matrix, f"the matrix of instance {n}", (4, 4)) for n, (*_, matrix) in enumerate(instances)]
        try:
            of_triangles = [np.broadcast_to(np.asarray(m, np.int32), n) for m, n in zip(materials, counts[:, 1],
                                                                                       strict=True)]
        except ValueError as e:
            raise SceneError("a mesh has one material, or one for each of its triangles") from e
        return cls(
            vertices=_stack([m.vertices for m in meshes], (0, 3), np.float32),
            triangles=_stack([m.triangles for m in meshes], (0, 3), np.int32),
            corner_normals=_stack([m.corner_normals() for m in meshes], (0, 3, 3), np.float32),
            uvs=_stack(uvs if any(m.uvs is not None for m in meshes) else [], (0, 3, 2), np.float32),
            triangle_materials=_stack(of_triangles, (0,), np.int32),
            meshes=np.stack([starts[:, 0], counts[:, 0], starts[:, 1], counts[:, 1]], 1).astype(np.int64),
            instance_mesh=np.array([mesh for mesh, _, _ in instances], np.int32),
            instance_object=np.array([number for _, number, _ in instances], np.int32),
            instance_matrix=_stack([np.array(places).reshape(-1, 4, 4)], (0, 4, 4), np.float64),
        )


def _stack(arrays: Sequence[NDArray[Any]], empty: tuple[int, ...], dtype: type) -> NDArray[Any]:
    """Return the arrays joined one after the other; if they have no rows, an array of shape `empty`."""
    arrays = [a for a in arrays if len(a)]
    return np.concatenate(arrays).astype(dtype) if arrays else np.zeros(empty, dtype)
