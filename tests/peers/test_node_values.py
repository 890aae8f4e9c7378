"""Values of shader nodes beside Cycles: an emitting plane, pixel by pixel, with a node tree behind its colour."""

import bpy
import numpy as np
import pytest

pytestmark = pytest.mark.slow


@pytest.fixture
def plane(scene, add_plane):
    """A plane that fills the picture, its UVs from 0 to 1, the render without filter, and Cycles' settings."""
    ob = add_plane(half=1.0)
    layer = ob.data.uv_layers.new(name="UVMap")
    for corner, at in zip(layer.uv, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        corner.vector = at
    scene.camera.data.type, scene.camera.data.ortho_scale = 'ORTHO', 1.96
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.filter_size = 0.0
    scene.light_meshes.samples = 1
    scene.cycles.samples, scene.cycles.filter_width, scene.cycles.use_denoising = 4, 0.01, False  # at pixels' middles
    scene.cycles.use_adaptive_sampling = False
    return ob


class Tree:
    """A material's node tree, written down quickly."""

    def __init__(self, name="Material"):
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()

    def node(self, idname, inputs=None, **properties):
        """A node; inputs by name or position: values, or sockets that are linked."""
        node = self.tree.nodes.new(idname)
        for name, value in properties.items():
            setattr(node, name, value)
        for key, value in (inputs or {}).items():
            socket = node.inputs[key] if isinstance(key, int) else next(
                s for s in node.inputs if s.name == key and not s.is_unavailable)
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node

    def uv(self):
        return self.node('ShaderNodeTexCoord').outputs["UV"]

    def separate(self, socket):
        return self.node('ShaderNodeSeparateXYZ', {0: socket}).outputs

    def emit(self, socket):
        """The material: emission of the value at `socket`, brought to where light is positive."""
        shown = self.node('ShaderNodeVectorMath', {0: socket, 1: (0.2, 0.2, 0.2), 2: (0.5, 0.5, 0.5)},
                          operation='MULTIPLY_ADD').outputs[0]
        emission = self.node('ShaderNodeEmission', {"Color": shown})
        output = self.tree.nodes.new('ShaderNodeOutputMaterial')
        self.tree.links.new(emission.outputs[0], output.inputs["Surface"])
        return self.material


def both(scene, render):
    """This engine's picture and Cycles'."""
    scene.render.engine = 'LIGHT_MESHES'
    ours = render(scene)["Combined"][..., :3]
    scene.render.engine = 'CYCLES'
    return ours, render(scene)["Combined"][..., :3]


def agree(ours, theirs, median=0.005, most=0.03):
    """Whether the pictures are the same: in the median, and at the 99th percentile away from the edges of patterns."""
    difference = np.abs(ours - theirs).max(2) / np.maximum(np.abs(theirs).max(2), 0.05)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(theirs, ((1, 1), (1, 1), (0, 0)), 'edge'), (3, 3), (0, 1))
    smooth = np.ptp(around, axis=(3, 4)).max(2) < 0.15 * max(theirs.max(), 0.05)
    assert smooth.mean() > 0.3
    assert np.median(difference) <= median, np.median(difference)
    assert np.quantile(difference[smooth], 0.99) <= most, np.quantile(difference[smooth], 0.99)


def check(plane, scene, render, socket, tree, **bounds):
    plane.data.materials.clear()
    plane.data.materials.append(tree.emit(socket))
    ours, theirs = both(scene, render)
    assert theirs.max() > 0.01
    agree(ours, theirs, **bounds)


MATH = [item.identifier for item in bpy.types.ShaderNodeMath.bl_rna.properties["operation"].enum_items]


@pytest.mark.parametrize("operation", MATH)
def test_math(plane, scene, render, operation):
    tree = Tree()
    u, w, _ = tree.separate(tree.uv())
    a = tree.node('ShaderNodeMath', {0: u, 1: 3.0, 2: -1.0}, operation='MULTIPLY_ADD').outputs[0]
    found = tree.node('ShaderNodeMath', {0: a, 1: w, 2: 0.4}, operation=operation).outputs[0]
    shown = tree.node('ShaderNodeMapRange', {"Value": found, "From Min": -4.0, "From Max": 4.0}).outputs[0]
    check(plane, scene, render, shown, tree)


