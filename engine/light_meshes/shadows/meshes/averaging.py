"""Steps 4 and 5 of Ψ for a batch of receivers: which values and rays are needed, and the mean over the nodes.

The kernels are in `averaging.c`. If surfaces let light through, the last step is in `semitransparent.c`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...support.bits import mask_of
from ...support.native import kernel, needs_memory, together
from ...support.rows import put

# The width of the blur. A light of radius ρ seen past an edge has the variance ρ²/4. The mean over the half-ball has
# this share of r² as its variance.
VARIANCE = {"UNIFORM": 1 / 5, "SMOOTH": 1 / 7}

ask, spare, free_start = kernel("psi_ask"), kernel("psi_spare"), kernel("psi_free_start")
ends, _answered, _sizes = (kernel(f"psi_{name}") for name in ("ends", "answered", "sizes"))
_listed, _means = kernel("psi_listed"), kernel("psi_means")


class Classes(NamedTuple):
    """The soft lights, sorted by the radius of their balls. With one radius, K = 1. A light of class k averages the
    rings 0..k.
    """

    ring: NDArray[np.int64]  # (L,) the class of each light
    radius: NDArray[np.float64]  # (K,) r of each class, world, ascending
    serve: NDArray[np.uint64]  # (K,W) for each ring, the soft lights that average it
    own: NDArray[np.uint64]  # (K,W) the lights of each class


class Neighbourhood(NamedTuple):
    """The nodes around a batch of receivers, and what is known of them.

    The candidates of receiver p in ring g are the rows start[p,g]:start[p,g+1] of `candidate`, `seen` and `weight`, in
    the order of `lattice.candidates`. The arrays are filled step by step.
    """

    start: NDArray[np.int64]  # (n,K+1)
    candidate: NDArray[np.int32]  # (c,) which node
    position: NDArray[np.float64]  # (u,3) of nodes, world
    values: NDArray  # (u,…) of nodes, as in the store
    seen: NDArray[np.bool_]  # (c,) the receiver certainly sees the node; no ray is needed
    weight: NDArray  # v(x_l,P): bool (c,), or float32 (c,C)
    uniform: NDArray[np.bool_]  # (n,) all candidates agree, and the first is seen
    m: NDArray[np.int32]  # (n,K) how many nodes step 3 keeps in the ball of each class

    def kept(self) -> NDArray[np.bool_]:
        """Return which candidates (c,) step 3 keeps."""
        return any_channel(self.weight)


def any_channel(v: NDArray) -> NDArray[np.bool_]:
    """Return which v(x_l,P), (n,) or (n,C), are not 0."""
    return v if v.ndim == 1 else (v > 0).any(1)


def classes(ring: NDArray[np.intp], radius: NDArray[np.float64], soft: NDArray[np.uint64]) -> Classes:
    """Return the classes for lights (L,) with these rings and radii; the lights in soft (W,) have soft shadows."""
    def lights(among: NDArray[np.bool_]) -> NDArray[np.uint64]:
        return mask_of(np.flatnonzero(among), len(ring))

    return Classes(np.asarray(ring, np.int64), radius,
                   np.stack([soft & lights(ring >= g) for g in range(len(radius))]),
                   np.stack([lights(ring == k) for k in range(len(radius))]))


def listed(near: Neighbourhood, soft: NDArray[np.uint64],
           lights: Classes) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return (receiver, index into candidate) of every short ray that is needed. Candidates that are `seen` need
    none.
    """
    of = near.start, soft, lights.serve, near.uniform, near.seen
    total = _listed(*of, None, None)
    row, index = np.empty(total, np.int32), np.empty(total, np.int64)
    _listed(*of, row, index)
    return row, index


def answered(near: Neighbourhood, soft: NDArray[np.uint64],
             lights: Classes) -> tuple[NDArray[np.uint64], NDArray[np.bool_], int]:
    """Return the soft lights (n,W) whose set is not empty, which receivers (n,) have soft lights with an empty set, and
    how many these are.
    """
    found, empty = np.empty_like(soft), np.empty(len(soft), np.bool_)
    return found, empty, _answered(near.m, soft, lights.serve, found, empty)


def sizes(near: Neighbourhood) -> None:
    """Fill m of the neighbourhood."""
    _sizes(near.start, near.kept(), near.uniform, near.m)


def means(near: Neighbourhood, P: NDArray[np.float64], soft: NDArray[np.uint64], lights: Classes, smooth: bool,
          rows: NDArray[np.int64], S: NDArray[np.float32], into: NDArray[np.uint64]) -> tuple[NDArray[np.bool_], int]:
    """Do step 5: fill m of the neighbourhood, and set S[rows] (…,L,1) and into[rows] (…,W): the soft lights whose set
    is not empty. Returns which receivers (n,) have soft lights with an empty set, and how many these are.

    S is the number of kept nodes that see the light/m, eq. (4); or, with smooth weights, Σ w·v / Σ w over the kept
    nodes, w = max(1 − |x − P|²/r², 1e-9).
    """
    found, empty, counts = np.empty_like(soft), np.empty(len(soft), np.bool_), np.empty(1, np.int64)
    mean = (_means, near.start, near.candidate, near.weight, near.uniform, near.values, soft, *lights, P, near.position,
            smooth, rows, near.m, found, empty, counts, S[..., 0])
    failed, _ = together(mean, (put, into, rows, found))
    needs_memory(failed)
    return empty, int(counts[0])
