"""One refracted path: a ray with its derivatives, the chain of interfaces it meets, Newton's method towards a point.

A ray is an array (6,3): origin P, unit direction D, and their derivatives by two parameters (Pu, Pv, Du, Dv), carried
along as in Igehy, Tracing Ray Differentials (1999), but without his approximations: normals are interpolated ones.
A path's signature is the sequence of what bends it: 2·patch, + 1 where it leaves the body, and η = n before / n behind.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .boxes import STACK
from .compiled import kernel
from .media import TOUCHING, Glass, closest

DEPTH = 8  # interfaces at which a path may bend
BODIES = 16  # bodies around one point
STEPS = 25  # of Newton's method
HALVINGS = 6  # of one step
WALK = 200  # triangles that one step may cross
FAR = 8.0  # a sun's rays start so far away: the frame's scene lies in [−1, 1]³
# Work of a call, counted by the kernels.
SEEDS, UNCONVERGED, NEWTON, RAYS, REJECTED = range(5)


class Scratch(NamedTuple):
    """A light, and room for one path at a time; one a thread. See `chain`."""

    light: NDArray[np.float64]  # (3,) frame; of a sun the unit vector towards it
    sun: bool
    medium0: NDArray[np.int64]  # (BODIES+1,2) bodies around the light, see `_cross`
    medium: NDArray[np.int64]
    alpha: NDArray[np.float64]  # (3,)
    ray: NDArray[np.float64]  # (6,3)
    code: NDArray[np.int64]  # (DEPTH,)
    eta: NDArray[np.float64]
    slot: NDArray[np.int64]
    uv: NDArray[np.float64]  # (DEPTH,2)
    rays: NDArray[np.float64]  # (DEPTH,6,3)
    alphas: NDArray[np.float64]  # (DEPTH,3)
    end: NDArray[np.float64]  # (DEPTH+1,)
    touched: NDArray[np.int64]  # (10,) see `next_bend`
    normal: NDArray[np.float64]  # (3,3)
    trial: NDArray[np.float64]  # (6,3) Newton's ray
    section: NDArray[np.float64]  # (3,2)
    found: NDArray[np.float64]  # (2,)
    out: NDArray[np.float64]  # (5,)
    stack: NDArray[np.int64]
    work: NDArray[np.int64]  # (5,) SEEDS .. REJECTED


def scratch(g: Glass, light: NDArray[np.float64], sun: bool) -> Scratch:
    """Room for the paths of one light; `light` in the frame."""
    s = Scratch(
        np.ascontiguousarray(light, np.float64), bool(sun), *(np.zeros((BODIES + 1, 2), np.int64) for _ in range(2)),
        np.ones(3), np.zeros((6, 3)), np.zeros(DEPTH, np.int64), np.zeros(DEPTH), np.zeros(DEPTH, np.int64),
        np.zeros((DEPTH, 2)), np.zeros((DEPTH, 6, 3)), np.zeros((DEPTH, 3)), np.zeros(DEPTH + 1),
        np.zeros(10, np.int64), np.zeros((3, 3)), np.zeros((6, 3)), np.zeros((3, 2)), np.zeros(2), np.zeros(5),
        np.zeros(STACK, np.int64), np.zeros(5, np.int64),
    )
    if not sun:
        medium_at(g, s.light, s.medium0, s.work, s.stack, s.out)
    return s


@kernel
def _basis(ray, row):
    """Two unit vectors at right angles to the direction and to each other, into rows `row` and row + 1."""
    x, y, z = ray[1, 0], ray[1, 1], ray[1, 2]
    sign = 1.0 if z >= 0.0 else -1.0
    f = -1.0 / (sign + z)
    g = x * y * f
    ray[row, 0], ray[row, 1], ray[row, 2] = 1.0 + sign * x * x * f, sign * g, -sign * x
    ray[row + 1, 0], ray[row + 1, 1], ray[row + 1, 2] = g, sign + y * y * f, -y


@kernel
def start_ray(light, sun, y, ray):
    """The light's ray through y; parameters: two angles at the light, or lengths across a sun's rays."""
    ray[:] = 0.0
    if sun:
        away = FAR + abs(y[0]) + abs(y[1]) + abs(y[2])
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


@kernel
def _start_at(g, light, sun, slot, u, v, ray):
    """The light's ray at the point (u, v) of a triangle; parameters: u and v."""
    length = 1.0
    for j in range(3):
        ray[0, j] = g.A[slot, j] + u * g.E1[slot, j] + v * g.E2[slot, j]
        ray[1, j] = -light[j] if sun else ray[0, j] - light[j]
        ray[2, j], ray[3, j] = g.E1[slot, j], g.E2[slot, j]
    if sun:
        ray[4:] = 0.0
        return
    length = np.sqrt(ray[1, 0] ** 2 + ray[1, 1] ** 2 + ray[1, 2] ** 2)
    a, b = 0.0, 0.0
    for j in range(3):
        ray[1, j] /= length
        a += ray[1, j] * ray[2, j]
        b += ray[1, j] * ray[3, j]
    for j in range(3):
        ray[4, j] = (ray[2, j] - a * ray[1, j]) / length
        ray[5, j] = (ray[3, j] - b * ray[1, j]) / length


