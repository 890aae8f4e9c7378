"""Programs of materials, run for a batch of surface points at once.

One register is an array over all points (or a number, where it is the same at all), one operation one call of numpy or
of a kernel: nothing is interpreted point by point. What Blender's nodes do where a result would be no number, as a
division by 0, is done here, too: see `_OPERATIONS`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scene.programs import OPERATIONS, PARAMETERS, Program, layer_of
from .atmosphere import sky
from .points import Points
from .procedural import TEXTURES
from .shading import covered, sent_out
from .textures import MISSING, Texture

Register = Any  # (n,) float64, or a number


def run(program: Program, points: Points, textures: Sequence[Texture | None],
        wanted: Collection[str] | None = None) -> dict[str, NDArray[np.float64]]:
    """Return the parameters that `program` sets: (n,), or (n,3) for colours, held within the bounds of a Material.

    wanted: the parameters that are needed; None: all, also those of layers. What they do not need is not computed. An
    argument may be an array with one number for each instance, so that programs which differ only in numbers are run as
    one (`lamps`).
    """
    needed, asked = program.all_needed if wanted is None else program.needed(wanted)
    wanted = program.values if wanted is None else wanted
    registers: list[Register] = []
    moved: dict[tuple, Points] = {}

    def beside(*shift: float) -> Points:
        if shift and shift not in moved:
            moved[shift] = points.shifted(int(shift[0]), shift[1])
        return moved[shift] if shift else points

    def value(argument: Any) -> Register:
        if isinstance(argument, tuple):
            return registers[argument[0]]
        return argument[points.instance] if isinstance(argument, np.ndarray) else argument

    with np.errstate(all="ignore"):
        for operation, needs in zip(program.operations, needed, strict=True):
            name, arguments = operation.name, operation.arguments
            if not needs:
                registers.extend([0.0] * OPERATIONS[name][1])
            elif name in _INPUTS:
                registers.extend(_INPUTS[name](beside(*arguments)))
            elif name == "attribute":
                registers.append(_channel(points.around.attributes, int(arguments[0]), beside(*arguments[1:])))
            elif name in _OF_POINTS:
                registers.extend(_OF_POINTS[name](points, *map(value, arguments)))
            elif name == "image":
                alpha = len(registers) + 3 in asked
                registers.extend(_images(textures, points, alpha, *map(value, arguments)))
            elif name == "sky":
                registers.extend(sky(len(points.P), *map(value, arguments)))
            elif name in TEXTURES:
                how = {"colour": bool({len(registers) + i for i in (2, 3)} & asked)} if name == "noise" else {}
                registers.extend(TEXTURES[name](len(points.P), *map(value, arguments), **how))
            elif name == "table":
                registers.append(_table(value(arguments[0]), np.array(arguments[1]), *map(bool, arguments[2:])))
            else:
                registers.append(_OPERATIONS[name](*map(value, arguments)))
    n, found = len(points.P), {}
    for name, refs in program.values.items():
        if name not in wanted:
            continue
        channels, low, high = PARAMETERS[layer_of(name)[1]]
        out = np.empty((n, channels))
        for k, ref in enumerate(refs):
            out[:, k] = value(ref)
        np.clip(out, low, high, out=out)
        lost = np.isnan(out)
        if lost.any():
            out[lost] = low
        found[name] = out if channels == 3 else out[:, 0]
    return found


def _columns(a: NDArray) -> tuple[NDArray, ...]:
    return tuple(np.ascontiguousarray(a[:, k]) for k in range(a.shape[1]))


def _moved(matrix: NDArray[np.float64], points: Points) -> tuple[NDArray, ...]:
    """Return P in another space of each instance: matrix (I,3,4)."""
    of = matrix[points.instance]
    return _columns(np.einsum("nij,nj->ni", of[:, :, :3], points.P) + of[:, :, 3])


def _object_normal(points: Points) -> tuple[NDArray, ...]:
    return _to_object_normal(points, *points.Ns.T)


def _to_object_normal(points: Points, x: Register, y: Register, z: Register) -> tuple[NDArray, ...]:
    """Return a normal of the world in the object's own space, with length 1; 0 where it has no direction."""
    # Normals go by the transpose of the way back.
    turned = np.einsum("nji,nj->ni", points.around.from_object[points.instance],
                       _stacked(points, x, y, z))
    return _columns(turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-300))


