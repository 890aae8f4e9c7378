"""Worlds beside Cycles: what the camera sees of them, pixel by pixel."""

import math

import bpy
import numpy as np
import pytest
from node_pictures import agree, both
from node_trees import World, exact

pytestmark = pytest.mark.slow
VIEWS = [(2.1, 0.0, 3.6), (0.7, 0.3, 0.3)]  # turns of the camera: up, and down


@pytest.fixture
def wide(scene):
    """A scene whose camera sees much of the world, from somewhere."""
    scene.camera.data.angle = 2.0
    scene.camera.location = (3.0, -2.0, 5.0)
    scene.render.resolution_x = scene.render.resolution_y = 64
    exact(scene)
    return scene


def compare(scene, render, views=VIEWS, **bounds):
    scene.world.cycles.sampling_method = 'NONE'  # nothing is lit, and Cycles need not know from where
    for turn in views:
        scene.camera.rotation_euler = turn
        ours, theirs = both(scene, render)
        assert theirs.max() > 0.01
        agree(ours, theirs, **bounds)


def painted(width=64, height=32, name="sky", space='sRGB', is_float=False):
    """An image without edges: what differs from texel to texel is small."""
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=is_float)
    x, y = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    red = 0.5 + 0.3 * np.sin(2 * math.pi * x) * np.sin(math.pi * y)
    green = 0.2 + 0.6 * y + 0.1 * np.cos(6 * math.pi * x) * np.sin(math.pi * y)
    blue = 0.4 + 0.3 * np.cos(2 * math.pi * (x - 0.3)) * np.sin(math.pi * y)
    pixels = np.stack([red, green, blue, np.ones_like(x)], 2).astype(np.float32)
    if is_float:
        pixels[..., :3] = 8 * pixels[..., :3] ** 4
    image.colorspace_settings.name = space
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image


@pytest.mark.parametrize("projection", ['EQUIRECTANGULAR', 'MIRROR_BALL'])
@pytest.mark.parametrize("kind", ["bytes", "floats", "data", "closest"])
def test_images_of_all_directions(wide, render, projection, kind):
    tree = World(wide)
    space = {"data": 'Non-Color', "floats": 'Linear Rec.709'}.get(kind, 'sRGB')
    image = painted(is_float=kind == "floats", space=space)
    place = tree.node('ShaderNodeTexCoord').outputs["Generated"]
    turned = tree.node('ShaderNodeMapping', {"Vector": place, "Rotation": (0.2, 0.4, 1.1)}).outputs[0]
    node = tree.node('ShaderNodeTexEnvironment', {0: turned}, image=image, projection=projection,
                     interpolation='Closest' if kind == "closest" else 'Linear')
    tree.shine(tree.background(node.outputs[0], 0.7))
    compare(wide, render)


COORDINATES = ["Generated", "Normal", "UV", "Object", "Camera", "Window", "Reflection"]


@pytest.mark.parametrize("output", COORDINATES)
def test_texture_coordinates(wide, render, output):
    tree = World(wide)
    place = tree.node('ShaderNodeTexCoord').outputs[output]
    shown = tree.node('ShaderNodeVectorMath', {0: place, 1: (0.2, 0.2, 0.2), 2: (0.5, 0.5, 0.5)},
                      operation='MULTIPLY_ADD').outputs[0]
    tree.shine(tree.background(shown))
    compare(wide, render)


@pytest.mark.parametrize("output", ["Position", "Normal", "True Normal", "Incoming", "Backfacing", "Parametric"])
def test_geometry(wide, render, output):
    tree = World(wide)
    place = tree.node('ShaderNodeNewGeometry').outputs[output]
    shown = tree.node('ShaderNodeVectorMath', {0: place, 1: (0.2, 0.2, 0.2), 2: (0.5, 0.5, 0.5)},
                      operation='MULTIPLY_ADD').outputs[0]
    tree.shine(tree.background(shown))
    compare(wide, render)


