"""A second implementation of algorithm Ψ, simple and slow: float64, brute force, directly from docs/method.md §1 and
§2.

It shares no code with the engine. The only thing that it takes from the engine is where the lattice's nodes are, and it
checks that these span a lattice of step h (`Lattice`).

Every yes-or-no question also returns "sure". It is False if the answer depends on less than `margin`, a length a few
times what float32 tracing can resolve. Comparisons skip such receivers, so they need no tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from light_meshes.scene.description import Light, Material, Scene

TAU = 1e-3  # a node nearer than τ·h to P's plane is dropped in step 2
MARGIN = 2e-5  # relative to the extent of scene and lights; rays to a light end 1e-5 of their length before it


class Lattice:
    """The nodes origin + axes·(i, j, k)."""

    def __init__(self, position: Callable[[np.ndarray], np.ndarray]) -> None:
        corners = position(np.vstack([np.zeros((1, 3)), np.eye(3)]).astype(np.int32))
        self.origin, self.axes = corners[0], (corners[1:] - corners[0]).T

    def ball(self, P: np.ndarray, radius: float) -> np.ndarray:
        """Return the indices of all nodes in a box that contains the ball, with one more step on every side."""
        to_index = np.linalg.inv(self.axes)
        middle = to_index @ (P - self.origin)
        reach = radius * np.linalg.norm(to_index, axis=1) + 1.0
        ranges = [np.arange(np.floor(m - e), np.ceil(m + e) + 1) for m, e in zip(middle, reach, strict=True)]
        return np.stack(np.meshgrid(*ranges, indexing="ij"), -1).reshape(-1, 3).astype(np.int64)

    def position(self, nodes: np.ndarray) -> np.ndarray:
        return self.origin + nodes @ self.axes.T


class Hit(NamedTuple):
    P: np.ndarray
    N: np.ndarray  # geometric, turned to the ray's side
    shading: np.ndarray
    material: Material
    distance: float
    triangle: int


class Oracle:
    def __init__(self, scene: Scene, lattice: Lattice | None = None) -> None:
        self.scene, self.lattice = scene, lattice
        self.h = scene.settings.h
        self.triangles, self.corner_normals, self.materials, self.owner = _world(scene)
        self.casts = self._agreed("visible_shadow")
        a, b, c = self.triangles.transpose(1, 0, 2)
        n = np.cross(b - a, c - a)
        self.area = np.linalg.norm(n, axis=1) / 2
        self.n = n / (2 * self.area[:, None])
        lamps = [light.position for light in scene.lights if light.type != "SUN"]
        points = [*self.triangles.reshape(-1, 3), *lamps]
        low, high = np.min(points, 0), np.max(points, 0)
        self.extent = float(np.linalg.norm(high - low))
        self.margin = MARGIN * self.extent

    def _agreed(self, name: str) -> np.ndarray:
        """Return a flag for each triangle: that of its object and, if materials have this flag too, that of its
        material.
        """
        return np.array([getattr(self.scene.objects[o], name) and getattr(m, name, True)
                         for o, m in zip(self.owner, self.materials, strict=True)])

    # --- Segments against all triangles -------------------------------------------------------------------

    def blocked(self, A: np.ndarray, B: np.ndarray, N: np.ndarray | None = None,
                casts: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return (blocked, sure) for each segment A→B (n,3). With N, A lies on a surface with that normal, and B is
        above it.
        """
        casts = self.casts if casts is None else casts
        a = self.triangles[:, 0]
        dA, dB = (np.einsum("nti,ti->nt", X[:, None] - a, self.n) for X in (A, B))
        length = np.linalg.norm(B - A, axis=1)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = np.clip(np.nan_to_num(dA / (dA - dB)), 0, 1)
            # An error across the plane becomes this much larger along it.
            margin = self.margin * (1 + np.minimum(length / np.abs(dA - dB), 1e30))
        Q = A[:, None] + s[..., None] * (B - A)[:, None]
        inside = np.min([np.einsum("nti,ti->nt", Q - self.triangles[:, k], self._inward(k)) for k in range(3)], 0)
        crosses = (dA > self.margin) & (dB < -self.margin) | (dA < -self.margin) & (dB > self.margin)
        beside = (dA > self.margin) & (dB > self.margin) | (dA < -self.margin) & (dB < -self.margin)
        low, high = self.triangles.min(1) - self.margin, self.triangles.max(1) + self.margin
        apart = ((np.minimum(A, B)[:, None] > high) | (np.maximum(A, B)[:, None] < low)).any(-1)
        hit = crosses & (inside > margin) & casts
        miss = beside | apart | (crosses & (inside < -margin)) | ~casts
        if N is not None:
            miss |= (np.abs(dA) <= self.margin) & (np.abs(self.n @ N) > 1 - 1e-9)
            hit &= ~miss
        answer = hit.any(1)
        return answer, answer | miss.all(1)

    def _inward(self, k: int) -> np.ndarray:
        edge = self.triangles[:, (k + 1) % 3] - self.triangles[:, k]
        return np.cross(self.n, edge) / np.linalg.norm(edge, axis=1, keepdims=True)

    def visible(self, X: np.ndarray, light: Light, N: np.ndarray | None = None,
                soft: bool | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return (visible, sure) of the light from each X. If `soft` is given, only the soft casters (True) or the
        sharp ones (False) block.
        """
        if not light.cast_shadow:
            return np.ones(len(X), bool), np.ones(len(X), bool)
        far = X - 4 * self.extent * np.array(light.direction)
        end = far if light.type == "SUN" else np.broadcast_to(light.position, X.shape)
        casts = self.casts.copy()
        if light.blockers is not None:
            casts &= np.isin(self.owner, light.blockers)
        if soft is not None:
            casts &= self._agreed("cast_soft_shadows") == soft
        blocked, sure = self.blocked(X, end, N, casts)
        return ~blocked, sure

    # --- Ψ ------------------------------------------------------------------------------------------------

    def radius(self, light: Light) -> float:
        """Return r of the light. With Light Size it is known only for a sun whose distance is given, because this needs
        no measuring.
        """
        if light.softness == "RADIUS":
            return light.soft_radius
        if light.softness == "LIGHT_SIZE":
            assert light.type == "SUN" and light.reference_distance > 0
            assert self.scene.settings.weights == "UNIFORM"
            return np.sqrt(1.25) * light.reference_distance * np.tan(light.angle / 2)
        return self.h * self.scene.settings.kI

    def interpolation_set(self, P: np.ndarray, N: np.ndarray, r: float | None = None) -> tuple[np.ndarray, bool]:
        """Do steps 1 to 4: return DLM(P) of radius r as lattice indices, and whether every decision was sure."""
        r = self.h * self.scene.settings.kI if r is None else r
        assert self.margin < TAU * self.h, "the scene is too large for h: step 2 could not be decided"
        nodes = self.lattice.ball(P, r)
        x = self.lattice.position(nodes)
        distance, height = np.linalg.norm(x - P, axis=1), (x - P) @ N
        keep = (distance <= r) & (height > TAU * self.h)
        near = (distance <= r + self.margin) & (height > TAU * self.h - self.margin)
        sure = bool((keep == near).all() and
                    ((distance <= r - self.margin) & (height > TAU * self.h + self.margin) == keep).all())
        nodes, x = nodes[keep], x[keep]
        hidden, certain = self.blocked(np.broadcast_to(P, x.shape), x, N)
        return nodes[~hidden], sure and bool(certain.all())

    def faces(self, P: np.ndarray, N: np.ndarray, light: Light) -> tuple[bool, bool]:
        """Return ξ(light, P), and whether it is sure."""
        to = -np.array(light.direction) * self.extent if light.type == "SUN" else np.array(light.position) - P
        height = float(N @ to)
        return height > 0, abs(height) > self.margin

    def soft(self, P: np.ndarray, N: np.ndarray, triangle: int | None = None) -> tuple[np.ndarray, bool]:
        """Return the smoothed visibility of each light.

        It is ξ times the share of DLM(P) that sees the light past the soft casters, times V at P past the sharp ones.
        If the set is empty, or the triangle receives sharp shadows, it is V at P past all casters.
        """
        receives = triangle is None or self._agreed("receive_soft_shadows")[triangle]
        sets: dict[float, tuple[np.ndarray, bool]] = {}
        values, sure = [], True
        for light in self.scene.lights:
            xi, certain = self.faces(P, N, light)
            sure &= certain
            if not xi or not self.lit(light, triangle):
                values.append(0.0)
                continue
            r, nodes = self.radius(light), np.zeros((0, 3))
            if light.soft_shadows and receives and r > 0:
                if r not in sets:
                    sets[r] = self.interpolation_set(P, N, r)
                nodes, certain = sets[r]
                sure &= certain
            if len(nodes):
                x = self.lattice.position(nodes)
                weight = np.ones(len(x))
                if self.scene.settings.weights == "SMOOTH":
                    weight = 1 - (np.linalg.norm(x - P, axis=1) / r) ** 2
                visible, certain = self.visible(x, light, soft=True)
                edge, clear = self.visible(P[None], light, N, soft=False)
                values.append(float(weight @ visible / weight.sum() * edge[0]))
                sure &= bool(certain.all() and clear[0])
            else:
                visible, certain = self.visible(P[None], light, N)
                values.append(float(visible[0]))
                sure &= bool(certain[0])
        return np.array(values), sure

    def sharp(self, P: np.ndarray, N: np.ndarray, triangle: int | None = None) -> tuple[np.ndarray, bool]:
        values, sure = [], True
        for light in self.scene.lights:
            xi, certain = self.faces(P, N, light)
            xi &= self.lit(light, triangle)
            visible, clear = self.visible(P[None], light, N)
            values.append(float(visible[0] and xi))
            sure &= certain and (not xi or bool(clear[0]))
        return np.array(values), sure

    def lit(self, light: Light, triangle: int | None) -> bool:
        """Return whether the light lights the triangle's object."""
        return triangle is None or light.receivers is None or int(self.owner[triangle]) in light.receivers

    # --- Light --------------------------------------------------------------------------------------------

    def omega(self, hit: Hit, view: np.ndarray) -> np.ndarray:
        """Return Ω(i, P) of every light, (L,3); `view` is the unit direction to the eye."""
        m, rows = hit.material, []
        for light in self.scene.lights:
            L, attenuation = _arriving(light, hit.P)
            cosine = float(hit.shading @ L)
            R = 2 * cosine * hit.shading - L
            rows.append(attenuation * np.array(light.intensity)
                        * (m.kd * np.array(m.Od) * max(0.0, cosine)
                           + m.ks * np.array(m.Os) * max(0.0, float(R @ view)) ** m.nShiny))
        return np.array(rows).reshape(-1, 3)

    def first_hit(self, origin: np.ndarray, direction: np.ndarray) -> tuple[Hit | None, bool]:
        """Return the first hit by Möller–Trumbore over all triangles. `sure` is False near an edge, and if two hits are
        almost equally near.
        """
        a, b, c = self.triangles.transpose(1, 0, 2)
        e1, e2 = b - a, c - a
        p = np.cross(direction, e2)
        with np.errstate(divide="ignore", invalid="ignore"):
            det = np.einsum("ti,ti->t", e1, p)
            u = np.einsum("ti,ti->t", origin - a, p) / det
            q = np.cross(origin - a, e1)
            v = (q @ direction) / det
            t = np.einsum("ti,ti->t", e2, q) / det
        w = np.min([u, v, 1 - u - v], 0)
        slack = 1e-4
        possible = np.flatnonzero((w > -slack) & (t > 0) & np.isfinite(t))
        hits = possible[w[possible] >= 0]
        if not len(hits):
            return None, not len(possible)
        k = hits[np.argmin(t[hits])]
        rivals = possible[(possible != k) & (t[possible] < t[k] + self.margin)]
        sure = w[k] > slack and not len(rivals)
        side = -1.0 if self.n[k] @ direction > 0 else 1.0
        bary = np.array([1 - u[k] - v[k], u[k], v[k]])
        smooth = side * bary @ self.corner_normals[k]
        return Hit(origin + t[k] * direction, side * self.n[k], smooth / np.linalg.norm(smooth),
                   self.materials[k], float(t[k]), int(k)), sure

    def pixel(self, x: int, y: int) -> tuple[np.ndarray, bool]:
        """Return the radiance through the centre of a pixel, eq. (1) or (2), and whether it is sure."""
        return self.radiance(*camera_ray(self.scene, x + 0.5, y + 0.5))

    def radiance(self, origin: np.ndarray, direction: np.ndarray, depth: int = 0) -> tuple[np.ndarray, bool]:
        """Return Ia·ka·Od + Σ S·Ω + emission and, in WHITTED mode, the light that a mirror reflects."""
        chosen = self.scene.settings
        hit, sure = self.first_hit(origin, direction)
        world = np.array(self.scene.world_color)
        if hit is None:
            return world, sure
        visibility = self.soft if chosen.shadows == "LIGHT_MESHES" else self.sharp
        S, certain = visibility(hit.P, hit.N, hit.triangle)
        m = hit.material
        total = chosen.ambient * m.ka * np.array(m.Od) * world + np.array(m.emission)
        total = total + S @ self.omega(hit, -direction)
        if chosen.mode == "WHITTED" and any(m.mirror) and depth < chosen.max_depth:
            reflected = direction - 2 * (direction @ hit.shading) * hit.shading
            inner, clear = self.radiance(hit.P + 1e-9 * self.extent * hit.N, reflected, depth + 1)
            total, certain = total + np.array(m.mirror) * inner, certain and clear
        return total, sure and certain

    def picture(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (radiance (h,w,3), sure (h,w)) of the whole frame."""
        w, h = self.scene.camera.width, self.scene.camera.height
        pixels = [self.pixel(x, y) for y in range(h) for x in range(w)]
        return np.array([p[0] for p in pixels]).reshape(h, w, 3), np.array([p[1] for p in pixels]).reshape(h, w)

    def receivers(self, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Return `places` without the triangles."""
        return self.places(n, seed)[:2]

    def places(self, n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return n random points on triangles with a normal to a random side, because the inside of a closed mesh must
        work too: (P, N, k).
        """
        random = np.random.default_rng(seed)
        k = random.choice(len(self.triangles), n, p=self.area / self.area.sum())
        bary = random.dirichlet((1, 1, 1), n)
        side = np.where(random.random(n) < 0.8, 1.0, -1.0)
        return np.einsum("nk,nki->ni", bary, self.triangles[k]), side[:, None] * self.n[k], k.astype(np.int32)


def camera_ray(scene: Scene, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (origin, unit direction) of the ray through the point (x, y) of the frame, in pixels from its lower left
    corner.
    """
    camera = scene.camera
    left, right, bottom, top = camera.window
    p = np.array([left + (right - left) * x / camera.width, bottom + (top - bottom) * y / camera.height])
    rotation, eye = camera.matrix[:3, :3], camera.matrix[:3, 3]
    if camera.perspective:
        direction = rotation @ np.array([*p, -1.0])
        return eye, direction / np.linalg.norm(direction)
    return eye + rotation @ np.array([*p, 0.0]), -rotation[:, 2]


def _arriving(light: Light, P: np.ndarray) -> tuple[np.ndarray, float]:
    """Return (L, f_att): the unit direction to the light, and the factor by which its intensity is reduced on the
    way.
    """
    axis = np.array(light.direction)
    if light.type == "SUN":
        return -axis, 1.0
    to = np.array(light.position) - P
    distance = float(np.linalg.norm(to))
    L, attenuation = to / distance, 1 / distance**2
    cosine = float(-L @ axis)
    assert light.axes is None, "stretched and sheared lamps are compared with Cycles, not here"
    if light.type == "SPOT":  # Cycles' falloff
        edge = np.cos(light.spot_angle / 2)
        x = (cosine - edge) / max((1 - edge) * light.spot_blend, 1e-12)
        x = min(max(x, 0.0), 1.0)
        attenuation *= x * x * (3 - 2 * x)
    if light.type == "AREA":
        assert light.spread == np.pi, "a narrower spread is compared with Cycles, not here"
        attenuation *= max(0.0, cosine)
    return L, attenuation


def _world(scene: Scene) -> tuple[np.ndarray, np.ndarray, list[Material], np.ndarray]:
    """Return all triangles in world space, and their corner normals, materials and objects."""
    g = scene.geometry
    triangles, normals, materials, owner = [], [], [], []
    for mesh, obj, matrix in zip(g.instance_mesh, g.instance_object, g.instance_matrix, strict=True):
        v0, _, t0, nt = g.meshes[mesh]
        local = g.vertices[v0 + g.triangles[t0:t0 + nt]].astype(np.float64)
        triangles.append(local @ matrix[:3, :3].T + matrix[:3, 3])
        turned = g.corner_normals[t0:t0 + nt].astype(np.float64) @ np.linalg.inv(matrix[:3, :3])
        if np.linalg.det(matrix[:3, :3]) < 0:
            triangles[-1] = triangles[-1][:, ::-1]  # so that counter-clockwise stays outside
            turned = turned[:, ::-1]
        normals.append(turned)
        materials += [scene.materials[m] for m in g.triangle_materials[t0:t0 + nt]]
        owner.append(np.full(nt, obj))
    return np.concatenate(triangles), np.concatenate(normals), materials, np.concatenate(owner)
