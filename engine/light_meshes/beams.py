"""Where refracted light goes: beams that leave one light through glass, as first guesses for Newton's method.

A beam is what the light sends through a small triangle on the first interface, between two of its bends: three rays
and the signature that they share. A ray is written as where it meets the plane z = z0 and its slope there, z being
the axis that it is most along; so the point of a beam that is at x follows from two linear equations. Beams stand in
trees of bounds on place and slope: they have no far end to put in a grid, and points may be anywhere.
Coordinates are the tracer's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .boxes import STACK
from .compiled import kernel
from .media import Glass
from .paths import DEPTH, Scratch, chain

CUTOFF = 1e-4  # beams of light fainter than this are not followed
SHRINK = 1e-3  # corners are sampled so far inside: which triangle the ray meets is then beyond doubt
COARSE = 1 / 8  # of a curved patch's radius: the longest edge of an element
FINE = 1 / 64  # the edge below which elements that differ are not split
FLAT_LEVELS = 2  # but so often in any case: small facets, each with its own signature
BENT = 0.1  # of its width: by how much a beam may miss its own middle ray
PAD = 0.25  # barycentric: how far outside a beam a point may be and still start a search
LEAF = 4


class Beams(NamedTuple):
    """All beams of a light, in the order of their trees."""

    slot: NDArray[np.int32]  # (B,) triangle of the first interface
    uv: NDArray[np.float64]  # (B,3,2) corners on it
    p: NDArray[np.float64]  # (B,3,2) where the corners' rays meet z = z0
    d: NDArray[np.float64]  # (B,3,2) their slopes
    z: NDArray[np.float64]  # (B,3) z0, and the least and greatest z
    group: NDArray[np.int8]  # (B,) 2·axis, + 1 where z runs against it
    k: NDArray[np.int8]  # (B,) bends before the beam
    code: NDArray[np.int32]  # (B,DEPTH) signature, see `paths`
    eta: NDArray[np.float64]  # (B,DEPTH)
    root: NDArray[np.int32]  # (6,) node of each group, −1: none
    bounds: NDArray[np.float64]  # (nodes,11) z0, least and greatest z, place 1, place 2, slope 1, slope 2
    child: NDArray[np.int32]  # (nodes,) first of two children, or first beam of a leaf
    count: NDArray[np.int32]  # (nodes,) beams of a leaf, 0: inner


def trace_beams(g: Glass, s: Scratch, h: float) -> Beams:
    """The beams of a light; h (frame): a miss below h/4 does not matter."""
    size, slot, used = 4096, 0, 0
    arrays = _room(size)
    while slot < len(g.triangle):
        slot, used = _trace(g, s, h, slot, used, *arrays)
        if slot < len(g.triangle):
            arrays = tuple(np.concatenate([a, b]) for a, b in zip(arrays, _room(size), strict=True))
            size *= 2
    arrays = tuple(a[:used] for a in arrays)
    order = np.argsort(arrays[5], kind="stable")
    bounds, child, count = np.empty((2 * used + 6, 11)), np.zeros(2 * used + 6, np.int32), np.zeros(
        2 * used + 6, np.int32)
    root = np.full(6, -1, np.int32)
    nodes = _tree(order, *arrays[2:6], root, bounds, child, count)
    return Beams(*(np.ascontiguousarray(a[order]) for a in arrays), root, bounds[:nodes], child[:nodes], count[:nodes])


def _room(n: int) -> tuple[NDArray, ...]:
    return (np.empty(n, np.int32), np.empty((n, 3, 2)), np.empty((n, 3, 2)), np.empty((n, 3, 2)), np.empty((n, 3)),
            np.empty(n, np.int8), np.empty(n, np.int8), np.zeros((n, DEPTH), np.int32), np.zeros((n, DEPTH)))


@kernel
def _same(code, eta, a, b, k):
    """Whether samples a and b agree on their first k bends."""
    for j in range(k):
        if code[a, j] != code[b, j] or eta[a, j] != eta[b, j]:
            return False
    return True


@kernel
def _axis(D):
    """2·axis that D is most along, + 1 where it runs against it."""
    a = 0
    for j in range(1, 3):
        if abs(D[j]) > abs(D[a]):
            a = j
    return 2 * a + (D[a] < 0.0)


@kernel
def _flatten(P, D, group, z0, p, d):
    """A ray as place and slope in the plane z = z0; False: it runs along the plane or back."""
    a = group >> 1
    sign = -1.0 if group & 1 else 1.0
    slope = sign * D[a]
    if not slope > 0.1:
        return False
    b, c = (a + 1) % 3, (a + 2) % 3
    t = (z0 - sign * P[a]) / slope
    p[0], p[1] = P[b] + t * D[b], P[c] + t * D[c]
    d[0], d[1] = D[b] / slope, D[c] / slope
    return True


@kernel
def _width(p, d, z):
    """Longest side of three rays' triangle at height z above their plane."""
    longest = 0.0
    for i in range(3):
        k = (i + 1) % 3
        x = p[i, 0] - p[k, 0] + z * (d[i, 0] - d[k, 0])
        y = p[i, 1] - p[k, 1] + z * (d[i, 1] - d[k, 1])
        longest = max(longest, x * x + y * y)
    return np.sqrt(longest)


