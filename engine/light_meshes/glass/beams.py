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

from ..support.compiled import kernel, part
from .beam_tree import beam_tree
from .media import BODY, E1, E2, FLAT_SHADED, NG, PATCH, A, Glass, U, V
from .optics import BENDS, DEPTH, FAR, RAYS, Scratch, chain, next_bend

CUTOFF = 1e-4  # beams of light fainter than this are not followed
SHRINK = 1e-3  # corners are sampled so far inside: which triangle the ray meets is then beyond doubt
COARSE = 1 / 8  # of a curved patch's radius: the longest edge of an element
WIDE = 1 / 4  # and as a share of its distance from the light, on any patch
FINE = 1 / 64  # of a body's radius, or of that distance: elements with shorter edges are not split because they differ;
COARSER = 3  # twice as much for each body more that the light has passed, but not so often more
USUAL = 8  # bends that light is followed through at first, and twice as often where some of it goes on
DEEPER = 8  # if that takes no more than so many times the rays
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
    code: NDArray[np.int32]  # (B,most) signature, see `optics`
    eta: NDArray[np.float64]  # (B,most)
    root: NDArray[np.int64]  # (6,) see `beam_tree`
    bounds: NDArray[np.float64]  # (nodes,11)
    child: NDArray[np.int64]  # (nodes,2)
    most: int  # bends that light was followed through: as many as it takes, or less where many bodies scatter it
    cut: bool  # whether some of it went on behind them


class _Samples(NamedTuple):
    """Room for the light through one element: its four samples, and the beam that they make."""

    n: NDArray[np.int64]  # (4,) bends
    code: NDArray[np.int64]  # (4,DEPTH) signatures
    eta: NDArray[np.float64]
    rays: NDArray[np.float64]  # (4,DEPTH,6,3) behind each bend
    end: NDArray[np.float64]  # (4,DEPTH+1) their lengths
    stop: NDArray[np.int64]  # (4,) code of what reflects all of it at last, −1: nothing does
    beyond: NDArray[np.float64]  # (4,) see `optics.beyond`
    uv: NDArray[np.float64]  # (4,2) where they are on the triangle
    p: NDArray[np.float64]  # (4,2), (4,2), (3,) as in `Beams`
    d: NDArray[np.float64]
    z: NDArray[np.float64]
    P: NDArray[np.float64]  # (3,) each: a ray, a point
    D: NDArray[np.float64]
    y: NDArray[np.float64]


def trace_beams(g: Glass, s: Scratch, h: float) -> Beams:
    """The beams of a light; h (frame): a miss below h/4 does not matter."""
    limit, deepest, fine = BUDGET[0] + BUDGET[1] * len(g.triangle), USUAL, FINE
    found = _followed(g, s, h, fine, deepest, limit)
    while found is None:
        # Light scattered by many bodies: there is no end to what could be told apart.
        fine, deepest = 2.0 * fine, deepest - 2
        found = _followed(g, s, h, fine, deepest, limit if deepest > 2 else 1 << 60)
    while found[1] and fine == FINE and deepest < DEPTH:
        deeper = _followed(g, s, h, fine, 2 * deepest, min(limit, DEEPER * int(s.work[RAYS])))
        if deeper is None:
            break
        found, deepest = deeper, 2 * deepest
    arrays, cut = found
    order, root, bounds, child = beam_tree(arrays[2], arrays[3], arrays[4], arrays[5], PAD)
    columns: Any = (*(np.ascontiguousarray(a[order]) for a in arrays), root, bounds, child, deepest, cut)
    return Beams(*columns)


def _followed(g: Glass, s: Scratch, h: float, fine: float, deepest: int,
              limit: int) -> tuple[tuple[NDArray, ...], bool] | None:
    """The beams through up to `deepest` bends, and whether light goes on behind them; None: more than `limit` rays."""
    size, slot, used, cut = 4096, 0, 0, False
    samples = _Samples(
        np.zeros(4, np.int64), np.zeros((4, DEPTH), np.int64), np.zeros((4, DEPTH)), np.zeros((4, DEPTH, 6, 3)),
        np.zeros((4, DEPTH + 1)), np.zeros(4, np.int64), np.zeros(4), np.zeros((4, 2)), np.zeros((4, 2)),
        np.zeros((4, 2)), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3),
    )
    arrays = _room(size, deepest)
    s.work[RAYS] = 0
    while slot < len(g.triangle):
        slot, used, cut = _trace(g, s, samples, h, fine, deepest, limit, slot, used, cut, *arrays)
        if slot < len(g.triangle):
            if s.work[RAYS] > limit:
                return None
            arrays = tuple(np.concatenate([a, b]) for a, b in zip(arrays, _room(size, deepest), strict=True))
            size *= 2
    return tuple(a[:used] for a in arrays), bool(cut)


