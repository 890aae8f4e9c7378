"""A ray of light with its derivatives, and the chain of interfaces that it meets.

A ray is an array (6,3): origin P, unit direction D, and their derivatives by two parameters (Pu, Pv, Du, Dv), carried
along as in Igehy, Tracing Ray Differentials (1999), but without his approximations: normals are interpolated ones.
A path's signature is the sequence of what bends it: 2·patch, + 1 where it leaves the body, and η = n before / n behind,
or REFLECTED where it stays: total reflection, if the light's paths are followed beyond it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.boxes import STACK
from ..support.compiled import kernel, part
from .media import BODY, E1, E2, FLAT_SHADED, KT, NG, NS, OWNER, PATCH, TOUCHING, A, Glass, U, V, closest

DEPTH = 64  # interfaces at which a path may bend
BODIES = 64  # bodies around one point
REFLECTED = -1.0
REFLECTIONS = 8  # of one path: of so many, one at a curved surface counting as CURVED, which scatters them
CURVED = 4
FAR = 8.0  # times the reach of the glass, and at least of the frame's box: so far away a sun's rays start
# Work of a call, counted by the kernels.
SEEDS, UNCONVERGED, NEWTON, RAYS, REJECTED = range(5)


class Scratch(NamedTuple):
    """A light, and room for one path at a time; one a thread. See `chain`."""

    light: NDArray[np.float64]  # (3,) frame; of a sun the unit vector towards it
    sun: bool
    total: bool  # whether paths go on where light is reflected totally
    far: float  # what all glass is nearer than, a sun's rays' start
    medium0: NDArray[np.int64]  # (BODIES+1,2) bodies around the light, see `_cross`
    medium: NDArray[np.int64]  # and around the ray
    ray: NDArray[np.float64]  # (6,3)
    alpha: NDArray[np.float64]  # (3,)
    touched: NDArray[np.int64]  # (10,) see `next_bend`
    code: NDArray[np.int64]  # (DEPTH+1,2) of each bend: code, slot; behind the last one of what reflects all, −1: none
    bend: NDArray[np.float64]  # (DEPTH+1,5) η, u, v, length before it, `beyond`
    rays: NDArray[np.float64]  # (DEPTH,6,3) behind it
    want: NDArray[np.int64]  # (DEPTH,) the signature that Newton's method keeps to: codes
    want_eta: NDArray[np.float64]  # (DEPTH,)
    trial: NDArray[np.float64]  # (6,3) its ray
    normal: NDArray[np.float64]  # (3,3)
    section: NDArray[np.float64]  # (3,2)
    out: NDArray[np.float64]  # (7,) t, u, v, slot, η of a hit; u, v that Newton's method is at
    stack: NDArray[np.int64]
    work: NDArray[np.int64]  # (5,) SEEDS .. REJECTED


def scratch(g: Glass, light: NDArray[np.float64], sun: bool, total: bool) -> Scratch:
    """Room for the paths of one light; `light` in the frame. total: see `Scratch`."""
    s = Scratch(
        np.ascontiguousarray(light, np.float64), bool(sun), bool(total),
        FAR * max(1.0, float(np.abs(g.box).max(initial=0))), np.zeros((BODIES + 1, 2), np.int64),
        np.zeros((BODIES + 1, 2), np.int64), np.zeros((6, 3)), np.ones(3), np.zeros(10, np.int64),
        np.zeros((DEPTH + 1, 2), np.int64),
        np.zeros((DEPTH + 1, 5)), np.zeros((DEPTH, 6, 3)), np.zeros(DEPTH, np.int64), np.zeros(DEPTH),
        np.zeros((6, 3)), np.zeros((3, 3)), np.zeros((3, 2)), np.zeros(7), np.zeros(STACK, np.int64),
        np.zeros(5, np.int64),
    )
    if not sun and len(g.ior):
        _medium_at(g, s)
    return s


@part
def _basis(ray, row):
    """Two unit vectors at right angles to the direction and to each other, into rows `row` and row + 1."""
    x, y, z = ray[1, 0], ray[1, 1], ray[1, 2]
    sign = 1.0 if z >= 0.0 else -1.0
    f = -1.0 / (sign + z)
    g = x * y * f
    ray[row, 0], ray[row, 1], ray[row, 2] = 1.0 + sign * x * x * f, sign * g, -sign * x
    ray[row + 1, 0], ray[row + 1, 1], ray[row + 1, 2] = g, sign + y * y * f, -y


@part
def start_ray(light, sun, far, y, ray):
    """The light's ray through y; parameters: two angles at the light, or lengths across a sun's rays."""
    ray[:] = 0.0
    if sun:
        away = far + abs(y[0]) + abs(y[1]) + abs(y[2])
        for j in range(3):
            ray[1, j] = -light[j]
            ray[0, j] = y[j] + away * light[j]
        _basis(ray, 2)
    else:
        length = 0.0
        for j in range(3):
            ray[0, j] = light[j]
            ray[1, j] = y[j] - light[j]
            length += ray[1, j] * ray[1, j]
        length = np.sqrt(length)
        for j in range(3):
            ray[1, j] /= length
        _basis(ray, 4)


@part
def slope_of(g, slot, ray):
    """Direction·NG: negative where the ray enters."""
    p = g.place
    return ray[1, 0] * p[slot, NG] + ray[1, 1] * p[slot, NG + 1] + ray[1, 2] * p[slot, NG + 2]


@part
def start_at(g, light, sun, slot, u, v, ray):
    """The light's ray at the point (u, v) of a triangle; parameters: u and v."""
    p = g.place
    square = 0.0
    for j in range(3):
        ray[0, j] = p[slot, A + j] + u * p[slot, E1 + j] + v * p[slot, E2 + j]
        ray[1, j] = -light[j] if sun else ray[0, j] - light[j]
        square += ray[1, j] * ray[1, j]
    length = np.sqrt(square)
    a, b = 0.0, 0.0
    for j in range(3):
        ray[1, j] /= length
        ray[2, j], ray[3, j] = p[slot, E1 + j], p[slot, E2 + j]
        a += ray[1, j] * ray[2, j]
        b += ray[1, j] * ray[3, j]
    for j in range(3):
        ray[4, j] = 0.0 if sun else (ray[2, j] - a * ray[1, j]) / length
        ray[5, j] = 0.0 if sun else (ray[3, j] - b * ray[1, j]) / length


