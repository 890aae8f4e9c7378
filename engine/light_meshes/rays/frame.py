"""The tracer's frame: coordinates in which float32 is precise where it matters. Huge triangles are cut into pieces that
are precise as well.

float32 is most precise near 0. If the whole scene is not much larger than the visible part, the frame is the scene's
box. Otherwise the centre of the frame is where the view begins, so what is seen, also in mirrors, is more precise the
nearer it is. A triangle is only as precise as its farthest vertex. So an edge that passes the centre at a distance less
than its length is halved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Camera
from ..scene.errors import SceneError
from ..support.native import kernel

_first, _too_large, _long_edges = kernel("frame_first"), kernel("frame_too_large"), kernel("frame_long_edges")

VIEWS = 16.0  # widths of the view: if half the scene's box is not larger than this many, the box is the frame
# the farthest that triangles may be in the frame, because Embree computes products of three lengths in float32
FAR = 2.0**38
PIECES = 4_000_000  # triangles are not cut into more pieces than this


class Frame(NamedTuple):
    """A shift and a scale, in float64, so that all triangles are in [−reach, reach]."""

    centre: NDArray[np.float64]  # (3,) world
    scale: float  # world lengths of one unit of the frame; a power of two, so that scaling is exact
    reach: float  # 1 if the frame is the scene's box

    def to_frame(self, world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return world points (n,3) in the frame, float64."""
        return (world - self.centre) / self.scale


def frame(world: NDArray[np.float64], triangles: NDArray[np.int32], seen: NDArray[np.bool_], camera: Camera) -> Frame:
    """Return the frame for triangles (T,3) of points `world` (V,3). `seen` (T,) says which triangles the camera may
    see.
    """
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
    first = np.empty(1)
    _first(world, triangles, seen, np.ascontiguousarray(camera.matrix, np.float64), np.array(camera.window, np.float64),
           camera.perspective, camera.clip_start, first)
    depth = float(first[0])
    width = max(abs(right - left), abs(top - bottom)) * (depth if camera.perspective else 1.0)
    if not np.isfinite(depth) or not half > VIEWS * width > 0.0:
        # 2 % larger, so that rounding leaves no vertex outside.
        return Frame(low / 2 + high / 2, 2.0 ** np.ceil(np.log2(max(half, 1e-150) * 1.02)), 1.0)
    if half / (FAR / 4) < 30 * width:  # a little less precision is better than dropping what is far
        width = max(width, half / (FAR / 4))
    # Use large steps, so that a view that moves a little keeps its frame, and so its accelerator.
    scale = 4.0 ** np.ceil(np.log2(2.0 * width) / 2)
    middle = np.array([(left + right) / 2, (bottom + top) / 2]) * (depth if camera.perspective else 1.0)
    begin = camera.matrix[:3, 3] + camera.matrix[:3, :3] @ np.array([*middle, -depth])
    centre = np.round(begin / scale) * scale
    reach = float(np.maximum(np.abs(low - centre), np.abs(high - centre)).max()) / scale
    return Frame(centre, scale, min(max(1.0, 1.02 * reach), FAR))


def too_large(local: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return which triangles (T,3) of points `local` (V,3) in the frame have an edge that must be halved."""
    out = np.zeros(len(triangles), np.bool_)
    _too_large(local, triangles, out)
    return out


def cut(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]:
    """Cut triangles (n,3,3) in the frame into pieces. Returns their corners (m,3,3), these as u, v on the whole
    triangle (m,3,2), and the row of that triangle (m,).

    Whether an edge is halved depends only on its ends, so pieces of neighbours fit together. Triangles beyond FAR are
    dropped.
    """
    whole = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    todo = np.concatenate([corners, np.broadcast_to(whole, (len(corners), 3, 2))], axis=2)
    source = np.arange(len(corners))
    done: list[tuple[NDArray, NDArray]] = []
    count = 0
    while len(todo):
        long = np.empty((len(todo), 3), np.bool_)
        _long_edges(np.ascontiguousarray(todo), long)
        edges = long.sum(1)
        if count + len(todo) > PIECES:
            edges[:] = 0
        ready = edges == 0
        done.append((todo[ready], source[ready]))
        count += int(ready.sum())
        parts, owners = [], []
        for number, first in ((1, long.argmax(1)), (2, (long.argmin(1) + 1) % 3), (3, np.zeros(len(todo), np.intp))):
            rows = np.flatnonzero(edges == number)
            turned = (first[rows, None] + np.arange(3)) % 3  # put the long edges first
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
