"""Draw the figures: error against time, also of the contest, time against lights, and growth.

This needs matplotlib (the extra `bench`).
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

from .contest_tables import measure_of
from .targets import cycles_line

MISSING = "no figures: they need matplotlib, which the extra 'bench' of this project installs"
COLOURS = {"RRTA": "#444444", "light meshes": "#d1495b", "lamp shape": "#7b2d8b", "area sampling": "#3a7ca5",
           "Cycles": "#e0a030", "Cycles, denoised": "#8a6d1b"}
MARKS = {"RRTA": "*", "light meshes": "o", "lamp shape": "D", "area sampling": "s", "Cycles": "^",
         "Cycles, denoised": "v"}
REFERENCES = {"RRTA": "sharp shadows", "HALF_BALL": "the half-ball integral", "SPHERE": "a sphere light"}


def available() -> bool:
    """Return whether figures can be drawn."""
    return importlib.util.find_spec("matplotlib") is not None


def draw(results: dict[str, Any], folder: Path) -> list[Path]:
    """Write the figures as .svg and .png, and return the paths."""
    import matplotlib
    matplotlib.use("Agg")

    written = []
    for name in REFERENCES:
        written += _save(_errors(results, name), folder / f"error-{name.lower().replace('_', '-')}")
    written += _save(_lights(results), folder / "lights")
    return written + _save(_growth(results), folder / "growth")


def contest(results: dict[str, Any], path: Path) -> Path | None:
    """Write the contest's figure: HDR-FLIP away from edges against seconds, a panel for each scene. Return its path, or
    None if nothing was measured.

    results: what `contest.run` returns.
    """
    import matplotlib
    matplotlib.use("Agg")

    scenes = {name: scene["rows"] for name, scene in results["scenes"].items() if scene["rows"]}
    if not scenes:
        return None
    figure, axes = _figure(len(scenes))
    for ax, (name, rows) in zip(axes, scenes.items(), strict=True):
        for kind, label in (("lamp shape", "Light Meshes"), ("Cycles, denoised", None),
                            ("Cycles", None)):
            points = sorted((row["seconds"], measure_of(row)) for row in rows.values() if _kind(row) == kind)
            if points:
                ax.plot(*zip(*points, strict=True), marker=MARKS[kind], color=COLOURS[kind], label=label or kind)
        ax.set_title(name.replace("_", " "))
        ax.set_xlabel("seconds")
    axes[0].set_ylabel("HDR-FLIP away from edges")
    axes[0].legend(fontsize=8)
    _save(figure, path)
    return path.with_suffix(".png")


def _kind(row: dict[str, Any]) -> str:
    if row["engine"] == "LIGHT_MESHES":
        return "lamp shape"
    return "Cycles, denoised" if row["denoise"] else "Cycles"


def _save(figure: Any, path: Path) -> list[Path]:
    if figure is None:
        return []
    import matplotlib.pyplot as plt

    paths = [path.with_suffix(suffix) for suffix in (".svg", ".png")]
    for p in paths:
        figure.savefig(p, dpi=80)
    plt.close(figure)
    return paths


def _figure(panels: int) -> tuple[Any, Any]:
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogLocator, NullFormatter

    columns = min(panels, 4)
    rows = -(-panels // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(1 + 3.6 * columns, 3.7 * rows), squeeze=False,
                                layout="constrained")
    for ax in axes.flat[panels:]:
        ax.remove()
    for ax in axes.flat[:panels]:
        ax.set_xscale("log")
        ax.set_yscale("log")
        for axis in (ax.xaxis, ax.yaxis):  # plain numbers, and only a few
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        ax.grid(True, which="both", color="#dddddd", linewidth=0.5)
    return figure, list(axes.flat[:panels])


def _points(results: dict[str, Any], case: dict[str, Any], method: str, reference: str) -> dict[str, Any]:
    """Return label → (seconds of a frame, RMSE, the row) for a method on a case with one sample per pixel."""
    key = case["scene"], case["lights"], method
    error = {r["label"]: r["all"]["rmse"] for r in results["errors"]
             if (r["scene"], r["lights"], r["method"]) == key and r["reference"] == reference}
    return {r["label"]: (r["frame"]["median"], error[r["label"]], r) for r in results["times"]
            if (r["scene"], r["lights"], r["method"]) == key and r["samples"] == 1 and error.get(r["label"])}


def _errors(results: dict[str, Any], reference: str) -> Any:
    cases = [c for c in results["scenes"] if _points(results, c, "light meshes", reference)]
    if not cases:
        return None
    figure, axes = _figure(len(cases))
    for ax, case in zip(axes, cases, strict=True):
        for method, colour in COLOURS.items():
            points = list(_points(results, case, method, reference).values())
            if method == "light meshes":  # one line for kI at the scene's r, one for h at its kI
                same = [p for p in points if abs(p[2]["h"] * p[2]["kI"] - case["r"]) < 1e-6 * case["r"]]
                steps = sorted((p for p in points if p[2]["kI"] == case["kI"]), key=lambda p: p[2]["h"])
                if len(steps) > 1:
                    ax.plot(*list(zip(*steps, strict=True))[:2], ":", color=colour, marker=".", label="light meshes, h")
                points = sorted(same, key=lambda p: p[2]["kI"])
                for seconds, rmse, row in points:
                    ax.annotate(f"{row['kI']:g}", (seconds, rmse), textcoords="offset points", xytext=(4, 4),
                                fontsize=7, color=colour)
            elif method.startswith("Cycles") and reference == "SPHERE":
                points = [(*p, None) for p in cycles_line(results, case["scene"], case["lights"], method)]
            if points:
                ax.plot([p[0] for p in points], [p[1] for p in points], "-", color=colour, marker=MARKS[method],
                        markersize=9 if method == "RRTA" else 5, label=method + ", kI" * (method == "light meshes"))
        ax.set_title(case["title"], fontsize=10)
        ax.set_xlabel("seconds a frame")
    axes[0].set_ylabel(f"RMSE against {REFERENCES[reference]}")
    axes[0].legend(fontsize=7)
    return figure


def _lights(results: dict[str, Any]) -> Any:
    rows = [r for r in results["times"] if r["scene"] == "S7" and r["method"] in ("RRTA", "light meshes")]
    own = {c["lights"]: c for c in results["scenes"] if c["scene"] == "S7"}
    if len(own) < 2 or not rows:
        return None
    figure, axes = _figure(2)
    for ax, samples in zip(axes, (1, 4), strict=True):
        for kI in (0.0, *sorted({r["kI"] for r in rows if r["kI"]})):
            line = sorted((r["lights"], r["frame"]["median"]) for r in rows if (r["kI"], r["samples"]) == (kI, samples)
                          and (not kI or abs(r["h"] * kI - own[r["lights"]]["r"]) < 1e-9))
            method = "light meshes" if kI else "RRTA"
            ax.plot(*zip(*line, strict=True), "-", color=COLOURS[method], marker=MARKS[method],
                    alpha=1 if not kI or kI == own[line[0][0]]["kI"] else 0.35,
                    label=f"{method}, kI {kI:g}" if kI else method)
        ax.set_title(f"S7, {samples} sample{'s' * (samples > 1)} a pixel", fontsize=10)
        ax.set_xlabel("lights")
        ax.set_ylabel("seconds a frame")
    axes[0].legend(fontsize=7)
    return figure


def _growth(results: dict[str, Any]) -> Any:
    if not results["growth"]:
        return None
    figure, axes = _figure(2)
    for ax, by in zip(axes, ("pixels", "triangles"), strict=True):
        for method in ("RRTA", "light meshes"):
            line = [(r["at"], r["frame"]["median"]) for r in results["growth"]
                    if (r["by"], r["method"]) == (by, method)]
            ax.plot(*zip(*line, strict=True), "-", color=COLOURS[method], marker=MARKS[method], label=method)
        ax.set_xlabel(by)
        ax.set_ylabel("seconds a frame")
    axes[0].legend(fontsize=7)
    return figure
