"""Judge pictures as an artist would see them: HDR-FLIP, RMSE, and the flicker of a camera's flight.

*FLIP* is the error that an observer sees when two pictures of high dynamic range are shown in turn, from 0 to 1: the
largest LDR-FLIP over exposures that the reference asks for (Andersson et al., 2020 and 2021; the package
flip-evaluator, which the extra `bench` installs). *RMSE* is of linear light, at the exposure at which the scene is
shown.

Edges of objects can be left out: there only anti-aliasing counts, which is no question of light. An edge is where, in
the eight pixels around one, another object is met, the surface turns by more than 20°, or it is not the same plane.

*Flicker* is how much a surface that does not move changes from one frame of a flight to the next, in the values of the
screen (0 to 1). Three frames in a row are compared at the same point of the surface: where the middle frame's pixel is
seen in the others follows from its place in the world. What counts is I(t) − ½·(I(t − 1) + I(t + 1)), so a highlight
that wanders evenly does not; it is divided by √1.5, so that noise of the standard deviation σ, independent in each
frame, gives σ. Left out are edges in any of the frames, and points that are hidden or outside of a frame. Between
pixels the others are interpolated, which smooths some noise and so flatters the noisier picture.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ..scene.errors import SceneError

MISSING = "no HDR-FLIP: it needs flip-evaluator, which the extra 'bench' of this project installs"
TURN = 20.0  # degrees between two pixels from which on there is an edge
OFF = 3.0  # how many pixels' widths a neighbour may be off the plane of a pixel
BRIGHTEST = 1e4  # what is brighter is cut, so that one pixel does not decide an RMSE


@dataclass(frozen=True)
class Guides:
    """What the centre of each pixel of a frame sees; the first row is the top one."""

    place: NDArray[np.float32]  # (h,w,3) in the world
    normal: NDArray[np.float32]  # (h,w,3)
    thing: NDArray[np.int64]  # (h,w), 0 where nothing is
    to_pixel: NDArray[np.float64]  # (4,4) from the world to (x, y, ·, w) of a pixel


def available() -> bool:
    """Return whether FLIP can be computed."""
    return importlib.util.find_spec("flip_evaluator") is not None


def read(path: Path) -> NDArray[np.float32]:
    """Return linear RGB of an EXR, (h,w,3), rows from above."""
    _, pixels = _channels(path)
    return np.ascontiguousarray(pixels[..., :3])


def read_guides(path: Path, to_pixel: Any) -> Guides:
    """Return the guides that Cycles wrote as an EXR of several layers."""
    names, pixels = _channels(path)

    def of(name: str, letters: str) -> NDArray[np.float32]:
        found = [i for x in letters for i, n in enumerate(names) if n.endswith(f".{name}.{x}")]
        if len(found) != len(letters):
            raise SceneError(f"{path} has no pass {name}")
        return pixels[..., found]

    thing = np.rint(of("IndexOB" if any(".IndexOB." in n for n in names) else "Object Index", "X")[..., 0])
    return Guides(of("Position", "XYZ"), of("Normal", "XYZ"), thing.astype(np.int64), np.asarray(to_pixel, np.float64))


def _channels(path: Path) -> tuple[list[str], NDArray[np.float32]]:
    """Return the names and values of all channels; some Blenders write a part of the file for each pass."""
    file = oiio.ImageInput.open(str(path))
    if file is None:
        raise SceneError(f"{path} cannot be read: {oiio.geterror()}")
    names: list[str] = []
    parts: list[NDArray[np.float32]] = []
    while file.seek_subimage(len(parts), 0):
        pixels = file.read_image(len(parts), 0, 0, file.spec().nchannels, oiio.FLOAT)
        if pixels is None:
            raise SceneError(f"{path} cannot be read: {file.geterror()}")
        names += file.spec().channelnames
        parts.append(np.asarray(pixels, np.float32).reshape(*pixels.shape[:2], -1))
    file.close()
    return names, np.concatenate(parts, -1)


def edges(at: Guides) -> NDArray[np.bool_]:
    """Return the pixels, (h,w), in whose neighbourhood is the edge of an object."""
    height, width = at.thing.shape
    found = np.zeros((height, width), np.bool_)
    wide = _pixel_width(at)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, height - dy), slice(max(0, -dx), width - max(0, dx)))
        b = (slice(dy, height), slice(max(0, dx), width - max(0, -dx)))
        apart = at.place[b] - at.place[a]
        off = np.maximum(np.abs((apart * at.normal[a]).sum(-1)), np.abs((apart * at.normal[b]).sum(-1)))
        turned = (at.normal[a] * at.normal[b]).sum(-1) < np.cos(np.radians(TURN))
        something = (at.thing[a] > 0) | (at.thing[b] > 0)
        edge = something & ((at.thing[a] != at.thing[b]) | turned | (off > OFF * np.maximum(wide[a], wide[b])))
        found[a] |= edge
        found[b] |= edge
    return found


def _pixel_width(at: Guides) -> NDArray[np.float64]:
    """Return how wide a pixel is in the world at the place that it shows."""
    x, w = at.to_pixel[0, :3], at.to_pixel[3, :3]
    depth = at.place.astype(np.float64) @ w + at.to_pixel[3, 3]
    # Along the picture's x axis one unit of the world is this many pixels at the depth of 1.
    scale = float(np.linalg.norm(np.cross(x, w))) / max(float(np.linalg.norm(w)), 1e-12)
    return np.abs(depth) / max(scale, 1e-12)


def flip(reference: NDArray[np.float32], found: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return HDR-FLIP of each pixel, (h,w), 0 to 1."""
    import flip_evaluator

    a, b = _clean(reference), _clean(found)
    parameters: dict[str, Any] = {}
    light = a @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    if np.median(light) <= 1e-4 * light.max():  # a night: the darkest exposure follows from what is lit, not from black
        lit = light[light > 1e-4 * light.max()]
        if not len(lit):
            return np.abs(b).max(-1).clip(0, 1)
        stop = -np.log2(float(np.median(lit)))
        parameters = {"startExposure": min(-np.log2(float(light.max())), stop - 1), "stopExposure": stop}
    shown, _, _ = flip_evaluator.evaluate(a, b, "HDR", applyMagma=False, computeMeanError=False, parameters=parameters)
    return np.asarray(shown, np.float32).reshape(a.shape[:2])


