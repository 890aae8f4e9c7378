"""Camera rays: where they pass through a pixel's filter, and through which point of the lens."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Camera
from ..support.native import kernel


def coarser(camera: Camera, divisor: int) -> Camera:
    """Return the camera with 1/`divisor` of the pixels in each direction. It sees exactly the same."""
    if divisor == 1:
        return camera
    x0, y0, x1, y1 = camera.crop or (0, 0, camera.width, camera.height)
    left, right, bottom, top = camera.window
    wide, high = (right - left) / camera.width, (top - bottom) / camera.height
    return dataclasses.replace(
        camera, crop=None, width=-(-(x1 - x0) // divisor), height=-(-(y1 - y0) // divisor),
        window=(left + wide * x0, left + wide * x1, bottom + high * y0, bottom + high * y1))


def blackman_harris(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Blackman-Harris filter at places x of its window, which goes from −.5 to .5."""
    a = 2 * np.pi * (x + 0.5)
    return 0.35875 - 0.48829 * np.cos(a) + 0.14128 * np.cos(2 * a) - 0.01168 * np.cos(3 * a)


def filter_offsets(samples: int, filter_size: float, shared: bool = False) -> NDArray[np.float64]:
    """Return offsets (n,2) from a pixel's centre, in pixels, distributed as a Blackman-Harris filter of that size.

    As in Cycles the filter ends `filter_size` from the centre: its window is twice as wide. Every pixel has the same n
    offsets, so the picture has no noise; for n = 1 it is the centre. The offsets are Latin hypercube strata (in van der
    Corput's order), mapped by the inverse distribution of the filter. All samples have the same weight, as in Cycles.
    The first sample is the one nearest to the centre. With `shared` the strata are spread evenly over the pixel
    instead, because the film weights the samples by the filter (`film/shared.py`).
    """
    stratum = (np.arange(samples) + 0.5) / samples
    corput = np.zeros(samples)
    for bit in range(13):
        corput += (np.arange(samples) >> bit & 1) * 0.5 ** (bit + 1)
    order = np.argsort(np.argsort(corput, kind="stable"), kind="stable")
    x = np.linspace(-0.5, 0.5, 4097)
    density = blackman_harris(x)
    share = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2)])
    inverse = np.interp(stratum, share / share[-1], x)
    inverse = (inverse - inverse[::-1]) / 2  # the filter is symmetric, so make the table symmetric to the last bit
    offsets = 2 * filter_size * np.stack([inverse, inverse[order]], axis=1)
    if shared:
        offsets = np.stack([stratum, stratum[order]], axis=1) - 0.5
    return offsets[np.argsort((offsets**2).sum(1), kind="stable")]


class Taps(NamedTuple):
    """The samples that a pixel takes if it shares them with those around, in the order in which they are added: arrays
    (t,). Those that are in one pixel follow each other.
    """

    up: NDArray[np.int64]  # so many pixels away from the one that takes them
    right: NDArray[np.int64]
    sample: NDArray[np.int64]
    weight: NDArray[np.float64]

    @property
    def reach(self) -> int:
        """Return how many pixels away the farthest one is."""
        return int(max(np.abs(self.up).max(), np.abs(self.right).max()))

    def by_pixel(self) -> list[Taps]:
        """Return the taps in each pixel."""
        ends = np.cumsum(self.counts())[:-1]
        return [Taps(*parts) for parts in zip(*(np.split(a, ends) for a in self), strict=True)]

    def counts(self) -> NDArray[np.int64]:
        """Return how many taps are in each pixel."""
        first = np.flatnonzero(np.append(1, np.diff(self.up) | np.diff(self.right)))
        return np.diff(np.append(first, len(self.up)))


def filter_taps(offsets: NDArray[np.float64], filter_size: float) -> Taps:
    """Return the samples that a Blackman-Harris filter reaches from a pixel's centre, where each pixel has samples at
    `offsets` (n,2), with their weights in the filter.
    """
    reach = int(np.ceil(filter_size + 0.5)) - 1
    around = np.arange(-reach, reach + 1)
    up, right, sample = (a.reshape(-1) for a in np.meshgrid(around, around, np.arange(len(offsets)), indexing="ij"))
    x, y = right + offsets[sample, 0], up + offsets[sample, 1]
    weight = blackman_harris(x / (2 * filter_size)) * blackman_harris(y / (2 * filter_size))
    inside = (np.abs(x) < filter_size) & (np.abs(y) < filter_size) & (weight > 0)
    return Taps(up[inside], right[inside], sample[inside], weight[inside])


_rays = kernel("camera_rays_of")
GOLDEN = (5**0.5 - 1) / 2
ORDERS = 16  # how many orders of the lens points are tried


def lens_points(camera: Camera, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points (n,2) on the lens for the n samples of a pixel, in scene units from its centre, x to the right, y
    up.

    They are the same for every pixel, like the samples' `offsets`. So a point out of focus becomes n points, with the
    same variance as the whole lens. A sunflower spiral (Vogel 1979) fills the disk evenly in all directions. A lens
    with blades has the same spiral, with each circle stretched to the polygon (which has the same form as in Cycles).
    The first sample uses the point nearest to the centre; a single sample uses the centre.
    """
    n = len(offsets)
    if camera.lens_radius == 0 or n == 1:
        return np.zeros((n, 2))
    k = np.arange(n)
    angle = 2 * np.pi * (k * GOLDEN % 1)
    if camera.lens_blades < 3:
        outline = np.stack([np.cos(angle), np.sin(angle)])
    else:
        # An angle, as a share of the circle, becomes the same share of the polygon's outline, so equal areas stay
        # equal.
        sector = 2 * np.pi / camera.lens_blades
        blade, along = np.divmod(angle / sector, 1)
        a, b = (np.stack([np.cos(v), np.sin(v)]) for v in (
            (blade + side) * sector + camera.lens_rotation for side in (-0.5, 0.5)))
        outline = a + along * (b - a)
    points = camera.lens_radius * (np.sqrt((k + 0.5) / n) * outline).T / [camera.lens_ratio, 1]
    # The place in the filter and the place on the lens must be almost independent. Each order that is tried goes around
    # the spiral by equal steps that meet every point; the least correlated one is used.
    steps = [m for m in range(-(-n // 4), n) if math.gcd(m, n) == 1]
    orders = [k * m % n for m in steps[::-(-len(steps) // ORDERS)]]
    return points[min(orders, key=lambda order: np.linalg.norm(offsets.T @ points[order]))]


def camera_rays(
    camera: Camera, box: tuple[int, int, int, int], offsets: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return origins (n,3), unit directions (n,3) and reach (n,) of the rays through the pixels of `box` (x0, y0, x1,
    y1).
    """
    x0, y0, x1, y1 = box
    n = (x1 - x0) * (y1 - y0) * len(offsets)
    origin, direction, stretch = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    lens = np.ascontiguousarray(lens_points(camera, offsets))
    _rays(np.ascontiguousarray(camera.matrix, np.float64), np.array(camera.window, np.float64), camera.perspective,
          camera.clip_start, camera.width, camera.height, np.array(box, np.int64), offsets, lens,
          lens / camera.focus_distance, origin, direction, stretch)
    return origin, direction, stretch * (camera.clip_end - camera.clip_start)


def depth(camera: Camera, P: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depth (n,) of world points along the camera's axis, as in Cycles' Depth pass."""
    axis = camera.matrix[:3, 2]
    return -((P[:, 0] - camera.matrix[0, 3]) * axis[0] + (P[:, 1] - camera.matrix[1, 3]) * axis[1]
             + (P[:, 2] - camera.matrix[2, 3]) * axis[2])
