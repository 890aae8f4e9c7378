"""Programs: lists of operations that compute, as Blender's nodes do, values of a material for each point of a surface,
or values of a lamp for each point that it lights.

An operation is [name, argument …]. Its outputs are registers, numbered through the whole program from 0; an argument is
a number, the register [n] of an earlier operation, or, of a `table`, a list of numbers. Every register is one number a
point: a colour takes three. `values` says which parameters of the material the program sets, by number or register. The
list comes from a file, which is not trusted: `program` checks it, once.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ..support.text import quoted
from .errors import SceneError

MOST = 20_000  # operations of a program
TABLES = 1 << 20  # numbers in all its tables

Argument = float | tuple[int] | tuple[float, ...]  # a number, a register, or a table
# Operations: (number of arguments, number of outputs).
OPERATIONS: dict[str, tuple[int, int]] = {
    "backfacing": (0, 1), "uv": (0, 2), "image": (3, 4), "where": (3, 1), "table": (4, 1),
    "noise": (13, 4), "white_noise": (5, 4), "bend": (5, 1), "magic": (5, 3), "brick": (11, 2),
    "voronoi": (15, 8), "attribute": (1, 1), "instance": (1, 1), "ray": (1, 1), "to_world_normal": (3, 3),
    "to_world": (4, 3), "to_object": (4, 3), "to_object_normal": (3, 3), "from_camera": (4, 3), "in_camera": (4, 3),
    "corner_normal": (0, 3), "to_camera": (3, 3), "window": (0, 2), "sky": (13, 3),
    "covered": (15, 3), "bump": (9, 3), "box": (1, 3), "parametric": (0, 2), "ray_length": (0, 1), "ies": (3, 1),
    **dict.fromkeys(("position", "normal", "true_normal", "incoming", "object", "object_normal", "generated",
                     "object_location"), (0, 3)),
    **dict.fromkeys(("log", "exponent", "sqrt", "absolute", "floor", "truncate", "sine", "cosine", "tangent",
                     "arcsine", "arccosine", "arctangent", "sinh", "cosh", "tanh", "single"), (1, 1)),
    **dict.fromkeys(("add", "subtract", "multiply", "divide", "power", "minimum", "maximum", "greater", "less",
                     "modulo", "arctan2"), (2, 1)),
}
OF_LAMPS = {"ray_length"}  # only a lamp's program may have these
NOT_OF_LAMPS = {"attribute", "instance", "corner_normal", "bump", "covered"}  # a lamp's may not have these
# These may have two more arguments, for bumps: they are taken one step beside the point, along the first (1) or the
# second (2) direction on the surface, or (0) at it; and how many pixels' widths a step is.
SHIFTED = {"uv", "position", "object", "generated", "attribute", "window", "parametric"}
# What only a point of a surface has: a world's program must not ask for it.
NOT_OF_WORLDS = {"uv", "attribute", "instance", "object", "object_normal", "generated", "object_location", "bump",
                 "box", "to_world_normal", "to_world", "to_object", "to_object_normal", "corner_normal", "parametric",
                 "ray_length", "covered"}
# Parameters of a Material that a program may set: (channels, smallest, largest value).
PARAMETERS: dict[str, tuple[int, float, float]] = {
    "Od": (3, 0.0, 1e30), "ka": (1, 0.0, 1e30), "kd": (1, 0.0, 1e30), "ks": (1, 0.0, 1e30), "Os": (3, 0.0, 1e30),
    "nShiny": (1, 0.0, 1e9), "mirror": (3, 0.0, 1e30), "emission": (3, 0.0, 1e30), "kt": (3, 0.0, 1e30),
    "ior": (1, 0.01, 100.0), "frosted": (1, 0.0, 1.0), "diffuse_roughness": (1, 0.0, 1.0),
    "translucent": (3, 0.0, 1e30), "alpha": (1, 0.0, 1.0), "normal": (3, -1e30, 1e30), "displaced": (3, -1e30, 1e30),
    "roughness": (1, 0.0, 1.0),
    "metal": (1, 0.0, 1e30), "F0": (3, 0.0, 1.0), "F90": (3, 0.0, 1.0), "F82": (3, 0.0, 1.0),
    "dielectric": (1, 0.0, 1e30), "dielectric_ior": (1, 1e-5, 1000.0), "dielectric_tint": (3, 0.0, 1e30),
    "layered": (1, 0.0, 1.0), "compensation": (1, 0.0, 1.0), "coat": (1, 0.0, 1.0), "coat_roughness": (1, 0.0, 1.0),
    "coat_ior": (1, 1.0, 1000.0), "coat_tint": (3, 0.0, 1.0), "coat_normal": (3, -1e30, 1e30),
    "sheen_normal": (3, -1e30, 1e30), "sheen": (1, 0.0, 1e30),
    "sheen_roughness": (1, 0.0, 1.0), "sheen_tint": (3, 0.0, 1.0), "share": (1, 0.0, 1e30)}
NORMALS = {"normal", "displaced", "coat_normal", "sheen_normal"}  # those of them that bend normals
LETS_THROUGH = {"alpha", "kt"}  # and those that say how much light gets through
# What a lamp's program sets: by how much its intensity is multiplied.
OF_LIGHT = ("emission",)


@dataclass(frozen=True)
class Operation:
    """One step of a program."""

    name: str
    arguments: tuple[Any, ...]  # floats, registers as (n,), or the table's tuple


@dataclass(frozen=True)
class Program:
    """A checked program. Empty: the material, or the lamp's light, is the same everywhere."""

    operations: tuple[Operation, ...] = ()
    # parameter, or of a layer its number from 1 on, a dot and the parameter → a number or register a channel
    values: dict[str, tuple[Any, ...]] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.values)

    def __hash__(self) -> int:
        return hash((self.operations, tuple(self.values.items())))

    def needed(self, names: Collection[str]) -> tuple[list[bool], set[int]]:
        """Return the operations and the registers that the parameters of these names need."""
        starts = [0]
        for operation in self.operations:
            starts.append(starts[-1] + OPERATIONS[operation.name][1])
        asked = {ref[0] for name in set(names) & set(self.values) for ref in self.values[name]
                 if isinstance(ref, tuple)}
        needs = [False] * len(self.operations)
        for i in range(len(self.operations) - 1, -1, -1):
            needs[i] = any(register in asked for register in range(starts[i], starts[i + 1]))
            if needs[i]:
                asked.update(a[0] for a in self.operations[i].arguments if isinstance(a, tuple) and len(a) == 1)
        return needs, asked

    @cached_property
    def all_needed(self) -> tuple[list[bool], set[int]]:
        """What all its parameters need, as `needed` says it."""
        return self.needed(self.values)

    def images(self) -> set[int]:
        """Return the images that the program looks up."""
        return {int(o.arguments[0]) for o in self.operations if o.name == "image"}

    def profiles(self) -> set[int]:
        """Return the profiles that the program looks up."""
        return {int(o.arguments[0]) for o in self.operations if o.name == "ies"}

    def asks(self) -> set[str]:
        """Return the names of its operations."""
        return {o.name for o in self.operations}

    def sees(self, *names: str) -> bool:
        """Return whether the program has an operation with one of these names."""
        return any(o.name in names for o in self.operations)

    @cached_property
    def without_normals(self) -> frozenset[str]:
        """Return the names of its parameters but for normals: what a surface is to light that is gathered."""
        return frozenset(name for name in self.values if layer_of(name)[1] not in NORMALS)

    def sees_camera(self, names: Collection[str] | None = None) -> bool:
        """Return whether the parameters of these names depend on where the camera is; None: whether any does. Values
        beside a point do: they are as far from it as pixels are from each other.
        """
        needed, _ = self.all_needed if names is None else self.needed(names)
        return any(needs and (o.name in ("to_camera", "from_camera", "in_camera", "window") or (
            o.name in SHIFTED and len(o.arguments) > OPERATIONS[o.name][0]))
            for o, needs in zip(self.operations, needed, strict=True))


