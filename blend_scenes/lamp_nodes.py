"""Lamps with nodes, by this engine and by Cycles: `python blend_scenes/lamp_nodes.py FOLDER`.

From left to right: a spot that projects a pattern of cells, a lamp behind an IES profile, a narrow area lamp with an
image on its face. Both pictures have direct light only. They become docs/pictures/lamp-nodes.jpg (see pictures.py).
"""

import sys
from math import radians

import bpy
import numpy as np
from parts import add, by_both_engines, camera, clean_scene, light, mesh, principled, world

# A luminaire that shines down in a cone and to four sides, in candela by vertical and horizontal angles.
IES = """IESNA:LM-63-2002
[TEST] none
TILT=NONE
1 1000 1 10 3 1 2 0 0 0
1 1 40
0 10 20 30 40 50 60 70 90 180
0 45 90
900 900 700 300 150 700 800 200 20 0
900 900 700 300 100 80 60 40 20 0
900 900 700 300 150 700 800 200 20 0
"""


def nodes_of(lamp):
    """Let a lamp use nodes; returns its tree and its Emission."""
    lamp.data.use_nodes = True
    return lamp.data.node_tree, lamp.data.node_tree.nodes["Emission"]


def gobo(lamp):
    """Cells, as large as the cone, with a tint of their own."""
    tree, emission = nodes_of(lamp)
    place, cells = tree.nodes.new('ShaderNodeNewGeometry'), tree.nodes.new('ShaderNodeTexVoronoi')
    cells.inputs["Scale"].default_value = 7.0
    edge = tree.nodes.new('ShaderNodeMath')
    edge.operation, edge.inputs[1].default_value = 'LESS_THAN', 0.42
    tree.links.new(place.outputs["Parametric"], cells.inputs["Vector"])
    tree.links.new(cells.outputs["Distance"], edge.inputs[0])
    tree.links.new(cells.outputs["Color"], emission.inputs["Color"])
    tree.links.new(edge.outputs[0], emission.inputs["Strength"])


def profile(lamp):
    """An IES profile in the light of a candle."""
    tree, emission = nodes_of(lamp)
    node, glow = tree.nodes.new('ShaderNodeTexIES'), tree.nodes.new('ShaderNodeBlackbody')
    node.ies = bpy.data.texts.new("lamp.ies")
    node.ies.write(IES)
    glow.inputs["Temperature"].default_value = 3000.0
    tree.links.new(node.outputs[0], emission.inputs["Strength"])
    tree.links.new(glow.outputs[0], emission.inputs["Color"])


def window(lamp):
    """A window with bars."""
    tree, emission = nodes_of(lamp)
    image = bpy.data.images.new("window", 64, 64)
    y, x = np.mgrid[0:64, 0:64]
    pixels = np.ones((64, 64, 4), np.float32)
    pixels[..., :3] = np.where((x % 21 > 2) & (y % 31 > 2), 1.0, 0.02)[..., None] * [0.7, 0.85, 1.0]
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    node = tree.nodes.new('ShaderNodeTexImage')
    node.image = image
    tree.links.new(node.outputs["Color"], emission.inputs["Color"])


def make():
    """Build the scene."""
    clean_scene(900, 340)
    grey = principled("Grey", (0.6, 0.6, 0.6), Roughness=1.0)
    floor = mesh("Floor", [(-8, -8, 0), (8, -8, 0), (8, 2, 0), (-8, 2, 0)], [(0, 1, 2, 3)], grey)
    wall = mesh("Wall", [(-8, 2, 0), (8, 2, 0), (8, 2, 6), (-8, 2, 6)], [(0, 1, 2, 3)], grey)
    post = mesh("Post", [(x, y, z) for z in (0, 1) for x, y in ((-.2, -.2), (.2, -.2), (.2, .2), (-.2, .2))],
                [(4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)], grey)
    add("Floor", floor)
    add("Wall", wall)
    for x in (-4.2, 0.0, 4.2):
        add("Post", post, (x, 0.3, 0))
    of_spot = light("Spot", 'SPOT', 900, (-4.2, -2.5, 4.0), shadow_soft_size=0.01, spot_size=0.9, spot_blend=0.1)
    of_spot.rotation_euler = (radians(40), 0, 0)
    gobo(of_spot)
    profile(light("Luminaire", 'POINT', 8, (0.0, 0.8, 2.6), shadow_soft_size=0.02))
    of_face = light("Window", 'AREA', 500, (4.2, -2.5, 3.5), size=1.6, spread=0.12)
    of_face.rotation_euler = (radians(50), 0, 0)
    window(of_face)
    camera((0, -12, 4), (0, 0, 1.2), radians(50))
    world((0, 0, 0))
    scene = bpy.context.scene
    scene.view_settings.view_transform = 'Standard'
    return scene


if __name__ == "__main__":
    by_both_engines(make, sys.argv[1], 256)
