"""A scene that is too large is refused before the render starts, and the expected memory agrees with the real one."""

import struct
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from light_meshes.film import images as film
from light_meshes.picture import memory
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import draw
from light_meshes.scene import snapshot
from light_meshes.scene.description import Image
from light_meshes.scene.errors import SceneError
from light_meshes.support.statistics import peak_memory
from scenes import hall, point, tabletop, with_lights

SUPPORT = Path(__file__).parents[1] / "support"

GIB = 1 << 30


def many(instances, triangles):
    """A scene of one mesh in many places."""
    scene = tabletop(16)
    g = scene.geometry
    mesh = np.array([[0, g.meshes[0, 1], 0, triangles]])
    return replace(scene, geometry=replace(
        g, triangles=np.zeros((triangles, 3), np.int32), corner_normals=np.zeros((triangles, 3, 3), np.float32),
        triangle_materials=np.zeros(triangles, np.int32), meshes=mesh, instance_mesh=np.zeros(instances, np.int32),
        instance_object=np.zeros(instances, np.int32), instance_matrix=np.tile(np.eye(4), (instances, 1, 1))))


def too_large(what):
    """Scenes that no machine of today renders."""
    scene = tabletop(16)
    if what == "triangles":
        return many(20_000, 100_000)
    if what == "pixels":
        return replace(scene, camera=replace(scene.camera, width=65536, height=65536), settings=replace(
            scene.settings, h=1.0))
    crowd = with_lights(scene, *(replace(point((0, 0, 3)), name=str(n)) for n in range(4096)))
    return replace(crowd, camera=replace(scene.camera, width=4096, height=4096)).with_settings(h=1e-6, samples=4096)


def test_a_scene_too_large_is_refused_before_it_starts(child, tmp_path):
    passes = ["Combined", "Normal", "Position", "Diffuse", "Glossy", "Shadow", "Ambient"]
    for number, (what, words) in enumerate({
        "triangles": ["2,000,000,000 triangles in 20,000 instances", "hide objects"],
        "pixels": ["65,536 × 65,536 pixels", "smaller picture"],
        "nodes": ["nodes of light meshes with 4,096 lights", "larger step than h = 1e-06"],
    }.items()):
        snapshot.write(too_large(what), tmp_path / what)
        child.send(command="render", id=number, snapshot=str(tmp_path / what), framebuffer="frame", passes=passes)
        error = child.of(number)[-1]
        assert error["event"] == "error", what
        for word in ["GiB of memory, and there are", *words]:
            assert word in error["message"]
    # The child lives on.
    child.put(tabletop(16))
    child.send(command="render", id=9, snapshot="scene", framebuffer="frame", passes=["Combined"])
    assert child.of(9)[-1]["event"] == "done"


def test_the_parent_holds_the_picture_as_well(child, tmp_path):
    """As Blender does: a picture that just goes into memory once is refused before it starts."""
    side = int(np.sqrt(0.9 * memory.available() / 16))
    scene = tabletop(16)
    snapshot.write(replace(scene, camera=replace(scene.camera, width=side, height=side)), tmp_path / "large")
    child.send(command="render", id=1, snapshot=str(tmp_path / "large"), framebuffer="frame", passes=["Combined"])
    first = child.next()
    assert first["event"] == "error" and f"{side:,} × {side:,} pixels" in first["message"]


def test_images_count_before_they_are_read(tmp_path, monkeypatch):
    """A small file may hold a large picture: its first bytes tell. It comes out of a cache of tiles with a limit."""
    header = struct.pack(">IIBBBBB", 50_000, 50_000, 8, 2, 0, 0, 0)
    path = tmp_path / "large.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in ((b"IHDR", header), (b"IDAT", b""), (b"IEND", b""))))
    scene = tabletop(16)
    images = (Image("large", str(path)), Image("lost", str(tmp_path / "lost.png")))
    scene = replace(scene, images=images, materials=tuple(replace(m, image=0) for m in scene.materials),
                    geometry=replace(scene.geometry, uvs=np.zeros((len(scene.geometry.triangles), 3, 2), np.float32)))
    monkeypatch.setattr(memory, "available", lambda: GIB)
    with pytest.raises(SceneError) as refused:
        Prepared(scene)
    assert "1 image texture, the largest 'large' of 50,000 × 50,000 take 2.0; scale images down" in str(refused.value)


