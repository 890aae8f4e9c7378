"""A second implementation of refracted light, simple and slow: one ray at a time through all triangles, and the sphere
in one dimension.

It shares no code with the solver. It uses float64 and world coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from light_meshes import Mesh, Scene, Shape, rectangle
from light_meshes.glass.media import Media, closed
from light_meshes.glass.refraction import Paths, RefractedPaths
from light_meshes.rays.geometry import flatten
from light_meshes.rays.tracer import Targets, Tracer
from scenes import look_down


@dataclass(frozen=True)
class Stuff:
    """The material of a part; a part without one is opaque."""

    n: float = 1.5
    t: Sequence[float] | float = 0.9
    priority: int = 0


class Ray(NamedTuple):
    """A path of light: the points where it bends, its directions, Π t behind each bend, and why it ended."""

    points: np.ndarray  # (k,3)
    directions: np.ndarray  # (k+1,3)
    alpha: np.ndarray  # (k+1,3)
    lengths: np.ndarray  # (k+1,) of each segment; the last one is infinite unless the path ended at total reflection


class Lab:
    """A scene of glass with one light: a point, or a sun's direction."""

    def __init__(self, parts: Sequence[tuple[Shape, Stuff | None]], light: Sequence[float] | None = None,
                 sun: Sequence[float] | None = None, h: float = 0.05) -> None:
        self.parts = list(parts)
        self.light = None if light is None else np.asarray(light, float)
        self.sun = None if sun is None else np.asarray(sun, float) / np.linalg.norm(sun)
        scene = Scene.from_shapes([p for p, _ in parts], look_down(0, 0, 1, 1), [])
        self.solver = solver(scene, [s for _, s in parts], self.targets, h)
        surfaces, _ = flatten(scene)
        owner = scene.geometry.instance_object[surfaces.instance]
        glassy = np.array([s is not None for _, s in parts])[owner]
        # Use the engine's own float32 vertices, because its answers are for this mesh.
        corners = surfaces.centre + surfaces.scale * surfaces.vertices[surfaces.triangles[glassy]].astype(float)
        normals = surfaces.at_corners(scene.geometry.corner_normals, np.flatnonzero(glassy))
        self.owner = owner[glassy]
        self.A, self.B, self.C = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(self.B, self.C)
        self.Ng = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        linear = scene.geometry.instance_matrix[surfaces.instance[glassy], :3, :3]
        inverse = np.linalg.inv(linear).transpose(0, 2, 1)
        self.Ns = np.einsum("nij,nkj->nki", inverse, normals)
        sine = np.linalg.norm(np.cross(self.Ns, self.Ng[:, None]), axis=2)
        self.flat = (sine < 1e-4 * np.linalg.norm(self.Ns, axis=2)).all(1)

    @property
    def targets(self) -> Targets:
        if self.sun is not None:
            return Targets(-self.sun[None], np.array([True]))
        return Targets(self.light[None], np.array([False]))

    def around(self, x: np.ndarray) -> dict[int, int]:
        """Return the objects around x, and how often each."""
        d = np.array([0.36, 0.48, 0.8])
        found: dict[int, int] = {}
        for t, i in zip(*self.hits(x, d), strict=True):
            if t > 0:
                o = int(self.owner[i])
                found[o] = found.get(o, 0) + (1 if self.Ng[i] @ d > 0 else -1)
        return {o: c for o, c in found.items() if c}

    def hits(self, P: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the lengths and triangles of all crossings of a line, in order."""
        with np.errstate(all="ignore"):
            q = np.cross(d, self.C)
            det = (self.B * q).sum(1)
            s = P - self.A
            u = (s * q).sum(1) / det
            r = np.cross(s, self.B)
            v = (r @ d) / det
            t = (self.C * r).sum(1) / det
            index = np.flatnonzero((u >= 0) & (v >= 0) & (u + v <= 1) & np.isfinite(t))
        order = np.argsort(t[index])
        return t[index][order], index[order]

    def index(self, inside: dict[int, int]) -> tuple[float, int]:
        """Return (n, object) of the medium: the highest priority counts; of equal ones the later part."""
        best = max(inside, key=lambda o: (self.parts[o][1].priority, o), default=-1)
        return (1.0, -1) if best < 0 else (self.parts[best][1].n, best)

    def trace(self, P: np.ndarray, d: np.ndarray, inside: dict[int, int] | None = None, most: int = 8) -> Ray:
        inside = dict(self.around(P) if inside is None else inside)
        points, directions, alpha, lengths = [], [d], [np.ones(3)], []
        a, here, start = np.ones(3), P, 1e-9
        while len(points) < most:
            t, index = self.hits(here, d)
            k = np.searchsorted(t, start)
            if k == len(t):
                break
            i, start = index[k], t[k] + 1e-12
            o = int(self.owner[i])
            stuff = self.parts[o][1]
            if stuff.n == 1:
                a = a * stuff.t
                continue
            facing = np.sign(self.Ng[i] @ d)
            n1, top1 = self.index(inside)
            inside[o] = inside.get(o, 0) - int(facing)
            if not inside[o]:
                del inside[o]
            n2, top2 = self.index(inside)
            if top1 == top2:
                continue
            a = a * stuff.t
            if n1 == n2:
                continue
            lengths.append(t[k])
            here = here + t[k] * d
            N = self.Ng[i]
            if not self.flat[i]:
                u, v = np.linalg.lstsq(np.stack([self.B[i], self.C[i]], 1), here - self.A[i], rcond=None)[0]
                N = (1 - u - v) * self.Ns[i, 0] + u * self.Ns[i, 1] + v * self.Ns[i, 2]
                N = N / np.linalg.norm(N)
            N = -facing * N
            cos = -(N @ d)
            sin = n1 / n2 * (d + cos * N)  # the tangential part, Snell's law
            if cos <= 0 or sin @ sin >= 1:
                return Ray(*map(np.array, (points, directions, alpha, lengths)))
            d = sin - np.sqrt(1 - sin @ sin) * N
            if (d @ self.Ng[i]) * facing <= 0:
                return Ray(*map(np.array, (points, directions, alpha, lengths)))
            points.append(here)
            directions.append(d)
            alpha[-1], start = a, 1e-9
            alpha.append(a)
        return Ray(np.array(points), np.array(directions), np.array(alpha), np.array([*lengths, np.inf]))

    def towards(self, y: np.ndarray) -> Ray:
        """Return the light's ray through y."""
        if self.sun is not None:
            return self.trace(y - 20 * self.sun, self.sun, {})
        return self.trace(self.light, (y - self.light) / np.linalg.norm(y - self.light))

    def error(self, x: np.ndarray, arrival: np.ndarray, P: np.ndarray) -> float:
        """Trace a path that should end at x back from x. Returns by how much it misses the light: a length, or an angle
        (sun).
        """
        back = self.trace(x, -arrival)
        if not len(back.points):
            return np.inf
        best = np.inf
        for k, p in enumerate(back.points):  # the light may be in front of the last bend
            d = back.directions[k + 1]
            if self.sun is not None:
                miss = np.linalg.norm(d + self.sun) if k == len(back.points) - 1 else np.inf
            else:
                way = self.light - p
                miss = np.linalg.norm(way - (way @ d) * d) if 0 < way @ d < back.lengths[k + 1] + 1e-9 else np.inf
            best = min(best, miss)
        return max(best, np.linalg.norm(back.points[0] - P))


def solver(scene: Scene, stuff: Sequence[Stuff | None], lights: Targets, h: float) -> RefractedPaths:
    surfaces, _ = flatten(scene)
    owner = scene.geometry.instance_object[surfaces.instance]

    def column(of, other):
        return np.array([other if s is None else of(s) for s in stuff])[owner]

    transparent = column(lambda s: True, False)
    ior = column(lambda s: float(s.n), 1.0)
    media = Media(transparent, closed(surfaces, transparent & (ior != 1)) & transparent, ior,
                  column(lambda s: np.broadcast_to(s.t, 3).astype(float), np.zeros(3)),
                  column(lambda s: s.priority, 0).astype(np.int32))
    rest = surfaces._replace(triangles=surfaces.triangles[~transparent], instance=surfaces.instance[~transparent],
                             source=surfaces.source[~transparent],
                             piece=surfaces.piece[~transparent] if len(surfaces.piece) else surfaces.piece)
    return RefractedPaths(surfaces, media, lights, Tracer(scene, rest), h)


def rotation(seed: int) -> np.ndarray:
    """Return a random rotation, (4,4)."""
    q = np.random.default_rng(seed).normal(size=4)
    w, x, y, z = q / np.linalg.norm(q)
    matrix = np.eye(4)
    matrix[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                      [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                      [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]
    return matrix


def torus(major: float, minor: float, segments: int, sides: int) -> Mesh:
    """Return a smooth torus around z."""
    a, b = np.meshgrid(2 * np.pi * np.arange(segments) / segments, 2 * np.pi * np.arange(sides) / sides, indexing="ij")
    n = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], -1)
    ring = np.stack([np.cos(a), np.sin(a), np.zeros_like(a)], -1)
    i, j = np.meshgrid(np.arange(segments), np.arange(sides), indexing="ij")
    k, m = (i + 1) % segments, (j + 1) % sides
    quad = np.stack([i * sides + j, k * sides + j, k * sides + m, i * sides + m], -1).reshape(-1, 4)
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return Mesh((major * ring + minor * n).reshape(-1, 3), triangles, n.reshape(-1, 3)[triangles])


def sphere_exits(phi: np.ndarray, L: float, n: float) -> tuple[np.ndarray, np.ndarray]:
    """For a unit sphere and a light on the axis at distance L: return where the ray that enters at angle phi leaves,
    and its direction.

    Coordinates are planar: (across, along) the axis.
    """
    y = np.stack([np.sin(phi), np.cos(phi)], -1)
    d = y - np.array([0, L])
    d /= np.linalg.norm(d, axis=-1, keepdims=True)

    def refract(d, N, eta):
        c = -(d * N).sum(-1, keepdims=True)
        return eta * d + (eta * c - np.sqrt(np.maximum(1 - eta**2 * (1 - c * c), 0))) * N

    inner = refract(d, y, 1 / n)
    P = y - 2 * (inner * y).sum(-1, keepdims=True) * inner
    return P, refract(inner, -P, n)


def sphere_roots(x: np.ndarray, L: float, n: float, grid: int = 20000) -> tuple[np.ndarray, np.ndarray]:
    """Return (point, phi) of all paths through the unit sphere to points x (m,2), found by dense bracketing and
    bisection.
    """
    limit = np.arccos(1 / L)
    phi = limit * np.sin(np.linspace(-np.pi / 2, np.pi / 2, grid + 1)) * (1 - 1e-12)

    def side(P, D, x):
        return D[..., 0] * (x[..., 1] - P[..., 1]) - D[..., 1] * (x[..., 0] - P[..., 0])

    P, D = sphere_exits(phi, L, n)
    rows, columns = [], []
    for i in range(0, len(x), 500):
        positive = side(P[None], D[None], x[i:i + 500, None]) > 0
        r, c = np.nonzero(positive[:, 1:] != positive[:, :-1])
        rows.append(r + i)
        columns.append(c)
    row, column = np.concatenate(rows), np.concatenate(columns)
    low, high = phi[column], phi[column + 1]
    first = side(*sphere_exits(low, L, n), x[row]) > 0
    for _ in range(60):
        middle = (low + high) / 2
        same = (side(*sphere_exits(middle, L, n), x[row]) > 0) == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    P, D = sphere_exits(low, L, n)
    ahead = ((x[row] - P) * D).sum(-1) > 0
    return row[ahead], low[ahead]


GLASS = Stuff(1.5, 0.9)
FLOOR = Shape(rectangle((-9, -9), (9, 9), -8.0), name="floor")


def paths(lab: Lab, *x) -> Paths:
    return lab.solver.paths(0, np.array(x, float))[0]


def only(lab: Lab, *x) -> Paths:
    """Return the single path to each x."""
    found = paths(lab, *x)
    assert (np.diff(found.start) == 1).all()
    return found