@part
def travel(g, slot, t, ray):
    """Move the ray by t to a triangle's plane; its derivatives then are those of its point in that plane."""
    p = g.place
    slope = slope_of(g, slot, ray)
    for k in range(2, 4):
        away = 0.0
        for j in range(3):
            ray[k, j] += t * ray[k + 2, j]
            away += ray[k, j] * p[slot, NG + j]
        for j in range(3):
            ray[k, j] -= away / slope * ray[1, j]
    for j in range(3):
        ray[0, j] += t * ray[1, j]


@part
def bend(g, slot, u, v, eta, ray, n):
    """Snell's law at the ray's point (u, v) of a triangle, by the shading normal; η REFLECTED: a mirror's.

    False: no light goes there. That is total reflection, or a shading normal by which the ray would not reach the
    surface, or not leave it on the right side.
    n (3,3) is room for the normal against the ray and its derivatives.
    """
    p = g.place
    facing = 1.0 if slope_of(g, slot, ray) > 0.0 else -1.0
    if g.link[slot, FLAT_SHADED]:
        for j in range(3):
            n[0, j], n[1, j], n[2, j] = -facing * p[slot, NG + j], 0.0, 0.0
    else:
        square = 0.0
        for j in range(3):
            n0 = p[slot, NS + j]
            n1, n2 = p[slot, NS + 3 + j] - n0, p[slot, NS + 6 + j] - n0
            n[0, j] = -facing * (n0 + u * n1 + v * n2)
            square += n[0, j] * n[0, j]
        length = np.sqrt(square)
        for j in range(3):
            n[0, j] /= length
        for k in range(2):
            du, dv = 0.0, 0.0
            for j in range(3):
                du += ray[2 + k, j] * p[slot, U + j]
                dv += ray[2 + k, j] * p[slot, V + j]
            along = 0.0
            for j in range(3):
                n0 = p[slot, NS + j]
                n[1 + k, j] = -facing / length * (du * (p[slot, NS + 3 + j] - n0) + dv * (p[slot, NS + 6 + j] - n0))
                along += n[1 + k, j] * n[0, j]
            for j in range(3):
                n[1 + k, j] -= along * n[0, j]
    c = -(ray[1, 0] * n[0, 0] + ray[1, 1] * n[0, 1] + ray[1, 2] * n[0, 2])
    square = 1.0 - eta * eta * (1.0 - c * c)
    if not (c > 0.0 and square > 0.0):
        return False
    mu, by_c = 2.0 * c, 2.0
    if eta == REFLECTED:
        eta, facing = 1.0, -facing
    else:
        root = np.sqrt(square)
        mu, by_c = eta * c - root, eta - eta * eta * c / root
    for k in range(2):
        dc = 0.0
        for j in range(3):
            dc -= ray[4 + k, j] * n[0, j] + ray[1, j] * n[1 + k, j]
        dmu = by_c * dc
        for j in range(3):
            ray[4 + k, j] = eta * ray[4 + k, j] + dmu * n[0, j] + mu * n[1 + k, j]
    for j in range(3):
        ray[1, j] = eta * ray[1, j] + mu * n[0, j]
    return slope_of(g, slot, ray) * facing > 0.0