NO_PROGRAM = Program()


def plain(program: Program) -> dict[str, Any]:
    """Return the program as a snapshot's JSON has it."""
    def argument(a: Any) -> Any:
        return list(a) if isinstance(a, tuple) else a
    return {"operations": [[o.name, *map(argument, o.arguments)] for o in program.operations],
            "values": {name: [argument(a) for a in refs] for name, refs in program.values.items()}}


def of_lamp(data: Any, where: str) -> Program:
    """Return the checked program of a lamp, from a JSON object. Raises SceneError; `where` names the lamp in its
    sentence.
    """
    made = program(data, where, OF_LIGHT, NOT_OF_LAMPS)
    if any(o.name in SHIFTED and len(o.arguments) > OPERATIONS[o.name][0] for o in made.operations):
        raise SceneError(f"{where}: its program takes a value beside a point, which lamps have not")
    return made


def program(data: Any, where: str, names: Collection[str] = PARAMETERS, without: Collection[str] = OF_LAMPS) -> Program:
    """Return the checked program of a JSON object. Raises SceneError; `where` names the material in its sentence.
    names: the parameters that the program may set. without: the operations that it may not have.
    """
    if not isinstance(data, dict) or set(data) - {"operations", "values"} or not isinstance(
            data.get("operations"), list) or not isinstance(data.get("values"), dict):
        raise SceneError(f"{where}: program must be an object of operations and values")
    if len(data["operations"]) > MOST:
        raise SceneError(f"{where}: its program has {len(data['operations']):,} operations; {MOST:,} are taken")
    operations: list[Operation] = []
    count = tables = 0
    for n, item in enumerate(data["operations"]):
        at = f"{where}: operation {n} of its program"
        if not isinstance(item, list) or not item or not isinstance(item[0], str) or item[0] not in OPERATIONS:
            raise SceneError(f"{at} is {quoted(item)}; the engine does not know it")
        name, given = item[0], item[1:]
        if name in without:
            raise SceneError(f"{at} is {quoted(name)}, which means nothing there")
        wanted, outputs = OPERATIONS[name]
        if len(given) not in (wanted, wanted + 2 * (name in SHIFTED)):
            raise SceneError(f"{at} ({name}) has {len(given)} arguments; it takes {wanted}")
        arguments = []
        for k, argument in enumerate(given):
            if name == "table" and k == 1:
                tables += len(argument) if isinstance(argument, list) else 0
                arguments.append(_table(argument, at, tables))
            else:
                arguments.append(_reference(argument, count, at))
        _check_choices(name, arguments, at)
        operations.append(Operation(name, tuple(arguments)))
        count += outputs
    values = {}
    for name, refs in data["values"].items():
        layer, bare = layer_of(name)
        if bare not in names or (layer and names is not PARAMETERS):
            raise SceneError(f"{where}: its program sets {quoted(name)}, which is no parameter")
        wide = PARAMETERS[bare][0]
        channels = refs if wide == 3 else [refs]
        if refs and isinstance(refs, list) and wide == 1 and isinstance(refs[0], list | float):
            channels = refs
        if not isinstance(channels, list) or len(channels) != wide:
            raise SceneError(f"{where}: its program must set {name} by {wide} values")
        values[name] = tuple(_reference(r, count, f"{where}: its program's {name}") for r in channels)
    return Program(tuple(operations), values)


