"""A desk in the evening (S8), a scene as an artist would make it.

It has Principled materials, a packed image texture, smooth shading, a subdivision modifier, instances of a collection,
a mirror, a sun, a spot, an area light and a world colour. Scales and names are like those in an ordinary file.
"""

from math import cos, pi, radians, sin

import bpy
import numpy as np
from parts import add, box, camera, clean_scene, lathe, light, mesh, principled, save, world


def wood_image(size=256):
    """Return an image of planks with a grain. It is made from sines, so that the file needs no picture from
    elsewhere.
    """
    x, y = np.meshgrid(np.linspace(0, 1, size, endpoint=False), np.linspace(0, 1, size, endpoint=False))
    plank = np.floor(4 * y)
    wave = 0.5 + 0.5 * np.sin(2 * pi * (18 * y + 0.35 * np.sin(2 * pi * (x + 0.37 * plank)) + 0.6 * plank))
    fine = 0.5 + 0.5 * np.sin(2 * pi * (90 * y + 2 * np.sin(2 * pi * x)))
    tone = 0.72 + 0.2 * wave + 0.08 * fine - 0.04 * (plank % 2)
    tone = np.where((4 * y) % 1 < 0.02, 0.45 * tone, tone)  # the joints
    pixels = np.ones((size, size, 4), np.float32)
    pixels[..., :3] = tone[..., None] * (0.62, 0.42, 0.27)
    image = bpy.data.images.new("wood", size, size)
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return image


def wood_material():
    material = principled("Wood", Roughness=0.45)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture = nodes.new('ShaderNodeTexImage')
    texture.image = wood_image()
    links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return material


def table():
    top = box("Desk Top", (-1.0, -0.5, 0.70), (1.0, 0.5, 0.74), wood_material())
    uv = top.uv_layers.new(name="UVMap")
    for loop in top.loops:
        x, y, _ = top.vertices[loop.vertex_index].co
        uv.data[loop.index].uv = (0.8 * x, 0.8 * y)
    add("Desk Top", top)
    leg = box("Desk Leg", (-0.03, -0.03, 0), (0.03, 0.03, 0.70), principled("Steel", (0.3, 0.3, 0.32), Metallic=1.0,
                                                                          Roughness=0.35))
    for n, (x, y) in enumerate(((-0.94, -0.44), (0.94, -0.44), (-0.94, 0.44), (0.94, 0.44))):
        add(f"Desk Leg.{n:03}", leg, (x, y, 0))


def mug(location):
    """Make a mug with thick walls, smoothed by a subdivision modifier. The handle is a bent tube with the same
    material.
    """
    clay = principled("Glaze", (0.10, 0.26, 0.34), Roughness=0.15)
    profile = [(0, 0), (0.036, 0), (0.04, 0.006), (0.04, 0.092), (0.037, 0.095), (0.034, 0.092), (0.034, 0.010),
               (0.03, 0.006), (0, 0.006)]
    body = add("Mug", lathe("Mug", profile, 16, clay), location)
    vertices, faces, steps, sides = [], [], 10, 8
    for k in range(steps + 1):
        a = -pi / 2 + pi * k / steps
        for s in range(sides):
            b = 2 * pi * s / sides
            reach = 0.026 + 0.006 * cos(b)
            vertices.append((0.038 + reach * cos(a), 0.006 * sin(b), 0.05 + reach * sin(a)))
    for k in range(steps):
        for s in range(sides):
            a, b = k * sides + s, k * sides + (s + 1) % sides
            faces.append((a, b, b + sides, a + sides))
    handle = add("Mug Handle", mesh("Mug Handle", vertices, faces, clay, smooth=True), location)
    for part in (body, handle):
        modifier = part.modifiers.new("Subdivision", 'SUBSURF')
        modifier.levels = modifier.render_levels = 2


def books():
    z = 0.74
    for n, (width, depth, height, turn, color) in enumerate((
            (0.24, 0.17, 0.030, 0.10, (0.45, 0.07, 0.06)), (0.22, 0.15, 0.022, -0.12, (0.10, 0.16, 0.33)),
            (0.19, 0.13, 0.035, 0.32, (0.62, 0.50, 0.20)))):
        cover = principled(f"Cover {n}", color, Roughness=0.6)
        add(f"Book.{n:03}", box(f"Book.{n:03}", (-width / 2, -depth / 2, 0), (width / 2, depth / 2, height), cover),
            (-0.52, 0.12, z), (0, 0, turn))
        z += height


