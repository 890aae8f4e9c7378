"""Write the results as text tables."""

from __future__ import annotations

from typing import Any

from .targets import Rows, speed_ratios

REFERENCES = {"RRTA": "sharp", "HALF_BALL": "half-ball", "SPHERE": "sphere light", "LAMPS": "lamp of its shape",
              "CYCLES": "Cycles, same light"}


def text(results: dict[str, Any]) -> str:
    """Return all tables as text; the targets come first."""
    parts = [_machine(results), _targets(results["targets"])]
    ratios = speed_ratios(results)
    if ratios:
        parts.append("Light meshes / RRTA, frame, S7, 4 samples a pixel: " +
                     ", ".join(f"{n} lights {ratio:.2f}" for n, ratio in ratios.items()))
    for case in results["scenes"]:
        parts += _case(results, case)
    parts += _lamps(results.get("lamps", []))
    parts += _growth(results["growth"]) + _rates(results.get("rates", []))
    parts += _single(results) + _decisions(results["decisions"])
    if results["notes"]:
        parts.append("\n".join(results["notes"]))
    return "\n\n".join(parts) + "\n"


def _machine(results: dict[str, Any]) -> str:
    of = ", ".join(f"{name} {value}" for name, value in results["machine"].items())
    return (f"light-meshes bench{' (quick: too short to conclude from)' if results['quick'] else ''}, "
            f"{results.get('seconds', 0) / 60:.1f} minutes\n{of}\n"
            "Times are medians (smallest to largest) of runs in turn, seconds; a frame is without the preparing; "
            "shadows are thread seconds.")


def table(heads: list[str], rows: list[list[str]]) -> str:
    """Return a table with columns as wide as necessary. The first column and columns of words are aligned left, the
    others right.
    """
    widths = [max(len(row[k]) for row in [heads, *rows]) for k in range(len(heads))]
    left = {0} | {k for row in rows for k, cell in enumerate(row) if cell[:1].isalpha() and " " in cell}
    lines = ["  ".join(cell.ljust(w) if k in left else cell.rjust(w) for k, (cell, w) in
                       enumerate(zip(row, widths, strict=True))).rstrip() for row in [heads, *rows]]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])


def _targets(rows: Rows) -> str:
    def number(x: float | None) -> str:
        return "–" if x is None else f"{x:.3g}"

    said = {None: "not measured", True: "reached", False: "NOT REACHED"}
    return "Targets\n" + table(["what", "measured", "target", ""], [
        [r["what"], number(r["measured"]), f"{'≥' if r['at_least'] else '≤'} {r['target']:.3g}",
         said[r["reached"]] + (f" ({r['remark']})" if r["remark"] else "")] for r in rows])


def _span(x: dict[str, float]) -> str:
    return f"{x['median']:.3f} ({x['min']:.3f}–{x['max']:.3f})"


def _case(results: dict[str, Any], case: dict[str, Any]) -> list[str]:
    def of_case(rows: Rows) -> Rows:
        return [r for r in rows if (r["scene"], r["lights"]) == (case["scene"], case["lights"])]

    times = of_case(results["times"])
    if not times:
        return []
    said = [f"{case['title']} ({case['file']}, mode {case['mode'].lower().replace('_', ' ')}, h {case['h']:.3g}, "
            f"kI {case['kI']:g}; {case['sizes']})"]
    rows = []
    for r in times:
        sharp = [t["frame"]["median"] for t in times if (t["method"], t["samples"]) == ("RRTA", r["samples"])]
        remark = f"from {r['measured_size']}²" if r["measured_size"] != r["size"] else ""
        rows.append([r["label"], str(r["samples"]), _span(r["frame"]), _span(r["shadow"]),
                     f"{r['frame']['median'] / sharp[0]:.2f}" if sharp else "–", f"{r['whole']['median']:.2f}",
                     f"{r['nodes']:,}" if r.get("nodes") else "", str(r["runs"]), remark])
    size = times[0]["size"]
    said.append(table([f"time, {size}²", "samples", "frame", "shadows", "/ RRTA", "with preparing", "nodes", "runs",
                       ""], rows))
    rows = [[r["label"] + (" (reference)" if "reference" in r["method"] else ""), REFERENCES[r["reference"]],
             f"{r['all']['flip']:.4f}" if "flip" in r["all"] else "–",
             *(f"{r['all'][k]:.2e}" for k in ("rmse", "mae", "p99", "max")), f"{r['penumbra']['rmse']:.2e}",
             f"{r['penumbra']['max']:.2e}", f"{r['rest']['rmse']:.2e}", f"{r['rest']['max']:.2e}"]
            for r in of_case(results["errors"])]
    if rows:
        first = of_case(results["errors"])[0]
        said.append(table([f"error, {first['size']}², {first['in_penumbra']:.0%} penumbra", "against", "FLIP", "RMSE",
                           "MAE", "99 %", "max", "penumbra RMSE", "max", "rest RMSE", "max"], rows))
    return said


