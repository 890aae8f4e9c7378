"""Attributes of meshes and objects beside Cycles: a mesh and two instances of it with values on every domain."""

import bpy
import numpy as np
import pytest
from node_pictures import agree, both
from node_trees import Tree, exact

pytestmark = pytest.mark.slow


@pytest.fixture
def panels(scene, add):
    """Two objects with one mesh of 4 × 4 quads, with two UV maps; the camera looks down on both."""
    n = 5
    vertices = [(x / 4, y / 4, 0.1 * x * y / 16) for y in range(n) for x in range(n)]
    faces = [(y * n + x, y * n + x + 1, (y + 1) * n + x + 1, (y + 1) * n + x) for y in range(n - 1)
             for x in range(n - 1)]
    mesh = bpy.data.meshes.new("Panel")
    mesh.from_pydata(vertices, [], faces)
    for name, factor in (("First", 1.0), ("Second", -2.0)):
        layer = mesh.uv_layers.new(name=name)
        for loop, corner in zip(mesh.loops, layer.uv, strict=True):
            x, y, _ = vertices[loop.vertex_index]
            corner.vector = (factor * x, y) if name == "First" else (y, factor * x + 0.3)
    objects = [add(mesh, name, location=(x, -0.5, 0)) for name, x in (("Ä left", -1.1), ("right", 0.1))]
    camera = scene.camera.data
    camera.type, camera.ortho_scale = 'ORTHO', 2.4
    exact(scene)
    scene.render.resolution_x, scene.render.resolution_y = 96, 48
    return objects


def compare(panels, scene, render, tree, socket):
    mesh = panels[0].data
    mesh.materials.clear()
    mesh.materials.append(tree.emit(socket))
    ours, theirs = both(scene, render)
    assert np.ptp(theirs) > 0.01
    agree(ours, theirs)


TYPES = [('FLOAT', 'POINT'), ('FLOAT', 'FACE'), ('FLOAT', 'EDGE'), ('INT', 'CORNER'), ('BOOLEAN', 'FACE'),
         ('FLOAT2', 'CORNER'), ('FLOAT_VECTOR', 'POINT'), ('FLOAT_COLOR', 'CORNER'), ('FLOAT_COLOR', 'POINT'),
         ('BYTE_COLOR', 'CORNER')]


@pytest.mark.parametrize(("kind", "domain"), TYPES)
def test_attributes(panels, scene, render, kind, domain):
    mesh = panels[0].data
    layer = mesh.attributes.new("Wear", kind, domain)
    rng = np.random.default_rng(3)
    prop, width = {'FLOAT2': ("vector", 2), 'FLOAT_VECTOR': ("vector", 3), 'FLOAT_COLOR': ("color", 4),
                   'BYTE_COLOR': ("color", 4)}.get(kind, ("value", 1))
    values = rng.uniform(0, 1, len(layer.data) * width)
    layer.data.foreach_set(prop, (values * (3 if kind == 'INT' else 1)).round().astype(int) if kind in (
        'INT', 'BOOLEAN') else values.astype(np.float32))
    tree = Tree()
    node = tree.node('ShaderNodeAttribute', attribute_name="Wear").outputs
    both_ = tree.node('ShaderNodeCombineXYZ', {0: node["Factor" if "Factor" in node else "Fac"], 1: node["Alpha"],
                                               2: tree.separate(node["Vector"])[1]})
    compare(panels, scene, render, tree, both_.outputs[0])


@pytest.mark.parametrize("name", ["", "Paint"])
def test_color_attributes(panels, scene, render, name):
    mesh = panels[0].data
    rng = np.random.default_rng(4)
    for layer in ("Paint", "Other"):
        data = mesh.color_attributes.new(layer, 'BYTE_COLOR', 'CORNER').data
        data.foreach_set("color", rng.uniform(0, 1, len(data) * 4).astype(np.float32))
    mesh.color_attributes.render_color_index = 1
    tree = Tree()
    compare(panels, scene, render, tree, tree.node('ShaderNodeVertexColor', layer_name=name).outputs["Color"])


@pytest.mark.parametrize("output", ["Generated", "UV", "UV Map"])
def test_places_on_what_an_instance_stands_on(panels, scene, render, output):
    """From Instancer: 0 for what is no instance."""
    tree = Tree()
    if output == "UV Map":
        place = tree.node('ShaderNodeUVMap', from_instancer=True).outputs[0]
    else:
        place = tree.node('ShaderNodeTexCoord', from_instancer=True).outputs[output]
    moved = tree.node('ShaderNodeVectorMath', {0: place, 1: tree.node('ShaderNodeTexCoord').outputs["Object"]})
    panels[1].instance_type, panels[1].use_instance_faces_scale, panels[1].instance_faces_scale = 'FACES', True, 0.8
    panels[0].parent = panels[1]
    compare(panels, scene, render, tree, moved.outputs[0])


def test_an_attribute_that_no_mesh_has(panels, scene, render):
    tree = Tree()
    node = tree.node('ShaderNodeAttribute', attribute_name="Nothing").outputs
    u = tree.separate(tree.uv())[0]
    shown = tree.node('ShaderNodeCombineXYZ', {0: u, 1: node["Alpha"], 2: tree.separate(node["Color"])[0]})
    compare(panels, scene, render, tree, shown.outputs[0])


