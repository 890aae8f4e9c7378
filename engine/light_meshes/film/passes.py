"""The one list of passes, and the samples of a tile's passes that the wave of rays writes."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Scene
from ..scene.errors import SceneError
from ..support.native import kernel
from ..support.text import quoted
from .mattes import KINDS, Mattes

_sum, _means = kernel("passes_add"), kernel("passes_means")

NO_DEPTH = 1e10  # as Cycles writes it

# Name → letters of its channels. Validation, framebuffer and channel names in files all read this list; the add-on
# has one that a test compares with it. "Shadow 3" is of the lights whose Light.shadow_pass is 3, see `letters`.
PASSES = {
    "Combined": "RGBA",  # premultiplied
    # Of the first surface that the camera sees through nothing but cut-outs:
    "Depth": "Z",  # along the camera's axis; NO_DEPTH where nothing is hit
    "Position": "XYZ",  # in the world
    "Normal": "XYZ",  # the shading normal, in the world
    "Mist": "Z",  # 0 near … 1 far; cut-outs and transparent surfaces count by how much of them is there
    "UV": "UVA",  # A is 1 where there is a surface
    "Object Index": "X",
    "Material Index": "X",
    "Shadow": "RGB",  # the mean of S over the lights
    # Combined comes apart in these (LIGHT):
    "Diffuse": "RGB",
    "Glossy": "RGB",  # highlights, and all that is seen by reflection
    "Emission": "RGB",
    "Ambient": "RGB",  # Ia·ka·Od
    "Transmission": "RGB",  # all that is seen through a surface
    "Environment": "RGB",  # the background itself
    # Light meshes at work (DEBUG), summed over all surfaces that a sample of the pixel shades:
    "Debug Candidates": "X",  # after step 2
    "Debug m": "X",  # after step 3; not counted where that was skipped
    "Debug Empty": "X",  # empty sets
    "Debug Skipped": "X",  # uniform skips
}
LIGHT = ("Diffuse", "Glossy", "Emission", "Ambient", "Transmission", "Environment")
DEBUG = tuple(name for name in PASSES if name.startswith("Debug "))
# What has no mean is that of the sample nearest to the pixel's centre. Cycles does so, and averages UV and Normal.
_CENTRE = ("Depth", "Position", "Object Index", "Material Index")
DIRECT, REFLECTED, TRANSMITTED = range(3)  # how the camera sees what a ray meets: the ray's "part"


def letters(name: str) -> str:
    """Letters of the channels of pass `name`; raises SceneError where there is none."""
    if re.fullmatch(rf"({'|'.join(KINDS)})0[0-7]", name):
        return "rgba"
    if name not in PASSES and shadow_number(name) is None:
        raise SceneError(f"there is no pass {quoted(name)}; there are {', '.join(PASSES)}, and 'Shadow N' of the "
                         "lights whose shadow_pass is N")
    return PASSES.get(name, "RGB")


def shadow_number(name: str) -> int | None:
    """3 of "Shadow 3", the pass of some lights' shadows; None of other passes."""
    match = re.fullmatch(r"Shadow (0|[1-9][0-9]{0,9})", name)
    return int(match[1]) if match else None


def all_of(scene: Scene) -> tuple[str, ...]:
    """Every pass that `scene` can have."""
    numbers = sorted({light.shadow_pass for light in scene.lights if light.shadow_pass >= 0})
    return (*PASSES, *(f"Shadow {n}" for n in numbers))


class Tile:
    """The samples of a tile, (n, channels) a pass: Combined, and of the others those that are asked for."""

    def __init__(self, names: Sequence[str], n: int) -> None:
        self.mattes = Mattes(names)
        self.samples = {name: np.zeros((n, len(letters(name)))) for name in {"Combined": None} | dict.fromkeys(names)
                        if not name.startswith(KINDS)}
        self.samples["Combined"][:, 3] = 1
        if "Depth" in self.samples:
            self.samples["Depth"][:] = NO_DEPTH
        if "Mist" in self.samples:
            self.samples["Mist"][:] = 1
        self.layers = "Mist" in self.samples or bool(self.mattes.wanted)  # rays know how much of them is left so far
        self.parts = any(name in self.samples for name in LIGHT)  # rays know how the camera sees what they meet
        self.seen = np.zeros(n, np.bool_)  # which samples have met their first surface
        self._debug = any(name in self.samples for name in DEBUG)

    def add_light(self, rays: dict[str, NDArray], weight: NDArray, colour: NDArray, terms: dict[str, NDArray]) -> None:
        """Combined += weight·colour. `terms`: pass → its share of colour, where the camera itself sees the surface."""
        _add(self.samples["Combined"], rays["pixel"], weight, colour)
        if not self.parts:
            return
        for part, shares in ((DIRECT, terms), (REFLECTED, {"Glossy": colour}), (TRANSMITTED, {"Transmission": colour})):
            rows = rays["part"] == part
            for name, share in shares.items():
                if name in self.samples:
                    own = share[rows] if share.ndim > 1 else share
                    _add(self.samples[name], rays["pixel"][rows], weight[rows], own)

    def take_alpha(self, pixel: NDArray, weight: NDArray) -> None:
        """Alpha −= the mean of weight (n,3): here the picture stays open."""
        _add(self.samples["Combined"], pixel, -weight.mean(1, keepdims=True), np.ones((len(pixel), 1)), first=3)

    def subtract(self, name: str, pixel: NDArray, values: NDArray) -> None:
        """Take values (n,) from a pass of one channel."""
        _add(self.samples[name], pixel, -values[:, None], np.ones((len(pixel), 1)))

    def work(self, n: int) -> NDArray | None:
        """Room for the counts of DEBUG of n surfaces, (n,4); None where nobody wants them."""
        return np.zeros((n, len(DEBUG))) if self._debug else None

    def add_work(self, pixel: NDArray, work: NDArray | None) -> None:
        """Add what `work` gave room for."""
        if work is not None:
            for i, name in enumerate(DEBUG):
                if name in self.samples:
                    _add(self.samples[name], pixel, work[:, i:i + 1], np.ones((len(pixel), 1)))

    def developed(self, name: str, box: tuple[int, int, int, int], per_pixel: int) -> NDArray:
        """(height, width, channels): the mean of a pixel's samples, added in order, or the one next to its centre."""
        if name.startswith(KINDS):
            found = self.mattes.developed(name, len(self.seen) // per_pixel, per_pixel)
            return found.reshape(box[3] - box[1], box[2] - box[0], -1)
        samples = self.samples[name]
        if name in _CENTRE:
            means = samples[::per_pixel]
        else:
            means = np.empty((len(samples) // per_pixel, samples.shape[1]))
            _means(samples, means)
        return means.reshape(box[3] - box[1], box[2] - box[0], -1)


def _add(samples: NDArray[np.float64], pixel: NDArray[np.int64], weight: NDArray[np.float64],
         colour: NDArray[np.float64], first: int = 0) -> None:
    """Add weight·colour to samples[pixel], from column `first` on; the rays of one pixel in their order.

    colour: of each ray (n,c), or one (c,) of all.
    """
    colour = np.ascontiguousarray(colour, np.float64)
    _sum(samples, first, pixel, np.ascontiguousarray(weight, np.float64), colour if colour.ndim > 1 else colour[None])