def _room(n: int, deepest: int) -> tuple[NDArray, ...]:
    return (np.empty(n, np.int32), np.empty((n, 3, 2)), np.empty((n, 3, 2)), np.empty((n, 3, 2)), np.empty((n, 3)),
            np.empty(n, np.int8), np.empty(n, np.int8), np.zeros((n, deepest), np.int32), np.zeros((n, deepest)))


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


@part
def _seen_first(g, s, slot):
    """Whether the light falls on the slot from the side that it is on: outside the body, or inside."""
    body = g.link[slot, BODY]
    if body < 0:
        return False
    inside = False
    for i in range(1, s.medium0[0, 0] + 1):
        inside = inside or s.medium0[i, 0] == body
    slope = 0.0
    for j in range(3):
        slope += g.place[slot, NG + j] * (-s.light[j] if s.sun else g.place[slot, A + j] - s.light[j])
    return (slope > 0.0) == inside and slope != 0.0


@part
def _sampled(g, s, slot, e, alone, deepest, t):
    """Follow the light through the element's middle, and unless `alone` through three points near its corners.

    Into t; returns the most bends of any, and whether one that took `deepest` would bend again.
    """
    most, cut = np.int64(0), False
    mu, mv = (e[0] + e[2] + e[4]) / 3.0, (e[1] + e[3] + e[5]) / 3.0
    for i in range(4):
        t.uv[i, 0] = mu if i == 3 else (1.0 - SHRINK) * e[2 * i] + SHRINK * mu
        t.uv[i, 1] = mv if i == 3 else (1.0 - SHRINK) * e[2 * i + 1] + SHRINK * mv
        t.n[i] = 0
        if alone and i < 3:
            continue
        for j in range(3):
            t.y[j] = (g.place[slot, A + j] + t.uv[i, 0] * g.place[slot, E1 + j] + t.uv[i, 1] * g.place[slot, E2 + j])
        t.n[i] = chain(g, s, t.y, np.int64(deepest), CUTOFF)
        if t.n[i] and s.code[0, 1] != slot:
            t.n[i] = 0  # something stands before it: no first interface
            s.code[0, 0] = -1
        _keep(s, t.n[i], i, t.code, t.eta, t.rays, t.end)
        t.stop[i], t.beyond[i] = s.code[t.n[i], 0], s.bend[t.n[i], 4]
        most = max(most, t.n[i])
        if t.n[i] == deepest:
            cut = cut or next_bend(g, s, np.inf) == BENDS
    return most, cut


@part
def _passes_between(t, most):
    """Whether light may pass between samples of which none does: what reflects it differs, or would hardly do so."""
    least, greatest, stopped = np.inf, -np.inf, False
    for i in range(4):
        if t.n[i] < most:
            continue
        if t.stop[i] >= 0:
            least, greatest, stopped = min(least, t.beyond[i]), max(greatest, t.beyond[i]), True
        for j in range(i):
            if t.n[j] == most and t.stop[j] != t.stop[i]:
                return True
    return stopped and least < greatest - least


@part
def _bundle(g, s, t, k, h, differ, body):
    """Whether the samples' rays behind bend k make one beam, as t.p, t.d, t.z; and whether the element must be split.

    Also the beam's group. body: that the light is not yet out of, −1: some other.
    """
    _ray_of(t.rays, 3, k, t.P, t.D)
    group = _axis(t.D)
    a, sign = group >> 1, (-1.0 if group & 1 else 1.0)
    z0 = sign * t.P[a]
    for i in range(4):
        _ray_of(t.rays, i, k, t.P, t.D)
        if not _flatten(t.P, t.D, group, z0, i, t.p, t.d):
            return False, differ, group
    p, d, split = t.p, t.d, False
    reach = s.far / FAR
    length = min(max(min(sign * t.P[a] + t.end[3, k] * sign * t.D[a], reach + 4.0 * h) - z0, 0.0), 4.0 * reach)
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
            split = _split_for_bodies(g, t.P, t.D, t.end[3, k], width, body)
    low, high = np.inf, -np.inf
    for i in range(4):
        at = sign * t.rays[i, k - 1, 0, a]
        low = min(low, at)
        high = max(high, at + t.end[i, k] * sign * t.rays[i, k - 1, 1, a])
    extent = _width(p, d, 0.0)
    t.z[0], t.z[1], t.z[2] = z0, low - 0.5 * extent, high + 0.5 * extent
    return True, split, group


