"""H4, H6, H7 and H8: light inside, through and behind glass, compared with the known answer (see hard_cases.py)."""

from __future__ import annotations

import numpy as np
from hard_cases import UP, Finding, Place, family, glass, off, picture, seen
from light_meshes import Mesh, Scene, Shape, box, rectangle, sphere, translate
from light_meshes.scene.description import Material
from scenes import GREY, WHITE, four_lights, look_down, point, settings, sun

DOWN = (0.0, 0.0, -1.0)
CLEAR = glass(1.0)


def through(parts: list[Shape], light, kind: str, **values) -> Scene:
    """Return a scene of parts under one light; if refracted: FULL, with light meshes of h = .05."""
    shadows = "SHARP" if kind == "sharp" else "LIGHT_MESHES"
    return Scene.from_shapes(parts, look_down(0, 0, 2, 8), [light],
                             settings(**({"h": 0.05, "shadows": shadows, "refraction": "FULL"} | values)))


def scattered(seed: int, low, high, count: int = 60) -> np.ndarray:
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


@family("H4 light inside a box, in a glass sphere", ("sharp", "refracted"))
def enclosed(place: Place, kind: str) -> list[Finding]:
    parts = [Shape(rectangle((-6, -6), (6, 6), -0.5), WHITE, "floor"), Shape(box((-1, -1, 0), (1, 1, 2)), GREY, "box")]
    shut = through(parts, point((0.2, 0.1, 0.9)), kind, h=0.1)
    inside, outside = scattered(0, (-0.99, -0.99, 0), (0.99, 0.99, 0)), scattered(1, (-4, -4, -0.5), (4, 4, -0.5))
    walls = scattered(2, (1, -0.99, 0.01), (1, 0.99, 1.99))
    findings = [
        Finding("inside the box 1", max(off(seen(place, shut, inside, UP), 1.0),
                                        off(seen(place, shut, walls, (-1, 0, 0)), 1.0)), 0.0),
        Finding("outside 0", max(off(seen(place, shut, outside, UP), 0.0),
                                 off(seen(place, shut, walls, (1, 0, 0)), 0.0)), 0.0)]
    t = 0.8
    parts = [Shape(rectangle((-6, -6), (6, 6), -2), WHITE, "floor"), Shape(sphere(1, 48, 24), glass(t), "ball")]
    below = scattered(3, (-3, -3, -2), (3, 3, -2))
    bulb = through(parts, point((0, 0, 0)), kind)
    focused = through(parts, point((0, 0, 0)), "sharp", caustics="FOCUS")
    return [*findings, Finding("at the centre of glass S is t", off(seen(place, bulb, below, UP), t), 1e-6),
            Finding("at the centre of glass J is 1", off(seen(place, focused, below, UP) / t, 1.0), 2e-5)]


def _edge_of_shadow(place: Place, scene: Scene) -> tuple[float, float]:
    """Return the x at which S passes half of its largest value along y = 0 on the floor, and that value."""
    x = np.linspace(-0.6, 0.6, 1201)
    S = seen(place, scene, np.c_[x, 0 * x, 0 * x], UP).reshape(len(x), -1)[:, 0]
    return float(x[np.argmax(S.max() / 2 < S)]), float(S.max())


@family("H6 slab at 45°", ("sharp", "refracted"))
def slab(place: Place, kind: str) -> list[Finding]:
    """An opaque half-plane is over the slab: its shadow on the floor is shifted as much as the slab shifts the
    rays.
    """
    T, t = 0.3, 0.9
    expected = T * (np.tan(np.pi / 4) - np.tan(np.arcsin(np.sin(np.pi / 4) / 1.5)))  # .1396
    shade = Shape(rectangle((-3.0, -5), (-0.8, 5), 0.8), GREY, "shade")
    floor = Shape(rectangle((-5, -5), (5, 5), 0.0), WHITE, "floor")
    plate = Shape(box((-4, -4, 0.2), (4, 4, 0.2 + T)), glass(t), "slab")
    free, free_S = _edge_of_shadow(place, through([floor, shade], sun((1, 0, -1)), kind, kI=2.0))
    bent, bent_S = _edge_of_shadow(place, through([floor, shade, plate], sun((1, 0, -1)), kind, kI=2.0))
    shift, resolved = free - bent, 1.1e-3 if kind == "sharp" else 0.01
    behind = scattered(4, (-2, -2, 0), (2, 2, 0))
    lamp = through([floor, plate], point((0.2, 0.1, 2)), kind, kI=2.0)
    return [Finding("shift along the slab .1396", abs(shift - expected), resolved),
            Finding("shift across the ray .0987", abs(shift * np.sqrt(0.5) - 0.0987), resolved),
            Finding("t²", max(abs(free_S - 1), abs(bent_S - t * t)), 1e-6),
            Finding("one path from a lamp", off(seen(place, lamp, behind, UP), t * t), 1e-6)]


