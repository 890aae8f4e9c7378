"""The native kernels: compiled C that comes with the package and is called with numpy arrays.

`kernel("name")` returns the function of that name. The comment above it in its C source declares its arguments
(`native.h` explains the format). They are checked at every call, so that a wrong call is a TypeError or a ValueError
here and not a crash in C. While a kernel runs, other Python threads can run too.
"""

from __future__ import annotations

import ctypes
import os
import re
import sys
from collections.abc import Sequence
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from .sources import KernelError, digest, library, sources

_PACKAGE = Path(__file__).resolve().parent.parent
_TYPES: dict[str, Any] = {
    "i8": np.int8, "i32": np.int32, "i64": np.int64, "u8": np.uint8, "u16": np.uint16, "u32": np.uint32,
    "u64": np.uint64, "f32": np.float32, "f64": np.float64, "bool": np.bool_,
}
_SCALARS = {"i64": (ctypes.c_int64, int), "u64": (ctypes.c_uint64, int), "f64": (ctypes.c_double, float)}
_ARGUMENT = re.compile(r"(\w+) (\w+)(?:\[([\w,]+)\])?([!?]*)")


def _load() -> ctypes.CDLL:
    """Load the library that suits the processor. LIGHT_MESHES_KERNELS=kernels chooses the one that runs on every
    processor.
    """
    found = _open("kernels")
    level = os.environ.get("LIGHT_MESHES_KERNELS")
    if level is None and found.processor_has_avx2() and (_PACKAGE / library(sys.platform, "kernels-avx2")).is_file():
        level = "kernels-avx2"
    return _open(level) if level else found


def _open(level: str) -> ctypes.CDLL:
    again = "install the package again (in a checkout: pip install -e .)"
    try:
        found = ctypes.CDLL(str(_PACKAGE / library(sys.platform, level)))
    except OSError as e:
        raise KernelError(f"the engine's kernels cannot be loaded: {e}. To have them built, {again}") from e
    if sources(_PACKAGE):  # this is a checkout, where the sources may have been edited since
        built = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(found, "sources_digest"))).decode()
        if built != digest(_PACKAGE):
            raise KernelError(f"the engine's kernels are older than their C sources: {again}")
    return found


_LIBRARY = _load()

_DATA = object.__basicsize__  # where an array's address stands in it (PyArrayObject.data, numpy's C interface)
_NEEDED, _WRITTEN = 0x101, 0x501  # of flags.num: contiguous and aligned; writable, too


@cache
def _code(text: str) -> Any:
    return compile(text, "<kernel>", "exec")


@cache
def _knows_arrays() -> bool:
    """Whether arrays have the memory layout that all releases of numpy so far have."""
    some = np.zeros(3)
    return all(ctypes.c_void_p.from_address(id(a) + _DATA).value == a.ctypes.data for a in (some, some[1:], some[2:]))


