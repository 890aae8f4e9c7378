"""Light and shadow linking: lights light the same objects, and are blocked by the same objects, as in Cycles."""

import bpy
import numpy as np
import pytest

ORDER = ("A", "B", "C", "Curve", "First", "Second", "Points", "Fan")  # from left to right, a unit apart
SQUARE = [(-0.4, -0.4, 0), (0.4, -0.4, 0), (0.4, 0.4, 0), (-0.4, 0.4, 0)]


@pytest.fixture
def row(scene, add, add_mesh, diffuse):
    """Squares of all kinds in a row, seen straight from above by a camera in which each is 8 pixels wide."""
    height = 1.0
    for i, name in enumerate(ORDER):
        place = (i - 3.5, 0, height)
        if name in "ABC":
            add_mesh(name, SQUARE, [(0, 1, 2, 3)], location=place)
        elif name == "Curve":
            curve = bpy.data.curves.new(name, 'CURVE')
            curve.dimensions, curve.fill_mode = '2D', 'BOTH'
            spline = curve.splines.new('POLY')
            spline.points.add(3)
            for point, corner in zip(spline.points, SQUARE, strict=True):
                point.co = (*corner, 1)
            spline.use_cyclic_u = True
            add(curve, location=place)
        elif name in ("First", "Second"):
            if name == "First":
                inner = add_mesh("Inner", SQUARE, [(0, 1, 2, 3)])
                instanced = bpy.data.collections.new("Instanced")
                instanced.objects.link(inner)
                scene.collection.objects.unlink(inner)
            add(None, name, instance_type='COLLECTION', instance_collection=instanced, location=place)
        else:
            parent = add_mesh(name, [(0, 0, 0)], [], location=place, instance_type='VERTS')
            child = add_mesh(f"{name}'s child", SQUARE, [(0, 1, 2, 3)])
            child.parent = parent
    grey = diffuse()
    for data in (*bpy.data.meshes, *bpy.data.curves):
        data.materials.append(grey)
    lens = scene.camera.data
    lens.type, lens.ortho_scale = 'ORTHO', 8
    scene.render.resolution_x, scene.render.resolution_y = 64, 8
    return scene


def sun(name, add):
    light = bpy.data.lights.new(name, 'SUN')
    light.energy, light.angle = 3, 0
    return add(light, name, location=(0, 0, 5))


def linked(name, children=(), **objects):
    """A collection with `objects` by name and state; children: (state, names, names in a collection in it)."""
    collection = bpy.data.collections.new(name)
    for state, names, deeper in children:
        child = bpy.data.collections.new(f"{name}'s child")
        collection.children.link(child)
        collection.collection_children[-1].light_linking.link_state = state
        if deeper:
            child.children.link(linked(f"{name}'s grandchild", **dict.fromkeys(deeper, 'EXCLUDE')))
        for one in names:
            child.objects.link(bpy.data.objects[one])
    for one, state in objects.items():
        collection.objects.link(bpy.data.objects[one.replace("_", "'s ")])
        collection.collection_objects[-1].light_linking.link_state = state
    return collection


# What a light's collection holds, and what another light's does.
CASES = {
    "empty": ({}, None),
    "one included": ({"A": 'INCLUDE'}, None),
    "one excluded": ({"A": 'EXCLUDE'}, None),
    "some of each": ({"A": 'INCLUDE', "Curve": 'INCLUDE', "B": 'EXCLUDE'}, None),
    "a curve excluded": ({"Curve": 'EXCLUDE'}, None),
    "nested included": ({"children": [('INCLUDE', ["A"], ["B"])]}, None),
    "nested excluded, one of it included": ({"children": [('EXCLUDE', ["A", "B"], [])], "A": 'INCLUDE'}, None),
    "in two nested": ({"children": [('INCLUDE', ["A", "B"], []), ('EXCLUDE', ["B", "C"], [])]}, None),
    "instanced object": ({"Inner": 'EXCLUDE', "Points_child": 'EXCLUDE'}, None),
    "instancer": ({"First": 'INCLUDE', "Points": 'INCLUDE'}, None),
    "instanced object, instancer elsewhere": ({"Inner": 'EXCLUDE'}, {"First": 'EXCLUDE'}),
    "instanced object and instancer": ({"Inner": 'INCLUDE', "Second": 'EXCLUDE', "Fan": 'EXCLUDE'}, None),
    "nothing in the scene": ({"Outside": 'INCLUDE'}, None),
}


