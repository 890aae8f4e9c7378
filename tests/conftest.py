"""Make Hypothesis draw the same examples every time; HYPOTHESIS_PROFILE=explore searches for new ones."""

import os
import shutil
import signal
import subprocess

# Kernels are asked whether all that they declare holds, also what released engines leave out (docs/developers.md).
os.environ.setdefault("LIGHT_MESHES_CHECKS", "all")

import hypothesis
import pytest
from children import Child

# Whoever starts the tests in the background may have these ignored, and so would all that the tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

hypothesis.settings.register_profile("default", deadline=None, derandomize=True, max_examples=25)
hypothesis.settings.register_profile("explore", deadline=None, max_examples=500)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

# A command in a namespace of its own, where the folder that is its first argument is a disk of 4 MiB.
SMALL_DISK = ["sh", "-c", 'mount -t tmpfs -o size=4m tmpfs "$0" && exec "$@"']


@pytest.fixture
def child():
    """The engine as a child process."""
    child = Child()
    yield child
    if child.process.poll() is None:
        child.process.terminate()  # it takes its folder along
    child.process.wait()


@pytest.fixture
def small_disk(tmp_path):
    """A command's prefix, and the folder that is a small disk to it."""
    (tmp_path / "disk").mkdir()
    for unshare in (["unshare", "-m"], ["unshare", "-rm"]):  # root, and who may be root in a namespace
        prefix = [*unshare, *SMALL_DISK, tmp_path / "disk"]
        if shutil.which("unshare") and not subprocess.run([*prefix, "true"], capture_output=True).returncode:
            return prefix, str(tmp_path / "disk")
    if "LIGHT_MESHES_BLENDER" in os.environ:
        pytest.fail("no file system can be mounted here")
    pytest.skip("no file system can be mounted here")
