"""Measure what `shadow_rate` saves and how it changes the picture: times at several rates compared with RRTA, and
errors against rate 1.
"""

from __future__ import annotations

from statistics import median
from typing import Any

import numpy as np

from ..picture.render import render_image
from .measure import Say, seconds
from .scenes import Case, sized

RATES = (1, 2, 4, 8)
SHARES = ("interpolated", "refined", "computed")


def table(case: Case, size: int, repeats: int, sharp: bool, say: Say, samples: int = 4) -> list[dict[str, Any]]:
    """Return the rows of a case: seconds of the frame, and the errors that the rate adds. If `sharp`, there is a row
    for RRTA too (rate 0).
    """
    scene = sized(case.scene, size, samples=samples)
    ways = {rate: scene.with_settings(shadow_rate=rate) for rate in RATES}
    if sharp:
        ways = {0: scene.with_settings(shadows="SHARP")} | ways
    frames: dict[int, list[float]] = {rate: [] for rate in ways}
    pictures, reports = {}, {}
    for way in ways.values():
        render_image(sized(way, 48))  # warm the kernels up
    for turn in range(repeats):
        for rate, way in ways.items():
            done = render_image(way)
            frames[rate].append(seconds(done.statistics)["frame"])
            pictures[rate], reports[rate] = done.passes["Combined"][..., :3].astype(np.float64), done.statistics
            say(f"{case.title}, {size}², {samples} a pixel, {turn + 1}: "
                f"{f'shadow rate {rate}' if rate else 'RRTA'}: {frames[rate][-1]:.2f} s")
    rows = []
    for rate, times in frames.items():
        row = {"scene": case.name, "lights": case.lights, "rate": rate, "size": size, "samples": samples,
               "frame": {"median": median(times), "min": min(times), "max": max(times)}}
        if rate:
            difference, counts = np.abs(pictures[rate] - pictures[1]), [reports[rate].get(name, 0) for name in SHARES]
            row |= {"rmse": float(np.sqrt((difference**2).mean())), "max": float(difference.max())}
            row |= {name: n / max(sum(counts), 1) for name, n in zip(SHARES, counts, strict=True)}
        rows.append(row)
    return rows
