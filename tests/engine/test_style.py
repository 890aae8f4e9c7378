"""Ruff and mypy are clean, and files stay of a size that one mind holds."""

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
# file → why it has more than 400 lines
LONG: dict[str, str] = {}  # files of more than 400 lines, and the reason
MOST = 60  # lines of a function


@pytest.mark.skipif(not (shutil.which("ruff") or (Path(sys.executable).parent / "ruff").exists()), reason="no ruff")
def test_ruff_has_nothing_to_say():
    ruff = shutil.which("ruff") or Path(sys.executable).parent / "ruff"
    done = subprocess.run([ruff, "check", "engine", "addon", "tests", "blend_scenes", "docs"], cwd=ROOT,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_mypy_has_nothing_to_say():
    """Of engine and add-on, with the numpy that is installed; .ci/run asks with the oldest and the newest one."""
    pytest.importorskip("mypy")
    done = subprocess.run([sys.executable, "-m", "mypy"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_file_is_long_without_a_reason():
    long = {str(p.relative_to(ROOT)) for folder in ("engine", "addon", "tests", "blend_scenes")
            for p in (ROOT / folder).rglob("*.py") if len(p.read_text(encoding="utf-8").splitlines()) > 400}
    assert long == set(LONG)


def functions(path):
    """Name → number of lines of the functions of a Python or C file."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return {node.name: node.end_lineno - node.lineno + 1 for node in ast.walk(ast.parse(text))
                if isinstance(node, ast.FunctionDef)}
    found, begun = {}, None
    for number, line in enumerate(text.splitlines()):
        name = re.match(r"(?!typedef|enum|struct|static const|KERNEL)[A-Za-z].*?(\w+)\(", line)
        begun = (name[1], number) if name else begun
        if line == "}" and begun:
            found[begun[0]] = number - begun[1] + 1
            begun = None
    return found


def test_no_function_is_long():
    long = {f"{path.relative_to(ROOT)}:{name}": lines for folder in ("engine", "addon") for kind in ("py", "c", "h")
            for path in (ROOT / folder).rglob(f"*.{kind}") for name, lines in functions(path).items() if lines > MOST}
    assert not long


def test_functions_are_found():
    """Or the test above says nothing."""
    assert functions(ROOT / "engine/light_meshes/rays/embree.c")["embree_near"] > 20
    assert functions(Path(__file__))["functions"] > 10


def test_the_files_that_begin_are_there():
    """conftest.py names them, and nothing would tell that one has another name now."""
    tree = ast.parse((ROOT / "tests" / "conftest.py").read_text(encoding="utf-8"))
    names = next(ast.literal_eval(node.value) for node in tree.body
                 if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "LONGEST")
    assert all(len(list((ROOT / "tests").glob(f"*/test_{name}.py"))) == 1 for name in names)
