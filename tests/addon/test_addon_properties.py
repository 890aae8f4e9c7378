"""Properties reach the render, and their tooltips describe them."""

import re

import bpy
import pytest


def own_properties(addon):
    from light_meshes_addon import properties

    for group in properties._GROUPS.values():
        yield from (p for p in group.bl_rna.properties if p.identifier not in {"rna_type", "name"})


def test_defaults(scene):
    own = scene.light_meshes
    assert (own.mode, own.shadows, own.auto_h) == ('WHITTED', 'LIGHT_MESHES', True)
    assert own.h == pytest.approx(0.05) and own.kI == 3 and own.samples == 4 and own.ambient == 1
    prop = own.bl_rna.properties["kI"]
    assert (prop.hard_min, prop.hard_max) == (0.5, 8) and prop.soft_min == pytest.approx(1.225)
    assert own.bl_rna.properties["h"].subtype == 'DISTANCE' and own.bl_rna.properties["h"].hard_min > 0


def test_every_property_has_a_tooltip_and_enums_are_numbered(addon):
    for prop in own_properties(addon):
        assert len(prop.description) > 15, prop.identifier
        if prop.type == 'ENUM':
            assert [i.value for i in prop.enum_items] == list(range(len(prop.enum_items)))


def test_labels_are_written_as_blenders(addon):
    """In title case, in American English, and no panel has the name of a field."""
    from light_meshes_addon import operators, ui

    panels = {panel.bl_label for panel in ui._CLASSES}
    fields = {prop.name for prop in own_properties(addon)}
    assert not panels & fields
    items = {item.name for prop in own_properties(addon) if prop.type == 'ENUM' for item in prop.enum_items}
    small = {"of", "at", "from", "the", "and"}
    for label in panels | fields | items | {operator.bl_label for operator in operators._CLASSES}:
        words = [word for word in re.sub(r"\(.*\)", "", label).split() if word not in small]
        assert all(word[:1].isupper() for word in words), label
    assert not [p.identifier for p in own_properties(addon) if "olour" in p.name + p.description]


def test_the_material_panel_shows_translated_colors(scene, node_material):
    from light_meshes_addon.export.materials import translated_value
    from light_meshes_addon.surface_properties import translated

    material = node_material("Red", 'ShaderNodeBsdfDiffuse', Color=(0.8, 0.1, 0.2, 1))
    translated[material.session_uid] = {name: translated_value(material, name) for name in ("Od", "mirror")}
    assert list(material.light_meshes_translated.Od) == pytest.approx([0.8, 0.1, 0.2])
    assert list(material.light_meshes_translated.mirror) == [0, 0, 0]
    material.light_meshes_translated.Od = 0, 1, 0
    assert list(material.light_meshes.Od) == [0, 1, 0] and material.light_meshes.override_Od
    assert not material.light_meshes.override_mirror


def test_scene_properties_reach_the_engine(scene, add_plane, snapshot):
    add_plane()
    values = {"mode": 'RAY_CASTING', "shadows": 'AREA_SAMPLING', "h": 0.25, "kI": 2.5, "auto_h": False, "samples": 7,
                  "light_samples": 33, "shadow_rate": 4, "light_threshold": 0.125, "max_depth": 2, "ambient": 0.5}
    snapshot(scene)  # what comes after an evaluation must reach the next one
    for key, value in values.items():
        setattr(scene.light_meshes, key, value)
    scene.render.filter_size = 2.25
    scene.render.film_transparent = True
    settings = snapshot(scene).settings
    for key, value in values.items():
        assert getattr(settings, key) == value, key
    assert settings.filter_size == 2.25 and settings.film_transparent


def test_an_over_wide_filter_is_not_an_error(scene, add_plane, snapshot):
    add_plane()
    scene.render.filter_size = 40
    assert snapshot(scene).settings.filter_size == 10


def test_animated_properties_reach_the_engine(scene, add_plane, snapshot):
    add_plane()
    scene.light_meshes.auto_h = False
    for frame, h in ((1, 0.1), (11, 0.3)):
        scene.light_meshes.h = h
        scene.light_meshes.keyframe_insert("h", frame=frame)
    scene.frame_set(11)
    assert snapshot(scene).settings.h == pytest.approx(0.3)
    scene.frame_set(1)
    assert snapshot(scene).settings.h == pytest.approx(0.1)


def test_light_and_material_properties_reach_the_engine(scene, add_plane, add_light, diffuse, snapshot):
    plane, light = add_plane(), add_light()
    material = diffuse()
    plane.data.materials.append(material)
    assert snapshot(scene).lights[0].soft_shadows
    light.data.light_meshes.soft_shadows = False
    material.light_meshes.kd = 0.25
    material.light_meshes.override_kd = True
    material.light_meshes.override_mirror = True
    material.light_meshes.mirror = (0.1, 0.2, 0.3)
    found = snapshot(scene)
    assert not found.lights[0].soft_shadows
    assert found.materials[0].kd == 0.25 and found.materials[0].ka == 1
    assert found.materials[0].mirror == pytest.approx((0.1, 0.2, 0.3))


