"""Lamps' nodes beside Cycles: a matt plane under one lamp."""


import bpy
import numpy as np
import pytest
from node_pictures import agree, both
from node_pictures import painted as painted_in_srgb
from node_trees import LampTree, Tree, lamp_sheet, outputs_of_lamps

pytestmark = pytest.mark.slow

# One of each type, over the plane and aslant; the last are scaled unevenly.
LAMPS = {
    'POINT': {"location": (0.3, -0.2, 1.5), "rotation": (0.3, 0.2, 0.4)},
    'SPOT': {"location": (0.4, -0.3, 2.5), "rotation": (0.1, 0.15, 0.4), "spot_size": 1.2},
    'SUN': {"rotation": (0.3, 0.2, 0.4)},
    'AREA': {"location": (0.2, -0.1, 1.5), "rotation": (0.2, 0.1, 0.4), "shape": 'RECTANGLE', "size": 1.0,
             "size_y": 0.6},
}


@pytest.fixture
def lamp(plane, scene, add_light):
    """(type, **changes) → the tree of a lamp that lights the plane alone, without a size where it may have none."""
    scene.light_meshes.shadows = 'SHARP'
    scene.cycles.samples, scene.cycles.max_bounces = 1, 0
    plane.scale = (2, 2, 1)
    matt = Tree()
    matt.tree.links.new(matt.node('ShaderNodeBsdfDiffuse').outputs[0],
                        matt.tree.nodes.new('ShaderNodeOutputMaterial').inputs[0])
    plane.data.materials.append(matt.material)
    scene.camera.data.ortho_scale = 3.9

    def make(kind, **changes):
        size = {'SUN': {"angle": 0.0, "energy": 3.0}, 'AREA': {"energy": 30.0}}.get(
            kind, {"shadow_soft_size": 0.0, "energy": 60.0})
        if kind == 'AREA':
            scene.cycles.samples = 256
        ob = add_light(kind, **(LAMPS[kind] | size | changes))
        ob.data.light_meshes.softness = 'SIZE'
        return LampTree(ob.data)
    return make


def painted(width, height):
    """An image of plain numbers: between texels Cycles interpolates what the file holds."""
    image = painted_in_srgb(width, height)
    image.colorspace_settings.name = 'Non-Color'
    return image


def check(scene, render, **bounds):
    ours, theirs = both(scene, render)
    assert theirs.max() > 0.02
    agree(ours, theirs, **bounds)


def shown(tree, socket):
    """A vector as a colour that is light."""
    return tree.node('ShaderNodeVectorMath', {0: socket, 1: (0.1, 0.1, 0.1), 2: (0.5, 0.5, 0.5)},
                     operation='MULTIPLY_ADD').outputs[0]


@pytest.mark.parametrize("kind", ['POINT', 'SPOT', 'AREA', 'SUN'])
def test_what_lamps_are_asked(scene, render, kind):
    cells = lamp_sheet(scene, outputs_of_lamps([kind]))
    for ob in scene.objects:
        ob.color, ob.pass_index = (0.2, 0.5, 0.8, 0.9), 2
    scene.cycles.samples = 64 if kind == 'AREA' else 1
    of_each(scene, render, cells)


def of_each(scene, render, cells):
    """Whether each cell of a sheet is as Cycles has it."""
    ours, theirs = both(scene, render)
    for cell in cells:
        assert theirs[cell].max() > 0.02
        agree(ours[cell], theirs[cell])


# Scaled and sheared lamps: what the lamp's own space is.
PLACED = {
    "spot, wide": ('SPOT', {"scale": (1.6, 0.8, 1.0)}),
    "spot, deep": ('SPOT', {"scale": (0.7, 0.7, 1.5)}),
    "spot, mirrored": ('SPOT', {"scale": (-1.0, 1.0, 1.0)}),
    "point, scaled": ('POINT', {"scale": (2.0, 1.0, 0.5)}),
    "area, scaled": ('AREA', {"scale": (1.5, 0.5, 2.0), "location": (0.2, -0.1, 1.2)}),
    "area, ellipse": ('AREA', {"shape": 'ELLIPSE', "size": 1.4, "size_y": 0.7}),
    "area, spread": ('AREA', {"spread": 0.6, "size": 2.0, "size_y": 2.0, "rotation": (0.1, 0.0, 0.3)}),
    "ball": ('POINT', {"shadow_soft_size": 0.05, "use_soft_falloff": False}),
}


