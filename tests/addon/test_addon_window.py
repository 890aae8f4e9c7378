"""The panels and buttons in a real Blender's window, on a virtual screen."""

import ast
import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


def test_panels_and_buttons(open_blender, addon, tmp_path):
    from light_meshes_addon import ui

    folder = tmp_path / "kept"
    folder.mkdir()
    said = open_blender("-P", Path(__file__).with_name("window_panels.py"), "--", folder, size=("1280", "1000"))
    assert "Traceback" not in said and "END" in said, said[-4000:]
    assert set(re.findall(r"^DREW (\S+)", said, re.M)) == {panel.__name__ for panel in ui._CLASSES}
    assert re.search(r"^SAW softness \['SIZE'\]$", said, re.M)
    assert re.search(r"^SAW render 96$", said, re.M)
    assert re.search(r"^SAW figures True True$", said, re.M)  # of F12, without moving the mouse
    names, shown, slots = re.search(r"^SAW snapshot (\[.*?\]) (\d+) (\[.*?\])$", said, re.M).groups()
    assert ast.literal_eval(names) == ["snapshot-untitled-Scene-1"] and (folder / ast.literal_eval(names)[0]).is_dir()
    assert int(shown) == 0 and ast.literal_eval(slots) == ["Snapshot"]
    assert f'light-meshes render "{folder}' in said
