"""Compare the results with the targets. Every output contains every target, reached or not."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from . import lamps

Rows = list[dict[str, Any]]
RMSE_ADDED, MAX_ADDED = 1 / 512, 1 / 64  # limits for the change by `shadow_rate`, as a share of the picture's light
RATE = 4


def targets(results: dict[str, Any]) -> Rows:
    """Return the rows: what, measured (None if this run did not measure it), target, reached (None likewise) and
    remark.
    """
    rows = [_row("RRTA's shadow stage / Embree alone on the same rays",
                 results["embree"] and results["embree"]["ratio"], 1.3)]
    ratios = speed_ratios(results)
    for lights, target in ((4, 1.3), (16, 0.7), (64, 0.3), (256, 0.15)):
        rows.append(_row(f"light meshes / RRTA, frame, S7, 4 samples a pixel, {lights} lights", ratios.get(lights),
                         target))
    even = break_even(ratios)
    rows.append(_row("break-even: light meshes are faster from so many lights on", even, 8))
    if even is None and ratios:
        rows[-1] |= {"reached": False, "remark": f"not up to {max(ratios)} lights"}
    for name in ("S3", "S7"):
        found = cycles_ratios(results, name)
        lights = 16 if 16 in found or not found else min(found)
        rows.append(_row(f"Cycles' time / light meshes' at the RMSE that these reach, {name}"
                         + f", {lights} lights" * (name == "S7"), found.get(lights), 10, at_least=True,
                         remark="; ".join([f"{n} lights: {x:.3g}" for n, x in found.items() if n != lights] +
                                          [_extended(results, name)] * bool(found))))
    cost = {r["lights"]: r["frame"]["median"] for r in own_rows(results, "S7", 4)}
    rows.append(_row("cost of 256 lights / of 1 light, light meshes, S7, 4 samples a pixel",
                     cost[256] / cost[1] if {1, 256} <= set(cost) else None, 8))
    memory = {r["lights"]: r["node_bytes"] / r["nodes"] for r in own_rows(results, "S7", 4) if r.get("nodes")}
    for lights in sorted(memory) or (64,):
        rows.append(_row(f"memory, bytes a node, {lights} opaque lights", memory.get(lights), 16 + lights / 8 * 1.5))
    process = results["process"]
    rows.append(_row("first render of a process over its later ones, seconds",
                     process and process["first"] - process["later"], 0.5))
    rows += lamp_targets(results.get("lamps", [])) + _threads(results.get("threads"))
    return rows + _release(results.get("release")) + _rates(results.get("rates", []))


def lamp_targets(rows: Rows) -> Rows:
    """Return the targets of lamps with a size, by the part `lamps`: Balanced must be as near as 4 rays to each lamp,
    and the faster one of Balanced and Fine that is as near as 16 counts against these.
    """
    out: Rows = []

    def add(what: str, scene: str, lights: int, name: str, target: float, error: str, at_least: bool = False) -> None:
        of = lamps.ratios(rows, scene, lights)
        value, remark = (of or {}).get(name), ""
        if of and value is not None and error:
            remark = f"error / that of so many rays: {of[error]:.2f}" + f", {of['by']}" * (error == "error_16")
        elif of and value is not None:
            remark = "{cycles_label}, HDR-FLIP {flip[1]:.3f} to {flip[0]:.3f}, with edges {flip_whole[1]:.3f} to " \
                     "{flip_whole[0]:.3f}".format(**of)
            remark += "" if of["cycles_near"] else ": none is as near"
        row = _row(what, value, target, at_least, remark)
        if row["reached"] and of and error and of[error] > 1:
            row["reached"] = False
        out.append(row)

    near, shape = "as near as {} rays a lamp: lamp shape / ", "S7, {} lights"
    for lights, target in ((16, 1.0), (64, 0.6), (256, 0.5)):
        add(near.format(4) + "sharp, " + shape.format(lights), "S7", lights, "sharp", target, "error")
    add(near.format(4) + "area sampling 4, S3", "S3", 1, "four", 1.0, "error")
    for scene, lights, target in (("S3", 1, 0.45), ("S7", 16, 0.3), ("S7", 64, 0.2), ("S7", 256, 0.15),
                                  ("clutter", 16, 0.5)):
        title = shape.format(lights) if scene == "S7" else scene
        add(near.format(16) + "area sampling 16, " + title, scene, lights, "sixteen", target, "error_16")
    for scene, lights, target in (("S3", 1, 3.0), ("S7", 16, 5.0), ("S7", 64, 15.0)):
        title = shape.format(lights) if scene == "S7" else scene
        add("Cycles, denoised, as near by HDR-FLIP / lamp shape, " + title, scene, lights, "cycles", target, "", True)
    return out


def _release(found: dict[str, Any] | None) -> Rows:
    """Return the targets of this release's frames against those of an earlier one."""
    if found is None:
        return [_row("frame / that of the release before, S3 and S7, 4 samples a pixel", None, 0.85,
                     remark="light-meshes bench --release PYTHON")]
    return [_row(f"frame / that of {found['versions'][0]}, {row['title']}, 4 samples a pixel", row["seconds"], 0.85,
                 remark=f"CPU time: {row['cpu']:.3g}") for row in found["rows"]]


