"""Steps 4 and 5 of Ψ on a batch of receivers: which values and rays are needed, and the mean of what nodes see.

`start` (n, K+1): the candidates of receiver p in ring g are rows start[p,g]:start[p,g+1] of `candidate`, as `lattice`
makes them. A light of class k averages rings 0..k: serve (K,W) has for each ring the bits of the lights that count it,
ring (L,) is each light's class, and m (n,K) the size of the set of each class. With one radius K = 1. The kernels and
what they take stand in `averaging.c`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...support.bits import mask_of
from ...support.native import kernel, needs_memory

# How wide the blur is: a light of radius ρ seen past an edge has variance ρ²/4, the mean over the half-ball this
# share of r².
VARIANCE = {"UNIFORM": 1 / 5, "SMOOTH": 1 / 7}

ask, agreement, certify = kernel("psi_ask"), kernel("psi_agreement"), kernel("psi_certify")
sizes = kernel("psi_sizes")
_listed, _mean, _smooth_mean = kernel("psi_listed"), kernel("psi_mean"), kernel("psi_smooth_mean")


def listed(start: NDArray[np.int64], soft: NDArray[np.uint64], serve: NDArray[np.uint64], uniform: NDArray[np.bool_],
           seen: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """(receiver, index into candidate) of every short ray that is needed: of those that are not `seen` anyway."""
    total = _listed(start, soft, serve, uniform, seen, None, None)
    row, index = np.empty(total, np.int32), np.empty(total, np.int64)
    _listed(start, soft, serve, uniform, seen, row, index)
    return row, index


def mean(*arguments: NDArray) -> None:
    """Uniform weights: S[rows] = (number of kept nodes that see the light)/m, eq. (4)."""
    needs_memory(_mean(*arguments))


def smooth_mean(start: NDArray, candidate: NDArray, kept: NDArray, uniform: NDArray, values: NDArray, soft: NDArray,
                ring: NDArray, radius: NDArray, P: NDArray, position: NDArray, m: NDArray, rows: NDArray,
                S: NDArray) -> None:
    """Smooth weights: S[rows] = Σ w·v / Σ w over the kept nodes, with w = max(1 − |x − P|²/r², 1e-9)."""
    own = np.stack([mask_of(np.flatnonzero(ring == k), len(ring)) for k in range(len(radius))])
    needs_memory(_smooth_mean(start, candidate, kept, uniform, values, soft, own, radius, P, position, m, rows, S))
