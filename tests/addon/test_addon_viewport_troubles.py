"""The rendered 3D view of a slow scene, and of an engine that dies or hangs, in a real Blender's window."""

import re
import shutil

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not shutil.which("Xvfb"), reason="no Xvfb")]


@pytest.fixture(scope="module")
def told(play_story):
    return play_story("viewport_troubles.py")


def test_quick_pictures_are_seen_at_once(told):
    gaps = told["quick"]["gaps"]
    assert len(gaps) > 4 and max(gaps) < 2, gaps  # some 15, of 0.2 s, on an idle machine


@pytest.mark.parametrize("what", ["dragging", "turning", "both", "playback"])
def test_a_slow_scene_is_seen_while_it_changes(told, what):
    """A picture every three seconds and its own time at the latest."""
    assert told["first picture"]["seconds"] > 1
    assert max(told[what]["gaps"]) < told[what]["patience"], told[what]
    assert len(told[what]["gaps"]) >= 2


@pytest.mark.parametrize("what", ["after all that", "after deaths", "after deaths at work", "after a hang"])
def test_in_the_end_all_is_shown(told, what):
    assert told[what]["same"]


@pytest.mark.parametrize("how", ["SIGKILL", "SIGTERM"])
@pytest.mark.parametrize("change", ["turn", "edit", "large edit"])
def test_an_engine_that_died_is_replaced_at_the_first_change(told, change, how):
    found = told[f"{change} after {how}"]
    assert found["another"] and found["engines"] == 1 and not found["failed"]
    assert not found["outdated"]  # no old picture under new overlays


@pytest.mark.parametrize("when", ["in the first picture", "in an export"])
def test_an_engine_that_dies_at_work_is_replaced(told, when):
    assert told[when]["engines"] == 1 and not told[when]["failed"]


def test_engines_that_die_again_and_again_end_in_a_sentence(told):
    found = told["again and again"]
    assert found["killed"] == 3 and found["engines"] == 0 and found["bare"]
    assert found["text"].startswith("The Light Meshes engine ")
    assert told["at last"]["engines"] == 1 and not told["at last"]["failed"]  # after a turn


def test_a_hung_engine_is_noticed_while_edits_go_on(told):
    found = told["hangs"]
    assert found["shown"] and found["another"] and found["edits"] > 20  # 5 s of silence; 8 in all on an idle machine


def test_every_view_has_its_engine_replaced(told):
    assert told["four views"]["engines"] == 4 and not any(told["four views"]["failed"])


def test_the_line_in_a_view_fits_a_quarter(told):
    assert all(re.fullmatch(r"[\d.]+ s, h [\d.]+, r [\d.]+", text) for text in told["four views"]["texts"])
