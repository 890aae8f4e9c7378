"""Compile the engine's kernels (all C sources of the package) into shared libraries inside the package.

The compiler is zig's. pip installs it as a wheel for the build, so no machine needs its own compiler. The kernels are
plain C, and ctypes loads them, so one wheel for each platform works with every Python. LIGHT_MESHES_TARGET names
another platform to build for (a key of TARGETS in `engine/light_meshes/support/sources.py`); without it the wheel is
for this machine.
"""

import os
import platform
import subprocess
import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext

HERE = Path(__file__).resolve().parent
PACKAGE = HERE / "engine" / "light_meshes"
sys.path.insert(0, str(PACKAGE / "support"))  # a module that imports nothing from the package, which is not built yet
from sources import TARGETS, Target, digest, library, sources  # noqa: E402

FLAGS = [
    "-shared", "-fPIC", "-O3", "-std=c11", "-Wall", "-Wextra", "-Werror", "-fvisibility=hidden", "-s",
    # IEEE arithmetic, operation by operation, so that every processor gives the same bits.
    "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math",
]


def target() -> Target:
    """Return the platform to build for."""
    machine = {"amd64": "x86_64", "aarch64": "arm64"}.get(platform.machine().lower(), platform.machine().lower())
    name = os.environ.get("LIGHT_MESHES_TARGET") or f"{sys.platform}-{machine}"
    if name not in TARGETS:
        raise SystemExit(f"the engine's kernels are not built for {name}, only for {', '.join(TARGETS)}; "
                         "set LIGHT_MESHES_TARGET to one of them")
    return TARGETS[name]


class Kernels(build_ext):
    """The libraries of all C sources, one for each level of the platform's processors."""

    def get_ext_filename(self, name: str) -> str:
        """Return the path of the library. Its name contains no Python version, because it does not depend on Python."""
        *folders, level = name.split(".")
        return str(Path(*folders, library(target().system, level)))

    def build_extension(self, extension: Extension) -> None:
        """Compile and link in one call."""
        out = Path(self.get_ext_fullpath(extension.name))
        out.parent.mkdir(parents=True, exist_ok=True)
        flags = target().levels[extension.name.split(".")[-1]]
        subprocess.run([
            sys.executable, "-m", "ziglang", "cc", "-target", target().zig, *flags, *FLAGS,
            f'-DSOURCES="{digest(PACKAGE)}"', f"-I{PACKAGE / 'support'}", "-o", str(out), *extension.sources,
            *([] if target().system == "win32" else ["-lm"]),
        ], check=True, cwd=HERE)
        # files that the linker for Windows leaves behind
        for extra in out.parent.glob("*.pdb"), out.parent.glob("*.lib"):
            for path in extra:
                path.unlink()


class AnyPython(bdist_wheel):
    """A wheel for one platform and all Pythons."""

    def get_tag(self) -> tuple[str, str, str]:
        """Return the tags in the wheel's name."""
        return "py3", "none", target().wheel


setup(
    ext_modules=[
        Extension(f"light_meshes.{level}", [path.relative_to(HERE).as_posix() for path in sources(PACKAGE)],
                  depends=[path.relative_to(HERE).as_posix() for path in PACKAGE.rglob("*.h")])
        for level in target().levels
    ],
    cmdclass={"build_ext": Kernels, "bdist_wheel": AnyPython},
)
