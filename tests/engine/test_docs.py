"""The documentation agrees with the sources: links, names of files and functions, sentences, properties."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
SOURCES = ("addon", "engine/light_meshes")


@pytest.fixture(params=PAGES, ids=lambda page: page.name)
def page(request):
    return request.param


def anchors(text):
    """GitHub's names of the headings."""
    titles = re.findall(r"^#+ (.+)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_links_and_pictures_are_there(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not target.startswith("https://"):
            path, _, anchor = target.partition("#")
            file = page.parent / path if path else page
            assert file.exists(), target
            assert not anchor or anchor in anchors(file.read_text(encoding="utf-8")), target


def test_every_page_and_picture_is_linked_from_a_page():
    linked = {(page.parent / target.partition("#")[0]).resolve() for page in PAGES
              for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))}
    files = {p.resolve() for p in (ROOT / "docs").rglob("*.*") if p.suffix in {".md", ".jpg", ".png", ".svg"}}
    assert not files - linked


def test_pictures_are_small():
    assert all(p.stat().st_size < 150_000 for p in (ROOT / "docs" / "pictures").iterdir())


# A definition: at a line's start, its body opens after the parameters. NAME(…) stands for one function a type.
C_FUNCTION = re.compile(r"^(?!#|KERNEL|typedef)[\w *]*?[ *](?:NAME\((\w+)\)|(\w+))\([^;{}!]*?\) \{", re.M)


@cache
def names_in(path):
    """All functions, classes, methods and module variables of a file; of a C source its functions."""
    if path.suffix in {".c", ".h"}:
        return {name or of_types for of_types, name in C_FUNCTION.findall(path.read_text(encoding="utf-8"))}
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    for node in tree.body:
        for target in [*getattr(node, "targets", []), getattr(node, "target", None)]:
            found |= {n.id for n in ast.walk(target) if isinstance(n, ast.Name)} if target else set()
    for owner in (n for n in ast.walk(tree) if isinstance(n, ast.ClassDef)):
        found |= {f"{owner.name}.{n.name}" for n in owner.body if isinstance(n, ast.FunctionDef)}
        found |= {f"{owner.name}.{n.target.id}" for n in owner.body if isinstance(n, ast.AnnAssign)}
    return found


NAMED = re.compile(r"`((?:addon|engine|tests|blend_scenes|docs)/[\w./-]*\.\w+)(?::([\w.]+))?`")


def test_named_files_and_functions_exist(page):
    for file, name in NAMED.findall(page.read_text(encoding="utf-8")):
        assert (ROOT / file).is_file(), file
        assert not name or name in names_in(ROOT / file), f"{file} has no {name}"


@pytest.mark.parametrize(("name", "least"), [("developers.md", 40), ("formulas.md", 40)])
def test_the_pages_for_developers_name_places_in_the_code(name, least):
    assert len(NAMED.findall((ROOT / "docs" / name).read_text(encoding="utf-8"))) >= least


def test_every_source_file_stands_on_the_houses_map():
    text = (ROOT / "docs" / "developers.md").read_text(encoding="utf-8")
    part = text[text.index("### The engine"):text.index("### Running it")]
    rows = "\n".join(line for line in part.splitlines() if line.startswith("|"))
    mapped = set(re.findall(r"`([\w/]+\.py)`", rows))
    files = {str(p.relative_to(ROOT / folder)) for folder in SOURCES for p in (ROOT / folder).rglob("*.py")}
    assert mapped == {file for file in files if not file.endswith("__init__.py")}


def test_every_property_is_among_all_settings():
    text = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8")
    tree = ast.parse("\n".join((ROOT / "addon" / f"{name}.py").read_text(encoding="utf-8")
                               for name in ("properties", "surface_properties")))
    groups = [n for n in tree.body if isinstance(n, ast.ClassDef)]
    names = {n.target.id for group in groups for n in group.body if isinstance(n, ast.AnnAssign)}
    assert len(names) > 20
    for assigned in (n for n in ast.walk(tree) if isinstance(n, ast.Dict)):  # of materials, and the two switches
        names |= {key.value for key, value in zip(assigned.keys, assigned.values, strict=True)
                  if isinstance(key, ast.Constant) and isinstance(value, ast.Call)}
    assert not {name for name in names if f"`{name}`" not in text}


def template(node):
    """A sentence of the source, with … for what is put in; None for other expressions."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(v.value if isinstance(v, ast.Constant) else "…" for v in node.values)
    return None


@cache
def templates():
    """All sentences of the sources, and of them those that are handed to what tells the artist."""
    said, told = set(), set()
    for path in (p for folder in SOURCES for p in (ROOT / folder).rglob("*.py")):
        tells = "/".join(path.parts[-2:]) not in CHECKED_ELSEWHERE and "bench" not in path.parts
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (text := template(node)) and " " in text:
                said.add(text)
            if isinstance(node, ast.Call) and tells:
                name = getattr(node.func, "id", getattr(node.func, "attr", ""))
                if name in TELLERS:
                    told |= {t for a in node.args if (t := template(a)) and len(re.findall(r"\w{2,}", t)) > 2}
    return said, told


TELLERS = {"SceneError", "ExportError", "EngineError", "EngineGone", "KernelError", "warn", "not_translated", "_warn",
           "_fail"}
# A folder that somebody changed, a caller who misspells: their sentences say all, and no artist meets them.
CHECKED_ELSEWHERE = {"scene/snapshot.py", "scene/values.py", "export/snapshot.py", "scene/arrays.py",
                     "frontends/service.py", "scene/description.py", "scene/mesh.py", "scene/transforms.py",
                     "scene/geometry.py", "scene/validation.py", "scene/programs.py", "scene/profile.py",
                     "frontends/program.py", "light_meshes/cli.py", "film/passes.py", "film/images.py"}


def matches(quoted, text):
    """Whether all pieces of `quoted` between … stand in `text`, in order."""
    at = 0
    for piece in quoted.split("…"):
        at = text.find(piece, at)
        if at < 0:
            return False
        at += len(piece)
    return True


@cache
def quoted():
    """The sentences in the first column of the tables of troubleshooting.md."""
    text = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    cells = [line.split(" | ")[0] for line in text.splitlines() if line.startswith("| ")]
    return [q for cell in cells for q in re.findall(r"`([^`]+)`", cell) if " " in q]


def test_quoted_sentences_are_said_somewhere():
    assert len(quoted()) > 50
    assert not [q for q in quoted() if not any(matches(q, text) for text in templates()[0])]


def test_sentences_for_artists_are_in_troubleshooting():
    assert len(templates()[1]) > 30
    assert not [t for t in templates()[1] if not any(matches(q, t) or matches(t, q) for q in quoted())]
