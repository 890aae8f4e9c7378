"""Where every candidate is seen without a ray (method §5, the plane certificate made stronger).

Nothing can stand between P and a node above its surface if all that lies within r of P is P's own *body*: an instance
that has no part above the planes of its own triangles (a convex one), or triangles of one plane. A grid of cells as
large as r holds which body is in a cell; P asks its cell and the 26 around it.

Exact: the answer is Embree's. A ray leaves P by ULPS, and bodies and planes are right within a few ulps; nodes less
than MARGIN above P's plane are left to Embree. (An ulp is one of 1, in the tracer's frame: what is outside of [−1, 1]³
is left to Embree, too.)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...rays.geometry import Surfaces
from ...rays.tracer import ULPS
from ...support.compiled import kernel, part

MARGIN = 2 * ULPS
FLAT = 2.0**-23  # how far off its plane a triangle may be, as vertices are rounded
NEEDLE = 1e-4  # a triangle's height over its length; Embree's plane of a thinner one may be another
CELLS = 1 << 19  # about so many, at most; else larger ones
GROUP = 8
MOST = 512  # boxes that are asked about a triangle, else it is not clear: dense flat faces have too many
# The side of a triangle that its winding calls outside, the other, and not asked yet.
ABOVE, BELOW, UNSURE = np.uint8(1), np.uint8(2), np.uint8(255)
SEVERAL, UNKNOWN, EMPTY = np.int32(-2), np.int32(-3), np.int32(-4)


class Convex(NamedTuple):
    """The vertices of instances that seem convex, sorted so that neighbours stand together, in boxes of boxes."""

    vertices: NDArray[np.float64]  # (3,n) in the frame
    boxes: NDArray[np.float64]  # (b,2,3) middle and half the size of GROUP vertices each
    larger: NDArray[np.float64]  # (g,2,3) of GROUP boxes each
    first: NDArray[np.int64]  # (I+1,) the larger boxes of instance i are first[i]:first[i+1]


class Certificate(NamedTuple):
    """Bodies, and the grid of those that shadow rays meet."""

    surfaces: Surfaces
    casts: NDArray[np.bool_]  # (T,) what shadow rays meet
    r: float  # world
    cell: float  # edge in the frame, more than r
    body: NDArray[np.int32]  # (T,) −1: of none
    clear: NDArray[np.uint8]  # (T,) ABOVE, BELOW: the sides on which nothing of the same body stands; UNSURE: not asked
    convex: Convex
    keys: NDArray[np.int64]  # hash table of cells; −1: free
    only: NDArray[np.int32]  # the only body in the cell, or SEVERAL
    around: NDArray[np.int32]  # the only body in the cell and the 26 around it, SEVERAL, or UNKNOWN: not asked yet

    def holds(self, P: NDArray[np.float64], N: NDArray[np.float64], triangle: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Receivers (n,) on `triangle` (n,), on its side N, that see all nodes more than MARGIN above it within r."""
        out = np.empty(len(P), np.bool_)
        _holds(self, P, N, triangle, out)
        return out


def certificate(surfaces: Surfaces, casts: NDArray[np.bool_], r: float) -> Certificate | None:
    """The certificate for balls of radius r (world), where the triangles in casts (T,) are met; None: no bodies."""
    reach = r / surfaces.scale
    body, clear = np.full(len(surfaces.triangles), -1, np.int32), np.zeros(len(surfaces.triangles), np.uint8)
    ends = np.searchsorted(surfaces.instance, np.arange(surfaces.instance.max(initial=-1) + 2))
    convex = _bodies(surfaces, ends, reach, body, clear)
    if not (body >= 0).any():
        return None
    cell = max(1.001 * reach + 4 * ULPS, 2.0**-19)
    wanted, limit = np.flatnonzero(casts), np.inf
    if surfaces.reach > 1:  # what may be within r of a point of the frame's box
        limit = 1 + 2 * cell
        corners = surfaces.vertices[surfaces.triangles[wanted]]
        wanted = wanted[(corners.min(1) <= limit).all(1) & (corners.max(1) >= -limit).all(1)]
    while _about(surfaces, wanted, cell) > CELLS:
        cell *= 1.5
    keys, only = _filled(surfaces, wanted, body, cell, limit)
    around = np.full(len(keys), UNKNOWN, np.int32)
    return Certificate(surfaces, casts, r, cell, body, clear, Convex(*convex), keys, only, around)


