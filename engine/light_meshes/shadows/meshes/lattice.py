"""The light mesh: an unbounded uniform lattice fixed in world space, and the nodes of it that are near a receiver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...support.compiled import kernel

# A node nearer than TAU·h to the receiver's plane is dropped: it is on the surface, and what touches a surface
# counts as blocked.
TAU = 1e-3


def _generic_rotation() -> NDArray[np.float64]:
    """A fixed rotation that aligns no lattice plane with anything an artist builds.

    From the unit quaternion along (1, √2, √3, √5): no two lattice directions have a rational ratio. On an
    axis-aligned lattice nodes lie exactly on floors and walls, and the penumbra is 3.5 times coarser (method §2).
    """
    w, x, y, z = np.sqrt([1.0, 2.0, 3.0, 5.0]) / np.sqrt(11.0)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


class Lattice(NamedTuple):
    """Node (i,j,k) lies at origin + h·R·(i,j,k)."""

    h: float
    reach: NDArray[np.float64]  # (K,) the radii of balls in steps, r/h, ascending; with one radius kI
    rotation: NDArray[np.float64]  # (3,3) R
    origin: NDArray[np.float64]  # (3,) world
    offsets: NDArray[np.float64]  # (c,3) all nodes that the ball around a point of the cell [0,1)³ may hold

    def position(self, nodes: NDArray[np.int32]) -> NDArray[np.float64]:
        """World positions (n,3) of nodes (n,3)."""
        out = np.empty((len(nodes), 3))
        _positions(self, nodes, out)
        return out


def lattice(h: float, reach: NDArray[np.float64], rotate: bool = True,
            origin: tuple[float, float, float] = (0, 0, 0)) -> Lattice:
    """The lattice of step h for balls of radii h·reach (K,), ascending; `rotate` turns and shifts it generically."""
    rotation = _generic_rotation() if rotate else np.eye(3)
    shift = rotation @ (h * (np.sqrt([2.0, 3.0, 5.0]) % 1)) if rotate else np.zeros(3)
    largest = reach[-1]
    far = int(np.ceil(largest)) + 1
    axis = np.arange(-far, far + 2, dtype=np.int32)
    cube = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    outside = np.maximum(np.maximum(-cube, cube - 1), 0)  # distance from the cell, axis by axis
    near = (outside.astype(np.float64) ** 2).sum(1) <= largest * largest
    cube = cube[near]
    # Nearest first: the first candidate is the likeliest to be seen, a witness that the set is not empty.
    order = np.argsort(((cube - 0.5) ** 2).sum(1), kind="stable")
    return Lattice(h, reach, rotation, np.asarray(origin, np.float64) + shift, cube[order].astype(np.float64))


@kernel
def _positions(lattice, nodes, out):
    R, h = lattice.rotation, lattice.h
    for n in range(len(nodes)):
        i, j, k = np.float64(nodes[n, 0]), np.float64(nodes[n, 1]), np.float64(nodes[n, 2])
        for r in range(3):
            out[n, r] = lattice.origin[r] + h * (R[r, 0] * i + R[r, 1] * j + R[r, 2] * k)


@kernel
def _hash(i, j, k):
    x = np.uint64(np.uint32(i)) * np.uint64(0x9E3779B185EBCA87)
    x ^= np.uint64(np.uint32(j)) * np.uint64(0xC2B2AE3D27D4EB4F)
    x ^= np.uint64(np.uint32(k)) * np.uint64(0x165667B19E3779F9)
    x ^= x >> np.uint64(29)
    x *= np.uint64(0xBF58476D1CE4E5B9)
    return x ^ (x >> np.uint64(32))


@kernel
def _find(table, keys, i, j, k):
    """Slot of the hash table that holds node (i,j,k), or the empty slot where it belongs."""
    mask = np.uint64(len(table) - 1)
    slot = _hash(i, j, k) & mask
    while True:
        row = table[slot]
        if row < 0 or (keys[row, 0] == i and keys[row, 1] == j and keys[row, 2] == k):
            return slot
        slot = (slot + np.uint64(1)) & mask


@kernel
def _fill(table, keys, count):
    """Enter the first `count` keys into an empty table."""
    for row in range(count):
        table[_find(table, keys, keys[row, 0], keys[row, 1], keys[row, 2])] = row


def candidates(lattice: Lattice, P: NDArray[np.float64], N: NDArray[np.float64]) -> tuple[NDArray, NDArray, NDArray]:
    """Steps 1 and 2 of Ψ for receivers P with unit geometric normals N, both (n,3).

    Returns (start, candidate, nodes): the candidates of receiver p are nodes[candidate[start[p,0]:start[p,K]]]. Those
    of start[p,g]:start[p,g+1] are its ring g: in ball g but in no smaller one, nearest cells first. nodes (u,3) holds
    each node once.
    """
    most = len(lattice.offsets)
    start = np.zeros((len(P), len(lattice.reach) + 1), np.int64)
    candidate = np.empty(most + len(P) * most // 3, np.int32)
    nodes = np.empty((most + 4096, 3), np.int32)
    table = np.full(1 << int(2 * len(nodes)).bit_length(), -1, np.int32)
    # Receivers of one cell have the same nodes near them: each is looked up once for all of them.
    cells, rows = np.empty((len(P), 3), np.int32), np.empty((len(P), most), np.int32)
    cell_table = np.full(1 << int(2 * len(P)).bit_length(), -1, np.int32)
    p, cell_count, count, total = 0, 0, 0, 0
    while True:
        p, cell_count, count, total = _candidates(lattice, P, N, p, cell_count, count, total, start, candidate, nodes,
                                                  table, cells, rows, cell_table)
        if p == len(P):
            return start, candidate[:total], nodes[:count]
        if total + most > len(candidate):
            candidate = np.concatenate([candidate, np.empty(len(candidate), np.int32)])
        else:
            nodes = np.concatenate([nodes, np.empty_like(nodes)])
            table = np.full(2 * len(table), -1, np.int32)
            _fill(table, nodes, count)


@kernel
def _candidates(lattice, P, N, p, cell_count, count, total, start, candidate, nodes, table, cells, rows, cell_table):
    """Receivers from p on, until all are done or an array may be too short; returns next p, cells, nodes, candidates.

    rows (cells, offsets): which node is at an offset from the cell; −1: nobody has asked yet.
    """
    R, square, h = lattice.rotation, lattice.reach * lattice.reach, lattice.h
    off = lattice.offsets.T.copy()
    o0, o1, o2 = lattice.origin[0], lattice.origin[1], lattice.origin[2]
    most, rings = off.shape[1], len(square)
    largest = square[rings - 1]
    taken, passed = np.empty(most, np.uint8), np.empty(most, np.int64)
    ring, place = np.empty(most if rings > 1 else 0, np.int32), np.empty(rings, np.int64)
    while p < len(P) and total + most <= len(candidate) and count + most <= len(nodes):
        x, y, z = (P[p, 0] - o0) / h, (P[p, 1] - o1) / h, (P[p, 2] - o2) / h
        q0 = R[0, 0] * x + R[1, 0] * y + R[2, 0] * z
        q1 = R[0, 1] * x + R[1, 1] * y + R[2, 1] * z
        q2 = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z
        n0 = R[0, 0] * N[p, 0] + R[1, 0] * N[p, 1] + R[2, 0] * N[p, 2]
        n1 = R[0, 1] * N[p, 0] + R[1, 1] * N[p, 1] + R[2, 1] * N[p, 2]
        n2 = R[0, 2] * N[p, 0] + R[1, 2] * N[p, 1] + R[2, 2] * N[p, 2]
        b0, b1, b2 = np.floor(q0), np.floor(q1), np.floor(q2)
        start[p, 0] = total
        # Beyond 32 bits there are no nodes: such a receiver gets an empty set, and a sharp shadow.
        if abs(b0) < 2e9 and abs(b1) < 2e9 and abs(b2) < 2e9:
            f0, f1, f2 = q0 - b0, q1 - b1, q2 - b2
            i0, i1, i2 = np.int32(b0), np.int32(b1), np.int32(b2)
            slot = _find(cell_table, cells, i0, i1, i2)
            cell = cell_table[slot]
            if cell < 0:
                cell = np.int32(cell_count)
                cells[cell, 0], cells[cell, 1], cells[cell, 2] = i0, i1, i2
                cell_table[slot] = cell
                rows[cell] = -1
                cell_count += 1
            for c in range(most):  # without a branch, which no processor could foretell, and several at once
                d0, d1, d2 = off[0, c] - f0, off[1, c] - f1, off[2, c] - f2
                near = d0 * d0 + d1 * d1 + d2 * d2 <= largest  # step 1
                above = d0 * n0 + d1 * n1 + d2 * n2 > TAU  # step 2
                taken[c] = near & above
            kept = 0
            for c in range(most):
                passed[kept] = c
                kept += taken[c]
            for c in passed[:kept]:
                row = rows[cell, c]
                if row < 0:
                    i, j, k = i0 + np.int32(off[0, c]), i1 + np.int32(off[1, c]), i2 + np.int32(off[2, c])
                    slot = _find(table, nodes, i, j, k)
                    row = table[slot]
                    if row < 0:
                        row = np.int32(count)
                        nodes[row, 0], nodes[row, 1], nodes[row, 2] = i, j, k
                        table[slot] = row
                        count += 1
                    rows[cell, c] = row
                g = 0
                if rings > 1:
                    d0, d1, d2 = off[0, c] - f0, off[1, c] - f1, off[2, c] - f2
                    while d0 * d0 + d1 * d1 + d2 * d2 > square[g]:
                        g += 1
                    ring[total - start[p, 0]] = g
                candidate[total] = row
                start[p, g + 1] += 1
                total += 1
        for g in range(rings):
            start[p, g + 1] += start[p, g]
        if rings > 1:
            _by_ring(candidate[start[p, 0]:total], ring, start[p], place)
        p += 1
    return p, cell_count, count, total


@kernel
def _by_ring(candidate, ring, start, place):
    """Sort a receiver's candidates by ring; within one they keep their order."""
    unsorted = candidate.copy()
    for g in range(len(place)):
        place[g] = start[g] - start[0]
    for c in range(len(candidate)):
        g = ring[c]
        candidate[place[g]] = unsorted[c]
        place[g] += 1
