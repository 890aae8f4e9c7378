"""Where refracted light goes: beams that leave one light through glass, as first guesses for Newton's method.

A beam is what the light sends through a small triangle on the first interface, between two of its bends: three rays
and the signature that they share. A ray is written as where it meets the plane z = z0 and its slope there, z being
the axis that it is most along; so the point of a beam that is at x follows from two linear equations. Beams stand in
trees of bounds on place and slope: they have no far end to put in a grid, and points may be anywhere.
Coordinates are the tracer's frame.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .beam_tree import beam_tree
from .compiled import kernel, part
from .media import BODY, E1, E2, FLAT_SHADED, NG, PATCH, A, Glass, U, V
from .optics import DEPTH, RAYS, Scratch, chain

CUTOFF = 1e-4  # beams of light fainter than this are not followed
SHRINK = 1e-3  # corners are sampled so far inside: which triangle the ray meets is then beyond doubt
COARSE = 1 / 8  # of a curved patch's radius: the longest edge of an element
WIDE = 1 / 4  # and as a share of its distance from the light, on any patch
FINE = 1 / 64  # of a body's radius, or of that distance: elements with shorter edges are not split because they differ;
#                twice as much for each body more that the light has passed
BUDGET = 3_000_000, 40  # rays, and rays a triangle, that the beams of a light may take
FLAT_LEVELS = 2  # but so often in any case: small facets, each with its own signature
BENT = 0.1  # of its width: by how much a beam may miss its own middle ray
PAD = 0.3  # barycentric: how far outside a beam a point may be and still start a search


class Beams(NamedTuple):
    """All beams of a light, in the order of their trees."""

    slot: NDArray[np.int32]  # (B,) triangle of the first interface
    uv: NDArray[np.float64]  # (B,3,2) corners on it
    p: NDArray[np.float64]  # (B,3,2) where the corners' rays meet z = z0
    d: NDArray[np.float64]  # (B,3,2) their slopes
    z: NDArray[np.float64]  # (B,3) z0, and the least and greatest z
    group: NDArray[np.int8]  # (B,) 2·axis, + 1 where z runs against it
    k: NDArray[np.int8]  # (B,) bends before the beam
    code: NDArray[np.int32]  # (B,DEPTH) signature, see `optics`
    eta: NDArray[np.float64]  # (B,DEPTH)
    root: NDArray[np.int64]  # (6,) see `beam_tree`
    bounds: NDArray[np.float64]  # (nodes,11)
    child: NDArray[np.int64]  # (nodes,2)
    most: int  # bends that light was followed through: DEPTH, or less where many bodies scatter it


def trace_beams(g: Glass, s: Scratch, h: float) -> Beams:
    """The beams of a light; h (frame): a miss below h/4 does not matter."""
    size, slot, used, fine, most = 4096, 0, 0, FINE, DEPTH
    arrays = _room(size)
    limit = BUDGET[0] + BUDGET[1] * len(g.triangle)
    while slot < len(g.triangle):
        slot, used = _trace(g, s, h, fine, most, limit, slot, used, *arrays)
        if slot < len(g.triangle) and s.work[RAYS] > limit:
            # Light scattered by many bodies: there is no end to what could be told apart.
            slot, used, fine, most = 0, 0, 2.0 * fine, most - 2
            s.work[RAYS] = 0
            if most == 2:
                limit = 1 << 60
        elif slot < len(g.triangle):
            arrays = tuple(np.concatenate([a, b]) for a, b in zip(arrays, _room(size), strict=True))
            size *= 2
    arrays = tuple(a[:used] for a in arrays)
    order, root, bounds, child = beam_tree(arrays[2], arrays[3], arrays[4], arrays[5], PAD)
    columns: Any = (*(np.ascontiguousarray(a[order]) for a in arrays), root, bounds, child, most)
    return Beams(*columns)


def _room(n: int) -> tuple[NDArray, ...]:
    return (np.empty(n, np.int32), np.empty((n, 3, 2)), np.empty((n, 3, 2)), np.empty((n, 3, 2)), np.empty((n, 3)),
            np.empty(n, np.int8), np.empty(n, np.int8), np.zeros((n, DEPTH), np.int32), np.zeros((n, DEPTH)))


@part
def _same(code, eta, a, b, k):
    """Whether samples a and b agree on their first k bends."""
    same = True
    for j in range(k):
        same = same and code[a, j] == code[b, j] and eta[a, j] == eta[b, j]
    return same


@part
def _axis(D):
    """2·axis that D is most along, + 1 where it runs against it."""
    a = 0
    for j in range(1, 3):
        if abs(D[j]) > abs(D[a]):
            a = j
    return 2 * a + (D[a] < 0.0)


@part
def _flatten(P, D, group, z0, i, p, d):
    """A ray as place p[i] and slope d[i] in the plane z = z0; False: it runs along the plane or back."""
    a = group >> 1
    sign = -1.0 if group & 1 else 1.0
    slope = sign * D[a]
    if not slope > 0.1:
        return False
    b, c = (a + 1) % 3, (a + 2) % 3
    t = (z0 - sign * P[a]) / slope
    p[i, 0], p[i, 1] = P[b] + t * D[b], P[c] + t * D[c]
    d[i, 0], d[i, 1] = D[b] / slope, D[c] / slope
    return True


@part
def _width(p, d, z):
    """Longest side of three rays' triangle at height z above their plane."""
    longest = 0.0
    for i in range(3):
        k = (i + 1) % 3
        x = p[i, 0] - p[k, 0] + z * (d[i, 0] - d[k, 0])
        y = p[i, 1] - p[k, 1] + z * (d[i, 1] - d[k, 1])
        longest = max(longest, x * x + y * y)
    return np.sqrt(longest)


