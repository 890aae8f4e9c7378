"""Simple triangle meshes, and a function that combines them into a `light_meshes.scene.description.Scene`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from light_meshes.scene.description import Camera, Geometry, Light, Material, Object, Scene, Settings

IDENTITY = np.eye(4)
GREY = Material("grey")


@dataclass(frozen=True)
class Mesh:
    vertices: np.ndarray  # (n,3)
    triangles: np.ndarray  # (t,3) counter-clockwise from outside
    normals: np.ndarray | None = None  # (t,3,3); None: flat


@dataclass(frozen=True)
class Part:
    """An object of the scene: one mesh with one or several instances."""

    mesh: Mesh
    material: Material = GREY
    name: str = "object"
    matrices: Sequence[np.ndarray] = (IDENTITY,)
    visible: dict[str, bool] = field(default_factory=dict)  # the flags of scene.Object


def box(low: Sequence[float], high: Sequence[float]) -> Mesh:
    corners = np.array([[(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]]
                        for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))


def rectangle(low: Sequence[float], high: Sequence[float], z: float) -> Mesh:
    """Return a rectangle that faces +z."""
    (x0, y0), (x1, y1) = low, high
    vertices = np.array([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], float)
    return Mesh(vertices, np.array([(0, 1, 2), (0, 2, 3)]))


def cylinder(radius: float, z0: float, z1: float, sides: int) -> Mesh:
    """Return a closed prism around the z axis."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], 1)
    bottom, top = np.c_[ring, np.full(sides, z0)], np.c_[ring, np.full(sides, z1)]
    vertices = np.vstack([bottom, top, [(0, 0, z0), (0, 0, z1)]])
    a, b = np.arange(sides), (np.arange(sides) + 1) % sides
    low, high = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    return Mesh(vertices, np.vstack([
        np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1),
        np.stack([low, b, a], 1), np.stack([high, a + sides, b + sides], 1),
    ]))


def sphere(radius: float, segments: int = 32, rings: int = 16, smooth: bool = True) -> Mesh:
    """Return a sphere around the origin, with its poles on z."""
    theta = np.pi * np.arange(1, rings) / rings
    phi = 2 * np.pi * np.arange(segments) / segments
    t, p = np.meshgrid(theta, phi, indexing="ij")
    unit = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1).reshape(-1, 3)
    unit = np.vstack([unit, [(0, 0, 1), (0, 0, -1)]])
    top, bottom = len(unit) - 2, len(unit) - 1
    triangles = []
    for s in range(segments):
        e = (s + 1) % segments
        triangles.append((top, s, e))
        for k in range(rings - 2):
            a, b, c, d = k * segments + s, (k + 1) * segments + s, (k + 1) * segments + e, k * segments + e
            triangles += [(a, b, c), (a, c, d)]
        last = (rings - 2) * segments
        triangles.append((bottom, last + e, last + s))
    t = np.array(triangles)
    return Mesh(unit * radius, t, unit[t] if smooth else None)


def move(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def scale(x: float, y: float, z: float) -> np.ndarray:
    return np.diag([x, y, z, 1.0])


def turn_x(angle: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return matrix


def turn_z(angle: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return matrix


def look_at(eye: Sequence[float], target: Sequence[float], degrees: float, width: int, height: int,
            **more: Any) -> Camera:
    """Return a perspective camera; `degrees` is the angle over the longer side, as in Blender."""
    half = np.tan(np.radians(degrees) / 2) / max(width, height)
    window = (-half * width, half * width, -half * height, half * height)
    return Camera(camera_matrix(eye, target), window, width, height, **more)


def look_down(x: float, y: float, size: float, pixels: int, height: float = 10.0, **more: Any) -> Camera:
    """Return an orthographic camera above the square of edge `size` around (x, y), looking down."""
    s = size / 2
    return Camera(move(x, y, height), (-s, s, -s, s), pixels, pixels, perspective=False, **more)


def camera_matrix(eye: Sequence[float], target: Sequence[float]) -> np.ndarray:
    eye, target = np.asarray(eye, float), np.asarray(target, float)
    back = (eye - target) / np.linalg.norm(eye - target)
    up = np.array([0.0, 1.0, 0.0]) if abs(back[2]) > 0.9999 else np.array([0.0, 0.0, 1.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :4] = np.stack([right, np.cross(back, right), back, eye], 1)
    return matrix


def assemble(parts: Sequence[Part], camera: Camera, lights: Sequence[Light],
             settings: Settings | None = None, **more: Any) -> Scene:
    materials = tuple({p.material: None for p in parts})
    meshes = list({id(p.mesh): p.mesh for p in parts}.values())
    place = {id(m): n for n, m in enumerate(meshes)}
    used: dict[int, Material] = {}
    for p in parts:  # because a triangle's material belongs to the mesh
        if used.setdefault(place[id(p.mesh)], p.material) != p.material:
            raise ValueError(f"{p.name}: one mesh has one material here")
    counts = np.array([(len(m.vertices), len(m.triangles)) for m in meshes], int).reshape(-1, 2)
    starts = np.cumsum(counts, 0) - counts
    geometry = Geometry(
        vertices=_stack([m.vertices for m in meshes], (0, 3), np.float32),
        triangles=_stack([m.triangles for m in meshes], (0, 3), np.int32),
        corner_normals=_stack([_normals(m) for m in meshes], (0, 3, 3), np.float32),
        uvs=np.zeros((0, 3, 2), np.float32),
        triangle_materials=np.repeat(np.array([materials.index(used[n]) for n in range(len(meshes))], np.int32),
                                     counts[:, 1]),
        meshes=np.stack([starts[:, 0], counts[:, 0], starts[:, 1], counts[:, 1]], 1).astype(np.int64),
        instance_mesh=np.array([place[id(p.mesh)] for p in parts for _ in p.matrices], np.int32),
        instance_object=np.array([n for n, p in enumerate(parts) for _ in p.matrices], np.int32),
        instance_matrix=_stack([np.asarray(p.matrices, float) for p in parts], (0, 4, 4), np.float64),
    )
    objects = tuple(Object(p.name, **p.visible) for p in parts)
    return Scene(camera, geometry, tuple(lights), materials or (GREY,), objects=objects,
                 settings=settings or Settings(), **more)


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


def _stack(arrays: list[np.ndarray], empty: tuple[int, ...], dtype: type) -> np.ndarray:
    arrays = [a for a in arrays if len(a)]
    return np.concatenate(arrays).astype(dtype) if arrays else np.zeros(empty, dtype)


def _normals(mesh: Mesh) -> np.ndarray:
    if mesh.normals is not None:
        return mesh.normals
    if not len(mesh.triangles):
        return np.zeros((0, 3, 3))
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    with np.errstate(all="ignore"):
        n = np.cross(b - a, c - a)
        n /= np.linalg.norm(n, axis=1, keepdims=True)
    return np.repeat(np.nan_to_num(n)[:, None], 3, 1)
