"""Highlights of microfacets (GGX), as the engine's Material has them: a metal's lobe and a dielectric's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from . import values as v
from .values import Triple, Value

WHITE: Triple = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Facets:
    """The two lobes of a surface. Each value is a number or an expression."""

    roughness: Value = 1.0
    metal: Value = 0.0  # weight of the metal's lobe
    F0: Triple = WHITE  # what it reflects at normal incidence, at a grazing angle,
    F90: Triple = WHITE
    F82: Triple = WHITE  # and at 82°, as a share of what Schlick's formula has there
    dielectric: Value = 0.0  # weight of the dielectric's lobe
    ior: Value = 1.5
    tint: Triple = WHITE
    layered: Value = 0.0  # share of the diffuse light that is below the dielectric
    compensation: Value = 1.0  # share that has the distribution Multiscatter GGX
    coat: Value = 0.0  # weight of a clear coat
    coat_roughness: Value = 0.0
    coat_ior: Value = 1.5
    coat_tint: Triple = WHITE

    @classmethod
    def glossy(cls, color: Triple, roughness: Value, compensation: Value = 1.0) -> Facets:
        """Glossy BSDF: the same colour at all angles."""
        weight = v.maximum(v.largest(color), 1.0)  # the engine takes no reflectance above 1
        shown = _held(v.divide(c, weight) for c in color)
        return cls(roughness=roughness, metal=weight, F0=shown, F90=shown, compensation=compensation)

    @classmethod
    def conductor(cls, n: Triple, k: Triple, roughness: Value, compensation: Value = 1.0) -> Facets:
        """Metallic BSDF by a complex index of refraction n + ik, by its reflectance at 0° and 82°."""
        n, k = (tuple(v.maximum(c, 0.0) for c in triple) for triple in (n, k))
        pairs = list(zip(n, k, strict=True))
        F0 = _held(_conductor(1.0, *pair) for pair in pairs)
        edge = (6 / 7) ** 5
        F82 = _held(v.divide(_conductor(1 / 7, *pair), f + (1.0 - f) * edge) for f, pair in zip(F0, pairs, strict=True))
        return cls(roughness=roughness, metal=1.0, F0=F0, F82=F82, compensation=compensation)

    @classmethod
    def principled(cls, color: Triple, metallic: Value, roughness: Value, level: Value, ior: Value,
                   tint: Triple = WHITE, compensation: Value = 1.0) -> Facets:
        """Principled BSDF without its transmission, coat and sheen.

        The specular level scales the reflectance that the index of refraction gives, and thereby that index.
        """
        ior = v.maximum(ior, 1e-5)
        if not (v.is_constant(level) and level == 0.5):
            root = v.square_root(v.minimum(squared((ior - 1) / (ior + 1)) * (2.0 * v.maximum(level, 0.0)), 0.99))
            scaled = (1.0 + root) / (1.0 - root)
            ior = v.where(v.less(ior, 1.0), v.divide(1.0, scaled), scaled)
        there = 0.0 if v.is_constant(ior) and ior == 1 else 1.0
        return cls(roughness=roughness, metal=metallic, F0=_held(color), F82=_held(tint),
                   dielectric=there * (1.0 - metallic), ior=ior, tint=tuple(v.maximum(c, 0.0) for c in tint),
                   layered=there, compensation=compensation)

    @classmethod
    def glass(cls, color: Triple, ior: Value, roughness: Value, compensation: Value = 1.0) -> Facets:
        """The reflection of Glass BSDF."""
        weight = v.largest(color)
        return cls(roughness=roughness, dielectric=weight, ior=ior, tint=tuple(v.divide(c, weight) for c in color),
                   compensation=compensation)

    def coated(self, weight: Value, roughness: Value, ior: Value, tint: Triple) -> Facets:
        """These facets below a clear coat."""
        return replace(self, coat=v.clamp(weight), coat_roughness=v.clamp(roughness), coat_ior=v.maximum(ior, 1.0),
                       coat_tint=_held(tint))

    def coat_reflectance(self) -> Value:
        """What the coat reflects at normal incidence."""
        return self.coat * squared((self.coat_ior - 1) / (self.coat_ior + 1))

    def plus(self, other: Facets, mine: Value, others: Value, below: tuple[Value, Value]) -> Facets:
        """The weighted sum of two; where there can only be one value it is the mean.

        below: how much of what is diffuse is each one's.
        """
        a, b = self, other
        metals, plates = (mine * a.metal, others * b.metal), (mine * a.dielectric, others * b.dielectric)
        coats = mine * a.coat, others * b.coat
        shine = tuple(m * v.largest(s.F0) + d * squared((s.ior - 1) / (s.ior + 1))
                      for m, d, s in zip(metals, plates, (a, b), strict=True))
        return Facets(
            roughness=weighted((a.roughness,), (b.roughness,), *shine)[0],
            metal=metals[0] + metals[1],
            F0=weighted(a.F0, b.F0, *metals), F90=weighted(a.F90, b.F90, *metals), F82=weighted(a.F82, b.F82, *metals),
            dielectric=plates[0] + plates[1],
            ior=weighted((a.ior,), (b.ior,), *plates)[0], tint=weighted(a.tint, b.tint, *plates),
            layered=weighted((a.layered,), (b.layered,), *below)[0],
            compensation=weighted((a.compensation,), (b.compensation,), *shine)[0],
            coat=coats[0] + coats[1], coat_tint=weighted(a.coat_tint, b.coat_tint, *coats),
            coat_roughness=weighted((a.coat_roughness,), (b.coat_roughness,), *coats)[0],
            coat_ior=weighted((a.coat_ior,), (b.coat_ior,), *coats)[0],
        )

    def parameters(self) -> dict[str, Any]:
        """What the engine's Material says of it; nothing where nothing shines."""
        lobes = self.metal, self.dielectric, self.coat
        if v.is_constant(*lobes) and not any(lobes):
            return {}
        return {
            "highlight": 'GGX', "roughness": v.clamp(self.roughness),
            "metal": v.maximum(self.metal, 0.0), "F0": list(self.F0), "F90": list(self.F90), "F82": list(self.F82),
            "dielectric": v.maximum(self.dielectric, 0.0), "dielectric_ior": v.clamp(self.ior, 1e-5, 1000.0),
            "dielectric_tint": list(self.tint), "layered": v.clamp(self.layered),
            "compensation": v.clamp(self.compensation),
            "coat": v.clamp(self.coat), "coat_roughness": self.coat_roughness,
            "coat_ior": v.minimum(self.coat_ior, 1000.0), "coat_tint": list(self.coat_tint),
        }


