"""Copy the results of `light-meshes bench --out FOLDER` into speed.md and README.md: `python docs/benchmark.py FOLDER`.

The text between the marks <!-- bench: NAME --> and <!-- end --> is replaced by what MAKE[NAME] returns for the results.
Names behind FOLDER are the only ones that are replaced: `python docs/benchmark.py FOLDER lamps in_short` after a run of
`light-meshes bench --only cycles,lamps --out FOLDER`.
"""

import json
import os
import re
import shutil
import sys
from pathlib import Path

from light_meshes.bench.lamps import ratios
from light_meshes.bench.tables import LAMPS, lamps_rows
from light_meshes.bench.targets import break_even, lamp_targets, own_rows, speed_ratios

DOCS = Path(__file__).parent
PAGES = DOCS / "speed.md", DOCS.parent / "README.md"
NOT_MEASURED = "Not measured yet."
BLOCK = re.compile(r"(<!-- bench: (\w+) -->\n).*?(\n<!-- end -->)", re.S)


def table(heads, rows):
    """Return a Markdown table of strings; `heads` is its first row."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "‖") for cell in line) + " |" for line in lines)


def machine(results, figure):
    of = ", ".join(f"{name} {value}" for name, value in results["machine"].items())
    short = " These are figures of a quick run, too short to conclude from." if results["quick"] else ""
    return f"{of}; {results.get('seconds', 0) / 60:.0f} minutes. Times are medians.{short}"


def lights(results, figure):
    sharp = {r["lights"]: r["frame"]["median"] for r in results["times"]
             if (r["scene"], r["method"], r["samples"]) == ("S7", "RRTA", 4)}
    rows = [[str(r["lights"]), f"{sharp[r['lights']]:.2f} s", f"{r['frame']['median']:.2f} s",
             f"{r['frame']['median'] / sharp[r['lights']]:.2f}"] for r in own_rows(results, "S7", 4)]
    return rows and table(["lamps in the hall", "sharp", "light meshes", "ratio"], rows) + figure(
        "lights", "Seconds a frame by the number of lamps, for light meshes and the ray tracer")


def lamps(results, figure):
    rows = results.get("lamps")
    if not rows:
        return ""
    asked = {row["what"] for row in lamp_targets(rows)}
    about = results | {"targets": [row for row in results["targets"] if row["what"] in asked]}
    return "\n\n".join([machine(results, figure), targets(about, figure), table(LAMPS, lamps_rows(rows))])


def in_short(results, figure):
    told = []
    for scene, count in (("S3", 1), ("S7", 16), ("S7", 64), ("S7", 256)):
        of = ratios(results.get("lamps") or [], scene, count)
        if of:
            told.append([str(count), *(f"{of[k]:.2f}" for k in ("sharp", "four", "error", "sixteen", "error_16"))])
    return told and table(["lamps", "Balanced / sharp", "/ 4 area samples", "its error / theirs",
                           "what is as near as 16 area samples / these", "its error / theirs"], told)


def errors(results, figure):
    return figure("error-sphere", "Error against a lamp with a size, by seconds a frame") + figure(
        "error-half-ball", "Error against the limit of the method, by seconds a frame")


def growth(results, figure):
    return figure("growth", "Seconds a frame by pixels, and by triangles")


def targets(results, figure):
    said = {None: "not measured", True: "reached", False: "**not reached**"}
    return table(["what", "measured", "target", ""], [
        [r["what"], "" if r["measured"] is None else f"{r['measured']:.3g}",
         f"{'≥' if r['at_least'] else '≤'} {r['target']:.3g}",
         said[r["reached"]] + (f" ({r['remark']})" if r["remark"] else "")] for r in results["targets"]])


def decisions(results, figure):
    return results["decisions"] and table(
        ["decision", "taken", "forced", "saves", "picture", "where it is taken the plan says", "and elsewhere"],
        [[f"{r['plan']}: {r['what']}", f"{r['taken_seconds']:.2f} s", f"{r['forced_seconds']:.2f} s",
          f"{1 - r['taken_seconds'] / r['forced_seconds']:.0%}", "same bits" if r["same_bits"] else "**other bits**",
          r["taken"], r["other"]] for r in results["decisions"]])


def main(results, figure):
    ratios = speed_ratios(results)
    even = break_even(ratios)
    faster, on = ("faster", f" from about {even:.0f} lamps on (**break-even**)") if even else (
        "not faster", " with any number of lamps that was measured")
    parts = [f"{ratios[n]:.2g} times " + (f"with {n}" if k else f"the sharp-shadow time with {n} lamp{'s' * (n > 1)}")
             for k, n in enumerate(sorted(ratios))]
    said = " and ".join(filter(None, [", ".join(parts[:-1]), *parts[-1:]]))
    return ratios and (
        f"In a hall of {max(r['triangles'] for r in own_rows(results, 'S7', 4)):,} triangles light meshes are {faster} "
        f"than ray-traced sharp shadows{on}.\nA frame takes {said}." + figure(
            "error-sphere", "Error against a lamp with a size, by seconds a frame, for light meshes, area sampling and "
            "Cycles"))


def all_tables(results, figure):
    return f"<details><summary>table.txt</summary>\n\n```text\n{results['text'].strip()}\n```\n\n</details>"


MAKE = {"machine": machine, "lights": lights, "lamps": lamps, "in_short": in_short, "errors": errors, "growth": growth,
        "targets": targets, "decisions": decisions, "all": all_tables, "main": main}


def insert(folder, pages=PAGES, pictures=DOCS / "pictures", only=()):
    """Fill the marked blocks of `pages`, or those of the names `only`, with the results in `folder`, and copy the
    figures into `pictures`.
    """
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    results["text"] = (folder / "table.txt").read_text(encoding="utf-8")
    pictures.mkdir(exist_ok=True)
    for page in pages:
        def figure(name, title, page=page):
            source, copy = folder / f"{name}.png", pictures / f"bench-{name}.png"
            if not source.is_file():
                return ""
            shutil.copy(source, copy)
            return f"\n\n![{title}]({Path(os.path.relpath(copy, page.parent)).as_posix()})"

        def filled(block, figure=figure):
            if only and block[2] not in only:
                return block[0]
            said = (MAKE[block[2]](results, figure) or NOT_MEASURED).strip()
            return block[1] + said + block[3]
        page.write_text(BLOCK.sub(filled, page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    insert(Path(sys.argv[1]), only=sys.argv[2:])
