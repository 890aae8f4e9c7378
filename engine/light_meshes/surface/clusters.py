"""Ω of hundreds of lamps: those that are far from a receiver and close to each other count as one (Light Threshold).

Lamps are the leaves of a tree. Each receiver goes down from the root until a node may count as one lamp in the middle
of its lamps, whose light may be wrong by at most the share PART · `threshold` of all light there. That bound is
proven, by Taylor's formula for what is scattered and by the largest values of each factor for what facets mirror
(clusters.h). It is added to the bound that the statistics tell. As with `shadows.grouped`, the largest nodes that
together give at most the share `threshold` have one shadow, for which one of their lamps, chosen by the place, is
asked.

Nodes that may count as one have lamps that shine alike in all directions. All others are computed lamp by lamp.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lights import registry
from ..support.native import kernel
from . import shading, sized

_asked, _sum = kernel("clusters_asked"), kernel("clusters_sum")
PART = 0.25  # of the threshold: by how much a node that counts as one may be wrong
MANY = 256  # lamps: with fewer, each is computed by itself
GUESS = 192  # groups of a receiver for which there is room at first
EMPTY, ONE, SEVERAL = range(3)  # clusters.h


class Groups(NamedTuple):
    """The groups of lamps of receivers, one behind the other."""

    start: NDArray[np.int64]  # (n+1,) where each receiver's begin
    lamp: NDArray[np.int32]  # (m,) the lamp whose shadow all have
    light: NDArray[np.float32]  # (m,6) what the receiver returns of them: scattered, mirrored

    def gather(self, S: NDArray[np.float32], colour: NDArray[np.float64], matt: NDArray[np.float64] | None = None,
               gloss: NDArray[np.float64] | None = None) -> None:
        """Add what S (n,L,C) leaves to colour (n,3), and its two terms to matt and gloss (n,3)."""
        if _sum(self.start, self.lamp, self.light, S, colour, matt, gloss):
            raise AssertionError("groups of other receivers")


class Asked(NamedTuple):
    """What a shadow method is asked, see `shadows.method.Receivers`, and for whom it answers."""

    groups: Groups
    active: NDArray[np.uint64]  # (n,W)
    several: NDArray[np.uint64]  # (n,W)
    weight: NDArray[np.float32]  # (n,L)
    bound: NDArray[np.float64]  # (n,) by how much the light may be wrong in each channel, by shadows and in all
    total: NDArray[np.float64]  # (n,) the light without shadows, of the brightest channel
    wrong: NDArray[np.float64]  # (n,) by how much that may be wrong


class Clusters:
    """The tree of a scene's lamps, with what its nodes are from far away."""

    def __init__(self, lights: shading.Lights, order: NDArray[np.int32], together: NDArray[np.bool_]) -> None:
        """order, together: see `shadows.grouped.tree`."""
        self._tree = order, together, *_nodes(lights, order)

    def __call__(self, lit: shading.Lit, faces: NDArray[np.float64], threshold: NDArray[np.float64]) -> Asked:
        """The groups of these receivers, each with a threshold (n,) of its own. faces (n,3): normals that say which
        lamps are above the surface.
        """
        n, count = len(lit.hits.P), len(lit.lights.type)
        rough = None if lit.shown is None else shading.rough_only(lit.materials, lit.hits.row)
        shown = None if rough is None else rough.facets()[0]
        active, several = (np.zeros((n, (count + 63) // 64), np.uint64) for _ in range(2))
        weight, bound, total, wrong = np.zeros((n, count), np.float32), np.empty(n), np.empty(n), np.empty(n)
        start, room = np.zeros(n + 1, np.int64), max(64, n * GUESS)
        while True:
            lamp, light = np.empty(room, np.int32), np.empty((room, 6), np.float32)
            found = _asked(*lit.taken, np.ascontiguousarray(faces), shown, *self._tree, threshold, PART, start, lamp,
                           light, active, several, weight, bound, total, wrong)
            if found < 0:
                raise MemoryError("out of memory in a kernel")
            if found <= room:
                groups = Groups(start, lamp[:found], light[:found])
                return Asked(groups, active, several, weight, bound + wrong, total, wrong)
            room = found


def suits(lights: shading.Lights) -> bool:
    """Whether there are so many lamps that may count together that a tree pays."""
    return int(_alike(lights).sum()) >= MANY


def _alike(lights: shading.Lights) -> NDArray[np.bool_]:
    """Which lamps (L,) shine alike in all directions."""
    return np.isin(lights.type, [registry.NAMES.index("POINT"), sized.BALL, sized.FACING])


def _nodes(lights: shading.Lights, order: NDArray[np.int32]) -> tuple[NDArray, ...]:
    """State, middle, reach, size, power, first and second moments of a tree's nodes (2·l,…), the root being 1."""
    leaves = len(order)
    there, lamp = order >= 0, np.maximum(order, 0)
    place, size = lights.position[lamp], np.where(there, lights.extent[lamp, 6], 0.0)
    power = np.where(there[:, None], lights.intensity[lamp], 0.0)
    alike = _alike(lights)[lamp] & (power >= 0).all(1)
    kind = np.where(alike, lights.diffuse[lamp] + 2 * lights.glossy[lamp], 4 + np.arange(leaves))
    state = np.zeros(2 * leaves, np.uint8)
    middle, moment, second, sums = (np.zeros((2 * leaves, 3)) for _ in range(4))
    reach, sizes = np.zeros(2 * leaves), np.zeros(2 * leaves)
    for level in range(leaves.bit_length()):
        nodes = 1 << level
        at, shape = slice(nodes, 2 * nodes), (nodes, leaves // nodes)
        on, given = there.reshape(shape), power.reshape(*shape, 3)
        x = np.where(on[..., None], place.reshape(*shape, 3), 0.0)
        by = given.sum(2) + 1e-300 * on
        sums[at] = given.sum(1)
        middle[at] = (x * by[..., None]).sum(1) / np.maximum(by.sum(1), 1e-300)[:, None]
        off = np.where(on[..., None], x - middle[at][:, None], 0.0)
        far = np.sqrt((off**2).sum(2))
        sizes[at] = size.reshape(shape).max(1)
        reach[at] = (far.max(1) + sizes[at]) * (1 + 1e-9)
        moment[at] = np.linalg.norm(np.einsum("nmc,nmj->ncj", given, off), axis=2) + 1e-12 * sums[at] * reach[at, None]
        second[at] = np.einsum("nmc,nm->nc", given, far**2)
        kinds = kind.reshape(shape)
        low, high = np.where(on, kinds, kind.max() + 1).min(1), np.where(on, kinds, -1).max(1)
        state[at] = np.where(on.any(1), np.where(low == high, ONE, SEVERAL), EMPTY)
    return state, middle, reach, sizes, sums, moment, second