@kernel
def _split_for_bodies(g, P, D, end, width, own):
    """Whether some body on the way is so small that the beam's few rays may all miss it."""
    for b in range(len(g.radius)):
        if b == own or 2.0 * width < g.radius[b]:
            continue
        along = 0.0
        for j in range(3):
            along += (g.centre[b, j] - P[j]) * D[j]
        along = min(max(along, 0.0), end)
        square = 0.0
        for j in range(3):
            away = g.centre[b, j] - P[j] - along * D[j]
            square += away * away
        if square < (g.radius[b] + width) ** 2:
            return True
    return False


@kernel
def _trace(g, s, h, slot, used, o_slot, o_uv, o_p, o_d, o_z, o_group, o_k, o_code, o_eta):
    """Beams of triangles from `slot` on, until all are done or the room is; returns the next triangle and the count."""
    n = np.zeros(4, np.int64)
    code, eta = np.zeros((4, DEPTH), np.int64), np.zeros((4, DEPTH))
    rays, end = np.zeros((4, DEPTH, 6, 3)), np.zeros((4, DEPTH + 1))
    uv = np.zeros((4, 2))
    p, d = np.zeros((4, 2)), np.zeros((4, 2))
    element = np.zeros((4 * 40, 8))  # u, v of three corners, level, first bend that is not done
    P, D, y = np.zeros(3), np.zeros(3), np.zeros(3)
    while slot < len(g.triangle):
        before = used
        full = False
        body = g.body[slot]
        top = 0
        if body >= 0:
            inside = False
            for i in range(1, s.medium0[0, 0] + 1):
                inside = inside or s.medium0[i, 0] == body
            slope = 0.0
            for j in range(3):
                slope += g.Ng[slot, j] * (-s.light[j] if s.sun else g.A[slot, j] - s.light[j])
            if (slope > 0.0) == inside and slope != 0.0:
                top = 1
                element[0] = 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0
        while top and not full:
            top -= 1
            e = element[top].copy()
            level, first = int(e[6]), int(e[7])
            mu, mv = (e[0] + e[2] + e[4]) / 3.0, (e[1] + e[3] + e[5]) / 3.0
            most = 0
            for i in range(4):
                uv[i, 0] = mu if i == 3 else (1.0 - SHRINK) * e[2 * i] + SHRINK * mu
                uv[i, 1] = mv if i == 3 else (1.0 - SHRINK) * e[2 * i + 1] + SHRINK * mv
                for j in range(3):
                    y[j] = g.A[slot, j] + uv[i, 0] * g.E1[slot, j] + uv[i, 1] * g.E2[slot, j]
                n[i] = chain(g, s, y, DEPTH, CUTOFF)
                if n[i] and s.slot[0] != slot:
                    n[i] = 0  # something stands before it: no first interface
                code[i], eta[i], rays[i], end[i] = s.code, s.eta, s.rays, s.end
                most = max(most, n[i])
            edge = 0.0
            for i in range(3):
                k = (i + 1) % 3
                square = 0.0
                for j in range(3):
                    square += ((uv[i, 0] - uv[k, 0]) * g.E1[slot, j] + (uv[i, 1] - uv[k, 1]) * g.E2[slot, j]) ** 2
                edge = max(edge, np.sqrt(square))
            size = g.patch_size[g.patch[slot]]
            splittable = top + 4 < len(element) and level < 40
            differ = splittable and (edge > FINE * size or level < FLAT_LEVELS)
            coarse = splittable and edge > COARSE * size and g.planar[g.patch[slot]] < 0
            for k in range(first, most + 1):
                agree = True
                for i in range(4):
                    agree = agree and n[i] >= k and _same(code, eta, 0, i, k)
                split = coarse or (not agree and differ)
                group, z0 = 0, 0.0
                if agree:
                    P[:], D[:] = rays[3, k - 1, 0], rays[3, k - 1, 1]
                    group = _axis(D)
                    a, sign = group >> 1, (-1.0 if group & 1 else 1.0)
                    z0 = sign * P[a]
                    straight = True
                    for i in range(4):
                        straight = straight and _flatten(rays[i, k - 1, 0], rays[i, k - 1, 1], group, z0, p[i], d[i])
                    if not straight:
                        agree = False
                        split = split or differ
                    elif not split:
                        length = min(max(min(sign * P[a] + end[3, k] * sign * D[a], 1.0 + 4.0 * h) - z0, 0.0), 4.0)
                        for z in (0.0, length):
                            x = p[3, 0] + z * d[3, 0]
                            x -= (p[0, 0] + p[1, 0] + p[2, 0] + z * (d[0, 0] + d[1, 0] + d[2, 0])) / 3.0
                            w = p[3, 1] + z * d[3, 1]
                            w -= (p[0, 1] + p[1, 1] + p[2, 1] + z * (d[0, 1] + d[1, 1] + d[2, 1])) / 3.0
                            width = _width(p, d, z)
                            if np.sqrt(x * x + w * w) > max(BENT * width, 0.25 * h):
                                split = split or differ
                            if len(g.radius) > 1 and not split and differ:
                                own = body if k == 1 else -1
                                split = _split_for_bodies(g, P, D, end[3, k], width, own)
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
                    o_slot[used], o_group[used], o_k[used] = slot, group, k
                    o_uv[used], o_p[used], o_d[used] = uv[:3], p[:3], d[:3]
                    low, high = np.inf, -np.inf
                    for i in range(4):
                        z = sign * rays[i, k - 1, 0, a]
                        low = min(low, z)
                        high = max(high, z + end[i, k] * sign * rays[i, k - 1, 1, a])
                    extent = _width(p, d, 0.0)
                    o_z[used, 0], o_z[used, 1], o_z[used, 2] = z0, low - 0.5 * extent, high + 0.5 * extent
                    o_code[used], o_eta[used] = code[3], eta[3]
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
                    if _beam_of_ray(g, slot, uv, i, rays, k, end[i, k], p, d, o_z[used], P, D):
                        o_slot[used], o_group[used], o_k[used] = slot, _axis(rays[i, k - 1, 1]), k
                        o_uv[used], o_p[used], o_d[used] = uv[:3], p[:3], d[:3]
                        o_code[used], o_eta[used] = code[i], eta[i]
                        used += 1
                if full:
                    break
        if full:
            return slot, before
        slot += 1
    return slot, used