@pytest.mark.parametrize("name", ["cast_soft_shadows", "receive_soft_shadows"])
def test_soft_shadows_of_an_object_and_of_what_instances_it(scene, add, add_plane, diffuse, snapshot, name):
    """An instance has soft shadows where the object, its instancer and the material say so."""
    curve = bpy.data.curves.new("Curve", 'CURVE')
    curve.bevel_depth = 0.1
    curve.splines.new('POLY').points.add(1)
    curve.splines[0].points[1].co = (1, 0, 0, 1)
    add(curve)
    plane, inner = add_plane(), add_plane(name="Inner")
    plane.data.materials.append(diffuse())
    collection = bpy.data.collections.new("Collection")
    collection.objects.link(inner)
    scene.collection.objects.unlink(inner)
    for one in ("First", "Second"):
        add(None, one, instance_type='COLLECTION', instance_collection=collection)

    def sharp():
        found = snapshot(scene)
        objects = sorted(o.name for o in found.objects if not getattr(o, name))
        return objects, sorted(getattr(m, name) for m in found.materials)

    assert sharp() == ([], [True, True])
    for ob, names in (("Curve", ["Curve"]), ("Plane", ["Plane"]), ("Inner", ["Inner", "Inner"]), ("First", ["Inner"])):
        setattr(bpy.data.objects[ob].light_meshes, name, False)
        assert sharp()[0] == names, ob
        setattr(bpy.data.objects[ob].light_meshes, name, True)
    setattr(plane.data.materials[0].light_meshes, name, False)
    assert sharp() == ([], [False, True])


def test_an_override_starts_from_the_translated_value(scene, node_material):
    material = node_material("Red", 'ShaderNodeBsdfDiffuse', Color=(0.7, 0.1, 0.2, 1))
    material.light_meshes.override_Od = True
    assert tuple(material.light_meshes.Od) == pytest.approx((0.7, 0.1, 0.2))


def test_properties_change_the_picture(scene, add_plane, add_mesh, add_light, render):
    add_plane(3)
    add_mesh("Blocker", [(0, -5, 1), (5, -5, 1), (5, 5, 1), (0, 5, 1)], [(0, 1, 2, 3)], visible_camera=False)
    light = add_light(energy=500)
    own = scene.light_meshes
    own.auto_h, own.h = False, 0.2

    def level(picture):  # on either side of the shadow's edge, and on it
        return [picture["Combined"][24, x, 0] for x in (20, 32, 44)]

    lit, edge, dark = level(render(scene))
    assert lit > 0 and dark == 0 and 0.2 * lit < edge < 0.8 * lit
    light.data.light_meshes.soft_shadows = False
    sharp = render(scene)["Combined"][24, :, 0]
    assert ((sharp > 0.01) & (sharp < 0.5 * lit)).sum() <= 4
    light.data.light_meshes.soft_shadows = True
    own.h = 0.05
    narrow = render(scene)["Combined"][24, :, 0]
    own.shadows = 'SHARP'
    assert level(render(scene))[2] == 0
    assert ((narrow > 0.02 * lit) & (narrow < 0.9 * lit)).sum() < 16
    own.mode = 'LOCAL'
    assert level(render(scene))[2] == pytest.approx(lit, rel=0.2)


def test_panels(addon, scene, add_light, node_material):
    """They draw without an error, which Blender would only print."""
    from light_meshes_addon import ui

    compatible = [p for p in bpy.types.Panel.__subclasses__() if ui.ENGINE in getattr(p, "COMPAT_ENGINES", ())]
    names = {p.__name__ for p in compatible}
    assert {"RENDER_PT_output", "DATA_PT_lens", "EEVEE_MATERIAL_PT_surface", "EEVEE_WORLD_PT_surface",
            "DATA_PT_camera_dof", "OBJECT_PT_visibility", "DATA_PT_custom_props_light"} <= names
    assert {"OBJECT_PT_shading", "LIGHT_MESHES_PT_light_linking"} & names  # Blender's, or before 4.3 ours
    assert "DATA_PT_light" not in names and not any("freestyle" in n.lower() for n in names)
    addon.unregister()
    try:
        left = [p.__name__ for p in bpy.types.Panel.__subclasses__()
                if ui.ENGINE in getattr(p, "COMPAT_ENGINES", ()) and "LIGHT_MESHES" not in p.__name__]
        assert left == []
    finally:
        addon.register()
