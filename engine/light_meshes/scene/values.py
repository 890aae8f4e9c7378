"""Values from files and commands, which are not trusted: each is checked against a sample of its type, and its bounds.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from ..support.text import quoted
from .description import Scalar
from .errors import SceneError


class Declared(Protocol):
    """The declaration of a value: its default, and which values are allowed."""

    default: Scalar
    low: float
    high: float
    choices: tuple[str, ...]


def checked_mapping(where: str, given: Mapping[str, Any], declared: Mapping[str, Any]) -> dict[str, Scalar]:
    """Return a value for every name that is `declared` (name → `Declared`): the given one, or the default. Raises
    SceneError.
    """
    for name in given:
        if name not in declared:
            raise SceneError(f"{where}: there is no property {quoted(name)}"
                             + (f"; there are {', '.join(declared)}" if declared else ""))
    values: dict[str, Scalar] = {}
    for name, of in declared.items():
        value = typed(where, name, of.default, given.get(name, of.default))
        values[name] = bounded(where, name, value, of.choices, of.low, of.high)
    return values


def bounded(where: str, name: str, value: Any, choices: tuple[str, ...], low: float, high: float) -> Any:
    """Return `value` if it is one of the choices (if there are any) and its numbers are within the bounds. Raises
    SceneError.
    """
    if choices and value not in choices:
        raise SceneError(f"{where}: {name} is {quoted(value)}; choose one of {', '.join(choices)}")
    for number in np.ravel(value).tolist() if isinstance(value, tuple) else (value,):
        if isinstance(number, int | float) and not low <= number <= high:
            raise SceneError(f"{where}: {name} is {number:g}; it must lie between {low:g} and {high:g}")
    return value


def typed(where: str, name: str, sample: Any, value: Any) -> Any:
    """Return `value` in the type of `sample`. Raises SceneError if it cannot be converted."""
    if isinstance(sample, tuple):
        if not isinstance(value, list | tuple) or len(value) != len(sample):
            raise SceneError(f"{where}: {name} must be {len(sample)} numbers")
        return tuple(typed(where, name, s, v) for s, v in zip(sample, value, strict=True))
    if isinstance(sample, bool) or isinstance(value, bool):
        if isinstance(value, bool) and isinstance(sample, bool):
            return value
    elif isinstance(sample, str):
        if isinstance(value, str):
            return value
    elif isinstance(sample, int):
        if (isinstance(value, int) or (isinstance(value, float) and value.is_integer())) and abs(value) < 2**63:
            return int(value)
    elif isinstance(value, int | float) and abs(value) <= sys.float_info.max:
        return float(value)
    kind = {bool: "true or false", str: "text", int: "a whole number"}.get(type(sample), "a finite number")
    raise SceneError(f"{where}: {name} is {quoted(value)}; it must be {kind}")