@kernel
def _beam_of_ray(g, slot, uv, i, rays, k, end, p, d, z, P, D):
    """A beam over the whole element from sample i alone: rays of the corners by its derivatives."""
    one, last = rays[i, 0], rays[i, k - 1]
    m00, m01, m10, m11 = 0.0, 0.0, 0.0, 0.0
    for j in range(3):
        m00 += one[2, j] * g.U[slot, j]
        m01 += one[3, j] * g.U[slot, j]
        m10 += one[2, j] * g.V[slot, j]
        m11 += one[3, j] * g.V[slot, j]
    det = m00 * m11 - m01 * m10
    if det == 0.0:
        return False
    group = _axis(last[1])
    axis, sign = group >> 1, (-1.0 if group & 1 else 1.0)
    z[0] = sign * last[0, axis]
    for c in range(3):
        du, dv = uv[c, 0] - uv[i, 0], uv[c, 1] - uv[i, 1]
        a, b = (m11 * du - m01 * dv) / det, (m00 * dv - m10 * du) / det
        for j in range(3):
            P[j] = last[0, j] + a * last[2, j] + b * last[3, j]
            D[j] = last[1, j] + a * last[4, j] + b * last[5, j]
        if not _flatten(P, D, group, z[0], p[c], d[c]):
            return False
    extent = _width(p, d, 0.0)
    z[1] = z[0] - extent
    z[2] = z[0] + end * sign * last[1, axis] + extent if end < np.inf else np.inf
    return True


