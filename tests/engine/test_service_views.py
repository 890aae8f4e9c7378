"""Successive pictures in a child process that keeps what it prepared."""

import json
import time
from dataclasses import replace

import numpy as np
import pytest
from light_meshes.picture.render import render_image
from light_meshes.scene import snapshot
from scenes import four_lights, tabletop


def camera_of(scene):
    """As scene.json has it."""
    data = snapshot._plain(scene.camera)
    return json.loads(json.dumps(data))


def view(child, number, name="scene", **more):
    """The events of a view, and its pictures."""
    child.send(command="view", id=number, snapshot=name, framebuffer="view", passes=["Combined"],
               **({"camera": None, "steps": [[4, 1], [2, 1], [1, 1], [1, 3]]} | more))
    events = [e for e in child.of(number) if e["event"] != "progress"]
    return events, [np.load(child.folder / "view" / str(e["step"]) / "Combined.npy")
                    for e in events if e["event"] == "picture"]


def test_a_view_gets_better_step_by_step(child):
    scene = four_lights(50)
    child.put(scene)
    events, pictures = view(child, 1)
    assert [e["event"] for e in events] == ["picture"] * 4 + ["done"]
    assert [(e["width"], e["height"]) for e in events[:-1]] == [(13, 13), (25, 25), (50, 50), (50, 50)]
    assert [p.shape for p in pictures] == [(13, 13, 4), (25, 25, 4), (50, 50, 4), (50, 50, 4)]
    np.testing.assert_array_equal(pictures[2], render_image(scene).passes["Combined"])
    best = replace(scene, settings=replace(scene.settings, samples=3))
    np.testing.assert_array_equal(pictures[3], render_image(best).passes["Combined"])
    steps = events[-1]["statistics"]["steps"]
    assert len(steps) == 4 and steps[3]["nodes_kept"] == steps[2]["nodes"] and steps[3]["long_rays"] == 0


def test_a_coarse_step_shows_what_the_whole_picture_does(child):
    """Also of a crop, whose size no divisor divides."""
    scene = four_lights(64)
    crop = replace(scene, camera=replace(scene.camera, crop=(5, 9, 56, 62)))
    child.put(crop)
    _, (coarse, fine) = view(child, 1, steps=[[3, 1], [1, 1]])
    np.testing.assert_array_equal(fine, render_image(crop).passes["Combined"])
    assert coarse.shape == (18, 17, 4)
    shrunk = fine[:51, :51].reshape(17, 3, 17, 3, 4).mean((1, 3))
    assert np.abs(coarse[:17] - shrunk).mean() < 0.05 * fine.mean()


def test_the_next_view_goes_on_where_the_last_one_was(child):
    scene = four_lights(40)
    child.put(scene)
    view(child, 1, steps=[[1, 1]])
    matrix = scene.camera.matrix.copy()
    matrix[:3, 3] += 0.05
    other = replace(scene, camera=replace(scene.camera, matrix=matrix))
    for number, camera in ((2, None), (3, other)):
        events, (picture,) = view(child, number, steps=[[1, 1]], camera=camera and camera_of(camera))
        fresh = render_image(camera or scene)
        np.testing.assert_array_equal(picture, fresh.passes["Combined"])
        found = events[-1]["statistics"]
        assert found["nodes_kept"] > 0
        assert found["long_rays"] < (1 if camera is None else 0.5 * fresh.statistics["long_rays"])


def test_a_snapshot_that_was_changed_in_its_place_is_read_again(child):
    child.put(four_lights(40))
    view(child, 1)
    for number, scene in ((2, tabletop(40)), (3, four_lights(32))):
        child.put(scene)
        _, pictures = view(child, number, steps=[[1, 1]])
        np.testing.assert_array_equal(pictures[0], render_image(scene).passes["Combined"])


def test_renders_keep_when_they_are_asked_to(child):
    scene = tabletop(40)
    child.put(scene)
    fresh = render_image(scene)
    rays = []
    for number, keep in enumerate((True, True, False, True, True, None)):
        more = {} if keep is None else {"keep": keep}
        child.send(command="render", id=number, snapshot="scene", framebuffer="frame", **more)
        end = child.of(number)[-1]
        rays.append(end["statistics"]["long_rays"])
        np.testing.assert_array_equal(np.load(child.folder / "frame" / "Combined.npy"), fresh.passes["Combined"])
    all_of_them = fresh.statistics["long_rays"]
    assert rays == [all_of_them, 0, all_of_them, all_of_them, 0, all_of_them]


def test_what_failed_or_was_cancelled_leaves_a_child_that_goes_on(child):
    scene = four_lights(40)
    child.put(scene)
    fresh = render_image(scene)
    view(child, 1)
    child.put(scene, "broken")
    (child.folder / "broken" / "vertices.npy").write_bytes(b"")
    events, _ = view(child, 2, "broken")
    assert [e["event"] for e in events] == ["error"]
    child.send(command="view", id=3, snapshot="scene", framebuffer="view", camera=None, steps=[[1, 64]] * 50)
    while child.next()["event"] != "picture":
        pass
    asked = time.monotonic()
    child.send(command="cancel", id=3)
    assert child.of(3)[-1]["event"] == "cancelled"
    assert time.monotonic() - asked < 0.2
    events, (picture,) = view(child, 4, steps=[[1, 1]])
    np.testing.assert_array_equal(picture, fresh.passes["Combined"])
    assert events[-1]["statistics"]["long_rays"] == 0


@pytest.mark.parametrize(("change", "sentence"), [
    ({"steps": []}, "steps"), ({"steps": [[0, 1]]}, "steps"), ({"steps": [[1]]}, "steps"), ({"steps": 3}, "steps"),
    ({"steps": [[1, True]]}, "steps"), ({"steps": [["1", 1]]}, "steps"), ({"camera": {}}, "camera"),
    ({"camera": 7}, "camera"), ({"passes": ["Fog"]}, "Fog"), ({"snapshot": "scene/vertices.npy"}, "no snapshot"),
    ({"command": "render", "keep": 1}, "keep"), ({"framebuffer": None}, "framebuffer"),
])
def test_a_bad_view_is_answered_in_a_sentence(child, change, sentence):
    child.put(tabletop(8))
    child.send(**({"command": "view", "id": 5, "snapshot": "scene", "framebuffer": "f"} | change))
    event = child.of(5)[-1]
    assert event["event"] == "error" and sentence in event["message"]


