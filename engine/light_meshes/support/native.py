"""The native kernels: compiled C that comes with the package and is called with numpy arrays.

`kernel("name")` returns the function of that name. The comment above it in its C source declares its arguments
(`native.h` explains the format). They are checked at every call, so that a wrong call is a TypeError or a ValueError
here and not a crash in C. While a kernel runs, other Python threads can run too.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from .sources import ARGUMENT, KernelError, digest, library, sources

_PACKAGE = Path(__file__).resolve().parent.parent
Call = tuple[Any, ...]  # a function and its arguments
_TYPES: dict[str, Any] = {
    "i8": np.int8, "i32": np.int32, "i64": np.int64, "u8": np.uint8, "u16": np.uint16, "u32": np.uint32,
    "u64": np.uint64, "f32": np.float32, "f64": np.float64, "bool": np.bool_,
}
_SCALARS = {"i64": (ctypes.c_int64, int), "u64": (ctypes.c_uint64, int), "f64": (ctypes.c_double, float)}


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

_ARRAY, _INTEGER, _UNSIGNED, _REAL = range(4)  # kinds of arguments, as in calls.c
_KINDS = {"i64": _INTEGER, "u64": _UNSIGNED, "f64": _REAL}
_MOST, _DIMENSIONS, _TOGETHER, _FASTCALL = 64, 4, 8, 0x80
_NEEDED, _WRITTEN = 0x101, 0x501  # of flags.num: contiguous and aligned; writable, too


class _Array(ctypes.Structure):
    """The beginning of an array in memory, by numpy's C interface (PyArrayObject)."""

    _fields_ = (("references", ctypes.c_int64), ("class_", ctypes.c_void_p), ("data", ctypes.c_void_p),
                ("axes", ctypes.c_int), ("shape", ctypes.POINTER(ctypes.c_int64)), ("strides", ctypes.c_void_p),
                ("base", ctypes.c_void_p), ("type", ctypes.c_void_p), ("flags", ctypes.c_int))


class _Definition(ctypes.Structure):
    """How Python describes a function that is written in C (PyMethodDef)."""

    _fields_ = (("name", ctypes.c_char_p), ("function", ctypes.c_void_p), ("flags", ctypes.c_int),
                ("text", ctypes.c_char_p))


_kept: list[_Definition] = []  # as long as Python's functions of them


class _Called(np.ndarray):
    """What calls.c knows of a kernel, and what must stay in memory as long as that."""

    kept: tuple[Any, ...] = ()


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


@cache
def _calls() -> Any:
    """Return the function that makes Python functions of kernels, by calls.c; None where arrays do not lie in memory as
    they do with all releases of numpy and Python so far.
    """
    some = np.zeros((3, 5))
    for a in (some, some[1:], some.T, np.frombuffer(bytes(8)), some.astype(np.uint16)):
        seen = _Array.from_address(id(a))
        if (seen.class_, seen.data, seen.axes, seen.type, seen.flags) != (
                id(np.ndarray), a.ctypes.data, a.ndim, id(a.dtype), a.flags.num) or (
                tuple(seen.shape[:a.ndim]) != a.shape):
            return None
    api = ctypes.pythonapi
    functions = (api.PyLong_AsLongLong, api.PyLong_AsUnsignedLongLongMask, api.PyFloat_AsDouble, api.PyErr_Occurred,
                 api.PyErr_Clear, api.PyEval_SaveThread, api.PyEval_RestoreThread, api.PyLong_FromLongLong,
                 api.PyObject_Vectorcall)
    places = np.array([*map(_address, functions), id(None), id(np.ndarray)], np.uint64)
    if Kernel("calls_know").checked(places):
        return None
    make = api.PyCFunction_NewEx
    make.argtypes, make.restype = [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p], ctypes.py_object
    return make


