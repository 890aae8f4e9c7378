"""Lamps with a size against their rivals: whole frames of 4 samples a pixel, timed in turn, and errors in a window.

Every method is asked for the same light: lamps of softness SIZE, also area sampling, which is the reference with many
rays; only *sharp* has point lamps, as a scene without soft shadows would. Errors are of a window of the very picture
whose time is taken, because how dense receivers stand decides what nodes and what rays answer. Cycles is compared with
Cycles of many samples in the same window, as it places its samples in pixels in another way. Errors are of linear
light, over the mean of the reference; HDR-FLIP also away from the edges of objects, where only anti-aliasing counts.
"""

from __future__ import annotations

import dataclasses
import time
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..picture.render import render_image
from ..scene.description import Camera, Scene
from . import judge, scenes
from .blender import Cycles
from .measure import DENOISED, LAMP_SHAPE, Method, Say, seconds
from .scenes import Case

SAMPLES = 4  # of a pixel
SHARP, FOUR, SIXTEEN = Method("RRTA"), Method("area sampling", samples=4), Method("area sampling", samples=16)
BALANCED, FINE = Method(LAMP_SHAPE, 3.0), Method(LAMP_SHAPE, 4.0)
RAYS = 256  # of the reference, a pixel and lamp
REFERENCE = 512  # samples of Cycles' reference
PASSES = ("Combined", "Position", "Normal", "Object Index")


class Plan(NamedTuple):
    """The rules by which a case is measured."""

    name: str
    lights: int
    part: float  # of the picture's width and height that is timed, its middle
    window: float  # of which errors are taken
    rounds: int
    cycles: bool


PLANS = (Plan("S3", 1, 1.0, 0.4, 5, True), Plan("S7", 16, 1.0, 0.3, 2, True), Plan("S7", 64, 0.5, 0.2, 2, True),
         Plan("S7", 256, 0.3, 0.08, 1, False), Plan("clutter", 16, 0.5, 0.3, 2, False))


def table(loaded: dict[str, Scene], size: int, rounds: int, cycles: Cycles | None, counts: tuple[int, ...],
          say: Say) -> list[dict[str, Any]]:
    """Measure all plans at size² pixels, each method `rounds` times at most; returns a row a case and method.

    loaded: the scenes by name. counts: the samples of Cycles, None without it.
    """
    rows: list[dict[str, Any]] = []
    for plan in PLANS:
        case = scenes.clutter(plan.lights) if plan.name == "clutter" else scenes.case(
            plan.name, loaded[plan.name], plan.lights)
        rows += _ours(plan, case, size, rounds, say)
        if cycles is not None and plan.cycles:
            rows += _by_cycles(plan, case, size, counts, cycles, say)
    return rows


def _window(camera: Camera) -> tuple[float, ...]:
    """Return the crop of a camera for Cycles, a little inside of its pixels, however Blender rounds."""
    x0, y0, x1, y1 = camera.crop or (0, 0, camera.width, camera.height)
    width, height = camera.width, camera.height
    return tuple((at + 1e-3) / size for at, size in ((x0, width), (y0, height), (x1, width), (y1, height)))


def middle(scene: Scene, size: int, part: float) -> Scene:
    """Return the scene with the middle `part` of its picture of size² pixels."""
    whole = scenes.sized(scene, size, samples=SAMPLES)
    width, height = whole.camera.width, whole.camera.height
    low, high = 0.5 - part / 2, 0.5 + part / 2
    crop = (round(low * width), round(low * height), round(high * width), round(high * height))
    return dataclasses.replace(whole, camera=dataclasses.replace(whole.camera, crop=None if part == 1 else crop))


def sized(scene: Scene) -> Scene:
    """Return the scene with lamps that have a size, where the method does not say so itself."""
    return dataclasses.replace(scene, lights=tuple(
        dataclasses.replace(light, softness="SIZE") for light in scene.lights))


