"""Pictures beside each other for the eye: whole ones, and below them crops where the methods differ most."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ..scene.errors import SceneError

GAP = 4  # white pixels between two pictures
CROPS = 3


def sheet(pictures: list[Path], errors: list[NDArray[np.float32] | None], path: Path) -> None:
    """Write a .png: a column for each picture (the first is the reference), and rows of crops from the same places.

    errors: that of each pixel, (h,w), of each picture; the crops are where these are largest, each picture's in turn.
    """
    shown = [_read(p) for p in pictures]
    height, width, _ = shown[0].shape
    edge = max(8, min(width, height) // 4)
    zoom = max(1, width // edge)
    rows = [shown]
    for y, x in places([e for e in errors if e is not None], edge):
        rows.append([np.repeat(np.repeat(p[y:y + edge, x:x + edge], zoom, 0), zoom, 1) for p in shown])
    lines = [_padded(np.concatenate([_padded(p, width, 1)[:, :width + GAP] for p in row], 1), 0, 0) for row in rows]
    whole = np.concatenate(lines, 0)
    spec = oiio.ImageSpec(whole.shape[1], whole.shape[0], 3, oiio.UINT8)
    file = oiio.ImageOutput.create(str(path))
    if file is None or not file.open(str(path), spec) or not file.write_image(np.ascontiguousarray(whole)):
        raise SceneError(f"{path} cannot be written: {oiio.geterror()}")
    file.close()


def places(errors: list[NDArray[np.float32]], edge: int) -> list[tuple[int, int]]:
    """Return (y, x) of up to CROPS squares with the largest sums of errors that do not overlap."""
    left, found = [e.astype(np.float64).copy() for e in errors], []
    for n in range(CROPS if errors else 0):
        error = left[n % len(left)]
        total = np.zeros((error.shape[0] + 1, error.shape[1] + 1))
        total[1:, 1:] = error.cumsum(0).cumsum(1)
        sums = total[edge:, edge:] - total[:-edge, edge:] - total[edge:, :-edge] + total[:-edge, :-edge]
        y, x = (int(k) for k in np.unravel_index(sums.argmax(), sums.shape))
        found.append((y, x))
        for other in left:
            other[max(0, y - edge // 2):y + edge, max(0, x - edge // 2):x + edge] = 0
    return found


def _padded(pixels: NDArray[np.uint8], width: int, gap: int) -> NDArray[np.uint8]:
    """Return pixels with a white border on the right and below, at least `width` wide."""
    more = max(0, width - pixels.shape[1])
    return np.pad(pixels, ((0, GAP), (0, more + gap * GAP), (0, 0)), constant_values=255)


def _read(path: Path) -> NDArray[np.uint8]:
    file = oiio.ImageInput.open(str(path))
    if file is None:
        raise SceneError(f"{path} cannot be read: {oiio.geterror()}")
    pixels = np.asarray(file.read_image(0, 0, 0, 3, oiio.UINT8))
    file.close()
    return pixels
