"""Matrices (4,4) that place things: they act on column vectors, and `a @ b` does b first, then a. Angles: radians."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .errors import SceneError
from .mesh import numbers

Matrix = NDArray[np.float64]


def translate(x: float, y: float, z: float) -> Matrix:
    """Return the matrix that moves by (x, y, z)."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def scale(x: float, y: float, z: float) -> Matrix:
    """Return the matrix that stretches along the axes; a negative factor mirrors."""
    return np.diag([x, y, z, 1.0])


def rotate_x(angle: float) -> Matrix:
    """Return the matrix that turns around the x axis, from y to z."""
    return _rotate(angle, 1, 2)


def rotate_y(angle: float) -> Matrix:
    """Return the matrix that turns around the y axis, from z to x."""
    return _rotate(angle, 2, 0)


def rotate_z(angle: float) -> Matrix:
    """Return the matrix that turns around the z axis, from x to y."""
    return _rotate(angle, 0, 1)


def _rotate(angle: float, a: int, b: int) -> Matrix:
    """Return the turn from axis a to axis b."""
    matrix = np.eye(4)
    matrix[[a, b], [a, b]] = np.cos(angle)
    matrix[a, b], matrix[b, a] = -np.sin(angle), np.sin(angle)
    return matrix


def look_at(eye: Sequence[float], target: Sequence[float], up: Sequence[float] = (0.0, 0.0, 1.0)) -> Matrix:
    """Return the matrix, local to world, of a camera at `eye` that looks at `target`: −z goes there, y as far up as it
    can.

    Where the view goes along `up`, which then says nothing, y is up; or z where that is no help either. Raises
    SceneError where eye and target are one point, or up is 0.
    """
    origin, goal, above = (numbers(v, f"look_at: {name}", (3,)) for name, v in (
        ("eye", eye), ("target", target), ("up", up)))
    distance = np.linalg.norm(origin - goal)
    if not (0 < distance < np.inf and np.linalg.norm(above) > 0):
        raise SceneError("look_at: eye and target must be two points, and up a direction")
    back = (origin - goal) / distance
    if abs(back @ above) > 0.9999 * np.linalg.norm(above):
        above = np.array([0.0, 1.0, 0.0] if abs(back[1]) < 0.9 else [0.0, 0.0, 1.0])
    right = np.cross(above, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, np.cross(back, right), back, origin], 1)
    return matrix