@kernel
def _travel(ray, t, N):
    """Move the ray by t to a plane with normal N; its derivatives then are those of its point in that plane."""
    slope = ray[1, 0] * N[0] + ray[1, 1] * N[1] + ray[1, 2] * N[2]
    for k in range(2, 4):
        away = 0.0
        for j in range(3):
            ray[k, j] += t * ray[k + 2, j]
            away += ray[k, j] * N[j]
        for j in range(3):
            ray[k, j] -= away / slope * ray[1, j]
    for j in range(3):
        ray[0, j] += t * ray[1, j]


@kernel
def _bend(g, slot, u, v, eta, ray, normal):
    """Snell's law at the ray's point (u, v) of a triangle, by the shading normal; False: no light passes.

    That is total reflection, or a shading normal by which the ray would not reach or not leave the surface.
    """
    D, Ng = ray[1], g.Ng[slot]
    facing = 1.0 if D[0] * Ng[0] + D[1] * Ng[1] + D[2] * Ng[2] > 0.0 else -1.0
    N, Nu, Nv = normal[0], normal[1], normal[2]  # against the ray, and its derivatives
    if g.flat[slot]:
        for j in range(3):
            N[j], Nu[j], Nv[j] = -facing * Ng[j], 0.0, 0.0
    else:
        n = g.Ns[slot]
        for k in range(2):
            du, dv = 0.0, 0.0
            for j in range(3):
                du += ray[2 + k, j] * g.U[slot, j]
                dv += ray[2 + k, j] * g.V[slot, j]
            for j in range(3):
                normal[1 + k, j] = -facing * (du * (n[1, j] - n[0, j]) + dv * (n[2, j] - n[0, j]))
        length = 0.0
        for j in range(3):
            N[j] = -facing * (n[0, j] + u * (n[1, j] - n[0, j]) + v * (n[2, j] - n[0, j]))
            length += N[j] * N[j]
        length = np.sqrt(length)
        a, b = 0.0, 0.0
        for j in range(3):
            N[j] /= length
            a += Nu[j] * N[j]
            b += Nv[j] * N[j]
        for j in range(3):
            Nu[j] = (Nu[j] - a * N[j]) / length
            Nv[j] = (Nv[j] - b * N[j]) / length
    c = -(D[0] * N[0] + D[1] * N[1] + D[2] * N[2])
    square = 1.0 - eta * eta * (1.0 - c * c)
    if not (c > 0.0 and square > 0.0):
        return False
    root = np.sqrt(square)
    mu = eta * c - root
    for k in range(2):
        dc = 0.0
        for j in range(3):
            dc -= ray[4 + k, j] * N[j] + D[j] * normal[1 + k, j]
        dmu = (eta - eta * eta * c / root) * dc
        for j in range(3):
            ray[4 + k, j] = eta * ray[4 + k, j] + dmu * N[j] + mu * normal[1 + k, j]
    through = 0.0
    for j in range(3):
        D[j] = eta * D[j] + mu * N[j]
        through += D[j] * Ng[j]
    return through * facing > 0.0


@kernel
def _medium_index(g, medium):
    """(n, rank) of the medium that a list of bodies makes; air: 1, −1."""
    n, rank = 1.0, np.int64(-1)
    for i in range(1, medium[0, 0] + 1):
        if g.rank[medium[i, 0]] > rank:
            rank = g.rank[medium[i, 0]]
            n = g.ior[medium[i, 0]]
    return n, rank


