"""Many lights over many triangles (S7): a hall of instanced columns and balls under 256 point lights.

`light-meshes bench` uses the first 1, 4, 16, 64 or all of the lights, always with the same total power.
"""

from math import cos, pi, radians, sin

import numpy as np
from parts import add, box, camera, clean_scene, diffuse, lathe, light, save, world

LIGHTS = 256
PLACES = 6  # in each direction
SIDES = 96  # of a column and of a ball
POWER = 300  # of all lights


def make():
    clean_scene(1000, 1000, auto_h=False, h=0.025, kI=2.0, weights='UNIFORM', samples=4)
    world((0, 0, 0), 0)
    grey = diffuse("Grey", (0.8, 0.8, 0.8))
    add("Floor", box("Floor", (-2.2, -2.2, -0.1), (2.2, 2.2, 0), grey))
    add("Left Wall", box("Left Wall", (-2.3, -2.2, 0), (-2.2, 2.2, 2), diffuse("Left", (0.7, 0.4, 0.3))))
    add("Back Wall", box("Back Wall", (-2.2, 2.2, 0), (2.2, 2.3, 2), diffuse("Back", (0.3, 0.5, 0.7))))
    step = 4 / PLACES
    radius = 0.12 * step
    column = lathe("Column", [(0, 0), (radius, 0), (radius, 1.2), (0, 1.2)], SIDES, grey, smooth="sides")
    radius, rings = 0.16 * step, SIDES // 2
    profile = [(radius * sin(pi * k / rings), -radius * cos(pi * k / rings)) for k in range(1, rings)]
    ball = lathe("Ball", [(0, -radius), *profile, (0, radius)], SIDES, diffuse("Ball", (0.7, 0.7, 0.3)))
    for n in range(PLACES**2):
        x, y = (step * (k + 0.5) - 2 for k in divmod(n, PLACES))
        add(f"Column.{n:03}", column, (x, y, 0))
        add(f"Ball.{n:03}", ball, (x + 0.33 * step, y - 0.3 * step, 0.17 * step), scale=(1, 1, 0.9))
    random = np.random.default_rng(7)
    for n in range(LIGHTS):
        where, color = random.uniform((-1.6, -1.6, 1.9), (1.6, 1.6, 2.5)), random.uniform(0.5, 1, 3)
        light(f"Light.{n:03}", 'POINT', POWER / LIGHTS, where, color=color, shadow_soft_size=0.05)
    camera((3.6, -4.6, 3.6), (0, 0, 0.3), radians(45))
    save("hall")