@pytest.mark.parametrize("name", PLACED)
def test_scaled_lamps(lamp, scene, render, name):
    kind, changes = PLACED[name]
    tree = lamp(kind, **changes)
    scene.cycles.samples = 256 if kind == 'AREA' or name == "ball" else 1
    place = tree.node('ShaderNodeTexCoord').outputs
    both_ = tree.node('ShaderNodeVectorMath', {0: place["Normal"], 1: place["UV"]}, operation='ADD').outputs[0]
    far = tree.node('ShaderNodeLightFalloff', {"Strength": 0.6}).outputs["Linear"]
    tree.emit(shown(tree, both_), far)
    check(scene, render)


def test_sheared_spot(lamp, scene, render):
    tree = lamp('SPOT', spot_size=2.4)
    ob = next(o for o in scene.objects if o.type == 'LIGHT')
    parent = bpy.data.objects.new("Parent", None)
    scene.collection.objects.link(parent)
    parent.scale, parent.location = (1.5, 1.0, 1.0), (0.0, 0.0, 0.2)
    ob.parent, ob.rotation_euler = parent, (0.2, 0.3, 0.7)
    tree.emit(shown(tree, tree.node('ShaderNodeTexCoord').outputs["UV"]))
    check(scene, render)


@pytest.mark.parametrize("kind", ['SPOT', 'POINT', 'AREA'])
def test_an_image_without_coordinates(lamp, scene, render, kind):
    """The quickest gobo that there is."""
    tree = lamp(kind, **({"spread": 0.3, "size": 2.0, "size_y": 2.0} if kind == 'AREA' else {}))
    image = tree.node('ShaderNodeTexImage', image=painted(6, 6))
    tree.emit(image.outputs["Color"], image.outputs["Alpha"])
    check(scene, render)


def test_a_gobo_by_the_normal(lamp, scene, render):
    """As tutorials do it: the direction divided by its depth, mapped into an image that ends."""
    tree = lamp('SPOT', spot_size=1.6)
    x, y, z = tree.separate(tree.node('ShaderNodeTexCoord').outputs["Normal"])
    sides = [tree.node('ShaderNodeMath', {0: side, 1: z}, operation='DIVIDE').outputs[0] for side in (x, y)]
    flat = tree.node('ShaderNodeCombineXYZ', {0: sides[0], 1: sides[1]}).outputs[0]
    place = tree.node('ShaderNodeMapping', {"Vector": flat, "Location": (0.5, 0.5, 0), "Rotation": (0, 0, 0.3),
                                            "Scale": (1.2, 0.8, 1)}).outputs[0]
    image = tree.node('ShaderNodeTexImage', {0: place}, image=painted(5, 4), extension='CLIP', interpolation='Closest')
    tree.emit(image.outputs["Color"])
    check(scene, render)


def test_a_procedural_gobo(lamp, scene, render):
    tree = lamp('POINT')
    place = tree.node('ShaderNodeTexCoord').outputs["Normal"]
    noise = tree.node('ShaderNodeTexNoise', {"Vector": place, "Scale": 3.0}).outputs[0]
    ramp = tree.node('ShaderNodeValToRGB', {0: noise})
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.3, 0.7
    kelvin = tree.node('ShaderNodeMath', {0: noise, 1: 6000.0, 2: 1500.0}, operation='MULTIPLY_ADD').outputs[0]
    tree.emit(tree.node('ShaderNodeBlackbody', {0: kelvin}).outputs[0], ramp.outputs[0])
    check(scene, render)


