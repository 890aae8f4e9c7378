"""Builds what is released: the extension's zips, and the wheels of the engine.

    python addon/build.py [-o FOLDER] [NAME …]            # zips; NAME is one of them, such as linux-x64
    python addon/build.py --wheels [-o FOLDER] [NAME …]   # wheels; NAME is one of them, such as linux-x86_64
    python addon/build.py --release --website URL         # all zips and all wheels, as they are published

A zip serves one platform and all Blenders: it holds the add-on, the engine's wheel and all packages that Blender lacks,
for each Python that a Blender has. numpy is left out, as all Blenders have it. The packages' versions and hashes are
in wheels.txt. A wheel serves one platform and all Pythons. All platforms are built on any of them, with zig's
compiler. What is built is checked. Needs pip, and a network or pip's cache.
"""

import argparse
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from calendar import timegm
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

ADDON = Path(__file__).resolve().parent
ROOT = ADDON.parent
sys.path[:0] = [str(ADDON), str(ROOT / "engine/light_meshes/support")]  # not as packages: they import bpy and numpy
from libraries import LibraryError, check_wheel  # noqa: E402
from sources import TARGETS, library  # noqa: E402

del sys.path[:2]

TOOLS = {"build.py", "libraries.py", "wheels.txt"}  # files in this folder that are not part of the add-on
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # a fixed time, so that the same sources give the same bytes
LARGEST = 50e6  # bytes of a zip

# blender.org's Blenders have 3.11 up to 5.0 and 3.13 from 5.1 on; Linux distributions build older ones with 3.13.
# Of a zip's wheels Blender installs those that are for its own Python.
PYTHONS = ("3.11", "3.13")


class Platform(NamedTuple):
    """A platform that Blender runs on."""

    target: str  # a key of TARGETS, what the engine's kernels are compiled for
    tags: list[str]  # of packages that run on the oldest system that Blender 4.2 runs on, the best ones first


# On macOS the oldest system of Blender 4.2 is 11, but embreex needs 13. embreex has no wheel for Linux on arm64.
PLATFORMS = {
    "linux-x64": Platform("linux-x86_64", [f"manylinux_2_{minor}_x86_64" for minor in range(28, 16, -1)]),
    "windows-x64": Platform("win32-x86_64", ["win_amd64"]),
    "macos-arm64": Platform("darwin-arm64", [f"macosx_{major}_0_arm64" for major in range(13, 10, -1)]),
    "macos-x64": Platform("darwin-x86_64", [*(f"macosx_{major}_0_x86_64" for major in range(13, 10, -1)),
                                            "macosx_10_15_x86_64"]),
}


class BuildError(Exception):
    """Something cannot be built. The message is one sentence that says why."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code: 0 if all is built and checked."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", metavar="NAME", nargs="*", help="platforms (default: all)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--wheels", action="store_true", help="build the engine's wheels and no zips")
    which.add_argument("--release", action="store_true", help="build all zips and all wheels")
    parser.add_argument("--website", metavar="URL", default="", help="where the project is, for the zips' manifest; "
                        "the extensions platform asks for it")
    parser.add_argument("-o", "--output", metavar="FOLDER", type=Path, default=ROOT / "dist")
    options = parser.parse_args(arguments)
    known = list(TARGETS if options.wheels else PLATFORMS)
    jobs: list[tuple[Callable[[str, Path], tuple[Path, str]], str]] = []
    if not options.wheels:
        jobs += [(partial(build_zip, website=options.website), name) for name in PLATFORMS]
    jobs += [(build_wheel, name) for name in TARGETS] if options.wheels or options.release else []
    try:
        if options.website and not re.fullmatch(r"https?://\S+", options.website):
            raise BuildError(f"{options.website!r} is no address of a website: it must begin with https://")
        if unknown := [name for name in options.names if name not in known]:
            raise BuildError(f"there is no {' or '.join(unknown)}; there are {', '.join(known)}")
        options.output.mkdir(parents=True, exist_ok=True)
        for build, name in jobs:
            if options.names and name not in options.names:
                continue
            start = time.perf_counter()
            path, said = build(name, options.output)
            size, took = path.stat().st_size / 1e6, time.perf_counter() - start
            print(f"{path}: {size:.2f} MB, {took:.0f} s, {said}", flush=True)
    except (BuildError, LibraryError) as e:
        print(f"build: {e}", file=sys.stderr)
        return 1
    return 0


def build_wheel(target: str, folder: Path) -> tuple[Path, str]:
    """Write the wheel for a key of TARGETS into `folder`. Returns its path, and what its libraries are.

    It is the project's own wheel as pip builds it, engine and add-on, and can be published as it is. The same sources
    give the same bytes.
    """
    with tempfile.TemporaryDirectory() as temporary:
        source, out = Path(temporary) / "source", Path(temporary) / "out"
        source.mkdir()
        # copy only these, so that nothing from an earlier build is included
        for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
            shutil.copy(ROOT / name, source)
        left = shutil.ignore_patterns("__pycache__", "*.egg-info", "kernels*.so", "kernels*.dll", "kernels*.dylib")
        for name in ("engine", "addon"):
            shutil.copytree(ROOT / name, source / name, ignore=left)
        command = [sys.executable, "-P", "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps",
                   *_without_isolation(), "--wheel-dir", str(out), str(source)]
        environment = os.environ | {"LIGHT_MESHES_TARGET": target, "SOURCE_DATE_EPOCH": str(timegm(LONG_AGO))}
        done = subprocess.run(command, capture_output=True, text=True, env=environment)
        if done.returncode:
            raise BuildError(f"the engine cannot be built for {target}: {done.stderr.strip()}")
        built = next(out.glob("*.whl"))
        libraries = {library(TARGETS[target].system, level) for level in TARGETS[target].levels}
        said = check_wheel(built, version(), TARGETS[target].wheel, libraries)
        path = folder / built.name
        shutil.move(built, path)
    return path, "; ".join(said)


def _without_isolation() -> list[str]:
    """Return the arguments that make pip build with the compiler of this Python, if it has one.

    Otherwise pip installs a compiler for each build in another folder, and each of them makes the C libraries of other
    systems again, because it keeps them by folder.
    """
    here = all(importlib.util.find_spec(name) for name in ("setuptools.command.bdist_wheel", "ziglang"))
    return ["--no-build-isolation"] if here else []


def build_zip(platform: str, folder: Path, website: str = "") -> tuple[Path, str]:
    """Write the zip for a key of PLATFORMS into `folder`. Returns its path, and what Blender's check says of it."""
    path = folder / f"light_meshes-{version()}-{platform}.zip"
    with tempfile.TemporaryDirectory() as temporary:
        wheels = [build_wheel(PLATFORMS[platform].target, Path(temporary))[0], *download(platform, Path(temporary))]
        write_zip(platform, wheels, path, website)
    if path.stat().st_size > LARGEST:
        raise BuildError(f"{path} has {path.stat().st_size / 1e6:.1f} MB, more than {LARGEST / 1e6:.0f}")
    return path, validate(path)


