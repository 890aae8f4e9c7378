"""The engine as a real child process with pipes: how every command ends, and that nothing of it outlives its parent."""

import ctypes
import json
import os
import platform
import queue
import signal
import stat
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from children import SECONDS
from light_meshes.picture.render import render_image
from light_meshes.support import scratch
from scenes import four_lights, hall, tabletop


def test_it_is_ready_with_a_private_folder(child):
    assert child.folder.is_dir()
    assert stat.S_IMODE(child.folder.stat().st_mode) == 0o700


@pytest.mark.skipif(os.name == "nt", reason="folders are not locked on Windows")
@pytest.mark.parametrize("locked", [False, True])
def test_a_folder_that_another_engine_removed_before_it_was_locked_is_made_again(tmp_path, monkeypatch, locked):
    """Engines that start at the same time remove each other's folders while these have no lock yet."""
    make, lock, left = tempfile.mkdtemp, scratch._lock, [2]

    def other(folder):
        left[0] -= 1
        if left[0] >= 0:
            scratch.sweep(folder.parent)

    def made(**where):
        folder = Path(make(**where))
        if not locked:
            other(folder)
        return str(folder)

    def locking(folder, wait=False):
        if wait and locked:  # it waits for the one that removes it
            opened = os.open(folder, os.O_RDONLY)
            other(folder)
            return opened
        return lock(folder, wait)

    monkeypatch.setattr(scratch.tempfile, "mkdtemp", made)
    monkeypatch.setattr(scratch, "_lock", locking)
    folder = scratch.make(tmp_path)
    assert folder.is_dir() and left[0] < 0
    scratch.remove(folder)
    assert not list(tmp_path.iterdir())


def test_a_render_tells_its_size_its_tiles_and_its_end(child):
    scene = tabletop(200)
    child.put(scene)
    child.send(command="render", id=7, snapshot="scene", framebuffer="frame", passes=["Combined", "Depth"])
    events = child.of(7)
    kinds = [e["event"] for e in events]
    started = next(e for e in events if e["event"] == "started")
    assert (started["width"], started["height"], started["passes"]) == (200, 200, {"Combined": 4, "Depth": 1})
    assert kinds[-1] == "done" and kinds.count("started") == 1
    fractions = [e["fraction"] for e in events if e["event"] == "progress"]
    assert fractions == sorted(fractions) and fractions[-1] == 1
    covered = np.zeros((200, 200), int)
    for e in events:
        if e["event"] == "tile":
            x0, y0, x1, y1 = e["box"]
            covered[y0:y1, x0:x1] += 1
    assert (covered == 1).all()
    expected = render_image(scene, ("Combined", "Depth"))
    for name in ("Combined", "Depth"):
        np.testing.assert_array_equal(np.load(child.folder / "frame" / f"{name}.npy"), expected.passes[name])
    assert events[-1]["statistics"]["triangles"] == expected.statistics["triangles"]


def test_several_renders_one_after_the_other(child):
    for number, scene in enumerate((tabletop(40), four_lights(40), tabletop(24))):
        child.put(scene, f"scene{number}")
        child.send(command="render", id=number, snapshot=f"scene{number}", framebuffer=f"frame{number}")
    for number in range(3):
        assert child.of(number)[-1]["event"] == "done"


def test_h_is_measured(child):
    child.put(tabletop(64))
    child.send(command="measure", id=1, snapshot="scene")
    (event,) = child.of(1)
    assert event["event"] == "measured" and 0.01 < event["h"] < 0.1 and set(event["radii"]) == {None}


def test_the_radii_of_lights_by_their_size_are_measured(child):
    scene = tabletop(64)
    lamp = replace(scene.lights[0], radius=0.2, softness="LIGHT_SIZE")
    child.put(replace(scene, lights=(lamp,)))
    child.send(command="measure", id=1, snapshot="scene")
    (event,) = child.of(1)
    (radius,) = event["radii"]
    assert 0.01 < radius < 0.5


def test_cancel_ends_a_render_within_a_fifth_of_a_second_and_the_next_one_works(child):
    child.put(tabletop(16), "small")
    child.send(command="render", id=1, snapshot="small", framebuffer="frame")  # so that nothing is left to load
    child.of(1)
    child.put(hall(64, columns=6, width=1500, samples=16, filter_size=1.5), "large")
    child.send(command="render", id=2, snapshot="large", framebuffer="large frame")
    while child.next()["event"] != "tile":
        pass
    asked = time.monotonic()
    child.send(command="cancel", id=2)
    assert child.of(2)[-1]["event"] == "cancelled"
    assert time.monotonic() - asked < 0.2
    child.send(command="render", id=3, snapshot="small", framebuffer="frame")
    assert child.of(3)[-1]["event"] == "done"


