"""The C sources of the kernels: the list of files, the platforms for which they are compiled, and the names of the
libraries.

Both the build (`setup.py`) and the engine (`native.py`) use this module, so it imports nothing from the package and
loads no kernels.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple


class KernelError(RuntimeError):
    """The library of kernels is missing, or was compiled from other sources."""


class Target(NamedTuple):
    """A platform for which kernels are built."""

    system: str  # sys.platform
    zig: str  # its name for the compiler; for Linux with the oldest supported C library
    wheel: str  # the platform tag in a wheel's name
    # library → compiler flags: one library for every processor, and one for processors with AVX2
    levels: dict[str, list[str]]


_X86 = {"kernels": ["-mcpu=x86_64_v2"], "kernels-avx2": ["-mcpu=x86_64_v3"]}
TARGETS = {
    "linux-x86_64": Target("linux", "x86_64-linux-gnu.2.17", "manylinux2014_x86_64", _X86),
    "linux-arm64": Target("linux", "aarch64-linux-gnu.2.17", "manylinux2014_aarch64", {"kernels": []}),
    "win32-x86_64": Target("win32", "x86_64-windows-gnu", "win_amd64", _X86),
    "darwin-x86_64": Target("darwin", "x86_64-macos.11.0", "macosx_11_0_x86_64", _X86),
    "darwin-arm64": Target("darwin", "aarch64-macos.11.0", "macosx_11_0_arm64", {"kernels": []}),
}


def sources(package: Path) -> list[Path]:
    """Return the C files below `package`."""
    return sorted(package.rglob("*.c"))


def digest(package: Path) -> str:
    """Return a hash of the sources, headers included, which identifies exactly this version of them."""
    found = hashlib.sha256()
    for path in [*sources(package), *sorted(package.rglob("*.h"))]:
        found.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:16]


def library(system: str, level: str = "kernels") -> str:
    """Return the file name of a library for a system (a value of sys.platform)."""
    return level + {"win32": ".dll", "darwin": ".dylib"}.get(system, ".so")


def included(package: Path) -> str:
    """Return a C source that includes all others, so that one run of a preprocessor expands all declarations."""
    return "".join(f'#include "{path.as_posix()}"\n' for path in sources(package))
