"""Recipes of docs/developers.md, followed in a copy of the engine."""

from __future__ import annotations

import difflib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "engine" / "light_meshes"


def shown(heading: str, language: str) -> str:
    """Return the file that the page shows under a heading."""
    text = (ROOT / "docs" / "developers.md").read_text(encoding="utf-8")
    part = text[text.index(f"## {heading}"):]
    found = re.search(rf"^( *)```{language}\n(.*?)```", part[:part.index("\n## ")], re.S | re.M)
    return re.sub(rf"^{found[1]}", "", found[2], flags=re.M)


def copied(folder: Path, files: dict[str, str], edits: list[tuple[str, str, str]]) -> Path:
    """Return the engine in `folder`, with new files, and with text replaced: (file, old, new), each found once."""
    package = folder / "light_meshes"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    for name, text in files.items():
        assert not (package / name).exists()
        (package / name).write_text(text, encoding="utf-8")
    for name, old, new in edits:
        text = (package / name).read_text(encoding="utf-8")
        assert text.count(old) == 1, old
        (package / name).write_text(text.replace(old, new), encoding="utf-8")
    return package


def changes(package: Path) -> tuple[set[str], list[str]]:
    """Return the files that are new in a copy, and the lines that are new in others."""
    before, after = _lines(PACKAGE), _lines(package)
    assert set(before) <= set(after)
    lines = [line for name in before for line in difflib.ndiff(before[name], after[name]) if line.startswith("+ ")]
    return set(after) - set(before), lines


def _lines(folder: Path) -> dict[str, list[str]]:
    return {path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8").splitlines()
            for path in folder.rglob("*") if path.suffix in {".py", ".c", ".h"}}


def run(package: Path, *arguments: object) -> subprocess.CompletedProcess:
    """Return the command, by the engine of a copy."""
    script = "import sys; from light_meshes import cli; print(cli.__file__); sys.exit(cli.main())"
    done = subprocess.run([sys.executable, "-c", script, *map(str, arguments)], capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": str(package.parent)}, timeout=120)
    assert not done.stdout or str(package) in done.stdout  # the copy, and not the engine that is installed
    return done
