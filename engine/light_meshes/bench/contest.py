"""The command `light-meshes contest`: compare time and error with Cycles, to see which engine an artist would choose.

Scenes of `blend_scenes/contest` are rendered by this engine at Draft, Balanced and Fine, and by Cycles with several
numbers of samples, with and without its denoiser, with the same bounces. All are judged against Cycles with many
samples (`judge`). OUT keeps every picture, so that a run that was interrupted, or asks for more, goes on where it
was. After each cell OUT/contest.json and OUT/contest.md are written again, and in the end the figure of error against
time, if matplotlib is there. Scenes that an earlier run in OUT measured at the same size and frame stay in both, so
that scenes may be run one by one, each with its own samples.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..support import console
from . import cells, contest_tables, crops, judge, plots
from .cells import Cell, Way
from .runs import machine

SCENES = ("still_life", "room", "night_hall", "stage", "product", "street", "forest", "exhibition")
LEVELS = ("DRAFT", "BALANCED", "FINE")
FORMAT, VERSION = "light-meshes contest", 2  # of contest.json
FLOOR = 8  # the flight's three frames of many samples have the reference's divided by this
Say = Callable[[str], None]


@dataclass(frozen=True)
class Task:
    """The settings of a contest: its scenes, sizes, methods and limits."""

    scenes: tuple[str, ...] = SCENES
    size: tuple[int, int] = (1920, 1080)
    levels: tuple[str, ...] = LEVELS
    samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64, 128, 256)
    reference: int = 4096  # samples
    frame: int = 10  # of the still
    flight: int = 20  # frames of the flight, from the first; 0: no flicker
    blender: str | None = None  # the program; None: bpy
    patience: float = 3600.0  # seconds for a cell

    def ways(self) -> list[Way]:
        """Return the methods that compete, cheap ones first."""
        by_cycles = [Way("CYCLES", samples=n, denoise=denoise) for n in self.samples for denoise in (True, False)]
        return [*(Way("LIGHT_MESHES", level) for level in self.levels), *by_cycles]


def run(task: Task, out: Path) -> dict[str, Any]:
    """Run the contest, and return what contest.json holds."""
    out.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()

    def say(line: str) -> None:
        console.say(f"[{time.monotonic() - started:6.0f} s] {line}", sys.stderr)

    if not judge.available():
        say(judge.MISSING)
    cells.make_scenes(list(task.scenes), out, task.blender)
    results: dict[str, Any] = {"format": FORMAT, "version": VERSION, "machine": machine(), "size": task.size,
                               "frame": task.frame, "scenes": _earlier(task, out)}
    for name in task.scenes:
        match = Match(task, name, out, say, results)
        match.stills()
        if task.flight >= 3:
            match.flight()
        match.show()
    console.say(write(results, out))
    if plots.available():
        plots.contest(results, out / f"contest_{task.size[0]}x{task.size[1]}")
    return results


def _earlier(task: Task, out: Path) -> dict[str, Any]:
    """Return what contest.json in OUT says of scenes that this run leaves out, if it is of the same size and frame."""
    try:
        found = json.loads((out / "contest.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    same = {"format": FORMAT, "version": VERSION, "size": list(task.size), "frame": task.frame}
    if not isinstance(found, dict) or any(found.get(key) != value for key, value in same.items()):
        return {}
    return {name: scene for name, scene in found["scenes"].items() if name not in task.scenes}


def write(results: dict[str, Any], out: Path) -> str:
    """Write contest.json and contest.md, and return the latter's text."""
    results["scenes"] = {name: results["scenes"][name] for name in SCENES if name in results["scenes"]}
    text = contest_tables.text(results)
    (out / "contest.json").write_text(json.dumps(results, indent=1, allow_nan=False), encoding="utf-8")
    (out / "contest.md").write_text(text, encoding="utf-8")
    return text


