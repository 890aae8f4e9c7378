"""Sheets in one place: cut-outs, films and what lies on them, nearer to each other than a ray leaves a surface.

Embree gives one surface of those that are in one place, and a ray that goes on leaves all of them behind. So the
triangles that lie in a sheet's place are known beforehand, as its partners, and rays that meet one of them look at all
in float64. Where rounded vertices do not tell which is in front, a sheet lies on an opaque surface, on either side of
it, and on the outside of one that bends light. Of two sheets in exactly one place the first of the scene lies on the
side of SIDE.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.compiled import kernel, part
from .boxes import STACK, box_tree
from .geometry import Surfaces

NEAR = 64 * 2.0**-23  # in the frame's box: four times as far as a ray leaves its surface
SAME = 1e-12  # of the way: no farther apart is in one place
SIDE = (0.5773, 0.3821, 0.7216)  # along no plane that an artist builds
SHEET, OPAQUE, BENDS = np.uint8(0), np.uint8(1), np.uint8(2)
STEEP = 0.1  # sine of the angle: what crosses a sheet more steeply is lost on a line too narrow to be seen


class Stacks(NamedTuple):
    """The partners of triangle t are partner[first[t]:first[t+1]]."""

    first: NDArray[np.int64]  # (T+1,)
    partner: NDArray[np.int32]
    nature: NDArray[np.uint8]  # (T,) SHEET, OPAQUE or BENDS


def stacks(surfaces: Surfaces, passes: NDArray[np.bool_], bends: NDArray[np.bool_]) -> Stacks | None:
    """What lies in the place of sheets, or a sheet in its; None: nothing does.

    passes (T,): what lets light through; bends (T,): and bends it. Sheets are those that only let it through.
    """
    sheets = passes & ~bends
    index = np.flatnonzero(sheets).astype(np.int32)
    if not len(index):
        return None
    corners = surfaces.vertices[surfaces.triangles[index]].astype(np.float64)
    pad = NEAR * np.maximum(1.0, np.abs(corners).max((1, 2)))[:, None]
    order, box, child = box_tree(np.concatenate([corners.min(1) - pad, corners.max(1) + pad], axis=1))
    room = 1024
    while True:
        found = np.empty((room, 2), np.int32)
        count = _pairs(surfaces, index[order], box, child, found)
        if count <= room:
            break
        room = count
    if not count:
        return None
    found = found[:count]
    found = np.concatenate([found, found[~sheets[found[:, 0]], ::-1]])
    found = found[np.lexsort((found[:, 1], found[:, 0]))]
    first = np.zeros(len(surfaces.triangles) + 1, np.int64)
    np.cumsum(np.bincount(found[:, 0], minlength=len(surfaces.triangles)), out=first[1:])
    nature = np.where(sheets, SHEET, np.where(bends, BENDS, OPAQUE)).astype(np.uint8)
    return Stacks(first, np.ascontiguousarray(found[:, 1]), nature)


@kernel
def _pairs(s, sheets, box, child, found):
    """Every (triangle, sheet) in one place, into `found` as far as it has room; returns how many there are."""
    stack = np.empty(STACK, np.int64)
    count = 0
    low, high = np.empty(3), np.empty(3)
    for t in range(len(s.triangles)):
        for j in range(3):
            a, b, c = s.vertices[s.triangles[t, 0], j], s.vertices[s.triangles[t, 1], j], s.vertices[
                s.triangles[t, 2], j]
            low[j], high[j] = min(a, b, c), max(a, b, c)
        stack[0] = 0
        top = 1
        while top:
            top -= 1
            n = stack[top]
            if not (low[0] <= box[n, 3] and high[0] >= box[n, 0] and low[1] <= box[n, 4] and high[1] >= box[n, 1]
                    and low[2] <= box[n, 5] and high[2] >= box[n, 2]):
                continue
            a = child[n, 0]
            if not child[n, 1]:
                stack[top], stack[top + 1] = a, a + 1
                top += 2
                continue
            for k in range(a, a + child[n, 1]):
                if sheets[k] != t and _in_one_place(s, t, sheets[k]):
                    if count < len(found):
                        found[count, 0], found[count, 1] = t, sheets[k]
                    count += 1
    return count


@part
def _corners(s, t, origin, out):
    """Corners of triangle t as seen from `origin`, into rows 0 to 2 of out; into row 3 its normal, of any length."""
    for k in range(3):
        for j in range(3):
            out[k, j] = np.float64(s.vertices[s.triangles[t, k], j]) - origin[j]
    _normal(out)


@part
def _normal(out):
    for j in range(3):
        a, b = (j + 1) % 3, (j + 2) % 3
        out[3, j] = ((out[1, a] - out[0, a]) * (out[2, b] - out[0, b])
                     - (out[1, b] - out[0, b]) * (out[2, a] - out[0, a]))


@part
def _in_one_place(s, t, u):
    """Whether triangles t and u overlap, seen along a normal, and touch or nearly do."""
    origin = np.empty(3)
    far = 1.0
    for j in range(3):
        origin[j] = s.vertices[s.triangles[t, 0], j]
        far = max(far, abs(origin[j]))
    p, q = np.empty((4, 3)), np.empty((4, 3))
    _corners(s, t, origin, p)
    _corners(s, u, origin, q)
    pp, qq, pq = 0.0, 0.0, 0.0
    for j in range(3):
        pp, qq, pq = pp + p[3, j] ** 2, qq + q[3, j] ** 2, pq + p[3, j] * q[3, j]
    if pq * pq < (1.0 - STEEP * STEEP) * pp * qq:
        return False
    if _apart(p, q, np.sqrt(pp), NEAR * far) or _apart(q, p, np.sqrt(qq), NEAR * far):
        return False
    axis = 0
    for j in range(1, 3):
        if abs(p[3, j]) > abs(p[3, axis]):
            axis = j
    return not (_beside(p, q, axis) or _beside(q, p, axis))


@part
def _apart(p, q, length, near):
    """Whether q is on one side of p's plane, farther than `near`."""
    low, high = np.inf, -np.inf
    for k in range(3):
        x = 0.0
        for j in range(3):
            x += p[3, j] / length * (q[k, j] - p[0, j])
        low, high = min(low, x), max(high, x)
    return low > near or high < -near


