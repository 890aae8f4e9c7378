"""Ruff and mypy are clean, and files stay of a size that one mind holds."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LONG = {}  # file → why it has more than 400 lines


@pytest.mark.skipif(not (shutil.which("ruff") or (Path(sys.executable).parent / "ruff").exists()), reason="no ruff")
def test_ruff_has_nothing_to_say():
    ruff = shutil.which("ruff") or Path(sys.executable).parent / "ruff"
    done = subprocess.run([ruff, "check", "engine", "addon", "tests", "blend_scenes", "docs"], cwd=ROOT,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_mypy_has_nothing_to_say():
    """Of engine and add-on, with the numpy that is installed; .ci/run asks with the oldest and the newest one."""
    pytest.importorskip("mypy")
    done = subprocess.run([sys.executable, "-m", "mypy"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_file_is_long_without_a_reason():
    long = {str(p.relative_to(ROOT)) for folder in ("engine", "addon", "tests", "blend_scenes")
            for p in (ROOT / folder).rglob("*.py") if len(p.read_text(encoding="utf-8").splitlines()) > 400}
    assert long == set(LONG)
