"""Replays calls of the kernels on the libraries for Windows, in Wine, and compares what they write with Linux's bits.

    python tests/support/windows_kernels.py [TEST_FILE …]

Run it on Linux, from a checkout with the engine installed. It needs Wine (`apt-get install wine64`) and ziglang
(`pip install ziglang`), and takes about eight minutes. It builds the wheel for Windows, runs the test files (or those
of TESTS) while it writes down what kernels are given and what they give back, and has `replay.c`, compiled for Windows,
do the same calls with each library of the wheel. One line a kernel says how many calls and numbers differ. The exit
code is 1 if any does, but for those in LAST_BITS.
"""

import contextlib
import importlib.util
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import threading
import zipfile
from pathlib import Path

import numpy as np
import pytest
from light_meshes.support import native

ROOT = Path(__file__).parents[2]
# They run in this process, are quick, and call most kernels.
TESTS = ["psi", "node_store", "lights", "refraction", "terminator", "textures", "reuse", "shadow_rate",
         "glass_in_glass", "light_size", "semitransparent", "certificate", "layers", "procedural", "blurred", "worlds",
         "patched", "sized_toggles", "light_threshold"]
# Kernels that take addresses in this process: of Python's functions, of what another thread changes; and those of
# Embree's functions, which are numbers of this type and name.
NOT_AGAIN, ADDRESSES = ("calls_", "lock_"), re.compile(r"\b(function|scene|occluded|closest) u64\b")
MOST = 12  # calls of each kernel, and
LARGEST = 4_000_000  # bytes of a call: what is left out is larger of the same
# Kernel → how far a number may be from Linux's: Windows' C library has another atan2, sin, cos and exp. bodies_winding
# gives sums of angles, which are rounded to whole turns.
LAST_BITS = {"bodies_winding": 1e-12, "blurred_rays": 1e-12, **dict.fromkeys(
    ("area_sample", "blurred_glass", "ggx_tables", "procedural_magic", "shading_gather", "sky_table_look"), 1e-14)}
INTEGER, REAL, NOTHING, FLOATS, DOUBLES, BYTES, SAME = range(7)  # the kinds of arguments in replay.c