def test_shaders_mixed_and_added(lamp, scene, render):
    """Emissions in a group, mixed by the direction, added; a surface's shader gives none; a muted node is passed."""
    tree = lamp('POINT')
    inner = bpy.data.node_groups.new("Glow", 'ShaderNodeTree')
    inner.interface.new_socket("Tint", in_out='INPUT', socket_type='NodeSocketColor')
    inner.interface.new_socket("Shader", in_out='OUTPUT', socket_type='NodeSocketShader')
    start, end = inner.nodes.new('NodeGroupInput'), inner.nodes.new('NodeGroupOutput')
    glow = inner.nodes.new('ShaderNodeEmission')
    inner.links.new(start.outputs[0], glow.inputs[0])
    inner.links.new(glow.outputs[0], end.inputs[0])
    x, y, _ = tree.separate(tree.node('ShaderNodeTexCoord').outputs["Normal"])
    first = tree.node('ShaderNodeGroup', node_tree=inner)
    first.inputs["Tint"].default_value = (0.9, 0.3, 0.2, 1)
    muted = tree.node('ShaderNodeLightFalloff', {"Strength": 9.0})
    muted.mute = True  # without a link before it, so that what it feeds has its own value
    second = tree.node('ShaderNodeEmission', {"Color": (0.1, 0.4, 0.9, 1), "Strength": muted.outputs["Linear"]})
    mix = tree.node('ShaderNodeMixShader', {0: x, 1: first.outputs[0], 2: second.outputs[0]})
    matt = tree.node('ShaderNodeBsdfDiffuse').outputs[0]
    matt = tree.node('ShaderNodeMixShader', {0: 0.5, 1: mix.outputs[0], 2: matt})
    third = tree.node('ShaderNodeEmission', {"Color": (0.2, 0.8, 0.1, 1), "Strength": tree.node(
        'ShaderNodeClamp', {0: y}).outputs[0]})
    tree.shine(tree.node('ShaderNodeAddShader', {0: matt.outputs[0], 1: third.outputs[0]}).outputs[0])
    check(scene, render)