def layer_of(name: str) -> tuple[int, str]:
    """Return the layer and the parameter that a name in a program's values means; layer 0 is the material itself."""
    layer, dot, bare = name.partition(".")
    return (int(layer), bare) if dot and layer in _LAYERS else (0, name)


LAYERS = 7  # a material has at most, beside itself
_LAYERS = {str(n) for n in range(1, LAYERS + 1)}


# Arguments that are choices, not registers: operation → (place, smallest, largest); None: any number.
CHOICES: dict[str, tuple[tuple[int, float, float], ...]] = {
    "image": ((0, 0, 1e9),), "ies": ((0, 0, 1e9),), "table": ((2, 0, 1), (3, 0, 1)),
    "noise": ((0, 1, 4), (1, 0, 4), (2, 0, 1)), "white_noise": ((0, 1, 4),), "magic": ((4, 0, 10),),
    "attribute": ((0, 0, 1e6),), "instance": ((0, 0, 1e6),), "ray": ((0, 0, 4),),
    "voronoi": ((0, 1, 4), (1, 0, 4), (2, 0, 3), (3, 0, 1), (4, 0, 1)), "brick": ((1, 0, 99), (3, 0, 99))}


# The bounds of what a sky depends on, in the order of `surface.atmosphere.Weather`.
_SKY = ((0, 2), (-1.6, 1.6), (-1e6, 1e6), (0, 1e5), (0, 100), (0, 100), (0, 100), (0, 3.2), (0, 1e9), (0, 1e3))


