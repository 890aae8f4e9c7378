"""Patches of surfaces: what light they return to rays that gather, after so many bounces.

A patch is a small triangle of a triangle's grid, or stands for tiny triangles that are close together. Its light is
the mean of four of its points: emission, the lamps' direct light, and what its own rays gather from other patches
(radiosity). It is computed for patches that rays hit, and kept.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .directions import directions
from .rays import Check, Field, Gatherer, Seen
from .table import Table

RAYS = 64  # of a patch
BATCH = 4096  # patches at once

# What a surface is at some points: emission (n,3), the share of light it returns in all directions (n,3), and the
# lamps' light (n,3) that a white surface would return there; seen along directions (n,3).
Lit = Callable[[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64], bool],
               tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]


class Patches:
    """Not for several threads at once."""

    def __init__(self, field: Field, gather: Gatherer, look: Lit, gathers: bool) -> None:
        """look: what surfaces are. gathers: whether light comes from elsewhere than from lamps, so that patches gather
        also for the first bounce.
        """
        self._field, self._gather, self._look, self._gathers = field, gather, look, gathers
        self._table = Table()
        self._local = directions(RAYS)
        self._emission = np.empty((0, 3))
        self._albedo, self._direct, self._sky = np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3))
        self._looked, self._lit, self._traced = (np.empty(0, np.bool_) for _ in range(3))
        self._bounced: list[tuple[NDArray[np.float64], NDArray[np.bool_]]] = []
        self._links: list[tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]] = []
        self._link = np.empty(0, np.int64)  # which of _links, by patch

    def __len__(self) -> int:
        return len(self._table)

    def radiance(self, keys: NDArray[np.uint64], bounces: int, check: Check) -> NDArray[np.float64]:
        """The radiance (n,3) of the patches with these keys (n,): emission, and light that has come `bounces` times,
        or less, from a surface.
        """
        different, back = np.unique(keys, return_inverse=True)
        number = self._table.numbers(different)
        self._grow()
        found = self._after(number, bounces, check)
        light: NDArray[np.float64] = found[back.reshape(-1)]
        return light

    def _grow(self) -> None:
        """Make room for the patches in the table."""
        n, had = len(self._table), len(self._looked)
        if n <= had:
            return
        more = max(n, 2 * had) - had

        def longer(a: NDArray) -> NDArray:
            return np.concatenate([a, np.zeros((more, *a.shape[1:]), a.dtype)])

        for name in ("_emission", "_albedo", "_direct", "_sky", "_looked", "_lit", "_traced", "_link"):
            setattr(self, name, longer(getattr(self, name)))
        self._bounced = [(longer(light), longer(known)) for light, known in self._bounced]

    def _after(self, number: NDArray[np.int32], bounces: int, check: Check) -> NDArray[np.float64]:
        """The radiance (n,3) of patches (n,), each number once."""
        self._see(number, bounces > 0, check)
        if bounces == 0:
            return self._emission[number]
        while len(self._bounced) < bounces:
            self._bounced.append((np.zeros((len(self._looked), 3)), np.zeros(len(self._looked), np.bool_)))
        new = number[~self._bounced[bounces - 1][1][number]]
        for i in range(0, len(new), BATCH):
            some = new[i:i + BATCH]
            light = self._emission[some] + self._direct[some]
            if self._gathers or bounces > 1:
                self._trace(some, check)
                light += self._albedo[some] * (self._sky[some] + self._from_others(some, bounces - 1, check))
            values, known = self._bounced[bounces - 1]  # they may have grown
            values[some], known[some] = light, True
        return self._bounced[bounces - 1][0][number]

    def _see(self, number: NDArray[np.int32], lit: bool, check: Check) -> None:
        """Find out what patches are, and their direct light if `lit`."""
        new = number[~(self._lit if lit else self._looked)[number]]
        for i in range(0, len(new), BATCH):
            check()
            some = new[i:i + BATCH]
            triangle, front, u, v = self._field.grids.inside(self._table.keys[some])
            P, N = self._points(triangle, front, u, v)
            emission, albedo, direct = self._look(np.repeat(triangle, 4), P, N, lit)
            self._emission[some] = emission.reshape(-1, 4, 3).mean(1)
            self._albedo[some] = albedo.reshape(-1, 4, 3).mean(1)
            self._direct[some] = (albedo * direct).reshape(-1, 4, 3).mean(1)
            self._looked[some] = True
            self._lit[some] = lit

    def _points(self, triangle: NDArray, front: NDArray, u: NDArray,
                v: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        grids = self._field.grids
        P = grids.points(np.repeat(triangle, 4), u.ravel(), v.ravel())
        return P, np.repeat(grids.normals(triangle) * np.where(front, 1, -1)[:, None], 4, axis=0)

    def _trace(self, number: NDArray[np.int32], check: Check) -> None:
        """Find the patches that those of these patches see, and the sky that they see."""
        new = number[~self._traced[number]]
        if not len(new):
            return
        check()
        keys = self._table.keys[new]
        P, N = self._points(*self._field.grids.inside(keys))
        # each patch turns its rays by an angle of its own, so that what all miss differs
        angle = (keys * np.uint64(0x9E3779B185EBCA87) >> np.uint64(40)).astype(np.float64) / 2**24 * 2 * np.pi
        sky = np.zeros((len(new), 3))
        rows, others, weights = [], [], []
        with self._field.stats.stage("patches: rays"):
            for q in range(4):
                local = np.ascontiguousarray(self._local[q::4])
                turn = np.stack([np.cos(angle), np.sin(angle)], 1)
                seen = self._gather(np.ascontiguousarray(P[q::4]), np.ascontiguousarray(N[q::4]), local, turn)
                sky += seen.light.reshape(len(new), len(local), 3).sum(1)
                for layer in seen.layers:
                    rows.append(layer.row // len(local))
                    others.append(layer.keys)
                    weights.append(np.ones((len(layer.keys), 3)) if layer.weight is None else layer.weight)
        row, found, weight = np.concatenate(rows), np.concatenate(others), np.concatenate(weights)
        order = np.argsort(row, kind="stable")
        different, back = np.unique(found[order], return_inverse=True)
        other = self._table.numbers(different)[back.reshape(-1)]
        self._grow()
        self._sky[new] = sky / RAYS
        start = np.searchsorted(row[order], np.arange(len(new) + 1))
        self._link[new] = sum(len(s) - 1 for s, *_ in self._links) + np.arange(len(new))
        self._links.append((start, other, weight[order] / RAYS))
        self._traced[new] = True

    def _from_others(self, number: NDArray[np.int32], bounces: int, check: Check) -> NDArray[np.float64]:
        """The radiance (n,3) that a white patch returns of the light of other patches, after so many bounces."""
        out = np.zeros((len(number), 3))
        first = 0
        link = self._link[number]
        for start, other, weight in self._links:
            rows = np.flatnonzero((link >= first) & (link < first + len(start) - 1))
            if len(rows):
                begin = start[link[rows] - first]
                count = start[link[rows] - first + 1] - begin
                at = np.repeat(begin - np.cumsum(count) + count, count) + np.arange(count.sum())
                different, back = np.unique(other[at], return_inverse=True)
                light = self._after(different, bounces, check)[back.reshape(-1)] * weight[at]
                of = np.repeat(rows, count)
                for j in range(3):
                    out[:, j] += np.bincount(of, light[:, j], len(number))
            first += len(start) - 1
        return out


def add(seen: Seen, patches: Patches, bounces: int, check: Check) -> NDArray[np.float64]:
    """The radiance (x,3) that rays find: sky and patches."""
    light = seen.light
    for layer in seen.layers:
        found = patches.radiance(layer.keys, bounces, check)
        light[layer.row] += found if layer.weight is None else layer.weight * found
    return light

