"""The light of luminaires by angle, as in IES files; the operation "ies" of lamps' programs looks it up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..support.text import quoted
from .errors import SceneError

MOST = 1 << 22  # numbers in a profile


@dataclass(frozen=True)
class Profile:
    """The light by angles, on a grid of rising angles in radians. `values` has one row for each horizontal angle, with
    one value for each vertical angle. The vertical angle is 0 at −z and π at +z of the vector that the program passes.
    """

    name: str
    horizontal: tuple[float, ...]
    vertical: tuple[float, ...]
    values: tuple[float, ...]


def profile(data: Any, where: str) -> Profile:
    """Return the checked profile of a JSON object. Raises SceneError; `where` names the profile in its sentence."""
    if not isinstance(data, dict) or set(data) != {"name", "horizontal", "vertical", "values"} or not isinstance(
            data["name"], str):
        raise SceneError(f"{where} must be an object of name, horizontal, vertical and values")
    where = f"{where} {quoted(data['name'])}"
    numbers = {key: _numbers(data[key], f"{where}: {key}") for key in ("horizontal", "vertical", "values")}
    made = Profile(data["name"], **numbers)
    for angles in (made.horizontal, made.vertical):
        if len(angles) < 2 or (np.diff(angles) < 0).any() or max(map(abs, angles)) > 100:
            raise SceneError(f"{where} must have two or more angles each way, rising, in radians")
    if len(made.values) != len(made.horizontal) * len(made.vertical):
        raise SceneError(f"{where} has {len(made.values):,} values for {len(made.horizontal):,} × "
                         f"{len(made.vertical):,} angles")
    return made


def _numbers(data: Any, where: str) -> tuple[float, ...]:
    if not isinstance(data, list | tuple) or len(data) > MOST or not all(
            isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) and abs(x) <= 1e30
            for x in data):
        raise SceneError(f"{where} must be a list of finite numbers, at most {MOST:,}")
    return tuple(map(float, data))