@part
def _medium_index(g, medium):
    """(n, rank) of the medium that a list of bodies makes; air: 1, −1."""
    n, rank = 1.0, np.int64(-1)
    for i in range(1, medium[0, 0] + 1):
        if g.rank[medium[i, 0]] > rank:
            rank = g.rank[medium[i, 0]]
            n = g.ior[medium[i, 0]]
    return n, rank


@part
def _cross(medium, body, entering):
    """Enter or leave a body; False where that is impossible. medium: rows 1..medium[0,0] hold (body, how often)."""
    for i in range(1, medium[0, 0] + 1):
        if medium[i, 0] == body:
            medium[i, 1] += 1 if entering else -1
            if medium[i, 1] == 0:
                last = medium[0, 0]
                medium[i, 0], medium[i, 1] = medium[last, 0], medium[last, 1]
                medium[0, 0] = last - 1
            return True
    if not entering or medium[0, 0] == BODIES:
        return False
    medium[0, 0] += 1
    medium[medium[0, 0], 0] = body
    medium[medium[0, 0], 1] = 1
    return True


BENDS, ENDS, BROKEN = range(3)
_ANY = np.int64(-1)  # numbers of one type: numba would compile `closest` once more for each literal


@part
def next_bend(g, s, end):
    """Follow s.ray to the first surface that bends it, or to `end`: BENDS, ENDS or BROKEN (surfaces not closed).

    s.out = t, u, v, slot, η. s.alpha takes t of each surface on the way, the last one included; a surface inside a
    medium of higher priority is not there. s.touched = number of slots met at the ray's origin, the last one's body,
    owner and facing, those slots; a second triangle of one surface at one place is an edge and counts once.
    """
    touched, out = s.touched, s.out
    t0, last = 0.0, -1.0
    if touched[0] < 0:  # reflected: whatever else is in that place is behind
        t0, touched[0] = 2.0 * TOUCHING, 0
    elif touched[0]:
        t0, last = -2.0 * TOUCHING, 0.0
    while True:
        s.work[RAYS] += 1
        slot = closest(g, s.ray, t0, end, touched, touched[0], _ANY, 0.0, s.stack, out)
        if slot < 0:
            return ENDS
        t = out[0]
        facing = 1 if slope_of(g, slot, s.ray) > 0.0 else -1
        body, owner = g.link[slot, BODY], g.link[slot, OWNER]
        edge = abs(t - last) < TOUCHING and body == touched[1] and owner == touched[2] and (
            facing == touched[3] if body >= 0 else min(out[1], out[2], 1.0 - out[1] - out[2]) < TOUCHING)
        if t - last > 2.0 * TOUCHING:
            touched[0] = 0
        if touched[0] < len(touched) - 4:
            touched[4 + touched[0]] = slot
            touched[0] += 1
            t0 = max(t0, t - 2.0 * TOUCHING)
        else:
            t0 = max(t0, t)
        last = t
        touched[1], touched[2], touched[3] = body, owner, facing
        if edge:
            continue
        before, behind = 1.0, 1.0
        if body >= 0:
            before, rank = _medium_index(g, s.medium)
            if not _cross(s.medium, body, facing < 0):
                return BROKEN
            behind, rank_behind = _medium_index(g, s.medium)
            if rank == rank_behind:
                continue  # hidden in a medium of higher priority
        for j in range(3):
            s.alpha[j] *= g.place[slot, KT + j]
        if before != behind:
            out[3], out[4] = slot, before / behind
            return BENDS


@kernel
def _medium_at(g, s):
    """The bodies around the light, into s.medium0: those that a ray from there leaves more often than it enters."""
    balance = np.zeros(len(g.ior), np.int64)
    for j in range(3):
        s.ray[0, j] = s.light[j]
        s.ray[1, j] = np.sqrt((2.0, 3.0, 5.0)[j] / 10.0)  # along no plane that an artist builds
    t0, last, last_body, last_facing, skips = 0.0, -1.0, np.int64(-1), 0, np.int64(0)
    while True:
        s.work[RAYS] += 1
        slot = closest(g, s.ray, t0, np.inf, s.touched, skips, _ANY, 0.0, s.stack, s.out)
        if slot < 0:
            break
        t0, s.touched[4], skips = s.out[0], slot, np.int64(1)
        body = g.link[slot, BODY]
        facing = 1 if slope_of(g, slot, s.ray) > 0.0 else -1
        if body >= 0 and not (body == last_body and facing == last_facing and t0 - last < TOUCHING):
            balance[body] += facing
        last, last_body, last_facing = t0, body, facing
    for b in range(len(balance)):
        if balance[b] > 0 and s.medium0[0, 0] < BODIES:
            s.medium0[0, 0] += 1
            s.medium0[s.medium0[0, 0], 0], s.medium0[s.medium0[0, 0], 1] = b, balance[b]