VECTOR_MATH = [item.identifier for item in bpy.types.ShaderNodeVectorMath.bl_rna.properties["operation"].enum_items]


@pytest.mark.parametrize("operation", VECTOR_MATH)
def test_vector_math(plane, scene, render, operation):
    tree = Tree()
    a = tree.node('ShaderNodeMapping', {"Vector": tree.uv(), "Location": (-0.7, -0.4, 0.3), "Scale": (2, 1.5, 1)})
    found = tree.node('ShaderNodeVectorMath', operation=operation)
    tree.tree.links.new(a.outputs[0], found.inputs[0])
    values = iter([(0.3, 0.6, -0.4), (0.8, -0.5, 0.2)])
    for socket in [s for s in found.inputs if not s.is_unavailable][1:]:
        socket.default_value = next(values) if socket.type == 'VECTOR' else 0.8
    output = next(s for s in found.outputs if not s.is_unavailable)
    check(plane, scene, render, output, tree)


BLENDS = [item.identifier for item in bpy.types.ShaderNodeMix.bl_rna.properties["blend_type"].enum_items]


@pytest.mark.parametrize("factor", [1.0, 0.6])
@pytest.mark.parametrize("mode", BLENDS)
def test_blend_modes(plane, scene, render, mode, factor):
    tree = Tree()
    u, w, _ = tree.separate(tree.uv())
    a = tree.node('ShaderNodeCombineXYZ', {0: u, 1: w, 2: 0.3}).outputs[0]
    b = tree.node('ShaderNodeCombineXYZ', {0: w, 1: 0.7, 2: u}).outputs[0]
    mix = tree.node('ShaderNodeMix', data_type='RGBA', blend_type=mode)
    sockets = [s for s in mix.inputs if not s.is_unavailable]
    sockets[0].default_value = factor
    tree.tree.links.new(a, sockets[1])
    tree.tree.links.new(b, sockets[2])
    check(plane, scene, render, next(s for s in mix.outputs if not s.is_unavailable), tree)


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


def painted(width=24, height=16):
    """An image whose every texel is another colour, with an alpha that goes from 0 to 1."""
    image = bpy.data.images.new("painted", width, height, alpha=True)
    rng = np.random.default_rng(5)
    pixels = rng.uniform(0.1, 0.9, (height, width, 4)).astype(np.float32)
    pixels[..., 3] = np.linspace(0, 1, width)
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image


@pytest.mark.parametrize("projection", ['FLAT', 'SPHERE', 'TUBE'])
@pytest.mark.parametrize("extension", ['REPEAT', 'EXTEND', 'CLIP', 'MIRROR'])
def test_images_that_are_placed(plane, scene, render, projection, extension):
    if projection != 'FLAT' and extension != 'REPEAT':
        pytest.skip("the extension has nothing to do with the projection")
    tree = Tree()
    place = tree.node('ShaderNodeMapping', {"Vector": tree.uv(), "Location": (-0.6, -0.4, 0.2), "Scale": (2, 2, 1),
                                            "Rotation": (0, 0, 0.3)}).outputs[0]
    image = tree.node('ShaderNodeTexImage', {0: place}, image=painted(), projection=projection, extension=extension,
                      interpolation='Closest')
    check(plane, scene, render, image.outputs["Color"], tree)


def test_colours_of_an_image_are_changed(plane, scene, render):
    tree = Tree()
    image = tree.node('ShaderNodeTexImage', image=painted(8, 8), interpolation='Closest')
    hue = tree.node('ShaderNodeHueSaturation', {"Color": image.outputs[0], "Saturation": 0.3, "Value": 1.5})
    check(plane, scene, render, hue.outputs[0], tree, most=0.04)


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


PATTERNS = [('ShaderNodeTexChecker', {}), *(('ShaderNodeTexGradient', {"gradient_type": kind}) for kind in (
    'LINEAR', 'QUADRATIC', 'EASING', 'DIAGONAL', 'SPHERICAL', 'QUADRATIC_SPHERE', 'RADIAL'))]


