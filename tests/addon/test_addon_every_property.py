"""Every property changes the picture as its tooltip says, reaches evaluated data, and survives save and load."""

import re
import subprocess

import every_property
import pytest
from test_addon_versions import PYTHONS, environment  # noqa: F401  a fixture


@pytest.mark.parametrize("row", every_property.ROWS, ids=lambda row: row.id)
def test_it_does_what_it_says(addon, row):
    assert every_property.run(row) == ""


def test_every_property_has_a_row(addon):
    assert every_property.missing() == []


def test_all_survive_save_and_load(addon, tmp_path):
    assert every_property.saved_and_loaded(tmp_path / "all.blend") == []


def test_rows_cover_all_owners(addon):
    from light_meshes_addon.properties import _GROUPS

    owners = {kind.__name__.lower() for kind in _GROUPS} - {"viewlayer"}  # which chooses passes only
    assert owners == {row.owner for row in every_property.ROWS}


@pytest.mark.slow
@pytest.mark.parametrize("python", PYTHONS or [pytest.param(
    None, marks=pytest.mark.skip(reason="LIGHT_MESHES_BPY_PYTHONS names no Python with another bpy"))])
def test_in_other_versions(python, environment, tmp_path):  # noqa: F811
    done = subprocess.run([python, every_property.__file__, tmp_path / "all.blend"], env=environment,
                          capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    check(done.stdout)


@pytest.mark.slow
def test_in_blenders_window(open_blender, tmp_path):
    check(open_blender("-P", every_property.__file__, "--", tmp_path / "all.blend"))


def check(said):
    assert re.findall("^BAD .*", said, re.M) == []
    assert re.search(f"^CHECKED {len(every_property.ROWS)} of", said, re.M), said[-3000:]