@part
def set_out(s, y):
    """A new path: the light's ray through y."""
    start_ray(s.light, s.sun, s.far, y, s.ray)
    s.touched[0] = 0
    for i in range(len(s.medium)):
        s.medium[i, 0], s.medium[i, 1] = s.medium0[i, 0], s.medium0[i, 1]
    for j in range(3):
        s.alpha[j] = 1.0


@part
def chain(g, s, y, most, cutoff):
    """The light's ray through y, up to `most` bends; returns how many there are.

    s takes for each bend its code, slot, η, (u, v), the length of the ray before it (infinity behind the last one: no
    further bend, or not looked for) and the ray behind it; s.ray, s.alpha and s.medium are those at the end. Where it
    ends at a surface that reflects all, s.code[n] and s.bend[n] say at which, and how far beyond.
    """
    set_out(s, y)
    n, reflections = 0, 0
    while n < most:
        s.bend[n, 3], s.code[n, 0] = np.inf, -1
        if next_bend(g, s, np.inf) != BENDS:
            return n
        t, slot = s.out[0], int(s.out[3])
        s.bend[n, 0], s.bend[n, 1], s.bend[n, 2], s.bend[n, 3] = s.out[4], s.out[1], s.out[2], t
        travel(g, slot, t, s.ray)
        bends = bend(g, slot, s.out[1], s.out[2], s.out[4], s.ray, s.normal)
        if not bends and s.total and reflections < REFLECTIONS and beyond(s) >= 0.0:
            bends = bend(g, slot, s.out[1], s.out[2], REFLECTED, s.ray, s.normal)
            s.bend[n, 0] = REFLECTED
            reflections += 1 if g.planar[g.link[slot, PATCH]] >= 0 else CURVED
            leaving = s.touched[3] > 0
            s.touched[0] = -1
            _cross(s.medium, g.link[slot, BODY], leaving)  # back
        if bends and max(s.alpha[0], s.alpha[1], s.alpha[2]) <= cutoff:
            return n
        s.bend[n, 4] = beyond(s)
        if bends or s.bend[n, 4] >= 0.0:
            s.code[n, 0], s.code[n, 1] = 2 * g.link[slot, PATCH] + (1 if s.touched[3] > 0 else 0), slot
        if not bends:
            return n
        for i in range(6):
            for j in range(3):
                s.rays[n, i, j] = s.ray[i, j]
        n += 1
    s.bend[n, 3], s.code[n, 0] = np.inf, -1
    return n


@part
def beyond(s):
    """By how much the cosine at s.normal, where `bend` let no light pass, is smaller than at the critical angle.

    Negative: it was not total reflection.
    """
    cosine, eta = 0.0, s.out[4]
    for j in range(3):
        cosine -= s.ray[1, j] * s.normal[0, j]
    if eta <= 1.0 or cosine <= 0.0:
        return -1.0
    return np.sqrt(max(1.0 - 1.0 / (eta * eta), 0.0)) - cosine


@part
def miss(ray, x):
    """Distance of x from the ray, and how far along the ray that is."""
    along = 0.0
    for j in range(3):
        along += (x[j] - ray[0, j]) * ray[1, j]
    square = 0.0
    for j in range(3):
        away = x[j] - ray[0, j] - along * ray[1, j]
        square += away * away
    return np.sqrt(square), along


@part
def cross_section(ray, x, along, out):
    """Derivatives of the ray's point at length `along`, across the ray: out[:2,:2]; and x across it: out[2,:2]."""
    d0, d1, d2 = ray[1, 0], ray[1, 1], ray[1, 2]
    sign = 1.0 if d2 >= 0.0 else -1.0
    f = -1.0 / (sign + d2)
    h = d0 * d1 * f
    a0, a1, a2 = 1.0 + sign * d0 * d0 * f, sign * h, -sign * d0
    b0, b1, b2 = h, sign + d1 * d1 * f, -d1
    for k in range(3):
        if k < 2:
            q0, q1, q2 = (ray[2 + k, 0] + along * ray[4 + k, 0], ray[2 + k, 1] + along * ray[4 + k, 1],
                          ray[2 + k, 2] + along * ray[4 + k, 2])
        else:
            q0, q1, q2 = x[0] - ray[0, 0], x[1] - ray[0, 1], x[2] - ray[0, 2]
        out[k, 0] = a0 * q0 + a1 * q1 + a2 * q2
        out[k, 1] = b0 * q0 + b1 * q1 + b2 * q2
