"""The contest's tables as Markdown, and what they compare: rivals at equal error and at equal time, and the targets."""

from __future__ import annotations

from typing import Any

Rows = dict[str, dict[str, Any]]
TARGETS = {"night_hall": 10.0, "stage": 10.0, "exhibition": 10.0}  # times faster at equal error
OTHERS = 3.0  # in at least three of the other scenes
FLICKER = 0.1  # of Cycles' with denoiser
NEAR = 1.1  # a rival at equal time may take so much longer


def measure_of(row: dict[str, Any]) -> float:
    """Return the error that decides: HDR-FLIP away from edges, or RMSE there without flip-evaluator."""
    return float(row.get("flip", row["rmse"]))


def rivals(rows: Rows) -> list[tuple[str, dict[str, Any]]]:
    """Return Cycles' rows with the denoiser, fewest samples first."""
    found = [(name, row) for name, row in rows.items() if row["engine"] == "CYCLES" and row["denoise"]]
    return sorted(found, key=lambda item: item[1]["samples"])


def equal_error(rows: Rows) -> str | None:
    """Return the fastest of Cycles with denoiser that is as near to the reference as Balanced; if none is, the nearest;
    None where it was not measured.
    """
    found = rivals(rows)
    if not found or "balanced" not in rows:
        return None
    near = [item for item in found if measure_of(item[1]) <= measure_of(rows["balanced"])]
    return min(near, key=lambda i: i[1]["seconds"])[0] if near else min(found, key=lambda i: measure_of(i[1]))[0]


def equal_time(rows: Rows) -> str | None:
    """Return the best of Cycles with denoiser in the time of Balanced; if none is as fast, the fastest."""
    found = rivals(rows)
    if not found or "balanced" not in rows:
        return None
    quick = [item for item in found if item[1]["seconds"] <= NEAR * rows["balanced"]["seconds"]]
    return max(quick, key=lambda i: i[1]["samples"])[0] if quick else min(found, key=lambda i: i[1]["seconds"])[0]


def faster(rows: Rows) -> tuple[float, bool] | None:
    """Return by which factor Balanced is faster than Cycles with denoiser at equal error, and whether that is only a
    bound, as no number of samples came as near; None where it was not measured.
    """
    name = equal_error(rows)
    if name is None:
        return None
    beyond = measure_of(rows[name]) > measure_of(rows["balanced"])
    return rows[name]["seconds"] / rows["balanced"]["seconds"], beyond


def reference_noise(rows: Rows, samples: int) -> float | None:
    """Return the RMSE away from edges that the reference of so many samples has by its own noise, from the noise of
    fewer: that of n samples against it is σ²/n + σ²/N. None without a picture that is not denoised.
    """
    noisy = [row for row in rows.values() if row["engine"] == "CYCLES" and not row["denoise"]]
    if not noisy:
        return None
    most = max(noisy, key=lambda row: row["samples"])
    return float(most["rmse"] / (1 + samples / most["samples"])**0.5)


def text(results: dict[str, Any]) -> str:
    """Return the page: a summary, then a table for each scene."""
    width, height = results["size"]
    machine = ", ".join(f"{name} {value}" for name, value in results["machine"].items())
    parts = [f"# The contest, {width}×{height}, frame {results['frame']}", machine,
             "References: Cycles with many samples, and with this engine's bounces. FLIP: HDR-FLIP, 0 to 1. \"Away\": "
             "without the edges of objects. Seconds are of Blender's render operator, with export, preparing and "
             "denoiser; CPU: the processor seconds of Blender and all that it started.",
             _summary(results["scenes"])]
    for name, scene in results["scenes"].items():
        parts += _scene(name, scene)
    return "\n\n".join(parts) + "\n"