def pencils():
    """Make a collection with one pencil, and five instances of it in a pot."""
    yellow = principled("Lacquer", (0.8, 0.45, 0.05), Roughness=0.3)
    collection = bpy.data.collections.new("Pencil")
    pencil = bpy.data.objects.new("Pencil", lathe("Pencil", [(0, 0), (0.0035, 0), (0.0035, 0.16), (0, 0.178)], 6,
                                                  yellow, smooth=False))
    collection.objects.link(pencil)
    pot = principled("Pot", (0.55, 0.56, 0.58), Metallic=1.0, Roughness=0.3)
    add("Pot", lathe("Pot", [(0, 0), (0.035, 0), (0.035, 0.10), (0.032, 0.10), (0.032, 0.004), (0, 0.004)], 48, pot),
        (0.36, 0.24, 0.74))
    for n in range(5):
        a = 2 * pi * n / 5
        stick = add(f"Pencil.{n:03}", None, (0.36 + 0.017 * cos(a), 0.24 + 0.017 * sin(a), 0.746),
                    (-0.10 * sin(a), 0.10 * cos(a), a))
        stick.instance_type, stick.instance_collection = 'COLLECTION', collection


def lamp():
    """Make a lampshade over the spot light."""
    metal = principled("Lamp Metal", (0.55, 0.10, 0.06), Roughness=0.35)
    add("Lamp Foot", lathe("Lamp Foot", [(0, 0), (0.07, 0), (0.07, 0.012), (0.008, 0.02), (0.008, 0.36), (0, 0.36)],
                           32, metal), (0.66, 0.28, 0.74))
    add("Lamp Shade", lathe("Lamp Shade", [(0.02, 0.10), (0.035, 0.09), (0.085, 0.0)], 48, metal),
        (0.55, 0.20, 1.03), (0.35, 0.45, 0))
    light("Desk Lamp", 'SPOT', 22, (0.556, 0.196, 1.09), (0.30, 0.02, 0.74), color=(1.0, 0.78, 0.5),
          spot_size=radians(95), spot_blend=0.35, shadow_soft_size=0.02)


def make():
    clean_scene(960, 540, samples=9)
    world((0.10, 0.14, 0.22), 0.35)
    plaster = principled("Plaster", (0.72, 0.69, 0.64), Roughness=1.0, Specular_IOR_Level=0.0)
    add("Floor", box("Floor", (-3, -3, -0.05), (3, 1, 0), principled("Parquet", (0.32, 0.22, 0.15), Roughness=0.7)))
    add("Wall", box("Wall", (-3, 0.56, 0), (3, 0.66, 2.6), plaster))
    table()
    mug((0.02, -0.12, 0.74))
    books()
    pencils()
    lamp()
    ball = add("Paperweight", lathe("Paperweight", [(0.045 * sin(pi * k / 24), 0.045 - 0.045 * cos(pi * k / 24))
                                                    for k in range(25)], 48,
                                    principled("Chrome", (0.9, 0.9, 0.92), Metallic=1.0, Roughness=0.0)),
               (-0.22, -0.18, 0.74))
    ball.data.update()
    bpy.ops.mesh.primitive_monkey_add(size=0.16, location=(-0.50, 0.10, 0.905), rotation=(-0.55, 0, 0.5))
    monkey = bpy.context.object
    monkey.name = "Suzanne"
    monkey.data.materials.append(principled("Jade", (0.16, 0.42, 0.24), Roughness=0.35))
    monkey.data.polygons.foreach_set("use_smooth", [True] * len(monkey.data.polygons))
    monkey.modifiers.new("Subdivision", 'SUBSURF').render_levels = 2
    frame = principled("Frame", (0.12, 0.08, 0.06), Roughness=0.5)
    add("Mirror Frame", box("Mirror Frame", (-0.02, 0, -0.02), (0.62, 0.03, 0.52), frame), (-0.35, 0.53, 0.95))
    add("Mirror", box("Mirror", (0, 0, 0), (0.6, 0.01, 0.5), principled("Mirror", (0.95, 0.95, 0.95), Metallic=1.0,
                                                                     Roughness=0.0)), (-0.35, 0.522, 0.95))
    light("Evening Sun", 'SUN', 1.1, (-2, -2, 3), (0.4, 0.7, 0.4), color=(1.0, 0.62, 0.36), angle=radians(0.53))
    light("Window", 'AREA', 26, (-1.6, -1.2, 1.9), (-0.1, 0.1, 0.75), color=(0.7, 0.82, 1.0), shape='RECTANGLE',
          size=0.8, size_y=1.1)
    camera((0.55, -1.55, 1.42), (0.08, 0.12, 0.87), radians(46))
    save("desk")