@part
def _split_for_bodies(g, P, D, end, width, own):
    """Whether some body on the way is so small that the beam's few rays may all miss it."""
    for b in range(len(g.ball)):
        if b == own or 2.0 * width < g.ball[b, 3]:
            continue
        along = 0.0
        for j in range(3):
            along += (g.ball[b, j] - P[j]) * D[j]
        along = min(max(along, 0.0), end)
        square = 0.0
        for j in range(3):
            away = g.ball[b, j] - P[j] - along * D[j]
            square += away * away
        if square < (g.ball[b, 3] + width) ** 2:
            return True
    return False


@part
def _extent(g, slot, e, s):
    """Longest edge of an element, and its middle's distance from the light (a sun's: infinite)."""
    edge, square = 0.0, 0.0
    for i in range(3):
        k = (i + 1) % 3
        length = 0.0
        for j in range(3):
            du, dv = e[2 * i] - e[2 * k], e[2 * i + 1] - e[2 * k + 1]
            length += (du * g.place[slot, E1 + j] + dv * g.place[slot, E2 + j]) ** 2
        edge = max(edge, length)
    for j in range(3):
        middle = g.place[slot, A + j] - s.light[j]
        for i in range(3):
            middle += (e[2 * i] * g.place[slot, E1 + j] + e[2 * i + 1] * g.place[slot, E2 + j]) / 3.0
        square += middle * middle
    return np.sqrt(edge), np.inf if s.sun else np.sqrt(square)