def ies(kind=1, across=(0, 45, 90), up=(0, 30, 60, 90, 120, 180), seed=3, tilt="NONE"):
    """The text of an IES file with values of chance."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(50, 900, (len(across), len(up)))
    values[:, [0, -1]] = values[0, [0, -1]]  # one value at a pole
    rows = [" ".join(f"{c:.2f}" for c in row) for row in values]
    between = "1\n3\n0 45 90\n1 .9 .8\n" if tilt == "INCLUDE" else ""
    return (f"IESNA:LM-63-2002\n[TEST] none\nTILT={tilt}\n{between}1 1000 1.2 {len(up)} {len(across)} {kind} 2 0 0 0\n"
            f"0.9 1.1 40\n{' '.join(map(str, up))}\n{' '.join(map(str, across))}\n" + "\n".join(rows) + "\n")


FILES = {
    "a quarter": {},
    "all around": {"across": (0, 60, 120, 180, 240, 300, 360)},
    "without the last": {"across": (0, 90, 180, 270)},
    "from 90": {"across": (90, 135, 180, 225, 270)},
    "one": {"across": (0,), "tilt": "INCLUDE"},
    "a half, down": {"across": (0, 90, 180), "up": (0, 20, 45, 90)},
    "type B": {"kind": 2, "across": (0, 30, 60, 90), "up": (-90, -40, 0, 45, 90)},
    "type A": {"kind": 3, "across": (-90, -30, 0, 50, 90), "up": (-90, -20, 0, 30, 90)},
    "type A, a half": {"kind": 3, "across": (0, 30, 90), "up": (-90, -20, 0, 30, 90)},
}


def test_ies_files(scene, render, tmp_path):
    def node(name, text, strength=0.1):
        def made(tree):
            node = tree.node('ShaderNodeTexIES', {"Strength": strength})
            if name == "a quarter":
                (tmp_path / "lamp.ies").write_text(text)
                node.mode, node.filepath = 'EXTERNAL', str(tmp_path / "lamp.ies")
            elif text:
                node.ies = bpy.data.texts.new("lamp.ies")
                node.ies.write(text)
            return node.outputs[0]
        return made

    cases = [('POINT', node(name, ies(**how)), (0.8, 0.5, 0.4)) for name, how in FILES.items()]
    cases += [('POINT', node("none", text, 0.03), (0.8, 0.5, 0.4)) for text in ("", "nothing of the kind")]
    of_each(scene, render, lamp_sheet(scene, cases))


def test_ies_on_an_area_lamp(lamp, scene, render):
    tree = lamp('AREA', energy=10.0, location=(0.3, -0.2, 1.0), rotation=(0.4, 0.2, 0.4))
    node = tree.node('ShaderNodeTexIES')
    node.ies = bpy.data.texts.new("lamp.ies")
    node.ies.write(ies(up=(0, 20, 40, 60, 90)))
    tree.emit((1.0, 0.8, 0.6, 1), node.outputs[0])
    check(scene, render)


def stage_spot(tree, gobos, iris, turns=(0.4, -0.7), size=1.6, shares=(0.0, 0.3), closed=0.0):
    """The tree that BlenderDMX 2.2 gives to each of its spots, of which it animates the numbers."""
    def mixed(mode, factor, a, b):
        inputs = {"A": a, "B": b}
        node = tree.node('ShaderNodeMix', data_type='RGBA', blend_type=mode)
        node.inputs[0].default_value = factor
        for name, value in inputs.items():
            socket = next(s for s in node.inputs if s.name == name and not s.is_unavailable)
            if isinstance(value, tuple):
                socket.default_value = value
            else:
                tree.tree.links.new(value, socket)
        return next(s for s in node.outputs if not s.is_unavailable)

    place = tree.node('ShaderNodeNewGeometry').outputs["Parametric"]
    masks = []
    for image, turn, share in zip(gobos, turns, shares, strict=True):
        turned = tree.node('ShaderNodeVectorRotate', {"Vector": place, "Center": (0.5, 0.5, 0), "Angle": turn},
                           rotation_type='Z_AXIS', invert=True).outputs[0]
        texture = tree.node('ShaderNodeTexImage', {0: turned}, image=image).outputs["Color"]
        masks.append(mixed('MIX', share, texture, (1, 1, 1, 1)))
    both_ = mixed('DARKEN', 1.0, *masks)
    centred = tree.node('ShaderNodeVectorMath', {0: tree.node('ShaderNodeNewGeometry').outputs["Parametric"],
                                                 1: (0.5, 0.5, 0)}, operation='SUBTRACT').outputs[0]
    wide = tree.node('ShaderNodeVectorMath', {0: centred, "Scale": size}, operation='SCALE').outputs[0]
    back = tree.node('ShaderNodeVectorMath', {0: wide, 1: (0.5, 0.5, 0)}, operation='ADD').outputs[0]
    opening = tree.node('ShaderNodeTexImage', {0: back}, image=iris, extension='EXTEND').outputs["Color"]
    seen = mixed('DARKEN', 1.0, both_, opening)
    white = tree.node('ShaderNodeRGB')
    white.outputs[0].default_value = (1, 1, 1, 1)
    tree.emit(mixed('MIX', closed, seen, white.outputs[0]))


def iris(size=64):
    """A white disc on black, whose alpha counts for nothing, as in the add-on."""
    image = bpy.data.images.new("iris", size, size, alpha=True)
    x, y = np.meshgrid(*[np.linspace(-1, 1, size)] * 2)
    pixels = np.ones((size, size, 4), np.float32)
    pixels[..., :3] = np.clip((0.98 - np.hypot(x, y)) * size / 4, 0, 1)[..., None]
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    image.colorspace_settings.name, image.alpha_mode = 'Non-Color', 'CHANNEL_PACKED'
    return image


def test_a_stage_spot(lamp, scene, render):
    tree = lamp('SPOT', spot_size=1.0, spot_blend=0.15)
    stage_spot(tree, (painted(8, 8), painted(5, 5)), iris())
    scene.render.resolution_x = scene.render.resolution_y = 128
    check(scene, render)


def test_several_stage_spots(lamp, scene, render):
    """Programs that differ in numbers and images only run as one; Cycles renders one after the other, without noise."""
    images = [painted(8, 8), painted(5, 5), painted(3, 4)]
    opening = iris()
    for i in range(4):
        x, y = (i % 2 - 0.5) * 1.2, (i // 2 - 0.5) * 1.2
        tree = lamp('SPOT', location=(x, y, 2.0), rotation=(0.1 * x, 0.2 * y, i), spot_size=0.9 + 0.04 * i,
                    energy=30.0, color=(1.0 - 0.1 * (i % 3), 0.6 + 0.1 * (i % 4), 0.5))
        stage_spot(tree, (images[i % 3], images[(i + 1) % 3]), opening, (0.2 * i, -0.3 * i), 1.1 + 0.1 * i,
                   (0.05 * i, 0.2), 0.05 * i)
    scene.render.engine = 'LIGHT_MESHES'
    ours = render(scene)["Combined"][..., :3]
    scene.render.engine = 'CYCLES'
    spots = [ob for ob in scene.objects if ob.type == 'LIGHT']
    theirs = np.zeros_like(ours)
    for alone in spots:
        for ob in spots:
            ob.hide_render = ob is not alone
        theirs += render(scene)["Combined"][..., :3]
    assert theirs.max() > 0.02
    agree(ours, theirs)