def test_what_only_surfaces_have_and_places_for_cameras(wide, render):
    """Attributes of the view layer, the alpha of one that is not there, the depth of rays; and the camera looks at a
    direction as at a place, as Cycles has it.
    """
    tree = World(wide)
    wide["glow"] = 0.7
    glow = tree.node('ShaderNodeAttribute', attribute_type='VIEW_LAYER', attribute_name="glow").outputs["Vector"]
    alpha = tree.node('ShaderNodeAttribute', attribute_name="nothing").outputs["Alpha"]
    depth = tree.node('ShaderNodeLightPath').outputs["Ray Depth"]
    data = tree.node('ShaderNodeCameraData').outputs
    place = tree.node('ShaderNodeVectorTransform', {0: tree.node('ShaderNodeNewGeometry').outputs["Position"]},
                      vector_type='POINT', convert_from='WORLD', convert_to='CAMERA').outputs[0]
    numbers = tree.node('ShaderNodeCombineXYZ', {0: alpha, 1: depth, 2: data["View Distance"]}).outputs[0]
    found = glow
    for more, factor in (numbers, 0.1), (data["View Vector"], 0.5), (place, 0.05):
        found = tree.node('ShaderNodeVectorMath', {0: more, 1: (factor,) * 3, 2: found},
                          operation='MULTIPLY_ADD').outputs[0]
    tree.shine(tree.background(found))
    compare(wide, render)


TEXTURES = [('ShaderNodeTexGradient', {}), ('ShaderNodeTexNoise', {}), ('ShaderNodeTexVoronoi', {}),
            ('ShaderNodeTexMagic', {}), ('ShaderNodeTexWave', {}), ('ShaderNodeTexEnvironment', {})]


@pytest.mark.parametrize(("idname", "properties"), TEXTURES)
def test_textures_without_a_place(wide, render, idname, properties):
    tree = World(wide)
    node = tree.node(idname, **properties)
    if hasattr(node, "image"):
        node.image = painted()
    elif "Scale" in node.inputs:
        node.inputs["Scale"].default_value = 0.5 if idname in ('ShaderNodeTexMagic', 'ShaderNodeTexWave') else 2.0
    tree.shine(tree.background(node.outputs["Color"], 2.0))
    compare(wide, render)


def test_a_gradient_by_height_through_a_ramp_in_a_group(wide, render):
    tree = World(wide)
    group = bpy.data.node_groups.new("Sky", 'ShaderNodeTree')
    group.interface.new_socket("Place", in_out='INPUT', socket_type='NodeSocketVector')
    group.interface.new_socket("Color", in_out='OUTPUT', socket_type='NodeSocketColor')
    first, last = group.nodes.new('NodeGroupInput'), group.nodes.new('NodeGroupOutput')
    apart, ramp = group.nodes.new('ShaderNodeSeparateXYZ'), group.nodes.new('ShaderNodeValToRGB')
    ramp.color_ramp.elements[0].color = (0.9, 0.5, 0.2, 1)
    ramp.color_ramp.elements[1].color = (0.1, 0.3, 0.9, 1)
    for a, b in ((first.outputs[0], apart.inputs[0]), (apart.outputs[2], ramp.inputs[0]),
                 (ramp.outputs[0], last.inputs[0])):
        group.links.new(a, b)
    node = tree.node('ShaderNodeGroup', node_tree=group)
    tree.tree.links.new(tree.node('ShaderNodeTexCoord').outputs["Generated"], node.inputs[0])
    tree.shine(tree.background(node.outputs[0]))
    compare(wide, render)


def test_backgrounds_that_are_mixed_added_and_muted(wide, render):
    tree = World(wide)
    x, y, z = tree.separate(tree.node('ShaderNodeTexCoord').outputs["Generated"])
    height = tree.node('ShaderNodeMath', {0: z}, operation='ABSOLUTE').outputs[0]
    first, second = tree.background((0.2, 0.5, 0.9, 1), 1.5), tree.background((0.9, 0.4, 0.1, 1), height)
    mixed = tree.node('ShaderNodeMixShader', {0: x, 1: first, 2: second}).outputs[0]
    glow = tree.node('ShaderNodeEmission', {"Color": (0.1, 0.2, 0.1, 1), "Strength": 0.5}).outputs[0]
    added = tree.node('ShaderNodeAddShader', {0: mixed, 1: glow}).outputs[0]
    muted = tree.node('ShaderNodeMixShader', {0: y, 1: added, 2: glow})
    muted.mute = True
    tree.shine(muted.outputs[0])
    compare(wide, render)