def test_cancel_before_a_render_starts(child):
    child.put(hall(64, columns=6, width=1000, samples=16), "large")
    child.put(tabletop(16), "small")
    child.send(command="render", id=1, snapshot="large", framebuffer="frame1")
    child.send(command="render", id=2, snapshot="small", framebuffer="frame2")
    child.send(command="cancel", id=2)
    child.send(command="cancel", id=1)
    assert child.of(1)[-1]["event"] == "cancelled"
    assert [e["event"] for e in child.of(2)] == ["cancelled"]


@pytest.mark.parametrize("line", [b"no json", b"", b"[]", b"3", b"null", b'"quit"', b"{}", b'{"id": 1}', b"{" * 100_000,
                                  b"\xff\xfe", b'{"command": ["render"]}', b'{"command": "cancel", "id": [1]}',
                                  b'{"command": "cancel", "id": {}}', b'{"command": "cancel"}'],
                         ids=lambda line: repr(line[:30]))
def test_a_bad_line_is_answered_and_the_child_lives_on(child, line):
    child.write(line + b"\n")
    child.put(tabletop(8))
    child.send(command="measure", id="after", snapshot="scene")
    events = [child.next()]
    while events[-1]["event"] != "measured":
        events.append(child.next())
    assert [e["event"] for e in events[:-1]] in ([], ["error"])
    child.process.stdin.close()
    assert child.gone() == 0


@pytest.mark.parametrize(("command", "sentence"), [
    ({"command": "dance"}, "dance"),
    ({"command": "render"}, "snapshot"),
    ({"command": "render", "snapshot": "nowhere", "framebuffer": "f"}, "no snapshot"),
    ({"command": "render", "snapshot": 3, "framebuffer": "f"}, "snapshot"),
    ({"command": "render", "snapshot": "scene"}, "framebuffer"),
    ({"command": "render", "snapshot": "scene", "framebuffer": "f", "passes": ["Fog"]}, "Fog"),
    ({"command": "render", "snapshot": "scene", "framebuffer": "f", "passes": 3}, "passes"),
    ({"command": "measure", "snapshot": "nowhere"}, "no snapshot"),
    ({"command": "measure", "snapshot": "no\nwhere\x15"}, "no\\nwhere\\x15 is no snapshot"),
    ({"command": "measure", "snapshot": "no\0where"}, "snapshot"),
    ({"command": "measure", "snapshot": "\ud800"}, "snapshot"),
    ({"command": "x" * 10**6}, "unknown command 'xxx"),
    ({"command": "render", "snapshot": "broken", "framebuffer": "f"}, "cut short"),
])
def test_a_bad_command_is_answered_in_a_sentence_with_its_id(child, command, sentence):
    child.put(tabletop(8))
    child.put(tabletop(8), "broken")
    file = child.folder / "broken" / "vertices.npy"
    file.write_bytes(file.read_bytes()[:-7])
    child.send(id=5, **command)
    (event,) = child.of(5)
    assert event["event"] == "error" and sentence in event["message"]
    child.send(command="measure", id=6, snapshot="scene")
    assert child.of(6)[-1]["event"] == "measured"


def test_broken_snapshots_are_refused_and_the_child_renders_on(child):
    def text(old, new):
        def edit(folder):
            json_file = folder / "scene.json"
            assert old in json_file.read_text()
            json_file.write_text(json_file.read_text().replace(old, new, 1))
        return edit

    def array(name, change):
        return lambda folder: np.save(folder / name, change(np.load(folder / name)))

    broken = {
        "cut short": lambda folder: os.truncate(folder / "triangles.npy", 500),
        "corner_normals has": array("corner_normals.npy", lambda a: a[:-1]),
        "vertices.npy is float64": array("vertices.npy", np.float64),
        "vertex does not exist": array("triangles.npy", lambda a: a + 10**6),
        "points outside": array("meshes.npy", lambda a: a * 10**12),
        "kI is nan": text('"kI": 3.0', '"kI": NaN'),
        "leads out of a folder": text('"images": []', '"images": [{"name": "x", "path": "../../etc/passwd"}]'),
        "no plain name": text('"images": []', '"images": [], "blocks": ["../scene"]'),
        "version 2": text('"version": 1', '"version": 2'),
        "no such file": lambda folder: (folder / "uvs.npy").unlink(),
        "is no snapshot": lambda folder: ((folder / "scene.json").unlink(), (folder / "scene.json").mkdir()),
    }
    for number, (sentence, edit) in enumerate(broken.items()):
        child.put(tabletop(8), f"broken-{number}")
        edit(child.folder / f"broken-{number}")
        child.send(command="render", id=number, snapshot=f"broken-{number}", framebuffer="frame")
        (event,) = child.of(number)
        assert event["event"] == "error" and sentence in event["message"], event
        assert len(event["message"]) < 300 and event["message"].isprintable()
    assert not (child.folder / "frame").exists()
    child.put(tabletop(8))
    child.send(command="render", id=99, snapshot="scene", framebuffer="frame")
    assert child.of(99)[-1]["event"] == "done"


