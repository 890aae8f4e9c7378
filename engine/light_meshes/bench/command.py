"""The command `light-meshes bench`: run the parts, and write table.txt, results.json and the figures."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..scene.errors import SceneError
from ..support import console
from . import plots, tables
from .runs import FORMAT, QUICK, Effort, bench
from .targets import targets


def run(folder: Path, quick: bool, parts: Sequence[str], release: str = "") -> None:
    """Measure, write the results into `folder` after each part, and print the tables. `release`: see `runs.bench`.

    Without parts nothing is measured: the tables and figures are made again from the results in `folder`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()

    def say(line: str) -> None:
        console.say(f"[{time.monotonic() - started:6.0f} s] {line}", sys.stderr)

    def keep(results: dict[str, Any]) -> None:
        write(results, folder, quick)

    if not plots.available():
        say(plots.MISSING)
    if parts:
        results = bench(QUICK if quick else Effort(), parts, say, keep, release)
    else:
        results = read(folder)
    console.say(write(results, folder, results.get("quick", quick)))
    if plots.available():
        for path in plots.draw(results, folder):
            say(f"wrote {path}")


def write(results: dict[str, Any], folder: Path, quick: bool) -> str:
    """Write results.json and table.txt, and return the table."""
    results |= {"quick": quick, "targets": targets(results)}
    (folder / "results.json").write_text(json.dumps(results, indent=1, allow_nan=False), encoding="utf-8")
    said = tables.text(results)
    (folder / "table.txt").write_text(said, encoding="utf-8")
    return said


def read(folder: Path) -> dict[str, Any]:
    """Return the results of an earlier run."""
    path = folder / "results.json"
    if not path.is_file():
        raise SceneError(f"{path} does not exist: run the benchmark with the same --out first")
    results: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    if results.get("format") != FORMAT:
        raise SceneError(f"{path} was not written by this benchmark")
    return results
