"""The edge of a forest: 25 trees with 4,000 leaf cards each, which are one mesh of four and its instances; grass."""

from math import pi, radians

import numpy as np
from common import add, concrete, flight, grid, lamp, leaf, mesh, noise, principled, save, sky, start, textured, tube

TREES, CARDS = 25, 4000  # 100,000 cards
KINDS = 4


def cards(name, centres, sizes, material, seed, up=0.35):
    """Return a mesh of square cards with UVs, turned at random."""
    random = np.random.default_rng(seed)
    n = len(centres)
    along = random.normal(size=(n, 3)) + np.array([0, 0, up])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, random.normal(size=(n, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along, across = along * sizes[:, None], across * sizes[:, None] / 2
    corners = np.stack([centres - across, centres + across, centres + across + along, centres - across + along], 1)
    made = mesh(name, corners.reshape(-1, 3).tolist(), np.arange(4 * n).reshape(-1, 4).tolist(), material)
    made.uv_layers.new(name="UVMap").data.foreach_set(
        "uv", np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32), (n, 1)).ravel()
    )
    return made


def tree(kind, material, bark):
    """Return the meshes of a tree: trunk, branches, crown."""
    random = np.random.default_rng(100 + kind)
    height = random.uniform(6.5, 9.5)
    lean = random.uniform(-0.35, 0.35, 2)
    trunk = [(lean[0] * t * t, lean[1] * t * t, height * 0.8 * t) for t in np.linspace(0, 1, 9)]
    parts, tips = [tube(f"Trunk {kind}", trunk, 0.13, bark)], []
    for n in range(16):
        t, turn = random.uniform(0.35, 1.0), random.uniform(0, 2 * pi)
        length = (1.3 - 0.75 * t) * random.uniform(1.6, 2.3)
        root = np.array([lean[0] * t * t, lean[1] * t * t, height * 0.8 * t])
        tip = root + length * np.array([np.cos(turn), np.sin(turn), random.uniform(0.25, 0.8)])
        parts.append(
            tube(f"Branch {kind}.{n}", [root, (root + tip) / 2 - np.array([0, 0, 0.08 * length]), tip], 0.03, bark, 6)
        )
        tips += [(root + tip) / 2, tip, tip + np.array([0, 0, 0.3])]
    tips = np.array(tips)
    centres = tips[random.integers(0, len(tips), CARDS)] + random.normal(size=(CARDS, 3)) * (0.42, 0.42, 0.34)
    return [*parts, cards(f"Crown {kind}", centres, random.uniform(0.16, 0.3, CARDS), material, kind)]


def trees():
    twig = textured("Twig", leaf("Twig"), alpha=True, Roughness=0.6)
    bark = principled("Bark", (0.13, 0.09, 0.06), Roughness=0.95)
    kinds = [tree(k, twig, bark) for k in range(KINDS)]
    random = np.random.default_rng(7)
    for n in range(TREES):
        row, k = divmod(n, 5)
        x, y = -12 + 6 * k + random.uniform(-1.8, 1.8), 9 + 4.2 * row + random.uniform(-1.4, 1.4)
        turn, size = random.uniform(0, 2 * pi), random.uniform(0.85, 1.2)
        for part in kinds[n % KINDS]:
            add(f"{part.name}.{n:03}", part, (x, y, hill(x, y)), (0, 0, turn), (size,) * 3)


def hill(x, y):
    return 0.35 * np.sin(0.28 * x + 1) * np.cos(0.2 * y) + 0.03 * y


def meadow():
    soil = textured("Soil", concrete("Soil", (0.12, 0.15, 0.05)), Roughness=1.0)
    add("Meadow", grid("Meadow", np.linspace(-40, 40, 161), np.linspace(-12, 60, 145), hill, soil))
    blades = principled("Grass", (0.13, 0.23, 0.05), Roughness=0.7)
    random, n = np.random.default_rng(9), 14_000
    spread = noise(128, 8, 5)
    x, y = random.uniform(-9, 9, n), random.uniform(-5.4, 9, n)
    keep = spread[(8 * (y + 6)).astype(int) % 128, (7 * (x + 9)).astype(int) % 128] > 0.25
    x, y = x[keep], y[keep]
    n = len(x)
    length, turn = random.uniform(0.12, 0.4, n), random.uniform(0, 2 * pi, n)
    root = np.stack([x, y, hill(x, y) - 0.02], 1)
    side = np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], 1) * 0.007
    bend = np.stack([-np.sin(turn), np.cos(turn), np.zeros(n)], 1) * (length * random.uniform(0.1, 0.6, n))[:, None]
    tip = root + bend + np.stack([np.zeros(n), np.zeros(n), length], 1)
    corners = np.stack([root - side, root + side, tip], 1).reshape(-1, 3)
    add("Grass", mesh("Grass", corners.tolist(), np.arange(3 * n).reshape(-1, 3).tolist(), blades))


def fence():
    wood = principled("Fence", (0.33, 0.27, 0.2), Roughness=0.9)
    for n in range(9):
        x = -9 + 2.2 * n
        add(
            f"Stake.{n}",
            tube("Stake", [(0, 0, -0.2), (0, 0, 1.15)], 0.055, wood),
            (x, 5.2, hill(x, 5.2)),
            (0, 0.04 * (n % 3 - 1), 0),
        )
    for z in (0.5, 0.95):
        rail = [(-9 + 2.2 * n, 5.2, hill(-9 + 2.2 * n, 5.2) + z) for n in range(9)]
        add(f"Rail.{z}", tube(f"Rail.{z}", rail, 0.035, wood))


def make(folder):
    start(exposure=0.5)
    sky(1.3, clouds=0.6)
    meadow()
    trees()
    fence()
    lamp("Sun", 'SUN', 4.5, (-16, -8, 17), (0, 8, 0), (1.0, 0.9, 0.75), angle=radians(0.53))
    flight((2.2, -6.4, 1.75), (0.9, -5.8, 1.75), (-0.8, 9, 2.7), (-1.0, 9, 2.7), 28)
    save("forest", folder)