def _ours(plan: Plan, case: Case, size: int, rounds: int, say: Say) -> list[dict[str, Any]]:
    methods = SHARP, FOUR, SIXTEEN, BALANCED, FINE
    timed, window = (middle(case.scene, size, part) for part in (plan.part, plan.window))
    small = middle(case.scene, size, 0.02)
    reference = render_image(sized(window).with_settings(
        shadows="AREA_SAMPLING", light_samples=RAYS // SAMPLES, seed=7), PASSES).passes
    edge = edges(window, reference)
    truth = reference["Combined"][..., :3]
    runs: dict[Method, list[dict[str, float]]] = {m: [] for m in methods}
    for method in methods:
        render_image(_applied(method, small))
    for turn in range(min(rounds, plan.rounds)):
        for method in methods:
            cpu, done = time.process_time(), render_image(_applied(method, timed)).statistics
            runs[method].append(seconds(done) | {"cpu": time.process_time() - cpu})
            say(f"{case.title}, {turn + 1}: {method.label}: {runs[method][-1]['frame']:.2f} s")
    rows = []
    for method in methods:
        found = render_image(_applied(method, window)).passes["Combined"][..., :3]
        rows.append(_row(plan, case, method, size, runs[method]) | errors(truth, found, edge))
        say(f"{case.title}: error of {method.label}: {rows[-1]['rmse_whole']:.5f} of the mean")
    return rows


def _applied(method: Method, scene: Scene) -> Scene:
    return method.applied(scene if method == SHARP else sized(scene))


def _by_cycles(plan: Plan, case: Case, size: int, counts: tuple[int, ...], cycles: Cycles,
               say: Say) -> list[dict[str, Any]]:
    window = middle(case.scene, size, plan.window)
    box = _window(window.camera)
    truth = cycles.picture(case, size, REFERENCE, seed=1, window=box)
    edge = edges(window, render_image(window.with_settings(shadows="NONE"), PASSES).passes)
    rows = []
    for kind in ("Cycles", DENOISED):
        for count in counts:
            method, least = Method(kind, samples=count), size
            while least >= 128 and least**2 * count > 4e6:  # time grows with the area
                least //= 2
            scale = (size / least) ** 2 * plan.part**2
            done = cycles.render(case, least, count, denoise=kind == DENOISED)
            found = cycles.picture(case, size, count, denoise=kind == DENOISED, window=box)
            run = {"frame": scale * done["sampling"], "whole": scale * done["whole"], "shadow": 0.0, "cpu": 0.0}
            rows.append(_row(plan, case, method, size, [run]) | errors(truth, found, edge))
            say(f"{case.title}: {method.label}: {run['frame']:.2f} s, error {rows[-1]['rmse_whole']:.5f}")
    return rows


def _row(plan: Plan, case: Case, method: Method, size: int, runs: list[dict[str, float]]) -> dict[str, Any]:
    return {"scene": plan.name, "lights": plan.lights, "title": case.title, "method": method.kind,
            "label": method.label, "kI": method.kI, "light_samples": method.samples, "size": size, "part": plan.part,
            "window": plan.window, "runs": len(runs), "frame": median(r["frame"] for r in runs),
            "cpu": median(r["cpu"] for r in runs)}


def errors(truth: NDArray, found: NDArray, edge: NDArray[np.bool_]) -> dict[str, float]:
    """Return `judge.compare`, with RMSE over the mean of the reference."""
    seen, _ = judge.compare(np.asarray(truth, np.float32), np.asarray(found, np.float32), edge)
    mean = max(float(truth.mean()), 1e-30)
    return seen | {"rmse": seen["rmse"] / mean, "rmse_whole": seen["rmse_whole"] / mean}


def edges(scene: Scene, passes: dict[str, NDArray]) -> NDArray[np.bool_]:
    """Return the pixels near edges of objects, from the passes of a picture."""
    camera = scene.camera
    left, right, _, _ = camera.window
    back = np.linalg.inv(np.asarray(camera.matrix, np.float64))
    depth = -back[2] if camera.perspective else np.array([0.0, 0.0, 0.0, 1.0])
    across = camera.width * (back[0] - left * depth) / (right - left)
    to_pixel = np.stack([across, np.zeros(4), np.zeros(4), depth])
    normal = passes["Normal"]
    there = (normal**2).sum(-1) > 0
    guides = judge.Guides(passes["Position"].astype(np.float32), normal.astype(np.float32),
                          np.where(there, 1 + passes["Object Index"][..., 0], 0).astype(np.int64), to_pixel)
    return judge.edges(guides)


# --- Targets ---------------------------------------------------------------------------------------------------


def ratios(rows: list[dict[str, Any]], scene: str, lights: int) -> dict[str, Any] | None:
    """Return the figures of a case that the targets ask for: the times of Balanced and Fine divided by those of their
    rivals, and whether each is as near to the reference as it has to be; None where something was not measured.
    """
    case = [r for r in rows if (r["scene"], r["lights"]) == (scene, lights)]
    of = {(r["method"], r["light_samples"] or r["kI"]): r for r in case}
    if (LAMP_SHAPE, BALANCED.kI) not in of:
        return None
    balanced, fine, sharp, four, sixteen = (of[m.kind, m.samples or m.kI] for m in (
        BALANCED, FINE, SHARP, FOUR, SIXTEEN))
    near = [r for r in (balanced, fine) if r["rmse_whole"] <= sixteen["rmse_whole"]]
    quickest = min(near, key=lambda r: float(r["frame"])) if near else fine
    found = {"sharp": balanced["frame"] / sharp["frame"], "four": balanced["frame"] / four["frame"],
             "sixteen": quickest["frame"] / sixteen["frame"], "by": quickest["label"],
             "error": balanced["rmse_whole"] / four["rmse_whole"],
             "error_16": quickest["rmse_whole"] / sixteen["rmse_whole"]}
    denoised = [r for r in case if r["method"] == DENOISED]
    if denoised and "flip" in balanced:
        good = [r for r in denoised if r["flip"] <= balanced["flip"]]
        best = min(good or denoised, key=lambda r: float(r["frame"]) if good else float(r["flip"]))
        found |= {"cycles": best["frame"] / balanced["frame"], "cycles_label": best["label"],
                  "cycles_near": bool(good), "flip": (balanced["flip"], best["flip"]),
                  "flip_whole": (balanced["flip_whole"], best["flip_whole"])}
    return found