@kernel
def _trace(g, s, h, fine, deepest, limit, slot, used, o_slot, o_uv, o_p, o_d, o_z, o_group, o_k, o_code, o_eta):
    """Beams of triangles from `slot` on, until all are done or the room is; returns the next triangle and the count."""
    n = np.zeros(4, np.int64)
    code, eta = np.zeros((4, DEPTH), np.int64), np.zeros((4, DEPTH))
    rays, end = np.zeros((4, DEPTH, 6, 3)), np.zeros((4, DEPTH + 1))
    uv = np.zeros((4, 2))
    p, d, z = np.zeros((4, 2)), np.zeros((4, 2)), np.zeros(3)
    element = np.zeros((4 * 40, 8))  # u, v of three corners, level, first bend that is not done
    P, D, y, e = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(8)
    while slot < len(g.triangle):
        before = used
        full = False
        body = g.link[slot, BODY]
        top = 0
        if body >= 0:
            inside = False
            for i in range(1, s.medium0[0, 0] + 1):
                inside = inside or s.medium0[i, 0] == body
            slope = 0.0
            for j in range(3):
                slope += g.place[slot, NG + j] * (-s.light[j] if s.sun else g.place[slot, A + j] - s.light[j])
            if (slope > 0.0) == inside and slope != 0.0:
                top = 1
                for j in range(8):
                    element[0, j] = 1.0 if j == 2 or j == 5 or j == 7 else 0.0
        while top and not full:
            top -= 1
            for j in range(8):
                e[j] = element[top, j]
            level, first = int(e[6]), int(e[7])
            patch = g.link[slot, PATCH]
            edge, distance = _extent(g, slot, e, s)
            size = min(g.ball[body, 3], distance)
            # A small triangle of a smooth mesh needs but one ray: its derivatives say the rest.
            alone = level == 0 and edge < 0.5 * fine * size and g.link[slot, FLAT_SHADED] == 0
            mu, mv = (e[0] + e[2] + e[4]) / 3.0, (e[1] + e[3] + e[5]) / 3.0
            most = 0
            for i in range(4):
                uv[i, 0] = mu if i == 3 else (1.0 - SHRINK) * e[2 * i] + SHRINK * mu
                uv[i, 1] = mv if i == 3 else (1.0 - SHRINK) * e[2 * i + 1] + SHRINK * mv
                n[i] = 0
                if alone and i < 3:
                    continue
                for j in range(3):
                    y[j] = g.place[slot, A + j] + uv[i, 0] * g.place[slot, E1 + j] + uv[i, 1] * g.place[slot, E2 + j]
                n[i] = chain(g, s, y, np.int64(deepest), CUTOFF)
                if n[i] and s.code[0, 1] != slot:
                    n[i] = 0  # something stands before it: no first interface
                _keep(s, n[i], i, code, eta, rays, end)
                full = full or s.work[RAYS] > limit
                most = max(most, n[i])
            splittable = top + 4 < len(element) and not alone
            coarse = splittable and (
                edge > WIDE * distance or (edge > COARSE * g.patch_size[patch] and g.planar[patch] < 0))
            # Where no light passes at the samples (total reflection) it may still pass between them.
            for k in range(first, max(most, first if coarse else 0) + 1):
                least = fine * size * (1 << ((k - 1) >> 1))
                differ = splittable and (edge > least or (level < FLAT_LEVELS and fine == FINE))
                agree = True
                for i in range(4):
                    agree = agree and n[i] >= k and _same(code, eta, i, np.int64(0), k)
                split = coarse or (not agree and differ)
                group, z0 = 0, 0.0
                if agree:
                    _ray_of(rays, 3, k, P, D)
                    group = _axis(D)
                    a, sign = group >> 1, (-1.0 if group & 1 else 1.0)
                    z0 = sign * P[a]
                    straight = True
                    for i in range(4):
                        _ray_of(rays, i, k, P, D)
                        straight = straight and _flatten(P, D, group, z0, i, p, d)
                    if not straight:
                        agree = False
                        split = split or differ
                    elif not split:
                        length = min(max(min(sign * P[a] + end[3, k] * sign * D[a], 1.0 + 4.0 * h) - z0, 0.0), 4.0)
                        for far in range(2):
                            at = far * length
                            x = p[3, 0] + at * d[3, 0]
                            x -= (p[0, 0] + p[1, 0] + p[2, 0] + at * (d[0, 0] + d[1, 0] + d[2, 0])) / 3.0
                            w = p[3, 1] + at * d[3, 1]
                            w -= (p[0, 1] + p[1, 1] + p[2, 1] + at * (d[0, 1] + d[1, 1] + d[2, 1])) / 3.0
                            width = _width(p, d, at)
                            if np.sqrt(x * x + w * w) > max(BENT * width, 0.25 * h):
                                split = split or differ
                            if len(g.ball) > 1 and not split and differ:
                                split = _split_for_bodies(g, P, D, end[3, k], width, body if k == 1 else -1)
                if split:
                    for i in range(4):  # three at the corners, one between the middles of the edges
                        for c in range(3):
                            j = i if i < 3 else (c + 1) % 3
                            element[top, 2 * c] = 0.5 * (e[2 * c] + e[2 * j])
                            element[top, 2 * c + 1] = 0.5 * (e[2 * c + 1] + e[2 * j + 1])
                        element[top, 6], element[top, 7] = level + 1, k
                        top += 1
                    break
                if agree:
                    if used == len(o_slot):
                        full = True
                        break
                    low, high = np.inf, -np.inf
                    for i in range(4):
                        at = sign * rays[i, k - 1, 0, a]
                        low = min(low, at)
                        high = max(high, at + end[i, k] * sign * rays[i, k - 1, 1, a])
                    extent = _width(p, d, 0.0)
                    z[0], z[1], z[2] = z0, low - 0.5 * extent, high + 0.5 * extent
                    _emit(used, slot, uv, p, d, z, group, k, code, eta, np.int64(3), o_slot, o_uv, o_p, o_d, o_z,
                          o_group, o_k, o_code, o_eta)
                    used += 1
                    continue
                # Too small to split: each sample stands for its own signature, with its derivatives for a beam.
                for i in range(4):
                    own = n[i] >= k
                    for other in range(i):
                        own = own and not (n[other] >= k and _same(code, eta, i, other, k))
                    if not own:
                        continue
                    if used == len(o_slot):
                        full = True
                        break
                    group = _beam_of_ray(g, slot, uv, i, rays, k, end[i, k], p, d, z, P, D)
                    if group >= 0:
                        _emit(used, slot, uv, p, d, z, group, k, code, eta, i, o_slot, o_uv, o_p, o_d, o_z, o_group,
                              o_k, o_code, o_eta)
                        used += 1
                if full:
                    break
        if full:
            return slot, before
        slot += 1
    return slot, used


