"""A thousand random scenes of bad meshes: no NaN, no infinity, nothing negative, no additional light. Ten thousand with
HYPOTHESIS_PROFILE=explore.

They have triangles without area, coincident ones, triangles on a line, and needles; faces that share an edge many
times, or coincide; lights on vertices, on faces, in planes, inside solids, on lattice nodes; and every kind of shadow.
"""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from hard_cases import glass
from light_meshes import Camera, Mesh, Scene, Shape, box, rotate_z, scale, translate
from light_meshes.picture.render import render_image
from light_meshes.scene.description import LIGHT_TYPES, Light, Material
from scenes import settings

GRID = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
H = 0.25  # its lattice, where it is not turned, has nodes on the grid's points


def soup(random: np.random.Generator) -> Mesh:
    """Triangles between the points of a grid: many have no area, share edges, or lie on each other."""
    corners = random.choice(GRID, (8, 3))
    if random.random() < 0.3:
        corners[random.integers(8)] += random.normal(size=3) * 10.0 ** random.uniform(-9, -2)
    return Mesh(corners, random.integers(0, 8, (random.integers(1, 24), 3)))


def needles(random: np.random.Generator) -> Mesh:
    n = 6
    a, way = random.uniform(-1, 1, (n, 3)), random.normal(size=(n, 3))
    c = a + 0.5 * way + random.normal(size=(n, 3)) * 10.0 ** random.uniform(-9, -2, (n, 1))
    return Mesh(np.concatenate([a, a + way, c]), np.arange(3 * n).reshape(3, n).T)


def solid(random: np.random.Generator) -> Mesh:
    """A box from the grid: others touch it or stand in the same place, and it may be flat."""
    low, high = np.sort(random.choice(GRID, (2, 3)), axis=0)
    return box(low, high)


def fan(random: np.random.Generator) -> Mesh:
    """Many triangles on one edge."""
    a, b = random.choice(GRID, (2, 3))
    return Mesh(np.vstack([a, b, random.choice(GRID, (6, 3))]), np.array([(0, 1, k) for k in range(2, 8)]))


def material(random: np.random.Generator, n: int) -> Material:
    if random.random() < 0.3:
        t = random.choice([0.0, 0.5, 1.0], 3)
        return replace(glass(tuple(t.tolist()), float(random.choice([1.0, 1.5]))), name=f"glass {n}")
    return Material(f"material {n}", Od=tuple(random.uniform(0, 1, 3).tolist()), ks=float(random.choice([0.0, 0.5])),
                    nShiny=float(random.choice([1.0, 1000.0])), cast_soft_shadows=bool(random.random() < 0.8),
                    receive_soft_shadows=bool(random.random() < 0.8))


def light(random: np.random.Generator, n: int, points: np.ndarray) -> Light:
    where = [random.choice(GRID, 3), points[random.integers(len(points))], random.uniform(-2, 2, 3),
             points[random.integers(0, len(points), 3)].mean(0)][random.integers(4)]
    axis = random.choice([-1.0, 0.0, 1.0], 3) if random.random() < 0.5 else random.normal(size=3)
    size = float(random.choice([0.0, 0.02, 0.1, 4.0], p=[0.3, 0.35, 0.33, 0.02]))
    return Light(f"light {n}", LIGHT_TYPES[random.integers(4)], tuple(random.uniform(0, 2, 3).tolist()),
                 position=tuple(where.tolist()), direction=tuple((axis / max(np.linalg.norm(axis), 1e-9)).tolist()),
                 spot_angle=float(random.uniform(0, np.pi)), spot_blend=float(random.choice([0.0, 0.5, 1.0])),
                 softness=str(random.choice(["SCENE", "RADIUS", "LIGHT_SIZE"])),
                 soft_radius=float(random.choice([0.0, 0.1, 0.6])), radius=size,
                 angle=min(size, 3.0), area_u=tuple((size * random.choice(GRID, 3)).tolist()),
                 reference_distance=float(random.choice([0.0, 1.0])), soft_shadows=bool(random.random() < 0.8),
                 cast_shadow=bool(random.random() < 0.9), receivers=linked(random), blockers=linked(random))


def linked(random: np.random.Generator) -> tuple[int, ...] | None:
    return tuple(np.flatnonzero(random.random(2) < 0.8).tolist()) if random.random() < 0.1 else None


def wild(seed: int) -> Scene:
    random = np.random.default_rng(seed)
    floor = Shape(box((-1.5, -1.5, -0.1), (1.5, 1.5, 0.0)), Material("floor"), "floor")
    parts = [floor] if random.random() < 0.8 else []
    for n in range(random.integers(1, 5)):
        mesh = (soup, needles, solid, fan)[random.integers(4)](random)
        matrices = [[np.eye(4)], [translate(0, 0, 0.5)], [rotate_z(random.uniform(0, 6)), np.eye(4)],
                    [scale(1, 1, 0)], [scale(-1, 1, 1)]][random.integers(5)]
        flags = {name: bool(random.random() < 0.9) for name in ("visible_camera", "visible_shadow")}
        parts.append(Shape(mesh, material(random, n), f"thing {n}", matrices, flags))
    points = np.concatenate([p.mesh.vertices for p in parts])
    lights = [light(random, n, points) for n in range(random.integers(1, 5))]
    full = random.random() < 0.1
    if full:  # with the largest radii the paths of one scene take a minute
        lights = [replace(source, softness="SCENE") for source in lights]
    eye = random.choice(GRID, 3) + 0.02 if random.random() < 0.1 else (2.4, -2.9, 2.2)
    chosen = settings(
        shadows=str(random.choice(["SHARP", "LIGHT_MESHES", "AREA_SAMPLING"], p=[0.25, 0.65, 0.1])), light_samples=4,
        h=H, kI=float(random.choice([0.5, 1.5, 2, 3])),
        weights=str(random.choice(["UNIFORM", "SMOOTH"])), lattice_rotation=bool(random.random() < 0.5),
        refraction="FULL" if full else "VIEW", glass=str(random.choice(["BOUNDED", "PAPER"])),
        leak_free=bool(random.random() < 0.3), caustics=str(random.choice(["PAPER", "FOCUS"])), cutoff=0.1)
    return Scene.from_shapes(parts, Camera.look_at(eye, (0, 0, 0.2), 45, 16, 16), lights, chosen,
                             world_color=(0.1, 0.2, 0.3))


@pytest.mark.slow
@pytest.mark.parametrize("hundred", range(100 if os.environ.get("HYPOTHESIS_PROFILE") == "explore" else 10))
def test_random_scenes_are_finite_and_make_no_light(hundred):
    shadowed = lit = 0
    for seed in range(100 * hundred, 100 * hundred + 100):
        scene = wild(seed)
        result = render_image(scene, ("Combined", "Depth", "Normal", "Shadow"), threads=1)
        for name, pixels in result.passes.items():
            assert np.isfinite(pixels).all(), f"seed {seed}: {name}"
        picture, shadow = result.passes["Combined"], result.passes["Shadow"]
        assert (picture >= 0).all() and (shadow >= 0).all(), f"seed {seed}"
        if "refracted_paths" in result.statistics:
            continue  # refracted light gathers: there may well be more of it
        unshadowed = render_image(scene.with_settings(mode="LOCAL"), threads=1).passes["Combined"]
        assert (picture <= unshadowed * (1 + 1e-6)).all(), f"seed {seed}"
        assert (shadow <= 1 + 1e-6).all(), f"seed {seed}"
        lit += unshadowed.max() > 0.3
        shadowed += (picture < unshadowed - 1e-3).any()
    assert lit > 50 and shadowed > 30