@kernel
def _bound(order, first, end, p, d, z, out):
    """Bounds of beams order[first:end], padded by PAD."""
    out[0] = np.inf
    for i in range(first, end):
        out[0] = min(out[0], z[order[i], 1])
    for j in range(1, 11, 2):
        out[j], out[j + 1] = np.inf, -np.inf
    for i in range(first, end):
        b = order[i]
        out[1], out[2] = min(out[1], z[b, 1]), max(out[2], z[b, 2])
        for j in range(2):
            for c in range(3):
                e, f = (c + 1) % 3, (c + 2) % 3
                slope = d[b, c, j] + PAD * (2.0 * d[b, c, j] - d[b, e, j] - d[b, f, j])
                place = p[b, c, j] + PAD * (2.0 * p[b, c, j] - p[b, e, j] - p[b, f, j])
                place += (out[0] - z[b, 0]) * slope
                out[3 + 2 * j], out[4 + 2 * j] = min(out[3 + 2 * j], place), max(out[4 + 2 * j], place)
                out[7 + 2 * j], out[8 + 2 * j] = min(out[7 + 2 * j], slope), max(out[8 + 2 * j], slope)


@kernel
def _tree(order, p, d, z, group, root, bounds, child, count):
    stack = np.empty((STACK, 3), np.int64)
    nodes, top = 0, 0
    i = 0
    while i < len(order):
        j = i
        while j < len(order) and group[order[j]] == group[order[i]]:
            j += 1
        root[group[order[i]]] = nodes
        stack[0] = nodes, i, j
        top = 1
        nodes += 1
        while top:
            top -= 1
            node, first, end = stack[top]
            _bound(order, first, end, p, d, z, bounds[node])
            if end - first <= LEAF:
                child[node], count[node] = first, end - first
                continue
            # Slopes weigh by the length over which they matter, about one unit of the frame.
            widest = 3
            for k in range(5, 11, 2):
                if bounds[node, k + 1] - bounds[node, k] > bounds[node, widest + 1] - bounds[node, widest]:
                    widest = k
            key = np.empty(end - first)
            for k in range(first, end):
                b = order[k]
                j2 = (widest - 3) // 2
                if j2 < 2:
                    key[k - first] = p[b, 0, j2] + (bounds[node, 0] - z[b, 0]) * d[b, 0, j2]
                else:
                    key[k - first] = d[b, 0, j2 - 2]
            order[first:end] = order[first:end][np.argsort(key, kind="mergesort")]
            child[node], count[node] = nodes, 0
            middle = (first + end) // 2
            stack[top] = nodes, first, middle
            stack[top + 1] = nodes + 1, middle, end
            top += 2
            nodes += 2
        i = j
    return nodes
