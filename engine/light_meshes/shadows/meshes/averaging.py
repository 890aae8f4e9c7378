"""Steps 4 and 5 of Ψ on a batch of receivers: which values and rays are needed, and the mean of what nodes see.

`start` (n, K+1): the candidates of receiver p in ring g are rows start[p,g]:start[p,g+1] of `candidate`, as `lattice`
makes them. A light of class k averages rings 0..k: serve (K,W) has for each ring the bits of the lights that count it,
ring (L,) is each light's class, and m (n,K) the size of the set of each class. With one radius K = 1.
"""

from __future__ import annotations

import numpy as np

from ...support.compiled import kernel, part, trailing_zeros

# How wide the blur is: a light of radius ρ seen past an edge has variance ρ²/4, the mean over the half-ball this
# share of r².
VARIANCE = {"UNIFORM": 1 / 5, "SMOOTH": 1 / 7}


@kernel
def falloff(square):
    """SMOOTH: the weight of a node at |x − P|² = square·r²; 0 at r, but never 0: a node that counts alone counts."""
    return max(1.0 - square, 1e-9)


@kernel
def ask(start, candidate, soft, serve, need):
    """The lights (u,W) that each node is asked for: those of all receivers whose candidate it is."""
    for p in range(len(soft)):
        for w in range(soft.shape[1]):
            for g in range(len(serve)):
                s = soft[p, w] & serve[g, w]
                if s:
                    for c in range(start[p, g], start[p, g + 1]):
                        need[candidate[c], w] |= s


@kernel
def agreement(start, candidate, values, soft, serve, uniform):
    """Marks receivers all of whose candidates agree, for every soft light that counts them."""
    rings = len(serve)
    for p in range(len(soft)):
        agree, any_soft = start[p, rings] > start[p, 0], False
        for w in range(soft.shape[1]):
            for g in range(rings):
                s = soft[p, w] & serve[g, w]
                if s == 0 or not agree or start[p, g + 1] == start[p, g]:
                    continue
                any_soft = True
                # Of the innermost ring that has any: all lights with a set count it.
                first = values[candidate[start[p, 0]], w] & s
                for c in range(start[p, g], start[p, g + 1]):
                    if values[candidate[c], w] & s != first:
                        agree = False
                        break
        uniform[p] = agree and any_soft


@kernel
def certify(start, candidate, holds, uniform, P, N, position, margin, seen):
    """Marks candidates of receivers with a certificate: those more than `margin` above P's plane. Returns how many.

    Of a uniform receiver the first only: more are not asked for.
    """
    count = 0
    for p in range(len(holds)):
        if holds[p]:
            last = start[p, 0] + 1 if uniform[p] else start[p, -1]
            for c in range(start[p, 0], last):
                x = position[candidate[c]]
                seen[c] = (x[0] - P[p, 0]) * N[p, 0] + (x[1] - P[p, 1]) * N[p, 1] + (x[2] - P[p, 2]) * N[p, 2] > margin
                count += seen[c]
    return count


@kernel
def listed(start, soft, serve, uniform, seen):
    """(receiver, index into candidate) of every short ray that is needed: of those not `seen` anyway."""
    total = 0
    end = np.zeros(len(soft), np.int64)  # candidates behind it serve no light of the receiver
    for p in range(len(soft)):
        end[p] = start[p, 0]
        if not uniform[p]:
            for w in range(soft.shape[1]):
                for g in range(len(serve)):
                    if soft[p, w] & serve[g, w]:
                        end[p] = max(end[p], start[p, g + 1])
            total += end[p] - start[p, 0]
    row, index = np.empty(total, np.int32), np.empty(total, np.int64)
    n = 0
    for p in range(len(soft)):
        for c in range(start[p, 0], end[p]):
            if not seen[c]:
                row[n], index[n] = p, c
                n += 1
    return row[:n], index[:n]


@kernel
def sizes(start, weight, uniform, m):
    """m (n,K): how many nodes step 3 keeps in each class's ball: those with a weight (c,C) that is not 0."""
    for p in range(len(m)):
        total = 0
        for g in range(m.shape[1]):
            if uniform[p]:  # all agree, and the first is seen: any m gives the same quotients
                total = 1 if start[p, g + 1] > start[p, 0] else 0
            else:
                for c in range(start[p, g], start[p, g + 1]):
                    kept = False
                    for k in range(weight.shape[1]):
                        kept = kept or weight[c, k] > 0
                    total += kept
            m[p, g] = total