def test_where_it_will_be_close_a_warning_says_so(monkeypatch):
    scene = tabletop(16)
    need = Prepared(scene).memory
    monkeypatch.setattr(memory, "available", lambda: int(need / 0.7))
    assert not Prepared(scene).warnings
    monkeypatch.setattr(memory, "available", lambda: int(need / 0.9))
    (warning,) = Prepared(scene).warnings
    assert "if it fails" in warning
    monkeypatch.setattr(memory, "available", lambda: int(need / 1.2))  # it may fit all the same
    assert Prepared(scene).warnings
    monkeypatch.setattr(memory, "available", lambda: int(need / 1.3))
    with pytest.raises(SceneError, match="the engine itself"):
        Prepared(scene)
    monkeypatch.setattr(memory, "available", lambda: None)
    assert not Prepared(scene).warnings


MEASURE = """
import sys
sys.path.insert(0, sys.argv[1])
from light_meshes.film.images import Framebuffer
from light_meshes.picture.prepared import Prepared
from light_meshes.picture.render import draw
from light_meshes.support.statistics import peak_memory
from scenes import hall
scene = hall(*map(int, sys.argv[2:6]), h=float(sys.argv[6]))
ready = Prepared(scene)
draw(ready, Framebuffer.create(scene, ("Combined",)))
print(ready.memory, peak_memory())
"""


def held(*hall_of, h):
    """Bytes expected and held at most by a process that renders hall(*hall_of)."""
    done = subprocess.run([sys.executable, "-c", MEASURE, SUPPORT, *map(str, [*hall_of, h])],
                          capture_output=True, text=True, check=True)
    expected, peak = map(float, done.stdout.split())
    return expected, peak


@pytest.mark.parametrize(("case", "h"), [((4, 8, 120, 64), 0.05), ((64, 3, 24, 400), 0.02)],
                         ids=["triangles", "lights"])
def test_what_is_expected_is_what_it_comes_to(case, h):
    expected, peak = held(*case, h=h)
    assert expected / memory.DOUBT < peak < memory.DOUBT * expected


def test_the_nodes_that_are_expected_come_to_be():
    scene = hall(200, columns=3, width=200, h=0.02)
    ready = Prepared(scene)
    draw(ready, film.Framebuffer.create(scene, ("Combined",)))
    part = memory.nodes(ready.scene, ready.world, ready.soft.lattice.reach, ready.plan.channels)
    expected = float(part.what.split()[1].replace(",", ""))
    assert 0.5 < expected / ready.soft.store.count < 2


def test_peak_memory_is_that_of_the_process_and_not_of_what_started_it():
    here = np.ones(60_000_000)  # 480 MB
    code = "from light_meshes.support.statistics import peak_memory; print(peak_memory())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 5e6 < int(done.stdout) < here.nbytes < peak_memory()


def test_available_memory():
    total = int(Path("/proc/meminfo").read_text().split("MemTotal:")[1].split()[0]) * 1024
    assert 0 < memory.available() <= 2 * total


def group(folder, values, cached):
    folder.mkdir(parents=True, exist_ok=True)
    for name, value in values.items():
        (folder / name).write_text(f"{value}\n")
    name = "inactive_file" if "memory.max" in values else "total_inactive_file"
    (folder / "memory.stat").write_text(f"anon 5\n{name} {cached}\n")


def test_limits_of_control_groups(tmp_path):
    group(tmp_path, {"memory.max": 10 * GIB, "memory.current": 4 * GIB}, GIB)
    group(tmp_path / "job" / "task", {"memory.max": "max", "memory.current": GIB}, 0)
    group(tmp_path / "memory" / "batch", {"memory.limit_in_bytes": 3 * GIB, "memory.usage_in_bytes": GIB}, 0)
    text = "3:cpu,cpuacct:/x\n4:memory:/batch/step\n0::/job/task\n"
    assert sorted(memory.left_in(text, tmp_path)) == [2 * GIB, 7 * GIB]


KEPT = """
import sys, threading
import numpy as np
from light_meshes.support import allocation
from light_meshes.support.statistics import peak_memory
if sys.argv[1] == "keep":
    allocation.keep()
turn, end = threading.Lock(), threading.Barrier(9)
def tiles():
    with turn:
        for _ in range(20):
            np.ones(10 << 20, np.uint8)
    end.wait()
before = peak_memory()
for _ in range(8):
    threading.Thread(target=tiles).start()
end.wait()
print(peak_memory() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the settings are those of Linux' C library")
def test_threads_use_the_memory_that_others_have_freed():
    """Eight threads, each of which has 10 MiB for a while, one after the other."""
    found = [int(subprocess.run([sys.executable, "-c", KEPT, how], capture_output=True, text=True, check=True).stdout)
             for how in ("keep", "leave")]
    assert found[0] < 25 << 20 < 60 << 20 < found[1]