@part
def _beside(p, q, axis):
    """Whether an edge of p separates p and q, as seen along an axis; touching is beside."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    for k in range(3):
        o = (k + 1) % 3
        x, y = p[o, a] - p[k, a], p[o, b] - p[k, b]
        third = (k + 2) % 3
        side = x * (p[third, b] - p[k, b]) - y * (p[third, a] - p[k, a])
        over = False
        for n in range(3):
            over = over or (x * (q[n, b] - p[k, b]) - y * (q[n, a] - p[k, a])) / side > 1e-6
        if not over:
            return True
    return False


@part
def _edge(p, i, k, d):
    """d·(p_i × p_k): on which side of an edge a ray from the origin passes. Exactly the negative for (k, i); never 0.

    So of two triangles at an edge one has the ray that meets it.
    """
    x = (d[0] * (p[i, 1] * p[k, 2] - p[i, 2] * p[k, 1]) + d[1] * (p[i, 2] * p[k, 0] - p[i, 0] * p[k, 2])
         + d[2] * (p[i, 0] * p[k, 1] - p[i, 1] * p[k, 0]))
    if x != 0.0:
        return x
    for j in range(3):
        if p[i, j] != p[k, j]:
            return 1e-300 if p[i, j] < p[k, j] else -1e-300
    return 1e-300


@part
def meet(s, t, o, d, p, out):
    """Where a line from o along d meets the plane of triangle t; True: within the triangle.

    out (4,): the line's length, u, v, and what of the length hangs on roundings of this and another triangle.
    p (4,3): room; then t's corners from o, and its normal.
    """
    _corners(s, t, o, p)
    a, b, c = _edge(p, 1, 2, d), _edge(p, 2, 0, d), _edge(p, 0, 1, d)
    slope = p[3, 0] * d[0] + p[3, 1] * d[1] + p[3, 2] * d[2]
    rounded = 0.0
    for j in range(3):
        most = 0.0
        for k in range(3):
            most = max(most, np.float64(abs(s.vertices[s.triangles[t, k], j])))
        rounded += abs(p[3, j]) * most
    out[3] = 3.0 * 2.0**-24 * rounded / abs(slope)
    out[0] = (p[3, 0] * p[0, 0] + p[3, 1] * p[0, 1] + p[3, 2] * p[0, 2]) / slope
    out[1], out[2] = b / (a + b + c), c / (a + b + c)
    return slope != 0.0 and (a > 0.0) == (b > 0.0) and (b > 0.0) == (c > 0.0)


@part
def _outward(s, t, d):
    """d·N of triangle t's normal to the outside, of any length."""
    p, origin = np.empty((4, 3)), np.zeros(3)
    _corners(s, t, origin, p)
    along = p[3, 0] * d[0] + p[3, 1] * d[1] + p[3, 2] * d[2]
    return -along if s.mirrored[s.instance[t]] else along


