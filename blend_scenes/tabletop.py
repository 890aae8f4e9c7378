"""The paper's scene (Fig. 3): a cylinder with a bar sealed into it hangs over a tabletop, under one point light."""

from math import radians

import bpy
from parts import add, box, camera, clean_scene, lathe, light, principled, save, world


def make():
    build()
    save("tabletop")
    # The same, cropped to the end of the bar's shadow (Fig. 6).
    render = bpy.context.scene.render
    render.resolution_x = render.resolution_y = 1400
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = 0.62, 0.90
    render.border_min_y, render.border_max_y = 0.32, 0.50
    save("parameters")


def build():
    clean_scene(1000, 1000, auto_h=False, h=0.05, kI=3.0, weights='UNIFORM', samples=9)
    world((1.0, 0.97, 0.92), 0.12)
    wood = principled("Tabletop", (0.62, 0.5, 0.38), Roughness=1.0, Specular_IOR_Level=0.0)
    stone = principled("Cylinder", (0.52, 0.54, 0.56), Roughness=1.0, Specular_IOR_Level=0.0)
    brass = principled("Bar", (0.72, 0.52, 0.22), Roughness=1.0, Specular_IOR_Level=0.0)
    add("Tabletop", box("Tabletop", (-2, -2, -0.2), (2, 2, 0), wood))
    profile = [(0, 0.35), (0.6, 0.35), (0.6, 1.75), (0, 1.75)]
    add("Cylinder", lathe("Cylinder", profile, 96, stone, smooth="sides"))
    add("Bar", box("Bar", (0.3, -0.125, 1.2), (1.7, 0.125, 1.45), brass))  # .3 of it is inside the cylinder
    light("Light", 'POINT', 650, (2.2, -1.8, 4.0), shadow_soft_size=0.15)
    camera((4.2, -4.6, 3.4), (0, 0, 0.6), radians(40))
