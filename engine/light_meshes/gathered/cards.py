"""Cards: small pieces of surface with cut-outs, as leaves and twigs are made of, gather light only at their corners.

In a crown of thousands of them others are always near, so the usual rules would ask for finer and finer records, each
with many rays. The picture does not show them: a card is small, and its neighbours look elsewhere. So the records at
the corners of a card have few rays, and are trusted on all of it. CARD = 0 switches this off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .thinned import SMALL

CARD = 2.0  # pieces are cards up to about this size, in finest distances; triangles smaller than SMALL are thinned
RAYS = 64  # of a record
ROUND = 2 / 3  # how far corners may be from their middle, as a share of that size: those of a triangle are so far


def cards(cutout: NDArray[np.bool_], longest: NDArray[np.float32], corner: NDArray[np.int32], P: NDArray[np.float64],
          fine: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which triangles (T,), and which corners (c,), are of cards.

    cutout (T,): which triangles have cut-outs. longest (T,): their longest edges; fine: the finest distance of records;
    scene units. corner (T,3): the numbers of their corners, −1: none; the same where flat triangles meet. P (c,3):
    where these are.
    """
    card, at_card = np.zeros(len(longest), np.bool_), np.zeros(len(P), np.bool_)
    cutout = cutout & (corner >= 0).all(1)
    some = np.flatnonzero(cutout & (longest <= CARD * fine) & (longest > SMALL * fine))
    if not len(some):
        return card, at_card
    own = corner[some]
    piece = _pieces(own, len(P))
    all_there = np.bincount(piece[corner[cutout]].ravel(), minlength=len(P))
    large = all_there > np.bincount(piece[own].ravel(), minlength=len(P))  # larger triangles hang together with it
    at = np.unique(own)
    count = np.bincount(piece[at], minlength=len(P))
    middle = np.stack([np.bincount(piece[at], P[at, k], len(P)) / np.maximum(count, 1) for k in range(3)], 1)
    large[piece[at[np.linalg.norm(P[at] - middle[piece[at]], axis=1) > ROUND * CARD * fine]]] = True
    card[some] = ~large[piece[own[:, 0]]]
    at_card[at] = ~large[piece[at]]
    return card, at_card


def _pieces(corner: NDArray[np.int32], n: int) -> NDArray[np.int32]:
    """Return for each of n corners the least one that hangs together with it by triangles, whose corners (t,3) are
    given.
    """
    least = np.arange(n, dtype=np.int32)
    while True:
        before = least[corner]
        lower = np.repeat(before.min(1), 3)
        if (before.ravel() == lower).all():
            return least
        np.minimum.at(least, before.ravel(), lower)
        while (least[least] != least).any():
            least = least[least]