def _threads(threads: dict[str, Any] | None) -> Rows:
    """Return the targets of threads that run side by side."""
    lock = (threads or {}).get("lock") or {"S3, 1 light": None}
    rows = [_row(f"share of the tile loop that holds Python's lock, {case}, 4 samples a pixel", share, 0.02)
            for case, share in lock.items()]
    found = (threads or {}).get("preparing")
    size = f"{found['triangles']:,}" if found else "2·10⁶"
    for what in ("accelerator", "certificate"):
        rows.append(_row(f"threads that are busy while the {what} of {size} triangles is made",
                         found and found[what]["threads"], 1.5, at_least=True,
                         remark=f"{found[what]['seconds']:.2f} s" if found else ""))
    return [*rows, _row(f"seconds of the certificate of {size} triangles without lamps",
                        found and found["without_lamps"], 0.0)]


def _rates(rows: Rows) -> Rows:
    """Return the targets for an S that is not computed at every sample: for rate 4 on S7, and for errors on all
    scenes.
    """
    frames = {r["rate"]: r["frame"]["median"] for r in rows if r["scene"] == "S7"}
    lights = next((r["lights"] for r in rows if r["scene"] == "S7"), 64)
    of_all = [r for r in rows if r["rate"] == RATE]
    where = "; ".join(f"{r['scene']} {r['rmse']:.2g}, {r['max']:.2g}" for r in of_all)
    return [
        _row(f"shadow rate {RATE}: frame / RRTA's, S7, {lights} lights, 4 samples a pixel",
             frames[RATE] / frames[0] if frames else None, 0.1, remark="; ".join(
                 f"rate {rate}: {frames[rate] / frames[0]:.3g}" for rate in frames if rate not in (0, RATE))),
        _row(f"shadow rate {RATE}: added RMSE", max((r["rmse"] for r in of_all), default=None), RMSE_ADDED,
             remark=f"RMSE, largest: {where}" if where else ""),
        _row(f"shadow rate {RATE}: largest error added", max((r["max"] for r in of_all), default=None), MAX_ADDED),
    ]


def _row(what: str, measured: float | None, target: float, at_least: bool = False, remark: str = "") -> dict[str, Any]:
    reached = None if measured is None else bool(measured >= target if at_least else measured <= target)
    return {"what": what, "measured": measured, "target": target, "at_least": at_least, "reached": reached,
            "remark": remark}


def own_rows(results: dict[str, Any], scene: str, samples: int, times: str = "times") -> Rows:
    """Return the rows of light meshes with the scene's own h and kI."""
    own = {(s["scene"], s["lights"]): s for s in results["scenes"]}
    return [r for r in results[times] if r["scene"] == scene and r["method"] == "light meshes"
            and r.get("samples", samples) == samples and r["kI"] == own[scene, r["lights"]]["kI"]
            and np.isclose(r["h"], own[scene, r["lights"]]["h"])]


def speed_ratios(results: dict[str, Any], samples: int = 4) -> dict[int, float]:
    """Return number of lights → time of a frame of light meshes divided by RRTA's, on S7."""
    sharp = {r["lights"]: r["frame"]["median"] for r in results["times"]
             if (r["scene"], r["method"], r["samples"]) == ("S7", "RRTA", samples)}
    return {r["lights"]: r["frame"]["median"] / sharp[r["lights"]] for r in own_rows(results, "S7", samples)}


def break_even(ratios: dict[int, float]) -> float | None:
    """Return the number of lights from which on light meshes are faster, interpolated log-log; None if they never
    are.
    """
    slow = [n for n in ratios if ratios[n] > 1]
    if not slow:
        return float(min(ratios)) if ratios else None
    for a, b in pairwise(sorted(ratios)):
        if a == max(slow):
            return float(np.exp(np.interp(0.0, np.log([ratios[b], ratios[a]]), np.log([b, a]))))
    return None


def cycles_ratios(results: dict[str, Any], scene: str) -> dict[int, float]:
    """Return number of lights → the time that Cycles needs for the RMSE of light meshes, divided by their time.

    Both RMSEs are against the same sphere light, each rendered by its own renderer. Time and error of Cycles are fitted
    by lines in log-log: noise falls as n^−½, and time grows as n.
    """
    found = {}
    for own in own_rows(results, scene, 1):
        lights = own["lights"]
        error, line = _own_error(results, scene, lights), cycles_line(results, scene, lights)
        if error and len(line) > 1:
            times, noise = np.log(np.array(line).T)
            slope, start = np.polyfit(noise, times, 1)
            found[lights] = float(np.exp(start + slope * np.log(error[0]))) / own["frame"]["median"]
    return found


def _own_error(results: dict[str, Any], scene: str, lights: int) -> list[float]:
    return [r["all"]["rmse"] for r in own_rows(results, scene, 1, "errors")
            if (r["lights"], r["reference"]) == (lights, "SPHERE")]


def _extended(results: dict[str, Any], scene: str) -> str:
    """Return the numbers of lights for which Cycles' line had to be extended beyond the samples that were measured."""
    beyond = [str(case["lights"]) for case in results["scenes"] if case["scene"] == scene
              for error in _own_error(results, scene, case["lights"])
              for line in [cycles_line(results, scene, case["lights"])]
              if line and error < min(noise for _, noise in line)]
    return (f"by Cycles' line beyond what was measured: {', '.join(beyond)} lights" if beyond
            else "within what was measured")


def cycles_line(results: dict[str, Any], scene: str, lights: int, method: str = "Cycles") -> list[tuple[float, float]]:
    """Return (seconds, RMSE) of Cycles, with its denoiser or without, for each number of samples."""
    noise = {r["light_samples"]: r["all"]["rmse"] for r in results["errors"]
             if (r["scene"], r["lights"], r["method"], r["reference"]) == (scene, lights, method, "CYCLES")}
    return [(r["frame"]["median"], noise[r["light_samples"]]) for r in results["times"]
            if (r["scene"], r["lights"], r["method"]) == (scene, lights, method) and noise.get(r["light_samples"])]
