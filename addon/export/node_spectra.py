"""Values of Blender's nodes that make colours of light by its spectrum: Blackbody and Wavelength.

Colours come from the CIE's standard observer of 1931 (2°), in steps of 5 nm from 380 to 780 nm.
"""

from __future__ import annotations

import functools
import math

from . import values as v
from .color import from_xyz
from .values import Triple, Value

# x̄, ȳ, z̄ in ten-thousandths, one after the other.
_OBSERVER = [
    14, 0, 65, 22, 1, 105, 42, 1, 201, 76, 2, 362, 143, 4, 679, 232, 6, 1102, 435, 12, 2074, 776, 22, 3713, 1344,
    40, 6456, 2148, 73, 10391, 2839, 116, 13856, 3285, 168, 16230, 3483, 230, 17471, 3481, 298, 17826, 3362, 380,
    17721, 3187, 480, 17441, 2908, 600, 16692, 2511, 739, 15281, 1954, 910, 12876, 1421, 1126, 10419, 956, 1390,
    8130, 580, 1693, 6162, 320, 2080, 4652, 147, 2586, 3533, 49, 3230, 2720, 24, 4073, 2123, 93, 5030, 1582, 291,
    6082, 1117, 633, 7100, 782, 1096, 7932, 573, 1655, 8620, 422, 2257, 9149, 298, 2904, 9540, 203, 3597, 9803,
    134, 4334, 9950, 87, 5121, 10000, 57, 5945, 9950, 39, 6784, 9786, 27, 7621, 9520, 21, 8425, 9154, 18, 9163,
    8700, 17, 9786, 8163, 14, 10263, 7570, 11, 10567, 6949, 10, 10622, 6310, 8, 10456, 5668, 6, 10026, 5030, 3,
    9384, 4412, 2, 8544, 3810, 2, 7514, 3210, 1, 6424, 2650, 0, 5419, 2170, 0, 4479, 1750, 0, 3608, 1382, 0, 2835,
    1070, 0, 2187, 816, 0, 1649, 610, 0, 1212, 446, 0, 874, 320, 0, 636, 232, 0, 468, 170, 0, 329, 119, 0, 227, 82,
    0, 158, 57, 0, 114, 41, 0, 81, 29, 0, 58, 21, 0, 41, 15, 0, 29, 10, 0, 20, 7, 0, 14, 5, 0, 10, 4, 0, 7, 2, 0,
    5, 2, 0, 3, 1, 0, 2, 1, 0, 2, 1, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0]
OBSERVER = [tuple(n / 10000 for n in _OBSERVER[i:i + 3]) for i in range(0, len(_OBSERVER), 3)]
FIRST, STEP = 380.0, 5.0  # nm
COLDEST, HOTTEST, KELVINS = 800.0, 12000.0, 20.0  # of the table for Blackbody, K: beyond, the colour stays


def _planck(wavelength: float, kelvin: float) -> float:
    """Return the radiance of a black body at a wavelength (nm), but for a factor."""
    return 1 / (wavelength**5 * (math.exp(1.4387769e7 / (wavelength * kelvin)) - 1))


@functools.cache
def _blackbodies() -> tuple[tuple[float, ...], ...]:
    """Return X, Y and Z, with Y = 1, of black bodies from COLDEST to HOTTEST."""
    rows = []
    for n in range(round((HOTTEST - COLDEST) / KELVINS) + 1):
        power = [_planck(FIRST + STEP * i, COLDEST + KELVINS * n) for i in range(len(OBSERVER))]
        total = [sum(p * o[k] for p, o in zip(power, OBSERVER, strict=True)) for k in range(3)]
        rows.append([t / total[1] for t in total])
    return tuple(zip(*rows, strict=True))


def _looked_up(columns, place: Value) -> Triple:
    """Return the values of three tables at a place, which counts their entries."""
    if v.is_constant(place):
        at = min(max(place, 0.0), len(columns[0]) - 1.0)
        i = min(int(at), len(columns[0]) - 2)
        return tuple(c[i] + (c[i + 1] - c[i]) * (at - i) for c in columns)  # type: ignore[return-value]
    return tuple(v.operation("table", place, tuple(c), 1.0, 0.0) for c in columns)  # type: ignore[return-value]


def from_light(xyz: Triple) -> Triple:
    """Return a colour of the scene's linear light, from 0 on."""
    return tuple(v.maximum(v.dot(row, xyz), 0.0) for row in from_xyz())  # type: ignore[return-value]


def blackbody(nodes, node, socket) -> Triple:
    """Translate the Blackbody node: the colour of what glows at a temperature, with a luminance of 1."""
    kelvin = nodes.value(node, "Temperature")
    return from_light(_looked_up(_blackbodies(), (kelvin - COLDEST) * (1 / KELVINS)))


def wavelength(nodes, node, socket) -> Triple:
    """Translate the Wavelength node: the colour of light of a single wavelength (nm), scaled as Blender does it."""
    nm = nodes.value(node, "Wavelength")
    seen = v.where(v.less(nm, FIRST), 0.0, v.where(v.less(nm, FIRST + STEP * (len(OBSERVER) - 1)), 1 / 2.52, 0.0))
    found = from_light(_looked_up(tuple(zip(*OBSERVER, strict=True)), (nm - FIRST) * (1 / STEP)))
    return tuple(c * seen for c in found)  # type: ignore[return-value]


NODES = {
    'ShaderNodeBlackbody': blackbody,
    'ShaderNodeWavelength': wavelength,
}
