"""Everything that sources, tests and pages refer to exists in the repository: sections of the method, scenes, tests."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILES = [path for folder in ("engine", "addon", "tests", "blend_scenes", "docs") for path in (ROOT / folder).rglob("*")
         if path.suffix in {".py", ".c", ".h", ".md"} and path != Path(__file__)]
TEXTS = {path: path.read_text(encoding="utf-8") for path in [*FILES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]}
METHOD, SCENES = ((ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("method.md", "scenes.md"))


def test_sections_of_the_method_are_there():
    named = {(path.name, n) for path, text in TEXTS.items() for n in re.findall(r"method(?:\.md)? §(\d+)", text)}
    sections = set(re.findall(r"^## (\d+)\.", METHOD, re.M))
    assert len(named) > 10 and not {(file, n) for file, n in named if n not in sections}


def test_scenes_are_described():
    named = {(path.name, n) for path, text in TEXTS.items() for n in re.findall(r"\b([SH]\d{1,2})\b(?!\.)", text)}
    described = set(re.findall(r"^\| ([SH]\d{1,2}) \|", SCENES, re.M))
    unknown = {(file, n) for file, n in named if n not in described}
    assert len(described) > 20 and unknown <= {("test_bench.py", "S9")}  # which is one that there is not


def test_tests_that_texts_name_exist():
    named = {n for text in TEXTS.values() for n in re.findall(r"\btests/[\w/]+\.(?:py|sh)\b", text)}
    assert len(named) > 20 and not {n for n in named if not (ROOT / n).is_file()}
