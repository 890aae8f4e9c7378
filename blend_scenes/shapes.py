"""Things under a square lamp and a bulb, by this engine and by Cycles: `python blend_scenes/shapes.py FOLDER`.

Both engines have their defaults, but direct light only; Cycles has 256 samples and no denoiser. The pictures become
docs/pictures/shapes.jpg (see pictures.py).
"""

import sys
from math import radians

import bpy
from parts import add, box, by_both_engines, camera, clean_scene, light, mesh, principled, world


def ball(name, radius, material):
    """Return a smooth mesh of a ball."""
    import bmesh  # which is there only once bpy is

    made, data = bmesh.new(), bpy.data.meshes.new(name)
    bmesh.ops.create_uvsphere(made, u_segments=48, v_segments=24, radius=radius)
    made.to_mesh(data)
    made.free()
    for polygon in data.polygons:
        polygon.use_smooth = True
    data.materials.append(material)
    return data


def make():
    """Build the scene."""
    clean_scene(800, 420)
    grey = principled("Grey", Roughness=0.5)
    add("Floor", mesh("Floor", [(-6, -6, 0), (6, -6, 0), (6, 6, 0), (-6, 6, 0)], [(0, 1, 2, 3)], grey))
    add("Box", box("Box", (-0.5, -0.5, 0), (0.5, 0.5, 1), grey), (-1.2, 0, 0), (0, 0, 0.5))
    add("Ball", ball("Ball", 0.5, grey), (0.3, -0.3, 0.5))
    add("Post", box("Post", (-0.02, -0.02, 0), (0.02, 0.02, 1.6), grey), (1.3, 0.2, 0))
    add("Board", box("Board", (-0.025, -0.5, -0.65), (0.025, 0.5, 0.65), grey), (1.9, 0.5, 0.55), (0, 0.6, 0))
    for lamp in (light("Softbox", 'AREA', 150, (2, -2, 3.2), (0.3, -0.1, 0.3), size=1.0),
                 light("Bulb", 'POINT', 80, (-2.5, -1.5, 2), color=(1, 0.7, 0.4), shadow_soft_size=0.15)):
        lamp.data.light_meshes.softness = 'SIZE'  # the default of a new lamp, which parts.py's have not
    camera((0.3, -6, 2.4), (0.3, 0, 0.4), radians(46))
    world((0, 0, 0))
    scene = bpy.context.scene
    scene.view_settings.view_transform = 'Standard'
    return scene


if __name__ == "__main__":
    by_both_engines(make, sys.argv[1], 256)