@part
def _before(s, nature, i, ti, k, tk, rounded, normal, d):
    """Whether a ray along d meets triangle i at ti before k at tk; normal: of one of them."""
    between_sheets = nature[i] == SHEET and nature[k] == SHEET  # an order of all, as rays go from one to the next
    if abs(ti - tk) > SAME * max(1.0, abs(tk)) + (0.0 if between_sheets else rounded):
        return ti < tk
    if nature[i] == SHEET and nature[k] != SHEET:
        return nature[k] == OPAQUE or _outward(s, k, d) < 0.0
    if nature[k] == SHEET and nature[i] != SHEET:
        return nature[i] == BENDS and _outward(s, i, d) > 0.0
    along = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]
    side = normal[0] * SIDE[0] + normal[1] * SIDE[1] + normal[2] * SIDE[2]
    return (i < k) == (along * side < 0.0)


@part
def _behind(s, nature, i, ti, k, tk, rounded, normal, d):
    """Whether a ray that met or leaves triangle k at tk meets i at ti next."""
    if nature[k] == OPAQUE and abs(ti - tk) <= SAME * max(1.0, abs(tk)) + rounded:
        return nature[i] == SHEET  # the ray comes back from k
    return _before(s, nature, k, tk, i, ti, rounded, normal, d)


@kernel
def first_of_all(s, stacks, seen, start, direction, last, triangle, u, v):
    """Put the first surface of those in one place where Embree found one (n,), −1: none, or where a ray goes on.

    start, direction (n,3): where rays began, world; last (n,): the triangle that they met or left last, −1: none. seen
    (T,): what they may meet.
    """
    p, out, o, nature = np.empty((4, 3)), np.empty(4), np.empty(3), stacks.nature
    for n in range(len(triangle)):
        found, passed = np.int64(triangle[n]), np.int64(last[n])
        if not ((found >= 0 and stacks.first[found + 1] > stacks.first[found])
                or (passed >= 0 and stacks.first[passed + 1] > stacks.first[passed])):
            continue
        d = direction[n]
        for j in range(3):
            o[j] = (start[n, j] - s.centre[j]) / s.scale
        best, at, behind = found, np.inf, 0.0
        if best >= 0:
            meet(s, best, o, d, p, out)
            at = out[0]
        if passed >= 0:
            meet(s, passed, o, d, p, out)
            behind = out[0]
        for k in (found, passed):
            if k < 0:
                continue
            for c in range(stacks.first[k], stacks.first[k + 1]):
                t = np.int64(stacks.partner[c])
                if not seen[t] or t in (best, passed) or not meet(s, t, o, d, p, out):
                    continue
                new = out[0] > 0.0
                if passed >= 0:
                    new = _behind(s, nature, t, out[0], passed, behind, out[3], p[3], d)
                    if nature[t] == OPAQUE and abs(out[0]) <= SAME + out[3]:
                        new = False  # the ray began there
                if new and (best < 0 or _before(s, nature, t, out[0], best, at, out[3], p[3], d)):
                    best, at = t, out[0]
                    triangle[n], u[n], v[n] = t, out[1], out[2]


@kernel
def also_crossed(s, stacks, seen, triangle, start, end, leaving, done, until, row, partner, u, v):
    """The partners of `triangle` (n,), −1: none, that segments start..end (n,3; frame) cross from shares done to until.

    leaving: the triangles are those that the segments leave, and what lies on them counts from there. Fills row,
    partner, u, v as far as they have room; returns how many there are.
    """
    p, out, d = np.empty((4, 3)), np.empty(4), np.empty(3)
    count = 0
    for n in range(len(triangle)):
        k = np.int64(triangle[n])
        if k < 0 or stacks.first[k] == stacks.first[k + 1]:
            continue
        for j in range(3):
            d[j] = end[n, j] - start[n, j]
        meet(s, k, start[n], d, p, out)
        at = out[0]
        for c in range(stacks.first[k], stacks.first[k + 1]):
            t = np.int64(stacks.partner[c])
            if not seen[t] or not meet(s, t, start[n], d, p, out) or out[0] > min(until[n], 1.0):
                continue
            if _behind(s, stacks.nature, t, out[0], k, at, out[3], p[3], d) if leaving else out[0] > done[n]:
                if count < len(row):
                    row[count], partner[count], u[count], v[count] = n, t, out[1], out[2]
                count += 1
    return count


@kernel
def place_of(s, triangle, start, end, out):
    """Shares of segments start..end (n,3; frame) at which they meet the planes of triangles (n,), into `out`."""
    p, found, d = np.empty((4, 3)), np.empty(4), np.empty(3)
    for n in range(len(triangle)):
        for j in range(3):
            d[j] = end[n, j] - start[n, j]
        meet(s, triangle[n], start[n], d, p, found)
        out[n] = found[0]
