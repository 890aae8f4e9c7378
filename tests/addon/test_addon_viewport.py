"""The rendered 3D view in a real Blender's window, on a virtual screen."""

import shutil

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not shutil.which("Xvfb"), reason="no Xvfb")]


@pytest.fixture(scope="module")
def told(play_story):
    """What the story told, by its titles."""
    return play_story("viewport_story.py")


def test_first_picture(told):
    """Of 100,000 triangles, by an engine that runs: within 0.5 s on an idle machine; generous here."""
    assert told["triangles"]["triangles"] == pytest.approx(100_000, rel=0.01)
    for what in ("first sync", "camera move", "object move", "light move", "material change", "mesh edit", "quality"):
        what += " of the large mesh"
        longest = {k: [round(s, 3) for s in v] for k, v in told[what]["longest"].items()}
        print(f"{what}: first picture after {told[what]['first']:.3f} s ({told[what]['engine']:.2f} s of the "
              f"processor), whole after {told[what]['whole']:.2f} s, Blender kept for [s, of the processor] {longest}")
        assert told[what]["engine"] < 1.0  # all threads; the time that passes is as the machine's other work lets it
        for seconds, busy in longest.values():
            assert busy < 0.1  # whatever else the machine does meanwhile
            assert seconds < 1


@pytest.mark.parametrize("what", [
    "after changes", "after edit mode", "undo", "after undo", "after a frame change",
    "after modifiers and a new object", "after a removal", "without a camera", "in local view", "after many updates"])
def test_pictures_are_those_of_a_view_that_begins_anew(told, what):
    assert told[what]["same"]


def test_what_changes_nothing_renders_nothing(told):
    assert told["selection"]["pictures"] == 0
    assert told["edit mode"]["changed"]


def test_it_lies_under_the_overlays(told):
    assert all(v < 0.02 for k, v in told["alignment"].items() if k != "what"), told["alignment"]
    assert all(v <= 0.51 for k, v in told["border"].items() if k != "what"), told["border"]
    x0, y0, x1, y1 = told["border picture"]["corners"]
    assert told["border picture"]["shape"] == [y1 - y0, x1 - x0, 4]
    width, height = told["pixel size"]["region"]
    assert told["pixel size"]["shape"] == [-(-height // 4), -(-width // 4), 4]


def test_a_cameras_view_has_its_depth_of_field(told):
    lens = told["lens"]
    assert lens["radius"] == pytest.approx(0.035 / 0.2) and lens["focus"] == 3


def test_a_render_goes_on_beside_it(told):
    assert told["render beside it"]["written"] and told["begin"]["children"] == 1
    shown, rendered = told["render beside it"]["h"]
    assert shown == rendered
    assert told["render beside it"]["before"] == 1 and told["render beside it"]["children"] == 2


def test_the_step_stays_while_the_view_moves(told):
    first, later = told["step without a camera"]["h"]
    assert first == later


def test_nothing_leaks(told):
    early, late = told["updates"]["sizes"]
    print("children, files, engine's and Blender's megabytes:", early, late)
    assert early[0] == late[0] == 1
    assert late[1] <= early[1] + 5
    # Nodes are kept, and so are Blender's buffers. In 37 updates: what leaks a megabyte in each would be seen.
    assert late[2] < early[2] + 30 and late[3] < early[3] + 37


def test_a_view_takes_the_engine_that_waits(told):
    assert told["begin"]["waited"] and told["begin"]["waiting"] <= 1  # another one, perhaps


def test_engine_ends_with_its_view(told):
    assert told["closed"]["viewports"] == told["another file"]["viewports"] == 0
    assert not told["closed"]["files"] and not told["another file"]["files"]
    assert "switched off" in told
