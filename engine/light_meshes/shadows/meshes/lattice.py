"""The light mesh: an infinite uniform lattice, fixed in world space, and its nodes near a receiver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...support.native import Call, kernel, needs_memory, together

# A node nearer than TAU·h to the receiver's plane is dropped: it is on the surface, and a node that touches a surface
# counts as blocked.
TAU = 1e-3

_positions, _fill, _candidates = kernel("lattice_positions"), kernel("lattice_fill"), kernel("lattice_candidates")


def _generic_rotation() -> NDArray[np.float64]:
    """Return a fixed rotation that makes no lattice plane parallel to anything that an artist builds.

    It is the unit quaternion along (1, √2, √3, √5): no two lattice directions have a rational ratio. In an axis-aligned
    lattice nodes would lie exactly on floors and walls, and the penumbra would be 3.5 times coarser (method §2).
    """
    w, x, y, z = np.sqrt([1.0, 2.0, 3.0, 5.0]) / np.sqrt(11.0)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


class Lattice(NamedTuple):
    """The node (i,j,k) is at origin + h·R·(i,j,k)."""

    h: float
    reach: NDArray[np.float64]  # (K,) the radii of the balls in steps, r/h, ascending; with one radius it is kI
    rotation: NDArray[np.float64]  # (3,3) R
    origin: NDArray[np.float64]  # (3,) world
    offsets: NDArray[np.float64]  # (3,c) all nodes that may be in the ball around any point of the cell [0,1)³

    def position(self, nodes: NDArray[np.int32]) -> NDArray[np.float64]:
        """Return the world positions (n,3) of nodes (n,3)."""
        out = np.empty((len(nodes), 3))
        together(self.place(nodes, out))
        return out

    def place(self, nodes: NDArray[np.int32], out: NDArray[np.float64]) -> Call:
        """Return the call that sets out (n,3) to the world positions of nodes (n,3). Its result is 0."""
        return _positions, self.h, self.rotation, self.origin, nodes, out


def above_a_plane(reach: float) -> float:
    """Return how many nodes, about, a ball of radius r = reach·h around a point of a plane has above it."""
    return 2 * np.pi / 3 * reach**3


def lattice(h: float, reach: NDArray[np.float64], rotate: bool = True,
            origin: tuple[float, float, float] = (0, 0, 0)) -> Lattice:
    """Return the lattice of step h for balls of the radii h·reach (K,), ascending. `rotate` applies the generic
    rotation and shift.
    """
    rotation = _generic_rotation() if rotate else np.eye(3)
    shift = rotation @ (h * (np.sqrt([2.0, 3.0, 5.0]) % 1)) if rotate else np.zeros(3)
    largest = reach[-1]
    far = int(np.ceil(largest)) + 1
    axis = np.arange(-far, far + 2, dtype=np.int32)
    cube = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    outside = np.maximum(np.maximum(-cube, cube - 1), 0)  # distance from the cell along each axis
    near = (outside.astype(np.float64) ** 2).sum(1) <= largest * largest
    cube = cube[near]
    # Sort by distance: the first candidate is the most likely to be seen, which proves that the set is not empty.
    order = np.argsort(((cube - 0.5) ** 2).sum(1), kind="stable")
    offsets = np.ascontiguousarray(cube[order].T, np.float64)
    return Lattice(h, reach, rotation, np.asarray(origin, np.float64) + shift, offsets)


class Candidates(NamedTuple):
    """The nodes near a batch of receivers. Those of receiver p are nodes[candidate[start[p,0]:start[p,K]]]; those of
    start[p,g]:start[p,g+1] are its ring g: they are in ball g but in no smaller one, with the nearest cells first.
    """

    start: NDArray[np.int64]  # (n,K+1)
    candidate: NDArray[np.int32]  # (c,) which node
    nodes: NDArray[np.int32]  # (u,3) each once
    position: NDArray[np.float64]  # (u,3) of nodes, world
    need: NDArray[np.uint64]  # (u,W) the lights that receivers ask for there


def candidates(lattice: Lattice, P: NDArray[np.float64], N: NDArray[np.float64],
               active: NDArray[np.uint64] | None = None, serve: NDArray[np.uint64] | None = None) -> Candidates:
    """Do steps 1 and 2 of Ψ for receivers P with unit geometric normals N, both (n,3).

    active (n,W): the lights that they ask for; None: none. serve (K,W): of each ring, those that count it.
    """
    most, n = lattice.offsets.shape[1], len(P)
    active = np.empty((n, 0), np.uint64) if active is None else active
    serve = np.empty((len(lattice.reach), 0), np.uint64) if serve is None else serve
    start = np.empty((n, len(lattice.reach) + 1), np.int64)
    candidate = np.empty(most + n * most // 3, np.int32)
    room = most + 4096 + n // 4
    nodes, position = np.empty((room, 3), np.int32), np.empty((room, 3))
    need = np.empty((room, active.shape[1]), np.uint64)
    table = np.empty(1 << int(2 * room).bit_length(), np.int32)
    state = np.zeros(3, np.int64)
    while True:
        needs_memory(_candidates(*lattice, TAU, P, N, active, serve, state, start, candidate, nodes, position, need,
                                 table))
        p, count, total = state.tolist()
        if p == n:
            return Candidates(start, candidate[:total], nodes[:count], position[:count], need[:count])
        if total + most > len(candidate):
            candidate = np.concatenate([candidate, np.empty(len(candidate), np.int32)])
        else:
            nodes, position, need = (np.concatenate([a, np.empty_like(a)]) for a in (nodes, position, need))
            table = np.empty(2 * len(table), np.int32)
            _fill(table, nodes, count)