@kernel
def mean(start, candidate, weight, uniform, values, soft, serve, ring, m, rows, S):
    """S[rows] = (number of kept nodes that see the light)/m, eq. (4)."""
    rings = len(serve)
    column = np.empty(np.max(start[:, rings] - start[:, 0]), np.uint64) if len(start) else np.empty(0, np.uint64)
    for p in range(len(soft)):
        if m[p, rings - 1] == 0:
            continue
        inner = 0  # the innermost ring with a kept node: lights that count no further one have no set
        while m[p, inner] == 0:
            inner += 1
        for w in range(soft.shape[1]):
            lit = soft[p, w] & serve[inner, w]
            if lit == 0:
                continue
            every, some = lit, np.uint64(0)
            if uniform[p]:
                every &= values[candidate[start[p, 0]], w]
                some = every
            else:
                n = 0
                for g in range(rings):
                    s = lit & serve[g, w]
                    if s == 0:
                        break
                    for c in range(start[p, g], start[p, g + 1]):
                        if weight[c]:
                            column[n] = values[candidate[c], w]
                            every &= column[n] | ~s
                            some |= column[n] & s
                            n += 1
            _spread(every, w, S[rows[p]])
            mixed = some & ~every  # on all others the nodes agree, as they mostly do
            while mixed:
                bit = np.uint64(trailing_zeros(mixed))
                mixed &= mixed - np.uint64(1)
                i = 64 * w + np.int64(bit)
                number = np.uint64(0)
                for n in range(m[p, ring[i]]):
                    number += column[n] >> bit & np.uint64(1)
                S[rows[p], i] = np.float32(np.float64(number) / m[p, ring[i]])


@part
def _spread(bits, w, S):
    """S (L,) += 1 for each light of word w that is in bits; without a branch."""
    row = S[64 * w:64 * w + 64]
    for i in range(len(row)):
        row[i] += np.float32(bits >> np.uint64(i) & np.uint64(1))


@kernel
def smooth_mean(start, candidate, weight, uniform, values, soft, ring, radius, P, position, m, rows, S):
    """S[rows] = Σ w·v / Σ w over the kept nodes, w = falloff(|x − P|²/r²); radius (K,) world."""
    words = values.shape[1]
    own = np.zeros((len(radius), words), np.uint64)  # the lights of each class
    for i in range(S.shape[1]):
        own[ring[i], i >> 6] |= np.uint64(1) << np.uint64(i & 63)
    lights, ends = np.empty(S.shape[1], np.int64), np.zeros(words + 1, np.int64)  # to add up; of word w up to ends[w+1]
    seen = np.empty(S.shape[1])
    every, some = np.empty(words, np.uint64), np.empty(words, np.uint64)
    for p in range(len(soft)):
        for k in range(len(radius)):
            if m[p, k] == 0:
                continue
            for w in range(words):
                every[w], some[w] = soft[p, w] & own[k, w], 0
            last = start[p, 0] + 1 if uniform[p] else start[p, k + 1]
            for c in range(start[p, 0], last):
                if uniform[p] or weight[c]:
                    for w in range(words):
                        every[w] &= values[candidate[c], w]
                        some[w] |= values[candidate[c], w]
            count = 0
            for w in range(words):
                _spread(every[w], w, S[rows[p]])  # what none of the kept nodes sees has S = 0: sums are for the others
                mixed = some[w] & ~every[w] & soft[p, w] & own[k, w]
                while mixed:
                    lights[count], seen[count] = 64 * w + trailing_zeros(mixed), 0.0
                    mixed &= mixed - np.uint64(1)
                    count += 1
                ends[w + 1] = count
            if count == 0:
                continue
            total = 0.0
            for c in range(start[p, 0], last):
                if not (uniform[p] or weight[c]):
                    continue
                node = candidate[c]
                w = falloff(squared(position[node], P[p]) / (radius[k] * radius[k]))
                total += w
                for word in range(words):
                    v = values[node, word]
                    for j in range(ends[word], ends[word + 1]):  # without a branch
                        seen[j] += w * np.float64(v >> np.uint64(lights[j] & 63) & np.uint64(1))
            for j in range(count):
                S[rows[p], lights[j]] = np.float32(seen[j] / total)


@kernel
def squared(a, b):
    """|a − b|²."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