def test_it_says_that_it_is_alive_every_second(child):
    end = time.monotonic() + 3.5
    signs = []
    while time.monotonic() < end:
        try:
            signs.append(child.events.get(timeout=end - time.monotonic()))
        except queue.Empty:
            break
    assert 2 <= sum(e["event"] == "alive" for e in signs) <= 4


def test_quit_ends_it(child):
    child.send(command="quit")
    assert child.gone() == 0


def test_a_closed_stdin_ends_it(child):
    child.process.stdin.close()
    assert child.gone() == 0


@pytest.mark.skipif(sys.platform != "linux", reason="a signal for one thread of another process")
def test_a_signal_that_does_not_wake_the_main_thread_ends_it(child):
    """A signal that comes just before the main thread begins to wait does not interrupt the wait; nor does one that the
    system hands to another thread, as here. Without an end to the wait the process stayed for ever.
    """
    child.send(command="nothing", id=1)
    assert child.next()["event"] == "error"
    time.sleep(0.3)  # so that it waits
    pid = child.process.pid
    other = next(int(thread.name) for thread in Path(f"/proc/{pid}/task").iterdir() if int(thread.name) != pid)
    number = {"x86_64": 234, "aarch64": 131}[platform.machine()]  # of the system call tgkill
    assert ctypes.CDLL(None).syscall(number, pid, other, int(signal.SIGTERM)) == 0
    assert child.gone() == 0


@pytest.mark.parametrize("end", ["closed stdin", "SIGTERM"])
def test_in_mid_render_it_ends_at_once_and_leaves_nothing(child, end):
    child.put(hall(64, columns=6, width=1500, samples=16, filter_size=1.5))
    child.send(command="render", id=1, snapshot="scene", framebuffer="frame")
    while child.next()["event"] != "tile":
        pass
    started = time.monotonic()
    if end == "closed stdin":
        child.process.stdin.close()
    else:
        child.process.terminate()
    child.gone()
    assert time.monotonic() - started < 3


def test_it_ends_when_nobody_listens():
    process = subprocess.Popen([sys.executable, "-m", "light_meshes.frontends.service"], stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE)
    folder = Path(json.loads(process.stdout.readline())["folder"])
    process.stdout.close()  # the next sign of life finds no reader
    assert process.wait(SECONDS) == 0
    assert not folder.exists()


def test_an_interrupt_is_the_parents_affair(child):
    child.process.send_signal(signal.SIGINT)
    child.put(tabletop(8))
    child.send(command="measure", id=1, snapshot="scene")
    assert child.of(1)[-1]["event"] == "measured"


def test_it_does_not_outlive_a_parent_that_is_killed():
    """SIGKILL leaves the parent no chance to clean up: the pipes close, and the child notices."""
    code = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-m", "light_meshes.frontends.service"], stdin=subprocess.PIPE,
                         stdout=subprocess.PIPE, text=True)
print(child.pid, child.stdout.readline(), flush=True)
time.sleep(600)
"""
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    pid, ready = parent.stdout.readline().split(maxsplit=1)
    folder = Path(json.loads(ready)["folder"])
    assert folder.is_dir()
    parent.kill()
    parent.wait()
    end = time.monotonic() + 10
    while (folder.exists() or _running(int(pid))) and time.monotonic() < end:
        time.sleep(0.05)
    assert not folder.exists() and not _running(int(pid))


def _running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/status")  # one that nobody has waited for yet is gone all the same
    return not (status.exists() and "State:\tZ" in status.read_text())
