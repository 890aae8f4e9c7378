"""The engine's rooms: what a module may import goes one way, down, and the package's root stays small.

Imports count wherever they stand, also those inside functions and those for types only.
"""

import ast
import re
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "engine" / "light_meshes"
# From the top down.
ORDER = ["cli", "bench", "frontends", "picture", "gathered", "shadows", "shadows.meshes", "glass", "surface", "film",
         "rays", "lights", "scene", "support"]
LEVEL = {room: level for level, room in enumerate(ORDER)}


def modules():
    """Name of every module → its file."""
    found = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(name, path, known):
    """The modules of the package that a module imports."""
    here = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    here = [part for part in here if part]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = here[:len(here) - node.level + 1] + (node.module.split(".") if node.module else [])
            for alias in node.names:
                full = ".".join([*base, alias.name])
                yield full if full in known else ".".join(base)
        elif isinstance(node, ast.ImportFrom | ast.Import):
            names = [node.module] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
            yield from (n.removeprefix("light_meshes.") for n in names if n.split(".")[0] == "light_meshes")


@cache
def graph():
    known = modules()
    edges = {name: set(imported(name, path, known)) - {name} for name, path in known.items()}
    for folder in ("shadows", "lights"):  # their registries find the files of methods and types by their names
        kinds = {f"{folder}.{p.stem}" for p in (PACKAGE / folder).glob("*.py") if "\nKIND = " in p.read_text("utf-8")}
        assert len(kinds) >= 4
        edges[f"{folder}.registry"] |= kinds
    return edges


def room(name):
    """The innermost room that a module is in; "": the package itself, which only names what it exports."""
    parts = name.split(".")
    return next((found for n in (2, 1) if (found := ".".join(parts[:n])) in LEVEL), "")


def test_the_graph_is_that_of_the_package():
    edges = graph()
    assert "shadows.psi" in edges["shadows.light_meshes"] and "picture.world" in edges["picture.prepared"]
    assert sum(map(len, edges.values())) > 200


def test_no_module_imports_itself_by_way_of_others():
    try:
        tuple(TopologicalSorter({name: to for name, to in graph().items() if name}).static_order())
    except CycleError as e:
        pytest.fail(" imports ".join(reversed(e.args[1])))


def test_rooms_know_only_those_below_them():
    wrong = [f"{name} imports {other}" for name, to in graph().items() for other in to
             if room(name) and room(other) and room(name) != room(other) and LEVEL[room(other)] <= LEVEL[room(name)]]
    assert not wrong


def test_c_sources_include_headers_of_rooms_below_them():
    wrong, count = [], 0
    for path in (p for p in PACKAGE.rglob("*") if p.suffix in {".c", ".h"}):
        for header in re.findall(r'^#include "(.*)"', path.read_text(encoding="utf-8"), re.M):
            file = (path.parent / header).resolve() if header != "native.h" else PACKAGE / "support" / header
            assert file.is_file(), f"{path}: {header}"
            here, there = (room(".".join(f.relative_to(PACKAGE).with_suffix("").parts)) for f in (path, file))
            count += 1
            if here != there and LEVEL[there] <= LEVEL[here]:
                wrong.append(f"{path.relative_to(PACKAGE)} includes {header}")
    assert count > 40 and not wrong


def test_every_module_is_in_a_room_and_few_at_the_root():
    assert not [name for name in graph() if name and not room(name)]
    assert len(list(PACKAGE.glob("*.py"))) <= 8


def test_every_room_is_built_into_the_wheel():
    with (PACKAGE.parents[1] / "pyproject.toml").open("rb") as file:
        packages = set(tomllib.load(file)["tool"]["setuptools"]["packages"])
    folders = {path.parent.relative_to(PACKAGE.parent).as_posix() for path in PACKAGE.rglob("__init__.py")}
    assert {folder.replace("/", ".") for folder in folders} <= packages