LAMPS = ["scene", "method", "frame", "/ sharp", "/ area 16", "RMSE", "at edges, too", "FLIP", "at edges, too", "runs"]


def lamps_rows(rows: Rows) -> list[list[str]]:
    """Return the rows of the table of lamps with a size, below LAMPS."""
    out = []
    for r in rows:
        of = {(t["method"], t["light_samples"]): t for t in rows if t["title"] == r["title"]}
        sharp, sixteen = of.get(("RRTA", 0)), of.get(("area sampling", 16))
        out.append([r["title"] + (f", the middle {r['part']:.0%} of it" if r["part"] < 1 else ""),
                    "sharp" if r["method"] == "RRTA" else r["label"], f"{r['frame']:.2f}",
                    *(f"{r['frame'] / t['frame']:.2f}" if t else "–" for t in (sharp, sixteen)),
                    f"{r['rmse']:.4f}", f"{r['rmse_whole']:.4f}",
                    *(f"{r[k]:.4f}" if k in r else "–" for k in ("flip", "flip_whole")), str(r["runs"])])
    return out


def _lamps(rows: Rows) -> list[str]:
    if not rows:
        return []
    return [f"Lamps with a size, {rows[0]['size']}², 4 samples a pixel; errors in a window in the middle\n"
            + table(LAMPS, lamps_rows(rows))]


def _growth(rows: Rows) -> list[str]:
    if not rows:
        return []
    return ["Growth, S7\n" + table(["by", "at", "method", "frame", "shadows", "with preparing"], [
        [r["by"], f"{r['at']:,}", r["label"], _span(r["frame"]), _span(r["shadow"]), f"{r['whole']['median']:.2f}"]
        for r in rows])]


def _rates(rows: Rows) -> list[str]:
    if not rows:
        return []
    sharp = {(r["scene"], r["lights"]): r["frame"]["median"] for r in rows if not r["rate"]}
    return ["Shadow rate, 4 samples a pixel, errors against rate 1\n" + table(
        ["scene", "lights", "size", "rate", "frame", "/ RRTA", "added RMSE", "largest", "interpolated",
         "in small blocks", "computed"],
        [[r["scene"], str(r["lights"]), f"{r['size']}²", str(r["rate"]) if r["rate"] else "RRTA", _span(r["frame"]),
          f"{r['frame']['median'] / sharp[r['scene'], r['lights']]:.3f}" if (r["scene"], r["lights"]) in sharp else "",
          *([f"{r['rmse']:.2e}", f"{r['max']:.2e}"] if r["rate"] else ["", ""]),
          *(f"{r[name]:.0%}" if r["rate"] > 1 else "" for name in ("interpolated", "refined", "computed"))]
         for r in rows])]


def _single(results: dict[str, Any]) -> list[str]:
    said, e, p = [], results["embree"], results["process"]
    if e:
        said.append(f"RRTA's shadow stage over Embree alone: {e['ratio']:.2f} on {e['rays']:,} rays, {e['threads']} "
                    f"threads: {min(e['shadow_stage']):.3f}–{max(e['shadow_stage']):.3f} over "
                    f"{min(e['embree_alone']):.3f}–{max(e['embree_alone']):.3f} thread seconds")
    if p:
        said.append(f"A fresh process: imports {p['import']:.2f} s, first render {p['first']:.2f} s, later ones "
                    f"{p['later']:.2f} s")
    return said


def _decisions(rows: Rows) -> list[str]:
    if not rows:
        return []
    return ["Decisions of the plan: taken, and forced the other way\n" + table(
        ["decision", "taken", "forced", "saves", "picture", "where it is taken the plan says", "and elsewhere"],
        [[f"{r['plan']}: {r['what']}", f"{r['taken_seconds']:.2f} s", f"{r['forced_seconds']:.2f} s",
          f"{1 - r['taken_seconds'] / r['forced_seconds']:.0%}", "same bits" if r["same_bits"] else "OTHER BITS",
          r["taken"], r["other"]] for r in rows])]
