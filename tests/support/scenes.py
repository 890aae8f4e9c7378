"""The scenes for tests, described with the engine's dataclasses: without Blender and without files.

The names S2, S3, … and H1, H12, … are those of docs/scenes.md; lengths are in metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from light_meshes import (
    Camera,
    Light,
    Material,
    Scene,
    Settings,
    Shape,
    box,
    cylinder,
    rectangle,
    rotate_z,
    scale,
    sphere,
    translate,
)
from light_meshes.picture.render import render_image
from light_meshes.scene.description import LIGHT_TYPES

IDENTITY = np.eye(4)
GREY = Material("grey")
WHITE = Material("white", Od=(1.0, 1.0, 1.0), ka=0.0)


def settings(**values: Any) -> Settings:
    """Return settings with one ray through the centre of each pixel and no reflections, unless a test overrides
    them.
    """
    return replace(Settings(mode="RAY_CASTING", samples=1, filter_size=0.0), **values)


def look_down(x: float, y: float, size: float, pixels: int, height: float = 10.0, **more: Any) -> Camera:
    """Return an orthographic camera above the square of edge `size` around (x, y), looking down."""
    return Camera.orthographic((x, y, height), (x, y, height - 1), size, pixels, pixels, **more)


def joined(a: Scene, b: Scene) -> Scene:
    """Return scene a with the objects of b added."""
    ga, gb = a.geometry, b.geometry
    return replace(a, objects=a.objects + b.objects, materials=a.materials + b.materials, geometry=replace(
        ga, vertices=np.concatenate([ga.vertices, gb.vertices]),
        triangles=np.concatenate([ga.triangles, gb.triangles]),
        corner_normals=np.concatenate([ga.corner_normals, gb.corner_normals]),
        triangle_materials=np.concatenate([ga.triangle_materials,
                                           gb.triangle_materials + np.int32(len(a.materials))]),
        meshes=np.concatenate([ga.meshes, np.add(gb.meshes, (len(ga.vertices), 0, len(ga.triangles), 0))]),
        instance_mesh=np.concatenate([ga.instance_mesh, gb.instance_mesh + np.int32(len(ga.meshes))]),
        instance_object=np.concatenate([ga.instance_object, gb.instance_object + np.int32(len(a.objects))]),
        instance_matrix=np.concatenate([ga.instance_matrix, gb.instance_matrix])))


def with_lights(scene: Scene, *lights: Light) -> Scene:
    return replace(scene, lights=lights)


def with_objects(scene: Scene, **flags: dict[str, bool]) -> Scene:
    """Return the scene with these flags for objects, by their names."""
    assert set(flags) <= {o.name for o in scene.objects}
    return replace(scene, objects=tuple(replace(o, **flags.get(o.name, {})) for o in scene.objects))


def all_objects(scene: Scene, **flags: bool) -> Scene:
    return replace(scene, objects=tuple(replace(o, **flags) for o in scene.objects))


def all_materials(scene: Scene, **flags: bool) -> Scene:
    return replace(scene, materials=tuple(replace(m, **flags) for m in scene.materials))


def all_lights(scene: Scene, **values: Any) -> Scene:
    return with_lights(scene, *(replace(light, **values) for light in scene.lights))


def combined(scene: Scene) -> np.ndarray:
    """Return the picture, RGB in float64."""
    return render_image(scene).passes["Combined"][..., :3].astype(float)


def placed(scene: Scene, size: float, offset: Sequence[float]) -> Scene:
    """Return the scene enlarged by `size` and then moved by `offset`, including its lattice, camera and the lights'
    energy.
    """
    return moved(scene, translate(*offset) @ scale(size, size, size), size)


def moved(scene: Scene, T: np.ndarray, size: float = 1.0) -> Scene:
    """Return the scene transformed by T (4,4), which may rotate, mirror and move, and enlarged by `size`. Only the
    lattice's axes stay.

    If T mirrors, the camera is mirrored too, so the picture's columns are reversed.
    """
    turn = T[:3, :3] / size
    camera, s = scene.camera, scene.settings
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ camera.matrix[:3, :3] @ np.diag([np.sign(np.linalg.det(turn)), 1, 1])
    matrix[:3, 3] = at(T, camera.matrix[:3, 3])
    window = camera.window if camera.perspective else tuple(size * w for w in camera.window)
    lights = [replace(
        light, position=_triple(at(T, light.position)), direction=_triple(turn @ light.direction),
        radius=size * light.radius, area_u=_triple(T[:3, :3] @ light.area_u), area_v=_triple(T[:3, :3] @ light.area_v),
        soft_radius=size * light.soft_radius, reference_distance=size * light.reference_distance,
        intensity=light.intensity if light.type == "SUN" else tuple(c * size**2 for c in light.intensity))
        for light in scene.lights]
    return replace(
        scene, lights=tuple(lights),
        camera=replace(camera, matrix=matrix, window=window, clip_start=camera.clip_start * size),
        geometry=replace(scene.geometry, instance_matrix=T @ scene.geometry.instance_matrix),
        settings=replace(s, h=s.h * size, lattice_origin=_triple(at(T, s.lattice_origin))))


def _triple(v: np.ndarray) -> tuple[float, float, float]:
    x, y, z = np.asarray(v, float).tolist()
    return x, y, z


def at(T: np.ndarray, p: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return points (…,3) transformed by the matrix T."""
    return np.asarray(p, float) @ T[:3, :3].T + T[:3, 3]


