"""IES files (LM-63): the light of a luminaire by angles, as Cycles takes it, for the engine's profiles.

A file holds candela on a grid of vertical and horizontal angles, for one of three kinds of goniometers: A, B, C. All
become C's: horizontal angles around the axis from 0 to 360°, vertical ones from 0 (down) to 180° (up).
"""

from __future__ import annotations

import math
import re

import numpy as np

# Candela to the watts that Cycles' lamps have: 4π, over the lumens of a watt of daylight (D65).
WATTS = 4 * math.pi / 177.83
MOST = 1 << 22  # numbers in a file
NEAR = 1e-4  # degrees: angles that are meant to be the same


class Profiles:
    """The profiles of a snapshot, each once."""

    def __init__(self) -> None:
        self.descriptions: list[dict] = []
        self._numbers: dict[str, int] = {}  # of texts; −1: it is none

    def index(self, name: str, text: str) -> int:
        """Return the number of the profile of an IES file's text; −1 where it is no such text."""
        if text not in self._numbers:
            found = parsed(text)
            self._numbers[text] = len(self.descriptions) if found else -1
            if found:
                self.descriptions.append({"name": name} | found)
        return self._numbers[text]


def parsed(text: str) -> dict[str, list[float]] | None:
    """Return the grid of a file's text: angles `horizontal` and `vertical` in radians, and `values`, a row of all
    vertical angles for each horizontal one; None where it is no such file.
    """
    found = _read(text)
    if found is None:
        return None
    kind, up, across, values = found
    up, across, values = {1: _type_c, 2: _type_b, 3: _type_a}[kind](up, across, values)
    if len(up) < 2 or len(across) < 2 or (np.diff(up) < 0).any() or (np.diff(across) < 0).any():
        return None
    return {"horizontal": np.radians(across).tolist(), "vertical": np.radians(up).tolist(),
            "values": values.ravel().tolist()}


def _read(text: str) -> tuple[int, np.ndarray, np.ndarray, np.ndarray] | None:
    """Return the kind of goniometer, vertical angles (v,), horizontal ones (h,), both in degrees, and watts (h,v)."""
    start = re.search(r"\nTILT=([^\n]*)", text.replace("\r\n", "\n").replace("\r", "\n"))
    if not start:
        return None
    words = iter(re.split(r"[\s,]+", start.string[start.end():].strip()))

    def numbers(count: int) -> list[float]:
        if not 0 <= count <= MOST:
            raise ValueError("too many numbers")
        return [float(next(words)) for _ in range(count)]

    try:
        if start[1].strip().startswith("INCLUDE"):
            _, tilts = numbers(2)
            numbers(2 * int(tilts))
        _, _, candela, ups, acrosses, kind, _, _, _, _, ballast, photometric, _ = numbers(13)
        up, across = np.array(numbers(int(ups))), np.array(numbers(int(acrosses)))
        values = np.array(numbers(len(up) * len(across))).reshape(len(across), len(up))
    except (StopIteration, RuntimeError, ValueError, OverflowError):
        return None
    values = values * (candela * ballast * photometric * WATTS)
    if kind not in (1, 2, 3) or not (len(up) and len(across)) or not (
            np.isfinite(values).all() and np.isfinite(up).all() and np.isfinite(across).all()):
        return None
    return int(kind), up, across, values


def _near(a: float, b: float) -> bool:
    return abs(a - b) < NEAR


def _type_c(up: np.ndarray, across: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Convert angles around a vertical axis: add what the file leaves out by symmetry."""
    if _near(across[0], 90):
        across = across - 90
    if len(across) == 1:  # the same all around
        return up, np.array([0.0, 360.0]), np.repeat(values, 2, axis=0)
    for half in (90.0, 180.0):  # one quarter, then one half, is mirrored
        if _near(across[-1], half):
            across = np.concatenate([across, 2 * half - across[-2::-1]])
            values = np.concatenate([values, values[-2::-1]])
    gap = 360 - across[-1]
    if _near(across[0], 0) and not _near(gap, 0) and (
            _near(across[-1] - across[-2], gap) or _near(across[1] - across[0], gap)):
        across, values = np.append(across, 360.0), np.concatenate([values, values[:1]])
    return up, across, values


def _type_b(up: np.ndarray, across: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Convert angles around a horizontal axis: the two angles change their places, because a lamp can be turned."""
    across, up, values = up, across, values.T
    across, values = _both_sides(across, values)
    up, turned = _both_sides(up, values.T)
    return up, across, turned.T


def _both_sides(angles: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values from −90 to 90°, or from 0 to 90° and mirrored, moved to 0 … 180°."""
    if _near(angles[0], 0):
        angles = np.concatenate([-angles[:0:-1], angles])
        values = np.concatenate([values[:0:-1], values])
    return angles + 90, values


def _type_a(up: np.ndarray, across: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Convert angles as for headlights of cars: −90 to 90° across, which is 270 to 90°."""
    first = across[0]
    turned, rows = 180 - across[::-1], values[::-1]
    if _near(first, 0):
        turned, rows = np.concatenate([turned, 180 + across[1:]]), np.concatenate([rows, values[1:]])
    return up + 90, turned, rows
