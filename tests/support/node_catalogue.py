"""Every node whose value is translated, with every choice that it has, as cells of a sheet: any bpy runs this."""

import itertools
import random

import bpy
import node_trees
from node_trees import Tree

# Properties that are no choice of the node's value.
_SKIPPED = {"color_tag", "type", "bl_icon", "bl_static_type", "warning_propagation"}
# Between which bounds the inputs of these names go over a cell, if not MOST; per node, then for all.
MOST = (-1.3, 1.9)
POSITIVE, SHARE = (0.1, 1.6), (-0.2, 1.3)
BETWEEN = {
    'ShaderNodeBlackbody': {"Temperature": (300.0, 14000.0)},
    'ShaderNodeWavelength': {"Wavelength": (340.0, 830.0)},
    'ShaderNodeGamma': {"Color": (-0.2, 1.5), "Gamma": (0.0, 3.0)},
    'ShaderNodeHueSaturation': {"Hue": (-0.3, 1.3), "Saturation": (0.0, 2.0), "Value": (0.0, 2.0)},
    'ShaderNodeFresnel': {"IOR": (0.6, 2.5)},
    'ShaderNodeMapRange': {"Steps": (0.5, 6.0), "From Min": (-1.0, 0.1), "From Max": (0.4, 1.5)},
    'ShaderNodeMath': {1: (0.3, 1.6)},  # what steps are wide is seen
    'ShaderNodeVectorMath': {1: (0.3, 1.6)},
    'ShaderNodeTexNoise': {"Scale": (0.6, 1.2), "Detail": (0.0, 2.0), "Roughness": (0.1, 0.9), "Lacunarity": (1.5, 2.4),
                           "Distortion": (0.0, 0.8), "Offset": (0.0, 1.0), "Gain": (0.5, 1.5), "W": (0.0, 2.0)},
    'ShaderNodeTexVoronoi': {"Scale": (0.8, 1.1), "Randomness": (0.3, 1.0), "Smoothness": (0.0, 1.0),
                             "Exponent": (0.6, 2.5), "Detail": (0.0, 2.5), "Roughness": (0.1, 0.9),
                             "Lacunarity": (1.5, 2.4), "W": (0.0, 2.0)},
    'ShaderNodeTexWave': {"Scale": (0.4, 0.8), "Distortion": (0.0, 2.0), "Detail": (0.0, 3.0),
                          "Detail Scale": (0.5, 1.5), "Detail Roughness": (0.1, 0.9), "Phase Offset": (-1.0, 4.0)},
    'ShaderNodeTexMagic': {"Scale": (0.2, 0.7), "Distortion": (0.5, 1.5)},
    'ShaderNodeTexChecker': {"Scale": (2.0, 2.5)},
    'ShaderNodeTexBrick': {"Scale": (2.0, 2.1), "Mortar Size": (0.02, 0.1), "Mortar Smooth": (-0.3, 1.0),
                           "Bias": (-0.5, 0.5), "Brick Width": (0.4, 0.5), "Row Height": (0.2, 0.3)},
    'ShaderNodeLayerWeight': {"Blend": SHARE},
    'ShaderNodeCombineColor': {0: (-0.3, 1.4), 1: (-0.1, 1.2), 2: (-0.1, 1.3)},
    'ShaderNodeNormalMap': {"Strength": (0.0, 1.5), "Color": (0.2, 0.8)},
    'ShaderNodeBrightContrast': {"Bright": (-0.4, 0.6), "Contrast": (-0.5, 1.0)},
}
ALL = {"Fac": SHARE, "Factor": SHARE}
PLACE = (0.1, 1.1)  # of textures
VALUES = [  # the last four are in old Blenders only
    "Math", "VectorMath", "MixRGB", "Mix", "MapRange", "Clamp", "Mapping", "VectorRotate", "VectorTransform",
    "ValToRGB", "RGBCurve", "VectorCurve", "FloatCurve", "HueSaturation", "BrightContrast", "Gamma", "Invert",
    "RGBToBW", "CombineColor", "SeparateColor", "CombineXYZ", "SeparateXYZ", "Blackbody", "Wavelength", "Normal",
    "LayerWeight", "Fresnel", "NormalMap", "TexNoise", "TexVoronoi", "TexWave", "TexMagic", "TexBrick", "TexChecker",
    "TexGradient", "TexWhiteNoise", "CombineRGB", "SeparateRGB", "CombineHSV", "SeparateHSV"]
INPUTS = ["TexCoord", "NewGeometry", "CameraData", "ObjectInfo", "UVMap", "Tangent", "Value", "RGB", "LightPath",
          "Attribute", "VertexColor"]


