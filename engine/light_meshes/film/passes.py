"""The only list of passes, and the samples of a tile's passes, which the ray tracing fills."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Scene
from ..scene.errors import SceneError
from ..support.native import kernel
from ..support.text import quoted
from .mattes import KINDS, Mattes, Ranked

_sum, _means = kernel("passes_add"), kernel("passes_means")

NO_DEPTH = 1e10  # the value that Cycles writes

# Name → letters of its channels. Validation, framebuffer and channel names in files all use this list. The add-on has
# its own list, which a test compares with this one. "Shadow 3" is for the lights whose Light.shadow_pass is 3, see
# `letters`.
PASSES = {
    "Combined": "RGBA",  # premultiplied
    # These are of the first surface that the camera sees; cut-outs are skipped:
    "Depth": "Z",  # along the camera's axis; NO_DEPTH if nothing is hit
    "Position": "XYZ",  # in the world
    "Normal": "XYZ",  # the shading normal, in the world
    "Mist": "Z",  # 0 near … 1 far; cut-outs and transparent surfaces are weighted by their opacity
    "UV": "UVA",  # A is 1 on surfaces
    "Object Index": "X",
    "Material Index": "X",
    "Shadow": "RGB",  # the mean of S over the lights
    # These add up to Combined (LIGHT):
    "Diffuse": "RGB",
    "Glossy": "RGB",  # highlights, and everything that is seen in a reflection
    "Diffuse Indirect": "RGB",  # light from everywhere that matt surfaces return
    "Emission": "RGB",
    "Ambient": "RGB",  # Ia·ka·Od
    "Transmission": "RGB",  # everything that is seen through a surface
    "Environment": "RGB",  # only the background itself
    # Where light is gathered from everywhere: the share of the sky above a surface that nothing hides
    "Ambient Occlusion": "RGB",
    # Counts of the light meshes method (DEBUG), summed over all surfaces that a sample of the pixel shades:
    "Debug Candidates": "X",  # after step 2
    "Debug m": "X",  # after step 3; not counted if that step was skipped
    "Debug Empty": "X",  # empty sets
    "Debug Skipped": "X",  # uniform skips
}
LIGHT = ("Diffuse", "Diffuse Indirect", "Glossy", "Emission", "Ambient", "Transmission", "Environment")
DEBUG = tuple(name for name in PASSES if name.startswith("Debug "))
# Passes whose values have no mean take the sample nearest to the pixel's centre. Cycles does so too, but averages UV
# and Normal.
CENTRE = ("Depth", "Position", "Object Index", "Material Index")
DIRECT, REFLECTED, TRANSMITTED = range(3)  # how the camera sees the surface that a ray hits: the ray's "part"


def letters(name: str) -> str:
    """Return the letters of the channels of pass `name`; raises SceneError if there is no such pass."""
    if re.fullmatch(rf"({'|'.join(KINDS)})0[0-7]", name):
        return "rgba"
    if name not in PASSES and shadow_number(name) is None:
        raise SceneError(f"there is no pass {quoted(name)}; there are {', '.join(PASSES)}, and 'Shadow N' of the "
                         "lights whose shadow_pass is N")
    return PASSES.get(name, "RGB")


def shadow_number(name: str) -> int | None:
    """Return 3 for "Shadow 3", the pass with the shadows of some lights; None for other passes."""
    match = re.fullmatch(r"Shadow (0|[1-9][0-9]{0,9})", name)
    return int(match[1]) if match else None


def all_of(scene: Scene) -> tuple[str, ...]:
    """Return every pass that `scene` can have."""
    numbers = sorted({light.shadow_pass for light in scene.lights if light.shadow_pass >= 0})
    return (*PASSES, *(f"Shadow {n}" for n in numbers))


class Tile:
    """The samples of a tile, an array (n, channels) for each pass: Combined, and the other passes that were asked
    for.
    """

    def __init__(self, names: Sequence[str], n: int) -> None:
        self.mattes = Mattes(names)
        self.samples = {name: np.zeros((n, len(letters(name)))) for name in {"Combined": None} | dict.fromkeys(names)
                        if not name.startswith(KINDS)}
        self.samples["Combined"][:, 3] = 1
        if "Depth" in self.samples:
            self.samples["Depth"][:] = NO_DEPTH
        if "Mist" in self.samples:
            self.samples["Mist"][:] = 1
        # whether rays must know how much of them is left
        self.layers = "Mist" in self.samples or bool(self.mattes.wanted)
        # whether rays must know how the camera sees what they hit
        self.parts = any(name in self.samples for name in (*LIGHT, "Ambient Occlusion"))
        self.seen = np.zeros(n, np.bool_)  # which samples have hit their first surface
        self._ranked: dict[str, Ranked] = {}
        self._debug = any(name in self.samples for name in DEBUG)

    def add_light(self, pixel: NDArray[np.int64], part: NDArray[np.int8] | None, weight: NDArray, colour: NDArray,
                  terms: dict[str, NDArray], most: float | NDArray[np.float64] = 0.0) -> None:
        """Add weight·colour to Combined. `terms` is pass → its share of the colour; it is added where the camera sees
        the surface directly. most: what is brighter is dimmed until the sum of its colours is three times this, one
        number or (n,); 0: not.
        """
        if np.any(most):
            total, least = colour.sum(-1), 3 * np.asarray(most)
            over = (least > 0) & (total > least)
            if over.any():
                weight = weight * np.where(over, least / np.where(over, total, 1.0), 1.0).reshape(-1, 1)
        _add(self.samples["Combined"], pixel, weight, colour)
        if part is None:
            return
        for how, shares in ((DIRECT, terms), (REFLECTED, {"Glossy": colour}), (TRANSMITTED, {"Transmission": colour})):
            rows = part == how
            for name, share in shares.items():
                if name in self.samples:
                    own = share[rows] if share.ndim > 1 else share
                    _add(self.samples[name], pixel[rows], weight[rows], own)

    def take_alpha(self, pixel: NDArray, weight: NDArray) -> None:
        """Subtract the mean of weight (n,3) from alpha, where the picture stays transparent."""
        _add(self.samples["Combined"], pixel, -weight.mean(1, keepdims=True), np.ones((len(pixel), 1)), first=3)

    def subtract(self, name: str, pixel: NDArray, values: NDArray) -> None:
        """Subtract values (n,) from a pass of one channel."""
        _add(self.samples[name], pixel, -values[:, None], np.ones((len(pixel), 1)))

    def work(self, n: int) -> NDArray | None:
        """Return an array (n,4) for the counts of the DEBUG passes of n surfaces; None if none of these passes is
        wanted.
        """
        return np.zeros((n, len(DEBUG))) if self._debug else None

    def add_work(self, pixel: NDArray, work: NDArray | None) -> None:
        """Add the counts in the array that `work` returned."""
        if work is not None:
            for i, name in enumerate(DEBUG):
                if name in self.samples:
                    _add(self.samples[name], pixel, work[:, i:i + 1], np.ones((len(pixel), 1)))

    def developed(self, name: str, box: tuple[int, int, int, int], per_pixel: int) -> NDArray:
        """Return the pass, shape (height, width, channels): the mean of each pixel's samples, added in order, or the
        sample next to its centre.
        """
        if name.startswith(KINDS):
            kind = name[:-2]
            if kind not in self._ranked:
                self._ranked[kind] = self.mattes.seen(kind).own(per_pixel)
            found = self._ranked[kind].values(name, len(self.seen) // per_pixel)
            return found.reshape(box[3] - box[1], box[2] - box[0], -1)
        samples = self.samples[name]
        if name in CENTRE:
            means = samples[::per_pixel]
        else:
            means = np.empty((len(samples) // per_pixel, samples.shape[1]))
            _means(samples, means)
        return means.reshape(box[3] - box[1], box[2] - box[0], -1)


def _add(samples: NDArray[np.float64], pixel: NDArray[np.int64], weight: NDArray[np.float64],
         colour: NDArray[np.float64], first: int = 0) -> None:
    """Add weight·colour to samples[pixel], beginning at column `first`. The rays of one pixel are added in their
    order. `colour` has a row for each ray (n,c), or is one (c,) for all.
    """
    colour = np.ascontiguousarray(colour, np.float64)
    _sum(samples, first, pixel, np.ascontiguousarray(weight, np.float64), colour if colour.ndim > 1 else colour[None])
