"""Where compiled kernels are kept, and that it is told when they are compiled: each in a process of its own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
from light_meshes import averaging, compiled
compiled.watch(lambda fraction, sentence: print(f"{fraction:.2f} {sentence}"))
averaging.falloff(0.5)
print(compiled._folder)
"""


@pytest.fixture
def run(tmp_path):
    """(**environment) → what a process says that needs one kernel; its last line is where kernels are kept."""
    def go(**environment):
        clean = {k: v for k, v in os.environ.items() if k not in {"LIGHT_MESHES_CACHE", "NUMBA_CACHE_DIR"}}
        done = subprocess.run([sys.executable, "-c", SCRIPT], env=clean | environment, capture_output=True, text=True,
                              timeout=120, check=True)
        return done.stdout.splitlines()
    return go


def test_the_folder_of_an_installation_is_private_and_holds_one_version(run, tmp_path):
    root = tmp_path / "installed"
    older = root / "light-meshes" / "0123456789abcdef"
    older.mkdir(parents=True)
    *told, folder = run(LIGHT_MESHES_CACHE=str(root), NUMBA_CACHE_DIR=str(tmp_path / "elsewhere"))
    assert [str(p) for p in older.parent.iterdir()] == [folder] and not (tmp_path / "elsewhere").exists()
    assert older.with_name(folder.rpartition("/")[2]).stat().st_mode & 0o777 == 0o700
    assert len(told) == 1 and "Compiling kernels (once after an installation): 1 of about" in told[0]
    assert run(LIGHT_MESHES_CACHE=str(root)) == [folder]  # nothing to compile any more
    if os.name != "nt":  # what others may write is not loaded
        Path(folder).chmod(0o777)
        *told, folder = run(LIGHT_MESHES_CACHE=str(root))
        assert folder == "None" and "each time" in told[0]


def test_a_folder_that_cannot_be_written(run, tmp_path):
    (tmp_path / "file").touch()
    *told, folder = run(LIGHT_MESHES_CACHE=str(tmp_path / "file"))
    assert folder == "None" and "each time, as there is no private folder to keep them in" in told[0]