def choices(node):
    """Return the node's properties that are a choice: name → values."""
    found = {}
    for prop in node.bl_rna.properties:
        own = prop.identifier not in bpy.types.ShaderNode.bl_rna.properties and not prop.is_readonly
        if not own or prop.identifier in _SKIPPED or prop.is_hidden:
            continue
        if prop.type == 'ENUM' and not prop.is_enum_flag:
            found[prop.identifier] = [i.identifier for i in prop.enum_items]
        elif prop.type == 'BOOLEAN' and not prop.is_array:
            found[prop.identifier] = [False, True]
    if node.bl_idname == 'ShaderNodeTexMagic':
        found["turbulence_depth"] = list(range(11))
    elif node.bl_idname == 'ShaderNodeTexBrick':
        found |= {"offset": [0.0, 0.5, 0.9], "squash": [1.0, 0.6, 1.7], "offset_frequency": [1, 2, 3],
                  "squash_frequency": [1, 2, 3]}
    return found


def combined(found, most):
    """Return the choices together: all of them where these are few, else each value of each a few times with others."""
    names, lists = list(found), list(found.values())
    every = list(itertools.product(*lists))
    if len(every) <= most:
        return [dict(zip(names, one, strict=True)) for one in every]
    chosen, picked = random.Random(len(every)), set()
    for i, values in enumerate(lists):
        for value in values:
            for _ in range(max(2, most // (2 * len(lists) * len(values)))):
                one = tuple(value if j == i else chosen.choice(other) for j, other in enumerate(lists))
                picked.add(one)
    return [dict(zip(names, one, strict=True)) for one in sorted(picked, key=str)]


def slope(tree, low, high, seed, whole):
    """Return a number that goes over the cell between two bounds, along a direction by the seed; whole: by whole steps.
    """
    chosen = random.Random(seed)
    x, y = tree.place()
    a = chosen.uniform(0.2, 0.8)
    mix = tree.node('ShaderNodeMath', {0: x, 1: a * (high - low), 2: low}, operation='MULTIPLY_ADD').outputs[0]
    rise = (1 - a) * (high - low)
    found = tree.node('ShaderNodeMath', {0: y, 1: rise, 2: mix}, operation='MULTIPLY_ADD').outputs[0]
    if whole:
        found = tree.node('ShaderNodeMath', {0: (x, y)[seed % 2], 1: 7.0, 2: -3.4}, operation='MULTIPLY_ADD').outputs[0]
        found = tree.node('ShaderNodeMath', {0: found}, operation='ROUND').outputs[0]
    return found


def bounds(node, i, socket):
    own = BETWEEN.get(node.bl_idname, {})
    usual = (-0.2, 1.3) if socket.type == 'RGBA' else PLACE if "Tex" in node.bl_idname else MOST
    return own.get(socket.name, own.get(i, ALL.get(socket.name, usual)))


def feed(tree, node, how, seed=1):
    """Give each input a value. how: 'slopes', 'whole' steps, 'constants', or 'some': each input either way."""
    chosen = random.Random(seed)
    for i, socket in enumerate(node.inputs):
        if socket.is_unavailable or socket.type not in ('VALUE', 'RGBA', 'VECTOR'):
            continue
        if getattr(socket, "hide_value", False) and socket.name in ("Normal", "Tangent"):
            continue
        low, high = bounds(node, i, socket)
        constant = how == 'constants' or (how == 'some' and chosen.random() < 0.5)
        if socket.type == 'VALUE':
            if constant:
                socket.default_value = chosen.uniform(low, high)
            else:
                tree.tree.links.new(slope(tree, low, high, seed + 10 * i, how == 'whole'), socket)
        elif constant:
            for j in range(3):
                socket.default_value[j] = chosen.uniform(low, high)
        else:
            parts = [slope(tree, low, high, seed + 10 * i + j + 1, how == 'whole') for j in range(3)]
            vector = tree.node('ShaderNodeCombineXYZ', dict(enumerate(parts))).outputs[0]
            tree.tree.links.new(vector, socket)


def ramps(node, seed):
    """Give a Color Ramp, or a curve, some points."""
    chosen = random.Random(seed)
    if node.bl_idname == 'ShaderNodeValToRGB':
        for place in (0.3, 0.55, 0.56):
            node.color_ramp.elements.new(place)
        for element in node.color_ramp.elements:
            element.color = [chosen.uniform(0, 1) for _ in range(4)]
        node.color_ramp.elements[0].position, node.color_ramp.elements[-1].position = 0.1, 0.9
    elif hasattr(node, "mapping"):
        for curve in node.mapping.curves:
            for place in (0.25, 0.6):
                curve.points.new(place, chosen.uniform(0, 1))
            if seed % 2:
                curve.points[0].location = -0.3 if node.bl_idname != 'ShaderNodeVectorCurve' else -1.2, 0.2
            curve.points[1].handle_type = chosen.choice(['AUTO', 'VECTOR', 'AUTO_CLAMPED'])
        node.mapping.extend = chosen.choice(['HORIZONTAL', 'EXTRAPOLATED'])
        node.mapping.use_clip = chosen.random() < 0.5
        node.mapping.update()


def _one(name, chosen, output, how, seed):
    """Return the function of a tree that makes one case."""
    def made(tree):
        node = tree.tree.nodes.new(f"ShaderNode{name}")
        for key, value in chosen.items():
            setattr(node, key, value)
        ramps(node, seed)
        if name == "ValToRGB":
            node.color_ramp.color_mode = ('RGB', 'HSV', 'HSL')[seed % 3]
            node.color_ramp.interpolation = ('LINEAR', 'CONSTANT', 'EASE', 'CARDINAL', 'B_SPLINE')[seed // 3 % 5]
            node.color_ramp.hue_interpolation = ('NEAR', 'FAR', 'CW', 'CCW')[seed // 15 % 4]
        feed(tree, node, how, seed)
        if name == "NormalMap":
            node.uv_map = "UVMap"
        return [s for s in node.outputs if not s.is_unavailable][output]
    return made


def cases(most=60, names=None):
    """[(what it is, function of a tree that returns the socket to be shown)], for all nodes of this bpy, or these."""
    scratch = bpy.data.materials.new("scratch")
    if bpy.app.version < (5, 0):
        scratch.use_nodes = True
    nodes, found = scratch.node_tree.nodes, []
    for name in names or VALUES:
        if not hasattr(bpy.types, f"ShaderNode{name}"):
            continue
        node = nodes.new(f"ShaderNode{name}")
        several = combined(choices(node), most) if name != "ValToRGB" else [{}] * 60
        for n, chosen in enumerate(several):
            try:
                for key, value in chosen.items():
                    setattr(node, key, value)
            except TypeError:  # a choice of other kinds of trees
                continue
            for output, socket in enumerate([s for s in node.outputs if not s.is_unavailable]):
                for how in {"TexWhiteNoise": ('whole',)}.get(name, (
                        ('slopes', 'whole', 'constants') if name in ("Math", "VectorMath", "Clamp", "MapRange") else
                        ('slopes', 'some')[n % 2:n % 2 + 1])):
                    label = f"{name} {' '.join(map(str, chosen.values()))} {socket.name} {how} {n}"
                    found.append((label, _one(name, chosen, output, how, n)))
        nodes.remove(node)
    bpy.data.materials.remove(scratch)
    return found


def painted(name, width, height, as_floats, alpha_mode, space):
    """Return a packed image of smooth colours, with an alpha that goes from 0.2 to 1."""
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=as_floats)
    chosen, pixels = random.Random(width), []
    for y in range(height):
        for x in range(width):
            pixels += [chosen.uniform(0.1, 0.9) for _ in range(3)] + [0.2 + 0.8 * (x + y) / (width + height - 2)]
    image.colorspace_settings.name, image.alpha_mode = space, alpha_mode  # which empties a painted image
    image.pixels.foreach_set(pixels)
    image.pack()
    assert len(set(image.pixels[:])) > width, "it is empty"
    return image


def images():
    """Cases of images: each extension with each interpolation and each projection, each of the image's own choices."""
    found = []
    for n, (extension, interpolation, projection) in enumerate(itertools.product(
            ('REPEAT', 'EXTEND', 'CLIP', 'MIRROR'), ('Linear', 'Closest', 'Cubic', 'Smart'),
            ('FLAT', 'BOX', 'SPHERE', 'TUBE'))):
        space = ("sRGB", "Non-Color", "Linear Rec.709")[n % 3]
        alpha = ('STRAIGHT', 'PREMUL', 'CHANNEL_PACKED', 'NONE')[n // 3 % 4]
        kind = {"extension": extension, "interpolation": interpolation, "projection": projection}

        def made(tree, kind=kind, n=n, space=space, alpha=alpha):
            as_floats = n % 5 == 0 and space != "sRGB"
            image = painted(f"Painted {n}", 5, 4, as_floats, alpha, space)
            parts = [slope(tree, -0.4, 1.3, n + j, False) for j in range(3)]
            place = tree.node('ShaderNodeCombineXYZ', dict(enumerate(parts))).outputs[0]
            node = tree.node('ShaderNodeTexImage', {"Vector": place}, image=image, **kind)
            node.projection_blend = (0.0, 0.4)[n % 2]
            return node.outputs[n % 7 == 3]
        found.append((f"image {' '.join(kind.values())} {space} {alpha} {n}", made))
    for n, (projection, interpolation) in enumerate(itertools.product(
            ('EQUIRECTANGULAR', 'MIRROR_BALL'), ('Linear', 'Closest', 'Cubic', 'Smart'))):
        def around(tree, n=n, projection=projection, interpolation=interpolation):
            parts = [slope(tree, -1.0, 1.1, n + j, False) for j in range(3)]
            place = tree.node('ShaderNodeCombineXYZ', dict(enumerate(parts))).outputs[0]
            image = painted(f"Sky {n}", 8, 4, n % 2 == 0, 'STRAIGHT', "Linear Rec.709")
            return tree.node('ShaderNodeTexEnvironment', {"Vector": place}, image=image, projection=projection,
                             interpolation=interpolation).outputs[0]
        found.append((f"environment {projection} {interpolation}", around))
    return found


# Attributes by their types, and what else is no attribute; outputs that one sheet cannot compare are left out.
ATTRIBUTES = [('GEOMETRY', "UVMap"), ('GEOMETRY', "Weights"), ('GEOMETRY', "Paint"), ('GEOMETRY', "none"),
              ('OBJECT', "color"), ('OBJECT', "location"), ('OBJECT', "own"), ('VIEW_LAYER', "own"), ('OBJECT', "none")]


def inputs():
    """Cases of nodes that say where on which surface a point is, and what is there."""
    found = []

    def add(name, output, **properties):
        found.append((f"{name} {output} {properties}",
                      lambda tree: tree.node(f"ShaderNode{name}", **properties).outputs[output]))
    for output in ("Generated", "Normal", "UV", "Object", "Camera", "Window", "Reflection"):
        add("TexCoord", output)
    for output in ("Position", "Normal", "Tangent", "True Normal", "Incoming", "Parametric", "Backfacing"):
        add("NewGeometry", output)
    for name, outputs in (("CameraData", ("View Vector", "View Z Depth", "View Distance")),
                          ("ObjectInfo", ("Location", "Color", "Alpha", "Object Index", "Material Index", "Random")),
                          ("LightPath", ("Is Camera Ray", "Is Shadow Ray", "Is Diffuse Ray", "Is Glossy Ray",
                                         "Is Singular Ray", "Is Reflection Ray", "Is Transmission Ray", "Ray Depth",
                                         "Transparent Depth"))):
        for output in outputs:
            add(name, output)
    add("UVMap", 0)
    add("UVMap", 0, uv_map="UVMap")
    add("UVMap", 0, uv_map="none")
    for axis in 'XYZ':
        add("Tangent", 0, direction_type='RADIAL', axis=axis)
    add("Tangent", 0, direction_type='UV_MAP')
    add("Tangent", 0, direction_type='UV_MAP', uv_map="UVMap")
    for output in (0, 1):
        add("VertexColor", output)
        add("VertexColor", output, layer_name="Paint")
        add("VertexColor", output, layer_name="none")
    for kind, name in ATTRIBUTES:
        for output in range(4):
            add("Attribute", output, attribute_type=kind, attribute_name=name)
    return found


def muted():
    """Cases of muted nodes, which hand on what feeds an input of theirs."""
    found = []
    for name in VALUES:
        if not hasattr(bpy.types, f"ShaderNode{name}"):
            continue
        def made(tree, name=name):
            node = tree.tree.nodes.new(f"ShaderNode{name}")
            feed(tree, node, 'slopes', 5)
            node.mute = True
            last = [s for s in node.outputs if not s.is_unavailable][-1]
            return tree.node('ShaderNodeVectorMath', {0: (0.7, 0.5, 0.3), 1: last}).outputs[0]
        found.append((f"muted {name}", made))
    return found


GAIN, MIDDLE = 0.12, 0.5  # what is shown of a value that is held between −4 and 4


def sheet(scene, cases, cell):
    """Show cases side by side, by light of GAIN·value + MIDDLE, on planes that have attributes; returns how many
    columns.
    """
    trees = []
    for _, made in cases:
        tree = Tree()
        socket = made(tree)
        for operation, bound in (('MAXIMUM', -4.0), ('MINIMUM', 4.0)):
            socket = tree.node('ShaderNodeVectorMath', {0: socket, 1: (bound,) * 3}, operation=operation).outputs[0]
        trees.append((tree, tree.node('ShaderNodeVectorMath', {0: socket, "Scale": GAIN / 0.2}, operation='SCALE'
                                      ).outputs[0]))
    columns = node_trees.sheet(scene, trees, cell)
    for ob in scene.objects:
        if ob.type == 'MESH':
            weights = ob.data.attributes.new("Weights", 'FLOAT', 'POINT')
            weights.data.foreach_set("value", (.1, .5, .9, .3))
            paint = ob.data.color_attributes.new("Paint", 'FLOAT_COLOR', 'CORNER')
            paint.data.foreach_set("color", (.1, .5, .9, 1, .8, .2, .3, .5, .6, .6, .1, .9, .2, .9, .4, .2))
            ob["own"] = 0.7
    scene["own"] = 0.4
    return columns


SHEETS = {"values": cases, "images": images, "inputs": inputs, "muted": muted}