class Kernel:
    """A compiled function. `takes` declares its arguments, as in its C source."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._call = getattr(_LIBRARY, name)
        text = ctypes.c_char.in_dll(_LIBRARY, f"{name}_takes")
        self.takes = ctypes.string_at(ctypes.addressof(text)).decode()
        self._lengths: list[str] = []
        self._arguments = [self._argument(*match) for match in _ARGUMENT.findall(self.takes)]
        scalars = [_SCALARS[kind][0] if shape is None else ctypes.c_void_p for _, kind, shape, *_ in self._arguments]
        self._call.argtypes = [ctypes.c_int64] * len(self._lengths) + scalars
        self._call.restype = ctypes.c_int64

    @cached_property
    def fast(self) -> Any:
        """The quickest function that calls the kernel. It is made at the first call: a picture needs few of all
        kernels, and each takes a millisecond to compile.
        """
        return self._compiled() if _knows_arrays() else self.checked

    def of(self, *first: Any) -> Any:
        """Return a function that calls the kernel with these first arguments, which are checked once, here.

        It is for arrays that do not change their place as long as the function is in use, such as those of a scene.
        """
        if not _knows_arrays():
            return partial(self, *first)
        known = [-1] * len(self._lengths)
        passed = self._passed(first, known)
        fast, names = self._compiled(first, passed, known), len(self._arguments) - len(first)

        def call(*rest: Any) -> int:
            return fast(*rest) if len(rest) == names else self.checked(*first, *rest)

        return call

    def _argument(self, name: str, kind: str, shape: str, marks: str) -> tuple:
        """Parse the declaration of one argument into (name, kind, lengths, dtype, written, optional). A length is a
        number or an index.
        """
        if not shape:
            return name, kind, None, None, False, False
        lengths: list[tuple[bool, int]] = []
        for letter in shape.split(","):
            if letter.isdigit():
                lengths.append((False, int(letter)))
            else:
                if letter not in self._lengths:
                    self._lengths.append(letter)
                lengths.append((True, self._lengths.index(letter)))
        return name, kind, tuple(lengths), np.dtype(_TYPES[kind]), "!" in marks, "?" in marks

    def __call__(self, *arguments: Any) -> int:
        """Call the kernel and return its result. Arrays are passed without copies, and the kernel may write into
        them.
        """
        try:
            return self.fast(*arguments)  # type: ignore[no-any-return]
        except TypeError:  # the number of arguments
            return self.checked(*arguments)

    def _compiled(self, first: tuple = (), given: Sequence[Any] = (), known: Sequence[int] = ()) -> Any:
        """Return a function that makes the same checks as `checked`, unrolled for this kernel's arguments, in a third
        of the time. It calls `checked` for all that is not as expected, which raises the error.

        first: arguments that are not to be passed any more; given, known: what `_passed` said of them.
        """
        names = [f"a{n}" for n in range(len(self._arguments))]
        otherwise = f"return checked({', '.join(names)})"
        known = known or [-1] * len(self._lengths)
        lines = [f"x{n} = n{n}" for n in range(len(known))]
        passed, bound = [f"g{n}" for n in range(len(first))], {n for n, length in enumerate(known) if length >= 0}
        space: dict[str, Any] = {f"g{n}": value for n, value in enumerate(given)}
        space |= {f"n{n}": length for n, length in enumerate(known)}
        for n, (_, kind, shape, dtype, written, optional) in list(enumerate(self._arguments))[len(first):]:
            a = names[n]
            if shape is None:
                passed.append(f"{_SCALARS[kind][1].__name__}({a})")
                continue
            passed.append(f"p{n}")
            space[f"t{n}"] = dtype
            needed = _WRITTEN if written else _NEEDED
            lines += [f"if {a} is None: p{n} = None", "else:"] if optional else ["if True:"]
            lines += [f" if type({a}) is not ndarray or {a}.dtype is not t{n} or {a}.ndim != {len(shape)} or "
                      f"{a}.flags.num & {needed} != {needed}: {otherwise}",
                      f" s = {a}.shape", f" p{n} = at(id({a}) + {_DATA}).value"]
            for axis, (free, wanted) in enumerate(shape):
                if free and wanted not in bound:
                    lines.append(f" if x{wanted} < 0: x{wanted} = s[{axis}]")
                lines.append(f" if s[{axis}] != {f'x{wanted}' if free else wanted}: {otherwise}")
            if not optional:
                bound |= {wanted for free, wanted in shape if free}
        lengths = [f"x{n}" if n in bound else f"max(x{n}, 0)" for n in range(len(self._lengths))]
        text = [f"def fast({', '.join(names[len(first):])}):", *(f" {line}" for line in lines),
                f" return call({', '.join(lengths + passed)})"]
        space |= {"checked": self.checked, "call": self._call, "ndarray": np.ndarray,
                  "at": ctypes.c_void_p.from_address, **dict(zip(names, first, strict=False))}
        exec(_code("\n".join(text)), space)
        return space["fast"]

    def checked(self, *arguments: Any) -> int:
        """Do the same as a call, in a loop over the arguments. A wrong call raises TypeError or ValueError."""
        if len(arguments) != len(self._arguments):
            raise TypeError(f"kernel {self.name} takes {len(self._arguments)} arguments, not {len(arguments)}: "
                            f"{self.takes}")
        known: list[int] = [-1] * len(self._lengths)
        passed = self._passed(arguments, known)
        return self._call(*(max(length, 0) for length in known), *passed)  # type: ignore[no-any-return]

    def _passed(self, arguments: Sequence[Any], known: list[int]) -> list[Any]:
        """Check the first arguments; return what C gets for them, and fill in the lengths that they say."""
        passed: list[Any] = []
        for value, (name, kind, shape, dtype, written, optional) in zip(arguments, self._arguments, strict=False):
            if shape is None:
                passed.append(_SCALARS[kind][1](value))
                continue
            if value is None and optional:
                passed.append(None)
                continue
            if not isinstance(value, np.ndarray) or value.dtype != dtype or value.ndim != len(shape):
                raise TypeError(f"kernel {self.name}: {name} must be {kind} with {len(shape)} axes, not {_what(value)}")
            flags = value.flags
            if not flags.c_contiguous or not flags.aligned or (written and not flags.writeable):
                raise ValueError(f"kernel {self.name}: {name} must be contiguous{' and writable' * written}")
            for (free, wanted), length in zip(shape, value.shape, strict=True):
                if free and known[wanted] < 0:
                    known[wanted] = length
                elif length != (known[wanted] if free else wanted):
                    raise ValueError(f"kernel {self.name}: the shape {value.shape} of {name} does not fit {self.takes}")
            passed.append(value.ctypes.data)
        return passed


def _what(value: Any) -> str:
    return f"{value.dtype}{list(value.shape)}" if isinstance(value, np.ndarray) else type(value).__name__


def kernel(name: str) -> Kernel:
    """Return the compiled function with this name."""
    return Kernel(name)


def needs_memory(failed: int) -> None:
    """Raise MemoryError if a kernel returned 1, which means that it could not allocate its working memory."""
    if failed:
        raise MemoryError("out of memory in a kernel")
