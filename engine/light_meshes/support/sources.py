"""The kernels' C sources: which there are, for which platforms they are compiled, and what the libraries are called.

Both the build (`setup.py`) and the engine (`native.py`) use it, so it imports nothing of the package, and loads no
kernels.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple


class KernelError(RuntimeError):
    """The library of kernels is missing, or was compiled from other sources."""


class Target(NamedTuple):
    """A platform that kernels are built for."""

    system: str  # sys.platform
    zig: str  # what the compiler calls it; of Linux with the oldest C library
    wheel: str  # the tag in a wheel's name
    levels: dict[str, list[str]]  # library → flags: one for every processor, and one for those with AVX2


_X86 = {"kernels": ["-mcpu=x86_64_v2"], "kernels-avx2": ["-mcpu=x86_64_v3"]}
TARGETS = {
    "linux-x86_64": Target("linux", "x86_64-linux-gnu.2.17", "manylinux2014_x86_64", _X86),
    "linux-arm64": Target("linux", "aarch64-linux-gnu.2.17", "manylinux2014_aarch64", {"kernels": []}),
    "win32-x86_64": Target("win32", "x86_64-windows-gnu", "win_amd64", _X86),
    "darwin-x86_64": Target("darwin", "x86_64-macos.11.0", "macosx_11_0_x86_64", _X86),
    "darwin-arm64": Target("darwin", "aarch64-macos.11.0", "macosx_11_0_arm64", {"kernels": []}),
}


def sources(package: Path) -> list[Path]:
    """The C files below `package`."""
    return sorted(package.rglob("*.c"))


def digest(package: Path) -> str:
    """A name for these very sources, headers included."""
    found = hashlib.sha256()
    for path in [*sources(package), *sorted(package.rglob("*.h"))]:
        found.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()[:16]


def library(system: str, level: str = "kernels") -> str:
    """The file name of a library on a system (sys.platform)."""
    return level + {"win32": ".dll", "darwin": ".dylib"}.get(system, ".so")
