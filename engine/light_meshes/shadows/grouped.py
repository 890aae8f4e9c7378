"""Light Threshold: with hundreds of lamps, one stands for the shadows of a group of them that gives little light.

The lamps are the leaves of a binary tree, which halves them by their places. At each receiver, a group is a node of the
tree whose lamps together give at most the share `threshold` of the light that the receiver would return without
shadows; the largest such nodes are taken. One lamp of a group is asked for its shadow. The receiver's place decides
which one, and brighter lamps are chosen more often. The S of this lamp is used for all of the group. Their Ω stays
their own, so light without shadows does not change at all.

The bound: S of a lamp is between 0 and 1. So U = Σ S_i·Ω_i is wrong, in each channel, by at most Σ Ω_i of the lamps for
which another one stands, that is by less than `threshold` times the light without shadows for each group. The
statistics hold this sum over all receivers, as a share of the light without shadows. As a rule the error is far
smaller, because the errors of groups have either sign.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..support.bits import has
from ..support.native import kernel, needs_memory
from ..support.statistics import Statistics
from .casters import Casters, union
from .method import Check, Method, Nodes, Receivers, Setup

_groups, _spread = kernel("lamp_groups"), kernel("lamp_groups_spread")
PARTS = 1 << 30  # in which the share of light is counted


class Grouped(Method):
    """Asks another method for one lamp of each group."""

    weighs = True

    def __init__(self, setup: Setup, of: Method, told: bool = True) -> None:
        """of: the method for single lamps. told: add the bound to the statistics."""
        self._of, self.threshold, self._stats = of, setup.settings.light_threshold, setup.stats
        self._told = told
        self.order, self.together = self.lamp_tree = tree(setup)

    @property
    def nodes(self) -> tuple[Nodes, ...]:  # type: ignore[override]
        """Return the nodes of the method for single lamps."""
        return self._of.nodes

    def __call__(self, at: Receivers, check: Check, probe: NDArray | None = None) -> NDArray[np.float32]:
        """Return S, see `Method`."""
        if at.weight is None or at.several is not None:  # the groups are there already (`surface.clusters`)
            return self._of(at, check, probe)
        e = at.weight
        group, weight, bound = np.empty(e.shape, np.int32), np.empty_like(e), np.empty(len(e))
        asked, several = np.empty_like(at.active), np.empty_like(at.active)
        with self._stats.stage("groups of lamps"):
            needs_memory(_groups(at.P, at.active, e, self.threshold, self.order, self.together, group, asked, several,
                                 weight, bound))
        if self._told:
            tell(self._stats, bound, e.sum(1, dtype=np.float64))
        S = self._of(at._replace(active=asked, weight=weight, several=several), check, probe)
        _spread(group, S)
        return S


def tell(stats: Statistics, bound: NDArray[np.float64], light: NDArray[np.float64],
         weight: NDArray[np.float64] | None = None) -> None:
    """Count which share of the light of receivers (n,) may be wrong by bound (n,).

    weight (n,): how much each receiver counts; None: all alike.
    """
    share = bound / np.maximum(light, 1e-300)
    counts = np.ones(len(light)) if weight is None else np.minimum(weight, 1.0)
    # as whole numbers, whose sum does not depend on tiles
    stats.add(grouped_receivers=int((counts * PARTS).astype(np.int64).sum()),
              grouped_light=int((share * counts * PARTS).astype(np.int64).sum()))


def tree(setup: Setup) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Return a binary tree of the lamps, as two arrays: the lamps in the order of the leaves (l,), −1 for an empty
    leaf; and which of the nodes (2·l,) may be groups, where node 1 is the root.

    The lamps of a group must have the same casters. Suns are in no group with other lamps, because they are seen in the
    same direction from everywhere.
    """
    count = len(setup.lights)
    kinds = _kinds(setup.casters, count)
    kinds[setup.targets.directional] = -1 - np.flatnonzero(setup.targets.directional)
    leaves = 1 << max(0, count - 1).bit_length()
    order = np.full(leaves, -1, np.int32)
    parts = [(np.arange(count), 0, leaves)]
    while parts:
        lamps, first, size = parts.pop()
        if size == 1 or not len(lamps):
            order[first:first + len(lamps)] = lamps
            continue
        sides = np.unique(kinds[lamps])
        if len(sides) > 1:
            values = kinds[lamps].astype(np.float64)
        else:
            places = setup.targets.position[lamps]
            values = places[:, np.argmax(places.max(0) - places.min(0))]
        lamps = lamps[np.argsort(values, kind="stable")]
        half = size // 2
        cut = min(half, max(len(lamps) - half, (len(lamps) + 1) // 2))
        parts += [(lamps[:cut], first, half), (lamps[cut:], first + half, half)]
    kind = np.full(2 * leaves, np.iinfo(np.int64).min)  # of a node, the smallest number: no lamp is below it
    kind[leaves:][order >= 0] = kinds[order[order >= 0]]
    together = np.ones(2 * leaves, np.bool_)
    for node in range(leaves - 1, 0, -1):
        a, b = kind[2 * node], kind[2 * node + 1]
        together[node] = together[2 * node] and together[2 * node + 1] and (
            a == b or min(a, b) == np.iinfo(np.int64).min)
        kind[node] = max(a, b)
    return order, together


def _kinds(casters: Casters, count: int) -> NDArray[np.int64]:
    """Return a number (L,) for each light, which is equal for lights with the same casters."""
    of = [[next((k for k, group in enumerate(groups) if has(group.lights, i)), -1) for i in range(count)]
          for groups in (casters.whole, casters.soft, casters.sharp)]
    soft = union(casters.soft, count)
    table = np.array([*of, [int(has(soft, i)) for i in range(count)]])
    return np.unique(table, axis=1, return_inverse=True)[1].reshape(-1).astype(np.int64)
