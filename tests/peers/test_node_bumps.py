"""Bump, Normal Map, Tangent and displacement as bumps beside Cycles: the normals themselves, and a lit surface."""

import numpy as np
import pytest
from node_pictures import agree, both, check, painted
from node_trees import Tree, space

pytestmark = pytest.mark.slow


@pytest.fixture
def ball(plane):
    """The plane's object as a turned, unevenly scaled ball with UVs, smooth but for a few faces."""
    import bmesh

    made = bmesh.new()
    bmesh.ops.create_uvsphere(made, u_segments=24, v_segments=12, radius=0.9, calc_uvs=True)
    layer = made.loops.layers.uv.new("UVMap") if not made.loops.layers.uv else made.loops.layers.uv[0]
    for face in made.faces:
        face.smooth = face.calc_center_median().z < 0.75
        for loop in face.loops:
            x, y, z = loop.vert.co
            loop[layer].uv = (x * 0.5 + 0.1 * z + 0.5, abs(y) * 0.7)  # mirrored in one half
    mesh = plane.data
    mesh.uv_layers.remove(mesh.uv_layers[0])
    made.to_mesh(mesh)
    made.free()
    plane.location, plane.rotation_euler, plane.scale = (0.05, 0.03, 0.2), (0.3, 0.5, 0.2), (1, 0.8, 0.9)
    return plane


def height(tree, kind):
    if kind == "image":
        image = painted(12, 12)
        image.colorspace_settings.name = 'Non-Color'
        return tree.node('ShaderNodeTexImage', image=image).outputs[0]
    if kind == "uv":
        u, w, _ = tree.separate(tree.uv())
        return tree.node('ShaderNodeMath', {0: u, 1: w}, operation='MULTIPLY').outputs[0]
    where = {"generated": lambda: tree.node('ShaderNodeTexCoord').outputs["Generated"],
             "object": lambda: tree.node('ShaderNodeTexCoord').outputs["Object"],
             "position": lambda: tree.node('ShaderNodeNewGeometry').outputs["Position"]}[kind]()
    return tree.node('ShaderNodeTexNoise', {"Vector": where, "Scale": 3.0, "Detail": 1.0}).outputs[0]


@pytest.mark.parametrize("kind", ["generated", "object", "position", "uv", "image"])
@pytest.mark.parametrize("invert", [False, True])
def test_bump(ball, scene, render, kind, invert):
    scene.camera.data.type = 'PERSP' if invert else 'ORTHO'
    scene.camera.data.lens = 170
    tree = Tree()
    bump = tree.node('ShaderNodeBump', {"Height": height(tree, kind), "Strength": 0.7, "Distance": 0.5}, invert=invert)
    check(ball, scene, render, bump.outputs[0], tree)


def test_bump_on_bump(ball, scene, render):
    """By an attribute, over another bump, with a wide filter where Blender has one."""
    mesh = ball.data
    layer = mesh.attributes.new("Height", 'FLOAT', 'POINT')
    layer.data.foreach_set("value", np.random.default_rng(2).uniform(0, 0.2, len(mesh.vertices)).astype(np.float32))
    tree = Tree()
    first = tree.node('ShaderNodeBump', {"Height": height(tree, "object"), "Distance": 0.5})
    attribute = tree.node('ShaderNodeAttribute', attribute_name="Height").outputs[2]
    second = tree.node('ShaderNodeBump', {"Height": attribute, "Normal": first.outputs[0]})
    if "Filter Width" in second.inputs:
        second.inputs["Filter Width"].default_value = 1.0
    check(ball, scene, render, second.outputs[0], tree)


@pytest.mark.parametrize("strength", [1.0, 0.3])
@pytest.mark.parametrize("kind", ['TANGENT', 'OBJECT', 'WORLD', 'BLENDER_OBJECT', 'BLENDER_WORLD'])
def test_normal_map(ball, scene, render, kind, strength):
    tree = Tree()
    u, w, _ = tree.separate(tree.uv())
    color = tree.node('ShaderNodeCombineColor', {0: u, 1: w, 2: 0.9}).outputs[0]
    found = tree.node('ShaderNodeNormalMap', {"Color": color, "Strength": strength}, space=kind)
    check(ball, scene, render, found.outputs[0], tree, most=0.04)  # as far as normals of such a ball are apart


@pytest.mark.parametrize("axis", ['X', 'Y', 'Z', 'UV'])
def test_tangents(ball, scene, render, axis):
    tree = Tree()
    node = tree.node('ShaderNodeTangent', direction_type='UV_MAP' if axis == 'UV' else 'RADIAL')
    if axis != 'UV':
        node.axis = axis
    check(ball, scene, render, node.outputs[0], tree)


def lit(scene, ob, tree, shader, add_light):
    add_light('SUN', rotation=(0.6, 0.3, 0), energy=3.0)
    output = tree.tree.nodes.new('ShaderNodeOutputMaterial')
    tree.tree.links.new(shader.outputs[0], output.inputs["Surface"])
    ob.data.materials.clear()
    ob.data.materials.append(tree.material)
    scene.light_meshes.shadows, scene.cycles.max_bounces = 'SHARP', 0
    scene.cycles.samples = 16
    return output