@part
def _plane(s, t):
    """Unit normal and offset of triangle t in the frame, and its height over its length."""
    a, b, c = s.vertices[s.triangles[t, 0]], s.vertices[s.triangles[t, 1]], s.vertices[s.triangles[t, 2]]
    e0, e1, e2 = np.float64(b[0]) - a[0], np.float64(b[1]) - a[1], np.float64(b[2]) - a[2]
    f0, f1, f2 = np.float64(c[0]) - a[0], np.float64(c[1]) - a[1], np.float64(c[2]) - a[2]
    x, y, z = e1 * f2 - e2 * f1, e2 * f0 - e0 * f2, e0 * f1 - e1 * f0
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    g0, g1, g2 = e0 - f0, e1 - f1, e2 - f2
    longest = max(e0 * e0 + e1 * e1 + e2 * e2, f0 * f0 + f1 * f1 + f2 * f2, g0 * g0 + g1 * g1 + g2 * g2)
    return x, y, z, x * a[0] + y * a[1] + z * a[2], length / longest


@kernel
def _bodies(s, ends, reach, body, clear):
    """Fill body and clear: instances that seem convex, and the planes of the others. Returns the arrays of Convex."""
    keys, near = np.full(1024, -1, np.int64), np.empty(1024, np.int32)
    planes = 0
    low, high, first = np.zeros(len(ends), np.int64), np.zeros(len(ends), np.int64), np.zeros(len(ends), np.int64)
    for i in range(len(ends) - 1):
        first[i + 1] = first[i]
        if ends[i + 1] > ends[i]:
            low[i], high[i] = _used(s, ends[i], ends[i + 1])
        if ends[i + 1] > ends[i] and _seems_convex(s, ends[i], ends[i + 1], low[i], high[i]):
            body[ends[i]:ends[i + 1]], clear[ends[i]:ends[i + 1]] = i, UNSURE
            first[i + 1] += (high[i] - low[i] + GROUP * GROUP - 1) // (GROUP * GROUP)
            continue
        for t in range(ends[i], ends[i + 1]):
            x, y, z, d, height = _plane(s, t)
            if not height > NEEDLE:
                continue
            if x + y * 0.7 + z * 0.4 < 0.0:
                x, y, z, d = -x, -y, -z, -d
            key = np.int64(0)  # of planes nearly the same; others that share it are lost
            for q in (x * 2.0**12, y * 2.0**12, z * 2.0**12, d * 2.0**20):
                key = (key * np.int64(0x9E3779B1) + np.int64(np.floor(q + 0.31))) & np.int64((1 << 62) - 1)
            slot = _slot(keys, key)
            if keys[slot] < 0:
                keys[slot], near[slot] = key, t
                planes += 1
                if 2 * planes > len(keys):
                    keys, near = _grown(keys, near)
                    slot = _slot(keys, key)
            u = near[slot]
            x0, y0, z0, d0, _ = _plane(s, u)
            if x * x0 + y * y0 + z * z0 < 0.0:
                x0, y0, z0, d0 = -x0, -y0, -z0, -d0
            flat = ((x - x0) ** 2 + (y - y0) ** 2 + (z - z0) ** 2) * 4.0 * reach * reach <= FLAT * FLAT
            for k in range(3):
                v = s.vertices[s.triangles[t, k]]
                flat = flat and abs(x0 * v[0] + y0 * v[1] + z0 * v[2] - d0) <= FLAT
            if flat:
                body[t], clear[t] = len(ends) + u, ABOVE | BELOW
    count = first[-1]
    vertices = np.empty((3, count * GROUP * GROUP))
    for i in range(len(ends) - 1):
        if first[i + 1] > first[i]:
            own = s.vertices[low[i]:high[i]]
            own = own[np.argsort(_morton(own))]
            for n in range(GROUP * GROUP * first[i], GROUP * GROUP * first[i + 1]):
                for j in range(3):  # the last fills the last boxes
                    vertices[j, n] = own[min(n - GROUP * GROUP * first[i], len(own) - 1), j]
    return vertices, _boxes(vertices, GROUP), _boxes(vertices, GROUP * GROUP), first


