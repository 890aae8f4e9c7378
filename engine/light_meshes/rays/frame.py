"""The tracer's frame: where float32 has its digits, and huge triangles cut into pieces that have them there too.

A float32 is as fine as it is near 0. Where the whole scene is not much larger than what is in view, the frame is its
box. Else its centre is where the view begins: what is seen, in mirrors too, is then as fine as it is near. A triangle
is only as fine as its farthest vertex; so edges that pass the centre nearer than they are long are halved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Camera, SceneError
from ..support.compiled import kernel, part

VIEWS = 16.0  # widths of the view: a scene with half a box of so many has its box as frame
FAR = 2.0**38  # the farthest that triangles may be in the frame: products of three lengths are float32 in Embree
PIECES = 4_000_000  # triangles are not cut into more


class Frame(NamedTuple):
    """Recentred and scaled in float64, so that all triangles lie in [−reach, reach]."""

    centre: NDArray[np.float64]  # (3,) world
    scale: float  # world lengths of one unit of the frame; a power of two, so that scaling is exact
    reach: float  # 1: the frame is the scene's box

    def to_frame(self, world: NDArray[np.float64]) -> NDArray[np.float64]:
        """World points (n,3) in the frame, float64."""
        return (world - self.centre) / self.scale


def frame(world: NDArray[np.float64], triangles: NDArray[np.int32], seen: NDArray[np.bool_], camera: Camera) -> Frame:
    """The frame for triangles (T,3) of points `world` (V,3). seen (T,): what the camera may see."""
    used = np.zeros(len(world), np.bool_)
    used[triangles] = True
    finite = world[used & np.isfinite(world).all(1)]
    if not len(finite):
        return Frame(np.zeros(3), 1.0, 1.0)
    low, high = finite.min(0), finite.max(0)
    half = float((high / 2 - low / 2).max())
    if not np.isfinite(half) or half > 1e150:
        raise SceneError("the scene is more than 1e150 units across: look for an object far from all others")
    left, right, bottom, top = camera.window
    depth = _first(world, triangles, seen, camera.matrix, np.array(camera.window, np.float64), camera.perspective,
                   float(camera.clip_start))
    width = max(abs(right - left), abs(top - bottom)) * (depth if camera.perspective else 1.0)
    if not np.isfinite(depth) or not half > VIEWS * width > 0.0:
        # 2 % of room, so that rounding leaves nothing outside.
        return Frame(low / 2 + high / 2, 2.0 ** np.ceil(np.log2(max(half, 1e-150) * 1.02)), 1.0)
    if half / (FAR / 4) < 30 * width:  # rather a little coarser than without what is far
        width = max(width, half / (FAR / 4))
    # In large steps: a view that moves a little keeps its frame, and so its accelerator.
    scale = 4.0 ** np.ceil(np.log2(2.0 * width) / 2)
    middle = np.array([(left + right) / 2, (bottom + top) / 2]) * (depth if camera.perspective else 1.0)
    begin = camera.matrix[:3, 3] + camera.matrix[:3, :3] @ np.array([*middle, -depth])
    centre = np.round(begin / scale) * scale
    reach = float(np.maximum(np.abs(low - centre), np.abs(high - centre)).max()) / scale
    return Frame(centre, scale, min(max(1.0, 1.02 * reach), FAR))


@kernel
def _first(world, triangles, seen, matrix, window, perspective, near):
    """Depth at which the view begins: of the nearest part of a triangle in it. Infinity: nothing is in view."""
    best = np.inf
    piece, clipped = np.empty((9, 3)), np.empty((9, 3))
    side = np.empty((5, 4))  # x, y, depth and 1 times these are at least 0 within the view
    side[:] = 0.0
    slope = 2 if perspective else 3
    for k in range(4):
        sign = 1.0 if k % 2 == 0 else -1.0
        side[k, k // 2], side[k, slope] = sign, -sign * window[k]
    side[4, 2], side[4, 3] = 1.0, -near
    for t in range(len(triangles)):
        if not seen[t]:
            continue
        nearest = np.inf
        for k in range(3):
            x, y, z = 0.0, 0.0, 0.0
            for r in range(3):
                away = world[triangles[t, k], r] - matrix[r, 3]
                x, y, z = x + matrix[r, 0] * away, y + matrix[r, 1] * away, z - matrix[r, 2] * away
            piece[k, 0], piece[k, 1], piece[k, 2] = x, y, z
            nearest = min(nearest, z) if z == z else np.nan
        if not nearest < best:
            continue
        count = 3
        for k in range(5):
            count = _clip(piece, count, side[k], clipped)
            piece, clipped = clipped, piece
        for k in range(count):
            best = min(best, piece[k, 2])
    return best


@part
def _clip(polygon, count, side, out):
    """The part of a polygon (count,3) on one side of a plane, into `out`; returns its number of corners."""
    n = 0
    for k in range(count):
        o = (k + 1) % count
        a = side[0] * polygon[k, 0] + side[1] * polygon[k, 1] + side[2] * polygon[k, 2] + side[3]
        b = side[0] * polygon[o, 0] + side[1] * polygon[o, 1] + side[2] * polygon[o, 2] + side[3]
        if a >= 0.0:
            for j in range(3):
                out[n, j] = polygon[k, j]
            n += 1
        if (a >= 0.0) != (b >= 0.0):
            for j in range(3):
                out[n, j] = polygon[k, j] + a / (a - b) * (polygon[o, j] - polygon[k, j])
            n += 1
    return n


def too_large(local: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Which triangles (T,3) of points `local` (V,3) in the frame have an edge to halve."""
    out = np.zeros(len(triangles), np.bool_)
    _too_large(local, triangles, out)
    return out


