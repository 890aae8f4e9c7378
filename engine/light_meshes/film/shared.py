"""How samples become pixels: by themselves, or shared with the pixels around.

A Blackman-Harris filter of the usual size, 1.5 pixels, reaches over the pixels around. Usually each pixel has samples
of its own, placed like the filter, and takes their mean. With `share_samples` the samples are spread evenly over their
pixels, and a pixel takes all that the filter reaches, weighted by the filter. So n samples are as near to the truth as
about 2¼ n, and no ray more is traced.

A tile does not have the samples around it. So its pixels at borders to other tiles are made again from *seams*, which
keep what the pixels on both sides give, until all tiles around have been drawn. At the border of a crop more samples
are drawn than the crop has. So a pixel is the same whatever the tiles and the crop are. At the border of the picture
the filter ends.
"""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..rays.camera import Taps, filter_taps
from ..support.native import kernel
from .mattes import KINDS, Seen
from .passes import CENTRE, Tile

_filtered = kernel("passes_filtered")

Box = tuple[int, int, int, int]  # pixels x0, y0, x1, y1
Developed = dict[str, NDArray[np.float64]]  # pass → (height, width, channels)


class Film:
    """Makes pixels of samples; each pixel has its own."""

    def __init__(self, names: Sequence[str], samples: int) -> None:
        """names: of the passes. samples: per pixel."""
        self._names, self._samples = tuple(names), samples

    def needs(self, box: Box) -> Box:
        """Return the pixels whose samples the tile `box` needs, without those that other tiles draw."""
        return box

    def developed(self, tile: Tile, drawn: Box, box: Box) -> Iterator[tuple[Box, Developed]]:
        """Yield pixels with their passes, of a tile `box` with the samples of at least `needs(box)`: of `drawn`.

        Threads may do this side by side. Pixels may come again, after they have been taken, with the right values.
        """
        yield box, _alone(tile, drawn, box, self._names, self._samples)


def _alone(tile: Tile, drawn: Box, box: Box, names: Sequence[str], samples: int) -> Developed:
    """Return passes of the pixels `box`, each of its own samples."""
    part = np.s_[box[1] - drawn[1]:box[3] - drawn[1], box[0] - drawn[0]:box[2] - drawn[0]]
    return {name: tile.developed(name, drawn, samples)[part] for name in names}