@part
def _beam_of_ray(g, slot, uv, i, rays, k, end, p, d, z, P, D):
    """A beam over the element from sample i alone, corners' rays by its derivatives; returns its group, −1: none."""
    m00, m01, m10, m11 = 0.0, 0.0, 0.0, 0.0
    for j in range(3):
        m00 += rays[i, 0, 2, j] * g.place[slot, U + j]
        m01 += rays[i, 0, 3, j] * g.place[slot, U + j]
        m10 += rays[i, 0, 2, j] * g.place[slot, V + j]
        m11 += rays[i, 0, 3, j] * g.place[slot, V + j]
    det = m00 * m11 - m01 * m10
    if det == 0.0:
        return -1
    _ray_of(rays, i, k, P, D)
    group = _axis(D)
    axis, sign = group >> 1, (-1.0 if group & 1 else 1.0)
    z[0] = sign * P[axis]
    last = z[0] + end * sign * D[axis]
    for c in range(3):
        du, dv = uv[c, 0] - uv[i, 0], uv[c, 1] - uv[i, 1]
        a, b = (m11 * du - m01 * dv) / det, (m00 * dv - m10 * du) / det
        _ray_of(rays, i, k, P, D)
        for j in range(3):
            P[j] += a * rays[i, k - 1, 2, j] + b * rays[i, k - 1, 3, j]
            D[j] += a * rays[i, k - 1, 4, j] + b * rays[i, k - 1, 5, j]
        if not _flatten(P, D, group, z[0], c, p, d):
            return -1
    extent = _width(p, d, 0.0)
    z[1], z[2] = z[0] - extent, last + extent
    return group


@part
def _ray_of(rays, i, k, P, D):
    """Origin and direction of sample i behind its bend k."""
    for j in range(3):
        P[j], D[j] = rays[i, k - 1, 0, j], rays[i, k - 1, 1, j]


@part
def _keep(s, n, i, code, eta, rays, end):
    """Store the chain in s as sample i."""
    for k in range(n + 1):
        end[i, k] = s.bend[k, 3]
    for k in range(n):
        code[i, k], eta[i, k] = s.code[k, 0], s.bend[k, 0]
        for r in range(6):
            for j in range(3):
                rays[i, k, r, j] = s.rays[k, r, j]


@part
def _emit(b, slot, uv, p, d, z, group, k, code, eta, i, o_slot, o_uv, o_p, o_d, o_z, o_group, o_k, o_code, o_eta):
    """Write beam b, with the signature of sample i."""
    o_slot[b], o_group[b], o_k[b] = slot, group, k
    for c in range(3):
        o_z[b, c] = z[c]
        for j in range(2):
            o_uv[b, c, j], o_p[b, c, j], o_d[b, c, j] = uv[c, j], p[c, j], d[c, j]
    for j in range(k):
        o_code[b, j], o_eta[b, j] = code[i, j], eta[i, j]