@kernel
def _cross(g, medium, body, entering):
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


@kernel
def next_bend(g, ray, end, medium, alpha, touched, work, stack, out):
    """Follow the ray to the first surface that bends it, or to `end`: BENDS, ENDS or BROKEN (surfaces not closed).

    out = t, u, v, slot, η. alpha (3,) takes t of each surface on the way, the last one included; a surface inside a
    medium of higher priority is not there. touched = number of slots met at the ray's origin, the last one's body,
    owner and facing, those slots; a second triangle of one surface at one place is an edge and counts once.
    """
    t0, last = 0.0, -1.0
    if touched[0]:
        t0, last = -2.0 * TOUCHING, 0.0
    last_body, last_owner, last_facing = touched[1], touched[2], touched[3]
    while True:
        work[RAYS] += 1
        slot = closest(g, ray[0], ray[1], t0, end, touched[4:], touched[0], -1, 0.0, stack, out)
        if slot < 0:
            return ENDS
        t = out[0]
        D, Ng = ray[1], g.Ng[slot]
        facing = 1 if D[0] * Ng[0] + D[1] * Ng[1] + D[2] * Ng[2] > 0.0 else -1
        body, owner = np.int64(g.body[slot]), np.int64(g.owner[slot])
        edge = abs(t - last) < TOUCHING and body == last_body and owner == last_owner and (
            facing == last_facing or body < 0)
        if t - last > 2.0 * TOUCHING:
            touched[0] = 0
        if touched[0] < len(touched) - 4:
            touched[4 + touched[0]] = slot
            touched[0] += 1
            t0 = max(t0, t - 2.0 * TOUCHING)
        else:
            t0 = max(t0, t)
        last, last_body, last_owner, last_facing = t, body, owner, facing
        touched[1], touched[2], touched[3] = body, owner, facing
        if edge:
            continue
        if body >= 0:
            before, rank = _medium_index(g, medium)
            if not _cross(g, medium, body, facing < 0):
                return BROKEN
            behind, rank_behind = _medium_index(g, medium)
            if rank == rank_behind:
                continue  # hidden in a medium of higher priority
        else:
            before, behind = 1.0, 1.0
        for j in range(3):
            alpha[j] *= g.t[slot, j]
        if before != behind:
            out[3], out[4] = slot, before / behind
            return BENDS


@kernel
def medium_at(g, P, medium, work, stack, out):
    """The bodies around P: those that a ray from there leaves more often than it enters."""
    medium[:] = 0
    balance = np.zeros(len(g.ior), np.int64)
    D = np.sqrt(np.array([2.0, 3.0, 5.0]) / 10.0)  # along no plane that an artist builds
    skip = np.empty(1, np.int64)
    skips, t0, last, last_body, last_facing = 0, 0.0, -1.0, -1, 0.0
    while True:
        work[RAYS] += 1
        slot = closest(g, P, D, t0, np.inf, skip, skips, -1, 0.0, stack, out)
        if slot < 0:
            break
        t0, skip[0], skips = out[0], slot, 1
        body = g.body[slot]
        facing = 1.0 if (D * g.Ng[slot]).sum() > 0.0 else -1.0
        if body >= 0 and not (body == last_body and facing == last_facing and t0 - last < TOUCHING):
            balance[body] += 1 if facing > 0.0 else -1
        last, last_body, last_facing = t0, body, facing
    for b in range(len(balance)):
        if balance[b] > 0 and medium[0, 0] < BODIES:
            medium[0, 0] += 1
            medium[medium[0, 0], 0], medium[medium[0, 0], 1] = b, balance[b]


