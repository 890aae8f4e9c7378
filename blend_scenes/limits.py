"""Posts from thick to thin on a floor, and a board that hangs above it, under one lamp with a size.

The documentation's pictures compare it with Cycles, to show shadow edges that are 2r wide everywhere. The fill light
casts no shadow; it makes the shadows visible in a black world.
"""

from math import radians

from parts import add, box, camera, clean_scene, light, principled, save, world

WIDTHS = (0.32, 0.16, 0.08, 0.04, 0.02)


def make():
    clean_scene(480, 330, auto_h=False, h=0.02, kI=4.0, mode='RAY_CASTING', samples=9)
    world((0, 0, 0), 0)
    plaster = principled("Plaster", (0.72, 0.69, 0.64), Roughness=1.0, Specular_IOR_Level=0.0)
    oak = principled("Oak", (0.55, 0.36, 0.2), Roughness=1.0, Specular_IOR_Level=0.0)
    slate = principled("Slate", (0.3, 0.38, 0.45), Roughness=1.0, Specular_IOR_Level=0.0)
    add("Floor", box("Floor", (-6, -6, -0.1), (6, 6, 0), plaster))
    for n, width in enumerate(WIDTHS):
        low, high = (-width / 2, -width / 2, 0), (width / 2, width / 2, 1.0)
        add(f"Post {n + 1}", box(f"Post {n + 1}", low, high, oak), (-1.5, 1.25 - 0.52 * n, 0))
    add("Board", box("Board", (-0.35, -0.5, -0.03), (0.35, 0.5, 0.03), slate), (0.3, -0.1, 0.8))
    lamp = light("Lamp", 'POINT', 1100, (-4.6, 0.4, 4.2), shadow_soft_size=0.3)
    lamp.data.light_meshes.softness = 'LIGHT_SIZE'
    light("Fill", 'SUN', 0.5, (0, 0, 5), (0.4, 0.8, 0), use_shadow=False)
    camera((0.3, -5.6, 4.3), (-0.12, 0.17, 0.15), radians(34))
    save("limits")
