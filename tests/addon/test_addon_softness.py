"""New lamps cast the shadow of their own shape; lamps of files that an earlier release saved keep what they had."""

from pathlib import Path

import bpy
import pytest

ROOT = Path(__file__).parents[2]
OLD = str(ROOT / "blend_scenes" / "tabletop.blend")  # saved by release 0.1, with one lamp in which nothing was chosen
OLD_WITHOUT_LAMPS = str(Path(__file__).with_name("full_of_0.1.blend"))


@pytest.fixture
def softness(addon):
    """() → what each lamp of the open file renders with, by name."""
    from light_meshes_addon.softness import softness_of

    return lambda: {lamp.name: softness_of(lamp) for lamp in bpy.data.lights}


def saved_again(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))


def linked():
    """Link the lamp of OLD into the open file, and put it into the scene."""
    with bpy.data.libraries.load(OLD, link=True) as (_, here):
        here.objects = ["Light"]
    scene = bpy.context.scene
    scene.collection.objects.link(here.objects[0])
    if scene.camera is None:
        scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(scene.camera)


def test_a_new_lamp_has_the_shadow_of_its_shape(scene, add, snapshot, softness, tmp_path):
    add(bpy.data.lights.new("New", 'POINT'))
    assert [light.softness for light in snapshot(scene).lights] == ["SIZE"]
    saved_again(tmp_path / "new.blend")
    assert softness() == {"New": 'SIZE'}
    assert [light.softness for light in snapshot(bpy.context.scene).lights] == ["SIZE"]


def test_a_file_of_another_engine_has_new_lamps(scene, add, softness, tmp_path):
    from light_meshes_addon import softness as module

    scene.render.engine = 'CYCLES'
    add(bpy.data.lights.new("New", 'POINT'))
    module.unregister()  # it is saved as if there were no add-on
    for name in ("release", "world_light", "bounces"):
        scene.light_meshes.property_unset(name)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "cycles.blend"))
    module.register()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "cycles.blend"))
    bpy.context.scene.render.engine = 'LIGHT_MESHES'
    assert softness() == {"New": 'SIZE'}


def test_a_lamp_of_an_old_file_keeps_the_scenes_width(softness, snapshot, tmp_path):
    bpy.ops.wm.open_mainfile(filepath=OLD)
    assert softness() == {"Light": 'SCENE'} and bpy.data.lights["Light"].light_meshes.softness == 'SCENE'
    assert [light.softness for light in snapshot(bpy.context.scene).lights] == ["SCENE"]
    bpy.data.lights.new("New", 'POINT').use_fake_user = True
    saved_again(tmp_path / "again.blend")
    assert softness() == {"Light": 'SCENE', "New": 'SIZE'}


def test_so_it_does_if_the_add_on_was_enabled_after_the_file_was_opened(softness, snapshot, tmp_path):
    from light_meshes_addon import softness as module

    module.unregister()
    bpy.ops.wm.open_mainfile(filepath=OLD)
    module.register()
    assert not bpy.context.scene.light_meshes.is_property_set("release")
    assert softness() == {"Light": 'SCENE'}
    assert [light.softness for light in snapshot(bpy.context.scene).lights] == ["SCENE"]
    saved_again(tmp_path / "again.blend")
    assert softness() == {"Light": 'SCENE'}


def test_linked_lamps_are_as_old_as_the_file(scene, softness, snapshot, tmp_path):
    linked()
    assert softness() == {"Light": 'SIZE'}
    bpy.ops.wm.open_mainfile(filepath=OLD_WITHOUT_LAMPS)
    linked()
    for again in ("once.blend", "twice.blend"):
        assert softness() == {"Light": 'SCENE'}
        assert [light.softness for light in snapshot(bpy.context.scene).lights] == ["SCENE"]
        saved_again(tmp_path / again)


def test_what_was_chosen_stays(softness, tmp_path):
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / "limits.blend"))
    assert softness()["Lamp"] == 'LIGHT_SIZE'
    bpy.data.lights["Lamp"].light_meshes.softness = 'SIZE'
    saved_again(tmp_path / "again.blend")
    assert softness()["Lamp"] == 'SIZE'