@kernel
def chain(g, s, y, most, cutoff):
    """The light's ray through y, up to `most` bends; returns how many there are.

    s (Scratch) takes for each bend its code and η, slot and (u, v), and the ray and α behind it; s.end[j]: how long
    the ray before bend j is, infinity: no further bend, or not looked for.
    """
    ray, medium, alpha = s.ray, s.medium, s.alpha
    start_ray(s.light, s.sun, y, ray)
    medium[:] = s.medium0
    alpha[:] = 1.0
    s.touched[0] = 0
    n = 0
    while n < most:
        s.end[n] = np.inf
        if next_bend(g, ray, np.inf, medium, alpha, s.touched, s.work, s.stack, s.out) != BENDS:
            break
        t, u, v, slot, eta = s.out[0], s.out[1], s.out[2], int(s.out[3]), s.out[4]
        s.end[n] = t
        _travel(ray, t, g.Ng[slot])
        if not _bend(g, slot, u, v, eta, ray, s.normal) or max(alpha[0], alpha[1], alpha[2]) <= cutoff:
            break
        s.code[n], s.eta[n], s.slot[n] = 2 * g.patch[slot] + (s.touched[3] > 0), eta, slot
        s.uv[n, 0], s.uv[n, 1] = u, v
        s.rays[n] = ray
        s.alphas[n] = alpha
        n += 1
    if n == most:
        s.end[n] = np.inf
    return n


@kernel
def _towards(g, s, x, slot, u, v, code, eta, k):
    """Lengths (distance of x from the path's end ray, from its last bend along it) of a path given by its first point.

    Each further interface is looked for on its own patch only. Leaves the ray in s.trial; a negative second length
    says that there is no such path.
    """
    ray = s.trial
    _start_at(g, s.light, s.sun, slot, u, v, ray)
    D, Ng = ray[1], g.Ng[slot]
    slope = D[0] * Ng[0] + D[1] * Ng[1] + D[2] * Ng[2]
    if (slope > 0.0) != (code[0] & 1) or not _bend(g, slot, u, v, eta[0], ray, s.normal):
        return np.inf, -1.0
    for j in range(1, k):
        s.work[RAYS] += 1
        patch, facing = code[j] >> 1, 1.0 if code[j] & 1 else -1.0
        s.touched[4] = slot
        slot = closest(g, ray[0], ray[1], 0.0, np.inf, s.touched[4:], 1, patch, facing, s.stack, s.out)
        if slot >= 0:
            t, u, v = s.out[0], s.out[1], s.out[2]
        elif g.planar[patch] >= 0:
            # A plane goes on where its patch ends: Newton's method may come back from there.
            slot = g.planar[patch]
            Ng = g.Ng[slot]
            slope, away = 0.0, 0.0
            for i in range(3):
                slope += ray[1, i] * Ng[i]
                away += (g.A[slot, i] - ray[0, i]) * Ng[i]
            t = away / slope if slope * facing > 0.0 else -1.0
            if not t > 0.0:
                return np.inf, -1.0
            u, v = 0.0, 0.0
        else:
            return np.inf, -1.0
        _travel(ray, t, g.Ng[slot])
        if not _bend(g, slot, u, v, eta[j], ray, s.normal):
            return np.inf, -1.0
    return miss(ray, x)


@kernel
def miss(ray, x):
    """Distance of x from the ray, and how far along the ray that is."""
    D = ray[1]
    along = 0.0
    for j in range(3):
        along += (x[j] - ray[0, j]) * D[j]
    square = 0.0
    for j in range(3):
        away = x[j] - ray[0, j] - along * D[j]
        square += away * away
    return np.sqrt(square), along


@kernel
def cross_section(ray, x, along, out):
    """Derivatives of the ray's point at length `along`, across the ray: out[:2,:2]; and x across it: out[2,:2]."""
    D = ray[1]
    sign = 1.0 if D[2] >= 0.0 else -1.0
    f = -1.0 / (sign + D[2])
    h = D[0] * D[1] * f
    a0, a1, a2 = 1.0 + sign * D[0] * D[0] * f, sign * h, -sign * D[0]
    b0, b1, b2 = h, sign + D[1] * D[1] * f, -D[1]
    for k in range(3):
        if k < 2:
            q0, q1, q2 = (ray[2 + k, 0] + along * ray[4 + k, 0], ray[2 + k, 1] + along * ray[4 + k, 1],
                          ray[2 + k, 2] + along * ray[4 + k, 2])
        else:
            q0, q1, q2 = x[0] - ray[0, 0], x[1] - ray[0, 1], x[2] - ray[0, 2]
        out[k, 0] = a0 * q0 + a1 * q1 + a2 * q2
        out[k, 1] = b0 * q0 + b1 * q1 + b2 * q2


