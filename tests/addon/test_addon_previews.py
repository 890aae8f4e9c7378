"""Previews of materials, lights and worlds: Blender's own small scenes, rendered as the user interface does it."""

import time

import bpy
import numpy as np
import pytest


@pytest.fixture
def preview(scene):
    """(datablock) → its preview, (128, 128, 4), top row first; Blender renders it here and now."""
    def run(datablock):
        datablock.asset_mark()
        datablock.asset_generate_preview()
        pixels = np.array(datablock.preview.image_pixels_float[:]).reshape(*datablock.preview.image_size[:], 4)
        return pixels[::-1]
    return run


def principled(name, **inputs):
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    for key, value in inputs.items():
        material.node_tree.nodes["Principled BSDF"].inputs[key.replace("_", " ")].default_value = value
    return material


def test_a_material_is_a_lit_ball_on_nothing(preview):
    picture = preview(principled("Red", Base_Color=(0.8, 0.05, 0.05, 1)))
    assert picture.shape == (128, 128, 4)
    assert not picture[:8, :8].any() and not picture[-8:, -8:].any()  # icons have no floor
    red, green = picture[..., 0], picture[..., 1]
    lit = picture[40:60, 40:60]  # from the left, above
    assert lit[..., 3].min() == 1 and lit[..., 0].min() > 0.7 and (lit[..., 0] > 1.2 * lit[..., 1]).all()
    assert (red >= green).all() and red[60, 115] < 0.2 * red[50, 50]  # the far side is dark
    assert 0.4 < picture[..., 3].mean() < 0.6


def test_a_mirror_shows_the_floor(preview):
    picture = preview(principled("Mirror", Metallic=1.0, Roughness=0.0))
    below, above = picture[95:105, 60:70, 0].mean(), picture[70:75, 60:70, 0].mean()
    assert 0.2 < below < 0.8 and above < 0.6 * below


def test_a_light_shows_its_colour(preview):
    light = bpy.data.lights.new("Blue", 'POINT')
    light.color = (0.1, 0.2, 1)
    picture = preview(light)
    assert picture[..., 2].mean() > 0.3 and (picture[..., 2] > picture[..., 0]).all()


def test_a_world_shows_its_colour(preview):
    world = bpy.data.worlds.new("Green")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0.5, 0, 1)
    picture = preview(world)
    assert picture[..., 1].mean() > 0.5 and picture[..., 0].max() < 0.1


def test_a_material_that_glows_is_even(preview):
    """It does not light itself, and what it lights does not light it back: as Blender's scene asks of Cycles, too."""
    picture = preview(principled("Glow", Base_Color=(0.8, 0.8, 0.8, 1), Emission_Color=(1, 0.5, 0.1, 1),
                                 Emission_Strength=2.0))
    middle = picture[40:90, 40:90, 2]
    assert abs(np.diff(middle, n=2, axis=0)).max() < 0.02 and abs(np.diff(middle, n=2, axis=1)).max() < 0.02


def test_a_mirror_shows_the_lamps_as_wide_as_they_are(preview):
    """A window at the upper left, and a round lamp; with lamps that are points both were spots with a glow."""
    picture = preview(principled("Chrome", Metallic=1.0, Roughness=0.0))
    white = picture[10:70, 10:90, :3].min(axis=2) > 0.9
    # 133 and 45 with 256 samples of each pixel alone; in Cycles, whose few samples miss the filter's rim, 108 and 40
    assert 120 < white.sum() < 145 and 38 < white[40:].sum() < 52


def test_previews_are_fast(preview):
    """With an engine that is awake; the first take longest. Blurred reflections take most, about three times as long
    as others.
    """
    preview(principled("First"))
    times = {}
    for name, seconds, inputs in ("plastic", 1, {}), ("metal", 2.5, {"Metallic": 1.0}):
        for i in range(3):
            material = principled(f"{name} {i}", Base_Color=(0.1 * i, 0.5, 0.5, 1), Roughness=0.2 * i + 0.1, **inputs)
            start = time.monotonic()
            preview(material)
            times.setdefault(name, []).append(time.monotonic() - start)
        print(name, *(f"{t:.3f}" for t in times[name]))
        assert min(times[name]) < seconds


def test_previews_leave_the_render_alone(scene, preview, render, add_plane, add_light, capfd):
    """Its engine, its statistics, its reports."""
    from light_meshes_addon import observers, session

    add_plane(2)
    add_light()
    picture = render(scene)["Combined"]
    statistics, process = session.statistics, session.current()
    heard = []
    observers.observers.append(heard.append)
    capfd.readouterr()
    try:
        material = principled("Odd")
        toon = material.node_tree.nodes.new('ShaderNodeBsdfToon')
        material.node_tree.links.new(toon.outputs[0], material.node_tree.nodes["Material Output"].inputs["Surface"])
        assert preview(material)[..., 3].mean() > 0.3
    finally:
        observers.observers.pop()
    said = capfd.readouterr().out
    assert not heard and "Warning" not in said and "Light Meshes:" not in said
    assert session.statistics is statistics and session.current() is process
    assert session.current(session.PREVIEW) is not process
    assert not list(session.current(session.PREVIEW).folder.iterdir())
    assert np.array_equal(render(scene)["Combined"], picture)


def test_without_an_engine_previews_are_empty_and_say_why(scene, preview, monkeypatch, capfd):
    monkeypatch.setenv("LIGHT_MESHES_PYTHON", "/no/such/python")
    assert not preview(principled("Red")).any()
    assert "/no/such/python cannot be run" in capfd.readouterr().out
    monkeypatch.undo()
    assert preview(principled("Red again")).any()


def test_an_engine_that_died_is_replaced_for_the_next_preview(preview):
    from light_meshes_addon import session

    assert preview(principled("Red")).any()
    process = session.current(session.PREVIEW)._process
    process.kill()
    process.wait()
    assert preview(principled("Red again")).any() and session.current(session.PREVIEW)._process is not process
