"""Scenes in which shadows touch, lean, thin out and pile up, and lamps with a size to light them; and their errors.

`python tests/support/sized_lamps.py [scene …]` prints the table: RMSE of S over the whole receiver against 1,024 rays.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from light_meshes import Light, Mesh, Scene, Shape, box, cylinder, rectangle, rotate_z, sphere, translate
from light_meshes.picture.prepared import Prepared
from light_meshes.rays.camera import camera_rays
from light_meshes.shadows import sized
from light_meshes.shadows.method import Receivers
from scenes import GREY, look_down, settings

HALF = 1.0  # of the square receiver


@pytest.fixture(autouse=True, scope="module")
def nodes_everywhere() -> Iterator[None]:
    """Nodes are asked however few receivers there are: for tests of nodes in small pictures, which import this."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sized, "DENSE", 1e-9)
        yield


def floor() -> Shape:
    return Shape(rectangle((-4, -4), (4, 4), 0.0), GREY, "floor")


def posts(thickness: float = 0.1) -> list[Shape]:
    """Upright posts on the floor, four of them half as thick."""
    places = [(x, y) for x in (-0.6, 0.0, 0.6) for y in (-0.6, 0.0, 0.6)]
    return [floor(), *(Shape(box((x - t / 2, y - t / 2, 0), (x + t / 2, y + t / 2, 0.5)), GREY, f"post {n}")
                        for n, (x, y) in enumerate(places) for t in [thickness / (1 + n % 2)])]


def tabletop() -> list[Shape]:
    """S3's cylinder and bar, smaller."""
    return [floor(), Shape(cylinder(0.3, 0.2, 0.8, 64), GREY, "cylinder"),
            Shape(box((0.15, -0.06, 0.5), (0.8, 0.06, 0.62)), GREY, "bar")]


def boxes(count: int = 60) -> list[Shape]:
    """Clutter: turned boxes on and above the floor."""
    random = np.random.default_rng(3)
    parts = [floor()]
    for n in range(count):
        size = random.uniform(0.02, 0.12, 3)
        x, y = random.uniform(-1, 1, 2)
        z = size[2] if n % 2 else random.uniform(0.1, 0.6)
        parts.append(Shape(box(-size, size), GREY, f"box {n}", [translate(x, y, z) @ rotate_z(random.uniform(0, 3))]))
    return parts


def board() -> list[Shape]:
    """Return a board that leans from the floor at x = −.8 to a height of 1.2 at x = .6, .6 wide."""
    v = np.array([(-0.8, -0.3, 0), (-0.8, 0.3, 0), (0.6, 0.3, 1.2), (0.6, -0.3, 1.2)], float)
    return [floor(), Shape(Mesh(v, np.array([(0, 1, 2), (0, 2, 3)])), GREY, "board")]


def plant(leaves: int = 10000) -> list[Shape]:
    """Return a bush of small leaves, two triangles each."""
    random = np.random.default_rng(5)
    centre = random.normal(0, 1, (leaves, 3))
    centre *= (0.5 * random.uniform(0.2, 1, leaves) ** (1 / 3) / np.linalg.norm(centre, axis=1))[:, None]
    centre[:, 2] = 0.55 + 0.9 * centre[:, 2]
    a, b = random.normal(0, 1, (2, leaves, 3))
    a *= (0.02 / np.linalg.norm(a, axis=1))[:, None]
    b *= (0.01 / np.linalg.norm(b, axis=1))[:, None]
    v = np.stack([centre - a, centre - b, centre + a, centre + b], 1).reshape(-1, 3)
    k = 4 * np.arange(leaves)[:, None]
    t = np.concatenate([k + np.array(which) for which in ((0, 1, 2), (0, 2, 3))])
    return [floor(), Shape(Mesh(v, t), GREY, "plant")]


def curved() -> list[Shape]:
    """Return a hollow of a sphere of radius 3 as the receiver, and two balls above it."""
    n = 97
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, n), np.linspace(-1.5, 1.5, n), indexing="ij")
    v = np.stack([x, y, 3 - np.sqrt(9 - x**2 - y**2)], -1).reshape(-1, 3)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    t = np.concatenate([np.stack([i, i + n, i + n + 1], 1), np.stack([i, i + n + 1, i + 1], 1)])
    return [Shape(Mesh(v, t), GREY, "hollow"), Shape(sphere(0.25), GREY, "ball", [translate(-0.3, 0.2, 0.7)]),
            Shape(sphere(0.1), GREY, "small", [translate(0.4, -0.3, 0.25)])]


def ball() -> list[Shape]:
    """Return a sphere that stands on the floor."""
    return [floor(), Shape(sphere(0.4, 96, 48), GREY, "ball", [translate(0, 0, 0.4)])]


SCENES = {"posts": posts, "thin posts": lambda: posts(0.02), "tabletop": tabletop, "boxes": boxes, "board": board,
          "plant": plant, "curved": curved, "ball": ball}