def _to_object(points: Points, x: Register, y: Register, z: Register, point: float) -> tuple[NDArray, ...]:
    """Return a vector of the world, or a point (1), in the object's own space."""
    m = points.around.to_object[points.instance]
    return _columns(np.einsum("nij,nj->ni", m[:, :, :3], _stacked(points, x, y, z)) + point * m[:, :, 3])


def _to_world(points: Points, x: Register, y: Register, z: Register, point: float) -> tuple[NDArray, ...]:
    """Return a vector of the object's own space, or a point (1), in the world."""
    back = points.around.from_object[points.instance]
    moved = _stacked(points, x, y, z) - point * points.around.to_object[points.instance, :, 3]
    return _columns(np.einsum("nij,nj->ni", back, moved))


def _from_camera(points: Points, x: Register, y: Register, z: Register, point: float) -> tuple[NDArray, ...]:
    """Return a vector of the camera's space, as `_camera_vector` has it, or a point (1), in the world."""
    m = points.around.to_camera
    moved = _stacked(points, x, y, z) * (1.0, 1.0, -1.0) - point * m[:, 3]
    return _columns(moved @ np.linalg.inv(m[:, :3]).T)


def _camera_vector(points: Points, x: Register, y: Register, z: Register, point: float) -> tuple[NDArray, ...]:
    """Return a vector of the world, or a point (1), in the camera's space: x to the right, y up, z away from it."""
    m = points.around.to_camera
    return _columns((_stacked(points, x, y, z) @ m[:, :3].T + point * m[:, 3]) * (1.0, 1.0, -1.0))


def _stacked(points: Points, x: Register, y: Register, z: Register) -> NDArray[np.float64]:
    out = np.empty((len(points.P), 3))
    out[:, 0], out[:, 1], out[:, 2] = x, y, z
    return out


def _world_normal(points: Points, x: Register, y: Register, z: Register) -> Sequence[Register]:
    """Return a normal of the object's own space in the world, with length 1; 0 where it has no direction."""
    normal = np.einsum("nji,nj->ni", points.around.to_object[:, :, :3][points.instance], _stacked(points, x, y, z))
    return _columns(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300))


def _location(points: Points) -> tuple[NDArray, ...]:
    """Return where the object's origin is in the world."""
    back = points.around.from_object
    return _columns(-np.einsum("nij,nj->ni", back, points.around.to_object[:, :, 3])[points.instance])


def _channel(values: NDArray, channel: int, points: Points) -> Register:
    """Return a channel of attributes (T,3,A); 0 where no mesh has it."""
    if channel >= values.shape[2]:
        return 0.0
    return points.at_corners(values[:, :, channel:channel + 1])[:, 0]


def _instance_value(points: Points, channel: float) -> Sequence[Register]:
    values = points.around.instance_values
    return (values[points.instance, int(channel)].astype(np.float64) if channel < values.shape[1] else 0.0,)


def _in_camera(points: Points, x: Register, y: Register, z: Register) -> Sequence[Register]:
    """Return a place of the world as the camera has it: x to the right, y up, z away from it."""
    m = points.around.to_camera
    across, up, back = (m[i, 0] * x + m[i, 1] * y + m[i, 2] * z + m[i, 3] for i in range(3))
    return across, up, -back


def _window(points: Points) -> Sequence[Register]:
    """Return where in the picture the camera sees the points: 0 to 1 from left to right and from bottom to top."""
    camera = points.around.camera
    left, right, bottom, top = camera.window
    x, y, z = _in_camera(points, *(points.P + points.around.eye).T)
    if camera.perspective:
        x, y = x / z, y / z
    return (x - left) / (right - left), (y - bottom) / (top - bottom)


