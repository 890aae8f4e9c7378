"""The parts of a benchmark, which run one after the other in one process."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

from ..picture.render import render_image
from ..scene import snapshot
from ..scene.description import Scene
from . import decisions, errors, lamps, rates, release, scenes, threads
from .blender import Cycles
from .embree import ShadowRays
from .measure import DENOISED, LAMP_SHAPE, NOT_SHADOWS, Measurement, Method, Say, in_turn
from .scenes import Case

SCENES = tuple(scenes.FILES)
PARTS = (*SCENES, "cycles", "errors", "lamps", "growth", "rates", "embree", "process", "threads", "decisions",
         "release")
FORMAT = "light-meshes benchmark"


@dataclass(frozen=True)
class Effort:
    """The amount of work of a benchmark: how much is measured, and for how long."""

    size: int = 1000  # pictures whose time is taken have size² pixels
    repeats: int = 5
    lights: tuple[int, ...] = (1, 4, 16, 64, 256)  # of S7
    kI: tuple[float, ...] = (1.5, 2.0, 3.0, 4.0)  # at the same r
    shapes: tuple[float, ...] = (3.0, 4.0)  # kI of lamps with the shadow of their own shape: Balanced, Fine
    steps: tuple[float, ...] = (2.0, 0.5)  # factors for the scene's h, at its kI
    samples: tuple[int, ...] = (1, 4, 16, 64)  # of area sampling and Cycles
    all_samples: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)  # the same on S3
    error_size: int = 120  # pictures whose error is taken have error_size² pixels
    cycles_reference: int = 512  # samples per pixel
    triangles: tuple[int, ...] = (10_000, 30_000, 100_000, 300_000, 1_000_000, 2_000_000)
    growth_lights: int = 16
    rate_lights: int = 64
    most: float = 10.0  # seconds for all runs of a method on a scene after the first run
    most_target: float = 150.0  # the same for the methods of the targets
    seconds: float = 2400.0  # seconds for the whole benchmark: a part that has used its share makes no second runs


QUICK = Effort(size=250, repeats=3, lights=(4, 16, 64), kI=(2.0,), steps=(), samples=(1, 4, 16), all_samples=(1, 4, 16),
               error_size=60, cycles_reference=64, triangles=(10_000, 100_000), most=2.0, most_target=6.0,
               seconds=120.0)
QUICK_PARTS = ("S3", "S7", "cycles", "errors", "lamps", "embree", "process", "threads")
SHARES = {"S3": 0.12, "S5": 0.08, "S7": 0.5, "S8": 0.08, "growth": 0.1, "embree": 0.04}  # of the seconds


class Bench:
    """One run of the benchmark; `results` is the content of results.json."""

    def __init__(self, effort: Effort, parts: Sequence[str], folder: Path, say: Say, release: str = "") -> None:
        """`folder` is for exported scenes, which are needed as long as this object lives. release: see `bench`."""
        self.effort, self.parts, self._folder, self._say, self._release = effort, parts, folder, say, release
        self._loaded: dict[str, Scene] = {}
        self.results: dict[str, Any] = {
            "format": FORMAT, "version": 1, "machine": machine(), "effort": dataclasses.asdict(effort),
            "parts": list(parts), "scenes": [], "times": [], "errors": [], "lamps": [], "growth": [], "rates": [],
            "embree": None, "process": None, "threads": None, "decisions": [], "release": None, "notes": []}
        self.threads = os.cpu_count() or 1

    def run(self, keep: Callable[[], None] = lambda: None) -> None:
        """Run all parts that were asked for; `keep` is called after each part."""
        started = time.monotonic()
        with contextlib.ExitStack() as stack:
            cycles = None
            if "cycles" in self.parts and set(self.parts) & {*SCENES, "lamps"}:
                cycles = stack.enter_context(Cycles())
            for part in self.parts:
                if part in SCENES:
                    self._scene(part, cycles)
                elif part == "lamps":
                    loaded = {name: self._scene_of(name) for name in ("S3", "S7")}
                    self.results["lamps"] = lamps.table(loaded, self.effort.size, self.effort.repeats, cycles,
                                                        self.effort.samples, self._say)
                elif part == "growth":
                    self._growth()
                elif part == "rates":
                    timed = scenes.case("S7", self._scene_of("S7"), self.effort.rate_lights)
                    self.results["rates"] += rates.table(timed, self.effort.size, self.effort.repeats, True, self._say)
                    for name in ("S3", "S5", "S8"):
                        case = scenes.case(name, self._scene_of(name))
                        self.results["rates"] += rates.table(case, self.effort.size // 2, 1, False, self._say)
                elif part == "embree":
                    self._embree()
                elif part == "process":
                    self._process()
                elif part == "threads":
                    self._threads()
                elif part == "release" and self._release:
                    self.results["release"] = release.table(self._release, self.effort.size, 4, self._say)
                elif part == "decisions":
                    self._say("decisions of the plan")
                    many, glass, still = (scenes.sized(s, self.effort.size // 2, samples=1) for s in (
                        scenes.case("S7", self._scene_of("S7"), 16).scene, self._scene_of("S5"), self._scene_of("S8")))
                    self.results["decisions"] = decisions.table(many, glass, still, self.effort.repeats, self._say)
                self.results["seconds"] = time.monotonic() - started
                keep()
            if cycles:
                self.results["machine"]["Blender"] = cycles.version

    def _scene_of(self, name: str) -> Scene:
        if name not in self._loaded:
            self._say(f"{name}: {scenes.FILES[name]}.blend")
            self._loaded[name] = scenes.exported(name, self._folder / name)
        return self._loaded[name]

    def _deadline(self, part: str, share: float = 1.0) -> float:
        return time.monotonic() + share * SHARES[part] * self.effort.seconds

    def _methods(self, case: Case, with_cycles: bool) -> list[Method]:
        s, e = case.scene.settings, self.effort
        r, counts = scenes.radius(case.scene), e.all_samples if case.name == "S3" else e.samples
        light_meshes = {kI: Method("light meshes", kI, r / kI) for kI in (*e.kI, s.kI)}
        light_meshes |= {-step: Method("light meshes", s.kI, s.h * step) for step in e.steps}
        methods = [Method("RRTA"), *light_meshes.values()]
        if case.name != "S5":  # area sampling does not bend shadow rays, and Cycles has no such glass
            methods += [Method(LAMP_SHAPE, kI) for kI in e.shapes]
            methods += [Method("area sampling", samples=n) for n in counts]
            methods += [Method(kind, samples=n) for n in counts for kind in ("Cycles", DENOISED) if with_cycles]
        return methods

    def _scene(self, name: str, cycles: Cycles | None) -> None:
        e, loaded = self.effort, self._scene_of(name)
        cases = [scenes.case(name, loaded, n) for n in (e.lights if name == "S7" else (None,))]
        for case in cases:
            s = case.scene.settings
            self.results["scenes"].append({
                "scene": name, "title": case.title, "lights": case.lights, "file": case.file.name, "h": s.h, "kI": s.kI,
                "r": scenes.radius(case.scene), "mode": s.mode, "sizes": case.rule})
        deadline = self._deadline(name)
        for case in cases:
            self._times(case, cycles, deadline)
        for case in cases if "errors" in self.parts else ():
            self._errors(case, cycles)

    def _times(self, case: Case, cycles: Cycles | None, deadline: float) -> None:
        e, own = self.effort, case.scene.settings.kI
        measured = []
        for method in self._methods(case, cycles is not None):
            target = method.kind == "RRTA" or (method.kI == own and abs(method.h - case.scene.settings.h) < 1e-9)
            most = e.most_target if target else e.most
            several = target or (method.kind == "light meshes" and case.lights <= 16)
            for samples in (1, 4) if several else (1,):
                measured.append(Measurement(case, method, _affordable(e.size, case, method, samples), e.size,
                                            samples, cycles, most))
        self.results["times"] += in_turn(measured, e.repeats, deadline, self._say)

    def _errors(self, case: Case, cycles: Cycles | None) -> None:
        size = self.effort.error_size // (2 if case.lights > 64 else 1)
        base = scenes.sized(case.scene, size, samples=1)
        self._say(f"{case.title}, {size}²: references")
        partly = errors.penumbra(base)
        half_ball, sphere = errors.half_ball(base), errors.sphere(base)
        references = {"RRTA": errors.picture(base.with_settings(shadows="SHARP")),
                      "HALF_BALL": errors.picture(half_ball)}
        about = {"scene": case.name, "lights": case.lights, "size": size, "in_penumbra": float(partly.mean())}
        if case.name != "S5":
            references["SPHERE"] = errors.picture(sphere)
        if cycles:
            by_cycles = cycles.picture(case, size, self.effort.cycles_reference, seed=1)
            if case.name in scenes.MATCHED:  # in other scenes the materials look different in Cycles
                self.results["errors"].append(about | {
                    "method": "Cycles' reference", "label": f"Cycles {self.effort.cycles_reference}", "kI": 0, "h": 0,
                    "light_samples": 0, "reference": "SPHERE",
                    **errors.compare(by_cycles, references["SPHERE"], partly)})
        for method in self._methods(case, cycles is not None):
            if method.by_cycles:
                assert cycles is not None
                found = cycles.picture(case, size, method.samples, denoise=method.kind == DENOISED)
                held = {"CYCLES": by_cycles}
            else:
                found = errors.picture(method.applied(base))
                if method.kind == LAMP_SHAPE and "LAMPS" not in references:  # whose light is that of the whole lamp
                    references["LAMPS"] = errors.picture(lamps.sized(sphere))
                held = {"LAMPS": references["LAMPS"]} if method.kind == LAMP_SHAPE else {
                    k: v for k, v in references.items() if k not in (method.kind, "LAMPS")}
            for name, reference in held.items():
                self.results["errors"].append(about | {
                    "method": method.kind, "label": method.label, "kI": method.kI, "h": method.h,
                    "light_samples": method.samples, "reference": name, **errors.compare(found, reference, partly)})
            self._say(f"{case.title}, {size}²: error of {method.label}")
        self.results["notes"].append(
            f"{case.title}: errors at {size}², references of light meshes with kI {half_ball.settings.kI:g} and of "
            f"{sphere.settings.light_samples} samples of each light")

    def _growth(self) -> None:
        e, loaded = self.effort, self._scene_of("S7")
        s = loaded.settings
        methods = Method("RRTA"), Method("light meshes", s.kI, s.h)
        whole = scenes.case("S7", loaded, e.growth_lights)
        for size in (e.size // 2, e.size, 2 * e.size):
            measured = [Measurement(whole, m, size, size, most=3 * e.most) for m in methods]
            self.results["growth"] += [{"by": "pixels", "at": size**2, **row} for row in in_turn(
                measured, e.repeats, self._deadline("growth", 0.2), self._say)]
        for triangles in e.triangles:
            case = dataclasses.replace(whole, scene=scenes.hall(whole.scene, triangles))
            measured = [Measurement(case, m, e.size // 2, e.size // 2, most=3 * e.most) for m in methods]
            self.results["growth"] += [{"by": "triangles", "at": row["triangles"], **row} for row in in_turn(
                measured, e.repeats, self._deadline("growth", 0.1), self._say)]

    def _embree(self) -> None:
        """Measure RRTA's shadow stage relative to Embree alone, in turn."""
        case = scenes.case("S7", self._scene_of("S7"), 4)
        scene = scenes.sized(case.scene, self.effort.size, shadows="SHARP", samples=1)
        tile = 128
        rays = ShadowRays(scene, tile)
        alone, stage = [], []
        for _ in range(self.effort.repeats):
            alone.append(rays.trace(self.threads))
            stages = render_image(scene, tile_size=tile).statistics["stages"]
            stage.append(sum(seconds for name, seconds in stages.items() if name not in NOT_SHADOWS))
            self._say(f"{case.title}: shadow stage {stage[-1]:.3f} thread seconds, Embree alone {alone[-1]:.3f}")
        self.results["embree"] = {"rays": rays.count, "shadow_stage": stage, "embree_alone": alone,
                                  "ratio": median(stage) / median(alone), "threads": self.threads}

    def _threads(self) -> None:
        """Measure how much of the tile loop holds Python's lock, and whether preparing uses all threads."""
        e, shares = self.effort, {}
        for name, count in [("S3", None), *(("S7", n) for n in e.lights if n >= 16)]:
            case = scenes.case(name, self._scene_of(name), count)
            shares[case.title] = threads.lock_share(scenes.sized(case.scene, e.size, samples=4))
            self._say(f"{case.title}, {e.size}², 4 a pixel: Python's lock is held {shares[case.title] or 0:.1%}")
        large = scenes.hall(scenes.case("S7", self._scene_of("S7"), e.growth_lights).scene, max(e.triangles))
        found = threads.preparing(scenes.sized(large, 2 * e.size, samples=4))
        self.results["threads"] = {"lock": shares, "preparing": found}
        self._say("{triangles:,} triangles: accelerator {accelerator[seconds]:.2f} s, certificate "
                  "{certificate[seconds]:.2f}".format(**found))

    def _process(self) -> None:
        """Measure the first render of a process, and its later ones."""
        scene = scenes.sized(self._scene_of("S3"), min(250, self.effort.size), samples=1)
        folder = self._folder / "process"
        snapshot.write(scene, folder)
        done = []
        for _ in range(min(3, self.effort.repeats)):
            child = subprocess.run([sys.executable, "-P", "-c", _FIRST, str(folder)], capture_output=True, text=True,
                                   check=True)
            done.append(json.loads(child.stdout))
            self._say("a fresh process: imports {import:.2f} s, first render {first:.2f}, later {later:.2f}".format(
                **done[-1]))
        self.results["process"] = {name: median(d[name] for d in done) for name in done[0]}


