"""A shadow method is one file, and its name in one line elsewhere: the recipe of docs/developers.md, followed."""

import difflib
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.description import SHADOWS, Settings
from light_meshes.scene.errors import SceneError
from light_meshes.shadows import registry
from scenes import four_lights, with_settings

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "engine" / "light_meshes"


def recipe():
    """The file of the recipe: the Python that the page shows."""
    text = (ROOT / "docs" / "developers.md").read_text(encoding="utf-8")
    part = text[text.index("## Add a shadow method"):text.index("## Add a kernel")]
    shown = re.search(r"( *)```python\n(.*?)```", part, re.S)
    return re.sub(rf"^{shown[1]}", "", shown[2], flags=re.M)


def lines(folder):
    return {path.relative_to(folder): path.read_text(encoding="utf-8").splitlines()
            for path in folder.rglob("*") if path.suffix in {".py", ".c", ".h"}}


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """A copy of the engine, with the method."""
    package = tmp_path_factory.mktemp("engine") / "light_meshes"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "shadows" / "half.py").write_text(recipe(), encoding="utf-8")
    description = package / "scene" / "description.py"
    text = description.read_text(encoding="utf-8")
    named = re.sub(r"^(SHADOWS = \(.*)\)", r'\1, "HALF")', text, flags=re.M)
    assert named != text
    description.write_text(named, encoding="utf-8")
    return package


def run(package, *arguments):
    script = "import sys; from light_meshes import cli; print(cli.__file__); sys.exit(cli.main())"
    done = subprocess.run([sys.executable, "-c", script, *map(str, arguments)], capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": str(package.parent)}, timeout=120)
    assert not done.stdout or str(package) in done.stdout  # the copy, and not the engine that is installed
    return done


def test_it_is_one_new_file_and_at_most_two_lines_elsewhere(extended):
    before, after = lines(PACKAGE), lines(extended)
    assert set(after) - set(before) == {Path("shadows/half.py")} and set(before) <= set(after)
    changed = [line for name in before for line in difflib.ndiff(before[name], after[name]) if line.startswith("+ ")]
    assert 1 <= len(changed) <= 2, changed


@pytest.mark.parametrize("share", [None, 0.25])
def test_it_renders(extended, tmp_path, share):
    scene = replace(with_settings(four_lights(24), mode="LOCAL"), world_color=(0.0, 0.0, 0.0))  # no light but lamps
    full = render_image(scene).passes["Combined"]
    snapshot.write(with_settings(scene, mode="RAY_CASTING"), tmp_path / "scene")
    own = [] if share is None else ["--set", f"method.share={share}"]
    done = run(extended, "render", tmp_path / "scene", "-o", tmp_path / "half.exr", "--set", "shadows=HALF", *own)
    assert done.returncode == 0, done.stderr
    found = oiio.ImageBuf(str(tmp_path / "half.exr")).get_pixels(oiio.FLOAT)[::-1]
    assert full[..., :3].max() > 0.1
    np.testing.assert_allclose(found[..., :3], (share or 0.5) * full[..., :3], rtol=1e-5)


@pytest.mark.parametrize(("setting", "sentence"), [
    ("method.share=2", "share is 2; it must lie between 0 and 1"), ("method.share=yes", "must be a finite number"),
    ("method.part=0.5", "there is no property 'part'; there are share")])
def test_its_setting_is_checked(extended, tmp_path, setting, sentence):
    snapshot.write(four_lights(8), tmp_path / "scene")
    done = run(extended, "render", tmp_path / "scene", "-o", tmp_path / "x.exr", "--set", "shadows=HALF", "--set",
               setting)
    assert done.returncode == 1 and sentence in done.stderr, done.stderr


def test_the_registry_has_the_methods_that_a_scene_can_name():
    assert set(registry.KINDS) == {registry.NONE, *SHADOWS}
    with pytest.raises(SceneError, match="no property 'share'"):
        registry.check(Settings(method={"share": 0.5}))
