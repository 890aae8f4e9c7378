"""Values of shader nodes beside Cycles: an emitting plane, pixel by pixel, with a node tree behind its colour."""

import bpy
import pytest
from node_pictures import check
from node_trees import Tree

pytestmark = pytest.mark.slow


def ramp(tree, interpolation, mode='RGB'):
    node = tree.node('ShaderNodeValToRGB', {0: tree.separate(tree.uv())[0]})
    node.color_ramp.color_mode = mode
    if mode == 'RGB':
        node.color_ramp.interpolation = interpolation
    node.color_ramp.elements[0].position, node.color_ramp.elements[1].position = 0.1, 0.9
    node.color_ramp.elements[0].color = (0.9, 0.1, 0.2, 1)
    node.color_ramp.elements.new(0.4).color = (0.1, 0.6, 0.9, 0.5)
    return node.outputs["Color"]


@pytest.mark.parametrize("interpolation", ['LINEAR', 'CONSTANT', 'EASE', 'CARDINAL', 'B_SPLINE'])
def test_color_ramps(plane, scene, render, interpolation):
    tree = Tree()
    check(plane, scene, render, ramp(tree, interpolation), tree)


@pytest.mark.parametrize("mode", ['HSV', 'HSL'])
def test_color_ramps_by_hue(plane, scene, render, mode):
    tree = Tree()
    check(plane, scene, render, ramp(tree, '', mode), tree)


def colors(tree):
    """Colours of every hue over the plane."""
    u, w, _ = tree.separate(tree.uv())
    return tree.node('ShaderNodeCombineColor', {0: u, 1: w, 2: 0.7}, mode='HSV').outputs[0]


def curved(node):
    node.mapping.curves[0].points.new(0.3, 0.6)
    node.mapping.curves[-1].points.new(0.6, 0.4)
    node.mapping.update()


COLORS = {
    "hue": ('ShaderNodeHueSaturation', {"Hue": 0.7, "Saturation": 0.6, "Value": 0.8}, "Color", None),
    "bright": ('ShaderNodeBrightContrast', {1: 0.2, "Contrast": 0.4}, "Color", None),
    "gamma": ('ShaderNodeGamma', {"Gamma": 2.2}, "Color", None),
    "invert": ('ShaderNodeInvert', {0: 0.8}, "Color", None),
    "black and white": ('ShaderNodeRGBToBW', {}, "Color", None),
    "rgb curves": ('ShaderNodeRGBCurve', {0: 0.8}, "Color", curved),
    "vector curves": ('ShaderNodeVectorCurve', {0: 1.0}, "Vector", curved),
}


@pytest.mark.parametrize("name", COLORS)
def test_colors(plane, scene, render, name):
    idname, inputs, at, change = COLORS[name]
    tree = Tree()
    node = tree.node(idname, {at: colors(tree)} | inputs)
    if change:
        change(node)
    check(plane, scene, render, node.outputs[0], tree)


@pytest.mark.parametrize("mode", ['RGB', 'HSV', 'HSL'])
def test_separated_and_combined_colors(plane, scene, render, mode):
    tree = Tree()
    parts = tree.node('ShaderNodeSeparateColor', {0: colors(tree)}, mode=mode).outputs
    turned = tree.node('ShaderNodeCombineColor', {0: parts[0], 1: parts[2], 2: parts[1]}, mode=mode)
    check(plane, scene, render, turned.outputs[0], tree)


def test_float_curve(plane, scene, render):
    tree = Tree()
    node = tree.node('ShaderNodeFloatCurve', {"Value": tree.separate(tree.uv())[0]})
    curved(node)
    check(plane, scene, render, node.outputs[0], tree)


@pytest.mark.parametrize("kind", ['LINEAR', 'STEPPED', 'SMOOTHSTEP', 'SMOOTHERSTEP'])
@pytest.mark.parametrize("data", ['FLOAT', 'FLOAT_VECTOR'])
def test_map_range(plane, scene, render, kind, data):
    tree = Tree()
    node = tree.node('ShaderNodeMapRange', data_type=data, interpolation_type=kind)
    sockets = [s for s in node.inputs if not s.is_unavailable]
    tree.tree.links.new(tree.uv() if data == 'FLOAT_VECTOR' else tree.separate(tree.uv())[0], sockets[0])
    for socket, value in zip(sockets[1:], (0.2, 0.9, 0.8, 0.1, 3.0), strict=False):
        socket.default_value = (value,) * 3 if socket.type == 'VECTOR' else value
    check(plane, scene, render, next(s for s in node.outputs if not s.is_unavailable), tree)


@pytest.mark.parametrize("kind", ['POINT', 'TEXTURE', 'VECTOR', 'NORMAL'])
def test_mapping(plane, scene, render, kind):
    tree = Tree()
    inputs = {"Vector": tree.uv(), "Rotation": (0.3, 0.5, 0.8), "Scale": (1.5, 0.8, 2.0)}
    if kind in ('POINT', 'TEXTURE'):
        inputs["Location"] = (0.2, 0.3, 0.1)
    check(plane, scene, render, tree.node('ShaderNodeMapping', inputs, vector_type=kind).outputs[0], tree)