class SharedFilm(Film):
    """Makes pixels of their own samples and of those around."""

    def __init__(self, names: Sequence[str], offsets: NDArray[np.float64], filter_size: float, size: tuple[int, int],
                 crop: Box, tiles: Sequence[Box]) -> None:
        """names: of the passes. offsets (n,2): of a pixel's samples. size: width and height of the picture, of which
        `tiles`, in rows and columns, make up the crop.
        """
        super().__init__(names, len(offsets))
        self._taps, self._crop, self._lock = filter_taps(offsets, filter_size), crop, threading.Lock()
        self._around = self._taps.by_pixel()
        # the same of the pixels that they are in, by which these give something to others
        self._given = [own._replace(up=0 * own.up, right=0 * own.right) for own in self._around]
        self._means = [name for name in names if name not in CENTRE and not name.startswith(KINDS)]
        self._area = _grown(crop, self._taps.reach, (0, 0, *size))
        self._columns, self._rows = (sorted({box[axis] for box in tiles}) for axis in (0, 1))
        self._seams: dict[Box, list[_Seam]] = {box: [] for box in tiles}
        at = {box[:2]: box for box in tiles}
        for box in tiles:
            for axis in (0, 1):
                if box[axis] > crop[axis]:
                    self._join(box, axis, at)

    def _join(self, box: Box, axis: int, at: dict[tuple[int, int], Box]) -> None:
        """Add the seam of a tile with the one on its left (axis 0) or below it. at: the tiles, by their first pixel."""
        reach, low, high = self._taps.reach, list(box[:2]), list(box[2:])
        low[axis], high[axis] = box[axis] - reach, box[axis] + reach
        inside = _common((low[0], low[1], high[0], high[1]), self._crop)
        around = _grown(inside, reach, self._area)
        columns, rows = (places[max(0, bisect_right(places, around[k]) - 1):bisect_left(places, around[k + 2])]
                         for k, places in ((0, self._columns), (1, self._rows)))
        of = [at[corner] for corner in product(columns, rows)]
        seam = _Seam(around, inside, len(of))
        for tile in of:
            self._seams[tile].append(seam)

    def needs(self, box: Box) -> Box:
        """See Film."""
        sides = zip(box, self._crop, self._area, strict=True)
        x0, y0, x1, y1 = (outer if side == end else side for side, end, outer in sides)
        return x0, y0, x1, y1

    def developed(self, tile: Tile, drawn: Box, box: Box) -> Iterator[tuple[Box, Developed]]:
        """See Film."""
        size, inside = (drawn[2] - drawn[0], drawn[3] - drawn[1]), _moved(box, drawn)
        made = _alone(tile, drawn, box, [name for name in self._names if name in CENTRE], self._samples)
        weights = _weights(self._around, size, inside)
        for name in self._means:
            made[name] = self._sums(tile.samples[name], size[0], inside, self._taps) / weights
        seen = {kind: tile.mattes.seen(kind) for kind in tile.mattes.wanted}
        yield box, made | self._mattes(seen, size, inside, weights)
        for seam in self._seams.pop(box):
            common = _common(seam.around, drawn)
            gives = {name: self._gives(tile.samples[name], size[0], _moved(common, drawn)) for name in self._means}
            moved = {kind: one.moved(drawn, seam.around, self._samples) for kind, one in seen.items()}
            with self._lock:
                seam.take(common, gives, moved)
                whole = seam.missing == 0
            if whole:
                yield seam.inside, self._joined(seam)

    def _sums(self, samples: NDArray[np.float64], width: int, box: Box, taps: Taps) -> NDArray[np.float64]:
        """Return the sums of taps (height, width, channels) of the pixels `box`; `width`: of the samples' pixels."""
        q = samples.shape[1]
        sums = np.empty((box[3] - box[1], box[2] - box[0], q))
        _filtered(samples, width, self._samples, np.array(box, np.int64), taps.counts(), *taps, np.empty_like(taps.up),
                  np.empty(q), sums.reshape(-1, q))
        return sums

    def _gives(self, samples: NDArray[np.float64], width: int, box: Box) -> NDArray[np.float64]:
        """Return what pixels give each of those around, in the order of the taps (height, width, these, channels)."""
        return np.stack([self._sums(samples, width, box, own) for own in self._given], axis=2)

    def _joined(self, seam: _Seam) -> Developed:
        """Return the passes of a seam that nothing is missing from."""
        box, size = _moved(seam.inside, seam.around), (seam.around[2] - seam.around[0], seam.around[3] - seam.around[1])
        weights, made = _weights(self._around, size, box), {}
        for name in self._means:
            gives = seam.gives[name]
            sums = np.zeros((box[3] - box[1], box[2] - box[0], gives.shape[-1]))
            for k, own in enumerate(self._around):
                up, right = int(own.up[0]), int(own.right[0])
                there = _common(_moved(box, (-right, -up, 0, 0)), (0, 0, *size))
                to = _moved(there, (box[0] + right, box[1] + up, 0, 0))
                sums[to[1]:to[3], to[0]:to[2]] += gives[there[1]:there[3], there[0]:there[2], k]
            made[name] = sums / weights
        seen = {kind: Seen.together(parts) for kind, parts in seam.seen.items()}
        return made | self._mattes(seen, size, box, weights)

    def _mattes(self, seen: dict[str, Seen], size: tuple[int, int], inside: Box, weights: NDArray) -> Developed:
        """Return the mattes of the pixels `inside`, by what the samples of width × height pixels (size) see."""
        ranked = {kind: one.shared(self._taps, size[0], inside, self._samples, weights) for kind, one in seen.items()}
        shape = (inside[3] - inside[1], inside[2] - inside[0], -1)
        return {name: ranked[name[:-2]].values(name, weights.size).reshape(shape)
                for name in self._names if name.startswith(KINDS)}


class _Seam:
    """What pixels give to those around, along a border between tiles."""

    def __init__(self, around: Box, inside: Box, tiles: int) -> None:
        """inside: the pixels that are made. around: those that give them something, which come from so many tiles."""
        self.around, self.inside, self.missing = around, inside, tiles
        self.gives: dict[str, NDArray[np.float64]] = {}  # pass → (height, width, pixels that get it, channels)
        self.seen: dict[str, list[Seen]] = {}

    def take(self, box: Box, gives: dict[str, NDArray[np.float64]], seen: dict[str, Seen]) -> None:
        """Keep what the pixels `box` of a tile give."""
        x0, y0, x1, y1 = _moved(box, self.around)
        for name, part in gives.items():
            if name not in self.gives:
                shape = self.around[3] - self.around[1], self.around[2] - self.around[0]
                self.gives[name] = np.empty((*shape, *part.shape[2:]))
            self.gives[name][y0:y1, x0:x1] = part
        for kind, one in seen.items():
            self.seen.setdefault(kind, []).append(one)
        self.missing -= 1


def _weights(around: Sequence[Taps], size: tuple[int, int], inside: Box) -> NDArray[np.float64]:
    """Return the sum of the weights of the taps of each pixel `inside` (height, width, 1) that are in a picture of
    width × height pixels (size). around: the taps in each of the pixels around.
    """
    x, y = np.arange(inside[0], inside[2]), np.arange(inside[1], inside[3])[:, None]
    total = np.zeros((len(y), len(x)))
    for own in around:
        u, v = x + own.right[0], y + own.up[0]
        total += np.where((u >= 0) & (u < size[0]) & (v >= 0) & (v < size[1]), own.weight.sum(), 0.0)
    return total[:, :, None]


def _common(a: Box, b: Box) -> Box:
    """Return the pixels that both have."""
    return max(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), min(a[3], b[3])


def _grown(box: Box, by: int, within: Box) -> Box:
    """Return the pixels that are at most so far from a box, and in another one."""
    return _common((box[0] - by, box[1] - by, box[2] + by, box[3] + by), within)


def _moved(box: Box, origin: Box) -> Box:
    """Return a box relative to the first pixel of another."""
    return box[0] - origin[0], box[1] - origin[1], box[2] - origin[0], box[3] - origin[1]