NO_FACETS = Facets()


def squared(a: Value) -> Value:
    """The value times itself."""
    return a * a


def weighted(a: tuple, b: tuple, weight_a: Value, weight_b: Value) -> Any:
    """The weighted mean of two colours or numbers; the first where both weights are 0."""
    total = weight_a + weight_b
    counts = v.greater(total, 0.0)
    share_a, share_b = v.divide(weight_a, total), v.divide(weight_b, total)
    return tuple(v.where(counts, x * share_a + y * share_b, x) for x, y in zip(a, b, strict=True))


def _held(color) -> Triple:
    """A colour between 0 and 1."""
    return tuple(v.clamp(c) for c in color)  # type: ignore[return-value]


def _conductor(c: float, n: Value, k: Value) -> Value:
    """Fresnel's equations of a conductor in air at the cosine c (M. Born, E. Wolf: Principles of optics, 14.4.1)."""
    cc, ss = c * c, 1.0 - c * c
    real = n * n - k * k - ss
    both = v.square_root(real * real + 4.0 * (n * n) * (k * k))
    twice = 2.0 * c * v.square_root(0.5 * (both + real))
    sharp = v.divide(both + cc - twice, both + cc + twice)
    flat = v.divide(cc * both + ss * ss - twice * ss, cc * both + ss * ss + twice * ss)
    return 0.5 * sharp * (1.0 + flat)