def _bump(points: Points, here: Register, first: Register, second: Register, x: Register, y: Register, z: Register,
          strength: Register, distance: Register, width: float) -> Sequence[Register]:
    """Return the normal (x, y, z) of a surface that is raised by heights: at the points, and one of `Points.steps`
    further.

    Blinn, "Simulation of wrinkled surfaces" (1978), as Cycles has it: the normal less the heights' gradient.
    """
    n = _stacked(points, x, y, z)
    dx, dy = points.steps(width)
    rx, ry = np.cross(dy, n), np.cross(n, dx)
    area = np.einsum("ni,ni->n", dx, rx)
    rises = [np.broadcast_to(np.subtract(a, here), len(n))[:, None] for a in (first, second)]
    turn = np.broadcast_to(np.multiply(np.sign(area), distance), len(n))[:, None]
    bent = unit(np.abs(area)[:, None] * n - turn * (rises[0] * rx + rises[1] * ry), n)
    share = np.broadcast_to(np.maximum(strength, 0.0), len(n))[:, None]
    return _columns(unit(share * bent + (1 - share) * n, n))


def unit(a: NDArray[np.float64], otherwise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (n,3) with length 1; `otherwise` for those without a direction."""
    length = np.linalg.norm(a, axis=1, keepdims=True)
    usable = (length > 0) & np.isfinite(length)
    return np.where(usable, a / np.where(usable, length, 1.0), otherwise)


def _box(points: Points, blend: Register) -> Sequence[Register]:
    """Return how much of each of three images shows that are projected along x, y and z in the object's space, as
    Blender mixes them: blend is how soft the edges of the box are.
    """
    n = np.abs(np.stack(_object_normal(points), axis=1))
    n /= n.sum(1, keepdims=True)
    limit = np.broadcast_to(0.5 * (1.0 + np.asarray(blend)), len(n))
    softness = np.where(np.equal(blend, 0), 1.0, blend)
    weight = np.maximum(((2 - limit) * n.T + (limit - 1)) / np.maximum(2 * limit - 1, 1e-9), 0).T  # of all three
    for k in (1, 0, 2):  # of the two beside axis k
        i, j = (k + 1) % 3, (k + 2) % 3
        first = np.clip((n[:, i] / (n[:, i] + n[:, j]) - 0.5 * (1 - softness)) / softness, 0, 1)
        two = n[:, k] < (1 - limit) * (n[:, i] + n[:, j])
        weight[two, i], weight[two, j], weight[two, k] = first[two], 1 - first[two], 0
    weight[np.broadcast_to(np.equal(blend, 0), len(n))] = (1, 0, 0)
    for k in (2, 1, 0):
        alone = (n[:, k] > limit * (n[:, k] + n[:, (k + 1) % 3])) & (n[:, k] > limit * (n[:, k] + n[:, (k + 2) % 3]))
        weight[alone] = np.eye(3)[k]
    return _columns(weight)


def _ies(points: Any, number: Register, x: Register, y: Register) -> Sequence[Register]:
    """Return the light of profiles at horizontal and vertical angles x and y."""
    out, numbers = np.empty(len(points.P)), np.broadcast_to(number, len(points.P))
    x, y = np.broadcast_to(x, len(out)), np.broadcast_to(y, len(out))
    for n in np.unique(numbers):
        rows = np.flatnonzero(numbers == n)
        out[rows] = points.around.profiles[int(n)](x[rows], y[rows])
    return (out,)


def _covered(points: Points, *values: Register) -> Sequence[Register]:
    """Return what of light from below gets through a coat (7 values) and fibres (5), whose normal is the last three."""
    normals = unit(_stacked(points, *values[12:]), points.Ns)
    coats = sent_out(normals, points.Ns, points.Ng, -points.incoming)
    return _columns(covered(values[:7], values[7:12], normals, points.incoming, coats))


_OF_POINTS: dict[str, Callable[..., Sequence[Register]]] = {
    "instance": _instance_value, "ray": lambda p, kind: ((p.ray == kind).astype(np.float64),),
    "to_world": _to_world, "to_object": _to_object, "to_object_normal": _to_object_normal,
    "from_camera": _from_camera, "in_camera": _camera_vector, "to_world_normal": _world_normal,
    "to_camera": _in_camera,
    "covered": _covered, "bump": _bump, "box": _box, "ies": _ies,
    "corner_normal": lambda p: _columns(p.at_corners(p.around.surfaces.corner_normals)),
}
_INPUTS: dict[str, Callable[[Any], Sequence[Register]]] = {
    "uv": lambda p: _columns(p.uv.astype(np.float64)),
    "position": lambda p: _columns(p.P),
    "normal": lambda p: _columns(p.Ns),
    "true_normal": lambda p: _columns(p.Ng),
    "incoming": lambda p: _columns(p.incoming),
    "object": lambda p: _moved(p.around.to_object, p),
    "generated": lambda p: _moved(p.around.to_generated, p),
    "object_normal": _object_normal,
    "object_location": _location,
    "parametric": lambda p: _columns(p.parametric),
    "window": _window,
    "ray_length": lambda p: (p.length,),
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
    # what is no number does not count there
    "minimum": np.fmin, "maximum": np.fmax, "modulo": _modulo, "arctan2": np.arctan2,
    "greater": lambda a, b: np.greater(a, b).astype(np.float64), "less": lambda a, b: np.less(a, b).astype(np.float64),
    "where": lambda condition, a, b: np.where(np.not_equal(condition, 0), a, b),
    "single": lambda a: np.asarray(a, np.float32).astype(np.float64),
    "log": lambda a: np.where(np.greater(a, 0), np.log(np.where(np.greater(a, 0), a, 1.0)), 0.0),
    "exponent": np.exp, "sqrt": lambda a: np.sqrt(np.maximum(a, 0.0)), "absolute": np.abs, "floor": np.floor,
    "truncate": np.trunc, "sine": np.sin, "cosine": np.cos, "tangent": np.tan, "arcsine": np.arcsin,
    "arccosine": np.arccos, "arctangent": np.arctan, "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh,
}


def _table(x: Register, table: NDArray[np.float64], interpolates: bool, extrapolates: bool) -> Register:
    """Return the table at place x, which counts its entries from 0; without interpolation the entry before x."""
    x = np.nan_to_num(np.asarray(x, np.float64))
    if not extrapolates:
        x = np.clip(x, 0, len(table) - 1)
    if not interpolates:
        return table[np.clip(x, 0, len(table) - 1).astype(np.int64)]
    i = np.clip(np.floor(x), 0, len(table) - 2).astype(np.int64)
    return table[i] + (table[i + 1] - table[i]) * (x - i)


def _images(textures: Sequence[Texture | None], points: Points, alpha: bool, number: Register, x: Register,
            y: Register) -> Sequence[Register]:
    """Return colour of images at (x, y), and alpha if it is wanted. number: one image for all points, or one for each.
    """
    if np.ndim(number) == 0:
        return _image(textures[int(number)], x, y, len(points.P), alpha)
    out = np.empty((len(points.P), 4))
    x, y = np.broadcast_to(x, len(out)), np.broadcast_to(y, len(out))
    for n in np.unique(number):
        rows = np.flatnonzero(number == n)
        for k, channel in enumerate(_image(textures[int(n)], x[rows], y[rows], len(rows), alpha)):
            out[rows, k] = channel
    return _columns(out)


def _image(texture: Texture | None, x: Register, y: Register, n: int, alpha: bool) -> Sequence[Register]:
    """Return colour and alpha of an image at (x, y); an image that cannot be read is magenta."""
    if texture is None:
        return *MISSING, 1.0
    place = np.empty((n, 2), np.float32)
    place[:, 0], place[:, 1] = x, y
    colour = np.empty((n, 3))
    texture.lookup(place, np.arange(n), colour)
    return (*_columns(colour), texture.alpha(place) if alpha else 1.0)