class Kernel:
    """A compiled function. `takes` declares its arguments, as in its C source."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._call, self._slots = getattr(_LIBRARY, name), getattr(_LIBRARY, f"{name}_slots")
        text = ctypes.c_char.in_dll(_LIBRARY, f"{name}_takes")
        self.takes = ctypes.string_at(ctypes.addressof(text)).decode()
        self._lengths: list[str] = []
        self._arguments = [self._argument(*match) for match in ARGUMENT.findall(self.takes)]
        scalars = [_SCALARS[kind][0] if shape is None else ctypes.c_void_p for _, kind, shape, *_ in self._arguments]
        self._call.argtypes = [ctypes.c_int64] * len(self._lengths) + scalars
        self._call.restype = ctypes.c_int64
        self.fast = self._first

    def _first(self, *arguments: Any) -> int:
        """Make the function for all calls, and call it."""
        self.fast = self._function()
        return self.fast(*arguments)  # type: ignore[no-any-return]

    def of(self, *first: Any) -> Any:
        """Return a function that calls the kernel with these first arguments, which are checked once, here.

        It is for arrays that do not change their place as long as the function is in use, such as those of a scene.
        """
        known = [-1] * len(self._lengths)
        return self._function(first, self._passed(first, known), known)

    def _function(self, first: tuple = (), passed: Sequence[Any] = (), known: Sequence[int] = ()) -> Any:
        """Return a Python function that makes the checks of `checked` in C, and calls `checked` where something is not
        as expected. It takes what follows the arguments `first`; passed and known: what `_passed` said of these.
        """
        otherwise, make = partial(self.checked, *first) if first else self.checked, _calls()
        axes = max((len(shape or ()) for _, _, shape, *_ in self._arguments), default=0)
        if make is None or max(len(self._lengths), len(self._arguments)) > _MOST or axes > _DIMENSIONS:
            return otherwise  # calls.c has no room for more
        values = np.zeros(_MOST, np.int64)
        for n, (value, (_, kind, shape, *_)) in enumerate(zip(passed, self._arguments, strict=False)):
            values[n:n + 1].view(np.float64 if shape is None and kind == "f64" else np.int64)[:] = value or 0
        lengths = [*(known or [-1] * len(self._lengths)), *[0] * (_MOST - len(self._lengths))]
        head = [_address(self._slots), id(otherwise), len(self._lengths), len(self._arguments), len(first)]
        words = [w for argument in self._arguments for w in self._words(*argument)]
        called = np.array([*head, *lengths, *values.tolist(), *words], np.int64).view(_Called)
        definition = _Definition(self.name.encode(), _address(_LIBRARY.calls_kernel), _FASTCALL, None)
        called.kept = otherwise, definition, first
        return make(ctypes.addressof(definition), called, None)

    @staticmethod
    def _words(_: str, kind: str, shape: Any, dtype: Any, written: bool, optional: bool) -> list[int]:
        """Return the description of an argument for calls.c."""
        if shape is None:
            return [_KINDS[kind], *[0] * (4 + _DIMENSIONS)]
        lengths = [-1 - wanted if free else wanted for free, wanted in shape]
        return [_ARRAY, id(dtype), len(shape), _WRITTEN if written else _NEEDED, int(optional), *lengths,
                *[0] * (_DIMENSIONS - len(shape))]

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
        return self.fast(*arguments)  # type: ignore[no-any-return]

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


@cache
def _run_together() -> Any:
    """Return the function of calls.c that calls several kernels; None where `_calls` returns None."""
    make = _calls()
    definition = _Definition(b"together", _address(_LIBRARY.calls_together), _FASTCALL, None)
    _kept.append(definition)
    return make and make(ctypes.addressof(definition), _Called, None)


def together(*calls: Call) -> list[int]:
    """Call some functions one after the other, each given as (function, *arguments), and return their results.

    If all of them are kernels, or what `Kernel.of` returned, and at most 8, no Python runs between them. Use it for
    kernels of a tile that need nothing but each other's arrays: what Python does between two kernels is a hundred times
    slower than usual, as meanwhile nothing of it stays in the processor's caches, and other threads have to wait.
    """
    results = np.empty(_TOGETHER, np.int64)
    flat: list[Any] = [results]
    for function, *arguments in calls:
        known = getattr(function.fast if isinstance(function, Kernel) else function, "__self__", None)
        if type(known) is not _Called:
            break
        flat += known, *arguments
    else:
        run = _run_together()
        if run is not None and len(calls) <= _TOGETHER and run(*flat):
            return results[:len(calls)].tolist()  # type: ignore[no-any-return]
    return [function(*arguments) for function, *arguments in calls]


def needs_memory(failed: int) -> None:
    """Raise MemoryError if a kernel returned 1, which means that it could not allocate its working memory."""
    if failed:
        raise MemoryError("out of memory in a kernel")