@pytest.mark.parametrize("kind", ['AXIS_ANGLE', 'X_AXIS', 'Y_AXIS', 'Z_AXIS', 'EULER_XYZ'])
@pytest.mark.parametrize("invert", [False, True])
def test_vector_rotate(plane, scene, render, kind, invert):
    tree = Tree()
    node = tree.node('ShaderNodeVectorRotate', rotation_type=kind, invert=invert)
    tree.tree.links.new(tree.uv(), node.inputs["Vector"])
    for name, value in (("Center", (0.5, 0.5, 0.2)), ("Axis", (0.2, 0.3, 1)), ("Angle", 0.7),
                        ("Rotation", (0.3, 0.5, 0.8))):
        if name in node.inputs:
            node.inputs[name].default_value = value
    check(plane, scene, render, node.outputs[0], tree)


PLACES = {
    "generated": ('ShaderNodeTexCoord', "Generated"), "object": ('ShaderNodeTexCoord', "Object"),
    "normal": ('ShaderNodeTexCoord', "Normal"), "reflection": ('ShaderNodeTexCoord', "Reflection"),
    "position": ('ShaderNodeNewGeometry', "Position"), "true normal": ('ShaderNodeNewGeometry', "True Normal"),
    "world normal": ('ShaderNodeNewGeometry', "Normal"), "incoming": ('ShaderNodeNewGeometry', "Incoming"),
    "location": ('ShaderNodeObjectInfo', "Location"), "facing": ('ShaderNodeLayerWeight', "Facing"),
    "layer fresnel": ('ShaderNodeLayerWeight', "Fresnel"), "fresnel": ('ShaderNodeFresnel', 0),
    "camera ray": ('ShaderNodeLightPath', "Is Camera Ray"),
}


@pytest.mark.parametrize("name", PLACES)
def test_where_a_point_is(plane, scene, render, name):
    """On a ball that is moved, turned and scaled unevenly."""
    import bmesh

    mesh = plane.data
    made = bmesh.new()
    bmesh.ops.create_uvsphere(made, u_segments=48, v_segments=24, radius=0.9)
    made.to_mesh(mesh)
    made.free()
    for polygon in mesh.polygons:
        polygon.use_smooth = True
    plane.location, plane.rotation_euler, plane.scale = (0.05, 0.03, 0.2), (0.3, 0.5, 0.2), (1, 0.8, 0.9)
    tree = Tree()
    idname, output = PLACES[name]
    found = tree.node(idname).outputs[output]
    check(plane, scene, render, found, tree, most=0.04)


def group(name, build):
    """A node group with the input and the output "Color" of `build`(tree, input socket) → output socket."""
    tree = Tree.__new__(Tree)
    tree.tree = bpy.data.node_groups.new(name, 'ShaderNodeTree')
    for kind in ('INPUT', 'OUTPUT'):
        tree.tree.interface.new_socket("Color", in_out=kind, socket_type='NodeSocketColor')
    given = tree.tree.nodes.new('NodeGroupInput').outputs[0]
    end = tree.tree.nodes.new('NodeGroupOutput')
    tree.tree.links.new(build(tree, given), end.inputs[0])
    return tree.tree


def test_groups_are_followed(plane, scene, render):
    """Nested, used twice with other inputs, with reroutes and muted nodes in them."""
    def inverted(tree, given):
        reroute = tree.tree.nodes.new('NodeReroute')
        tree.tree.links.new(given, reroute.inputs[0])
        muted = tree.node('ShaderNodeGamma', {0: reroute.outputs[0], 1: 5.0}, mute=True)
        return tree.node('ShaderNodeInvert', {1: muted.outputs[0]}).outputs[0]

    inner = group("Inner", inverted)

    def outer(tree, given):
        first = tree.node('ShaderNodeGroup', node_tree=inner)
        tree.tree.links.new(given, first.inputs[0])
        alone = tree.node('ShaderNodeGroup', node_tree=inner)  # with its own colour
        alone.inputs[0].default_value = (0.2, 0.5, 0.9, 1)
        mix = tree.node('ShaderNodeMix', {0: 0.5}, data_type='RGBA')
        sockets = [s for s in mix.inputs if not s.is_unavailable]
        tree.tree.links.new(first.outputs[0], sockets[1])
        tree.tree.links.new(alone.outputs[0], sockets[2])
        return next(s for s in mix.outputs if not s.is_unavailable)

    whole = group("Outer", outer)
    tree = Tree()
    node = tree.node('ShaderNodeGroup', node_tree=whole)
    tree.tree.links.new(colors(tree), node.inputs[0])
    check(plane, scene, render, node.outputs[0], tree)
