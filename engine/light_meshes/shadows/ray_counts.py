"""How many shadow rays go from a receiver to each lamp with a size, if nodes do not tell how much of it is seen.

With few lamps, many rays go to each, and more if these disagree. With many lamps, each is a small part of the light,
and so is its error: the rays are shared out so that the error of the sum is smallest. If a receiver returns the light e
of a lamp, the error with n stratified rays is about e·n^-3/4. For a given number of rays in all, the sum of the squared
errors is smallest if n is proportional to e^0.8. A lamp that gives as much as the mean lamp (the mean is weighted by
what lamps give) gets `mean` rays.

Rays of a rough surface hit some receivers, and one such ray may stand for a whole lobe. These receivers count in the
picture only by the share of light that the ray brings, so they get rays by what they add to the light of a usual pixel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel
from .blocks import BALANCED as QUICK
from .blocks import BEST as CAREFUL
from .blocks import SINGLE, Rules

_counts = kernel("lamp_ray_counts")
# Rays come in sets of 16, whose points spread evenly; parts of such a set are far worse for edges along the lamp's.
FEW, FINE = 4, 4.0  # to so many lamps go RAYS where the penumbra is narrow, from a receiver to each,
RAYS, MORE_RAYS = 16, 32  # and more where no node may answer and they disagree
BLURRED = (1.0, 2.0, 4.0, 8.0, 16.0)  # what there is where receivers are seen blurred, up to the most of others


class Rays(NamedTuple):
    """Numbers of rays from one receiver to one lamp."""

    first: int
    most: int  # where the first disagree
    alone: bool = False  # the latter only where no nodes have a say


class Shared(NamedTuple):
    """The rules by which rays are shared out between many lamps."""

    mean: float  # rays of a mean lamp, where a pixel has one sample
    counts: tuple[float, ...]  # what there is of such; to a lamp that gets the last of these
    most: int  # go so many where they disagree


# As near as 4 and as 16 rays to each lamp
BALANCED, BEST = Shared(7.5, (2.0, 4.0, 8.0), 16), Shared(43.0, (4.0, 8.0, 16.0), 16)
# The same where blocks of the picture find out which pairs are worth more than a ray; and where a plane through those
# of the pixels around can stand for more of them (`fitted.c`)
BALANCED_BLOCKS, BEST_BLOCKS = Shared(7.5, (2.0, 4.0, 8.0), 8), Shared(36.0, (4.0, 8.0, 16.0, 32.0), 32)
BALANCED_FITTED = BALANCED_BLOCKS._replace(mean=5.5)
SEVERAL, FEWER = 4, 0.8  # so many samples of a pixel share a pattern: so many times the rays of each are as near


def many(lamps: int) -> bool:
    """Return whether rays are shared out between so many lamps, instead of the same number for each."""
    return lamps > FEW


def shared(kI: float) -> Shared:
    """Return how rays are shared out: from kI = FINE on, each lamp gets more."""
    return BEST if kI >= FINE else BALANCED


def in_blocks(kI: float, samples: int = 1) -> Shared:
    """How they are shared out where blocks of the picture do not agree. samples: of a pixel."""
    if kI >= FINE:
        return BEST_BLOCKS
    return BALANCED_FITTED if samples >= SEVERAL else BALANCED_BLOCKS


def rules(kI: float, samples: int) -> Rules:
    """Return how blocks are asked, in pictures of so many samples a pixel."""
    if kI >= FINE:
        return CAREFUL
    return QUICK if samples >= SEVERAL else SINGLE


def most(kI: float, lamps: int) -> Rays:
    """Return the largest number of rays that a lamp may get."""
    of = shared(kI)
    return Rays(int(of.counts[-1]), of.most) if many(lamps) else Rays(RAYS, MORE_RAYS, alone=True)


class RayCounts:
    """The number of rays for each pair of a receiver and a lamp."""

    def __init__(self, kI: float, lamps: int, samples: int) -> None:
        """lamps: the number of lamps with a size. samples: the samples of a pixel."""
        self.shared, self._most, self._of = many(lamps), most(kI, lamps), shared(kI)
        self._fewer = FEWER if samples >= SEVERAL else 1.0
        self._mean = self._of.mean * self._fewer
        self._in_blocks, self.rules = in_blocks(kI, samples), rules(kI, samples)
        self.steps = tuple(int(n) for n in self._in_blocks.counts)

    def __call__(self, active: NDArray[np.uint64], e: NDArray[np.float32] | None,
                 shown: NDArray[np.float64] | None) -> NDArray[np.uint8]:
        """Return how many rays go to each active lamp (n,W): (n,L), or (n,1) if all lamps get the same number.

        e (n,L): how much of each lamp receivers return; it is not needed where all get the same number. shown: see
        `Receivers`.
        """
        first = self._most.first
        if e is None:
            return np.full((len(active), 1), first, np.uint8)
        none = np.zeros(len(active))
        if self.shared:
            out = np.empty(e.shape, np.uint8)
            _counts(active, e, none, self._mean, np.array(self._of.counts), out)
        else:
            out = np.full(e.shape, first, np.uint8)
        some = none[:0] if shown is None else np.flatnonzero(shown)
        if shown is not None and len(some):
            found = np.empty((len(some), e.shape[1]), np.uint8)
            _counts(active[some], e[some], shown[some], self._mean if self.shared else float(first),
                    np.array([n for n in BLURRED if n <= first]), found)
            out[some] = found
        return out

    def in_blocks(self, active: NDArray[np.uint64], e: NDArray[np.float32]) -> NDArray[np.uint8]:
        """How many rays (n,L) go at last where blocks do not agree, of lamps that are shared out."""
        out, of = np.empty(e.shape, np.uint8), self._in_blocks
        _counts(active, e, np.zeros(len(e)), of.mean * self._fewer, np.array(of.counts), out)
        return out

    def kind(self, count: int) -> Rays:
        """Return the numbers of rays for a lamp that gets this many at first."""
        return self._most if count == self._most.first else Rays(count, count)
