"""Newton's method for one refracted path: the first point from which light ends in a given point."""

from __future__ import annotations

import numpy as np

from ..support.compiled import part
from .media import E1, E2, NEIGHBOUR, NG, PATCH, A, U, V, closest
from .optics import NEWTON, RAYS, bend, cross_section, miss, slope_of, start_at, travel

STEPS = 25
HALVINGS = 6  # of one step
WALK = 200  # triangles that one step may cross


@part
def _towards(g, s, x, slot, u, v, k):
    """Lengths (distance of x from the path's end ray, from its last bend along it) of a path given by its first point.

    The path keeps to the signature s.want: each further interface is looked for on its own patch only. Leaves the ray
    in s.trial; a negative second length says that there is no such path.
    """
    ray, p = s.trial, g.place
    start_at(g, s.light, s.sun, slot, u, v, ray)
    if (slope_of(g, slot, ray) > 0.0) != (s.want[0] & 1 == 1):
        return np.inf, -1.0
    j = 0
    while bend(g, slot, u, v, s.want_eta[j], ray, s.normal):
        j += 1
        if j == k:
            return miss(ray, x)
        s.work[RAYS] += 1
        patch, facing = s.want[j] >> 1, 1.0 if s.want[j] & 1 else -1.0
        s.touched[4] = slot
        slot = closest(g, ray, 0.0, np.inf, s.touched, np.int64(1), patch, facing, s.stack, s.out)
        t, u, v = s.out[0], s.out[1], s.out[2]
        if slot < 0:
            slot = g.planar[patch]
            if slot < 0:
                break
            # A plane goes on where its patch ends: Newton's method may come back from there.
            away = 0.0
            for i in range(3):
                away += (p[slot, A + i] - ray[0, i]) * p[slot, NG + i]
            slope = slope_of(g, slot, ray)
            t, u, v = away / slope, 0.0, 0.0
            if not (t > 0.0 and slope * facing > 0.0):
                break
        travel(g, slot, t, ray)
    return np.inf, -1.0


@part
def _walk(g, slot, u, v, du, dv):
    """From (u, v) of a triangle by (du, dv) over its patch, straight on across edges; returns slot, u, v.

    On a plane there is nothing to walk over, and at the end of a curved patch the way ends.
    """
    p = g.place
    if g.planar[g.link[slot, PATCH]] >= 0:
        return slot, u + du, v + dv
    for _ in range(WALK):
        a, b = u + du, v + dv
        if a >= 0.0 and b >= 0.0 and a + b <= 1.0:
            return slot, a, b
        step, edge = 1.0, -1
        if b < 0.0 and dv < 0.0 and -v / dv < step:
            step, edge = -v / dv, 0
        if a + b > 1.0 and du + dv > 0.0 and (1.0 - u - v) / (du + dv) < step:
            step, edge = (1.0 - u - v) / (du + dv), 1
        if a < 0.0 and du < 0.0 and -u / du < step:
            step, edge = -u / du, 2
        if edge < 0:
            break
        step = max(step, 0.0)
        u, v = u + step * du, v + step * dv
        du, dv = (1.0 - step) * du, (1.0 - step) * dv
        other = g.link[slot, NEIGHBOUR + edge]
        if other < 0:
            break
        cosine, along = 0.0, 0.0
        for j in range(3):
            cosine += p[slot, NG + j] * p[other, NG + j]
            along += (du * p[slot, E1 + j] + dv * p[slot, E2 + j]) * p[other, NG + j]
        if cosine < -0.99:
            break
        # Turn the rest of the way about the edge into the other plane.
        f = along / (1.0 + cosine)
        new_u, new_v, new_du, new_dv = 0.0, 0.0, 0.0, 0.0
        for j in range(3):
            way = du * p[slot, E1 + j] + dv * p[slot, E2 + j] - f * (p[slot, NG + j] + p[other, NG + j])
            here = p[slot, A + j] + u * p[slot, E1 + j] + v * p[slot, E2 + j] - p[other, A + j]
            new_u += here * p[other, U + j]
            new_v += here * p[other, V + j]
            new_du += way * p[other, U + j]
            new_dv += way * p[other, V + j]
        slot, u, v, du, dv = other, max(new_u, 0.0), max(new_v, 0.0), new_du, new_dv
        if u + v > 1.0:
            u, v = u / (u + v), v / (u + v)
    return slot, u, v


@part
def newton(g, s, x, slot, u, v, k):
    """Newton's method on the first point of a path of signature s.want[:k], until its end ray passes through x.

    Damped: a step is halved until it brings the ray nearer. Returns the slot (−1: not found); s.out[5:7] = u, v.
    The position on the first surface is the unknown, not the direction at the light: at grazing angles a direction
    says too little (method §3).
    """
    m, p = s.section, g.place
    size = g.patch_size[s.want[0] >> 1]
    distance, along = np.inf, 0.0
    du, dv, damp, left = 0.0, 0.0, 0.0, -1  # the first look is at the seed itself
    for _ in range(STEPS):
        nearer = False
        while left >= -1:
            there, a, b = _walk(g, slot, u, v, damp * du, damp * dv)
            trial, along_trial = _towards(g, s, x, there, a, b, k)
            nearer = along_trial > 0.0 and trial < distance
            if nearer or left <= 0:
                break
            left -= 1
            damp *= 0.5
        if not nearer:
            if distance > 1e-11 * size:
                return -1
            s.out[5], s.out[6] = u, v  # nothing left but rounding
            return slot
        slot, u, v, distance, along = there, a, b, trial, along_trial
        s.work[NEWTON] += 1
        cross_section(s.trial, x, along, m)
        det = m[0, 0] * m[1, 1] - m[1, 0] * m[0, 1]
        if not abs(det) > 1e-300:
            return -1
        du = (m[2, 0] * m[1, 1] - m[1, 0] * m[2, 1]) / det
        dv = (m[0, 0] * m[2, 1] - m[2, 0] * m[0, 1]) / det
        square = 0.0
        for j in range(3):
            square += (du * p[slot, E1 + j] + dv * p[slot, E2 + j]) ** 2
        length = np.sqrt(square)
        if not length < np.inf:
            return -1
        if length <= 1e-9 * size:  # the next step would be its square
            if distance > 1e-8 * size:
                return -1
            s.out[5], s.out[6] = u + du, v + dv
            return slot
        damp, left = min(1.0, 0.5 * size / length), HALVINGS
    return -1
