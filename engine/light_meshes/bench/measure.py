"""Take times: run the methods in turn on warm kernels, and keep the median, the smallest and the largest time.

A *frame* is the time of the picture without the preparing (triangles and accelerator), which is the same for all
methods. The *shadow stage* is the thread seconds that the statistics count for shadows. A frame of Cycles lasts from
before its first sample until after its last, and after the denoiser where it has one.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from ..picture.render import render_image
from ..scene.description import Scene
from .blender import Cycles
from .scenes import Case, sized

PREPARING = ("geometry", "accelerator")
NOT_SHADOWS = (*PREPARING, "camera rays", "secondary rays", "shading", "interpolation")
COUNTS = ("triangles", "receivers", "candidates", "nodes", "node_bytes", "node_share", "long_rays", "short_rays",
          "shadow_rays", "uniform_skips", "empty_sets", "threads")
Say = Callable[[str], None]
DENOISED, LAMP_SHAPE = "Cycles, denoised", "lamp shape"


@dataclass(frozen=True)
class Method:
    """A way to render the shadows of a scene."""

    kind: str  # RRTA, light meshes, lamp shape, area sampling, Cycles, or Cycles, denoised
    kI: float = 0.0
    h: float = 0.0
    samples: int = 0  # per light (area sampling) or per pixel (Cycles)

    @property
    def label(self) -> str:
        """Return the name for tables and figures."""
        if self.kind == LAMP_SHAPE:
            return f"{self.kind} kI {self.kI:g}"
        if self.kind == DENOISED:
            return f"Cycles {self.samples}, denoised"
        return f"{self.kind} kI {self.kI:g}, h {self.h:.3g}" if self.h else f"{self.kind} {self.samples or ''}".strip()

    @property
    def by_cycles(self) -> bool:
        """Return whether Cycles renders it."""
        return self.kind.startswith("Cycles")

    def applied(self, scene: Scene) -> Scene:
        """Return the scene as this method renders it."""
        if self.kind == LAMP_SHAPE:  # as a new scene has it: every lamp casts the shadow of its own shape
            scene = dataclasses.replace(scene, lights=tuple(
                dataclasses.replace(light, softness="SIZE") for light in scene.lights))
        return scene.with_settings(**self.settings())

    def settings(self) -> dict[str, Any]:
        """Return the settings for this engine."""
        if self.kind == "RRTA":
            return {"shadows": "SHARP"}
        if self.kind == "area sampling":
            return {"shadows": "AREA_SAMPLING", "light_samples": self.samples}
        if self.kind == LAMP_SHAPE:
            return {"shadows": "LIGHT_MESHES", "kI": self.kI, "auto_h": True, "weights": "SMOOTH"}
        return {"shadows": "LIGHT_MESHES", "h": self.h, "kI": self.kI, "auto_h": False}


@dataclass
class Measurement:
    """A method on a case at one size, with the runs that were made of it."""

    case: Case
    method: Method
    size: int  # the picture has size² pixels
    full: int  # the size for which the time is meant: times are scaled by (full/size)²
    samples: int = 1  # per pixel, for this engine
    cycles: Cycles | None = None
    most: float = 10.0  # the largest sum of seconds for its runs
    runs: list[dict[str, Any]] = field(default_factory=list)
    counts: dict[str, Any] = field(default_factory=dict)

    def once(self) -> None:
        """Make one more run."""
        if self.method.by_cycles:
            assert self.cycles is not None
            done = self.cycles.render(self.case, self.size, self.method.samples, denoise=self.method.kind == DENOISED)
            self.runs.append({"whole": done["whole"], "frame": done["sampling"], "shadow": done["sampling"]})
            return
        scene = self.method.applied(sized(self.case.scene, self.size, samples=self.samples))
        self.runs.append(timed(scene, self.counts))

    def row(self) -> dict[str, Any]:
        """Return the row for the results."""
        m, scale = self.method, (self.full / self.size) ** 2
        row = {"scene": self.case.name, "lights": self.case.lights, "method": m.kind, "label": m.label, "kI": m.kI,
               "h": m.h, "light_samples": m.samples, "size": self.full, "measured_size": self.size,
               "samples": self.samples, "runs": len(self.runs)}
        for what in self.runs[0]:
            times = [scale * run[what] for run in self.runs]
            row[what] = {"median": median(times), "min": min(times), "max": max(times)}
        return row | self.counts


def timed(scene: Scene, counts: dict[str, Any]) -> dict[str, float]:
    """Render once. Returns the seconds in total and without preparing, and the thread seconds of the shadow stage;
    fills `counts`.
    """
    report = render_image(scene).statistics
    counts |= {name: report[name] for name in COUNTS if name in report}
    counts["stages"] = report["stages"]
    return seconds(report)


def seconds(report: dict[str, Any]) -> dict[str, float]:
    """Return the same times from the statistics of a render."""
    stages = report["stages"]
    return {"whole": report["seconds"], "frame": report["seconds"] - sum(stages.get(n, 0.0) for n in PREPARING),
            "shadow": sum(seconds for name, seconds in stages.items() if name not in NOT_SHADOWS)}


def in_turn(what: list[Measurement], repeats: int, deadline: float, say: Say) -> list[dict[str, Any]]:
    """Return the rows of `what`. Each is run once in every round, until it has had its repeats or the time is used
    up.
    """
    warm: set[tuple[str, str]] = set()
    for m in what:
        key = (m.case.name, m.method.kind)
        if key not in warm and not m.method.by_cycles:
            warm.add(key)
            render_image(m.method.applied(sized(m.case.scene, 16)))
    for turn in range(repeats):
        for m in what:
            spent = sum(run["whole"] for run in m.runs)
            if turn and (spent * (turn + 1) / turn > m.most or time.monotonic() > deadline):
                continue
            m.once()
            last = m.runs[-1]
            say(f"{m.case.title}, {m.size}², {m.samples} a pixel, {turn + 1}: {m.method.label}: "
                f"{last['frame']:.2f} s, of it shadows {last['shadow']:.2f}")
    return [m.row() for m in what]
