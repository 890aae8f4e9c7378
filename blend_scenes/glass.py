"""The paper's scenes with semitransparent surfaces: the tabletop with a cylinder of glass (Fig. 4), and a sphere as a
lens (Fig. 5).
"""

from math import cos, pi, radians, sin

import bpy
import tabletop
from parts import add, camera, clean_scene, lathe, light, mesh, principled, save, world


def make():
    tabletop.build()
    bpy.context.scene.light_meshes.max_depth = 8
    bpy.context.scene.light_meshes.mode = 'WHITTED'
    bpy.context.scene.light_meshes.caustics = 'PAPER'
    whitted(bpy.data.materials["Cylinder"], kd=0.3, kt=(0.7, 0.7, 0.7), ior=1.5)
    save("cylinder")
    build_lens()
    save("lens")


def build_lens():
    clean_scene(1000, 1000, auto_h=False, h=0.03, kI=4.0, weights='UNIFORM', samples=9, max_depth=8, refraction='FULL',
                caustics='FOCUS')
    world((1.0, 0.97, 0.92), 0.12)
    floor = principled("Floor", (0.62, 0.55, 0.45), Roughness=1.0, Specular_IOR_Level=0.0)
    red = principled("Red", (0.6, 0.15, 0.1), Roughness=1.0, Specular_IOR_Level=0.0)
    glass = principled("Glass", (0.5, 0.5, 0.5), Roughness=1.0, Specular_IOR_Level=0.0)
    whitted(glass, kd=0.05, ks=0.4, nShiny=200.0, kt=(0.95, 0.95, 0.95), ior=1.5)
    add("Floor", mesh("Floor", [(-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0)], [(0, 1, 2, 3)], floor))
    add("Lens", ball("Lens", 0.6, glass), (0, 0, 0.9))
    add("Ball", ball("Ball", 0.3, red), (-0.9, 0.4, 0.3))
    light("Light", 'POINT', 650, (0.8, -0.6, 4.2), shadow_soft_size=0.15)
    camera((2.6, -4.2, 2.6), (-0.2, 0, 0.5), radians(36))


def ball(name, radius, material, rings=48):
    """Make a smooth sphere."""
    profile = [(radius * sin(pi * k / rings), -radius * cos(pi * k / rings)) for k in range(rings + 1)]
    profile[0], profile[-1] = (0, -radius), (0, radius)
    return lathe(name, profile, 2 * rings, material)


def whitted(material, **parameters):
    """Override the translated parameters of a material with these Whitted parameters."""
    for name, value in parameters.items():
        setattr(material.light_meshes, f"override_{name}", True)
        setattr(material.light_meshes, name, value)