def test_two_uv_maps_in_one_material(panels, scene, render):
    tree = Tree()
    first = tree.separate(tree.uv())
    second = tree.separate(tree.node('ShaderNodeUVMap', uv_map="Second").outputs[0])
    compare(panels, scene, render, tree, tree.node('ShaderNodeCombineXYZ', {
        0: first[0], 1: second[0], 2: second[1]}).outputs[0])


def test_materials_with_other_uv_maps_on_one_mesh(panels, scene, render):
    mesh = panels[0].data
    for name in ("First", "Second"):
        tree = Tree(name)
        mesh.materials.append(tree.emit(tree.node('ShaderNodeUVMap', uv_map=name).outputs[0]))
    mesh.attributes.new("material_index", 'INT', 'FACE').data.foreach_set("value", np.arange(16) % 2)
    agree(*both(scene, render))


INFO = ["Location", "Color", "Alpha", "Object Index", "Material Index", "Random"]


@pytest.mark.parametrize("output", INFO)
def test_object_info(panels, scene, render, output):
    for i, ob in enumerate(panels):
        ob.color, ob.pass_index = (0.2 + i / 2, 0.4, 0.9 - i / 2, 0.3 + i / 3), i + 1
    tree = Tree()
    tree.material.pass_index = 2
    node = tree.node('ShaderNodeObjectInfo').outputs
    shown = tree.node('ShaderNodeCombineXYZ', {0: node["Random"], 1: tree.separate(tree.uv())[0]}).outputs[0]
    shown = tree.node('ShaderNodeVectorMath', {0: shown, 1: node[output]}).outputs[0]
    compare(panels, scene, render, tree, shown)


def test_properties_of_objects_and_instancers(panels, scene, render, add):
    """Custom ones and Blender's own; the two panels are instances of two empties."""
    collection = bpy.data.collections.new("Panels")
    collection.objects.link(panels[1])
    scene.collection.objects.unlink(panels[1])
    panels[1]["heat"] = 0.7
    panels[1]["tint"] = (0.2, 0.4, 0.6)
    empty = add(None, "Empty", location=(0.05, 0.1, 0), instance_type='COLLECTION', instance_collection=collection)
    empty["heat"] = 0.25
    scene["heat"] = 0.6
    tree = Tree()
    kinds = [tree.node('ShaderNodeAttribute', attribute_type=kind, attribute_name=name).outputs for kind, name in (
        ('OBJECT', "heat"), ('INSTANCER', "heat"), ('OBJECT', "tint"), ('OBJECT', "color"), ('VIEW_LAYER', "heat"))]
    first = tree.node('ShaderNodeCombineXYZ', {0: kinds[0][2], 1: kinds[1][2], 2: kinds[4][2]}).outputs[0]
    second = tree.node('ShaderNodeVectorMath', {0: kinds[2]["Color"], 1: kinds[3]["Color"]}).outputs[0]
    shown = tree.node('ShaderNodeVectorMath', {0: first, 1: second}).outputs[0]
    shown = tree.node('ShaderNodeVectorMath', {0: shown, 1: tree.node('ShaderNodeObjectInfo').outputs["Random"]})
    compare(panels, scene, render, tree, shown.outputs[0])


def tuft(mesh):
    """Make the panel's mesh three bent parts, some vertices of which are at one place, one with a loose edge."""
    n = 6
    vertices, faces = [], []
    for part in range(3):
        first = len(vertices)
        vertices += [(x / 10 + (part & 1) / 2, y / 10 + (part >> 1) / 2, 0.15 * np.sin(x * (part + 1)) * np.cos(y))
                     for y in range(n) for x in range(n)]
        faces += [tuple(first + at for at in (y * n + x, y * n + x + 1, (y + 1) * n + x + 1, (y + 1) * n + x))
                  for y in range(n - 1) for x in range(n - 1)]
    mesh.clear_geometry()
    mesh.from_pydata([*vertices, (0.2, 0.2, 0.9)], [(0, len(vertices))], faces)


@pytest.mark.parametrize("name", ["Pointiness", "Random Per Island"])
def test_what_the_shape_of_a_mesh_says(panels, scene, render, name):
    mesh = panels[0].data
    tuft(mesh)
    for polygon in mesh.polygons:
        polygon.use_smooth = True
    tree = Tree()
    compare(panels, scene, render, tree, tree.node('ShaderNodeNewGeometry').outputs[name])


def test_flat_faces_that_are_not_level(scene, render, add_mesh):
    """Each triangle of a flat polygon has a normal of its own."""
    corners = [(-1, -1, 0), (0, -1, 0.4), (0, 1, -0.3), (-1, 1, 0.5), (1, -1, 0), (1, 1, 0.6)]
    tree, ob = Tree(), add_mesh("Bent", corners, [(0, 1, 2, 3), (1, 4, 5, 2)])
    ob.data.shade_flat()
    ob.data.materials.append(tree.emit(tree.node('ShaderNodeNewGeometry').outputs["Normal"]))
    scene.camera.data.type, scene.camera.data.ortho_scale = 'ORTHO', 1.9
    exact(scene)
    scene.render.resolution_x = scene.render.resolution_y = 48
    agree(*both(scene, render))
