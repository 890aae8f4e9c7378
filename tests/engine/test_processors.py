"""The number of threads: the number that was set, or otherwise the processors that this process may use, by number and
by time.
"""

import os
import subprocess
import sys

import pytest
from light_meshes.picture import memory
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from light_meshes.scene.errors import SceneError
from light_meshes.support import processors
from scenes import tabletop


@pytest.fixture
def told():
    yield
    processors.tell(None)


def test_a_share_of_the_time_counts(tmp_path):
    """In both versions of control groups, in the group itself and around it."""
    def put(file, text):
        path = tmp_path / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    put("cpu.max", "max 100000\n")
    put("job/cpu.max", "350000 100000\n")
    put("job/task/cpu.max", "max 100000\n")
    assert list(processors.allowed("0::/job/task", tmp_path)) == [3.5]
    put("cpu,cpuacct/cpu.cfs_quota_us", "-1\n")
    put("cpu,cpuacct/cpu.cfs_period_us", "100000\n")
    put("cpu,cpuacct/slurm/cpu.cfs_quota_us", "150000\n")
    put("cpu,cpuacct/slurm/cpu.cfs_period_us", "100000\n")
    assert list(processors.allowed("4:memory:/x\n3:cpu,cpuacct:/slurm/step\n", tmp_path)) == [1.5]
    assert list(processors.allowed("", tmp_path)) == []


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system has no affinity")
def test_only_the_processors_that_are_allowed():
    code = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); " \
        "from light_meshes.support import processors; print(processors.count())"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "1\n"


def test_what_is_told_is_used_and_the_picture_is_the_same(told):
    one, five = (None, None)
    processors.tell(1)
    one = render_image(tabletop(40))
    processors.tell(5)
    five = render_image(tabletop(40))
    assert (one.statistics["threads"], five.statistics["threads"]) == (1, 5)
    assert (one.passes["Combined"] == five.passes["Combined"]).all()
    threads = next(part for part in memory.before(tabletop(40), ("Combined",)) if "threads" in part.what)
    assert threads.what.startswith("5 threads") and "--threads" in threads.remedy


def test_the_command_and_the_child_take_a_number(tmp_path):
    snapshot.write(tabletop(40), tmp_path / "scene")

    def run(number):
        return subprocess.run([sys.executable, "-m", "light_meshes.cli", "render", tmp_path / "scene", "-o",
                               tmp_path / "o.png", "--threads", number], capture_output=True, text=True, timeout=120)
    assert "on 3 threads" in run("3").stdout
    for wrong in ("0", "-1", "1025", "many", ""):
        failed = run(wrong)
        assert failed.returncode == 2 and "from 1 to 1024" in failed.stderr, failed.stderr
    from light_meshes.frontends.service import _threads

    assert _threads({"threads": 2}) == 2 and _threads({}) is None
    for wrong in (0, True, 1.0, "2", 1025):
        with pytest.raises(SceneError, match="threads is"):
            _threads({"threads": wrong})
