"""The border between Python and the kernels: whatever a kernel is given that it does not declare is a Python error, and
no crash. All kernels are called with one wrong argument after the other, in a process of its own.
"""

import re
import subprocess
import sys
from pathlib import Path

from light_meshes.support import native

PACKAGE = Path(native.__file__).parents[1]
SOURCES = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.[ch]"))
NAMES = sorted(set(re.findall(r"^KERNEL\((\w+),", SOURCES, re.M)))

WRONG_CALLS = """
import sys
import numpy as np
from light_meshes.support import native

LENGTH = 3  # of all axes that have a letter
OTHER = {"f8": "f4", "f4": "f8", "i8": "i4", "i4": "u4", "u8": "i8", "u4": "i4", "u2": "u1", "u1": "i1", "i1": "u1",
         "b1": "u1"}


def right(kernel):
    return [1 if shape is None else np.zeros([LENGTH if free else n for free, n in shape], dtype)
            for _, _, shape, dtype, *_ in kernel._arguments]


def wrong(array, shape, written, optional, shared):
    '''Yield what must be refused in place of an array. shared: the axes whose length another axis has, too.'''
    yield [array]
    yield 7
    yield "text"
    yield array.tobytes()
    yield memoryview(array)
    yield array.astype(OTHER[array.dtype.str[1:]])
    yield array.astype(object)
    if array.dtype.itemsize > 1:
        yield np.zeros(array.shape, array.dtype.newbyteorder())
        yield np.zeros(array.nbytes + 1, np.uint8)[1:].view(array.dtype).reshape(array.shape)  # not aligned
    yield array[None]
    yield array[0]
    yield np.zeros((), array.dtype)
    if not optional:
        yield None
    for axis, (free, n) in enumerate(shape):
        if not free or axis in shared:
            for length in {0, array.shape[axis] - 1, array.shape[axis] + 1}:
                yield np.zeros([length if k == axis else m for k, m in enumerate(array.shape)], array.dtype)
        if array.shape[axis] > 1:
            twice = np.zeros([m * (2 if k == axis else 1) for k, m in enumerate(array.shape)], array.dtype)
            step = tuple(slice(None, None, 2 if k == axis else 1) for k in range(array.ndim))
            yield twice[step]
            yield np.flip(array, axis)
    if array.ndim > 1 and array.size > 1:
        yield np.asfortranarray(array)
        yield np.broadcast_to(array[:1], array.shape)
    if written:
        fixed = array.copy()
        fixed.flags.writeable = False
        yield fixed


calls = 0
for name in sys.argv[1:]:
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
    for k, (argument, kind, shape, dtype, written, optional) in enumerate(kernel._arguments):
        if shape is None:
            bad = [None, "text", arguments, object(), np.zeros(2)]
        else:
            shared = {axis for axis, (free, n) in enumerate(shape) if free and letters.count(n) > 1}
            bad = wrong(arguments[k], shape, written, optional, shared)
            bad = [b for b in bad if b is not None or not optional]
        for value in bad:
            given = [*arguments[:k], value, *arguments[k + 1:]]
            for way in kernel, kernel.checked, lambda *all: kernel.of(*all[:k + 1])(*all[k + 1:]):
                try:
                    way(*given)
                except (TypeError, ValueError, OverflowError):
                    calls += 1
                else:
                    raise SystemExit(f"{name}: {argument} = {value!r} is taken")
print(calls, "refused")
"""


def test_a_wrong_call_is_an_error_and_no_crash():
    done = subprocess.run([sys.executable, "-c", WRONG_CALLS, *NAMES], capture_output=True, text=True)
    assert done.returncode == 0, f"exit code {done.returncode}: {done.stderr[-2000:]}"
    assert int(re.fullmatch(r"(\d+) refused\n", done.stdout)[1]) > 100 * len(NAMES)
