"""The light of a lamp with a size, plain and slow: a sum over many small parts of the lamp, in numpy.

Straight from the definition, and shares no code with the engine: a part of area dA that sends the radiance I/A towards
the receiver P counts (I/A)·f(ω)·cos·dA/d², where ω is the unit vector from P to it, and f is N·ω for matt surfaces and
(ω·M)^n for glossy ones.
"""

from __future__ import annotations

import numpy as np
from light_meshes.scene.description import Light


def parts(light: Light, P: np.ndarray, grid: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of grid² parts of the lamp as P sees it: ω (m,3); what each sends, over I (m,); where it is (m,3).

    A sun's parts are at ω.
    """
    s, t = (a.ravel() for a in np.meshgrid((np.arange(grid) + 0.5) / grid, (np.arange(grid) + 0.5) / grid))
    if light.type == "AREA":
        return _area(light, P, s, t)
    centre = -np.array(light.direction) if light.type == "SUN" else np.array(light.position) - P
    distance = np.linalg.norm(centre)
    d = centre / distance
    a = np.cross(d, np.eye(3)[np.argmin(np.abs(d))])
    a /= np.linalg.norm(a)
    ring = np.cos(2 * np.pi * t)[:, None] * a + np.sin(2 * np.pi * t)[:, None] * np.cross(d, a)
    if light.facing_disc:
        X = centre + light.radius * s[:, None] ** 2 * ring  # finer in the middle, which may be near
        length = np.linalg.norm(X, axis=1)
        way = X / length[:, None]
        sent = 4 * s**3 * (way @ d) / length**2 / len(X)
    else:
        sine = np.sin(light.angle / 2) if light.type == "SUN" else light.radius / distance
        inside = sine >= 1 and light.type != "SUN"
        solid = 2.0 if inside else 1 - np.sqrt(1 - sine**2)  # over 2π
        cosine = 1 - solid * s
        way = cosine[:, None] * d + np.sqrt(1 - cosine**2)[:, None] * ring
        area = np.pi * (sine if light.type == "SUN" else light.radius) ** 2
        sent = np.full(len(way), 2 * np.pi * solid / len(way) / area)
        if light.type == "SUN":
            return way, sent, way
        along = distance * cosine
        root = np.sqrt(np.maximum(along**2 - distance**2 + light.radius**2, 0))
        X = way * (along + root if inside else along - root)[:, None]
    if light.type == "SPOT":
        sent = sent * _cone(light, way)
    return way, sent, P + X


def _area(light: Light, P: np.ndarray, s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the grid is even in the angles at which P sees it along u and along v, which must be perpendicular."""
    u, v, n = np.array(light.area_u), np.array(light.area_v), np.array(light.direction)
    a, b = np.linalg.norm(u), np.linalg.norm(v)
    centre = np.array(light.position) - P
    height = max(-centre @ n, 1e-12)
    most = np.tan(light.spread / 2) * height if light.spread < np.pi - 1e-4 else np.inf

    def even(share: np.ndarray, middle: float, half: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Places along an axis, from the foot of P, and the lengths there."""
        low, high = (np.arctan(np.clip(middle + side * half, -most, most) / height) for side in (-1, 1))
        angle = low + share * (high - low)
        return height * np.tan(angle), height / np.cos(angle) ** 2 * (high - low) / np.sqrt(len(share))

    x, dx = even(s, centre @ u / a, a)
    half = b * np.sqrt(np.maximum(1 - ((x - centre @ u / a) / a) ** 2, 0)) if light.area_ellipse else b
    y, dy = even(t, centre @ v / b, half)
    X = x[:, None] * u / a + y[:, None] * v / b - height * n
    share = dx * dy / (a * b * (np.pi if light.area_ellipse else 4))
    length = np.linalg.norm(X, axis=1)
    way = X / length[:, None]
    cosine = np.maximum(-way @ np.array(light.direction), 0)
    sent = share * cosine / length**2
    if light.spread < np.pi - 1e-4:
        half = light.spread / 2
        with np.errstate(divide="ignore"):
            tangent = np.sqrt(np.maximum(1 - cosine**2, 0)) / cosine
        sent = sent * np.maximum(np.tan(half) - tangent, 0) / (np.tan(half) - half)
    return way, sent, P + X


def _cone(light: Light, way: np.ndarray) -> np.ndarray:
    axis = way @ -np.array(light.direction)
    if light.axes:
        q = way @ np.array(light.axes).T
        axis = -q[:, 2] / np.linalg.norm(q, axis=1)
    edge = np.cos(light.spot_angle / 2)
    t = np.clip((axis - edge) / max((1 - edge) * light.spot_blend, 1e-9), 0, 1)
    return t * t * (3 - 2 * t)


def all_of(light: Light, P: np.ndarray, N: np.ndarray, M: np.ndarray, shiny: tuple[float, ...],
           grid: int = 400) -> list[float]:
    """Return what `matt` returns, and then what `gloss` returns for each n of `shiny`."""
    way, sent, _ = parts(light, P, grid)
    up, mirrored = way @ N, np.maximum(way @ M, 0)
    glossy = sent * (up > 0)
    return [float((sent * np.maximum(up, 0)).sum()), *(float((glossy * mirrored**n).sum()) for n in shiny)]


def matt(light: Light, P: np.ndarray, N: np.ndarray, grid: int = 400) -> float:
    """What a white matt surface of normal N returns, over I."""
    way, sent, _ = parts(light, P, grid)
    return float((sent * np.maximum(way @ N, 0)).sum())


def gloss(light: Light, P: np.ndarray, N: np.ndarray, M: np.ndarray, n: float, grid: int = 400) -> float:
    """Return the highlight (R·V)^n of a surface of normal N whose eye's ray is mirrored to M, over I."""
    way, sent, _ = parts(light, P, grid)
    return float((sent * (way @ N > 0) * np.maximum(way @ M, 0) ** n).sum())
