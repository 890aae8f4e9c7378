"""The sky of a clear day by direction. The operation "sky" of programs computes it, like Blender's Sky Texture.

Two models follow sunlight through the air: SINGLE, light that was scattered once (Nishita et al., "Display of the earth
taking into account atmospheric scattering", 1993, with ozone), at 21 wavelengths; MULTIPLE, with an approximation of
light that was scattered more often or returned by the ground (García Liñán, "Spectral sky", 2024), at 4. PREETHAM is a
formula that was fitted to such skies (Preetham, Shirley, Smits, "A practical analytic model for daylight", 1999).

The slow part is done once for each sky: a table of the light that air and dust scatter, without their phase functions,
by azimuth from the sun and elevation, in which this light is smooth. Colours are CIE XYZ; lengths are metres, and
kilometres in MULTIPLE.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.native import kernel

_look = kernel("atmosphere_look")
MODELS = SINGLE, MULTIPLE, PREETHAM = range(3)
AZIMUTHS, ELEVATIONS = 33, 129  # of the tables: from the sun to the other side, and on each side of the horizon


class Weather(NamedTuple):
    """The parameters of a sky. Not every model uses all of them."""

    model: float
    elevation: float  # of the sun, radians
    rotation: float  # of the sun, from y towards x
    altitude: float  # of the one who looks, metres
    air: float  # densities, as factors of the usual ones
    dust: float
    ozone: float
    size: float  # full angle of the sun's disc, radians; 0: it is not drawn
    intensity: float  # factor of the sun's disc
    turbidity: float


def sky(n: int, *arguments: Any) -> tuple[NDArray[np.float64], ...]:
    """Return X, Y and Z, each (n,), of the light from directions x, y, z (n,). The other arguments are those of
    `Weather`.
    """
    weather, place = Weather(*arguments[:-3]), arguments[-3:]
    direction = np.stack([np.broadcast_to(np.asarray(p, np.float64), n) for p in place], axis=1)
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    direction = np.where(length > 0, direction / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))
    sun = _direction(weather.elevation, weather.rotation)
    xyz = _fitted(weather, direction, sun) if weather.model == PREETHAM else (
        _scattered(weather, direction, sun) + _disc(weather, direction, sun))
    return tuple(np.ascontiguousarray(xyz[:, k]) for k in range(3))


def _direction(elevation: float, rotation: float) -> NDArray[np.float64]:
    """Return the unit vector (3,) to a place of the sky; rotation turns from y towards x."""
    flat = np.cos(elevation)
    return np.array([flat * np.sin(rotation), flat * np.cos(rotation), np.sin(elevation)])


# --- what air scatters ------------------------------------------------------------------------------------------------


def _scattered(w: Weather, direction: NDArray[np.float64], sun: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sky's light (n,3) without the sun's disc."""
    tables = (_single if w.model == SINGLE else _multiple)(*w[1:2], *w[3:7])
    away = np.arctan2(direction[:, 0], direction[:, 1]) - w.rotation
    away = np.abs((away + np.pi) % (2 * np.pi) - np.pi)
    elevation, mu = np.arcsin(np.clip(direction[:, 2], -1, 1)), direction @ sun
    phases: tuple[NDArray[np.float64], ...]
    if w.model == MULTIPLE:
        phases = (3 / (16 * np.pi) * (1 + mu * mu), _henyey(mu, 0.8), np.ones_like(mu))
        return _looked_up(tables, away, elevation, phases)
    # Blender's table has 512 × 128 entries and is read half an entry beside; the ground is what the horizon is.
    away = np.minimum(away + np.pi / 512, np.pi)
    elevation = np.maximum(np.sqrt(np.maximum(elevation, 0) / (np.pi / 2)) - 0.5 / 128, 0) ** 2 * (np.pi / 2)
    mu = np.cos(elevation) * np.cos(away) * np.cos(w.elevation) + np.sin(elevation) * np.sin(w.elevation)
    g2 = 0.76**2
    phases = (3 / (16 * np.pi) * (1 + mu * mu),
              3 * (1 - g2) * (1 + mu * mu) / (8 * np.pi * (2 + g2) * (1 + g2 - 2 * 0.76 * mu) ** 1.5))
    return _looked_up(tables, away, elevation, phases) * (  # darker further down
        np.maximum(1 + 2.5 * np.minimum(direction[:, 2], 0), 0) ** 3)[:, None]


def _henyey(mu: NDArray[np.float64], g: float) -> NDArray[np.float64]:
    """Return Henyey and Greenstein's phase function."""
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * mu) ** 1.5)


