"""Four balls with procedural materials, by this engine and by Cycles: `python blend_scenes/materials.py FOLDER`.

The nodes of the materials are linked as in Blender's node editor. Both pictures have direct light only. They become
docs/pictures/materials.jpg (see pictures.py).
"""

import sys
from math import radians

import bpy
from parts import add, by_both_engines, camera, clean_scene, light, mesh, principled, world

BALLS = 64, 32  # segments and rings


def linked(material, node, output, socket="Base Color"):
    """Link an output of a node to the material's Principled BSDF."""
    material.node_tree.links.new(node.outputs[output], material.node_tree.nodes["Principled BSDF"].inputs[socket])


def placed(material, idname, coordinates="Generated", **inputs):
    """Add a texture node with these inputs, placed by Texture Coordinate."""
    tree = material.node_tree
    node, place = tree.nodes.new(idname), tree.nodes.new('ShaderNodeTexCoord')
    tree.links.new(place.outputs[coordinates], node.inputs["Vector"])
    for name, value in inputs.items():
        node.inputs[name].default_value = value
    return node


def clouds():
    material = principled("Clouds", Roughness=0.5)
    noise = placed(material, 'ShaderNodeTexNoise', Scale=6.0)
    ramp = material.node_tree.nodes.new('ShaderNodeValToRGB')
    for element, position, color in zip(ramp.color_ramp.elements, (0.4, 0.6), ((0.05, 0.1, 0.4, 1), (0.9, 0.7, 0.3, 1)),
                                        strict=True):
        element.position, element.color = position, color
    material.node_tree.links.new(noise.outputs[0], ramp.inputs[0])
    linked(material, ramp, "Color")
    return material


def bricks():
    material = principled("Bricks", Roughness=0.8)
    linked(material, placed(material, 'ShaderNodeTexBrick', Scale=4.0), "Color")
    return material


def stripes():
    material = principled("Stripes", Roughness=0.5)
    wave = placed(material, 'ShaderNodeTexWave', Scale=2.0, Distortion=4.0)
    hue = material.node_tree.nodes.new('ShaderNodeHueSaturation')
    hue.inputs["Color"].default_value = (0.8, 0.2, 0.1, 1)
    material.node_tree.links.new(wave.outputs[1], hue.inputs["Value"])
    linked(material, hue, 0)
    return material


def bumps():
    material = principled("Bumps", (0.3, 0.5, 0.25), Roughness=0.35)
    cells = placed(material, 'ShaderNodeTexVoronoi', Scale=9.0)
    bump = material.node_tree.nodes.new('ShaderNodeBump')
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 0.6, 0.1
    material.node_tree.links.new(cells.outputs["Distance"], bump.inputs["Height"])
    linked(material, bump, 0, "Normal")
    return material


def make():
    """Build the scene."""
    import bmesh

    clean_scene(900, 340)
    for i, material in enumerate((clouds(), bricks(), stripes(), bumps())):
        ball = bmesh.new()
        bmesh.ops.create_uvsphere(ball, u_segments=BALLS[0], v_segments=BALLS[1], radius=0.9)
        data = bpy.data.meshes.new(material.name)
        ball.to_mesh(data)
        ball.free()
        for polygon in data.polygons:
            polygon.use_smooth = True
        data.materials.append(material)
        add(material.name, data, (2 * i - 3, 0, 0.9))
    floor = principled("Floor", Roughness=1.0)
    linked(floor, placed(floor, 'ShaderNodeTexChecker', "Object", Scale=1.0, Color1=(0.6, 0.6, 0.6, 1),
                         Color2=(0.3, 0.3, 0.35, 1)), "Color")
    add("Floor", mesh("Floor", [(-8, -8, 0), (8, -8, 0), (8, 8, 0), (-8, 8, 0)], [(0, 1, 2, 3)], floor))
    light("Lamp", 'POINT', 1200, (3, -4, 6), shadow_soft_size=0.3)
    camera((0, -10, 3.4), (0, 0, 0.9), radians(48))
    world((0, 0, 0))
    scene = bpy.context.scene
    scene.view_settings.view_transform = 'Standard'
    return scene


if __name__ == "__main__":
    by_both_engines(make, sys.argv[1], 128)