def point(position: Sequence[float], intensity: float = 10.0, name: str = "point", **more: Any) -> Light:
    return Light(name, "POINT", (intensity,) * 3, position=tuple(position), **more)


def sun(direction: Sequence[float], intensity: float = 1.0, **more: Any) -> Light:
    d = np.asarray(direction, float)
    return Light("sun", "SUN", (intensity,) * 3, direction=tuple((d / np.linalg.norm(d)).tolist()), **more)


# --- The paper's ------------------------------------------------------------------------------------------

S2_PLATE = ((0, -2, 0.9), (2, 2, 1))
S2_FLOOR = ((-4, -4), (4, 4), 0.0)
S2_POST = ((-1.0, -0.2, 0), (-0.9, 0.2, 0.4))


def light_leak(width: int = 200, **values: Any) -> Scene:
    """S2 (Fig. 2): a plate lit from above, a second light low on its left, and a post in front of that light on the
    floor.
    """
    parts = [Shape(box(*S2_PLATE), GREY, "plate"), Shape(rectangle(*S2_FLOOR), GREY, "floor"),
             Shape(box(*S2_POST), GREY, "post")]
    lights = [point((1, 0, 4), name="above"), point((-2, 0, 0.5), name="low")]
    camera = Camera.look_at((-1, -6, 4), (0.3, 0, 0.6), 50, width, width)
    return Scene.from_shapes(parts, camera, lights, settings(**values))


TABLETOP = ((-2, -2, -0.2), (2, 2, 0))
BAR = ((0.3, -0.125, 1.2), (1.7, 0.125, 1.45))
CYLINDER = (0.6, 0.35, 1.75, 96)
S3_LIGHT = (2.2, -1.8, 4.0)
S3_EYE, S3_TARGET, S3_DEGREES = (4.2, -4.6, 3.4), (0, 0, 0.6), 40


def tabletop(width: int = 200, **values: Any) -> Scene:
    """S3 (Fig. 3): a cylinder hanging over a tabletop, with a bar sealed into it."""
    values = {"h": 0.05, "kI": 3.0} | values
    parts = [Shape(box(*TABLETOP), Material("tabletop", Od=(0.7, 0.6, 0.5)), "tabletop"),
             Shape(cylinder(*CYLINDER), Material("cylinder", Od=(0.6, 0.6, 0.7)), "cylinder"),
             Shape(box(*BAR), Material("bar", Od=(0.8, 0.5, 0.3)), "bar")]
    return Scene.from_shapes(parts, Camera.look_at(S3_EYE, S3_TARGET, S3_DEGREES, width, width),
                             [point(S3_LIGHT, 20.0)], settings(**values), world_color=(0.05, 0.05, 0.05))


def bar_shadow(h: float, r: float, width: int = 160, **values: Any) -> Scene:
    """S6 (Fig. 6): S3 with the camera cropped to the end of the bar's shadow, for a step h and a radius r."""
    scene = tabletop(h=h, kI=r / h, **values)
    whole = 8 * width  # the crop is an eighth of the frame
    middle = project(scene, _shadow_of((1.7, 0.0, 1.325)))
    x0, y0 = (int(c * whole - width / 2) for c in middle)
    camera = Camera.look_at(S3_EYE, S3_TARGET, S3_DEGREES, whole, whole, crop=(x0, y0, x0 + width, y0 + width))
    return replace(scene, camera=camera)


def _shadow_of(p: Sequence[float]) -> np.ndarray:
    """Return where the shadow of p from S3's light falls on the tabletop."""
    light, p = np.array(S3_LIGHT), np.asarray(p, float)
    return light + (p - light) * light[2] / (light[2] - p[2])