def write_zip(platform: str, wheels: list[Path], path: Path, website: str = "") -> None:
    """Write a zip with the add-on and these wheels to `path`; website: see `manifest`."""
    wheels = sorted(wheels, key=lambda wheel: wheel.name)
    with zipfile.ZipFile(path, "w") as archive:
        for file in sorted(p for p in ADDON.rglob("*.py") if p.name not in TOOLS):
            _add(archive, file.relative_to(ADDON).as_posix(), file.read_bytes())
        _add(archive, "LICENSE", (ROOT / "LICENSE").read_bytes())
        _add(archive, "blender_manifest.toml", manifest(platform, [wheel.name for wheel in wheels], website).encode())
        for wheel in wheels:
            _add(archive, f"wheels/{wheel.name}", wheel.read_bytes(), zipfile.ZIP_STORED)


def version() -> str:
    """Return the version of the add-on and the engine, as `light_meshes/__init__.py` says it.

    blender_manifest.toml repeats it, because Blender reads that file as it is, from a checkout too. Raises BuildError
    where the two differ.
    """
    found = re.findall(r'^__version__ = "(.*)"$', (ROOT / "engine/light_meshes/__init__.py").read_text("utf-8"), re.M)
    repeated = tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
    if found != [repeated]:
        raise BuildError(f"blender_manifest.toml has version {repeated} and light_meshes/__init__.py {found}: "
                         "write into the first what the second says")
    return repeated


def manifest(platform: str, wheels: list[str], website: str = "") -> str:
    """Return the text of the add-on's manifest, with the parts that differ from zip to zip, and the address of the
    project's website, if one is given.
    """
    own, tables = (ADDON / "blender_manifest.toml").read_text(encoding="utf-8").split("\n[", 1)
    where = f"website = {json.dumps(website)}\n" if website else ""
    listed = json.dumps([f"./wheels/{name}" for name in wheels], indent=2)
    return f'{own}{where}platforms = ["{platform}"]\nwheels = {listed}\n\n[{tables}'


def download(platform: str, folder: Path, pythons: tuple[str, ...] = PYTHONS) -> list[Path]:
    """Return the wheels of wheels.txt for one platform and these Pythons, downloaded into `folder`."""
    places = [word for tag in PLATFORMS[platform].tags for word in ("--platform", tag)]
    packages = folder / "packages"
    for python in pythons:
        command = [sys.executable, "-P", "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps",
                   "--only-binary=:all:", "--require-hashes", "--implementation", "cp", "--python-version", python,
                   *places, "--dest", str(packages), "--requirement", str(ADDON / "wheels.txt")]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            missing = re.search(r"No matching distribution found for (\S+)", done.stderr)
            raise BuildError(f"no wheel of {missing[1]} is to be had for {platform} and Python {python}" if missing
                             else f"pip cannot download the wheels: {done.stderr.strip()}")
    return sorted(packages.glob("*.whl"))


def validate(path: Path) -> str:
    """Return what Blender's own check says of a zip, or that there is no Blender to ask. Raises BuildError if it
    complains.
    """
    found = importlib.util.find_spec("bpy")
    origin = found.origin if found else None
    scripts = list(Path(origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")) if origin else []
    blender = shutil.which("blender")
    if scripts:
        command = [sys.executable, str(scripts[0])]
    elif blender:
        command = [blender, "--command", "extension"]
    else:
        return "not validated, as there is neither a bpy nor a blender"
    done = subprocess.run([*command, "validate", str(path)], capture_output=True, text=True)
    if done.returncode:
        raise BuildError(f"{path} is not valid: {done.stdout}{done.stderr}")
    return "valid"


def _add(archive: zipfile.ZipFile, name: str, data: bytes, compression: int = zipfile.ZIP_DEFLATED) -> None:
    """Add a file to an archive, with the same time and mode wherever it is built."""
    entry = zipfile.ZipInfo(name, LONG_AGO)
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, data, compression)


if __name__ == "__main__":
    sys.exit(main())
