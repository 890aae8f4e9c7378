"""Records: the light from everywhere at points of surfaces, and its interpolation.

Records are at points of the grids of triangles, so they are fixed in the world. Each is computed when a receiver first
asks, from fixed rays, and its value depends on nothing else: not on the camera, on order or on threads. A receiver asks
the three points of its triangle's coarsest grid around it, then of finer ones, until it trusts them: they must be
closer together than a share of the mean distance of what they see (Ward, Rubinstein and Clear 1988), and of the
distance of edges near them. Between levels it blends. The distance of edges is found first, without rays; where it says
that the records will not be trusted, they are not computed.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits
from ..rays.tracer import points
from ..support.native import kernel
from ..support.statistics import Statistics
from .cards import RAYS as CARD_RAYS
from .cards import cards
from .directions import Nested, Rays, nested
from .grids import CORNER, INSET, LAST, Places
from .light import Light, light_of, together
from .nearness import Nearness
from .patches import Patches, SharedRecordsError
from .rays import Check, Field, Gatherer
from .table import Table
from .thinned import Sources, Thinned
from .thinned import mean as _mean_of

_sum, _asked = kernel("records_sum"), kernel("records_asked")
NEW, WANTED, CELL, SIGHT = 1, 2, 3, 4  # why a receiver waits, as in asked.c
# Rays of a record at first, by how far apart records are, in finest distances: each record of a coarse grid counts for
# a large part of a surface, and there are few.
RAYS = ((6.0, 1024), (3.0, 512), (0.0, 256))
NOISE = 0.025  # where its light is less certain, as a share of it, a record asks with more rays: with
SPREAD = 0.75  # this power of whose number the error falls, at edges, twice or four times as many
BATCH = 1 << 18  # rays at once
WITHIN = 0.35  # records are trusted up to this share of the mean distance of what they see,
STRICT = 0.2  # or up to this where they are far apart
APART = 1.0  # and up to this multiple of the distance of edges
BEYOND = 3  # levels finer than the finest, where no record can be seen from a receiver
EDGE = 1e-3  # what stands in a cell less far from the triangle's border does not count, as a share of the cell's edge
LIFT = 1e-3  # how far above their surface records are looked at, as a share of the distance between them
SOURCE = np.uint64(1 << 62)  # the bit of keys of corners that gather light for others, too
ABOVE = 0.25  # how high sources and corners are looked at from each other, as a share of how far sources count
KEPT = 2_000_000  # more records or patches are not kept for the next picture
_ARRAYS = ("_placed", "_claimed", "_done", "_P", "_M", "_mean", "_inverse", "_nearest", "_open",
           "_sectors")
SECTORS = 64  # of what a record sees, as in sectors.h
ENOUGH = 1e-3  # so little is not asked for at the next level


class Gathered(NamedTuple):
    """The light from everywhere at n receivers."""

    light: NDArray[np.float64]  # (n,3) the radiance of a white matt surface there
    sky: NDArray[np.float64]  # (n,) share of the half-space from which nothing is in the way


class Lobe(NamedTuple):
    """How surfaces reflect that are seen along `way`: as microfacets (GGX)."""

    way: NDArray[np.float64]  # (n,3) unit
    alpha: NDArray[np.float64]  # (n,) roughness²


class Records:
    """All records of a scene, shared by threads. A thread that needs records which another one is computing waits for
    it.
    """

    def __init__(self, field: Field, gather: Gatherer, patches: Patches, nearness: Nearness, fine: float,
                 bounces: int, glossy: bool) -> None:
        """fine: the distance between records at the finest level, scene units. glossy: they are asked for lobes."""
        self._field, self._gather, self._patches, self._nearness = field, gather, patches, nearness
        self._fine, self._bounces = fine, bounces
        self._glossy = glossy
        self._nested = {n: nested(n) for _, n in RAYS}
        self._nested[CARD_RAYS] = nested(CARD_RAYS)
        g = field.grids
        card, self._card = cards(field.glass.cut, g.longest, g.corner, g.corners.P, fine)
        self._longest = np.where(card, np.minimum(g.longest, np.float32(fine)), g.longest)  # so that they are trusted
        self._thinned = Thinned(g, fine)
        self._table = Table()
        self._cells = Table()  # halves of cells; 1: all places there see each other; 2: perhaps not
        self._clear = np.zeros(0, np.uint8)
        self._lock = threading.Condition()
        self._broken = False
        # where it is and how near edges are is known; a thread computes it; it is known
        self._placed, self._claimed, self._done = (np.zeros(0, np.bool_) for _ in range(3))
        self._P, self._M = np.zeros((0, 3)), np.zeros((0, 3))
        self._mean = np.zeros((0, 5, 3), np.float32)
        self._inverse, self._nearest, self._open = (np.zeros(0, np.float32) for _ in range(3))
        self._sectors = np.zeros((0, SECTORS if glossy else 0), np.uint32)

    def __len__(self) -> int:
        return len(self._table)

    def kept(self, stats: Statistics) -> bool:
        """Get ready for another picture, whose work is counted in `stats`. Return whether the records are worth their
        memory.
        """
        self._field.stats = stats
        placed = self._placed[:len(self._table)]
        if not placed.all():  # the picture before was given up
            keys, count = self._table.keys[placed], np.count_nonzero(placed)
            self._table = Table()
            self._table.numbers(keys)
            for name in _ARRAYS:
                setattr(self, name, getattr(self, name)[:len(placed)][placed])
            assert len(self._table) == count
        self._claimed = self._done.copy()
        self._broken = False
        self._patches.again()
        return len(self._table) < KEPT and len(self._patches) < KEPT

    def __call__(self, hits: Hits, check: Check, lobe: Lobe | None = None) -> Gathered:
        """Return the light from everywhere at hits, for their shading normals Ns. lobe: not of matt surfaces, but the
        mean over these lobes.
        """
        n, g, stats = len(hits.P), self._field.grids, self._field.stats
        ask = _Asked(np.zeros(n, np.int32), np.ones(n), np.zeros((n, 3)), np.zeros(n), np.empty((n, 3), np.uint64),
                     np.empty((n, 3), np.int32), np.empty((n, 3)), np.ones((n, 3), np.bool_), np.zeros(n, np.int32),
                     np.zeros(n, np.uint8), np.zeros(n, np.uint64))
        todo, state = np.arange(n, dtype=np.int32), np.array([n, 0])
        way, alpha = lobe or (None, None)
        while state[0]:
            check()
            with stats.stage("gathered light: asked"):
                _asked(*g.shape, g.other, g.flipped, self._longest, g.corner, g.coarse, *self._known(), WITHIN, STRICT,
                       self._fine, self._fine / 2**BEYOND, LAST, ENOUGH, hits.triangle, hits.P, hits.Ng, hits.Ns, way,
                       alpha, *ask, todo, state)
                state[0] = state[1]
                waiting = todo[:state[0]]
                why = ask.why[waiting]
                new, wanted, cells, sight = (waiting[why == one] for one in (NEW, WANTED, CELL, SIGHT))
                self._enter(ask.keys[new].ravel())
                self._find_clear(ask.half[cells], ask.keys[cells])
                self._look(hits, ask, sight)
            self._ready(ask.number[wanted].ravel(), check)
        whole = 1 - ask.share  # what is left out counts as the rest does
        return Gathered(ask.light / whole[:, None], ask.sky / whole)

    def nearly(self, hits: Hits, direction: NDArray[np.float64], size: NDArray[np.float64],
               check: Check) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return two lights (n,3) at the places that rays along `direction` (n,3) hit: that of lamps, and that from
        everywhere. Each is the radiance of a white matt surface, as a mean over patches of about size (n,), scene
        units.
        """
        with self._field.stats.stage("gathered light: patches"), self._patches.asked():
            met = self._gather.at(hits.triangle, hits.P, direction, size)
            return self._patches.arriving(met, self._bounces, check)

    def _look(self, hits: Hits, ask: _Asked, rows: NDArray[np.int32]) -> None:
        """Find out which records (n,3) can be seen from the receivers of these rows."""
        of, corner = np.nonzero(ask.weight[rows] > 1e-9)
        row = rows[of]
        # both ends stand a little above the surface
        blocked = self._field.tracer.occluded(hits.P, row, points(self._P), ask.number[row, corner], hits.Ng, False,
                                              kind="diffuse")
        ask.visible[rows] = True
        ask.visible[row, corner] = ~blocked
        ask.seen[rows] = ask.level[rows] + 1
        self._field.stats.add(gathered_short_rays=len(row))

    def _find_clear(self, half: NDArray[np.uint64], keys: NDArray[np.uint64]) -> None:
        """Find out in which halves of cells (n,) nothing stands between places there and the records (n,3) around them,
        so that receivers need not ask each for itself.

        That is so where no edge comes into what lies between the surface and the lifted records, and nothing cuts
        through all of it: then it would cut one of three lines around it.
        """
        if not len(half):
            return
        half, first = np.unique(half, return_index=True)
        corners = self._field.grids.places(keys[first].ravel(), EDGE)
        P, N, spacing = corners.P.reshape(-1, 3, 3), corners.N[::3], corners.spacing[::3]
        start = np.arange(3 * len(half), dtype=np.int32)
        end = start.reshape(-1, 3)[:, [1, 2, 0]].ravel()
        up = corners.P + LIFT * corners.spacing[:, None] * corners.N
        blocked = self._field.tracer.occluded(corners.P, start, points(up), end, corners.N, False, kind="diffuse")
        clear = ~blocked.reshape(-1, 3).any(1) & self._nearness.clear(P, N, spacing, 2 * INSET, 1.5 * LIFT)
        self._field.stats.add(gathered_short_rays=len(start))
        with self._lock:
            number = self._cells.numbers(half)
            if len(self._cells) > len(self._clear):
                more = max(len(self._cells), 2 * len(self._clear), 4096) - len(self._clear)
                self._clear = np.concatenate([self._clear, np.zeros(more, np.uint8)])
            self._clear[number] = np.where(clear, 1, 2)

    def _enter(self, keys: NDArray[np.uint64]) -> None:
        """Enter records with these keys (n,), and find out how near edges are to them."""
        if not len(keys):
            return
        with self._lock:
            before = len(self._table)
            self._table.numbers(keys)
            new = slice(before, len(self._table))
            if new.stop > before:
                self._grow()
                self._place(new)

    def _place(self, new: slice) -> None:
        """Find out how near edges are to new records."""
        places = self._field.grids.places(self._table.keys[new])
        near = self._nearness(places.P, places.N, places.spacing, places.own)
        near[self._is_card(self._table.keys[new])] = np.inf  # they are seen from all of the card
        self._inverse[new], self._nearest[new] = WITHIN / (APART * np.maximum(near, 1e-30)), near
        self._placed[new] = True

    def _known(self) -> tuple[NDArray | None, ...]:
        """Return the table of records, and the arrays of their data. The data of a record that is not computed says
        that nothing is near.
        """
        with self._lock:
            return (*self._table.arrays[:2], self._inverse, self._nearest, self._done, self._M, self._mean, self._open,
                    self._sectors if self._glossy else None, *self._cells.arrays[:2], self._clear)

    def _ready(self, number: NDArray[np.int32], check: Check) -> None:
        """Make sure that records (n,) are computed, by this thread or another one."""
        if not len(number):
            return
        with self._lock:
            mine = np.unique(number[~self._claimed[number]])
            self._claimed[mine] = True
            keys = self._table.keys[mine]
        if len(mine):
            try:
                self._compute_all(mine, keys, check)
            except BaseException:
                with self._lock:
                    self._broken = True
                    self._lock.notify_all()
                raise
        with self._lock:
            if len(mine):
                self._lock.notify_all()
            while not self._done[number].all():
                if self._broken:
                    raise SharedRecordsError("another thread failed while it computed light that this one needs")
                self._lock.wait()

    def _grow(self) -> None:
        n, had = len(self._table), len(self._done)
        if n <= had:
            return
        more = max(n, 2 * had, 4096) - had
        for name in _ARRAYS:
            a = getattr(self, name)
            setattr(self, name, np.concatenate([a, np.zeros((more, *a.shape[1:]), a.dtype)]))

    def _compute_all(self, new: NDArray[np.int32], keys: NDArray[np.uint64], check: Check) -> None:
        """Compute records (n,) with these keys."""
        small = (keys & CORNER != 0) & (keys & SOURCE == 0)
        small[small] = self._thinned.small[_corner(keys[small])]
        if small.any():
            alone = self._blend(new[small], keys[small], check)
            small[np.flatnonzero(small)[alone]] = False
            new, keys = new[~small], keys[~small]
        places, card = self._field.grids.places(keys), self._is_card(keys)
        for some in _parts(np.flatnonzero(card), BATCH // CARD_RAYS):
            at, rays = Places._make(a[some] for a in places), self._nested[CARD_RAYS].first
            mean, _, _, free, found = self._summed(self._ask(at, rays.local, check), rays)[0]
            self._store(new[some], *at[:3], mean, self._inverse[new[some]], self._nearest[new[some]], free, found)
        left = ~card
        for at_least, n in RAYS:
            rows = np.flatnonzero(left & (places.spacing >= at_least * self._fine))
            left[rows] = False
            for some in _parts(rows, BATCH // n):
                at = Places._make(a[some] for a in places)
                self._store(new[some], *at[:3], *self._compute(at, self._nested[n], check))

    def _is_card(self, keys: NDArray[np.uint64]) -> NDArray[np.bool_]:
        """Return which records with these keys (n,) are those of cards."""
        found = (keys & CORNER) != 0
        found[found] = self._card[_corner(keys[found])]
        return found

    def _blend(self, new: NDArray[np.int32], keys: NDArray[np.uint64], check: Check) -> NDArray[np.bool_]:
        """Let records of small corners (n,) have what sources near them gather. Return those that see no source."""
        places = self._field.grids.places(keys)
        sources = self._thinned.around(_corner(keys))
        there = sources.corner >= 0
        bits = CORNER | SOURCE | keys & np.uint64(1 << 31)
        number = np.full(there.shape, -1, np.int32)
        wanted, which = np.unique((sources.corner.astype(np.uint64) | bits[:, None])[there], return_inverse=True)
        self._enter(wanted)
        with self._lock:
            of = self._table.numbers(wanted)
        number[there] = of[which.reshape(-1)]
        self._ready(of, check)
        self._hide(places, sources, number)
        alone: NDArray[np.bool_] = ~(sources.weight > 0).any(1)
        rows = np.flatnonzero(~alone)
        out = self._room(len(rows))
        with self._lock:
            known = self._M, self._mean, self._inverse, self._nearest, self._open
            kept = (self._sectors, out[-1]) if self._glossy else (None, None)
        _mean_of(number[rows], sources.weight[rows], places.N[rows], *known, kept[0], *out[:-1], kept[1])
        self._store(new[rows], *(a[rows] for a in places[:3]), *out)
        return alone

    def _hide(self, places: Places, sources: Sources, number: NDArray[np.int32]) -> None:
        """Take the weight from sources (n,s) that are hidden from these places (n,) by what is near them."""
        with self._lock:
            P, M, nearest = self._P, self._M, self._nearest
        row, at = np.nonzero(sources.weight > 0)
        of, up = number[row, at], ABOVE * self._thinned.reach
        near = np.flatnonzero(nearest[of] < 1.5 * np.linalg.norm(P[of] - places.P[row], axis=1) + up)
        if not len(near):
            return
        row, at, of = row[near], at[near], of[near]
        ends, number = points(P[of] + up * M[of]), np.arange(len(of), dtype=np.int32)
        blocked = self._field.tracer.occluded(places.P + up * places.N, row.astype(np.int32), ends, number, None, False,
                                              kind="diffuse")
        sources.weight[row[blocked], at[blocked]] = 0
        self._field.stats.add(gathered_short_rays=len(of))

    def _compute(self, places: Places, rays: Nested, check: Check) -> tuple[NDArray, ...]:
        """Return what `_store` keeps of records. Where the first rays leave their light uncertain, they send more."""
        first = self._ask(places, rays.first.local, check)
        out, noise = self._summed(first, rays.first)
        twice = noise <= NOISE * 2**SPREAD
        for times, wanted in ((2, (noise > NOISE) & twice), (4, ~twice)):
            for rows in _parts(np.flatnonzero(wanted), BATCH // len(rays.more[times])):
                more = self._ask(Places._make(a[rows] for a in places), rays.more[times], check)
                found, _ = self._summed(together(first, rows, more), rays.all[times])
                for kept, values in zip(out, found, strict=True):
                    kept[rows] = values
        return out

    def _ask(self, places: Places, local: NDArray[np.float64], check: Check) -> Light:
        """Return the light that rays of records find along `local` (d,3) around their normals."""
        check()
        with self._field.stats.stage("gathered light: rays"):
            seen = self._gather(places.P, places.N, local)
        with self._field.stats.stage("gathered light: patches"):
            return light_of(seen, len(local), self._patches, self._bounces, self._glossy, check)

    def _summed(self, light: Light, rays: Rays) -> tuple[tuple[NDArray, ...], NDArray[np.float32]]:
        """Return what the kernel `records_sum` makes of the light that rays find, and how uncertain it is."""
        out, noise = self._room(len(light.number)), np.empty(len(light.number), np.float32)
        _sum(*light, rays.tilts, rays.within, *rays.beside, *out[:-1], noise, out[-1] if self._glossy else None)
        return out, noise

    def _room(self, n: int) -> tuple[NDArray, ...]:
        """Return arrays for what `_store` keeps of n records: mean, inverse, nearest, open, sectors."""
        return (np.empty((n, 5, 3), np.float32), *(np.empty(n, np.float32) for _ in range(3)),
                np.empty((n, self._sectors.shape[1]), np.uint32))

    def _store(self, new: NDArray[np.int32], P: NDArray, N: NDArray, spacing: NDArray, mean: NDArray, inverse: NDArray,
               nearest: NDArray, free: NDArray, found: NDArray) -> None:
        """Keep what has been found at records (n,), so that other threads see it."""
        with self._lock:
            self._P[new], self._M[new] = P + LIFT * spacing[:, None] * N, N
            self._mean[new], self._open[new], self._sectors[new] = mean, free, found
            self._inverse[new] = np.maximum(inverse, self._inverse[new])
            self._nearest[new] = np.minimum(nearest, self._nearest[new])
        with self._lock:  # again: other threads read without it, and see what was written before they see this
            self._done[new] = True
        self._field.stats.add(records=len(new))


def _parts(rows: NDArray[np.int64], most: int) -> Iterator[NDArray[np.int64]]:
    """Return these rows (n,) in parts of so many, or fewer."""
    return (rows[i:i + most] for i in range(0, len(rows), most))


def _corner(keys: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the numbers (n,) of the corners of records with these keys."""
    return (keys & np.uint64((1 << 31) - 1)).astype(np.int64)


class _Asked(NamedTuple):
    """How far n receivers are; see the kernel records_asked."""

    level: NDArray[np.int32]  # (n,)
    share: NDArray[np.float64]  # (n,)
    light: NDArray[np.float64]  # (n,3)
    sky: NDArray[np.float64]  # (n,)
    keys: NDArray[np.uint64]  # (n,3)
    number: NDArray[np.int32]  # (n,3)
    weight: NDArray[np.float64]  # (n,3)
    visible: NDArray[np.bool_]  # (n,3)
    seen: NDArray[np.int32]  # (n,)
    why: NDArray[np.uint8]  # (n,)
    half: NDArray[np.uint64]  # (n,)
