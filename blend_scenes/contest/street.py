"""A street in the afternoon: houses of brick, parked cars, trees, lamp posts, under a sky with clouds and a sun."""

from math import pi, radians

import numpy as np
from common import (
    add,
    ball,
    box,
    concrete,
    facade,
    flight,
    lamp,
    lathe,
    mesh,
    principled,
    save,
    sky,
    start,
    textured,
    tube,
    unwrap,
)


def ground():
    asphalt = textured("Asphalt", concrete("Asphalt", (0.10, 0.10, 0.105)), Roughness=0.85)
    paving = textured("Paving", concrete("Paving", (0.38, 0.36, 0.33)), Roughness=0.8)
    add("Road", unwrap(box("Road", (-4, -20, -0.3), (4, 90, 0), asphalt), 4.0))
    line = principled("Paint", (0.75, 0.75, 0.72), Roughness=0.7)
    dash = box("Dash", (-0.07, 0, 0), (0.07, 2.2, 0.004), line)
    for n in range(18):
        add(f"Dash.{n:02}", dash, (0, 5 * n - 6, 0))
    for name, low, high in (
        ("Pavement", (-8, -20, -0.3), (-4, 90, 0.13)),
        ("Pavement.001", (4, -20, -0.3), (8, 90, 0.13)),
    ):
        add(name, unwrap(box(name, low, high, paving), 2.0))


def houses():
    walls = ((0.42, 0.16, 0.11), (0.55, 0.42, 0.27), (0.46, 0.24, 0.17), (0.62, 0.55, 0.45))
    brick = [
        textured(f"Front {n}", facade(f"Front {n}", wall, (0.03, 0.04, 0.05)), Roughness=0.85)
        for n, wall in enumerate(walls)
    ]
    roof = principled("Roof", (0.15, 0.09, 0.08), Roughness=0.9)
    trim = principled("Cornice", (0.66, 0.62, 0.55), Roughness=0.8)
    random, n = np.random.default_rng(3), 0
    for side in (-1, 1):
        y = -14.0
        while y < 80:
            deep, wide, high = 8.0, float(random.choice([9.0, 12.0])), float(random.choice([9.0, 12.0]))
            low, top = min(side * 8, side * (8 + deep)), max(side * 8, side * (8 + deep))
            house = box(f"House {n}", (low, y, 0), (top, y + wide, high), brick[n % 4])
            add(f"House.{n:03}", unwrap(house, 12.0 if high == 12 else 9.0))
            add(
                f"Cornice.{n:03}", box(f"Cornice {n}", (low - 0.25, y, high), (top + 0.25, y + wide, high + 0.35), trim)
            )
            gable = [
                (low, y, high + 0.35),
                (top, y, high + 0.35),
                (top, y + wide, high + 0.35),
                (low, y + wide, high + 0.35),
                ((low + top) / 2, y, high + 3.2),
                ((low + top) / 2, y + wide, high + 3.2),
            ]
            add(
                f"Roof.{n:03}",
                mesh(f"Roof {n}", gable, [(0, 4, 5, 3), (1, 2, 5, 4), (0, 1, 4), (2, 3, 5), (0, 3, 2, 1)], roof),
            )
            step = box(f"Step {n}", (side * 8 - 0.5, y + 1.2, 0.13), (side * 8 + 0.5, y + 2.6, 0.35), trim)
            add(f"Step.{n:03}", step)
            y, n = y + wide, n + 1
    add("Far House", unwrap(box("Far House", (-16, 90, 0), (16, 96, 14), brick[1]), 14.0))


def car(name, paint, x, y, turn=0.0):
    """A car of three parts: body, cabin, wheels."""
    body = box(f"{name} Body", (-0.88, -2.1, 0.3), (0.88, 2.1, 0.86), paint)
    glass = principled("Car Window", (0.02, 0.025, 0.03), Roughness=0.05)
    cabin = mesh(
        f"{name} Cabin",
        [
            (-0.82, -1.35, 0.86),
            (0.82, -1.35, 0.86),
            (0.82, 1.55, 0.86),
            (-0.82, 1.55, 0.86),
            (-0.66, -0.75, 1.42),
            (0.66, -0.75, 1.42),
            (0.66, 1.05, 1.42),
            (-0.66, 1.05, 1.42),
        ],
        [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (0, 3, 2, 1)],
        glass,
    )
    roof = box(f"{name} Roof", (-0.67, -0.76, 1.41), (0.67, 1.06, 1.45), paint)
    for part in (body, cabin, roof):
        made = add(part.name, part, (x, y, 0), (0, 0, turn))
        if part is body:
            bevel = made.modifiers.new("Bevel", 'BEVEL')
            bevel.width, bevel.segments = 0.14, 4
    rubber = principled("Rubber", (0.02, 0.02, 0.02), Roughness=0.9)
    wheel = lathe(
        f"{name} Wheel",
        [(0, -0.1), (0.3, -0.1), (0.32, -0.07), (0.32, 0.07), (0.3, 0.1), (0, 0.1)],
        40,
        rubber,
        smooth="sides",
    )
    sign = -1 if abs(turn) > 1 else 1
    for n, (u, v) in enumerate(((-0.8, -1.3), (0.8, -1.3), (-0.8, 1.35), (0.8, 1.35))):
        add(f"{name} Wheel.{n}", wheel, (x + sign * u, y + sign * v, 0.32), (0, pi / 2, turn))


