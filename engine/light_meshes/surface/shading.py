"""Ω(i,P): local illumination by light i without visibility (method §1), and the sums over lights."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.tracer import Targets
from ..scene.description import LIGHT_TYPES, Light, Material, Scene
from ..support.compiled import inlined, kernel, part

POINT, SUN, SPOT, AREA = range(len(LIGHT_TYPES))
SKEWED_SPOT, SKEWED_AREA = range(len(LIGHT_TYPES), len(LIGHT_TYPES) + 2)  # those with axes of their own


class Lights(NamedTuple):
    """All lights, structure of arrays; see scene.Light for the units."""

    type: NDArray[np.int8]  # (L,) index into LIGHT_TYPES, or SKEWED_…
    position: NDArray[np.float64]  # (L,3)
    direction: NDArray[np.float64]  # (L,3) unit, the way the light travels
    intensity: NDArray[np.float64]  # (L,3)
    edge: NDArray[np.float64]  # (L,) SPOT: cosine of the half cone; AREA: tangent of half the spread
    slope: NDArray[np.float64]  # (L,) SPOT: 1/width of the blend in cosines; AREA: the spread's normalisation
    axes: NDArray[np.float64]  # (L,3,3) SKEWED_…: scene.Light.axes
    diffuse: NDArray[np.bool_]  # (L,)
    glossy: NDArray[np.bool_]  # (L,)

    def targets(self) -> Targets:
        """Where shadow rays go."""
        sun = self.type == SUN
        return Targets(np.where(sun[:, None], -self.direction, self.position), sun)


def light_arrays(lights: tuple[Light, ...]) -> Lights:
    """Scene lights as arrays."""
    edge, slope = np.zeros(len(lights)), np.zeros(len(lights))
    for i, light in enumerate(lights):
        if light.type == "SPOT":
            edge[i] = np.cos(light.spot_angle / 2)
            slope[i] = 1 / max((1 - edge[i]) * light.spot_blend, 1e-9)
        elif light.type == "AREA" and light.spread < np.pi - 1e-4:
            # As Cycles: what leaves is weighted by tan(spread/2) − tan(angle), the power kept.
            half = max(light.spread / 2, 1e-4)
            edge[i], slope[i] = np.tan(half), 1 / (np.tan(half) - half)
    direction = np.array([light.direction for light in lights], np.float64).reshape(-1, 3)
    length = np.sqrt((direction**2).sum(1, keepdims=True))
    skewed = {"SPOT": SKEWED_SPOT, "AREA": SKEWED_AREA}
    return Lights(
        np.array([skewed.get(light.type, LIGHT_TYPES.index(light.type)) if light.axes
                  else LIGHT_TYPES.index(light.type) for light in lights], np.int8),
        np.array([light.position for light in lights], np.float64).reshape(-1, 3),
        direction / np.where(length > 0, length, 1),
        np.array([light.intensity for light in lights], np.float64).reshape(-1, 3),
        edge, slope, np.array([light.axes or np.zeros((3, 3)) for light in lights], np.float64).reshape(-1, 3, 3),
        np.array([light.diffuse for light in lights], np.bool_), np.array([light.glossy for light in lights], np.bool_),
    )


class Materials(NamedTuple):
    """All materials, structure of arrays; see scene.Material."""

    Od: NDArray[np.float64]  # (M,3)
    ka: NDArray[np.float64]  # (M,)
    kd: NDArray[np.float64]
    ks: NDArray[np.float64]
    Os: NDArray[np.float64]  # (M,3)
    nShiny: NDArray[np.float64]
    mirror: NDArray[np.float64]  # (M,3)
    emission: NDArray[np.float64]  # (M,3)
    image: NDArray[np.int32]


def material_arrays(materials: tuple[Material, ...]) -> Materials:
    """Scene materials as arrays."""
    def column(name: str) -> NDArray[np.float64]:
        return np.array([getattr(m, name) for m in materials], np.float64)

    def colour(name: str) -> NDArray[np.float64]:
        return column(name).reshape(-1, 3)

    return Materials(
        colour("Od"), column("ka"), column("kd"), column("ks"), colour("Os"), column("nShiny"), colour("mirror"),
        colour("emission"), np.array([m.image for m in materials], np.int32),
    )


BLOCK = 32  # receivers that are lit side by side: a processor computes several at once


class Block(NamedTuple):
    """Receivers side by side: (3,BLOCK) each, or (BLOCK,)."""

    P: NDArray[np.float64]
    Ng: NDArray[np.float64]
    Ns: NDArray[np.float64]
    eye: NDArray[np.float64]  # the way to it
    matt: NDArray[np.float64]  # kd·Od
    gloss: NDArray[np.float64]  # ks·Os
    facing: NDArray[np.float64]  # N·V
    returns: NDArray[np.uint64]  # bits of the channels in which matt, then gloss, is not 0


class Source(NamedTuple):
    """One of `Lights`."""

    x: float  # position
    y: float
    z: float
    u: float  # direction
    v: float
    w: float
    edge: float
    slope: float
    red: float  # intensity
    green: float
    blue: float
    axes: NDArray[np.float64]  # (3,3)
    diffuse: bool
    glossy: bool


@part
def _source(lights, i):
    a, d, c = lights.position[i], lights.direction[i], lights.intensity[i]
    return Source(a[0], a[1], a[2], d[0], d[1], d[2], lights.edge[i], lights.slope[i], c[0], c[1], c[2],
                  lights.axes[i], lights.diffuse[i], lights.glossy[i])


@part
def _empty():
    return Block(np.empty((3, BLOCK)), np.empty((3, BLOCK)), np.empty((3, BLOCK)), np.empty((3, BLOCK)),
                 np.empty((3, BLOCK)), np.empty((3, BLOCK)), np.empty(BLOCK), np.empty(BLOCK, np.uint64))


@part
def _fill(block, first, materials, hits, direction, Od):
    """Take the receivers from `first` on; the last also fills the places that are left. Returns whether any shines."""
    glossy = False
    for k in range(BLOCK):
        p = min(first + k, len(direction) - 1)
        m = hits.material[p]
        block.facing[k], block.returns[k] = 0.0, 0
        for j in range(3):
            block.P[j, k], block.Ng[j, k], block.Ns[j, k] = hits.P[p, j], hits.Ng[p, j], hits.Ns[p, j]
            block.eye[j, k] = -direction[p, j]
            block.facing[k] -= hits.Ns[p, j] * direction[p, j]
            block.matt[j, k], block.gloss[j, k] = materials.kd[m] * Od[p, j], materials.ks[m] * materials.Os[m, j]
            block.returns[k] |= np.uint64(block.matt[j, k] != 0.0) << np.uint64(j)
            block.returns[k] |= np.uint64(block.gloss[j, k] != 0.0) << np.uint64(3 + j)
        glossy = glossy or block.returns[k] > 7
    return glossy


@inlined
def _arriving(kind, light, block, k):
    """At receiver k: ξ_i·f_att,i ≠ 0, f_att,i, 1/|L_i − P|, and N·L_i and R_i·V, both times |L_i − P|.

    Nothing branches on k: loops over k become vectors, and the root is left out where nobody wants it.
    """
    if kind == SUN:
        x, y, z = -light.u, -light.v, -light.w
        inverse, power, lit = 1.0, 1.0, True
    else:
        x, y, z = light.x - block.P[0, k], light.y - block.P[1, k], light.z - block.P[2, k]
        square = x * x + y * y + z * z
        inverse = 1.0 / np.sqrt(square)
        power = inverse * inverse
        lit = square > 0.0  # else the light is on the very point
    axis = -(x * light.u + y * light.v + z * light.w) * inverse
    if kind in (SKEWED_SPOT, SKEWED_AREA):
        a, b, c = light.axes[0], light.axes[1], light.axes[2]
        p, q, r = (x * a[0] + y * a[1] + z * a[2], x * b[0] + y * b[1] + z * b[2], x * c[0] + y * c[1] + z * c[2])
        turned = 1.0 / np.sqrt(p * p + q * q + r * r)
        if kind == SKEWED_SPOT:
            axis = -r * turned
        else:
            # Cycles samples a rectangle as if its axes were perpendicular: the light comes from another direction.
            lit &= axis > 0.0
            x, y, z = p * a[0] + q * b[0] + r * c[0], p * a[1] + q * b[1] + r * c[1], p * a[2] + q * b[2] + r * c[2]
            inverse = 1.0 / np.sqrt(x * x + y * y + z * z)
            axis = -(x * light.u + y * light.v + z * light.w) * inverse
            power = turned * turned * turned * abs(r)
            lit &= power > 0.0
    if kind in (SPOT, SKEWED_SPOT):
        t = (axis - light.edge) * light.slope
        t = t if t > 0.0 else 0.0
        t = t if t < 1.0 else 1.0
        lit &= t > 0.0
        power *= t * t * (3.0 - 2.0 * t)
    if kind == AREA:
        power *= axis if axis > 0.0 else 0.0
    if kind in (AREA, SKEWED_AREA):
        lit &= axis > 0.0  # else behind the lamp
        sine = 1.0 - axis * axis
        spread = (light.edge - np.sqrt(sine if sine > 0.0 else 0.0) / axis) * light.slope
        spread = spread if light.slope > 0.0 else 1.0
        lit &= spread > 0.0
        power *= spread if spread > 0.0 else 0.0
    lit &= block.Ng[0, k] * x + block.Ng[1, k] * y + block.Ng[2, k] * z > 0.0
    cosine = block.Ns[0, k] * x + block.Ns[1, k] * y + block.Ns[2, k] * z
    # R·V with R = 2(N·L)N − L
    lobe = 2.0 * cosine * block.facing[k] - (x * block.eye[0, k] + y * block.eye[1, k] + z * block.eye[2, k])
    return lit, power, inverse, cosine, lobe


@kernel
def reaching(lights, materials, hits, direction, Od, unlit, active):
    """Fills active (n,W): the bits of ξ_i·Ω_i ≠ 0, for hits of rays with `direction`.

    unlit: lights that reach P (ξ_i·I_i·f_att ≠ 0) count even where the material returns nothing (the shadow passes
    want them).
    """
    block, bits = _empty(), np.empty(BLOCK, np.uint64)
    for first in range(0, len(direction), BLOCK):
        _fill(block, first, materials, hits, direction, Od)
        for w in range(active.shape[1]):
            bits[:] = 0
            for i in range(64 * w, min(64 * w + 64, len(lights.type))):
                kind, light, bit = lights.type[i], _source(lights, i), np.uint64(1) << np.uint64(i & 63)
                if kind == POINT:
                    _mark(POINT, light, bit, unlit, block, bits)
                elif kind == SUN:
                    _mark(SUN, light, bit, unlit, block, bits)
                elif kind == SPOT:
                    _mark(SPOT, light, bit, unlit, block, bits)
                elif kind == AREA:
                    _mark(AREA, light, bit, unlit, block, bits)
                elif kind == SKEWED_SPOT:
                    _mark(SKEWED_SPOT, light, bit, unlit, block, bits)
                else:
                    _mark(SKEWED_AREA, light, bit, unlit, block, bits)
            for k in range(min(BLOCK, len(direction) - first)):
                active[first + k, w] = bits[k]


@inlined
def _mark(kind, light, bit, unlit, block, bits):
    """Set the bit of the receivers that the light reaches."""
    colour = np.uint64(light.red != 0.0) | np.uint64(light.green != 0.0) << np.uint64(1) | (
        np.uint64(light.blue != 0.0) << np.uint64(2))
    if colour == 0:
        return
    for k in range(BLOCK):
        lit, _, _, cosine, lobe = _arriving(kind, light, block, k)
        matt = light.diffuse & (block.returns[k] & colour != 0)
        gloss = light.glossy & (block.returns[k] & (colour << np.uint64(3)) != 0)
        lit &= unlit | (matt & (cosine > 0.0)) | (gloss & (lobe > 0.0))
        bits[k] |= bit if lit else np.uint64(0)


@kernel
def gather(lights, materials, hits, direction, Od, S, colour, matt, gloss):
    """Adds U = Σ_i S_i·Ω_i, eqs. (2), (4) and (7), to colour (n,3); to matt and gloss, (n,3) or (0,3), its two terms.

    S is (n,L,C): one number a light, or RGB; 0 where ξ_i·Ω_i is, which is not asked again.
    """
    channels = S.shape[2]
    block, share, total, shine = _empty(), np.empty((3, BLOCK)), np.empty((3, BLOCK)), np.empty((3, BLOCK))
    for first in range(0, len(direction), BLOCK):
        glossy = _fill(block, first, materials, hits, direction, Od)
        total[:], shine[:] = 0.0, 0.0
        for i in range(len(lights.type)):
            for c in range(channels):
                for k in range(BLOCK):
                    share[c, k] = S[min(first + k, len(direction) - 1), i, c]
            S_i = share[0], share[channels // 2], share[channels - 1]
            kind, light = lights.type[i], _source(lights, i)
            if not light.diffuse:
                pass
            elif kind == POINT:
                _add(POINT, light, S_i, block, total)
            elif kind == SUN:
                _add(SUN, light, S_i, block, total)
            elif kind == SPOT:
                _add(SPOT, light, S_i, block, total)
            elif kind == AREA:
                _add(AREA, light, S_i, block, total)
            elif kind == SKEWED_SPOT:
                _add(SKEWED_SPOT, light, S_i, block, total)
            else:
                _add(SKEWED_AREA, light, S_i, block, total)
            if glossy and light.glossy:
                _add_gloss(kind, light, S_i, block, materials.nShiny, hits.material, first, shine)
        for k in range(min(BLOCK, len(direction) - first)):
            p = first + k
            for j in range(3):
                colour[p, j] += total[j, k] * block.matt[j, k] + shine[j, k] * block.gloss[j, k]
                if len(matt):
                    matt[p, j] += total[j, k] * block.matt[j, k]
                    gloss[p, j] += shine[j, k] * block.gloss[j, k]


@inlined
def _add(kind, light, S, block, total):
    """total += S·f_att·I·(N·L); S is 0 where ξ is."""
    red, green, blue = S
    for k in range(BLOCK):
        _, power, inverse, cosine, _ = _arriving(kind, light, block, k)
        power *= cosine * inverse
        power = power if cosine > 0.0 else 0.0
        total[0, k] += red[k] * (power * light.red)
        total[1, k] += green[k] * (power * light.green)
        total[2, k] += blue[k] * (power * light.blue)


@part
def _add_gloss(kind, light, S, block, nShiny, material, first, total):
    """total += S·f_att·I·(R·V)^nShiny."""
    red, green, blue = S
    for k in range(min(BLOCK, len(material) - first)):
        _, power, inverse, _, lobe = _arriving(kind, light, block, k)
        if block.returns[k] > 7 and lobe > 0.0 and (red[k] != 0.0 or green[k] != 0.0 or blue[k] != 0.0):
            power *= min(lobe * inverse, 1.0) ** nShiny[material[first + k]]
            total[0, k] += red[k] * (power * light.red)
            total[1, k] += green[k] * (power * light.green)
            total[2, k] += blue[k] * (power * light.blue)


@kernel
def steps(lights, materials, hits, direction, Od, S, group, jump, step, matt, gloss):
    """By how much the light of a white surface may change nearby: matt and gloss (n,).

    By the share `jump` of lights seen in part, by `step` of all others. group (L,): lights of one number stand together
    and count as one, in part where one is; groups go their own ways, and so the root of their squares' sum counts.
    Where S > 1, focused light, S times that.
    """
    block, order = _empty(), np.argsort(group, kind="mergesort")
    one, all_of = np.empty((2, BLOCK)), np.empty((2, BLOCK))  # a group, the squares' sum; matt and gloss
    some = np.empty(BLOCK, np.bool_)  # a light of the group is seen in part
    for first in range(0, len(direction), BLOCK):
        _fill(block, first, materials, hits, direction, Od)
        one[:], all_of[:], some[:] = 0.0, 0.0, False
        for n in range(len(order)):
            i = order[n]
            kind, light = lights.type[i], _source(lights, i)
            ends = n + 1 == len(order) or group[order[n + 1]] != group[i]
            alone = ends and (n == 0 or group[order[n - 1]] != group[i])
            for k in range(min(BLOCK, len(direction) - first)):
                p, most = first + k, 1.0
                for c in range(S.shape[2]):
                    some[k] |= S[p, i, c] != 0.0 and S[p, i, c] != 1.0
                    most = max(most, np.float64(S[p, i, c]))
                if step > 0.0 or some[k] or not alone:
                    _, power, inverse, cosine, lobe = _arriving(kind, light, block, k)
                    power *= most * max(light.red, max(light.green, light.blue))
                    if light.diffuse:
                        one[0, k] += power * max(cosine, 0.0) * inverse
                    if light.glossy and block.returns[k] > 7 and lobe > 0.0 and cosine > 0.0:
                        one[1, k] += power * min(lobe * inverse, 1.0) ** materials.nShiny[hits.material[p]]
                if ends:
                    share = jump if some[k] else step
                    for j in range(2):
                        all_of[j, k] += (share * one[j, k]) ** 2
                    one[0, k], one[1, k], some[k] = 0.0, 0.0, False
        for k in range(min(BLOCK, len(direction) - first)):
            matt[first + k], gloss[first + k] = np.sqrt(all_of[0, k]), np.sqrt(all_of[1, k])


@kernel
def unlit(materials, material, Ia, Od, colour, ambient):
    """Emission + Ia·ka·Od, and the second term alone; Od, colour, ambient (n,3), Ia (3,)."""
    for p in range(len(material)):
        m = material[p]
        for j in range(3):
            ambient[p, j] = materials.ka[m] * Od[p, j] * Ia[j]
            colour[p, j] = materials.emission[m, j] + ambient[p, j]


def linked(scene: Scene) -> NDArray[np.uint64] | None:
    """(objects, W) bits of the lights that light each object; None where all light all."""
    if all(light.receivers is None for light in scene.lights):
        return None
    lit = np.full((len(scene.objects), (len(scene.lights) + 63) // 64), ~np.uint64(0))
    for i, light in enumerate(scene.lights):
        if light.receivers is not None:
            dark = np.setdiff1d(np.arange(len(scene.objects)), light.receivers)
            lit[dark, i >> 6] &= ~(np.uint64(1) << np.uint64(i & 63))
    return lit


@kernel
def unlink(linked, owner, active):
    """Clears the bits of lights that do not light the object owner[p]."""
    for p in range(len(owner)):
        for w in range(active.shape[1]):
            active[p, w] &= linked[owner[p], w]


@kernel
def mirrored(direction, Ng, Ns, out):
    """R = d − 2(d·N)N by the shading normal; by the geometric one where that would enter the surface."""
    for p in range(len(direction)):
        for attempt in range(2):
            N = Ns[p] if attempt == 0 else Ng[p]
            d = 2.0 * (direction[p, 0] * N[0] + direction[p, 1] * N[1] + direction[p, 2] * N[2])
            x, y, z = direction[p, 0] - d * N[0], direction[p, 1] - d * N[1], direction[p, 2] - d * N[2]
            if x * Ng[p, 0] + y * Ng[p, 1] + z * Ng[p, 2] > 0.0:
                break
        length = np.sqrt(x * x + y * y + z * z)
        out[p, 0], out[p, 1], out[p, 2] = x / length, y / length, z / length
