"""Build the extension: zips with the add-on, the engine and every package that Blender lacks.

    python addon/build.py [-o FOLDER] [NAME …]

There is one zip for each platform and Python. NAME is the beginning of the names to build, such as linux-x64 or
linux-x64-py3.13; without a name all are built. It needs pip, and a network or pip's cache. The versions and hashes of
the wheels are in wheels.txt. numpy is not included, because every Blender has it.
"""

import argparse
import base64
import hashlib
import importlib.util
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path
from typing import NamedTuple

ADDON = Path(__file__).parent
ROOT = ADDON.parent
TOOLS = {"build.py", "wheels.txt"}  # files in this folder that are not part of the add-on
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # a fixed time, so that the same sources give the same bytes

# The platforms for which the engine's kernels are built, by their names in `engine/light_meshes/support/sources.py`.
TARGETS = {"linux-x64": "linux-x86_64", "windows-x64": "win32-x86_64", "macos-arm64": "darwin-arm64"}
# Tags of wheels that run on the oldest system that Blender 4.2 supports. On macOS that is 11, but embreex needs 13.
PLATFORMS = {
    "linux-x64": [f"manylinux_2_{minor}_x86_64" for minor in range(28, 16, -1)],
    "windows-x64": ["win_amd64"],
    "macos-arm64": [f"macosx_{major}_0_arm64" for major in range(13, 10, -1)],
}


class Python(NamedTuple):
    """A version of Python, and the range of Blender versions that contain it."""

    version: str
    blender_min: str
    blender_max: str | None  # the first Blender version with another Python


# Blenders from blender.org have Python 3.11 up to 5.0 and 3.13 from 5.1 on; some Linux distributions build older ones
# with 3.13. Blender itself refuses wheels for another Python than its own.
PYTHONS = (Python("3.11", "4.2.0", "5.1.0"), Python("3.13", "4.2.0", None))


class BuildError(Exception):
    """The build failed; the message is one sentence that says why."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", metavar="NAME", nargs="*", default=[""])
    parser.add_argument("-o", "--output", metavar="FOLDER", type=Path, default=ROOT / "dist")
    options = parser.parse_args(arguments)
    targets = {f"{platform}-py{python.version}": (platform, python) for python in PYTHONS for platform in PLATFORMS}
    wanted = [name for name in targets if name.startswith(tuple(options.names))]
    try:
        if not wanted:
            raise BuildError(f"there is no {' or '.join(options.names)}; there are {', '.join(targets)}")
        options.output.mkdir(parents=True, exist_ok=True)
        for name in wanted:
            path = options.output / f"light_meshes-{version()}-{name}.zip"
            with tempfile.TemporaryDirectory() as folder:
                build(*targets[name], download(*targets[name], Path(folder)), path)
            print(f"{path}: {path.stat().st_size / 1e6:.1f} MB, {validate(path)}", flush=True)
    except BuildError as e:
        print(f"build: {e}", file=sys.stderr)
        return 1
    return 0


def build(platform: str, python: Python, packages: list[Path], path: Path) -> None:
    """Write the zip of one platform and Python, with the wheels of `packages`, to `path`."""
    wheels = dict([engine_wheel(platform), *((file.name, file.read_bytes()) for file in sorted(packages))])
    with zipfile.ZipFile(path, "w") as archive:
        for file in sorted(p for p in ADDON.rglob("*.py") if p.name not in TOOLS):
            _add(archive, file.relative_to(ADDON).as_posix(), file.read_bytes())
        _add(archive, "LICENSE", (ROOT / "LICENSE").read_bytes())
        _add(archive, "blender_manifest.toml", manifest(platform, python, list(wheels)).encode())
        for name, data in wheels.items():
            _add(archive, f"wheels/{name}", data, zipfile.ZIP_STORED)


def version() -> str:
    """Return the common version of the add-on and the engine."""
    versions = {tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))["version"],
                tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"],
                *re.findall(r'__version__ = "(.*)"', (ROOT / "engine/light_meshes/__init__.py").read_text("utf-8"))}
    if len(versions) > 1:
        raise BuildError(f"blender_manifest.toml, pyproject.toml and the engine have versions {sorted(versions)}")
    return versions.pop()


def manifest(platform: str, python: Python, wheels: list[str]) -> str:
    """Return the text of the add-on's manifest, with the parts that differ from zip to zip."""
    text = (ADDON / "blender_manifest.toml").read_text(encoding="utf-8")
    own, tables = text.split("\n[", 1)
    lines = [line for line in own.splitlines() if not line.startswith("blender_version_")]
    lines.append(f'blender_version_min = "{python.blender_min}"')
    if python.blender_max:
        lines.append(f'blender_version_max = "{python.blender_max}"')
    lines.append(f'platforms = ["{platform}"]')
    lines.append("wheels = " + json.dumps([f"./wheels/{name}" for name in wheels], indent=2))
    return "\n".join(lines) + "\n\n[" + tables


