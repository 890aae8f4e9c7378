"""Translucent surfaces and rough matt ones beside Cycles, in the light of lamps on either side."""

import pytest
from node_pictures import agree, both

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("height", [4.0, -4.0], ids=["in front", "behind"])
def test_light_comes_through_scattered(plane, scene, render, node_material, add_light, add_plane, height):
    """A leaf, half matt and half translucent, with a lamp on either side, and a post that throws a shadow on it."""
    leaf = node_material("Leaf", 'ShaderNodeBsdfTranslucent', Color=(0.3, 0.7, 0.2, 1))
    tree = leaf.node_tree
    mix = tree.nodes.new('ShaderNodeMixShader')
    matt = tree.nodes.new('ShaderNodeBsdfDiffuse')
    output = next(n for n in tree.nodes if n.bl_idname == 'ShaderNodeOutputMaterial')
    tree.links.new(tree.nodes["Translucent BSDF"].outputs[0], mix.inputs[1])
    tree.links.new(matt.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    plane.data.materials.append(leaf)
    post = add_plane(0.2, name="Post", location=(0.3, 0.2, height / 4))
    post.data.materials.append(node_material("Post", 'ShaderNodeBsdfDiffuse'))
    lamp = add_light('POINT', location=(0.5, 0.3, height), energy=500, shadow_soft_size=0)
    lamp.data.light_meshes.softness = 'SCENE'
    scene.light_meshes.shadows = 'SHARP'
    scene.cycles.max_bounces = 0
    ours, theirs = both(scene, render)
    assert theirs.max() > 0.1
    agree(ours, theirs)
