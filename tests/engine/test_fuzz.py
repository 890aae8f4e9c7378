"""A short run of each fuzzer; `fuzz.py` says how to run them for longer. Bugs that they found have their own tests."""

import platform
import re
import subprocess
import sys
from pathlib import Path

import pytest

SUPPORT = Path(__file__).parents[1] / "support"

# Where pyproject.toml has it installed.
ATHERIS = sys.platform == "linux" and platform.machine() == "x86_64" and sys.version_info < (3, 15)


@pytest.mark.skipif(not ATHERIS, reason="atheris has wheels for Linux on x86-64")
@pytest.mark.parametrize(("target", "runs", "branches"), [("snapshot", 1000, 150), ("commands", 300, 80),
                                                          ("events", 20000, 30)])
def test_whatever_it_is_given_it_is_read_or_refused(tmp_path, target, runs, branches):
    done = subprocess.run([sys.executable, SUPPORT / "fuzz.py", target, "--runs", str(runs)],
                          cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
    last = re.search(r"DONE +cov: (\d+)", done.stderr)
    assert last and int(last[1]) > branches, done.stderr[-3000:]
    assert f"number_of_executed_units: {runs}" in done.stderr
