"""The command's output: names cannot control a terminal, and no console, closed or with few characters, stops a
render.
"""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from light_meshes.scene import snapshot
from light_meshes.scene.errors import SceneError
from light_meshes.support.text import shown
from scenes import tabletop

COMMAND = [str(Path(sys.executable).parent / "light-meshes")]
# A title, a cleared screen, a line of a farm's protocol, text that runs backwards, a bell, a letter of no UTF-8.
NAME = "é\x1b]0;title\x07\x1b[2J\nopenjd_env: PATH=/evil\r\u202etxt.exe\u2028\udc80\x9b31m"
ESCAPED = r"é\x1b]0;title\x07\x1b[2J\nopenjd_env: PATH=/evil\r\u202etxt.exe\u2028\udc80\x9b31m"


@pytest.fixture
def folder(tmp_path):
    scene = tabletop(8, samples=1)
    snapshot.write(replace(
        scene, warnings=(f"Object '{NAME}': hair is not translated",),
        lights=tuple(replace(light, name=NAME) for light in scene.lights),
        materials=tuple(replace(m, name=NAME) for m in scene.materials),
        objects=tuple(replace(o, name=NAME) for o in scene.objects)), tmp_path / "scene")
    return tmp_path


def run(folder, *arguments, **environment):
    return subprocess.run([*COMMAND, *arguments], cwd=folder, env=os.environ | environment, capture_output=True,
                          timeout=120)


def test_names_are_shown_as_they_are():
    assert shown(NAME) == ESCAPED and shown("Лампа «№1» 灯 ½") == "Лампа «№1» 灯 ½"
    assert str(SceneError(NAME)) == ESCAPED


@pytest.mark.parametrize("arguments", [
    ("inspect", "scene"), ("render", "scene", "-o", "out.png"), ("render", "scene", "-o", f"{NAME}.png"),
    ("inspect", NAME), ("render", NAME, "-o", "out.png"), ("render", "scene", "-o", "out.png", "-f", NAME),
    ("render", "scene", "-o", f"{NAME}/out.png"), ("render", "scene", "-o", f"{NAME}\x1b"),
    ("render", "scene", "-o", "o.png", NAME),
    (NAME,), ("render", "scene", "-o", "out.png", "--set", NAME), ("inspect", NAME, "--debug"),
    ("render", "scene", "-o", "out.png", "--set", f"h={NAME}"), ("bench", "--only", NAME),
], ids=range(14))
def test_names_do_not_steer_the_terminal(folder, arguments):
    done = run(folder, *arguments)
    said = (done.stdout + done.stderr).decode()
    assert "Traceback" not in said or "--debug" in arguments
    assert "\\x1b" in said or "\\x9b" in said
    assert all(c.isprintable() or c == "\n" for c in said), ascii(said)
    assert not any(line.startswith("openjd_") for line in said.splitlines())


@pytest.mark.parametrize("environment", [
    {"PYTHONIOENCODING": "cp1251"}, {"PYTHONIOENCODING": "cp437"},
    {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
], ids=["cp1251", "cp437", "C"])
@pytest.mark.parametrize("what", ["render", "inspect"])
def test_letters_that_the_console_lacks(folder, environment, what):
    done = run(folder, what, "scene", *(["-o", "é×.png"] if what == "render" else []), **environment)
    assert done.returncode == 0, done.stderr
    said = done.stdout + done.stderr
    assert b"hair is not translated" in said
    if environment.get("PYTHONIOENCODING") != "cp437":  # it has an é
        assert b"\\xe9" in said
    if what == "render":
        assert (folder / "é×.png").stat().st_size > 0


@pytest.mark.parametrize("end", [">&-", ">&- 2>&- <&-", ">/dev/full", "2>/dev/full", "| true"])
def test_standard_streams_that_are_closed_or_full(folder, end):
    script = f'set -o pipefail; "$@" {end}'
    for arguments in (("render", "scene", "-o", "out.png"), ("inspect", "scene")):
        done = subprocess.run(["bash", "-c", script, "bash", *COMMAND, *arguments], cwd=folder, capture_output=True,
                              text=True, timeout=120)
        lost = arguments[0] == "inspect" and ">/dev/full" in end and "2>/dev" not in end
        assert done.returncode == lost, (arguments, done)
        assert "Traceback" not in done.stderr and "Exception ignored" not in done.stderr
        if lost and "|" not in end:
            assert done.stderr == "light-meshes: the standard output: No space left on device\n"
    picture = (folder / "out.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    run(folder, "render", "scene", "-o", "again.png")
    assert picture == (folder / "again.png").read_bytes()
