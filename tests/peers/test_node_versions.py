"""Every supported bpy gives the patterns of its own Cycles: this one, and those of LIGHT_MESHES_BPY_PYTHONS."""

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
pytestmark = [pytest.mark.slow, pytest.mark.parametrize("python", PYTHONS)]


def picture(path):
    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))[..., :3]


@pytest.mark.parametrize("name", ["voronoi", "bumps", "others", "lamps"])
def test_a_sheet_of_trees(python, name, tmp_path):
    import light_meshes_addon

    (tmp_path / "packages").mkdir()
    (tmp_path / "packages" / "light_meshes_addon").symlink_to(Path(light_meshes_addon.__file__).parent)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path / "packages"), str(SUPPORT)]),
                                "LIGHT_MESHES_PYTHON": sys.executable, "TMPDIR": str(tmp_path)}
    files = [tmp_path / "ours.exr", tmp_path / "theirs.exr"]
    done = subprocess.run([python, str(SUPPORT / "node_versions.py"), name, *map(str, files)], env=environment,
                          capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    ours, theirs = map(picture, files)
    for y in range(0, len(ours), 32):
        for x in range(0, ours.shape[1], 32):
            cell = np.s_[y:y + 32, x:x + 32]
            if theirs[cell].max() > 0:  # else the sheet's last row ends before
                agree(ours[cell], theirs[cell])
