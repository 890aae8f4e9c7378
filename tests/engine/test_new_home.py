"""A home in which nothing has been rendered yet: its first picture takes no longer, and nothing is kept in it."""

import os
import resource
import subprocess
import sys

import pytest
from light_meshes.scene import snapshot
from scenes import tabletop

HOMES = ("HOME", "TMPDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR")


def files(folder):
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if not p.is_dir())


@pytest.mark.skipif(sys.platform != "linux", reason="where a home is said by these variables")
def test_the_first_picture_of_a_new_home(tmp_path):
    """Of two homes the seconds of processors, which do not depend on what else runs, for two pictures each."""
    scene, out = tmp_path / "scene", tmp_path / "pictures"
    snapshot.write(tabletop(60, shadows="LIGHT_MESHES"), scene)
    out.mkdir()
    before = files(scene)
    spent = {"first": [], "second": []}
    for number in range(2):
        homes = {name: tmp_path / f"home {number}" / name for name in HOMES}
        for folder in homes.values():
            folder.mkdir(parents=True)
        for turn, seconds in spent.items():
            began = resource.getrusage(resource.RUSAGE_CHILDREN)
            command = [sys.executable, "-m", "light_meshes.cli", "render", scene, "-o", out / f"{number} {turn}.exr"]
            subprocess.run(command,
                           check=True, capture_output=True, cwd=homes["HOME"],
                           env=os.environ | {name: str(folder) for name, folder in homes.items()})
            ended = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds.append(ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime)
        assert files(tmp_path / f"home {number}") == []
    assert min(spent["first"]) < min(spent["second"]) + 0.5
    assert files(out) == ["0 first.exr", "0 second.exr", "1 first.exr", "1 second.exr"]
    assert files(scene) == before