LAMPS = {
    "sphere": Light("lamp", "POINT", (1.0,) * 3, position=(1.0, 0.7, 2.5), radius=0.3),
    "spot": Light("lamp", "SPOT", (1.0,) * 3, position=(-0.8, 1.0, 2.2), direction=(0.31, -0.39, -0.87),
                  spot_angle=1.5, radius=0.15),
    "rectangle": Light("lamp", "AREA", (1.0,) * 3, position=(0.9, -0.7, 2.4), direction=(0.0, 0.0, -1.0),
                       area_u=(0.4, 0.0, 0.0), area_v=(0.0, 0.2, 0.0)),
    "disc": Light("lamp", "AREA", (1.0,) * 3, position=(-1.0, -0.5, 2.6), direction=(0.0, 0.0, -1.0),
                  area_u=(0.35, 0.0, 0.0), area_v=(0.0, 0.35, 0.0), area_ellipse=True),
    "sun": Light("lamp", "SUN", (1.0,) * 3, direction=(0.48, 0.36, -0.8), angle=0.2),
}


def scene_of(name: str, lamp: str, pixels: int = 160, **values: float) -> Scene:
    """Return the scene from above under the lamp."""
    light = replace(LAMPS[lamp], softness="SIZE")
    return Scene.from_shapes(SCENES[name](), look_down(0, 0, 2 * HALF, pixels, height=1e-3 + 6), [light],
                    settings(**({"h": 0.0125, "kI": 2.0, "shadows": "LIGHT_MESHES"} | values)))


class Seen:
    """What the camera sees of a scene's first object, the receiver, and S of it by several methods."""

    def __init__(self, scene: Scene) -> None:
        self.ready = Prepared(scene)
        camera = scene.camera
        origin, direction, reach = camera_rays(camera, (0, 0, camera.width, camera.height), np.zeros((1, 2)))
        self.hit, hits = self.ready.world.closest("camera", origin, direction, None, reach)
        on = self.ready.world.owner(hits.triangle) == 0
        self.pixel = np.flatnonzero(self.hit)[on]  # of the picture, row by row from below
        self.P, self.triangle = hits.P[on], hits.triangle[on]
        active = np.full((int(on.sum()), 1), (1 << len(scene.lights)) - 1, np.uint64)
        sample = np.stack([self.pixel, np.zeros_like(self.pixel)], axis=1)
        self.at = Receivers(hits.P[on], hits.Ng[on], active, hits.triangle[on], sample=sample)
        self.counts = self.ready.stats.counts

    def by(self, shadows: str, samples: int = 64, **values: float) -> np.ndarray:
        """Return S (n,L) by a method; `samples` rays a light by AREA_SAMPLING."""
        scene = self.ready.scene.with_settings(shadows=shadows, light_samples=samples, seed=1, **values)
        ready = Prepared(scene)
        S = ready.shadowing.method(self.at, lambda: None)[..., 0]
        self.counts = ready.stats.counts
        return S.astype(float)


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(np.mean((a.astype(float) - b) ** 2)))


def table(names: list[str], lamps: list[str], pixels: int, **values: float) -> None:
    """Print it."""
    print(f"{'scene':12} {'lamp':10} {'sharp':>7} {'one r':>7} {'area 4':>7} {'area 16':>7} {'SIZE':>7} | of pairs:"
          f" mixed, by rays | rays a receiver: long, shadow")
    for name in names:
        for lamp in lamps:
            seen = Seen(scene_of(name, lamp, pixels, **values))
            truth, n = seen.by("AREA_SAMPLING", 1024), len(seen.P)
            errors = [rmse(S, truth) for S in (seen.by("SHARP"), one_width(seen), seen.by("AREA_SAMPLING", 4),
                                               seen.by("AREA_SAMPLING", 16), seen.by("LIGHT_MESHES"))]
            c = seen.counts
            print(f"{name:12} {lamp:10} " + " ".join(f"{e:7.4f}" for e in errors) +
                  f" | {c['mixed_pairs'] / n:5.2f} {c['ray_pairs'] / n:5.2f} |"
                  f" {c['long_rays'] / n:6.2f} {c['shadow_rays'] / n:6.2f}", flush=True)


def one_width(seen: Seen) -> np.ndarray:
    """Return S by light meshes of one width, LIGHT_SIZE, with kI = 3."""
    scene = seen.ready.scene
    ready = Prepared(replace(scene, lights=tuple(replace(light, softness="LIGHT_SIZE") for light in scene.lights),
                             settings=replace(scene.settings, shadows="LIGHT_MESHES", weights="SMOOTH", auto_h=True)))
    return ready.shadowing.method(seen.at, lambda: None)[..., 0].astype(float)


if __name__ == "__main__":
    words = [w for w in sys.argv[1:] if "=" not in w]
    options = {k: (int(v) if v.isdigit() else float(v)) for k, v in (w.split("=") for w in sys.argv[1:] if "=" in w)}
    pixels = options.pop("pixels", 160)
    table([w for w in words if w in SCENES] or list(SCENES), [w for w in words if w in LAMPS] or list(LAMPS), pixels,
          **options)
