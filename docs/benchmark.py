"""Put what `light-meshes bench --out FOLDER` measured into docs/speed.md: `python docs/benchmark.py FOLDER`.

Between the marks <!-- bench: NAME --> and <!-- end --> stands what the function NAME here makes of the results.
"""

import json
import re
import shutil
import sys
from pathlib import Path

from light_meshes.bench.targets import own_rows

PAGE = Path(__file__).with_name("speed.md")
NOT_MEASURED = "Not measured yet."
BLOCK = re.compile(r"(<!-- bench: (\w+) -->\n).*?(\n<!-- end -->)", re.S)


def table(heads, rows):
    """Markdown."""
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


def all_tables(results, figure):
    return f"<details><summary>table.txt</summary>\n\n```text\n{results['text'].strip()}\n```\n\n</details>"


MAKE = {"machine": machine, "lights": lights, "errors": errors, "growth": growth, "targets": targets,
        "decisions": decisions, "all": all_tables}


def insert(folder, page=PAGE):
    """Fill the blocks of `page` by the results in `folder`, and copy their figures beside it."""
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    results["text"] = (folder / "table.txt").read_text(encoding="utf-8")

    def figure(name, title):
        source = folder / f"{name}.svg"
        if not source.is_file():
            return ""
        (page.parent / "pictures").mkdir(exist_ok=True)
        shutil.copy(source, page.parent / "pictures" / f"bench-{name}.svg")
        return f"\n\n![{title}](pictures/bench-{name}.svg)"

    def filled(block):
        said = (MAKE[block[2]](results, figure) or NOT_MEASURED).strip()
        return block[1] + said + block[3]
    page.write_text(BLOCK.sub(filled, page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    insert(Path(sys.argv[1]))
