"""Calls kernels in ways that they must refuse. A program for tests/engine/test_border.py, as a process may crash:

    python tests/support/border_calls.py arguments|conditions KERNEL …

arguments: one wrong argument after the other. conditions: each condition that the kernels declare is broken, in ways
that change one length, one number or one value of an array. It prints how many calls were refused, and ends with an
error if one was not.
"""

import re
import sys

import numpy as np
from light_meshes.support import declarations, native

LENGTH = 3  # of an axis that has a letter, if no condition says more
FUNCTIONS = {"words": lambda n: -(-n // 64), "power": lambda n: n & (n - 1) == 0, "inf": np.inf}
OTHER = {"f8": "f4", "f4": "f8", "i8": "i4", "i4": "u4", "u8": "i8", "u4": "i4", "u2": "u1", "u1": "i1", "i1": "u1",
         "b1": "u1"}


def right(kernel, fixed=None):
    """Return arguments for which all conditions hold: lengths and numbers changed until they do, zeros. fixed:
    some that must have a value; then some condition may not hold. None if a length would be less than 0.
    """
    of = declarations.declared(kernel.takes)
    values = dict.fromkeys(of.lengths, LENGTH) | {a.name: 1 for a in of.arguments if not a.lengths}
    values |= fixed or {}
    arrays = {a.name for a in of.arguments if a.lengths}
    plain = [c for c in of.conditions if not arrays & set(declarations.names(c))]
    for _ in range(50):
        broken = [c for c in plain if not any(holds(one, values) for one in c.split("|"))]
        if not broken:
            break
        for condition in broken:
            either = condition.split("|")
            mend(either[0 if re.search(r"\d{4}", either[-1]) else -1], values)  # rather no table than a long one
        values |= fixed or {}
    if any(not 0 <= values[letter] < 10_000 for letter in of.lengths):
        return None
    return [made(a, of, values) if a.lengths else values[a.name] for a in of.arguments]


def made(argument, of, values):
    """Return an array of zeros, of ones where a condition asks for more than 0, or a tree of leaves."""
    array = np.zeros([int(n) if n.isdigit() else values[n] for n in argument.lengths], native._TYPES[argument.kind])
    for condition in of.conditions:
        if condition.startswith(f"tree({argument.name},"):
            array[:, 1] = 1
        elif condition == f"1<={argument.name}":
            array[:] = 1
    return array


def value(text, values):
    """Return what lengths and numbers are together."""
    return eval(text.replace("/", "//"), {}, FUNCTIONS | values)


def holds(condition, values):
    """Return whether a condition without arrays holds."""
    return value(re.sub("(?<!<)=", "==", condition), values)


def mend(condition, values):
    """Change a length or a number so that a condition without arrays holds."""
    parts = re.split("(<=|<|=)", condition)
    if len(parts) == 1:  # power(m)
        (name,) = declarations.names(condition)
        values[name] = 1 << values[name].bit_length()
    for a, op, b in zip(parts[:-2:2], parts[1:-1:2], parts[2::2], strict=True):
        if holds(a + op + b, values):
            continue
        if op == "=" and a in values:
            values[a] = value(b, values)
        elif b in values:
            values[b] = value(a, values) + (op == "<")
        elif a in values:
            values[a] = value(b, values) - (op == "<")
        else:  # 2*n<=m+1
            (name,) = re.findall(r"^[a-zA-Z]", b)
            while not holds(a + op + b, values) and values[name] < 100:
                values[name] += 1


def wrong(array, shape, written, optional, shared):
    """Yield what must be refused in place of an array. shared: the axes whose length another axis has, too."""
    yield [array]
    yield 7
    yield "text"
    yield array.tobytes()
    yield memoryview(array)
    yield array.astype(OTHER[array.dtype.str[1:]])
    yield array.astype(object)
    if array.dtype.itemsize > 1 and array.size:
        yield np.zeros(array.shape, array.dtype.newbyteorder())
        yield np.zeros(array.nbytes + 1, np.uint8)[1:].view(array.dtype).reshape(array.shape)  # not aligned
    yield array[None]
    yield from array[:1]
    yield np.zeros((), array.dtype)
    if not optional:
        yield None
    for axis, (free, _) in enumerate(shape):
        if not free or axis in shared:
            for length in {0, array.shape[axis] - 1, array.shape[axis] + 1} - {-1, array.shape[axis]}:
                yield np.zeros([length if k == axis else m for k, m in enumerate(array.shape)], array.dtype)
        if array.shape[axis] > 1:
            twice = np.zeros([m * (2 if k == axis else 1) for k, m in enumerate(array.shape)], array.dtype)
            step = tuple(slice(None, None, 2 if k == axis else 1) for k in range(array.ndim))
            yield twice[step]
            yield np.flip(array, axis)
    for other in np.asfortranarray(array), np.broadcast_to(array[:1], array.shape):
        if not other.flags.c_contiguous:
            yield other
    if written:
        fixed = array.copy()
        fixed.flags.writeable = False
        yield fixed


def give_wrong_arguments(name):
    """Return how many calls were refused."""
    calls = 0
    kernel = native.kernel(name)
    letters = [n for *_, shape, _, _, _ in kernel._arguments if shape for free, n in shape if free]
    arguments = right(kernel)
    for way in kernel, kernel.checked:
        for some in [*(arguments[:k] for k in range(len(arguments))), [*arguments, None]]:  # too few, too many
            try:
                way(*some)
            except TypeError:
                calls += 1
            else:
                raise SystemExit(f"{name} takes {len(some)} arguments")
    for k, (argument, _, shape, _, written, optional) in enumerate(kernel._arguments):
        if shape is None:
            bad = [None, "text", arguments, object(), np.zeros(2)]
        else:
            shared = {axis for axis, (free, n) in enumerate(shape) if free and letters.count(n) > 1}
            bad = wrong(arguments[k], shape, written, optional, shared)
            bad = [b for b in bad if b is not None or not optional]
        for value in bad:
            given = [*arguments[:k], value, *arguments[k + 1:]]
            for way in kernel, kernel.checked, lambda *all, k=k: kernel.of(*all[:k + 1])(*all[k + 1:]):
                try:
                    way(*given)
                except (TypeError, ValueError, OverflowError):
                    calls += 1
                else:
                    raise SystemExit(f"{name}: {argument} = {value!r} is taken")
    return calls


def with_length(kernel, arguments, letter, length):
    """Return the arguments with another length, which all arrays have that share it."""
    at = kernel._lengths.index(letter)
    return [np.zeros([length if axis == (True, at) else size for axis, size in zip(shape, a.shape, strict=True)], dtype)
            if shape and (True, at) in shape else a
            for a, (_, _, shape, dtype, *_) in zip(arguments, kernel._arguments, strict=True)]


def changed(kernel, arguments):
    """Yield arguments of which one length, number or value is another."""
    for at, letter in enumerate(kernel._lengths):
        size = next(a.shape[shape.index((True, at))] for a, (_, _, shape, *_) in
                    zip(arguments, kernel._arguments, strict=True) if shape and (True, at) in shape)
        for length in {0, size - 1, size + 1, 2 * size + 1} - {-1, size}:
            yield with_length(kernel, arguments, letter, length)
    for k, (_, kind, shape, dtype, *_) in enumerate(kernel._arguments):
        if shape is None:
            wrong = [n for n in (-1, 0, 2, 5, 17, 33, 65, 300, 70000, 2**62, -(2**62)) if n >= 0 or kind != "u64"]
            for number in [*wrong, *(np.nan, np.inf, -np.inf) * (kind == "f64")]:
                yield [*arguments[:k], number, *arguments[k + 1:]]
        elif arguments[k].size:
            real = dtype.kind == "f"
            low, high = (-np.inf, np.inf) if real else (0, 1) if dtype.kind == "b" else (
                np.iinfo(dtype).min, np.iinfo(dtype).max)
            wrong = [n for n in (low, -1, -2, -7, 1, 2, 3, 4, 5, 9, 300, high) if low <= n <= high]
            for number in [*wrong, *[np.nan] * real]:
                for place in 0, -1:
                    array = arguments[k].copy()
                    array.reshape(-1)[place] = number
                    yield [*arguments[:k], array, *arguments[k + 1:]]


def broken_by(kernel, arguments):
    """Return the condition that a call would break; None: none."""
    known = [-1] * len(kernel._lengths)
    try:
        kernel._test(arguments, kernel._passed(arguments, known), known, (1 << len(kernel._conditions)) - 1)
    except ValueError as error:
        return str(error).split(": ", 1)[1].split(" does not hold")[0]
    return None


def break_conditions(name):
    """Return how many calls were refused."""
    kernel = native.kernel(name)
    left, calls = set(kernel._conditions), 0
    whole = [argument for argument, kind, *_ in kernel._arguments if kind == "i64" and _[0] is None]
    if broken_by(kernel, right(kernel)):
        raise SystemExit(f"{name}: {broken_by(kernel, right(kernel))} does not hold for what is right")
    fixed = [None, *({letter: n} for letter in kernel._lengths for n in (3, 9, 65)),
             *({number: n} for number in whole for n in (0, 2))]
    bases = [base for base in (right(kernel, one) for one in fixed) if base]
    for wrong in (*bases, *(wrong for base in bases if not broken_by(kernel, base) for wrong in changed(kernel, base))):
        if not left and calls > 50:
            break
        condition = broken_by(kernel, wrong)
        if condition not in left and (condition is None or calls > 50):
            continue
        left.discard(condition)
        half = len(wrong) // 2
        for way in (kernel, kernel.checked, lambda *all: native.together((kernel, *all)),
                    lambda *all: kernel.of(*all[:half])(*all[half:]), lambda *all: kernel.of(*all)()):  # noqa: B023
            try:
                way(*wrong)
            except ValueError as error:
                if "does not hold" not in str(error):
                    raise
                calls += 1
            else:
                raise SystemExit(f"{name}: {condition} does not hold, and that is taken")
    if left:
        raise SystemExit(f"{name}: nothing breaks {left}")
    return calls


if __name__ == "__main__":
    task = {"arguments": give_wrong_arguments, "conditions": break_conditions}[sys.argv[1]]
    print(sum(task(name) for name in sys.argv[2:]), "refused")
