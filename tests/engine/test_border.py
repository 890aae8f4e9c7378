"""The border between Python and the kernels: whatever a kernel is given that it does not declare is a Python error, and
no crash. All kernels are called with one wrong argument after the other, and with every condition that they declare
(`native.h`) broken, by processes of their own: tests/support/border_calls.py.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from light_meshes.support import native

PACKAGE = Path(native.__file__).parents[1]
SOURCES = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.[ch]"))
NAMES = sorted(set(re.findall(r"^KERNEL\((\w+),", SOURCES, re.M)))
# Kernels whose text stands once for several types.
OF_TYPES = ["semitransparent_mean", "semitransparent_mean_apart",
            *(f"textures_look_{kind}" for kind in ("u8", "u16", "f32"))]
PROGRAM = Path(__file__).parents[1] / "support" / "border_calls.py"


@pytest.mark.parametrize(("wrong", "times"), [("arguments", 100), ("conditions", 30)])
def test_a_wrong_call_is_an_error_and_no_crash(wrong, times):
    """Each condition is broken at least once, also those that released engines do not test at every call."""
    done = subprocess.run([sys.executable, PROGRAM, wrong, *NAMES, *OF_TYPES], capture_output=True, text=True,
                          env=os.environ | {"LIGHT_MESHES_CHECKS": "all"})
    assert done.returncode == 0, f"exit code {done.returncode}: {done.stderr[-2000:]}"
    assert int(re.fullmatch(r"(\d+) refused\n", done.stdout)[1]) > times * len(NAMES)