def test_a_bumped_surface_is_lit(ball, scene, render, add_light):
    tree = Tree()
    bump = tree.node('ShaderNodeBump', {"Height": height(tree, "object"), "Distance": 0.4})
    shader = tree.node('ShaderNodeBsdfDiffuse', {"Normal": bump.outputs[0]})
    lit(scene, ball, tree, shader, add_light)
    agree(*both(scene, render), most=0.05)


@pytest.mark.parametrize("where", ['OBJECT', 'WORLD'])
def test_displacement_is_shown_as_bumps(plane, scene, render, add_light, where):
    plane.scale = (2, 2, 2)
    tree = Tree()
    output = lit(scene, plane, tree, tree.node('ShaderNodeBsdfDiffuse'), add_light)
    noise = tree.node('ShaderNodeTexNoise', {"Vector": space(tree), "Scale": 4.0}).outputs[0]
    displacement = tree.node('ShaderNodeDisplacement', {"Height": noise, "Scale": 0.2}, space=where)
    tree.tree.links.new(displacement.outputs[0], output.inputs["Displacement"])
    tree.material.displacement_method = 'BUMP'
    agree(*both(scene, render), most=0.05)


def smoothed(ob):
    """Displaced meshes have no sharp edges in Cycles."""
    for polygon in ob.data.polygons:
        polygon.use_smooth = True


@pytest.mark.parametrize("space_of", ['OBJECT', 'WORLD', 'TANGENT'])
def test_vector_displacement_is_shown_as_bumps(ball, scene, render, add_light, space_of):
    smoothed(ball)
    tree = Tree()
    output = lit(scene, ball, tree, tree.node('ShaderNodeBsdfDiffuse'), add_light)
    where = tree.node('ShaderNodeTexCoord').outputs["Object"]
    noise = tree.node('ShaderNodeTexNoise', {"Vector": where, "Scale": 2.0}).outputs[1]
    displacement = tree.node('ShaderNodeVectorDisplacement', {"Vector": noise, "Scale": 0.3, "Midlevel": 0.4},
                             space=space_of)
    tree.tree.links.new(displacement.outputs[0], output.inputs["Displacement"])
    tree.material.displacement_method = 'BUMP'
    agree(*both(scene, render), most=0.05)


def test_any_vector_displaces(ball, scene, render, add_light):
    """A sum of two displacements, one of them along a normal of its own."""
    smoothed(ball)
    tree = Tree()
    output = lit(scene, ball, tree, tree.node('ShaderNodeBsdfDiffuse'), add_light)
    where = tree.node('ShaderNodeTexCoord').outputs["Object"]
    noise = tree.node('ShaderNodeTexNoise', {"Vector": where, "Scale": 2.0}).outputs[0]
    first = tree.node('ShaderNodeDisplacement', {"Height": noise, "Scale": 0.2}).outputs[0]
    own = tree.node('ShaderNodeNewGeometry').outputs["Normal"]
    aside = tree.node('ShaderNodeVectorMath', {0: own, 1: (0.5, 0.3, 0.1)}, operation='ADD').outputs[0]
    second = tree.node('ShaderNodeDisplacement', {"Height": noise, "Scale": 0.1, "Normal": aside}).outputs[0]
    both_of = tree.node('ShaderNodeVectorMath', {0: first, 1: second}, operation='ADD').outputs[0]
    tree.tree.links.new(both_of, output.inputs["Displacement"])
    tree.material.displacement_method = 'BUMP'
    agree(*both(scene, render), most=0.05)


@pytest.mark.parametrize("kind", ['POINT', 'VECTOR', 'NORMAL'])
def test_vector_transform(ball, scene, render, kind):
    """Between all three spaces, mixed into one colour."""
    scene.camera.rotation_euler, scene.camera.location.y = (0.05, 0.02, 0.3), -0.3
    tree = Tree()
    vector = tree.node('ShaderNodeNewGeometry').outputs["Normal" if kind == 'NORMAL' else "Position"]
    for n, (a, b) in enumerate([('WORLD', 'OBJECT'), ('OBJECT', 'CAMERA'), ('CAMERA', 'WORLD'), ('WORLD', 'CAMERA'),
                                ('CAMERA', 'OBJECT'), ('OBJECT', 'WORLD'), ('WORLD', 'WORLD')]):
        vector = tree.node('ShaderNodeVectorTransform', {0: vector}, vector_type=kind, convert_from=a, convert_to=b)
        vector = tree.node('ShaderNodeVectorMath', {0: vector.outputs[0], 1: (0.1 * n, 0.2, -0.1)},
                           operation='ADD').outputs[0]
    shown = tree.node('ShaderNodeVectorMath', {0: vector, "Scale": 0.2}, operation='SCALE').outputs[0]
    check(ball, scene, render, shown, tree)