@kernel
def _walk(g, slot, u, v, du, dv, out):
    """From (u, v) of a triangle by (du, dv) over its patch, straight on across edges; out = u, v; returns the slot.

    On a plane there is nothing to walk over, and at the end of a curved patch the way ends.
    """
    if g.planar[g.patch[slot]] >= 0:
        out[0], out[1] = u + du, v + dv
        return slot
    for _ in range(WALK):
        a, b = u + du, v + dv
        if a >= 0.0 and b >= 0.0 and a + b <= 1.0:
            u, v = a, b
            break
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
        other = g.neighbour[slot, edge]
        if other < 0:
            break
        # Turn the rest of the way about the edge into the other plane.
        w0 = du * g.E1[slot, 0] + dv * g.E2[slot, 0]
        w1 = du * g.E1[slot, 1] + dv * g.E2[slot, 1]
        w2 = du * g.E1[slot, 2] + dv * g.E2[slot, 2]
        N, M = g.Ng[slot], g.Ng[other]
        cosine = N[0] * M[0] + N[1] * M[1] + N[2] * M[2]
        if cosine < -0.99:
            break
        f = (w0 * M[0] + w1 * M[1] + w2 * M[2]) / (1.0 + cosine)
        w0, w1, w2 = w0 - f * (N[0] + M[0]), w1 - f * (N[1] + M[1]), w2 - f * (N[2] + M[2])
        p0 = g.A[slot, 0] + u * g.E1[slot, 0] + v * g.E2[slot, 0] - g.A[other, 0]
        p1 = g.A[slot, 1] + u * g.E1[slot, 1] + v * g.E2[slot, 1] - g.A[other, 1]
        p2 = g.A[slot, 2] + u * g.E1[slot, 2] + v * g.E2[slot, 2] - g.A[other, 2]
        U, V = g.U[other], g.V[other]
        u = max(p0 * U[0] + p1 * U[1] + p2 * U[2], 0.0)
        v = max(p0 * V[0] + p1 * V[1] + p2 * V[2], 0.0)
        if u + v > 1.0:
            u, v = u / (u + v), v / (u + v)
        du, dv = w0 * U[0] + w1 * U[1] + w2 * U[2], w0 * V[0] + w1 * V[1] + w2 * V[2]
        slot = other
    out[0], out[1] = u, v
    return slot


@kernel
def newton(g, s, x, slot, u, v, code, eta, k):
    """Newton's method on the first point of a path with this signature, until its end ray passes through x.

    Damped: a step is halved until it brings the ray nearer. Returns the slot (−1: not found); s.found = u, v.
    The position on the first surface is the unknown, not the direction at the light: at grazing angles a direction
    says too little (method §3).
    """
    size = g.patch_size[code[0] >> 1]
    distance, along = _towards(g, s, x, slot, u, v, code, eta, k)
    if not along > 0.0:
        return -1
    for _ in range(STEPS):
        s.work[NEWTON] += 1
        cross_section(s.trial, x, along, s.section)
        m = s.section
        det = m[0, 0] * m[1, 1] - m[1, 0] * m[0, 1]
        if not abs(det) > 1e-300:
            return -1
        du = (m[2, 0] * m[1, 1] - m[1, 0] * m[2, 1]) / det
        dv = (m[0, 0] * m[2, 1] - m[2, 0] * m[0, 1]) / det
        length = 0.0
        for j in range(3):
            length += (du * g.E1[slot, j] + dv * g.E2[slot, j]) ** 2
        length = np.sqrt(length)
        if not length < np.inf:
            return -1
        if length <= 1e-9 * size:  # the next step would be its square
            if distance <= 1e-8 * size:
                s.found[0], s.found[1] = u + du, v + dv
                return slot
            return -1
        damp = min(1.0, 0.5 * size / length)
        nearer = False
        for _ in range(HALVINGS + 1):
            there = _walk(g, slot, u, v, damp * du, damp * dv, s.found)
            trial, along_trial = _towards(g, s, x, there, s.found[0], s.found[1], code, eta, k)
            if along_trial > 0.0 and trial < distance:
                nearer = True
                break
            damp *= 0.5
        if not nearer:
            if distance <= 1e-11 * size:  # nothing left but rounding
                s.found[0], s.found[1] = u, v
                return slot
            return -1
        slot, u, v, distance, along = there, s.found[0], s.found[1], trial, along_trial
    return -1