def test_the_camera_sees_another_background_than_mirrors(wide, render, add_mesh):
    """A ball's worth of mirror below, with a background of its own; and what is seen through clear glass."""
    tree = World(wide)
    path = tree.node('ShaderNodeLightPath').outputs
    x, y, z = tree.separate(tree.node('ShaderNodeTexCoord').outputs["Generated"])
    place = tree.node('ShaderNodeCombineXYZ', {0: x, 1: y, 2: z}).outputs[0]
    shown = tree.node('ShaderNodeVectorMath', {0: place, 1: (0.2, 0.2, 0.2), 2: (0.5, 0.5, 0.5)},
                      operation='MULTIPLY_ADD').outputs[0]
    mixed = tree.node('ShaderNodeMixShader', {0: path["Is Camera Ray"], 1: tree.background(shown),
                                              2: tree.background((0.1, 0.6, 0.2, 1))}).outputs[0]
    tree.shine(mixed)
    corners = [(x * 20, y * 20, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    floor = add_mesh("Mirror", corners, [(0, 1, 2, 3)])
    material = bpy.data.materials.new("Mirror")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    output = material.node_tree.nodes.new('ShaderNodeOutputMaterial')
    glossy = material.node_tree.nodes.new('ShaderNodeBsdfAnisotropic')
    glossy.inputs["Roughness"].default_value, glossy.inputs["Color"].default_value = 0.0, (1, 1, 1, 1)
    material.node_tree.links.new(glossy.outputs[0], output.inputs["Surface"])
    floor.data.materials.append(material)
    wide.light_meshes.ambient = 0.0
    compare(wide, render, views=[(1.2, 0.0, 0.3)])


@pytest.mark.parametrize("kind", ["camera", "glossy", "diffuse"])
def test_a_world_that_some_rays_do_not_see(wide, render, kind):
    tree = World(wide)
    tree.shine(tree.background(tree.node('ShaderNodeTexCoord').outputs["Generated"]))
    setattr(wide.world.cycles_visibility, kind, False)
    ours, theirs = both(wide, render)
    assert (theirs.max() > 0) == (kind != "camera")
    np.testing.assert_allclose(ours, np.maximum(theirs, 0), atol=5e-3)  # no light is negative here


MODELS = [kind.identifier for kind in bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items
          if kind.identifier != 'HOSEK_WILKIE']


@pytest.mark.parametrize("elevation", [0.02, 0.3, 1.1])
@pytest.mark.parametrize("model", MODELS)
def test_skies(wide, render, model, elevation):
    """Above the horizon; the sun is in the picture."""
    tree = World(wide)
    node = tree.node('ShaderNodeTexSky', sky_type=model)
    if model == 'PREETHAM':
        node.sun_direction, node.turbidity = (0.6, 0.8 * math.cos(elevation), 0.8 * math.sin(elevation)), 3.0
    else:
        node.sun_elevation, node.sun_rotation, node.sun_size, node.altitude = elevation, 0.9, 0.1, 300.0
        node.ozone_density, node.air_density, node.sun_intensity = 2.0, 1.3, 0.1
        setattr(node, "aerosol_density" if hasattr(node, "aerosol_density") else "dust_density", 1.5)
    tree.shine(tree.background(node.outputs[0]))
    wide.camera.data.angle = 1.2
    compare(wide, render, views=[(math.pi / 2 + 0.65, 0.0, -0.9)])


def test_a_sky_that_cannot_be_had_is_named(wide, snapshot):
    tree = World(wide)
    node = tree.node('ShaderNodeTexSky', sky_type='HOSEK_WILKIE')
    tree.shine(tree.background(node.outputs[0]))
    found = snapshot(wide)
    assert any("sky type Hosek" in w and "Preetham" in w for w in found.warnings)
    assert [o.arguments[0] for o in found.world.operations if o.name == "sky"] == [2.0]
