"""A room with a window, lit by the sun, the sky and one bounce: `python blend_scenes/window.py FOLDER`.

This engine has its defaults, Cycles 64 samples, one bounce and no denoiser. The pictures become
docs/pictures/window.jpg (see pictures.py).
"""

import sys
from math import radians

import bpy
from parts import add, box, by_both_engines, camera, clean_scene, light, principled, world
from shapes import ball


def make():
    """Build the scene."""
    clean_scene(720, 378, world_light='SKY', bounces=1)
    white, red, blue = (principled(name, color, Roughness=1.0) for name, color in (
        ("White", (0.76, 0.74, 0.7)), ("Red", (0.62, 0.08, 0.06)), ("Blue", (0.15, 0.28, 0.55))))
    wood = principled("Wood", (0.45, 0.28, 0.16), Roughness=1.0)
    for name, low, high, material in (
            ("Floor", (-2.6, -3, -0.1), (2.6, 2.6, 0), wood), ("Ceiling", (-2.6, -3, 2.6), (2.6, 2.6, 2.7), white),
            ("Back", (-2.6, 2.5, 0), (2.6, 2.6, 2.6), white), ("Left", (-2.6, -3, 0), (-2.5, 2.5, 2.6), red),
            ("Front", (-2.6, -3.1, -0.1), (2.6, -3, 2.7), white), ("Below", (2.5, -3, 0), (2.6, 2.5, 0.8), white),
            ("Above", (2.5, -3, 2.2), (2.6, 2.5, 2.6), white), ("Near", (2.5, -3, 0.8), (2.6, -0.8, 2.2), white),
            ("Far", (2.5, 1.6, 0.8), (2.6, 2.5, 2.2), white), ("Bar", (2.52, 0.36, 0.8), (2.58, 0.44, 2.2), white),
            ("Table", (-1.3, 0.6, 0.42), (0.2, 1.5, 0.47), white), ("Cupboard", (0.9, 1.7, 0), (1.7, 2.3, 1.1), blue)):
        add(name, box(name, low, high, material))
    for n, (x, y) in enumerate(((-1.25, 0.65), (0.1, 0.65), (-1.25, 1.4), (0.1, 1.4))):
        add(f"Leg {n}", box(f"Leg {n}", (x, y, 0), (x + 0.05, y + 0.05, 0.42), white))
    add("Ball", ball("Ball", 0.3, blue), (-0.6, 1.0, 0.77))
    sun = light("Sun", 'SUN', 7, (6, -1.5, 4.4), (0, 0.6, 0.2), angle=radians(0.53))
    sun.data.light_meshes.softness = 'SIZE'
    camera((0.4, -2.7, 1.4), (-0.25, 1.3, 0.95), radians(72))
    world((0.35, 0.5, 0.8), 1.5)
    scene = bpy.context.scene
    scene.view_settings.view_transform, scene.view_settings.exposure = 'Standard', 0.6
    return scene


if __name__ == "__main__":
    by_both_engines(make, sys.argv[1], 64)
