"""Blender's procedural textures, for programs of materials: noise, white noise, magic, wave, brick, Voronoi."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

Register = Any  # (n,) float64, or a number
_noise, _white_noise = kernel("procedural_noise"), kernel("procedural_white_noise")
_bend, _magic, _brick = kernel("procedural_bend"), kernel("procedural_magic"), kernel("procedural_brick")
_voronoi = kernel("procedural_voronoi")


def _block(n: int, *registers: Register) -> NDArray[np.float64]:
    """Return registers as the columns of an array (n,k)."""
    out = np.empty((n, len(registers)))
    for k, register in enumerate(registers):
        out[:, k] = register
    return out


def _columns(a: NDArray) -> Sequence[Register]:
    return tuple(np.ascontiguousarray(a[:, k]) for k in range(a.shape[1]))


def noise(n: int, dimensions: float, kind: float, normalize: float, *rest: Register,
          colour: bool = True) -> Sequence[Register]:
    """Return the Noise texture: a value and a colour, which is three times the work and 0 where it is not asked for.
    rest: x, y, z, w, detail, roughness, lacunarity, offset, gain and distortion. kind: see the enum in noise.h.
    """
    out = np.empty((n, 4))
    _noise(_block(n, *rest[:4]), _block(n, *rest[4:]), int(dimensions), int(kind), int(normalize), colour, out)
    return _columns(out)


def white_noise(n: int, dimensions: float, *place: Register) -> Sequence[Register]:
    """Return the White Noise texture at x, y, z, w: a value and a colour."""
    out = np.empty((n, 4))
    _white_noise(_block(n, *place), int(dimensions), out)
    return _columns(out)


def bend(n: int, x: Register, y: Register, z: Register, detail: Register, roughness: Register) -> Sequence[Register]:
    """Return the distortion of the Wave texture, from −1 to 1."""
    out = np.empty(n)
    _bend(_block(n, x, y, z, 0.0), _block(n, detail, roughness), out)
    return (out,)


def magic(n: int, x: Register, y: Register, z: Register, distortion: Register, depth: float) -> Sequence[Register]:
    """Return the Magic texture's colour."""
    out = np.empty((n, 3))
    _magic(_block(n, x, y, z, 0.0), _block(n, distortion)[:, 0].copy(), int(depth), out)
    return _columns(out)


def brick(n: int, offset: float, offset_frequency: float, squash: float, squash_frequency: float, x: Register,
          y: Register, *how: Register) -> Sequence[Register]:
    """Return the Brick texture: each brick's tint, and how much is mortar. how: see the kernel."""
    out = np.empty((n, 2))
    _brick(_block(n, x, y, 0.0, 0.0), _block(n, *how), offset, int(offset_frequency), squash, int(squash_frequency),
           out)
    return _columns(out)


def voronoi(n: int, dimensions: float, feature: float, metric: float, normalize: float, hashed: float,
            *rest: Register) -> Sequence[Register]:
    """Return the Voronoi texture: distance or radius, a colour, and a place (4), by choices that voronoi.c names. rest:
    x, y, z, w, detail, roughness, lacunarity, smoothness, exponent and randomness.
    """
    out = np.empty((n, 8))
    _voronoi(_block(n, *rest[:4]), _block(n, *rest[4:]), int(dimensions), int(feature), int(metric), int(normalize),
             int(hashed), out)
    return _columns(out)


TEXTURES: dict[str, Callable[..., Sequence[Register]]] = {
    "noise": noise, "white_noise": white_noise, "bend": bend, "magic": magic, "brick": brick,
    "voronoi": voronoi}
