"""Ω(i,P): local illumination by light i without visibility (method §1), and the sums over lights."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiled import kernel
from .scene import LIGHT_TYPES, Light, Material, Scene
from .tracing import Targets

POINT, SUN, SPOT, AREA = range(len(LIGHT_TYPES))


class Lights(NamedTuple):
    """All lights, structure of arrays; see scene.Light for the units."""

    type: NDArray[np.int8]  # (L,) index into LIGHT_TYPES
    position: NDArray[np.float64]  # (L,3)
    direction: NDArray[np.float64]  # (L,3) unit, the way the light travels
    intensity: NDArray[np.float64]  # (L,3)
    edge: NDArray[np.float64]  # (L,) SPOT: cosine of the half cone; AREA: tangent of half the spread
    slope: NDArray[np.float64]  # (L,) SPOT: 1/width of the blend in cosines; AREA: the spread's normalisation

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
    return Lights(
        np.array([LIGHT_TYPES.index(light.type) for light in lights], np.int8),
        np.array([light.position for light in lights], np.float64).reshape(-1, 3),
        direction / np.where(length > 0, length, 1),
        np.array([light.intensity for light in lights], np.float64).reshape(-1, 3),
        edge, slope,
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


@kernel
def omega(lights, materials, P, Ng, Ns, direction, Od, material, unlit, out, active):
    """Ω(i,P) for hits of rays with `direction`; out (n,L,3) float32, active (n,W): the bits of ξ_i·Ω_i ≠ 0.

    unlit: lights that reach P (ξ_i·I_i·f_att ≠ 0) count as active even where the material returns nothing (the
    shadow passes want them).
    """
    for p in range(len(P)):
        m = material[p]
        kd, ks, shiny = materials.kd[m], materials.ks[m], materials.nShiny[m]
        for i in range(len(lights.type)):
            out[p, i, 0] = out[p, i, 1] = out[p, i, 2] = 0.0
            kind = lights.type[i]
            if kind == SUN:
                x, y, z = -lights.direction[i, 0], -lights.direction[i, 1], -lights.direction[i, 2]
                power = 1.0
                if not Ng[p, 0] * x + Ng[p, 1] * y + Ng[p, 2] * z > 0.0:
                    continue  # ξ = 0
            else:
                x = lights.position[i, 0] - P[p, 0]
                y = lights.position[i, 1] - P[p, 1]
                z = lights.position[i, 2] - P[p, 2]
                square = x * x + y * y + z * z
                if not square > 0.0:
                    continue  # the light is on the very point
                if not Ng[p, 0] * x + Ng[p, 1] * y + Ng[p, 2] * z > 0.0:
                    continue  # ξ = 0
                inverse = 1.0 / np.sqrt(square)
                x, y, z = x * inverse, y * inverse, z * inverse
                power = inverse * inverse  # f_att
            if kind in (SPOT, AREA):
                axis = -(x * lights.direction[i, 0] + y * lights.direction[i, 1] + z * lights.direction[i, 2])
                if kind == SPOT:
                    t = min(max((axis - lights.edge[i]) * lights.slope[i], 0.0), 1.0)
                    power *= t * t * (3.0 - 2.0 * t)
                else:
                    if axis <= 0.0:
                        continue  # behind the lamp
                    power *= axis
                    if lights.slope[i] > 0.0:
                        tangent = np.sqrt(max(1.0 - axis * axis, 0.0)) / axis
                        power *= max((lights.edge[i] - tangent) * lights.slope[i], 0.0)
            r, g, b = power * lights.intensity[i, 0], power * lights.intensity[i, 1], power * lights.intensity[i, 2]
            if r == 0.0 and g == 0.0 and b == 0.0:
                continue
            cosine = Ns[p, 0] * x + Ns[p, 1] * y + Ns[p, 2] * z
            diffuse = kd * max(cosine, 0.0)
            gloss = 0.0
            if ks > 0.0:
                # (R·V) with R = 2(N·L)N − L and V = −direction
                view = -(Ns[p, 0] * direction[p, 0] + Ns[p, 1] * direction[p, 1] + Ns[p, 2] * direction[p, 2])
                lobe = 2.0 * cosine * view + x * direction[p, 0] + y * direction[p, 1] + z * direction[p, 2]
                if lobe > 0.0:
                    gloss = ks * min(lobe, 1.0) ** shiny
            r *= diffuse * Od[p, 0] + gloss * materials.Os[m, 0]
            g *= diffuse * Od[p, 1] + gloss * materials.Os[m, 1]
            b *= diffuse * Od[p, 2] + gloss * materials.Os[m, 2]
            out[p, i, 0], out[p, i, 1], out[p, i, 2] = r, g, b
            if unlit or r != 0.0 or g != 0.0 or b != 0.0:
                active[p, i >> 6] |= np.uint64(1) << np.uint64(i & 63)


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
def unlink(linked, owner, out, active):
    """Ω = 0 from lights that do not light the object owner[p]; out and active are those of `omega`."""
    for p in range(len(owner)):
        for w in range(active.shape[1]):
            active[p, w] &= linked[owner[p], w]
        for i in range(out.shape[1]):
            if not linked[owner[p], i >> 6] >> np.uint64(i & 63) & np.uint64(1):
                out[p, i, 0] = out[p, i, 1] = out[p, i, 2] = 0.0


@kernel
def gather(S, out, colour):
    """Adds U = Σ_i S_i·Ω_i, eqs. (2), (4) and (7), to colour (n,3).

    S is (n,L,C): one number a light, or RGB.
    """
    green, blue = S.shape[2] // 2, S.shape[2] - 1
    for p in range(len(S)):
        r, g, b = 0.0, 0.0, 0.0
        for i in range(S.shape[1]):
            x, y, z = np.float64(S[p, i, 0]), np.float64(S[p, i, green]), np.float64(S[p, i, blue])
            r += x * out[p, i, 0]
            g += y * out[p, i, 1]
            b += z * out[p, i, 2]
        colour[p, 0] += r
        colour[p, 1] += g
        colour[p, 2] += b


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