class Match:
    """All ways on one scene; `found` is the scene's part of contest.json."""

    def __init__(self, task: Task, name: str, out: Path, say: Say, results: dict[str, Any]) -> None:
        self.task, self.name, self._out, self._say, self._results = task, name, out, say, results
        self.found: dict[str, Any] = {"reference": task.reference, "rows": {}, "failed": [], "flight": {}}
        results["scenes"][name] = self.found
        self._errors: dict[str, NDArray[np.float32]] = {}  # of each pixel

    def stills(self) -> None:
        """Render the reference, the guides (what each pixel sees) and a still by every way. Judge each still as soon as
        it is done.
        """
        guides = self._render(Way("GUIDES"), (self.task.frame,))
        true = self._render(Way("CYCLES", samples=self.task.reference, reference=True), (self.task.frame,))
        if guides is None or true is None:
            return
        self.found |= {"exposure": true["exposure"], "reference_seconds": true["frames"][0]["seconds"],
                       "version": true["version"]}
        edge = judge.edges(judge.read_guides(self._cell(Way("GUIDES")).picture(self._out, self.task.frame),
                                             guides["frames"][0]["to_pixel"]))
        reference = judge.read(self.picture(self.reference))
        for way in self.task.ways():
            done = self._render(way, (self.task.frame,))
            if done is None:
                continue
            errors, self._errors[way.name] = judge.compare(reference, judge.read(self.picture(way)), edge,
                                                           true["exposure"])
            frame = done["frames"][0]
            self.found["rows"][way.name] = errors | {
                "label": way.label, "engine": way.engine, "level": way.level, "samples": way.samples,
                "denoise": way.denoise, "seconds": frame["seconds"], "processor": frame["processor"],
                "memory": done.get("memory"), "warnings": done["warnings"]}
            self._say(f"{self.name}: {way.label}: {frame['seconds']:.2f} s, " + ", ".join(
                f"{key} {errors[key]:.4f}" for key in ("flip", "rmse") if key in errors))
            write(self._results, self._out)

    @property
    def reference(self) -> Way:
        """Return the way that counts as the truth."""
        return Way("CYCLES", samples=self.task.reference, reference=True)

    def picture(self, way: Way, suffix: str = ".exr") -> Path:
        """Return the path of a way's still."""
        return self._cell(way).picture(self._out, self.task.frame, suffix)

    def flight(self) -> None:
        """Measure the flicker of Balanced and, with the denoiser, of Cycles at equal error and at equal time; and of
        three frames that have next to no noise, the floor of the measure.
        """
        frames = tuple(range(1, self.task.flight + 1))
        rows = self.found["rows"]
        if "balanced" not in rows:
            return
        rivals = {contest_tables.equal_error(rows), contest_tables.equal_time(rows)} - {None}
        guides = self._render(Way("GUIDES"), frames)
        if guides is None:
            return
        seen = [judge.read_guides(self._cell(Way("GUIDES"), frames).picture(self._out, f["frame"]), f["to_pixel"])
                for f in guides["frames"]]
        # What would flicker without noise, as textures between pixels do: three frames of many samples.
        floor = Way("CYCLES", samples=max(1, self.task.reference // FLOOR), reference=True)
        for way in [floor, *(w for w in self.task.ways() if w.name in rivals | {"balanced"})]:
            these = frames[:3] if way is floor else frames
            done = self._render(way, these)
            if done is None:
                continue
            shown = [judge.read(self._cell(way, these).picture(self._out, n)) for n in these]
            seconds = [f["seconds"] for f in done["frames"]]
            measured = judge.flicker(shown, seen[:len(these)], self.found["exposure"])
            self.found["flight"]["floor" if way is floor else way.name] = measured | {
                "label": way.label, "seconds": float(np.median(seconds)), "first": seconds[0]}
            self._say(f"{self.name}: {way.label}: flicker {measured.get('flicker', 0):.5f}")
            write(self._results, self._out)

    def show(self) -> None:
        """Write crops at equal time and at equal error beside each other, and the errors' pictures."""
        rows = self.found["rows"]
        if "balanced" not in rows:
            return
        rivals = [contest_tables.equal_time(rows), contest_tables.equal_error(rows)]
        chosen = [self.reference, *(w for w in self.task.ways() if w.name == "balanced"),
                  *(w for name in dict.fromkeys(rivals) for w in self.task.ways() if w.name == name)]
        path = self._out / f"{self.name}_{self.task.size[0]}x{self.task.size[1]}.png"
        crops.sheet([self.picture(way, ".png") for way in chosen], [self._errors.get(w.name) for w in chosen], path)
        columns = ["reference", *(rows[w.name]["label"] for w in chosen[1:])]
        self.found["sheet"] = {"file": path.name, "columns": columns}
        write(self._results, self._out)

    def _cell(self, way: Way, frames: tuple[int, ...] | None = None) -> Cell:
        return Cell(self.name, way, self.task.size, frames or (self.task.frame,))

    def _render(self, way: Way, frames: tuple[int, ...]) -> dict[str, Any] | None:
        cell = self._cell(way, frames)
        done = cells.run(cell, self._out, self.task.blender, os.cpu_count() or 1, self.task.patience)
        if done is None:
            where = cell.folder(self._out) / cells.ERROR
            self.found["failed"].append({"label": way.label, "frames": frames, "why": where.read_text("utf-8")[-300:]})
            self._say(f"{self.name}: {way.label}: failed, see {where}")
            write(self._results, self._out)
        return done