def cycles(scene, render):
    scene.render.engine = 'CYCLES'
    scene.cycles.samples, scene.cycles.max_bounces, scene.cycles.use_denoising = 4, 0, False
    picture = middles(render(scene))
    scene.render.engine = 'LIGHT_MESHES'
    return picture


def middles(picture):
    """The level in the middle of each square."""
    return picture["Combined"][4, 4::8, 0]


def named(found, light, what):
    """Names in ORDER of the objects that the exported light has in `what`."""
    numbers = getattr(next(one for one in found.lights if one.name == light), what)
    if numbers is None:
        return set(ORDER)
    place = {i: round(float(m[0, 3]) + 3.5) for i, m in zip(
        found.geometry.instance_object, found.geometry.instance_matrix, strict=True)}
    return {ORDER[place[i]] for i in numbers if found.objects[i].name != "Floor"}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("what", ["receivers", "blockers"])
def test_what_is_linked_is_what_cycles_links(row, add, add_plane, snapshot, render, case, what):
    outside = bpy.data.objects.new("Outside", bpy.data.objects["A"].data)
    assert outside.name not in row.objects
    mine, others = CASES[case]
    light = sun("Sun", add)
    collection = {"receivers": "receiver_collection", "blockers": "blocker_collection"}[what]
    setattr(light.light_linking, collection, linked("Mine", **mine))
    if others:
        other = sun("Other", add)
        other.data.energy = 0
        setattr(other.light_linking, collection, linked("Others", **others))
    if what == "blockers":
        add_plane(10, "Floor").data.materials.append(bpy.data.materials["Diffuse"])
        for ob in (*row.objects, bpy.data.objects["Inner"]):
            ob.visible_camera = ob.name in ("Floor", "First", "Second", "Points", "Fan") and ob.type != 'EMPTY'
    theirs = cycles(row, render)
    expected = {name for name, level in zip(ORDER, theirs, strict=True) if (level > 0.1) == (what == "receivers")}
    found = snapshot(row)
    assert not found.warnings
    assert named(found, "Sun", what) == expected
    np.testing.assert_allclose(middles(render(row)), theirs, atol=1e-3)


def test_what_links_everything_is_not_written(row, add, snapshot):
    light = sun("Sun", add)
    light.light_linking.receiver_collection = linked("All", **dict.fromkeys(ORDER, 'INCLUDE'))
    light.light_linking.blocker_collection = linked("None")
    (found,) = snapshot(row).lights
    assert found.receivers is None and found.blockers is None


def test_a_light_may_be_linked_to_nothing(row, add, snapshot):
    light = sun("Sun", add)
    light.light_linking.receiver_collection = linked("All", **dict.fromkeys(ORDER, 'EXCLUDE'))
    assert snapshot(row).lights[0].receivers == ()


def test_meshes_have_links_too(row, snapshot):
    """Their surfaces may give light. An instance without links of its own has those of its instancer."""
    for name in ("A", "Points"):
        bpy.data.objects[name].light_linking.receiver_collection = linked(f"{name} lights", B='INCLUDE')
        bpy.data.objects[name].light_linking.blocker_collection = linked(f"{name} is blocked", B='EXCLUDE')
    found = snapshot(row).objects
    (b,) = (i for i, ob in enumerate(found) if ob.name == "B")
    has = [ob for ob in found if ob.receivers is not None]
    assert {ob.receivers for ob in has} == {(b,)} and len(has) == 2 and "A" in {ob.name for ob in has}
    assert {ob.blockers for ob in has} == {tuple(i for i in range(len(found)) if i != b)}
    assert all(ob.blockers is None for ob in found if ob not in has)