class Recorder:
    """Writes calls of kernels into a file while it is entered. Calls with other lengths than before come first."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._seen: dict[str, set[tuple]] = {}
        self._lock = threading.RLock()  # one kernel at a time, so that no other writes into its arrays

    def __enter__(self):
        self._file = self._path.open("wb")
        self._call, self._of, self._together = native.Kernel.__call__, native.Kernel.of, native._TOGETHER
        recorder, call = self, self._call

        def recorded(kernel, *arguments):
            with recorder._lock:
                return recorder._record(kernel, arguments, lambda: call(kernel, *arguments))

        native.Kernel.__call__ = recorded
        native._TOGETHER = 0  # kernels that are called together come one by one
        native.Kernel.of = lambda kernel, *first: lambda *rest: recorded(kernel, *first, *rest)
        return self

    def __exit__(self, *_):
        native.Kernel.__call__, native.Kernel.of, native._TOGETHER = self._call, self._of, self._together
        self._file.close()

    @property
    def names(self) -> set[str]:
        """Return the kernels that were called."""
        return set(self._seen)

    def _record(self, kernel, arguments, call) -> int:
        """Call a kernel, and write the call down if it is one of the first of its kind."""
        if kernel.name.startswith(NOT_AGAIN) or ADDRESSES.search(kernel.takes):
            return call()
        seen = self._seen.setdefault(kernel.name, set())
        shapes = tuple(a.shape for a in arguments if isinstance(a, np.ndarray))
        size = sum(a.nbytes for a in arguments if isinstance(a, np.ndarray))
        if shapes in seen or len(seen) == MOST or size > LARGEST or len(arguments) != len(kernel._arguments):
            return call()
        before = [a.tobytes() if isinstance(a, np.ndarray) else None for a in arguments]
        gave = call()  # it raises where a test gives it something wrong
        seen.add(shapes)
        words, lengths, places = [], [-1] * len(kernel._lengths), {}
        for value, contents, (_, kind, shape, *_) in zip(arguments, before, kernel._arguments, strict=True):
            place = len(lengths) + len(words)
            if shape is None:
                real = kind == "f64"
                words.append(struct.pack("<QQ", REAL if real else INTEGER, 8)
                             + (struct.pack("<d", value) if real else struct.pack("<Q", int(value) % 2**64)))
            elif value is None:
                words.append(struct.pack("<QQQ", NOTHING, 8, 0))
            elif value.nbytes and value.ctypes.data in places:
                words.append(struct.pack("<QQ", SAME, places[value.ctypes.data]))
            else:
                number = {"f": FLOATS, "d": DOUBLES}.get(value.dtype.char, BYTES)
                words.append(struct.pack("<QQ", number, value.nbytes) + contents + value.tobytes())
                places[value.ctypes.data] = place
            if value is not None and shape is not None:
                for (free, wanted), length in zip(shape, value.shape, strict=True):
                    if free:
                        lengths[wanted] = length
        words[:0] = [struct.pack("<QQq", INTEGER, 8, max(length, 0)) for length in lengths]
        head = kernel.name.encode().ljust(64, b"\0") + struct.pack("<Qq", len(words), gave)
        self._file.write(head + b"".join(words))
        return gave


def windows_libraries(folder: Path) -> list[Path]:
    """Return the libraries of the wheel for Windows, built now, in `folder`."""
    spec = importlib.util.spec_from_file_location("build", ROOT / "addon" / "build.py")
    build = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(build)
    wheel, _ = build.build_wheel("win32-x86_64", folder)
    with zipfile.ZipFile(wheel) as archive:
        return [Path(archive.extract(name, folder)) for name in archive.namelist() if name.endswith(".dll")]


def main(tests: list[str]) -> int:
    """Build, record, replay and compare. Returns the exit code."""
    wine = shutil.which("wine64", path=os.pathsep.join([os.environ["PATH"], "/usr/lib/wine"]))
    if not wine or not importlib.util.find_spec("ziglang"):
        print("needs wine64 (apt-get install wine64) and ziglang (pip install ziglang)", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        program = folder / "replay.exe"
        subprocess.run([sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu", "-O1", "-Wall",
                        "-Werror", "-o", program, Path(__file__).with_name("replay.c")], check=True)
        libraries = windows_libraries(folder)
        with Recorder(folder / "calls") as recorder, contextlib.chdir(ROOT):
            failed = pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-m", "not slow", *tests])
        if failed:
            return 2
        exported = sorted(native_names())
        print(f"{len(recorder.names)} of {len(exported)} kernels were called; not: "
              f"{', '.join(sorted(set(exported) - recorder.names)) or 'none'}")
        environment = os.environ | {"WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"}
        codes = []
        for library in libraries:
            print(f"\n{library.name} in Wine:", flush=True)
            done = subprocess.run([wine, program, library, folder / "calls"], env=environment, stdout=subprocess.PIPE,
                                  text=True)
            print(done.stdout, end="")
            codes.append(done.returncode if done.returncode > 1 else int(differs(done.stdout)))
        subprocess.run([Path(wine).with_name("wineserver"), "-k"], env=environment)
    return max(codes)


def differs(said: str) -> bool:
    """Return whether any kernel differs by more than it may, by what replay.c says."""
    return any(int(wrong) and not float(worst) <= LAST_BITS.get(name, -1.0)
               for name, wrong, worst in re.findall(r"^(\w+): (\d+) of .* at most (\S+)$", said, re.M))


def native_names() -> set[str]:
    """Return the names of all kernels that can be called again; each declares its arguments in this system's library.
    """
    data = (ROOT / "engine/light_meshes" / native.library(sys.platform)).read_bytes()
    names = {name.removesuffix(b"_takes").decode() for name in data.split(b"\0") if name.endswith(b"_takes")}
    names = {name for name in names if not name.startswith(NOT_AGAIN)}
    return {name for name in names if not ADDRESSES.search(native.kernel(name).takes)}


if __name__ == "__main__":
    names = sys.argv[1:] or [str(ROOT / "tests/engine" / f"test_{name}.py") for name in TESTS]
    sys.exit(main(names))
