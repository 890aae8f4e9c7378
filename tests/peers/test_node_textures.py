"""Texture nodes beside Cycles: the same pattern, pixel by pixel."""

import pytest
from node_pictures import check, painted
from node_trees import Tree

pytestmark = pytest.mark.slow


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
