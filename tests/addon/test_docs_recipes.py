"""The recipes of docs/headless.md, run as they are printed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import OpenImageIO as oiio
import pytest

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^<!-- run -->\n```sh\n(.*?)^```\n<!-- end -->$", re.M | re.S)
RECIPES = BLOCK.findall((ROOT / "docs" / "headless.md").read_text(encoding="utf-8"))
MAKES = [  # what each recipe leaves: file → its width, or what it says
    {"tabletop.png": 200},
    {f"frames/lights_000{n}.exr": 320 for n in (1, 3, 4)},
    "All is translated",
    {"blend_scenes/light_0001.png": 320},
    {"blend_scenes/sharp_0001.png": 200},
    {f"blend_scenes/radius-{radius}.png": 118 for radius in (0.05, 0.1, 0.2)},
    {"soft.exr": 200},
]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A copy of the folders that recipes read."""
    folder = tmp_path_factory.mktemp("clone")
    shutil.copytree(ROOT / "blend_scenes", folder / "blend_scenes", ignore=shutil.ignore_patterns("*.py"))
    return folder


@pytest.fixture(scope="module")
def environment(place, blender_path, blender_environment):
    """light-meshes, python and blender on the PATH, the add-on enabled, and told the engine's Python."""
    commands = place / "bin"
    commands.mkdir()
    for name, words in {"light-meshes": [sys.executable, "-m", "light_meshes.cli"], "python": [sys.executable],
                        "blender": [blender_path]}.items():
        command = commands / name
        command.write_text("#!/bin/sh\nexec " + " ".join(f"'{word}'" for word in words) + ' "$@"\n')
        command.chmod(0o755)
    return blender_environment | {"PATH": f"{commands}{os.pathsep}{os.environ['PATH']}"}


def test_every_recipe_is_run():
    assert len(RECIPES) == len(MAKES) == (ROOT / "docs" / "headless.md").read_text().count("```sh")


@pytest.mark.parametrize("n", range(len(RECIPES)))
def test_recipe(n, place, environment):
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", RECIPES[n]], cwd=place, env=environment, text=True,
                          capture_output=True, timeout=180)
    assert done.returncode == 0, done.stdout + done.stderr
    made = MAKES[n]
    if isinstance(made, str):
        assert made in done.stdout
        return
    for name, width in made.items():
        picture = oiio.ImageBuf(str(place / name))
        assert picture.spec().width == width, f"{name}: {picture.geterror()}"
        assert oiio.ImageBufAlgo.computePixelStats(picture).max[0] > 0.1  # not black
