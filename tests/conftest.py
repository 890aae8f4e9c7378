"""Make Hypothesis draw the same examples every time; HYPOTHESIS_PROFILE=explore searches for new ones. And let no test
wait for ever.
"""

import collections
import contextlib
import faulthandler
import os
import shutil
import signal
import subprocess
import threading

# Kernels are asked whether all that they declare holds, also what released engines leave out (docs/developers.md).
os.environ.setdefault("LIGHT_MESHES_CHECKS", "all")

# Engines keep what Python compiles; otherwise each of more than a thousand would compile all modules again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

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

# Seconds after which a test, or a fixture, fails and shows where it hangs. The slowest takes two minutes on an idle
# machine. Where Python cannot interrupt it, its process ends a minute later and tells where each thread is.
MOST_SECONDS = 1800
# Files that take longest, of those that have few tests. Those with a window do not stand side by side.
LONGEST = ("addon_installed", "node_versions", "addon_every_property", "ggx", "addon_viewport_troubles", "build",
           "refraction_figures", "addon_viewport", "addon_jobs", "addon_faults", "addon_headless", "addon_in_blender",
           "random_scenes", "reflections", "patched", "addon_kills", "addon_sized_pictures", "control_oracle", "farm",
           "addon_console", "current_folder", "shaders_random", "contest", "caustics", "addon_versions", "border",
           "claims")
UNCAPTURED = pytest.StashKey[int]()

# A command in a namespace of its own, where the folder that is its first argument is a disk of 4 MiB.
SMALL_DISK = ["sh", "-c", 'mount -t tmpfs -o size=4m tmpfs "$0" && exec "$@"']


def pytest_configure(config):
    config.stash[UNCAPTURED] = os.dup(2)  # later pytest keeps what is written there
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False  # pytest-xdist's own order is by numbers of tests alone


def pytest_collection_modifyitems(items):
    """Begin with the files that take longest, so that processes that share the tests end together; then those of many
    tests. The order within a file stays.
    """
    counts = collections.Counter(item.path for item in items)
    last = len(LONGEST)
    rank = {f"test_{name}": n for n, name in enumerate(LONGEST)}
    items.sort(key=lambda item: (rank.get(item.path.stem, last), -counts[item.path], str(item.path)))


@contextlib.contextmanager
def bounded(item, what):
    """Let `what`, a part of the test `item`, end after MOST_SECONDS."""
    def late(*_):
        pytest.fail(f"{what} of {item.nodeid} has not ended after {MOST_SECONDS} seconds")

    faulthandler.dump_traceback_later(MOST_SECONDS + 60, exit=True, file=item.config.stash[UNCAPTURED])
    alarm = hasattr(signal, "SIGALRM") and threading.current_thread() is threading.main_thread()
    if alarm:
        before = signal.signal(signal.SIGALRM, late)
        signal.alarm(MOST_SECONDS)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        if alarm:
            signal.alarm(0)
            signal.signal(signal.SIGALRM, before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    with bounded(item, "the setup"):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    with bounded(item, "the call"):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item):
    with bounded(item, "the teardown"):
        return (yield)


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
