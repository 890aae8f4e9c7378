"""A living room by a window: the sun falls in and draws the bars of the window on the floor."""

from math import radians

import numpy as np
from common import (
    add,
    ball,
    box,
    cloth,
    flight,
    lamp,
    lathe,
    mesh,
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


def shell():
    """Floor, ceiling, three walls, and the wall with the window on the left (x = −2.5)."""
    floor = box(
        "Floor",
        (-2.5, -3, -0.05),
        (2.5, 3, 0),
        textured("Parquet", wood("Parquet", planks=8), bump=0.0005, Roughness=0.35),
    )
    add("Floor", unwrap(floor, 1.6))
    white = textured("Wall Paint", plaster("Wall Paint", (0.78, 0.75, 0.70)), Roughness=0.9)
    for name, low, high in (
        ("Ceiling", (-2.5, -3, 2.7), (2.5, 3, 2.8)),
        ("Back Wall", (-2.5, 3, 0), (2.5, 3.1, 2.7)),
        ("Right Wall", (2.5, -3, 0), (2.6, 3, 2.7)),
        ("Front Wall", (-2.5, -3.1, 0), (2.5, -3, 2.7)),
        ("Sill Wall", (-2.75, -3, 0), (-2.5, 3, 0.75)),
        ("Lintel", (-2.75, -3, 2.35), (-2.5, 3, 2.8)),
        ("Pier", (-2.75, -3, 0.75), (-2.5, -0.5, 2.35)),
        ("Pier.001", (-2.75, 1.7, 0.75), (-2.5, 3, 2.35)),
    ):
        add(name, unwrap(box(name, low, high, white), 2.0))
    frame = principled("Frame", (0.8, 0.8, 0.78), Roughness=0.4)
    bars = [
        ((-2.66, -0.5, 0.75), (-2.6, 1.7, 0.82)),
        ((-2.66, -0.5, 2.28), (-2.6, 1.7, 2.35)),
        ((-2.66, -0.5, 0.82), (-2.6, -0.43, 2.28)),
        ((-2.66, 1.63, 0.82), (-2.6, 1.7, 2.28)),
        ((-2.66, 0.57, 0.82), (-2.6, 0.63, 2.28)),
        ((-2.65, -0.43, 1.72), (-2.61, 1.63, 1.76)),
    ]
    for n, (low, high) in enumerate(bars):
        add(f"Bar.{n:03}", box(f"Bar.{n:03}", low, high, frame))
    board = box("Skirting", (-2.5, 2.98, 0), (2.5, 3.0, 0.09), frame)
    add("Skirting", board)


def sofa():
    fabric = textured("Fabric", cloth("Fabric", (0.16, 0.24, 0.27), (0.13, 0.2, 0.23), 80), Roughness=0.95)
    parts = [
        ((-1.05, 2.0, 0.12), (1.05, 2.85, 0.42)),
        ((-1.05, 2.65, 0.42), (1.05, 2.9, 0.85)),
        ((-1.25, 2.0, 0.12), (-1.05, 2.9, 0.62)),
        ((1.05, 2.0, 0.12), (1.25, 2.9, 0.62)),
        ((-1.03, 1.98, 0.42), (-0.01, 2.66, 0.54)),
        ((0.01, 1.98, 0.42), (1.03, 2.66, 0.54)),
    ]
    for n, (low, high) in enumerate(parts):
        made = add(f"Sofa.{n:03}", unwrap(box(f"Sofa.{n:03}", low, high, fabric), 0.5))
        rounded(made, 0.05)
    for n, (x, turn, color) in enumerate(((-0.7, 0.25, (0.72, 0.42, 0.12)), (0.75, -0.3, (0.65, 0.6, 0.52)))):
        cushion = box(
            f"Cushion.{n:03}", (-0.22, -0.06, -0.2), (0.22, 0.06, 0.2), principled(f"Cushion {n}", color, Roughness=1.0)
        )
        rounded(add(f"Cushion.{n:03}", cushion, (x, 2.52, 0.74), (-0.3, 0, turn)), 0.055)
    wooden = principled("Walnut", (0.14, 0.07, 0.04), Roughness=0.4)
    for n, (x, y) in enumerate(((-1.15, 2.1), (1.15, 2.1), (-1.15, 2.8), (1.15, 2.8))):
        add(
            f"Sofa Foot.{n:03}",
            lathe("Sofa Foot", [(0, 0), (0.015, 0), (0.025, 0.12), (0, 0.12)], 24, wooden),
            (x, y, 0),
        )


def rounded(ob, width):
    bevel = ob.modifiers.new("Bevel", 'BEVEL')
    bevel.width, bevel.segments, bevel.harden_normals = width, 4, False
    ob.data.polygons.foreach_set("use_smooth", [True] * len(ob.data.polygons))


def rug_and_table():
    rug = box(
        "Rug",
        (-1.3, 0.1, 0),
        (1.1, 1.75, 0.012),
        textured("Rug", cloth("Rug", (0.62, 0.56, 0.46), (0.42, 0.16, 0.12), 128, 4), Roughness=1.0),
    )
    add("Rug", unwrap(rug, 1.6))
    steel = principled("Black Steel", (0.03, 0.03, 0.03), Roughness=0.35)
    ash = textured("Ash", wood("Ash", (0.5, 0.36, 0.2), (0.78, 0.62, 0.42)), Roughness=0.3)
    top = [(0, 0.38), (0.42, 0.38), (0.43, 0.39), (0.43, 0.405), (0.42, 0.415), (0, 0.415)]
    add("Table Top", unwrap(lathe("Table Top", top, 96, ash, smooth="sides"), 0.9), (0.1, 1.1, 0))
    for n in range(3):
        a = radians(120 * n + 20)
        add(
            f"Table Leg.{n:03}",
            tube(
                "Table Leg",
                [(0.32 * np.cos(a), 0.32 * np.sin(a), 0.012), (0.22 * np.cos(a), 0.22 * np.sin(a), 0.38)],
                0.011,
                steel,
            ),
            (0.1, 1.1, 0),
        )
    vase = principled("Ceramic", (0.75, 0.77, 0.76), Roughness=0.12)
    add(
        "Vase",
        lathe(
            "Vase",
            [
                (0, 0),
                (0.05, 0),
                (0.085, 0.05),
                (0.08, 0.12),
                (0.035, 0.19),
                (0.04, 0.22),
                (0.036, 0.22),
                (0.031, 0.19),
                (0, 0.1),
            ],
            64,
            vase,
        ),
        (0.22, 1.18, 0.415),
    )
    bowl = principled("Bowl", (0.12, 0.3, 0.32), Roughness=0.2)
    add(
        "Bowl",
        lathe("Bowl", [(0, 0), (0.05, 0), (0.11, 0.05), (0.107, 0.053), (0.047, 0.006), (0, 0.006)], 64, bowl),
        (-0.08, 1.02, 0.415),
    )
    for n in range(3):
        add(
            f"Apple.{n:03}",
            ball("Apple", 0.034, principled("Apple", (0.5, 0.08, 0.05), Roughness=0.3)),
            (-0.08 + 0.04 * np.cos(2.1 * n), 1.02 + 0.04 * np.sin(2.1 * n), 0.47),
        )


def plant():
    """Thin stems with flat leaves, between the window and the sofa."""
    add(
        "Planter",
        lathe(
            "Planter",
            [(0, 0), (0.14, 0), (0.19, 0.36), (0.17, 0.36), (0.16, 0.3), (0, 0.3)],
            64,
            principled("Terracotta", (0.5, 0.22, 0.13), Roughness=0.8),
        ),
        (-1.9, 2.3, 0),
    )
    green = principled("Leaf Green", (0.06, 0.2, 0.05), Roughness=0.4)
    random = np.random.default_rng(4)
    vertices, faces = [], []
    for n in range(26):
        turn, lean, length = random.uniform(0, 6.3), random.uniform(0.15, 0.75), random.uniform(0.6, 1.15)
        out = np.array([np.cos(turn), np.sin(turn), 0])
        side = np.array([-np.sin(turn), np.cos(turn), 0])
        for k in range(13):
            t = k / 12
            middle = out * lean * t * t * length + np.array([0, 0, 1]) * length * t * (1 - 0.45 * lean * t)
            width = 0.055 * np.sin(np.pi * min(1, 0.08 + t)) ** 0.7
            vertices += [
                tuple(middle - width * side),
                tuple(middle + np.array([0, 0, -0.012])),
                tuple(middle + width * side),
            ]
        at = 39 * n
        for k in range(12):
            a = at + 3 * k
            faces += [(a, a + 1, a + 4, a + 3), (a + 1, a + 2, a + 5, a + 4)]
    add("Plant", mesh("Plant", vertices, faces, green, smooth=True), (-1.9, 2.3, 0.3))


def wall_things():
    frame = principled("Picture Frame", (0.05, 0.04, 0.035), Roughness=0.4)
    for n, (x, low, wide, high) in enumerate(((-0.35, 1.35, 0.6, 0.8), (0.6, 1.45, 0.8, 0.55))):
        add(
            f"Picture Frame.{n:03}",
            box("Picture Frame", (x - wide / 2, 2.965, low), (x + wide / 2, 3.0, low + high), frame),
        )
        art = textured(
            f"Art {n}",
            cloth(f"Art {n}", (0.7, 0.66, 0.58), ((0.1, 0.25, 0.4), (0.7, 0.3, 0.12))[n], 6, n * 3),
            Roughness=0.7,
        )
        add(
            f"Art.{n:03}",
            unwrap(
                box(
                    "Art",
                    (x - wide / 2 + 0.04, 2.955, low + 0.04),
                    (x + wide / 2 - 0.04, 2.966, low + high - 0.04),
                    art,
                ),
                0.5,
            ),
        )
    # A floor lamp that is off.
    steel = principled("Brushed Steel", (0.6, 0.58, 0.55), Metallic=1.0, Roughness=0.3)
    add("Floor Lamp", tube("Floor Lamp", [(0, 0, 0.02), (0, 0, 1.5)], 0.012, steel), (1.75, 2.5, 0))
    add(
        "Floor Lamp Foot",
        lathe("Floor Lamp Foot", [(0, 0), (0.14, 0), (0.14, 0.015), (0, 0.02)], 64, steel),
        (1.75, 2.5, 0),
    )
    add(
        "Floor Lamp Shade",
        lathe(
            "Floor Lamp Shade",
            [(0.2, 1.4), (0.15, 1.7), (0.148, 1.7), (0.198, 1.4)],
            64,
            principled("Shade", (0.75, 0.7, 0.6), Roughness=1.0),
        ),
        (1.75, 2.5, 0),
    )


def make(folder):
    start(exposure=0.8)
    world((0.62, 0.75, 1.0), 1.0)
    shell()
    sofa()
    rug_and_table()
    plant()
    wall_things()
    lamp("Sun", 'SUN', 7.0, (-6, -2, 5), (-0.3, 1.1, 0), (1.0, 0.93, 0.82), angle=radians(0.53))
    # What the sky gives through the window, as an artist helps the renderer.
    lamp(
        "Sky Portal",
        'AREA',
        110,
        (-2.78, 0.6, 1.55),
        (0, 0.6, 1.3),
        (0.78, 0.88, 1.0),
        shape='RECTANGLE',
        size=2.2,
        size_y=1.6,
    )
    flight((1.35, -2.55, 1.45), (0.75, -2.6, 1.5), (-0.3, 1.6, 0.85), (-0.4, 1.6, 0.85), 24)
    save("room", folder)