def _looked_up(tables: NDArray[np.float64], away: NDArray, elevation: NDArray, phases: tuple) -> NDArray[np.float64]:
    """Return the sum of tables (k, rows, AZIMUTHS, 3), each times its phase function (n,), at these places."""
    rows = tables.shape[1]
    up = np.sqrt(np.abs(elevation) / (np.pi / 2)) * (ELEVATIONS - 1)
    y = up if rows == ELEVATIONS else np.copysign(up, elevation) + ELEVATIONS - 1.5
    out = np.empty((len(y), 3))
    _look(tables, away / np.pi * (AZIMUTHS - 1), y, np.stack(phases), out)
    return out


def _grid(below: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the unit directions (rows·AZIMUTHS, 3) of a table, where the sun is towards y; more of them at the
    horizon.

    With what is below it none is at the horizon, where the ground begins, but two are beside it, as in Blender's table.
    """
    row = np.linspace(0, 1, ELEVATIONS)
    if below:
        row = (np.arange(2 * ELEVATIONS - 2) + 0.5) / (ELEVATIONS - 1) - 1
    elevation = np.copysign(row * row, row) * (np.pi / 2)
    e, a = np.meshgrid(elevation, np.linspace(0, np.pi, AZIMUTHS), indexing="ij")
    return np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], -1).reshape(-1, 3), elevation


# --- the sun's disc ---------------------------------------------------------------------------------------------------


def _disc(w: Weather, direction: NDArray[np.float64], sun: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the light (n,3) of the sun's disc: darker at its limb, and redder below than above."""
    found = np.zeros((len(direction), 3))
    if w.size <= 0:
        return found
    angle = 2 * np.arctan2(np.linalg.norm(direction - sun, axis=1), np.linalg.norm(direction + sun, axis=1))
    elevation = np.arcsin(np.clip(direction[:, 2], -1, 1))
    horizon = 0.0 if w.model == SINGLE else -np.arccos(EARTH / (EARTH + w.altitude / 1000))
    on = np.flatnonzero((angle < w.size / 2) & (elevation > horizon))
    if len(on):
        both = (_single_sun if w.model == SINGLE else _multiple_sun)(w)
        share = np.clip((elevation[on] - w.elevation) / w.size + 0.5, 0, 1)[:, None]
        limb = 1 - 0.6 * (1 - np.sqrt(np.maximum(1 - (angle[on] / (w.size / 2)) ** 2, 0)))
        found[on] = (both[0] * (1 - share) + both[1] * share) * (limb * w.intensity)[:, None]
    return found


def _solid_angle(w: Weather) -> float:
    return float(2 * np.pi * (1 - np.cos(w.size / 2)))


# --- light that was scattered once ------------------------------------------------------------------------------------

_WAVES = np.linspace(380.0, 780.0, 21)  # nm
# CIE 1931, 2°, at these wavelengths.
_OBSERVER = np.array([
    (.001368, .000039, .00645), (.01431, .000396, .06785), (.13438, .004, .6456), (.34828, .023, 1.74706),
    (.2908, .06, 1.6692), (.09564, .13902, .81295), (.0049, .323, .272), (.06327, .71, .07825), (.2904, .954, .0203),
    (.5945, .995, .0039), (.9163, .87, .00165), (1.0622, .631, .0008), (.85445, .381, .00019), (.4479, .175, .00002),
    (.1649, .061, 0), (.04677, .017, 0), (.011359, .004102, 0), (.002899, .001047, 0), (.00069, .000249, 0),
    (.000166, .00006, 0), (.000042, .000015, 0)])
# The sun above the air, W/(m²·nm): a black body of 5,778 K. What scatters, and absorbs, at the ground and where ozone
# is densest: by Rayleigh's law, and as measured, 1/m.
_SUN = 6.797e-5 * 1.191043e-16 / (_WAVES * 1e-9) ** 5 / np.expm1(0.01438777 / (_WAVES * 1e-9 * 5778)) * 1e-9
_AIR = 1.13116e-6 / (_WAVES / 1000) ** 4
_DUST, _DUST_ALSO_ABSORBS = 2e-5, 1.11
_OZONE = 1e-6 * np.array([.00325, .00585, .0198, .0731, .201, .404, .636, .967, 1.548, 2.090, 2.461, 2.736, 2.151,
                          1.591, 1.124, .735, .465, .331, .225, .149, .168])
_GROUND, _TOP = 6360e3, 6420e3
_STEPS = 32
# Gauss and Laguerre's rule: what is dense where it begins, and thins out.
_NODES, _WEIGHTS = np.polynomial.laguerre.laggauss(8)
_NODES, _WEIGHTS = _NODES / 25, _WEIGHTS * np.exp(_NODES) / 25


def _densities(P: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the densities of air, dust and ozone at places (…,3) around the earth's middle, as shares of the largest.
    """
    height = np.linalg.norm(P, axis=-1) - _GROUND
    ozone = np.maximum(1 - np.abs(height - 25e3) / 15e3, 0)
    return np.stack([np.exp(-height / 8e3), np.exp(-height / 1.2e3), ozone], -1)


def _to_the_top(P: NDArray[np.float64], d: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far (…,) it is from places along unit d to the end of the air."""
    b = (P * d).sum(-1)
    return np.sqrt(np.maximum(b * b + _TOP**2 - (P * P).sum(-1), 0)) - b


def _depths(P: NDArray[np.float64], d: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how much air, dust and ozone (…,3) light meets from places along d, as metres of the densest."""
    far = _to_the_top(P, d)
    total = np.zeros((*P.shape[:-1], 3))
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        total += weight * _densities(P + (node * far)[..., None] * d)
    return total * far[..., None]


@lru_cache(8)
def _single(elevation: float, altitude: float, air: float, dust: float, ozone: float) -> NDArray[np.float64]:
    """Return the tables of SINGLE: of air and of dust."""
    d, rows = _grid(below=False)
    sun, density = _direction(elevation, 0.0), np.array([air, dust, ozone])
    eye = np.array([0.0, 0.0, _GROUND + np.clip(altitude, 1, 59999)])
    step = _to_the_top(np.broadcast_to(eye, d.shape), d) / _STEPS
    depth = np.zeros((len(d), 3))
    extinction = np.stack([_AIR, np.full(21, _DUST * _DUST_ALSO_ABSORBS), _OZONE])
    tables = np.zeros((2, len(d), 21))
    for i in range(_STEPS):
        P = eye + ((i + 0.5) * step)[:, None] * d
        here = _densities(P) * density
        depth += here * step[:, None]
        # Where the earth is in the way it is night.
        b = P @ sun
        night = (b * b - (P * P).sum(1) + _GROUND**2 >= 0) & (sun[2] < 0)
        left = np.exp(-(depth + _depths(P, sun) * density) @ extinction) * (step * ~night)[:, None]
        tables[0] += left * here[:, 0:1]
        tables[1] += left * here[:, 1:2]
    tables[0] *= _AIR * _SUN
    tables[1] *= _DUST * _SUN
    return (tables @ _OBSERVER * 20.0).reshape(2, len(rows), AZIMUTHS, 3)


def _single_sun(w: Weather) -> NDArray[np.float64]:
    """Return the colours (2,3) of the lowest and of the highest point of the sun's disc."""
    eye = np.array([0.0, 0.0, _GROUND + np.clip(w.altitude, 1, 59999)])
    if w.elevation + w.size / 2 <= 0:
        return np.zeros((2, 3))
    d = np.stack([_direction(max(w.elevation + side * w.size / 2, 0.0), 0.0) for side in (-1, 1)])
    depth = _depths(np.broadcast_to(eye, d.shape), d)
    left = np.exp(-depth[:, :1] * (_AIR * w.air) - depth[:, 1:2] * (_DUST * _DUST_ALSO_ABSORBS * w.dust))
    return left * _SUN @ _OBSERVER * (20.0 / _solid_angle(w))


# --- light that was scattered often -----------------------------------------------------------------------------------

EARTH, THICK = 6371.0, 100.0  # km
# At 630, 560, 490 and 430 nm: the sun above the air; what air scatters at the ground, 1/km; what a molecule of ozone
# absorbs, and a particle of dust absorbs and scatters, m²; and the colours of these four kinds of light.
_SUN_4 = np.array([1.679, 1.828, 1.986, 1.307])
_AIR_4 = np.array([6.605e-3, 1.067e-2, 1.842e-2, 3.156e-2])
_OZONE_4 = np.array([3.472e-25, 3.914e-25, 1.349e-25, 11.03e-27]) * 334.5  # × Dobson units of a usual year
_DUST_ABSORBS_4 = np.array([2.8722e-24, 4.6168e-24, 7.9706e-24, 1.3578e-23])
_DUST_SCATTERS_4 = np.array([1.5908e-22, 1.7711e-22, 2.0942e-22, 2.4033e-22])
_XYZ_4 = np.array([(53.386918, 22.981338, 0.0), (43.904845, 71.347796, 0.102507), (1.613728, 18.422961, 31.742921),
                   (20.762669, 2.361421, 110.480096)])
_MARCH = 64
_HEIGHTS, _COSINES = 64, 256  # of the table of transmittances


class _Air(NamedTuple):
    """The properties of air at places (…,4), 1/km."""

    molecules: NDArray[np.float64]  # scatter
    particles: NDArray[np.float64]
    extinction: NDArray[np.float64]  # of all


def _air_at(height: NDArray[np.float64], air: float, dust: float, ozone: float) -> _Air:
    """Return the air at heights (…,), km."""
    h = np.maximum(height, 0.0)[..., None]
    molecules = _AIR_4 * (air * np.exp(-0.07771971 * h**1.16364243))
    log = np.log(np.maximum(h, 1e-4))
    layer = 3.78547397e20 * ozone * np.exp(-5.55555555 * (log - 3.22261) ** 2 - log)
    grains = dust * (1.3681e20 * np.exp(-h / 0.73) + 2e6)
    particles = _DUST_SCATTERS_4 * grains
    return _Air(molecules, particles, molecules + particles + _OZONE_4 * layer + _DUST_ABSORBS_4 * grains)


def _reach(distance: NDArray[np.float64], cosine: NDArray[np.float64], radius: float) -> tuple[NDArray, NDArray]:
    """Return how far it is to the near and to the far side of a sphere around the earth's middle; NaN where it is
    missed.
    """
    with np.errstate(invalid="ignore"):
        root = np.sqrt(radius**2 - distance**2 * (1 - cosine**2))
    return -distance * cosine - root, -distance * cosine + root


def _transmittance(cosine: NDArray[np.float64], height: NDArray[np.float64], air: float, dust: float,
                   ozone: float) -> NDArray[np.float64]:
    """Return what is left (…,4) of sunlight that comes to `height` (km) from a direction with this cosine to the
    zenith.
    """
    distance = EARTH + height
    step = _reach(distance, cosine, EARTH + THICK)[1] / _MARCH
    depth = np.zeros((*np.shape(step), 4))
    for i in range(_MARCH):
        t = (i + 0.5) * step
        at = np.sqrt(distance**2 + t * t + 2 * t * distance * cosine) - EARTH
        depth += _air_at(at, air, dust, ozone).extinction * step[..., None]
    return np.exp(-depth)


@lru_cache(8)
def _multiple(elevation: float, altitude: float, air: float, dust: float, ozone: float) -> NDArray[np.float64]:
    """Return the tables of MULTIPLE: of molecules, of particles, and of what came to both from everywhere."""
    d, rows = _grid(below=True)
    eye, sun = EARTH + np.clip(altitude, 1, 99999) / 1000, _direction(elevation, 0.0)
    h, c = np.meshgrid(np.linspace(0, THICK, _HEIGHTS), np.linspace(-1, 1, _COSINES), indexing="ij")
    lit = _transmittance(c, h, air, dust, ozone)
    end = np.broadcast_to(eye, len(d))
    ground, top = _reach(end, d[:, 2], EARTH)[0], _reach(end, d[:, 2], EARTH + THICK)[1]
    step = np.where(ground > 0, ground, top) / _MARCH
    left, tables = np.ones((len(d), 4)), np.zeros((3, len(d), 4))
    for i in range(_MARCH):
        P = d * ((i + 0.5) * step)[:, None] + (0, 0, eye)
        distance = np.linalg.norm(P, axis=1)
        height, cosine = np.maximum(distance - EARTH, 0), P @ sun / distance
        here = _air_at(height, air, dust, ozone)
        direct, often = _between(lit, cosine, height), _often(lit, cosine, height, distance)
        passed = np.exp(-here.extinction * step[:, None])
        share = left * (1 - passed) / np.maximum(here.extinction, 1e-7)
        tables[0] += share * here.molecules * direct
        tables[1] += share * here.particles * direct
        tables[2] += share * (here.molecules + here.particles) * often
        left *= passed
    return (tables * _SUN_4 @ _XYZ_4).reshape(3, len(rows), AZIMUTHS, 3)


def _between(lit: NDArray[np.float64], cosine: NDArray, height: NDArray) -> NDArray[np.float64]:
    """Return the table of transmittances (heights, cosines, 4) at these places, linearly."""
    x, y = np.clip(cosine * 0.5 + 0.5, 0, 1) * (_COSINES - 1), np.clip(height / THICK, 0, 1) * (_HEIGHTS - 1)
    i, j = np.minimum(x.astype(np.int64), _COSINES - 2), np.minimum(y.astype(np.int64), _HEIGHTS - 2)
    fx, fy = (x - i)[:, None], (y - j)[:, None]
    return (lit[j, i] * (1 - fx) + lit[j, i + 1] * fx) * (1 - fy) + (
        lit[j + 1, i] * (1 - fx) + lit[j + 1, i + 1] * fx) * fy


def _often(lit: NDArray[np.float64], cosine: NDArray, height: NDArray, distance: NDArray) -> NDArray[np.float64]:
    """Return the light that comes to places from all sides: from the ground, and (by a fit) from air that was lit by
    air.
    """
    seen = 2 * np.pi * (1 - np.sqrt(np.maximum(1 - (EARTH / distance) ** 2, 0)))[:, None]  # solid angle of the earth
    up = np.ones_like(cosine)
    climbed = _between(lit, up, 0 * up) / _between(lit, up, height)
    ground = seen / (4 * np.pi) * (0.3 / np.pi) * _between(lit, cosine, 0 * up) * climbed * cosine[:, None]
    fit = 0.02 * np.array([0.217, 0.347, 0.594, 1.0]) / (1 + 5 * np.exp(-17.92 * cosine))[:, None]
    return ground + fit


def _multiple_sun(w: Weather) -> NDArray[np.float64]:
    """Return the colours (2,3) of the lowest and of the highest point of the sun's disc."""
    elevation = w.elevation + np.array([-0.5, 0.5]) * w.size
    height = np.full(2, np.clip(w.altitude, 1, 99999) / 1000)
    left = _transmittance(np.sin(elevation), height, w.air, w.dust, w.ozone)
    return left * _SUN_4 @ _XYZ_4 / _solid_angle(w)


# --- a formula --------------------------------------------------------------------------------------------------------

# Of Y, x and y: five numbers of the sky's shape, each a line in the turbidity; and the zenith's x and y, cubic in the
# sun's distance from it and square in the turbidity.
_SHAPE = np.array([
    [(0.1787, -1.4630), (-0.3554, 0.4275), (-0.0227, 5.3251), (0.1206, -2.5771), (-0.0670, 0.3703)],
    [(-0.0193, -0.2592), (-0.0665, 0.0008), (-0.0004, 0.2125), (-0.0641, -0.8989), (-0.0033, 0.0452)],
    [(-0.0167, -0.2608), (-0.0950, 0.0092), (-0.0079, 0.2102), (-0.0441, -1.6537), (-0.0109, 0.0529)]])
_ZENITH = np.array([
    [(0.00166, -0.00375, 0.00209, 0), (-0.02903, 0.06377, -0.03202, 0.00394), (0.11693, -0.21196, 0.06052, 0.25886)],
    [(0.00275, -0.00610, 0.00317, 0), (-0.04214, 0.08970, -0.04153, 0.00516), (0.15346, -0.26756, 0.06670, 0.26688)]])


def _perez(k: NDArray[np.float64], cosine: Any, angle: Any) -> Any:
    """Return Perez's shape of the sky for the parameters k (5,), the cosine to the zenith, and the angle to the sun."""
    return (1 + k[0] * np.exp(k[1] / cosine)) * (1 + k[2] * np.exp(k[3] * angle) + k[4] * np.cos(angle) ** 2)


def _fitted(w: Weather, direction: NDArray[np.float64], sun: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the light of PREETHAM (n,3)."""
    T, zenith = w.turbidity, np.pi / 2 - w.elevation
    shape = _SHAPE @ (T, 1.0)
    high = np.array([(4.0453 * T - 4.9710) * np.tan((4 / 9 - T / 120) * (np.pi - 2 * zenith)) - 0.2155 * T + 2.4192,
                     *(_ZENITH @ (zenith**3, zenith**2, zenith, 1.0) @ (T * T, T, 1.0))])
    high[0] *= 0.06
    cosine = np.maximum(direction[:, 2], np.cos(np.pi / 2 - 0.001))
    angle = np.arccos(np.clip(direction @ sun, -1, 1))
    Y, x, y = (level * _perez(k, cosine, angle) / _perez(k, 1.0, zenith) for level, k in zip(high, shape, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(np.stack([x / y * Y, Y, (1 - x - y) / y * Y], axis=1))
