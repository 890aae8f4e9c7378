"""A still life: a copper pot, a wine glass, plastic, cloth, fruit, and a lamp that is in view."""

from math import cos, pi, sin

import numpy as np
from common import (
    add,
    ball,
    box,
    cloth,
    emission,
    emitter,
    flight,
    grid,
    lamp,
    lathe,
    plaster,
    principled,
    save,
    start,
    textured,
    tube,
    unwrap,
    wood,
    world,
)


def table():
    top = box("Table", (-0.9, -0.5, -0.04), (0.9, 0.5, 0), textured("Oak", wood("Oak"), bump=0.0004, Roughness=0.42))
    add("Table", unwrap(top, 0.9))
    wall = box(
        "Wall",
        (-2.4, 0.95, -0.8),
        (2.4, 1.0, 1.8),
        textured("Plaster", plaster("Plaster", (0.36, 0.40, 0.38)), Roughness=0.9),
    )
    add("Wall", unwrap(wall, 1.5))
    folds = grid(
        "Cloth",
        np.linspace(-0.78, 0.02, 160),
        np.linspace(-0.56, 0.12, 140),
        _folds,
        textured("Linen", cloth("Linen", (0.78, 0.74, 0.66), (0.50, 0.10, 0.09), 96, 5), Roughness=0.95),
    )
    add("Cloth", folds)


def _folds(x, y):
    """The cloth lies on the table with low folds, and hangs over its edge."""
    lying = 0.006 + 0.011 * (1 + np.sin(17 * x + 9 * y + 2 * np.sin(7 * y))) * np.clip(1.4 * (0.12 - y), 0, 1)
    over = np.clip(-0.5 - y, 0, 1)
    return np.where(over > 0, lying - 3.2 * over, lying)


def pot():
    copper = principled("Copper", (0.86, 0.42, 0.28), Metallic=1.0, Roughness=0.16)
    profile = [
        (0, 0),
        (0.085, 0),
        (0.112, 0.018),
        (0.123, 0.055),
        (0.12, 0.1),
        (0.107, 0.135),
        (0.11, 0.148),
        (0.106, 0.15),
        (0.103, 0.135),
        (0.115, 0.1),
        (0.117, 0.055),
        (0.105, 0.02),
        (0, 0.008),
    ]
    add("Pot", lathe("Pot", profile, 96, copper), (-0.22, 0.12, 0.012))
    brass = principled("Brass", (0.83, 0.63, 0.28), Metallic=1.0, Roughness=0.28)
    for side in (-1, 1):
        path = [
            (side * (0.117 + 0.045 * sin(a)), 0.035 * cos(a) * 1.2, 0.105 + 0.012 * sin(a))
            for a in np.linspace(0, pi, 16)
        ]
        add(f"Handle {side}", tube("Handle", path, 0.0055, brass), (-0.22, 0.12, 0.012))


def glass():
    clear = principled("Glass", (1, 1, 1), Roughness=0.0, Transmission_Weight=1.0, IOR=1.5)
    profile = [
        (0, 0),
        (0.036, 0),
        (0.036, 0.0025),
        (0.006, 0.008),
        (0.0042, 0.03),
        (0.0042, 0.085),
        (0.012, 0.095),
        (0.034, 0.115),
        (0.041, 0.145),
        (0.038, 0.185),
        (0.033, 0.21),
        (0.0318, 0.21),
        (0.0366, 0.185),
        (0.0394, 0.145),
        (0.0325, 0.1165),
        (0.011, 0.0975),
        (0, 0.096),
    ]
    add("Wine Glass", lathe("Wine Glass", profile, 96, clear), (0.14, -0.12, 0))


def things():
    red = principled("Red Plastic", (0.62, 0.035, 0.03), Roughness=0.28)
    blue = principled("Blue Plastic", (0.03, 0.12, 0.42), Roughness=0.4)
    cup = [(0, 0), (0.034, 0), (0.043, 0.098), (0.0405, 0.098), (0.032, 0.004), (0, 0.004)]
    add("Beaker", lathe("Beaker", cup, 64, red), (0.3, 0.02, 0))
    add(
        "Lid",
        lathe(
            "Lid",
            [(0, 0), (0.055, 0), (0.055, 0.012), (0.05, 0.016), (0.012, 0.018), (0.012, 0.03), (0, 0.032)],
            64,
            blue,
        ),
        (0.36, -0.2, 0),
        (0, 0, 0),
    )
    lemon = principled("Lemon", (0.82, 0.60, 0.06), Roughness=0.45)
    orange = principled("Orange", (0.80, 0.30, 0.03), Roughness=0.5)
    add("Lemon", ball("Lemon", 0.033, lemon, squash=1.35), (0.01, -0.25, 0.031), (pi / 2, 0, 0.6))
    add("Orange", ball("Orange", 0.042, orange), (-0.08, -0.17, 0.056))
    add("Orange.001", ball("Orange.001", 0.04, orange), (-0.17, -0.13, 0.058))
    add(
        "Pencil",
        tube("Pencil", [(-0.09, 0, 0), (0.09, 0, 0)], 0.0037, principled("Lacquer", (0.7, 0.5, 0.04)), 6),
        (0.12, -0.31, 0.004),
        (0, 0, 0.35),
    )


def table_lamp():
    """A lamp with a shade that is open above and below; its bulb is seen from below the rim."""
    at = (0.5, 0.26, 0)
    steel = principled("Steel", (0.62, 0.62, 0.64), Metallic=1.0, Roughness=0.22)
    add(
        "Foot",
        lathe(
            "Foot",
            [(0, 0), (0.075, 0), (0.075, 0.012), (0.012, 0.022), (0.007, 0.03), (0.007, 0.27), (0, 0.27)],
            64,
            steel,
        ),
        at,
    )
    shade = principled("Shade", (0.74, 0.66, 0.5), Roughness=0.9)
    add("Shade", lathe("Shade", [(0.14, 0.27), (0.09, 0.42), (0.0885, 0.42), (0.1385, 0.27)], 96, shade), at)
    emitter("Bulb", ball("Bulb", 0.028, emission("Filament", (1, 0.72, 0.42), 40), 32), (at[0], at[1], 0.325))
    lamp("Bulb Lamp", 'POINT', 11, (at[0], at[1], 0.325), color=(1, 0.68, 0.38), shadow_soft_size=0.028)


def make(folder):
    start()
    world((0.05, 0.06, 0.08), 1.0)
    table()
    pot()
    glass()
    things()
    table_lamp()
    lamp(
        "Window", 'AREA', 40, (-1.5, -0.9, 1.35), (0, 0, 0.1), (0.82, 0.9, 1.0), shape='RECTANGLE', size=0.9, size_y=1.3
    )
    flight((0.18, -1.3, 0.36), (-0.08, -1.28, 0.4), (0.13, 0.05, 0.155), (0.11, 0.05, 0.15), 46)
    save("still_life", folder)