def furniture():
    iron = principled("Lamp Post", (0.05, 0.07, 0.06), Roughness=0.5)
    bark = principled("Bark", (0.16, 0.11, 0.07), Roughness=0.95)
    green = principled("Foliage", (0.09, 0.17, 0.035), Roughness=0.8)
    random = np.random.default_rng(8)
    for n in range(7):
        for side in (-1, 1):
            x, y = side * 4.6, 12 * n - 2 + 3 * side
            add(
                f"Post.{n}.{side}",
                tube("Post", [(0, 0, 0.13), (0, 0, 4.8), (-side * 0.3, 0, 5.2), (-side * 1.1, 0, 5.25)], 0.05, iron),
                (x, y, 0),
            )
            add(f"Head.{n}.{side}", box("Head", (-0.3, -0.1, -0.06), (0.3, 0.1, 0.06), iron), (x - side * 1.2, y, 5.22))
            add(
                f"Trunk.{n}.{side}",
                tube("Trunk", [(0, 0, 0.1), (0.05, 0, 1.6), (0, 0.06, 2.8)], 0.11, bark),
                (x + side * 0.4, y + 6, 0),
            )
            for k in range(9):
                at = random.uniform((-0.9, -0.9, 2.7), (0.9, 0.9, 4.6))
                add(
                    f"Crown.{n}.{side}.{k}",
                    lump(f"Crown {k}", green, k),
                    (x + side * 0.4 + at[0], y + 6 + at[1], at[2]),
                    scale=(random.uniform(0.6, 1.0),) * 3,
                )
    bin_ = lathe(
        "Bin",
        [(0, 0), (0.22, 0), (0.26, 0.8), (0.23, 0.8), (0.2, 0.05), (0, 0.05)],
        32,
        principled("Bin", (0.1, 0.22, 0.14), Roughness=0.5),
    )
    for n, (x, y) in enumerate(((4.9, 3.2), (-5.0, 14), (4.9, 27))):
        add(f"Bin.{n}", bin_, (x, y, 0.13))


_lumps = {}


def lump(name, material, seed):
    """Return a ball with bumps, once for each seed."""
    if name not in _lumps or not _lumps[name].users:
        data, random = ball(name, 0.7, material, 32), np.random.default_rng(seed)
        points = np.empty(3 * len(data.vertices), np.float32)
        data.vertices.foreach_get("co", points)
        points = points.reshape(-1, 3)
        waves = sum(0.07 * np.sin(points @ random.uniform(-9, 9, 3) + random.uniform(0, 6)) for _ in range(6))
        data.vertices.foreach_set("co", (points * (1 + waves[:, None])).astype(np.float32).ravel())
        _lumps[name] = data
    return _lumps[name]


def make(folder):
    _lumps.clear()
    start(exposure=0.3)
    sky(1.5)
    ground()
    houses()
    for n, (x, y, color, turn) in enumerate(
        (
            (-3.1, 5, (0.4, 0.02, 0.02), 0.0),
            (3.1, 9, (0.04, 0.1, 0.25), pi),
            (-3.1, 17, (0.55, 0.56, 0.58), 0.0),
            (3.1, 23, (0.6, 0.5, 0.1), pi),
            (-3.1, 31, (0.05, 0.05, 0.05), 0.0),
            (1.6, 40, (0.5, 0.5, 0.48), pi),
        )
    ):
        car(f"Car {n}", principled(f"Paint {n}", color, Roughness=0.25, Coat_Weight=0.6), x, y, turn)
    furniture()
    lamp("Sun", 'SUN', 4.2, (9, -26, 23), (0, 10, 0), (1.0, 0.92, 0.8), angle=radians(0.53))
    flight((-1.3, -7.5, 1.65), (-0.9, -5.8, 1.65), (0.6, 12, 2.6), (0.6, 13, 2.6), 26)
    save("street", folder)