@family("H7 no bending, a core of the same glass", ("sharp", "refracted"))
def same_index(place: Place, kind: str) -> list[Finding]:
    still = four_lights(32)
    still = still.with_settings(shadows="SHARP" if kind == "sharp" else "LIGHT_MESHES")
    air = glass((0.9, 0.8, 0.7), 1.0)
    still = Scene(**{**still.__dict__, "materials": tuple(air if m.name == "ball" else m for m in still.materials)})
    M1, M3 = (picture(place, still.with_settings(refraction=r)) for r in ("NONE", "FULL"))
    floor = Shape(rectangle((-5, -5), (5, 5), -2), WHITE, "floor")
    shell = Shape(sphere(1, 48, 24), glass(0.9), "shell")
    core = Shape(sphere(0.5, 32, 16), CLEAR, "core", [translate(0.1, 0, 0)])
    below = scattered(5, (-2, -2, -2), (2, 2, -2), 200 if kind == "sharp" else 20)
    solid, filled = (seen(place, through(parts, point((0, 0, 4)), kind, kI=1.5), below, UP)
                     for parts in ([floor, shell], [floor, shell, core]))
    return [Finding("index 1: M3 is M1", off(M3, M1), 1e-6),
            Finding("core of the same glass", off(filled, solid), 1e-6)]


def _prism() -> Mesh:
    """The legs are z = 0 and x = 0; the hypotenuse goes from (1, ·, 0) to (0, ·, 1)."""
    corners = np.array([(0, 0), (1, 0), (0, 1)], float)
    vertices = np.vstack([np.c_[corners, np.full(3, -2)], np.c_[corners, np.full(3, 2)]])[:, [0, 2, 1]]
    return Mesh(vertices, np.array([(0, 1, 2), (5, 4, 3), (0, 3, 4), (0, 4, 1), (1, 4, 5), (1, 5, 2), (2, 5, 3),
                                    (2, 3, 0)]))


@family("H8 prism, light under water", ("sharp", "refracted"))
def total_reflection(place: Place, kind: str) -> list[Finding]:
    ceiling = Shape(rectangle((-4, -4), (4, 4), 2.0), WHITE, "ceiling")
    prism = through([ceiling, Shape(_prism(), glass(), "prism")], sun((0, 0, 1)), kind, kI=2.0)
    dark, lit = scattered(6, (0.15, -1, 2), (0.85, 1, 2)), scattered(7, (1.2, -1, 2), (3, 1, 2))
    findings = [Finding("0 behind the hypotenuse", off(seen(place, prism, dark, DOWN), 0.0), 0.0),
                Finding("1 beside the prism", off(seen(place, prism, lit, DOWN), 1.0), 1e-6)]
    water = Material("water", Od=(0, 0, 0), ka=0.0, kd=0.0, kt=(1.0,) * 3, ior=1.33)
    for d, z in ((1.0, 1.0), (0.5, 2.0)):
        parts = [Shape(box((-9, -9, -5), (9, 9, 0)), water, "water"),
                 Shape(rectangle((-4, -4), (4, 4), z), WHITE, "over")]
        above = scattered(8, (-1, -1, z), (1, 1, z), 20)
        paths = seen(place, through(parts, point((0, 0, -d)), kind, kI=1.5), above, DOWN)
        J = seen(place, through(parts, point((0, 0, -d)), "sharp", caustics="FOCUS"), np.array([[0, 0, z]]), DOWN)
        findings += [Finding(f"one path out of water, d = {d}, z = {z}", off(paths, 1.0), 1e-6),
                     Finding(f"J on the axis, d = {d}, z = {z}", off(J, ((d + z) / (d + 1.33 * z)) ** 2), 1e-5)]
    return findings