@part
def _quarters(e, level, k, element, top):
    """Push the four parts of an element: three at the corners, one between the middles of the edges."""
    for i in range(4):
        for c in range(3):
            j = i if i < 3 else (c + 1) % 3
            element[top + i, 2 * c] = 0.5 * (e[2 * c] + e[2 * j])
            element[top + i, 2 * c + 1] = 0.5 * (e[2 * c + 1] + e[2 * j + 1])
        element[top + i, 6], element[top + i, 7] = level + 1, k


@part
def _element(g, s, t, slot, e, h, fine, deepest, room, used, out):
    """Beams of an element from bend e[7] on, into `out`; returns the bend at which it must be split (0: done), the
    count, whether light went on behind `deepest` bends; and -1 as the bend where the room is not enough.
    """
    level, first = int(e[6]), int(e[7])
    body, patch = g.link[slot, BODY], g.link[slot, PATCH]
    edge, distance = _extent(g, slot, e, s)
    size = min(g.ball[body, 3], distance)
    # A small triangle of a smooth mesh needs but one ray: its derivatives say the rest.
    alone = level == 0 and edge < 0.5 * fine * size and g.link[slot, FLAT_SHADED] == 0
    most, cut = _sampled(g, s, slot, e, alone, deepest, t)
    splittable = room and not alone
    coarse = splittable and (
        edge > WIDE * distance or (edge > COARSE * g.patch_size[patch] and g.planar[patch] < 0))
    # Where no light passes at the samples (total reflection) it may still pass between them.
    last = max(most, first) if coarse else most
    if splittable and most + 1 >= first and _passes_between(t, most):
        last = most + 1
    for k in range(first, last + 1):
        least = fine * size * (1 << min((k - 1) >> 1, COARSER))
        differ = splittable and (edge > least or (level < FLAT_LEVELS and fine == FINE))
        agree = True
        for i in range(4):
            agree = agree and t.n[i] >= k and _same(t.code, t.eta, i, np.int64(0), k)
        split, group = coarse or (not agree and differ), 0
        if agree:
            agree, wider, group = _bundle(g, s, t, k, h, differ and not split, body if k == 1 else -1)
            split = split or wider
        if split:
            return k, used, cut
        if used + 4 > len(out[0]):
            return -1, used, cut
        if agree:
            _emit(used, slot, t.uv, t.p, t.d, t.z, group, k, t.code, t.eta, np.int64(3), *out)
            used += 1
            continue
        # Too small to split: each sample stands for its own signature, with its derivatives for a beam.
        for i in range(4):
            own = t.n[i] >= k
            for other in range(i):
                own = own and not (t.n[other] >= k and _same(t.code, t.eta, i, other, k))
            if not own:
                continue
            group = _beam_of_ray(g, slot, t.uv, i, t.rays, k, t.end[i, k], t.p, t.d, t.z, t.P, t.D)
            if group >= 0:
                _emit(used, slot, t.uv, t.p, t.d, t.z, group, k, t.code, t.eta, i, *out)
                used += 1
    return 0, used, cut


@kernel
def _trace(g, s, t, h, fine, deepest, limit, slot, used, cut, *out):
    """Beams of triangles from `slot` on, until all are done, the room is, or the rays are.

    Returns the next triangle, the count of beams, and whether light went on behind `deepest` bends.
    """
    element = np.zeros((4 * 40, 8))  # u, v of three corners, level, first bend that is not done
    e = np.zeros(8)
    while slot < len(g.triangle):
        before = used
        top = 0
        if _seen_first(g, s, slot):
            top = 1
            for j in range(8):
                element[0, j] = 1.0 if j == 2 or j == 5 or j == 7 else 0.0
        while top:
            top -= 1
            for j in range(8):
                e[j] = element[top, j]
            k, used, more = _element(g, s, t, slot, e, h, fine, deepest, top + 4 < len(element), used, out)
            cut = cut or more
            if k < 0 or s.work[RAYS] > limit:
                return slot, before, cut
            if k:
                _quarters(e, e[6], k, element, top)
                top += 4
        slot += 1
    return slot, used, cut


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
