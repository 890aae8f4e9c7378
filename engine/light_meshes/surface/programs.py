"""Programs of materials, run for a batch of surface points at once.

One register is an array over all points (or a number, where it is the same at all), one operation one call of numpy or
of a kernel: nothing is interpreted point by point. What Blender's nodes do where a result would be no number, as a
division by 0, is done here, too: see `_OPERATIONS`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.programs import OPERATIONS, PARAMETERS, Program
from .procedural import TEXTURES
from .textures import Texture

Register = Any  # (n,) float64, or a number


class Points(NamedTuple):
    """What a program may ask of the surface points (n,) it is run for."""

    P: NDArray[np.float64]  # (n,3) world
    Ns: NDArray[np.float64]  # (n,3) unit, to the side that the ray came from
    Ng: NDArray[np.float64]  # (n,3)
    incoming: NDArray[np.float64]  # (n,3) unit, to where the ray came from
    front: NDArray[np.bool_]  # (n,)
    uv: NDArray[np.float32]  # (n,2)
    instance: NDArray[np.int32]  # (n,)
    to_object: NDArray[np.float64]  # (I,3,4) world to the instance's own space
    to_generated: NDArray[np.float64]  # (I,3,4) world to the texture space of its mesh

    def at(self, rows: NDArray) -> Points:
        """These points only."""
        return Points._make([*(a[rows] for a in self[:7]), self.to_object, self.to_generated])


def run(program: Program, points: Points, textures: Sequence[Texture | None],
        wanted: Collection[str] = PARAMETERS) -> dict[str, NDArray[np.float64]]:
    """The parameters that `program` sets: (n,) or, of colours, (n,3), held to what a Material may have.

    wanted: of which parameters only; what they do not need is not computed.
    """
    needed = program.needed(wanted)
    registers: list[Register] = []

    def value(argument: Any) -> Register:
        return registers[argument[0]] if isinstance(argument, tuple) else argument

    with np.errstate(all="ignore"):
        for operation, needs in zip(program.operations, needed, strict=True):
            name, arguments = operation.name, operation.arguments
            if not needs:
                registers.extend([0.0] * OPERATIONS[name][1])
            elif name in _INPUTS:
                registers.extend(_INPUTS[name](points))
            elif name == "image":
                registers.extend(_image(textures[int(arguments[0])], value(arguments[1]), value(arguments[2]), points))
            elif name in TEXTURES:
                registers.extend(TEXTURES[name](len(points.P), *map(value, arguments)))
            elif name == "table":
                registers.append(_table(value(arguments[0]), np.array(arguments[1]), *map(bool, arguments[2:])))
            else:
                registers.append(_OPERATIONS[name](*map(value, arguments)))
    n, found = len(points.P), {}
    for name, refs in program.values.items():
        if name not in wanted:
            continue
        channels, low, high = PARAMETERS[name]
        out = np.empty((n, channels))
        for k, ref in enumerate(refs):
            out[:, k] = value(ref)
        np.nan_to_num(out, copy=False, nan=low, posinf=high, neginf=low)
        np.clip(out, low, high, out=out)
        found[name] = out if channels == 3 else out[:, 0]
    return found


def _columns(a: NDArray) -> tuple[NDArray, ...]:
    return tuple(np.ascontiguousarray(a[:, k]) for k in range(a.shape[1]))


def _moved(matrix: NDArray[np.float64], points: Points) -> tuple[NDArray, ...]:
    """P in another space of each instance: matrix (I,3,4)."""
    of = matrix[points.instance]
    return _columns(np.einsum("nij,nj->ni", of[:, :, :3], points.P) + of[:, :, 3])


def _object_normal(points: Points) -> tuple[NDArray, ...]:
    # Normals go by the transpose of the way back.
    turned = np.einsum("nji,nj->ni", np.linalg.pinv(points.to_object[:, :, :3])[points.instance], points.Ns)
    return _columns(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def _location(points: Points) -> tuple[NDArray, ...]:
    """Where the object's origin is in the world."""
    back = np.linalg.pinv(points.to_object[:, :, :3])
    return _columns(-np.einsum("nij,nj->ni", back, points.to_object[:, :, 3])[points.instance])


_INPUTS: dict[str, Callable[[Points], Sequence[Register]]] = {
    "uv": lambda p: _columns(p.uv.astype(np.float64)),
    "position": lambda p: _columns(p.P),
    "normal": lambda p: _columns(p.Ns),
    "true_normal": lambda p: _columns(p.Ng),
    "incoming": lambda p: _columns(p.incoming),
    "object": lambda p: _moved(p.to_object, p),
    "generated": lambda p: _moved(p.to_generated, p),
    "object_normal": _object_normal,
    "object_location": _location,
    "backfacing": lambda p: [(~p.front).astype(np.float64)],
}


def _divide(a: Register, b: Register) -> Register:
    return np.where(np.equal(b, 0), 0.0, np.divide(a, np.where(np.equal(b, 0), 1.0, b)))


def _power(a: Register, b: Register) -> Register:
    found = np.power(np.asarray(a, np.float64), b)
    return np.where(np.isfinite(found), found, 0.0)


def _modulo(a: Register, b: Register) -> Register:
    return np.where(np.equal(b, 0), 0.0, np.fmod(a, np.where(np.equal(b, 0), 1.0, b)))


_OPERATIONS: dict[str, Callable[..., Register]] = {
    "add": np.add, "subtract": np.subtract, "multiply": np.multiply, "divide": _divide, "power": _power,
    "minimum": np.minimum, "maximum": np.maximum, "modulo": _modulo, "arctan2": np.arctan2,
    "greater": lambda a, b: np.greater(a, b).astype(np.float64), "less": lambda a, b: np.less(a, b).astype(np.float64),
    "where": lambda condition, a, b: np.where(np.not_equal(condition, 0), a, b),
    "single": lambda a: np.asarray(a, np.float32).astype(np.float64),
    "log": lambda a: np.where(np.greater(a, 0), np.log(np.where(np.greater(a, 0), a, 1.0)), 0.0),
    "exponent": np.exp, "sqrt": lambda a: np.sqrt(np.maximum(a, 0.0)), "absolute": np.abs, "floor": np.floor,
    "truncate": np.trunc, "sine": np.sin, "cosine": np.cos, "tangent": np.tan, "arcsine": np.arcsin,
    "arccosine": np.arccos, "arctangent": np.arctan, "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh,
}


def _table(x: Register, table: NDArray[np.float64], interpolates: bool, extrapolates: bool) -> Register:
    """The table at place x, which counts its entries from 0."""
    x = np.nan_to_num(np.asarray(x, np.float64))
    if not extrapolates:
        x = np.clip(x, 0, len(table) - 1)
    if not interpolates:
        return table[np.rint(np.clip(x, 0, len(table) - 1)).astype(np.int64)]
    i = np.clip(np.floor(x), 0, len(table) - 2).astype(np.int64)
    return table[i] + (table[i + 1] - table[i]) * (x - i)


def _image(texture: Texture | None, x: Register, y: Register, points: Points) -> Sequence[Register]:
    """Colour and alpha of an image at (x, y); one that cannot be read is light grey."""
    n = len(points.P)
    if texture is None:
        return 0.8, 0.8, 0.8, 1.0
    place = np.empty((n, 2), np.float32)
    place[:, 0], place[:, 1] = x, y
    colour = np.empty((n, 3))
    texture.lookup(place, np.arange(n), colour)
    return (*_columns(colour), texture.alpha(place))
