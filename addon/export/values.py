"""Values of shader sockets: numbers where they are constant, and else expressions, which become a program.

A `Value` is a float, or an `Expression` that the engine computes for each point of a surface. Arithmetic with floats
gives floats, so a surface without textures is translated as before, and its program is empty. `compiled` writes what
is left as the list of operations that the engine's Material.program holds; equal parts are written once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar

Value = Any  # float | Expression: told apart at run time
Triple = tuple[Value, Value, Value]  # a colour or a vector


class Expression:
    """One output of an operation on values. Equal expressions are one object, see `operation`."""

    __slots__ = ("arguments", "name", "output")
    _known: ClassVar[dict[tuple, Expression]] = {}

    def __init__(self, name: str, arguments: tuple, output: int) -> None:
        self.name, self.arguments, self.output = name, arguments, output

    def __add__(self, other: Value) -> Value:
        return self if other == 0 else operation("add", self, other)

    def __radd__(self, other: Value) -> Value:
        return self + other

    def __sub__(self, other: Value) -> Value:
        return self if other == 0 else 0.0 if other is self else operation("subtract", self, other)

    def __rsub__(self, other: Value) -> Value:
        return operation("subtract", other, self)

    def __mul__(self, other: Value) -> Value:
        return 0.0 if other == 0 else self if other == 1 else operation("multiply", self, other)

    def __rmul__(self, other: Value) -> Value:
        return self * other

    def __truediv__(self, other: Value) -> Value:
        return self if other == 1 else operation("divide", self, other)

    def __rtruediv__(self, other: Value) -> Value:
        return operation("divide", other, self)

    def __neg__(self) -> Value:
        return self * -1.0

    def __bool__(self) -> bool:
        raise TypeError("an expression has no truth value: use `where`")

    def __float__(self) -> float:
        raise TypeError("an expression is no number")

    __lt__ = __le__ = __gt__ = __ge__ = lambda self, other: bool(self)  # raises: use `where`


def operation(name: str, *arguments: Any, output: int = 0) -> Expression:
    """Return output `output` of the engine's operation `name`, on values and, if it takes them, texts and lists."""
    key = (name, arguments, output)
    try:
        found = Expression._known.get(key)
    except TypeError:  # a list
        key = (name, tuple(tuple(a) if isinstance(a, list) else a for a in arguments), output)
        found = Expression._known.get(key)
    if found is None:
        found = Expression._known[key] = Expression(name, arguments, output)
    return found


def outputs(name: str, count: int, *arguments: Any) -> tuple[Value, ...]:
    """Return all outputs of an operation."""
    return tuple(operation(name, *arguments, output=i) for i in range(count))


def forget() -> None:
    """Forget all expressions: after a material's translation nobody asks for them again."""
    Expression._known.clear()


def is_constant(*values: Value) -> bool:
    """Return whether all values are numbers."""
    for value in values:  # noqa: SIM110  (a loop: this is asked some hundred times of each material)
        if isinstance(value, Expression):
            return False
    return True


def divide(a: Value, b: Value) -> Value:
    """Return a/b; 0 where b is 0, as in Blender."""
    if is_constant(a, b):
        return a / b if b != 0 else 0.0
    return operation("divide", a, b)


def power(a: Value, b: Value) -> Value:
    """Return a to the power of b; 0 where that is no number, as in Blender's Math node."""
    if is_constant(a, b):
        try:
            found = a**b
        except (ZeroDivisionError, OverflowError):
            return 0.0
        return found if isinstance(found, float | int) else 0.0
    return a if b == 1 else operation("power", a, b)


def square_root(a: Value) -> Value:
    """Return the root of a; 0 of negative numbers."""
    return math.sqrt(max(a, 0.0)) if is_constant(a) else operation("sqrt", a)


def minimum(a: Value, b: Value) -> Value:
    """Return the smaller of two values."""
    if isinstance(a, Expression) or isinstance(b, Expression):  # not `is_constant`: this is asked very often
        return a if a is b else operation("minimum", a, b)
    return min(a, b)


