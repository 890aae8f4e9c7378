"""New scenes have light from everywhere; scenes of files that an earlier release saved keep ambient light."""

from pathlib import Path

import bpy

OLD = str(Path(__file__).parents[2] / "blend_scenes" / "tabletop.blend")  # saved by release 0.1, which had neither


def of(scene):
    settings = scene.light_meshes
    return settings.world_light, settings.bounces


def test_a_new_scene_has_it_also_after_it_was_saved(scene, snapshot, tmp_path):
    for name in ("release", "world_light", "bounces", "clamp_indirect", "glass_shadows", "share_samples"):
        scene.light_meshes.property_unset(name)
    assert of(scene) == ('SKY', 1)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "new.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "new.blend"))
    assert of(bpy.context.scene) == ('SKY', 1)
    described = snapshot(bpy.context.scene).settings
    assert (described.world_light, described.bounces, described.clamp_indirect) == ("SKY", 1, 10)
    assert described.glass_shadows == "SOLID" and described.share_samples


def test_a_scene_of_an_old_file_keeps_ambient_light(addon, snapshot, tmp_path):
    bpy.ops.wm.open_mainfile(filepath=OLD)
    assert of(bpy.context.scene) == ('AMBIENT', 0)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "again.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "again.blend"))
    described = snapshot(bpy.context.scene).settings
    assert (described.world_light, described.bounces, described.clamp_indirect) == ("AMBIENT", 0, 0)
    assert described.glass_shadows == "CLEAR" and not described.share_samples


def test_a_file_from_between_keeps_what_had_not_changed_since(scene, snapshot, tmp_path):
    """Files of release 3 of the lamps had light from everywhere, and clear shadows of glass."""
    for name in ("world_light", "bounces", "clamp_indirect", "glass_shadows"):
        scene.light_meshes.property_unset(name)
    scene.light_meshes.property_unset("share_samples")
    scene.light_meshes.release = 3
    described = snapshot(scene).settings
    assert not described.share_samples
    assert (described.world_light, described.bounces, described.glass_shadows) == ("SKY", 1, "CLEAR")


def test_objects_say_whether_they_are_met(scene, add_plane, snapshot):
    add_plane().visible_diffuse = False
    assert [o.visible_diffuse for o in snapshot(scene).objects] == [False]