def project(scene: Scene, p: Sequence[float]) -> tuple[float, float]:
    """Return the place (x, y) of a world point in the frame, 0..1, y up; only for perspective cameras."""
    camera = scene.camera
    x, y, z = (np.linalg.inv(camera.matrix) @ np.append(p, 1.0))[:3]
    left, right, bottom, top = camera.window
    return (x / -z - left) / (right - left), (y / -z - bottom) / (top - bottom)


# --- Shadows with a known answer --------------------------------------------------------------------------

def edge(kI: float = 3.0, h: float = 0.1, beta: float = np.pi / 2, pixels: int = 64, size: float | None = None,
         light_radius: float = 0.0, **values: Any) -> Scene:
    """H12: a half-plane casts a straight shadow edge along x = 0; the lit side is x > 0.

    `beta` is the angle between the shadow plane and the receiver on the lit side: at 90° the plane is upright; with
    less, it leans over the lit side, towards the light.
    """
    top = 4.0
    x = top / np.tan(beta)  # seen along the light, the occluder's edge is above the shadow's edge
    parts = [Shape(rectangle((-60, -60), (60, 60), 0.0), WHITE, "floor"),
             Shape(rectangle((-60 + x, -60), (x, 60), top), WHITE, "occluder")]
    light = (sun((-1 / np.tan(beta), 0, -1)) if not light_radius
             else point((2 * x, 0, 2 * top), radius=light_radius))
    return Scene.from_shapes(parts, look_down(0.0, 0.0, size or 2.5 * h * kI / np.sin(beta), pixels, height=top / 2),
                             [light], settings(h=h, kI=kI, **values))


def strip(width: float, kI: float = 4.0, h: float = 0.1, **values: Any) -> Scene:
    """H12: a strip of this width along y, above x = 0, straight under the sun."""
    parts = [Shape(rectangle((-30, -30), (30, 30), 0.0), WHITE, "floor"),
             Shape(rectangle((-width / 2, -30), (width / 2, 30), 4.0), WHITE, "strip")]
    return Scene.from_shapes(parts, look_down(0.0, 0.0, 3 * h * kI, 64, height=2.0), [sun((0, 0, -1))],
                             settings(h=h, kI=kI, **values))


def wall(**values: Any) -> Scene:
    """H1: a wall a fifth of h thick on a floor, and a light on its left (−x)."""
    parts = [Shape(rectangle((-5, -5), (5, 5), 0.0), WHITE, "floor"),
             Shape(box((-0.01, -5, -1), (0.01, 5, 3)), WHITE, "wall")]
    return Scene.from_shapes(parts, look_down(0.0, 0.0, 2.0, 64), [point((-2, 0, 1))], settings(h=0.1, **values))


def low_plate(**values: Any) -> Scene:
    """H5: a plate .2h above a floor, under a light."""
    parts = [Shape(rectangle((-5, -5), (5, 5), 0.0), WHITE, "floor"),
             Shape(box((-1, -1, 0.02), (1, 1, 0.04)), WHITE, "plate")]
    return Scene.from_shapes(parts, Camera.look_at((3, -3, 2), (0.5, -0.5, 0), 40, 64, 64), [point((0.5, 0.3, 3))],
                             settings(h=0.1, **values))


# --- General ----------------------------------------------------------------------------------------------

def four_lights(width: int = 96, **values: Any) -> Scene:
    """Return a small still life with a glossy ball, under one coloured light of each type."""
    ball = Material("ball", Od=(0.2, 0.5, 0.7), ks=0.4, nShiny=30.0)
    parts = [Shape(rectangle((-3, -3), (3, 3), 0.0), GREY, "floor"),
             Shape(sphere(0.6, 24, 12), ball, "ball", [translate(-0.6, 0.3, 0.65)]),
             Shape(box((0.3, -0.4, 0.0), (0.9, 0.4, 1.1)), Material("box", Od=(0.7, 0.3, 0.2)), "box")]
    lights = [
        Light("point", "POINT", (4.0, 3.0, 2.0), position=(1.5, -2.0, 3.0), radius=0.1),
        sun((0.4, 0.3, -1.0), 0.3, angle=0.05),
        Light("spot", "SPOT", (2.0, 8.0, 4.0), position=(-2.0, -1.5, 2.5), direction=_unit((2.0, 1.6, -2.4)),
              spot_angle=0.9, spot_blend=0.3, radius=0.05),
        Light("area", "AREA", (6.0, 2.0, 6.0), position=(0.2, 2.2, 2.2), direction=_unit((0.0, -2.0, -2.0)),
              area_u=(0.3, 0.0, 0.0), area_v=(0.0, 0.14, -0.14)),
    ]
    return Scene.from_shapes(parts, Camera.look_at((2.5, -4.5, 3.0), (0, 0, 0.4), 40, width, width), lights,
                             settings(**({"h": 0.08} | values)), world_color=(0.02, 0.03, 0.05))


