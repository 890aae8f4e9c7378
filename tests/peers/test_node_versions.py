"""Every supported bpy gives the patterns of its own Cycles: this one, and those of LIGHT_MESHES_BPY_PYTHONS."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from node_pictures import agree

oiio = pytest.importorskip("OpenImageIO")
SUPPORT = Path(__file__).parents[1] / "support"
PYTHONS = [sys.executable, *(p for p in os.environ.get("LIGHT_MESHES_BPY_PYTHONS", "").split(os.pathsep) if p)]
pytestmark = pytest.mark.slow
TREES = ["bumps", "others", "lamps", "suns", "area lamps", "worlds"]
CATALOGUE = [*(f"values {n}" for n in range(4)), "images", "inputs", "muted", "structures", "sources"]


def picture(path):
    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))[..., :3]


@pytest.fixture(scope="module", params=PYTHONS)
def sheets(request, tmp_path_factory):
    """(name) → both engines' pictures of a sheet, and the names of its cells. One process draws all of them."""
    import light_meshes_addon

    folder = tmp_path_factory.mktemp("sheets")
    (folder / "packages").mkdir()
    (folder / "packages" / "light_meshes_addon").symlink_to(Path(light_meshes_addon.__file__).parent)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(folder / "packages"), str(SUPPORT)]),
                                "LIGHT_MESHES_PYTHON": sys.executable, "TMPDIR": str(folder)}
    done = subprocess.run([request.param, str(SUPPORT / "node_versions.py"), folder, *TREES, *CATALOGUE],
                          env=environment, capture_output=True, text=True, timeout=1200)
    said = done.stdout[-3000:] + done.stderr[-3000:]

    def drawn(name):
        files = [folder / f"{name}.{whose}.exr" for whose in ("ours", "theirs")]
        assert all(file.exists() for file in files), said
        names = folder / f"{name}.json"
        return *map(picture, files), json.loads(names.read_text()) if names.exists() else None

    yield drawn
    assert done.returncode == 0, said


@pytest.mark.parametrize("name", TREES)
def test_a_sheet_of_trees(sheets, name):
    ours, theirs, _ = sheets(name)
    size = 24 if name == "area lamps" else 32  # as in node_versions.py, which needs a bpy
    for y in range(0, len(ours), size):
        for x in range(0, ours.shape[1], size):
            cell = np.s_[y:y + size, x:x + size]
            if theirs[cell].max() > 0:  # else the sheet's last row ends before
                agree(ours[cell], theirs[cell])


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_catalogue(sheets, name):
    """Every node with each of its choices: in the median within .5 %, and of what is no edge 99 % within 3 %."""
    ours, theirs, (cell, columns, labels) = sheets(name)
    ours, theirs = ((a - 0.5) / 0.12 for a in (ours, theirs))
    seam = np.abs(np.add.outer(np.arange(cell), np.arange(cell)) - cell + 1) <= 1  # between a plane's two triangles
    wrong = []
    for i, label in enumerate(labels):
        y, x = cell * (i // columns), cell * (i % columns)
        a, b = (picture[y:y + cell, x:x + cell] for picture in (ours, theirs))
        around = np.lib.stride_tricks.sliding_window_view(np.pad(b, ((1, 1), (1, 1), (0, 0)), 'edge'), (3, 3), (0, 1))
        step, size = np.ptp(around, axis=(3, 4)).max(2), np.abs(b).max(2)
        difference = np.abs(a - b).max(2) / np.maximum(np.maximum(size, step), 0.1)
        away = difference[(step < max(0.15 * size.max(), 0.1)) & ~seam]
        most = np.quantile(away, 0.99) if len(away) > 0.1 * cell**2 else 0.0
        if not (np.median(difference) <= 0.005 and most <= 0.03):
            wrong.append(f"{label}: {np.median(difference):.4f}, {most:.4f}")
    assert not wrong, "\n".join(wrong)
