"""Whole frames by this release and by an earlier one, in turn, each in a process of its own.

The earlier release is whatever `light_meshes` is in another Python, for example that of an environment into which a
checkout of it was installed. Each process exports the .blend files with its own add-on, since snapshots have other
contents in each release, and renders one frame whenever it is asked to.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import median
from types import TracebackType
from typing import Any, Self

from ..scene.errors import SceneError
from .measure import Say

REPEATS = 3
CASES: tuple[tuple[str, int | None], ...] = (("S3", None), ("S7", 16), ("S7", 64), ("S7", 256))  # scene, lights

# Of the first release, too: modules have other places there, and it compiles its kernels at its first frame.
_CHILD = """
import json, sys, time
from pathlib import Path
import light_meshes
from light_meshes.bench import scenes
try:
    from light_meshes.picture.render import render_image
except ImportError:
    from light_meshes.render import render_image
try:
    from light_meshes.support import allocation
    allocation.keep()
except ImportError:
    pass
print(json.dumps(light_meshes.__version__), flush=True)
loaded = {}
for line in sys.stdin:
    name, lights, size, samples = json.loads(line)
    key = name, lights
    if key not in loaded:
        loaded[key] = scenes.case(name, scenes.exported(name, Path(sys.argv[1], name)), lights).scene
        render_image(scenes.sized(loaded[key], 48, samples=1))
    scene = scenes.sized(loaded[key], size, samples=samples)
    wall, cpu = time.perf_counter(), time.process_time()
    render_image(scene)
    print(json.dumps([time.perf_counter() - wall, time.process_time() - cpu]), flush=True)
"""


class Renderer:
    """A process that renders frames of the benchmark's scenes with the release that `python` has. Use it in a `with`
    statement.
    """

    def __init__(self, python: str, folder: Path) -> None:
        """`folder` must exist; exported scenes are put there. Raises SceneError if there is no release to be had."""
        try:
            self._child = subprocess.Popen([python, "-P", "-c", _CHILD, str(folder)], stdin=subprocess.PIPE,
                                           stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace")
        except OSError as e:
            raise SceneError(f"{python} cannot be started: {e.strerror}") from e
        self.version = str(self._answer())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._child.kill()
        self._child.communicate()

    def frame(self, name: str, lights: int | None, size: int, samples: int) -> list[float]:
        """Render the scene with its first `lights` lights (None: all) in size² pixels; return seconds, and CPU seconds.

        The first call for a scene exports it and renders a small picture first, which does not count.
        """
        assert self._child.stdin is not None
        self._child.stdin.write(json.dumps([name, lights, size, samples]) + "\n")
        self._child.stdin.flush()
        found: list[float] = self._answer()
        return found

    def _answer(self) -> Any:
        assert self._child.stdout is not None
        line = self._child.stdout.readline()
        if line:
            return json.loads(line)
        said = self._child.communicate()[1].strip().splitlines()
        raise SceneError(f"the release to compare with ended: {said[-1] if said else 'it did not say why'}")


def table(python: str, size: int, samples: int, say: Say,
          cases: Sequence[tuple[str, int | None]] = CASES) -> dict[str, Any]:
    """Return the versions, and for each case the time of this release divided by that of `python`'s, also of CPU time.

    These are ratios of medians of REPEATS frames of size² pixels, of which each release renders one in turn.
    """
    with ExitStack() as stack:
        folders = [Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="light-meshes-"))) for _ in range(2)]
        both = [stack.enter_context(Renderer(p, folder))
                for p, folder in zip((python, sys.executable), folders, strict=True)]
        rows = []
        for name, lights in cases:
            times: list[list[list[float]]] = [[], []]
            for turn in range(REPEATS):
                for which in (0, 1) if turn % 2 else (1, 0):
                    times[which].append(both[which].frame(name, lights, size, samples))
            wall, cpu = (median(run[kind] for run in times[1]) / median(run[kind] for run in times[0])
                         for kind in (0, 1))
            title = f"{name}, {lights or 1} light{'s' * ((lights or 1) > 1)}"
            rows.append({"title": title, "seconds": wall, "cpu": cpu})
            say(f"{title}, {size}², {samples} a pixel: {wall:.2f} of the time of {both[0].version}, CPU {cpu:.2f}")
        return {"versions": [one.version for one in both], "rows": rows}