def hall(lights: int = 16, columns: int = 4, sides: int = 24, width: int = 96, **values: Any) -> Scene:
    """S7: a hall of columns² instanced columns and balls under point lights.

    Each place has 4·sides + 2·sides·(sides/2 − 1) triangles: columns=12, sides=48 makes about 0.34 million.
    """
    places = [(4.0 * i / columns - 2.0 + 2.0 / columns, 4.0 * j / columns - 2.0 + 2.0 / columns)
              for i in range(columns) for j in range(columns)]
    step = 4.0 / columns
    parts = [Shape(box((-2.2, -2.2, -0.1), (2.2, 2.2, 0.0)), GREY, "floor"),
             Shape(box((-2.3, -2.2, 0.0), (-2.2, 2.2, 2.0)), Material("left", Od=(0.7, 0.4, 0.3)), "left wall"),
             Shape(box((-2.2, 2.2, 0.0), (2.2, 2.3, 2.0)), Material("back", Od=(0.3, 0.5, 0.7)), "back wall"),
             Shape(cylinder(0.12 * step, 0.0, 1.2, sides), GREY, "columns", [translate(x, y, 0) for x, y in places]),
             Shape(sphere(0.16 * step, sides, sides // 2), Material("ball", Od=(0.7, 0.7, 0.3)), "balls",
                   [translate(x + 0.33 * step, y - 0.3 * step, 0.17 * step) @ scale(1, 1, 0.9) for x, y in places])]
    random = np.random.default_rng(7)
    where = random.uniform((-2.0, -2.0, 1.6), (2.0, 2.0, 2.4), (lights, 3))
    colour = random.uniform(0.5, 1.0, (lights, 3)) * 6.0 / lights
    sources = [Light(f"light {n}", "POINT", tuple(c), position=tuple(p))
               for n, (p, c) in enumerate(zip(where.tolist(), colour.tolist(), strict=True))]
    return Scene.from_shapes(parts, Camera.look_at((3.6, -4.6, 3.6), (0, 0, 0.3), 45, width, width), sources,
                             settings(**({"h": 0.05, "kI": 2.0} | values)))


def random_scene(seed: int, h: float, kI: float, lights: int, **values: Any) -> Scene:
    """Return a floor with a few rotated boxes and prisms, some of them thin or touching, and lights of every type."""
    random = np.random.default_rng(seed)
    parts = [Shape(box((-1.5, -1.5, -0.1), (1.5, 1.5, 0.0)), GREY, "floor")]
    for n in range(random.integers(2, 6)):
        size = random.uniform(0.05, 0.5, 3)
        mesh = (box(-size, size), cylinder(size[0], -size[2], size[2], 7))[n % 2]
        where = random.uniform((-1.0, -1.0, -0.1), (1.0, 1.0, 0.9))
        tilt = np.eye(4)
        tilt[:3, :3] = np.linalg.qr(random.normal(size=(3, 3)))[0]  # it may mirror, which is a negative scale
        parts.append(Shape(mesh, Material(f"material {n}", Od=tuple(random.uniform(0.2, 0.9, 3).tolist()),
                                          ks=float(random.uniform(0, 0.5)), nShiny=float(random.uniform(2, 60))),
                           f"thing {n}", [translate(*where) @ rotate_z(random.uniform(0, 6)) @ tilt]))
    return Scene.from_shapes(parts, Camera.look_at((2.4, -2.9, 2.2), (0, 0, 0.2), 45, 20, 20),
                             [_random_light(random, n) for n in range(lights)], settings(h=h, kI=kI, **values),
                             world_color=(0.1, 0.2, 0.3))


def _random_light(random: np.random.Generator, n: int) -> Light:
    position = random.uniform((-2.5, -2.5, 0.8), (2.5, 2.5, 3.0))
    return Light(f"light {n}", LIGHT_TYPES[n % 4], tuple(random.uniform(0.2, 3.0, 3).tolist()),
                 position=tuple(position.tolist()),
                 direction=_unit(random.uniform((-0.5, -0.5, -0.1), (0.5, 0.5, 0.2)) - position),
                 spot_angle=float(random.uniform(0.3, 1.5)), spot_blend=float(random.uniform(0, 1)))


def _unit(v: Sequence[float]) -> tuple[float, float, float]:
    v = np.asarray(v, float)
    return tuple((v / np.linalg.norm(v)).tolist())