_FIRST = """
import json, sys, time
from pathlib import Path
t = [time.perf_counter()]
from light_meshes.scene import snapshot
from light_meshes.picture.render import render_image
t.append(time.perf_counter())
scene = snapshot.read(Path(sys.argv[1]))
t.append(time.perf_counter())
for _ in range(4):
    render_image(scene)
    t.append(time.perf_counter())
d = [b - a for a, b in zip(t, t[1:])]
print(json.dumps({"import": d[0], "first": d[2], "later": sorted(d[3:])[1]}))
"""


def _affordable(size: int, case: Case, method: Method, samples: int) -> int:
    """Return the edge of the picture to measure: the full one, or half of it as often as necessary. Time grows with the
    area.
    """
    if method.by_cycles:
        rays, most = float(method.samples), 4e6
    elif method.kind == "area sampling":
        rays, most = method.samples * case.lights / 2, 1e8
    elif method.kind == "RRTA" and case.scene.settings.refraction == "FULL":  # this solves for paths at each sample
        rays, most = float(samples), 3e5
    else:
        return size
    while size >= 128 and size**2 * rays > most:
        size //= 2
    return size


def machine() -> dict[str, Any]:
    """Return a description of the machine and the software."""
    name = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):
        models = [line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines()
                  if line.startswith("model name")]
        name = models[0] if models else name
    packages = {p: version(p) for p in ("light-meshes", "numpy", "embreex")}
    return {"processor": name, "cores": os.cpu_count(), "system": f"{platform.system()} {platform.machine()}",
            "Python": platform.python_version(), **packages, "when": time.strftime("%Y-%m-%d %H:%M:%S")}


def bench(effort: Effort, parts: Sequence[str], say: Say, keep: Callable[[dict[str, Any]], None],
          release: str = "") -> dict[str, Any]:
    """Run the parts. `keep` gets the results after each of them, complete or not. `release`: the Python that has an
    earlier release, for the part of that name; "" skips that part.
    """
    with tempfile.TemporaryDirectory(prefix="light-meshes-") as folder:
        made = Bench(effort, parts, Path(folder), say, release)
        made.run(lambda: keep(made.results))
        return made.results
