"""Compiles the engine's kernels, all C sources of the package, into shared libraries inside it.

The compiler is zig's, a wheel that pip brings for the build, so that no machine needs one of its own. What is built is
plain C that ctypes loads: one wheel a platform serves every Python. LIGHT_MESHES_TARGET names another platform to build
for (a key of TARGETS in `engine/light_meshes/support/sources.py`); without it the wheel is for this machine.
LIGHT_MESHES_CFLAGS holds flags for the compiler that come after the others, such as -O0 -g0 -fno-sanitize=undefined, by
which a build takes a third of the time where nobody waits for the kernels' speed.
"""

import os
import platform
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

HERE = Path(__file__).resolve().parent
PACKAGE = HERE / "engine" / "light_meshes"
sys.path.insert(0, str(PACKAGE / "support"))  # modules that import nothing of the package, which is not built yet
from declarations import calls  # noqa: E402
from sources import TARGETS, Target, digest, included, library, sources  # noqa: E402

FLAGS = [
    "-fPIC", "-O3", "-std=c11", "-Wall", "-Wextra", "-Werror", "-fvisibility=hidden",
    # IEEE arithmetic, operation by operation: the same bits whatever the processor.
    "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math",
]
LINKING = ["-shared", "-O3", "-s"]
TOOLS = {("light_meshes_addon", "build"), ("light_meshes_addon", "libraries")}


def target() -> Target:
    """The platform to build for."""
    machine = {"amd64": "x86_64", "aarch64": "arm64"}.get(platform.machine().lower(), platform.machine().lower())
    name = os.environ.get("LIGHT_MESHES_TARGET") or f"{sys.platform}-{machine}"
    if name not in TARGETS:
        raise SystemExit(f"the engine's kernels are not built for {name}, only for {', '.join(TARGETS)}; "
                         "set LIGHT_MESHES_TARGET to one of them")
    return TARGETS[name]


class Kernels(build_ext):
    """Libraries of all C sources, one for each level of the platform's processors."""

    def get_ext_filename(self, name: str) -> str:
        """The library's place. No Python's version is in its name, as it knows nothing of Python."""
        *folders, level = name.split(".")
        return str(Path(*folders, library(target().system, level)))

    def build_extension(self, extension: Extension) -> None:
        """Compile for one level of processors, and link.

        The C library, which zig makes where a system has none, is linked for every processor: Windows' takes minutes.
        macOS' libraries hold a name, which would be the path of this build.
        """
        out = Path(self.get_ext_fullpath(extension.name)).resolve()
        level = extension.name.split(".")[-1]
        objects = Path(self.build_temp).resolve() / level
        for folder in (out.parent, objects):
            folder.mkdir(parents=True, exist_ok=True)
        zig = [sys.executable, "-m", "ziglang", "cc", "-target", target().zig]
        compiler = [*zig, *target().levels[level], *FLAGS, *os.environ.get("LIGHT_MESHES_CFLAGS", "").split(),
                    f'-DSOURCES="{digest(PACKAGE)}"', f"-I{PACKAGE / 'support'}"]

        def compiled(source: str | Path) -> str:
            name = Path(source).stem + ".o"
            subprocess.run([*compiler, "-c", "-o", name, str(HERE / source)], check=True, cwd=objects)
            return name

        expanded = subprocess.run([*compiler, "-w", "-E", "-x", "c", "-"], check=True, cwd=objects,
                                  stdout=subprocess.PIPE, input=included(PACKAGE).encode()).stdout
        (objects / "slots.c").write_text(calls(expanded.decode()))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            names = sorted(pool.map(compiled, [*extension.sources, objects / "slots.c"]))
        system = {"win32": [], "darwin": ["-lm", f"-Wl,-install_name,@rpath/{out.name}"]}.get(target().system, ["-lm"])
        subprocess.run([*zig, *LINKING, "-o", str(out), *names, *system], check=True, cwd=objects)
        for extra in out.parent.glob("*.pdb"), out.parent.glob("*.lib"):  # what Windows' linker leaves
            for path in extra:
                path.unlink()


class Modules(build_py):
    """The packages' modules, without the tools that build and check what is released."""

    def find_package_modules(self, package: str, package_dir: str) -> list[tuple[str, str, str]]:
        """All modules of a package as (package, module, path)."""
        found = super().find_package_modules(package, package_dir)
        return [one for one in found if one[:2] not in TOOLS]


class AnyPython(bdist_wheel):
    """A wheel for one platform and all Pythons."""

    def get_tag(self) -> tuple[str, str, str]:
        """The tags in the wheel's name."""
        return "py3", "none", target().wheel


setup(
    ext_modules=[
        Extension(f"light_meshes.{level}", [path.relative_to(HERE).as_posix() for path in sources(PACKAGE)],
                  depends=[path.relative_to(HERE).as_posix() for path in PACKAGE.rglob("*.h")])
        for level in target().levels
    ],
    cmdclass={"build_py": Modules, "build_ext": Kernels, "bdist_wheel": AnyPython},
)
