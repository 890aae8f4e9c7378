"""Formulas for the limits of light meshes (h → 0 with r fixed) and for disc-shaped lights."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

QUANTISATION = 0.145  # mean error of a penumbra on a generic lattice, times kI²: about .14 (method.md §7)


def smoothstep(u: np.ndarray) -> np.ndarray:
    """Return S for an upright shadow plane, u = s/r: the lit share of a half-ball."""
    u = np.clip(u, -1, 1)
    return 0.5 + 0.75 * u - 0.25 * u**3


def smootherstep(u: np.ndarray) -> np.ndarray:
    """Return the same if nodes weigh 1 − t², t = |x−P|/r: the density of x in the weighted half-ball is 15/16·(1 −
    u²)².
    """
    u = np.clip(u, -1, 1)
    return 0.5 + 15 / 16 * (u - 2 / 3 * u**3 + u**5 / 5)


def half_ball(s: np.ndarray, r: float, beta: float, weight: Callable[[np.ndarray], np.ndarray] = np.ones_like,
              ) -> np.ndarray:
    """Return the lit share of the half-ball over a receiver at signed distance s from a shadow's edge; its points have
    the weight weight(t).

    The shadow plane meets the receiver at the angle beta, measured on the lit side: at height z it has moved by
    z·cot(beta) over the lit side. A ball of any weight is a sum of uniform ones: balls of radius a·r with the share
    −weight'(a)·a³, and one of radius r with the share weight(1). Each of these is integrated slice by slice over z;
    each slice is a disc cut by a line.
    """
    s = np.asarray(s, float)
    edges = np.linspace(0, 1, 101)
    drop = weight(edges[:-1]) - weight(edges[1:])
    parts = [*zip((edges[:-1] + edges[1:]) / 2, drop, strict=True), (1.0, float(weight(np.ones(1))[0]))]
    parts = [(a, share * a**3) for a, share in parts if share]
    return sum(share * _uniform_half_ball(s, a * r, beta) for a, share in parts) / sum(share for _, share in parts)


def _uniform_half_ball(s: np.ndarray, r: float, beta: float) -> np.ndarray:
    nodes, weights = np.polynomial.legendre.leggauss(100)
    z, dz = r * (nodes + 1) / 2, weights * r / 2
    rho = np.sqrt(r * r - z * z)
    share = disc_share((s[..., None] - z / np.tan(beta)) / rho)
    return (share * rho**2 * np.pi * dz).sum(-1) / (2 / 3 * np.pi * r**3)


def disc_share(u: np.ndarray) -> np.ndarray:
    """Return the share of the unit disc on the near side of a line at distance u from its centre."""
    u = np.clip(u, -1, 1)
    return 0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / np.pi


def strip_minimum(width: float, r: float, limit: Callable[[np.ndarray], np.ndarray] = smoothstep) -> float:
    """Return S in the middle of a strip's shadow that is narrower than 2r, if a single edge has the profile `limit`."""
    u = np.array([width / r / 2])
    return float(1 - (limit(u) - limit(-u))[0])  # 1 − (¾w/r − (w/r)³/16) for smoothstep