def _check_choices(name: str, arguments: list[Any], where: str) -> None:
    """Raise SceneError unless arguments that choose something are whole numbers in their bounds."""
    for place, low, high in CHOICES.get(name, ()):
        value = arguments[place]
        if not (isinstance(value, float) and value.is_integer() and low <= value <= high):
            raise SceneError(f"{where} ({name}): its argument {place} must be a whole number from {low:g} to {high:g}")
    shift = arguments[OPERATIONS[name][0]:]
    if shift and not (shift[0] in (0.0, 1.0, 2.0) and isinstance(shift[1], float) and 0 < shift[1] <= 1e6):
        raise SceneError(f"{where} ({name}): a shift must be 0, 1 or 2, and its width a positive number")
    if name == "bump" and not (isinstance(arguments[8], float) and 0 < arguments[8] <= 1e6):
        raise SceneError(f"{where} (bump): its width must be a positive number")
    if name == "sky":
        for value, low, high in zip(arguments, *zip(*_SKY, strict=True), strict=False):
            if not (isinstance(value, float) and low <= value <= high):
                raise SceneError(f"{where} (sky): {value!r} must be a number from {low:g} to {high:g}")
    if name == "brick" and not (isinstance(arguments[0], float) and isinstance(arguments[2], float)):
        raise SceneError(f"{where} (brick): offset and squash must be numbers")


def _reference(argument: Any, count: int, where: str) -> Any:
    """Return a number, or a register below `count` as a tuple."""
    if isinstance(argument, list) and len(argument) == 1 and type(argument[0]) is int and 0 <= argument[0] < count:
        return (argument[0],)
    if isinstance(argument, int | float) and not isinstance(argument, bool) and abs(argument) <= 1e300:
        return float(argument)
    raise SceneError(f"{where} has {quoted(argument)} where a finite number or an earlier register must stand")


def check_world(world: Program, where: str) -> None:
    """Raise SceneError unless `world` is what a scene's world may be: a radiance that needs no surface."""
    if other := set(world.values) - {"emission"}:
        raise SceneError(f"{where}: its program sets {quoted(min(other))}; a world has an emission only")
    for operation in world.operations:
        if operation.name in NOT_OF_WORLDS or len(operation.arguments) > OPERATIONS[operation.name][0]:
            raise SceneError(f"{where}: its program has {quoted(operation.name)} of surfaces; a world has none")


def _table(argument: Any, where: str, total: int) -> tuple[float, ...]:
    if not isinstance(argument, list) or len(argument) < 2 or total > TABLES or not all(
            isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) for x in argument):
        raise SceneError(f"{where} must have a table of two or more finite numbers, and of {TABLES:,} in all at most")
    return tuple(map(float, argument))