def cut(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]:
    """Triangles (n,3,3) in the frame in pieces: their corners (m,3,3), where these are (m,3,2: u, v), and in which.

    Which edges are halved depends on nothing but their ends: pieces of neighbours fit. What is beyond FAR is lost.
    """
    whole = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    todo = np.concatenate([corners, np.broadcast_to(whole, (len(corners), 3, 2))], axis=2)
    source = np.arange(len(corners))
    done: list[tuple[NDArray, NDArray]] = []
    count = 0
    while len(todo):
        long = np.empty((len(todo), 3), np.bool_)
        _long_edges(todo, long)
        edges = long.sum(1)
        if count + len(todo) > PIECES:
            edges[:] = 0
        ready = edges == 0
        done.append((todo[ready], source[ready]))
        count += int(ready.sum())
        parts, owners = [], []
        for number, first in ((1, long.argmax(1)), (2, (long.argmin(1) + 1) % 3), (3, np.zeros(len(todo), np.intp))):
            rows = np.flatnonzero(edges == number)
            turned = (first[rows, None] + np.arange(3)) % 3  # the long edges come first
            a, b, c = np.take_along_axis(todo[rows], turned[:, :, None], axis=1).transpose(1, 0, 2)
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            if number == 1:
                new = [(a, ab, c), (ab, b, c)]
            elif number == 2:
                new = [(ab, b, bc), (a, ab, bc), (a, bc, c)]
            else:
                new = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
            parts += [np.stack(piece, axis=1) for piece in new]
            owners += [source[rows]] * len(new)
        todo, source = np.concatenate(parts), np.concatenate(owners)
    pieces, source = (np.concatenate(column) for column in zip(*done, strict=True))
    near = (np.abs(pieces[..., :3]) <= FAR).all((1, 2))
    pieces, source = pieces[near], source[near]
    order = np.argsort(source, kind="stable")
    return pieces[order, :, :3], pieces[order, :, 3:], source[order]


@part
def _long_edge(a, b):
    """Whether an edge (a, b: 3 numbers or more) is longer than 1 and than its way past the centre; same for (b, a)."""
    swap = a[0] > b[0] or (a[0] == b[0] and (a[1] > b[1] or (a[1] == b[1] and a[2] > b[2])))
    along, square, distance = 0.0, 0.0, 0.0
    for j in range(3):
        begin, end = (b[j], a[j]) if swap else (a[j], b[j])
        along -= begin * (end - begin)
        square += (end - begin) ** 2
    if not square > 1.0:
        return False
    along = min(max(along / square, 0.0), 1.0)
    for j in range(3):
        begin, end = (b[j], a[j]) if swap else (a[j], b[j])
        distance += (begin + along * (end - begin)) ** 2
    return square > distance


@kernel
def _too_large(local, triangles, out):
    for t in range(len(triangles)):
        a, b, c = local[triangles[t, 0]], local[triangles[t, 1]], local[triangles[t, 2]]
        farthest = 0.0
        for j in range(3):
            farthest = max(farthest, abs(a[j]), abs(b[j]), abs(c[j]))
        out[t] = farthest > 1.0 and (
            farthest > FAR or _long_edge(a, b) or _long_edge(b, c) or _long_edge(c, a))


@kernel
def _long_edges(todo, long):
    for n in range(len(todo)):
        for k in range(3):
            long[n, k] = _long_edge(todo[n, k], todo[n, (k + 1) % 3])
