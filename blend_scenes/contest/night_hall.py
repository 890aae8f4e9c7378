"""A station hall at night: two rows of columns, benches, people waiting, and 64 lamps with globes of glass."""

from math import cos, pi, sin

import numpy as np
from common import (
    add,
    ball,
    box,
    concrete,
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
    unwrap,
    wood,
    world,
)

LAMPS = 64


def architecture():
    stone = textured("Terrazzo", concrete("Terrazzo", (0.5, 0.46, 0.4)), Roughness=0.3)
    add("Floor", unwrap(box("Floor", (-9, -4, -0.1), (9, 36, 0), stone), 3.0))
    wall = textured("Limestone", plaster("Limestone", (0.62, 0.55, 0.45)), Roughness=0.9)
    add("Left Wall", unwrap(box("Left Wall", (-9.3, -4, 0), (-9, 36, 9), wall), 4.0))
    add("Right Wall", unwrap(box("Right Wall", (9, -4, 0), (9.3, 36, 9), wall), 4.0))
    add("End Wall", unwrap(box("End Wall", (-9, 36, 0), (9, 36.3, 13), wall), 4.0))
    vault = grid(
        "Vault",
        np.linspace(-9, 9, 73),
        np.linspace(-4, 36, 3),
        lambda x, y: 7 + 5.2 * np.sqrt(np.clip(1 - (x / 9.1) ** 2, 0, 1)),
        wall,
    )
    add("Vault", vault)
    column = [
        (0, 0),
        (0.62, 0),
        (0.62, 0.25),
        (0.48, 0.38),
        (0.44, 0.6),
        (0.4, 6.2),
        (0.5, 6.4),
        (0.66, 6.7),
        (0.66, 7.0),
        (0, 7.0),
    ]
    stone = textured("Column", plaster("Column", (0.58, 0.52, 0.44)), Roughness=0.7)
    shaft = unwrap(lathe("Column", column, 48, stone, smooth="sides"), 4.0)
    for n in range(8):
        for side in (-1, 1):
            add(f"Column.{n}.{side}", shaft, (side * 5.6, 4 * n + 1, 0))
    rib = unwrap(box("Rib", (-5.9, -0.25, 7.0), (5.9, 0.25, 7.35), wall), 4.0)
    for n in range(8):
        add(f"Rib.{n}", rib, (0, 4 * n + 1, 0))
    clock = principled(
        "Clock", (0.85, 0.83, 0.75), Roughness=0.4, Emission_Color=(1, 0.95, 0.8, 1), Emission_Strength=1.2
    )
    add(
        "Clock",
        lathe("Clock", [(0, -0.08), (1.1, -0.08), (1.15, 0.08), (0, 0.1)], 64, clock),
        (0, 35.9, 8.6),
        (pi / 2, 0, 0),
    )


def furniture():
    oak = textured("Bench Oak", wood("Bench Oak"), Roughness=0.4)
    iron = principled("Iron", (0.06, 0.06, 0.065), Metallic=1.0, Roughness=0.45)
    seat = unwrap(box("Seat", (-1.1, -0.25, 0.42), (1.1, 0.25, 0.47), oak), 2.4)
    back = unwrap(box("Back", (-1.1, 0.22, 0.55), (1.1, 0.27, 0.95), oak), 2.4)
    leg = box("Leg", (-0.04, -0.24, 0), (0.04, 0.27, 0.42), iron)
    places = [(-2.7, 4), (2.7, 6.5), (-2.6, 11), (2.8, 13), (-2.7, 18), (2.7, 21), (-2.7, 26)]
    for n, (x, y) in enumerate(places):
        turn = pi / 2 if x < 0 else -pi / 2
        for part in (seat, back):
            add(f"{part.name}.{n:03}", part, (x, y, 0), (0, 0, turn))
        for end in (-0.9, 0.9):
            add(f"Leg.{n:03}.{end}", leg, (x - end * sin(turn), y + end * cos(turn), 0), (0, 0, turn))


def people():
    """Standing figures and their luggage: turned forms, each in its own colour."""
    body = [
        (0, 0),
        (0.12, 0),
        (0.14, 0.3),
        (0.17, 0.8),
        (0.21, 1.1),
        (0.23, 1.35),
        (0.18, 1.46),
        (0.07, 1.5),
        (0.07, 1.55),
        (0.1, 1.6),
        (0.11, 1.68),
        (0.08, 1.77),
        (0, 1.8),
    ]
    random = np.random.default_rng(6)
    leather = principled("Leather", (0.16, 0.07, 0.03), Roughness=0.4)
    for n in range(14):
        color = random.uniform(0.06, 0.45, 3)
        cloth = principled(f"Coat {n}", tuple(color), Roughness=0.9)
        x, y = random.uniform(-4.4, 4.4), random.uniform(3, 30)
        data = lathe(f"Person {n}", body, 32, cloth)
        add(f"Person.{n:03}", data, (x, y, 0), scale=(1, 0.7, random.uniform(0.92, 1.06)))
        if n % 2:
            add(
                f"Case.{n:03}",
                box(f"Case {n}", (-0.3, -0.1, 0), (0.3, 0.1, 0.42), leather),
                (x + 0.5, y - 0.1, 0),
                (0, 0, random.uniform(-1, 1)),
            )


def lamps():
    """Four rows of 16 globes on rods. Their light is warm, one in nine is a little colder."""
    globe = ball("Globe", 0.12, emission("Globe", (1, 0.8, 0.52), 9), 32)
    rod = lathe(
        "Rod",
        [(0, 0.12), (0.012, 0.12), (0.012, 2.6), (0, 2.6)],
        12,
        principled("Rod", (0.2, 0.15, 0.08), Metallic=1.0, Roughness=0.4),
    )
    for n in range(LAMPS):
        row, k = divmod(n, 16)
        x, y, z = (-7.2, -2.4, 2.4, 7.2)[row], 2 * k + 0.6, (3.6 if row in (0, 3) else 4.7)
        warm = (1, 0.9, 0.78) if n % 9 == 4 else (1, 0.74, 0.45)
        emitter(f"Globe.{n:03}", globe, (x, y, z))
        add(f"Rod.{n:03}", rod, (x, y, z), scale=(1, 1, 1.5 if row in (1, 2) else 2.2))
        lamp(f"Lamp.{n:03}", 'POINT', 42, (x, y, z), color=warm, shadow_soft_size=0.12)


def make(folder):
    start(exposure=0.6)
    world((0.01, 0.014, 0.03), 1.0)
    architecture()
    furniture()
    people()
    lamps()
    flight((1.2, -2.6, 1.9), (0.2, -1.4, 2.0), (-0.4, 14, 2.6), (-0.2, 15, 2.7), 24)
    save("night_hall", folder)
