"""An exhibition: 4,096 small lamps hang as a wave over sculptures in a dark room."""

from math import cos, pi, sin

import bpy
import numpy as np
from common import (
    add,
    ball,
    box,
    concrete,
    emission,
    emitter,
    flight,
    lathe,
    plaster,
    principled,
    save,
    start,
    textured,
    tube,
    unwrap,
    world,
)

LAMPS = 4096


def room():
    floor = textured("Floor", concrete("Floor", (0.22, 0.22, 0.23)), Roughness=0.25)
    add("Floor", unwrap(box("Floor", (-9, -7, -0.1), (9, 12, 0), floor), 3.0))
    wall = textured("Wall", plaster("Wall", (0.5, 0.5, 0.52)), Roughness=0.9)
    for name, low, high in (
        ("Left", (-9.2, -7, 0), (-9, 12, 5)),
        ("Right", (9, -7, 0), (9.2, 12, 5)),
        ("Back", (-9, 12, 0), (9, 12.2, 5)),
        ("Ceiling", (-9, -7, 5), (9, 12, 5.1)),
    ):
        add(name, unwrap(box(name, low, high, wall), 3.0))


def lamps():
    """64 × 64 lamps on a wave that is highest in the middle; their colour goes from warm to blue."""
    shades = 16
    data, seen = [], []
    for n in range(shades):
        t = n / (shades - 1)
        color = (1 - 0.65 * t, 0.62 + 0.1 * t, 0.3 + 0.7 * t)
        made = bpy.data.lights.new(f"Diode {n}", 'POINT')
        made.energy, made.color, made.shadow_soft_size = 0.42, color, 0.012
        made.light_meshes.softness = 'SIZE'
        data.append(made)
        seen.append(ball(f"Diode {n}", 0.012, emission(f"Diode {n}", color, 12), 10))
    for n in range(LAMPS):
        i, j = divmod(n, 64)
        x, y = -7.4 + 14.8 * i / 63, -1.5 + 12.2 * j / 63
        z = 3.35 + 0.45 * sin(0.85 * x + 0.5 * y) + 0.35 * cos(0.9 * y - 0.4 * x)
        shade = int((shades - 1) * (0.5 + 0.5 * sin(0.7 * x - 0.55 * y)))
        add(f"Lamp.{n:04}", data[shade], (x, y, z))
        emitter(f"Diode.{n:04}", seen[shade], (x, y, z))


def sculptures():
    plinth = principled("Plinth", (0.72, 0.72, 0.7), Roughness=0.7)
    marble = principled("Marble", (0.78, 0.76, 0.72), Roughness=0.25)
    bronze = principled("Bronze", (0.5, 0.32, 0.16), Metallic=1.0, Roughness=0.3)
    places = [(-3.4, 2.2), (0.2, 1.0), (3.5, 2.6), (-5.6, 6.4), (-1.6, 6.2), (2.2, 6.8), (5.8, 6.2), (0.0, 9.6)]
    for n, (x, y) in enumerate(places):
        add(
            f"Plinth.{n}",
            box("Plinth", (-0.45, -0.45, 0), (0.45, 0.45, 0.9 if n % 2 else 0.6), plinth),
            (x, y, 0),
            (0, 0, 0.2 * n),
        )
        base = 0.9 if n % 2 else 0.6
        material = (marble, bronze)[n % 3 == 1]
        if n % 3 == 0:  # a twisted column
            add(f"Sculpture.{n}", twist(f"Twist {n}", material), (x, y, base))
        elif n % 3 == 1:  # a knot
            path = [
                (0.34 * (sin(t) + 2 * sin(2 * t)) / 2, 0.34 * (cos(t) - 2 * cos(2 * t)) / 2, 0.62 - 0.3 * sin(3 * t))
                for t in np.linspace(0, 2 * pi, 140)
            ]
            add(f"Sculpture.{n}", tube(f"Knot {n}", path, 0.085, material, 24), (x, y, base))
        else:  # balls on each other
            z = base
            for k, r in enumerate((0.36, 0.27, 0.2, 0.13)):
                add(f"Sculpture.{n}.{k}", ball(f"Ball {n}.{k}", r, material), (x + 0.04 * (-1) ** k, y, z + 0.96 * r))
                z += 1.9 * r


def twist(name, material):
    profile = [(0.3 - 0.12 * t + 0.05 * sin(9 * t), 1.35 * t) for t in np.linspace(0, 1, 40)]
    data = lathe(name, [(0, 0), *profile, (0, 1.36)], 64, material)
    points = np.empty(3 * len(data.vertices), np.float32)
    data.vertices.foreach_get("co", points)
    points = points.reshape(-1, 3)
    angle = np.arctan2(points[:, 1], points[:, 0])
    swell = 1 + 0.22 * np.cos(4 * angle + 3.4 * points[:, 2])
    points[:, :2] *= swell[:, None]
    data.vertices.foreach_set("co", points.ravel())
    data.update()
    return data


def make(folder):
    start(exposure=0.1)
    bpy.context.scene.light_meshes.light_threshold = 0.01  # as Cycles' own
    world((0.004, 0.005, 0.008), 1.0)
    room()
    lamps()
    sculptures()
    flight((1.6, -5.6, 1.6), (0.6, -5.4, 1.6), (-0.2, 4, 1.75), (0, 4, 1.75), 24)
    save("exhibition", folder)
