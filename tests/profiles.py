"""What light meshes converge to where the answer is a formula: h → 0 with r fixed, and disc-shaped lights."""

from __future__ import annotations

import numpy as np

QUANTISATION = 0.145  # mean error of a penumbra on a generic lattice, times kI²: about .14 (method.md §7)


def smoothstep(u: np.ndarray) -> np.ndarray:
    """S over an upright shadow plane, u = s/r: the lit share of a half-ball."""
    u = np.clip(u, -1, 1)
    return 0.5 + 0.75 * u - 0.25 * u**3


def half_ball(s: np.ndarray, r: float, beta: float) -> np.ndarray:
    """Lit share of the half-ball over a receiver at signed distance s from a shadow's edge.

    The shadow plane meets the receiver at the angle beta, measured on the lit side: at height z it has moved
    by z·cot(beta) over the lit side. Integrated slice by slice over z; each slice is a disc cut by a line.
    """
    nodes, weights = np.polynomial.legendre.leggauss(200)
    z, dz = r * (nodes + 1) / 2, weights * r / 2
    rho = np.sqrt(r * r - z * z)
    share = disc_share((np.asarray(s, float)[..., None] - z / np.tan(beta)) / rho)
    return (share * rho**2 * np.pi * dz).sum(-1) / (2 / 3 * np.pi * r**3)


def disc_share(u: np.ndarray) -> np.ndarray:
    """Share of the unit disc on the near side of a line at distance u from its middle."""
    u = np.clip(u, -1, 1)
    return 0.5 + (u * np.sqrt(1 - u * u) + np.arcsin(u)) / np.pi


def strip_minimum(width: float, r: float) -> float:
    """S in the middle of a strip's shadow that is narrower than 2r."""
    u = width / r
    return 1 - (0.75 * u - u**3 / 16)
