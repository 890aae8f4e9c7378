"""A product on white: a bottle of perfume, its box and a jar of cream, under three softboxes."""

from math import cos, pi, sin

import numpy as np
from common import (
    add,
    box,
    flight,
    grid,
    image,
    lamp,
    lathe,
    mesh,
    noise,
    principled,
    save,
    start,
    textured,
    unwrap,
    world,
)


def sweep():
    """The paper: flat, then bent upwards behind."""

    def height(x, y):
        bend = np.clip((y - 0.5) / 0.5, 0, None)
        return np.where(bend < 1, 0.5 * (1 - np.sqrt(np.clip(1 - np.minimum(bend, 1) ** 2, 0, 1))), 0.5)

    white = principled("Paper", (0.86, 0.86, 0.86), Roughness=0.75)
    add(
        "Sweep",
        grid("Sweep", np.linspace(-3, 3, 3), np.concatenate([[-2.5], np.linspace(0.5, 0.995, 60)]), height, white),
    )
    add("Wall", box("Wall", (-3, 0.99, 0.4), (3, 1.02, 3), white))


def superellipse(name, wide, deep, sections, material, power=5, sides=96):
    """Return a mesh with rounded rectangles as sections: (scale, z) from below upwards, closed at both ends."""
    a = 2 * pi * np.arange(sides) / sides
    x = wide * np.sign(np.cos(a)) * np.abs(np.cos(a)) ** (2 / power)
    y = deep * np.sign(np.sin(a)) * np.abs(np.sin(a)) ** (2 / power)
    vertices = [(scale * u, scale * v, z) for scale, z in sections for u, v in zip(x, y, strict=True)]
    faces = [
        (k * sides + s, k * sides + (s + 1) % sides, (k + 1) * sides + (s + 1) % sides, (k + 1) * sides + s)
        for k in range(len(sections) - 1)
        for s in range(sides)
    ]
    end = len(vertices) - sides
    faces += [tuple(range(sides))[::-1], tuple(range(end, end + sides))]
    return mesh(name, vertices, faces, material, smooth=True)


def label(size=512):
    """Return a picture for the box: a dark card with a golden frame and stripes of print."""
    y, x = np.meshgrid(np.arange(size) / size, np.arange(size) / size, indexing="ij")
    card = np.asarray((0.045, 0.07, 0.12)) * (0.9 + 0.2 * noise(size, 16, 2)[..., None])
    u, v = np.abs(x - 0.5) / 0.72, np.abs(y - 0.5)  # the card is seen over .72 of the width
    frame = (np.maximum(u, v) > 0.42) & (np.maximum(u, v) < 0.436)
    print_ = (np.abs(x - 0.5) < 0.2) & (np.abs(y - 0.5) < 0.03) & ((x * 22) % 1 < 0.6)
    small = (np.abs(x - 0.5) < 0.12) & (np.abs(y - 0.4) < 0.008) & ((x * 60) % 1 < 0.6)
    return image("Label", np.where((frame | print_ | small)[..., None], (0.8, 0.6, 0.28), card))


def things():
    glass = principled("Bottle Glass", (0.98, 0.93, 0.9), Roughness=0.0, Transmission_Weight=1.0, IOR=1.5)
    liquid = principled("Perfume", (0.95, 0.62, 0.38), Roughness=0.0, Transmission_Weight=1.0, IOR=1.36)
    outside = [(0.9, 0), (0.97, 0.003), (1, 0.01), (1, 0.082), (0.96, 0.09), (0.8, 0.095), (0.3, 0.097)]
    inside = [(0.8, 0.011), (0.86, 0.014), (0.87, 0.02), (0.87, 0.06)]
    add("Bottle", superellipse("Bottle", 0.036, 0.02, outside, glass), (0.01, 0, 0.0005), (0, 0, 0.25))
    add("Perfume", superellipse("Perfume", 0.036, 0.02, inside, liquid), (0.01, 0, 0.0005), (0, 0, 0.25))
    gold = principled("Gold", (0.95, 0.70, 0.36), Metallic=1.0, Roughness=0.18)
    black = principled("Cap", (0.015, 0.015, 0.018), Roughness=0.08, Coat_Weight=0.5)
    add(
        "Collar",
        lathe("Collar", [(0, 0), (0.0105, 0), (0.0105, 0.008), (0.009, 0.009), (0, 0.009)], 64, gold),
        (0.01, 0, 0.0976),
    )
    add(
        "Cap",
        superellipse("Cap", 0.017, 0.014, [(0.96, 0), (1, 0.001), (1, 0.034), (0.94, 0.036)], black),
        (0.01, 0, 0.107),
        (0, 0, 0.25),
    )
    carton = box("Carton", (-0.045, -0.026, 0), (0.045, 0.026, 0.125), textured("Carton", label(), Roughness=0.35))
    unwrap(carton, 0.125, (0.5, 0.0))
    bevel = add("Carton", carton, (-0.095, 0.045, 0), (0, 0, 0.42)).modifiers.new("Bevel", 'BEVEL')
    bevel.width, bevel.segments = 0.0008, 2
    porcelain = principled("Porcelain", (0.82, 0.8, 0.76), Roughness=0.12)
    add(
        "Jar",
        lathe("Jar", [(0, 0), (0.026, 0), (0.029, 0.003), (0.029, 0.026), (0, 0.026)], 96, porcelain, smooth="sides"),
        (0.095, -0.02, 0),
    )
    add(
        "Jar Lid",
        lathe(
            "Jar Lid",
            [(0, 0.027), (0.0295, 0.027), (0.0295, 0.041), (0.0285, 0.042), (0, 0.042)],
            96,
            gold,
            smooth="sides",
        ),
        (0.095, -0.02, 0),
    )
    pebble = principled("Pebble", (0.3, 0.29, 0.28), Roughness=0.7)
    for n, (x, y, s) in enumerate(((0.06, -0.075, 0.012), (0.078, -0.088, 0.008), (-0.05, -0.07, 0.009))):
        add(
            f"Pebble.{n}",
            lathe(
                "Pebble",
                [(0, -s * 0.5)]
                + [(s * sin(a), -0.5 * s * cos(a)) for a in np.linspace(0.3, pi - 0.3, 10)]
                + [(0, s * 0.5)],
                32,
                pebble,
            ),
            (x, y, s * 0.5),
            (0, 0, n),
            (1.3, 1, 1),
        )


def make(folder):
    start(exposure=0.0, transform='Standard')
    world((1, 1, 1), 0.25)
    sweep()
    things()
    lamp("Key Softbox", 'AREA', 5.5, (-0.75, -0.45, 0.75), (0, 0, 0.04), shape='RECTANGLE', size=0.6, size_y=0.9)
    lamp("Fill Softbox", 'AREA', 1.8, (0.9, -0.6, 0.5), (0, 0, 0.05), shape='RECTANGLE', size=0.5, size_y=0.8)
    lamp("Top Softbox", 'AREA', 5.0, (0, 0.15, 1.1), (0, 0.1, 0), shape='RECTANGLE', size=1.0, size_y=0.6)
    flight((0.08, -0.62, 0.16), (-0.06, -0.63, 0.18), (0.0, 0, 0.052), (0.0, 0, 0.052), 62)
    save("product", folder)