def maximum(a: Value, b: Value) -> Value:
    """Return the larger of two values."""
    if isinstance(a, Expression) or isinstance(b, Expression):
        return a if a is b else operation("maximum", a, b)
    return max(a, b)


def largest(values: Iterable[Value]) -> Value:
    """Return the largest of several values."""
    first, *others = values
    for value in others:
        first = maximum(first, value)
    return first


def clamp(a: Value, low: float = 0.0, high: float = 1.0) -> Value:
    """Return the value held between two others."""
    if isinstance(a, Expression) and a.name == "image" and (low, high) == (0.0, 1.0) and a.output == 3:
        return a  # an image's alpha is there already
    return minimum(maximum(a, low), high)


def greater(a: Value, b: Value) -> Value:
    """Return 1 where a > b, and 0 elsewhere."""
    return float(a > b) if is_constant(a, b) else operation("greater", a, b)


def less(a: Value, b: Value) -> Value:
    """Return 1 where a < b, and 0 elsewhere."""
    return float(a < b) if is_constant(a, b) else operation("less", a, b)


def where(condition: Value, a: Value, b: Value) -> Value:
    """Return `a` where the condition is not 0, and `b` elsewhere."""
    if is_constant(condition):
        return a if condition else b
    return a if a is b or (is_constant(a, b) and a == b) else operation("where", condition, a, b)


def unary(name: str, fold: Callable[[float], float], a: Value) -> Value:
    """Return operation `name` of one value; `fold` computes it for numbers."""
    if not is_constant(a):
        return operation(name, a)
    try:
        return float(fold(a))
    except (ValueError, OverflowError, ZeroDivisionError):
        return 0.0


def truncated(a: Value) -> Value:
    """Return the value without what follows the decimal point."""
    return unary("truncate", math.trunc, a)


def mixed(a: Value, b: Value, factor: Value) -> Value:
    """Return a + (b − a)·factor."""
    if is_constant(factor):
        if factor == 0:
            return a
        if factor == 1:
            return b
    return a * (1.0 - factor) + b * factor


def dot(a: Sequence[Value], b: Sequence[Value]) -> Value:
    """Return the sum of products."""
    total: Value = 0.0
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total


def length(a: Sequence[Value]) -> Value:
    """Return the length of a vector."""
    return square_root(dot(a, a))


def cross(a: Triple, b: Triple) -> Triple:
    """Return the cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def normalized(a: Triple) -> Triple:
    """Return the vector with length 1; 0 stays 0."""
    long = length(a)
    return (divide(a[0], long), divide(a[1], long), divide(a[2], long))


def plain_image(values: Sequence[Value], first: int) -> int:
    """Return the number of the image whose outputs, from `first` on, are these values, placed by the UV map; −1: there
    is none.
    """
    one = values[0]
    if not isinstance(one, Expression) or one.name != "image":
        return -1
    number, x, y = one.arguments
    plain = x is operation("uv", output=0) and y is operation("uv", output=1)
    same = all(value is operation("image", *one.arguments, output=first + i) for i, value in enumerate(values))
    return int(number) if plain and same else -1


# What is evaluated beside a point for bumps, and how many arguments it has without a shift.
SHIFTED = {"uv": 0, "position": 0, "object": 0, "generated": 0, "attribute": 1, "window": 0, "parametric": 0}


def shifted(value: Value, step: int, width: float) -> Value:
    """Return the value one step beside each point, for bumps: see the engine's `Points.shifted`."""
    if not isinstance(value, Expression):
        return value
    made: dict[Expression, Expression] = {}
    for e in _ordered([value]):
        arguments = tuple(made[a] if isinstance(a, Expression) else a for a in e.arguments)
        if SHIFTED.get(e.name) == len(arguments):
            arguments += (float(step), width)
        made[e] = operation(e.name, *arguments, output=e.output)
    return made[value]


