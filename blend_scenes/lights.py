"""One light of each type, coloured and almost a point, over diffuse surfaces in a black world.

tests/peers/test_cycles.py renders each light alone with this engine and with Cycles.
"""

from math import radians

from parts import add, box, camera, clean_scene, diffuse, lathe, light, save, world

SMALL = 0.002  # a Cycles area light cannot be a point


def make():
    clean_scene(320, 240, mode='RAY_CASTING', shadows='SHARP', samples=1)
    world((0, 0, 0), 0)
    add("Floor", box("Floor", (-4, -4, -0.1), (4, 4, 0), diffuse("Grey", (0.8, 0.8, 0.8))))
    add("Block", box("Block", (-0.4, -0.4, 0), (0.4, 0.4, 0.9), diffuse("Red", (0.7, 0.25, 0.15))),
        (-0.9, 0.3, 0), (0, 0, 0.5))
    add("Column", lathe("Column", [(0, 0), (0.35, 0), (0.35, 1.2), (0, 1.2)], 64, diffuse("Blue", (0.2, 0.4, 0.75)),
                        smooth="sides"), (0.9, 0.7, 0))
    add("Plate", box("Plate", (-0.5, -0.3, -0.02), (0.5, 0.3, 0.02), diffuse("White", (1, 1, 1))),
        (0.4, -0.9, 0.6), (0.5, 0.2, 0.3))
    target = (0, 0, 0.3)
    light("Point", 'POINT', 500, (1.4, -1.8, 2.6), color=(1.0, 0.7, 0.4), shadow_soft_size=0.0)
    light("Sun", 'SUN', 2.5, (0, 0, 5), (-1.2, 1.5, 1.0), color=(0.6, 0.8, 1.0), angle=0.0)
    light("Spot", 'SPOT', 900, (-2.2, -1.6, 2.8), target, color=(0.5, 1.0, 0.6), shadow_soft_size=0.0,
          spot_size=radians(50), spot_blend=0.4)
    light("Area", 'AREA', 120, (1.8, 1.9, 2.5), target, color=(1.0, 0.5, 0.8), shape='SQUARE', size=SMALL)
    camera((3.0, -4.4, 3.2), (0, 0, 0.3), radians(42))
    save("lights")
