"""Compare the memory of 2·10⁶ triangles under 64 lamps with an earlier release's, which another Python has:

    python tests/support/release_memory.py PYTHON

Each release renders the hall of the benchmark at 1000², 4 samples a pixel, in a process of its own. The largest memory
of each is printed, and that before the picture. It is run by hand: an earlier release is no part of the tests.
"""

import subprocess
import sys
import tempfile

TRIANGLES, LIGHTS = 2_000_000, 64

# Modules have other places in the first release.
CHILD = f"""
import resource, sys
from pathlib import Path
import light_meshes
from light_meshes.bench import scenes
try:
    from light_meshes.picture.render import render_image
    from light_meshes.support import allocation
    allocation.keep()  # as the engine's own programs do
except ImportError:
    from light_meshes.render import render_image
hall = scenes.hall(scenes.exported("S7", Path(sys.argv[1])), {TRIANGLES})
scene = scenes.sized(scenes.case("S8", hall, {LIGHTS}).scene, 1000, samples=4)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
told = render_image(scene).statistics
print(light_meshes.__version__, before >> 10, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10, told["nodes"])
"""


def peak(python: str) -> int:
    """Return the largest memory in MiB that the release of `python` takes; prints it."""
    with tempfile.TemporaryDirectory() as folder:
        said = subprocess.run([python, "-P", "-c", CHILD, folder], check=True, capture_output=True, text=True).stdout
    version, before, most, nodes = said.split()[-4:]
    print(f"{version}: {int(most):,} MiB, {int(before):,} before the picture; {int(nodes):,} nodes", flush=True)
    return int(most)


if __name__ == "__main__":
    old, new = (peak(python) for python in (sys.argv[1], sys.executable))
    print(f"{new / old:.2f} of it")