def download(platform: str, python: Python, folder: Path) -> list[Path]:
    """Download the wheels of wheels.txt for one platform and Python into `folder`, and return their paths."""
    places = [word for tag in PLATFORMS[platform] for word in ("--platform", tag)]
    command = [sys.executable, "-P", "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps",
               "--only-binary=:all:", "--require-hashes", "--implementation", "cp", "--python-version", python.version,
               *places, "--dest", str(folder), "--requirement", str(ADDON / "wheels.txt")]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        missing = re.search(r"No matching distribution found for (\S+)", done.stderr)
        raise BuildError(f"no wheel of {missing[1]} is to be had for {platform} and Python {python.version}" if missing
                         else f"pip cannot download the wheels: {done.stderr.strip()}")
    return list(folder.glob("*.whl"))


def engine_wheel(platform: str) -> tuple[str, bytes]:
    """Return the name and the contents of a wheel with only the engine. The project's own wheel also contains the
    add-on.
    """
    contents, tag = project_wheel(platform)
    # Blender keeps an installed package of the same name and version. So each engine wheel gets its own version.
    release = f"{version()}+{hashlib.sha256(repr(contents).encode()).hexdigest()[:8]}"
    info = f"light_meshes-{release}.dist-info"
    contents |= {
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: light-meshes\nVersion: {release}\n"
                            "License: GPL-3.0-or-later\n".encode(),
        f"{info}/WHEEL": f"Wheel-Version: 1.0\nGenerator: light-meshes\nRoot-Is-Purelib: false\nTag: {tag}\n".encode(),
    }
    record = [f"{name},sha256={_hash(data)},{len(data)}" for name, data in contents.items()]
    contents[f"{info}/RECORD"] = "\n".join([*record, f"{info}/RECORD,,", ""]).encode()
    wheel = io.BytesIO()
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, data in contents.items():
            _add(archive, name, data)
    return f"light_meshes-{release}-{tag}.whl", wheel.getvalue()


def project_wheel(platform: str) -> tuple[dict[str, bytes], str]:
    """Build the project's wheel for a platform with pip; return the engine's files in it, and the wheel's tag."""
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder) / "source", Path(folder) / "out"
        source.mkdir()
        # copy only these, so that nothing from an earlier build is included
        for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
            shutil.copy(ROOT / name, source)
        left = shutil.ignore_patterns("__pycache__", "*.egg-info", "kernels*.so", "kernels*.dll", "kernels*.dylib")
        for name in ("engine", "addon"):
            shutil.copytree(ROOT / name, source / name, ignore=left)
        command = [sys.executable, "-P", "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps",
                   "--wheel-dir", str(out), str(source)]
        done = subprocess.run(command, capture_output=True, text=True,
                              env=os.environ | {"LIGHT_MESHES_TARGET": TARGETS[platform]})
        if done.returncode:
            raise BuildError(f"the engine cannot be built for {platform}: {done.stderr.strip()}")
        wheel = next(out.glob("*.whl"))
        with zipfile.ZipFile(wheel) as archive:
            names = [name for name in sorted(archive.namelist()) if name.startswith("light_meshes/")]
            return {name: archive.read(name) for name in names}, "-".join(wheel.stem.split("-")[-3:])


def validate(path: Path) -> str:
    """Run Blender's own check on a zip, and return what it says."""
    found = importlib.util.find_spec("bpy")
    scripts = found and list(Path(found.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    if scripts:
        command = [sys.executable, str(scripts[0])]
    elif shutil.which("blender"):
        command = [shutil.which("blender"), "--command", "extension"]
    else:
        return "not validated, as there is neither a bpy nor a blender"
    done = subprocess.run([*command, "validate", str(path)], capture_output=True, text=True)
    if done.returncode:
        raise BuildError(f"{path} is not valid: {done.stdout}{done.stderr}")
    return "valid"


def _add(archive: zipfile.ZipFile, name: str, data: bytes, compression: int = zipfile.ZIP_DEFLATED) -> None:
    entry = zipfile.ZipInfo(name, LONG_AGO)
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, data, compression)


def _hash(data: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()


if __name__ == "__main__":
    sys.exit(main())