def table(heads: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _summary(scenes: dict[str, Any]) -> str:
    lines = []
    for name, scene in scenes.items():
        rows, flight = scene["rows"], scene["flight"]
        if "balanced" not in rows:
            lines.append([name, *["–"] * 8])
            continue
        own, found = rows["balanced"], faster(rows)
        line = [name, f"{own['seconds']:.2f}", _number(measure_of(own))]
        if found is None:
            line += ["–"] * 4
        else:
            error, time = rows[str(equal_error(rows))], rows[str(equal_time(rows))]
            ratio, beyond = found
            target = TARGETS.get(name, OTHERS)
            reached = "reached" if ratio >= target else "**slower**" if ratio < 1 else "**not reached**"
            line += [f"{error['label']}: {error['seconds']:.2f} s" + (", less near" if beyond else ""),
                     f"{'> ' * beyond}{ratio:.2f}", f"≥ {target:g}: {reached}",
                     f"{time['label']}: {_number(measure_of(time))}"]
        lines.append([*line, *_flicker(flight)])
    return table(["scene", "Balanced, s", "FLIP away", "Cycles at equal error", "times faster", "target",
                  "Cycles at equal time: FLIP away", "flicker / Cycles'", f"≤ {FLICKER:g}"], lines)


def _flicker(flight: dict[str, Any]) -> list[str]:
    """Return Balanced's flicker over that of the steadier of the two rivals, beyond the floor, and whether it is small
    enough. The floor's variance is taken off: it is of what any method shows.
    """
    own = flight.get("balanced", {}).get("flicker")
    others = [row["flicker"] for name, row in flight.items() if name not in ("balanced", "floor") and "flicker" in row]
    if own is None or not others:
        return ["–", "–"]
    floor = flight.get("floor", {}).get("flicker", 0.0)
    noise = max(min(others)**2 - floor**2, 0.0)**0.5
    if not noise:
        return ["–", "–"]
    ratio = max(own**2 - floor**2, 0.0)**0.5 / noise
    return [f"{ratio:.2f}", "reached" if ratio <= FLICKER else "**not reached**"]


def _scene(name: str, scene: dict[str, Any]) -> list[str]:
    said, samples = [f"## {name}"], scene["reference"]
    if scene["rows"]:
        share = next(iter(scene["rows"].values()))["edges"]
        said.append(f"Blender {scene.get('version', '')}; the reference has {samples} samples and took "
                    f"{scene.get('reference_seconds', 0):.0f} s; {share:.0%} of the pixels are at edges; of its own "
                    f"noise it has an RMSE of {_number(reference_noise(scene['rows'], samples))}: errors not much "
                    "larger are not known.")
        said.append(table(["", "s", "CPU s", "FLIP away", "whole", "RMSE away", "whole", "MiB"], [
            [row["label"], f"{row['seconds']:.2f}", f"{row['processor']:.2f}", _number(row.get("flip")),
             _number(row.get("flip_whole")), _number(row["rmse"]), _number(row["rmse_whole"]),
             f"{row['memory'] / 2**20:,.0f}" if row.get("memory") else "–"] for row in scene["rows"].values()]))
    if scene["flight"]:
        said.append(table(["flight", "flicker", "99 %", "compared", "s a frame", "first frame"], [
            [row["label"], _number(row.get("flicker")), _number(row.get("flicker_p99")), f"{row['compared']:.0%}",
             f"{row['seconds']:.2f}", f"{row['first']:.2f}"] for row in scene["flight"].values()]))
    if scene.get("sheet"):
        said.append(f"{scene['sheet']['file']}, from left to right: {', '.join(scene['sheet']['columns'])}; below: "
                    "crops where the largest errors are.")
    warnings = dict.fromkeys(w for row in scene["rows"].values() for w in row["warnings"])
    if warnings:
        said.append("Warnings:\n" + "\n".join(f"- {w}" for w in warnings))
    if scene["failed"]:
        said.append("Failed:\n" + "\n".join(f"- {f['label']}: {' '.join(f['why'].split())}" for f in scene["failed"]))
    return said


def _number(x: float | None) -> str:
    return "–" if x is None else f"{x:.4f}"