@part
def _used(s, begin, end):
    """First vertex of triangles begin..end, and one behind the last."""
    low, high = np.int64(len(s.vertices)), np.int64(0)
    for t in range(begin, end):
        for k in range(3):
            low, high = min(low, np.int64(s.triangles[t, k])), max(high, np.int64(s.triangles[t, k]) + 1)
    return low, high


@part
def _seems_convex(s, begin, end, low, high):
    """Whether some of triangles begin..end, which stand for all, have none of vertices low..high on one side."""
    for t in range(begin, end, (end - begin + 7) // 8):
        x, y, z, d, _ = _plane(s, t)
        above, below = False, False
        for n in range(low, high):
            q = x * s.vertices[n, 0] + y * s.vertices[n, 1] + z * s.vertices[n, 2] - d
            above, below = above or q > 2 * FLAT, below or q < -2 * FLAT
            if above and below:
                return False
    thinnest = 1.0
    for t in range(begin, end):
        thinnest = min(thinnest, _plane(s, t)[4])
    return thinnest > NEEDLE


@part
def _sides(s, t, convex):
    """The sides of triangle t on which none of its instance's vertices is."""
    x, y, z, d, _ = _plane(s, t)
    above, below, asked = False, False, 0
    for g in range(convex.first[s.instance[t]], convex.first[s.instance[t] + 1]):
        if not _crosses(convex.larger[g], x, y, z, d, above, below):
            continue
        for b in range(GROUP * g, GROUP * g + GROUP):
            if not _crosses(convex.boxes[b], x, y, z, d, above, below):
                continue
            over, under = 0, 0
            for n in range(GROUP * b, GROUP * b + GROUP):  # no branch: several at once
                q = x * convex.vertices[0, n] + y * convex.vertices[1, n] + z * convex.vertices[2, n] - d
                over += q > 2 * FLAT
                under += q < -2 * FLAT
            above, below = above or over > 0, below or under > 0
            asked += 1
        if asked > MOST:
            return np.uint8(0)
    return (np.uint8(0) if above else ABOVE) | (np.uint8(0) if below else BELOW)


@part
def _boxes(vertices, group):
    """Middle and half the size (b,2,3) of boxes round `group` vertices each."""
    boxes = np.empty(((vertices.shape[1] + group - 1) // group, 2, 3))
    for b in range(len(boxes)):
        for j in range(3):
            low, high = np.inf, -np.inf
            for n in range(group * b, min(group * b + group, vertices.shape[1])):
                low, high = min(low, vertices[j, n]), max(high, vertices[j, n])
            boxes[b, 0, j], boxes[b, 1, j] = (high + low) / 2, (high - low) / 2 + 1e-9
    return boxes


@part
def _crosses(box, x, y, z, d, above, below):
    """Whether something in the box may be above the plane, or below it, where that is not known yet."""
    middle = x * box[0, 0] + y * box[0, 1] + z * box[0, 2] - d
    half = abs(x) * box[1, 0] + abs(y) * box[1, 1] + abs(z) * box[1, 2]
    return (middle + half > 2 * FLAT and not above) or (middle - half < -2 * FLAT and not below)


@part
def _morton(vertices):
    """Numbers by which neighbours in space are neighbours in order: the bits of x, y and z in turn."""
    out = np.zeros(len(vertices), np.int64)
    size = 1e-30
    for j in range(3):
        size = max(size, np.float64(np.ptp(vertices[:, j])))
    for j in range(3):
        low = np.float64(vertices[:, j].min())
        for n in range(len(vertices)):
            x = np.int64((vertices[n, j] - low) / size * 1023.0)
            for b in range(10):
                out[n] |= (x >> b & 1) << (3 * b + j)
    return out


@kernel
def _about(s, wanted, cell):
    """About how many cells the triangles fill."""
    total = 0.0
    for t in wanted:
        a, b, c = s.vertices[s.triangles[t, 0]], s.vertices[s.triangles[t, 1]], s.vertices[s.triangles[t, 2]]
        across, length = 0.0, 0.0
        for j in range(3):
            k, m = (j + 1) % 3, (j + 2) % 3
            x = (b[k] - a[k]) * (c[m] - a[m]) - (b[m] - a[m]) * (c[k] - a[k])
            across += np.float64(x) * x
            length = max(length, np.float64(max(a[j], b[j], c[j]) - min(a[j], b[j], c[j])))
        total += np.sqrt(across) / (cell * cell) + (length / cell if length > cell else 0.0)
    return total


@kernel
def _filled(s, wanted, body, cell, limit):
    """The grid of triangles `wanted` within ±limit. Large ones are halved until the box of each part is a few cells."""
    keys, only = np.full(4096, -1, np.int64), np.empty(4096, np.int32)
    count = 0
    stack = np.empty((256, 3, 3))
    box, last = np.empty((2, 3), np.int64), np.zeros((2, 3), np.int64)
    whose = SEVERAL
    for t in wanted:
        for k in range(3):
            for j in range(3):
                stack[0, k, j] = s.vertices[s.triangles[t, k], j] / cell
        left = 1
        while left:
            left -= 1
            piece = stack[left]
            cells = 1.0
            again = count > 0 and whose == body[t]
            beyond = False
            for j in range(3):
                low, high = min(piece[0, j], piece[1, j], piece[2, j]), max(piece[0, j], piece[1, j], piece[2, j])
                beyond = beyond or low > limit / cell or high < -limit / cell
                low, high = np.floor(low - 1e-6), np.floor(high + 1e-6)
                box[0, j], box[1, j] = np.int64(low), np.int64(high)
                cells *= high - low + 1.0
                again = again and box[0, j] == last[0, j] and box[1, j] == last[1, j]
            if beyond or (again and cells <= 8.0):  # as neighbours often are
                continue
            if cells > 8.0:
                _halve(piece, stack[left + 1])
                left += 2
                continue
            whose = body[t]
            for j in range(3):
                last[0, j], last[1, j] = box[0, j], box[1, j]
            for i in range(box[0, 0], box[1, 0] + 1):
                for j in range(box[0, 1], box[1, 1] + 1):
                    for k in range(box[0, 2], box[1, 2] + 1):
                        key = _key(i, j, k)
                        slot = _slot(keys, key)
                        if keys[slot] < 0:
                            if 2 * count > len(keys):
                                keys, only = _grown(keys, only)
                                slot = _slot(keys, key)
                            count += 1
                            keys[slot], only[slot] = key, whose if whose >= 0 else SEVERAL
                        elif only[slot] != whose:
                            only[slot] = SEVERAL
    return keys, only


@part
def _halve(piece, other):
    """Cut triangle `piece` (3,3) through the middle of its longest edge; `other` is the second half."""
    longest, at = -1.0, 0
    for k in range(3):
        q = 0.0
        for j in range(3):
            q += (piece[(k + 1) % 3, j] - piece[k, j]) ** 2
        if q > longest:
            longest, at = q, k
    to = (at + 1) % 3
    for j in range(3):
        middle = (piece[at, j] + piece[to, j]) / 2
        other[at, j], other[to, j], other[3 - at - to, j] = middle, piece[to, j], piece[3 - at - to, j]
        piece[to, j] = middle


@part
def _around(grid, i, j, k):
    """The only body in cell (i,j,k) and the 26 around it, SEVERAL, or EMPTY."""
    one = EMPTY
    for a in range(i - 1, i + 2):
        for b in range(j - 1, j + 2):
            for c in range(k - 1, k + 2):
                slot = _slot(grid.keys, _key(a, b, c))
                if grid.keys[slot] >= 0:
                    here = grid.only[slot]
                    if here == SEVERAL or (one != EMPTY and one != here):
                        return SEVERAL
                    one = here
    return one


@kernel
def _holds(grid, P, N, triangle, out):
    s = grid.surfaces
    last, i0, j0, k0 = 0, np.int64(0), np.int64(0), np.int64(0)
    for p in range(len(P)):
        t = triangle[p]
        i = np.int64(np.floor((P[p, 0] - s.centre[0]) / s.scale / grid.cell))
        j = np.int64(np.floor((P[p, 1] - s.centre[1]) / s.scale / grid.cell))
        k = np.int64(np.floor((P[p, 2] - s.centre[2]) / s.scale / grid.cell))
        if s.reach > 1.0 and np.abs(P[p] - s.centre).max() > s.scale:
            out[p] = False
            continue
        if p > 0 and t == triangle[last] and i == i0 and j == j0 and k == k0 and (
                N[p, 0] == N[last, 0] and N[p, 1] == N[last, 1] and N[p, 2] == N[last, 2]):
            out[p] = out[last]  # as neighbours often are
            continue
        last, i0, j0, k0 = p, i, j, k
        slot = _slot(grid.keys, _key(i, j, k))  # threads may meet in `around` and `clear`: all write the same
        if grid.keys[slot] < 0:
            one = _around(grid, i, j, k)
        else:
            one = grid.around[slot]
            if one == UNKNOWN:
                one = _around(grid, i, j, k)
                grid.around[slot] = one
        out[p] = one == EMPTY
        if one >= 0 and one == grid.body[t]:
            a, b, c = s.vertices[s.triangles[t, 0]], s.vertices[s.triangles[t, 1]], s.vertices[s.triangles[t, 2]]
            e0, e1, e2 = np.float64(b[0]) - a[0], np.float64(b[1]) - a[1], np.float64(b[2]) - a[2]
            f0, f1, f2 = np.float64(c[0]) - a[0], np.float64(c[1]) - a[1], np.float64(c[2]) - a[2]
            up = (e1 * f2 - e2 * f1) * N[p, 0] + (e2 * f0 - e0 * f2) * N[p, 1] + (e0 * f1 - e1 * f0) * N[p, 2] > 0.0
            if grid.clear[t] == UNSURE:
                grid.clear[t] = _sides(s, t, grid.convex)
            out[p] = grid.clear[t] & (ABOVE if up else BELOW) != 0


@part
def _slot(keys, key):
    """The slot of the table that holds the key, or the free one where it belongs."""
    mask = np.uint64(len(keys) - 1)
    x = np.uint64(key) * np.uint64(0x9E3779B185EBCA87)
    slot = (x ^ (x >> np.uint64(32))) & mask
    while keys[slot] != key and keys[slot] >= 0:
        slot = (slot + np.uint64(1)) & mask
    return slot


@part
def _grown(keys, values):
    """The table with twice the room."""
    more, moved = np.full(2 * len(keys), -1, np.int64), np.empty(2 * len(keys), np.int32)
    for n in range(len(keys)):
        if keys[n] >= 0:
            slot = _slot(more, keys[n])
            more[slot], moved[slot] = keys[n], values[n]
    return more, moved


@part
def _key(i, j, k):
    """Of cell (i,j,k), each within ±2²⁰."""
    half = np.int64(1 << 20)
    return ((np.int64(i) + half) << np.int64(42)) | ((np.int64(j) + half) << np.int64(21)) | (np.int64(k) + half)