@pytest.mark.parametrize(("idname", "properties"), PATTERNS)
def test_checkers_and_gradients(plane, scene, render, idname, properties):
    tree = Tree()
    place = tree.node('ShaderNodeMapping', {"Vector": tree.uv(), "Location": (-0.5, -0.4, 0.2)}).outputs[0]
    check(plane, scene, render, tree.node(idname, {0: place}, **properties).outputs[0], tree)


def space(tree):
    """Places in space that move over the plane, with all three numbers."""
    return tree.node('ShaderNodeMapping', {"Vector": tree.uv(), "Location": (-0.4, -0.3, 0.2),
                                           "Rotation": (0.5, 0.3, 0.2)}).outputs[0]


@pytest.mark.parametrize("output", ["Color", 0])
@pytest.mark.parametrize("kind", ['FBM', 'MULTIFRACTAL', 'HYBRID_MULTIFRACTAL', 'RIDGED_MULTIFRACTAL',
                                  'HETERO_TERRAIN'])
@pytest.mark.parametrize("dimensions", ['1D', '2D', '3D', '4D'])
def test_noise(plane, scene, render, dimensions, kind, output):
    tree = Tree()
    inputs = {"Scale": 3.0, "Detail": 1.6, "Roughness": 0.6, "Lacunarity": 2.1, "Offset": 0.4, "Gain": 1.2}
    if dimensions in ('1D', '4D'):
        inputs["W"] = tree.separate(space(tree))[0]
    if dimensions != '1D':
        inputs["Vector"] = space(tree)
    node = tree.node('ShaderNodeTexNoise', noise_dimensions=dimensions, noise_type=kind)
    for name, value in inputs.items():
        if name not in node.inputs:
            continue
        if isinstance(value, float):
            node.inputs[name].default_value = value
        else:
            tree.tree.links.new(value, node.inputs[name])
    node.inputs["Distortion"].default_value = 0.0 if kind == 'FBM' else 0.4
    check(plane, scene, render, node.outputs[output], tree)


@pytest.mark.parametrize("dimensions", ['1D', '2D', '3D', '4D'])
def test_white_noise(plane, scene, render, dimensions):
    tree = Tree()
    cells = tree.node('ShaderNodeVectorMath', {0: space(tree), 1: (0.25, 0.25, 0.25)}, operation='SNAP').outputs[0]
    node = tree.node('ShaderNodeTexWhiteNoise', noise_dimensions=dimensions)
    for name, socket in (("Vector", cells), ("W", tree.separate(cells)[0])):
        if name in node.inputs:
            tree.tree.links.new(socket, node.inputs[name])
    check(plane, scene, render, node.outputs["Color"], tree, most=0.06)


@pytest.mark.parametrize("profile", ['SIN', 'SAW', 'TRI'])
@pytest.mark.parametrize("kind", ['BANDS X', 'BANDS DIAGONAL', 'RINGS Z', 'RINGS SPHERICAL'])
def test_waves(plane, scene, render, kind, profile):
    tree = Tree()
    kind, direction = kind.split()
    node = tree.node('ShaderNodeTexWave', {"Vector": space(tree), "Scale": 0.7, "Distortion": 2.0, "Detail": 1.5,
                                           "Detail Scale": 1.3, "Phase Offset": 0.4},
                     wave_type=kind, wave_profile=profile)
    setattr(node, f"{kind.lower()}_direction", direction)
    check(plane, scene, render, node.outputs["Color"], tree)


@pytest.mark.parametrize("depth", range(0, 11, 2))
def test_magic(plane, scene, render, depth):
    tree = Tree()
    node = tree.node('ShaderNodeTexMagic', {"Vector": space(tree), "Scale": 0.8, "Distortion": 1.2},
                     turbulence_depth=depth)
    check(plane, scene, render, node.outputs["Color"], tree)


@pytest.mark.parametrize("frequencies", [(2, 1), (2, 3)])
def test_bricks(plane, scene, render, frequencies):
    tree = Tree()
    node = tree.node('ShaderNodeTexBrick', {"Vector": space(tree), "Scale": 6.0, "Mortar Smooth": 0.4,
                                            "Mortar Size": 0.06}, offset_frequency=frequencies[0],
                     squash_frequency=frequencies[1], squash=0.6)
    check(plane, scene, render, node.outputs["Color"], tree)
