"""Highlights of GGX, sheen, what is dimmed below them, and mixed shaders, beside Cycles: balls and squares."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = [pytest.mark.slow,
              pytest.mark.skipif(not importlib.util.find_spec("bpy"), reason="bpy is not installed")]
HERE = Path(__file__).parent
PYTHONS = [p for p in os.environ.get("LIGHT_MESHES_BPY_PYTHONS", "").split(os.pathsep) if p]
COLUMNS = 12  # as in ggx_pictures.py, which needs a bpy
# In the median, and at the 99th percentile.
MOST = {"diffuse": (0.005, 0.03), "gloss": (0.03, 0.12), "whole": (0.01, 0.12)}
PICTURES = ["sun.diffuse", "area.diffuse", "point.gloss", "sun.gloss", "spot.gloss", "area.gloss"]


def draw(python, folder, **sheets):
    """Draw pictures of sheets by a Python's bpy: sheet → those that are wanted. Returns sheet → (its folder, the
    materials' names).
    """
    import light_meshes_addon

    packages = folder / "packages"
    packages.mkdir()
    (packages / "light_meshes_addon").symlink_to(Path(light_meshes_addon.__file__).parent)
    environment = os.environ | {"PYTHONPATH": str(packages), "LIGHT_MESHES_PYTHON": sys.executable,
                                "TMPDIR": str(folder)}
    jobs = [f"{name}:{','.join(wanted)}" for name, wanted in sheets.items()]
    done = subprocess.run([python, str(HERE / "ggx_pictures.py"), str(folder), *jobs], env=environment,
                          capture_output=True, text=True, timeout=600)
    files = {name: folder / name / "cells.json" for name in sheets}
    assert all(file.exists() for file in files.values()), done.stdout[-3000:] + done.stderr[-3000:]
    return {name: (file.parent, json.loads(file.read_text())) for name, file in files.items()}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    return draw(sys.executable, tmp_path_factory.mktemp("ggx"), lobes=PICTURES, mixes=["sun.whole", "area.whole"],
                bumps=["sun.diffuse", "sun.gloss"])


@pytest.fixture(scope="module", params=PYTHONS or [pytest.param(
    None, marks=pytest.mark.skip(reason="LIGHT_MESHES_BPY_PYTHONS names no Python with another bpy"))])
def drawn_elsewhere(request, tmp_path_factory):
    return draw(request.param, tmp_path_factory.mktemp("ggx"), lobes=["sun.diffuse", "sun.gloss"],
                mixes=["sun.whole"], bumps=["sun.diffuse"])


def inside(size):
    """Which pixels of a ball's cell and of a square's, of so many pixels a side, lie away from its edges."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    return np.hypot(x, y) < 0.42 * size, (abs(x) < 0.33 * size) & (abs(y) < 0.33 * size)


def compare(folder, names, name):
    """Assert that both engines' pictures agree, cell by cell; returns how many cells shine."""
    ours, theirs = (np.load(folder / f"{name}.{whose}.npy").astype(float) for whose in ("ours", "theirs"))
    median, most = MOST[name.split(".")[1]]
    size, bright = theirs.shape[1] // COLUMNS, 0
    for cell in range(2 * len(names)):
        y, x = (size * k for k in divmod(cell, COLUMNS))
        pixels = inside(size)[cell % 2]
        a, b = (picture[y:y + size, x:x + size][pixels] for picture in (ours, theirs))
        light = b.max(1)
        if light.max() == 0:
            assert a.max() < 1e-6, names[cell // 2]
            continue
        bright += 1
        seen = light > 0.01 * np.quantile(light, 0.99)  # else at the edge of what the lamp lights
        difference = (np.abs(a - b).max(1) / np.maximum(light, 1e-12))[seen]
        assert np.median(difference) <= median, (names[cell // 2], np.median(difference))
        assert np.quantile(difference, 0.99) <= most, (names[cell // 2], np.quantile(difference, 0.99))
    return bright


@pytest.mark.parametrize("name", PICTURES)
def test_lit_as_in_cycles(drawn, name):
    # Not all have a diffuse part, and not all shine.
    assert compare(*drawn["lobes"], name) >= (30 if name.endswith("diffuse") else 50)


def test_mixed_shaders_are_as_in_cycles(drawn):
    for name in ("sun.whole", "area.whole"):
        assert compare(*drawn["mixes"], name) == 2 * len(drawn["mixes"][1])


def test_bumps_are_lit_as_in_cycles(drawn):
    """What is scattered is softened, and mirrors do not show what is inside."""
    assert compare(*drawn["bumps"], "sun.diffuse") >= 18 and compare(*drawn["bumps"], "sun.gloss") >= 12


def test_in_every_blender(drawn_elsewhere):
    lobes = drawn_elsewhere["lobes"]
    assert compare(*lobes, "sun.diffuse") >= 30 and compare(*lobes, "sun.gloss") >= 50


def test_mixes_and_bumps_in_every_blender(drawn_elsewhere):
    mixes = drawn_elsewhere["mixes"]
    assert compare(*mixes, "sun.whole") == 2 * len(mixes[1])
    assert compare(*drawn_elsewhere["bumps"], "sun.diffuse") >= 18