def compare(reference: NDArray[np.float32], found: NDArray[np.float32], edge: NDArray[np.bool_],
            exposure: float = 0.0) -> tuple[dict[str, float], NDArray[np.float32]]:
    """Return the errors, and the error of each pixel: FLIP, or without flip-evaluator the difference.

    `flip` and `rmse` are away from edges, where the reference is put in the place of the edges so that they do not
    shine into their surroundings; `flip_whole` and `rmse_whole` are of all pixels.
    """
    scale = np.float32(2.0**exposure)
    difference = np.abs(scale * _clean(found) - scale * _clean(reference)).astype(np.float64)
    inside = ~edge if (~edge).any() else np.ones_like(edge)
    result = {"rmse": float(np.sqrt((difference[inside]**2).mean())),
              "rmse_whole": float(np.sqrt((difference**2).mean())), "edges": float(edge.mean())}
    shown = difference.mean(-1).astype(np.float32)
    if available():
        within = np.where(inside[..., None], found, reference)
        shown = flip(reference, found)
        result |= {"flip": float(flip(reference, within)[inside].mean()), "flip_whole": float(shown.mean())}
    return result, shown


def flicker(frames: list[NDArray[np.float32]], guides: list[Guides], exposure: float = 0.0) -> dict[str, float]:
    """Return the flicker of a flight of at least three frames: `flicker`, which is the mean, its 99th percentile, and
    the share of the pixels that were compared.
    """
    changes, compared, pixels = [], 0, 0
    shown = [screen(frame, exposure) for frame in frames]
    rough = [edges(at) for at in guides]
    for t in range(1, len(frames) - 1):
        at, good = guides[t], (guides[t].thing > 0) & ~rough[t]
        others = []
        for other in (t - 1, t + 1):
            values, seen = _seen_from(at, guides[other], rough[other], shown[other])
            others.append(values)
            good &= seen
        change = (shown[t] - 0.5 * (others[0] + others[1]))[good] / np.sqrt(1.5)
        changes.append(np.sqrt((change**2).mean(-1)))
        compared, pixels = compared + int(good.sum()), pixels + good.size
    found = np.concatenate(changes) if changes else np.zeros(0)
    if not len(found):
        return {"compared": 0.0}
    return {"flicker": float(np.sqrt((found**2).mean())), "flicker_p99": float(np.quantile(found, 0.99)),
            "compared": compared / pixels}


def screen(linear: NDArray[np.float32], exposure: float = 0.0) -> NDArray[np.float64]:
    """Return what a plain screen shows (sRGB's curve), 0 to 1."""
    x = np.clip(np.nan_to_num(linear.astype(np.float64), posinf=1.0) * 2.0**exposure, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def _seen_from(at: Guides, other: Guides, rough: NDArray[np.bool_], values: NDArray[np.float64]
               ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the values of another frame at the places of this one, and where these are seen there.

    They are interpolated bilinearly. All four pixels must be of the same thing, without an edge, and the place must be
    on their surface.
    """
    height, width = at.thing.shape
    x, y, _, w = np.moveaxis(at.place.astype(np.float64) @ other.to_pixel[:, :3].T + other.to_pixel[:, 3], -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = x / w - 0.5, y / w - 0.5  # from the pixels' corners to their centres
    good = (w > 0) & (x >= 0) & (y >= 0) & (x < width - 1) & (y < height - 1)
    left, top = (np.where(good, v, 0).astype(np.int64) for v in (x, y))
    u, v = (np.where(good, a, 0) - b for a, b in ((x, left), (y, top)))
    wide, found, place = _pixel_width(other), np.zeros_like(values), np.zeros_like(values)
    for dy, dx, weight in ((0, 0, (1 - u) * (1 - v)), (0, 1, u * (1 - v)), (1, 0, (1 - u) * v), (1, 1, u * v)):
        there = (top + dy, left + dx)
        good &= (other.thing[there] == at.thing) & ~rough[there]
        found += weight[..., None] * values[there]
        place += weight[..., None] * other.place[there]
    good &= np.linalg.norm(place - at.place, axis=-1) < OFF * wide[top, left]
    return found, good


def _clean(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return pixels that are numbers, not below 0, and not beyond what counts."""
    return np.ascontiguousarray(np.clip(np.nan_to_num(pixels, nan=0.0, posinf=BRIGHTEST), 0, BRIGHTEST), np.float32)