def unshifted(value: Value) -> Value:
    """Return the value at points themselves, also where bumps are taken beside them."""
    return shifted(value, 0, 1.0)


# What operations about surfaces give for a direction of the world, where there is none: other outputs, or 0.
_OUTSIDE = {"generated": "position", "object": "position", "object_normal": "normal", "corner_normal": "normal"}
_NOWHERE = {"uv", "attribute", "instance", "object_location"}


def outside(results: Sequence[Value]) -> tuple[Value, ...]:
    """Return the values by direction, as they are for the world: without what only surfaces have, as Cycles gives it.
    """
    made: dict[Expression, Value] = {}
    for e in _ordered(results):
        arguments = [made[a] if isinstance(a, Expression) else a for a in e.arguments]
        if e.name in _NOWHERE:
            made[e] = 0.0
        elif e.name == "parametric":
            made[e] = 1.0 - e.output
        elif e.name in _OUTSIDE:
            made[e] = operation(_OUTSIDE[e.name], output=e.output)
        elif e.name == "bump":
            made[e] = arguments[3 + e.output]
        elif e.name in ("to_world", "to_object", "to_object_normal"):
            made[e] = arguments[e.output]
        elif e.name == "to_world_normal":
            made[e] = normalized((arguments[0], arguments[1], arguments[2]))[e.output]
        elif e.name == "box":  # as for soft edges
            made[e] = power(operation("normal", output=e.output), 2.0)
        else:
            made[e] = operation(e.name, *arguments, output=e.output)
    return tuple(made[a] if isinstance(a, Expression) else a for a in results)


def compiled(results: dict[str, Any]) -> tuple[list[list], dict[str, Any]]:
    """Return (operations, results with expressions replaced by [register]) for the engine's Material.program.

    An operation is [name, argument …]: a number is a constant, a list of one whole number a register. The registers are
    the outputs of all operations, counted in order; `engine` knows how many each has, here they are OUTPUTS.
    """
    program: list[list] = []
    registers: dict[tuple[str, tuple], int] = {}
    count = 0

    def register(value: Any) -> Any:
        if not isinstance(value, Expression):
            return value
        return [registers[value.name, value.arguments] + value.output]

    for expression in _ordered(v for result in results.values() for v in _flat(result)):
        key = expression.name, expression.arguments
        if key not in registers:
            registers[key] = count
            count += OUTPUTS.get(expression.name, 1)
            program.append([expression.name, *map(register, expression.arguments)])
    return program, {name: [register(v) for v in result] if isinstance(result, list | tuple) else register(result)
                     for name, result in results.items()}


# Operations with more than one output.
OUTPUTS = {"image": 4, "uv": 2, "generated": 3, "object": 3, "object_normal": 3, "object_location": 3, "position": 3,
           "normal": 3, "true_normal": 3, "incoming": 3, "noise": 4, "white_noise": 4, "magic": 3, "brick": 2,
           "voronoi": 8, "corner_normal": 3, "to_camera": 3, "to_world_normal": 3, "window": 2, "bump": 3, "covered": 3,
           "sky": 3, "to_world": 3, "to_object": 3, "to_object_normal": 3, "from_camera": 3, "in_camera": 3,
           "box": 3, "parametric": 2}


def _flat(result: Any) -> Iterable[Any]:
    return result if isinstance(result, list | tuple) else (result,)


def _ordered(results: Iterable[Any]) -> Iterable[Expression]:
    """Yield all expressions that the results need, each after those that it needs itself. There is no recursion,
    because trees may be deep.
    """
    done: set[Expression] = set()
    for result in results:
        stack = [result] if isinstance(result, Expression) else []
        while stack:
            value = stack[-1]
            if value not in done:
                waits = [a for a in value.arguments if isinstance(a, Expression) and a not in done]
                if waits:
                    stack.extend(waits)
                    continue
                done.add(value)
                yield value
            stack.pop()
