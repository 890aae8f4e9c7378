"""Highlights of microfacets (GGX), as the engine's Material has them: a metal's lobe and a dielectric's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import bpy

from . import values as v
from .values import Triple, Value

WHITE: Triple = (1.0, 1.0, 1.0)
# Formulas by which this Blender's Cycles differs from the newest: parameters of the engine's Material.
FORMULAS = {name: False for name, since in (("matt_several", (4, 3)), ("coat_several", (4, 5)),
                                            ("facet_bumps", (4, 5))) if bpy.app.version < since}


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
    coat_normal: Triple | None = None  # by which it dims what is below; None: the surface's own
    sheen: Value = 0.0  # weight of fibres over all that
    sheen_roughness: Value = 0.3
    sheen_tint: Triple = WHITE
    sheen_normal: Triple | None = None
    share: Value = 1.0  # of the light of coat and sheen that counts

    @classmethod
    def glossy(cls, color: Triple, roughness: Value, compensation: Value = 1.0) -> Facets:
        """Return the lobe of the Glossy BSDF: the same colour at all angles."""
        weight = v.maximum(v.largest(color), 1.0)  # the engine takes no reflectance above 1
        shown = _held(v.divide(c, weight) for c in color)
        return cls(roughness=roughness, metal=weight, F0=shown, F90=shown, compensation=compensation)

    @classmethod
    def conductor(cls, n: Triple, k: Triple, roughness: Value, compensation: Value = 1.0) -> Facets:
        """Return the lobe of the Metallic BSDF with a complex index of refraction n + ik, from its reflectance at 0°
        and 82°.
        """
        n, k = (tuple(v.maximum(c, 0.0) for c in triple) for triple in (n, k))
        pairs = list(zip(n, k, strict=True))
        F0 = _held(_conductor(1.0, *pair) for pair in pairs)
        edge = (6 / 7) ** 5
        F82 = _held(v.divide(_conductor(1 / 7, *pair), f + (1.0 - f) * edge) for f, pair in zip(F0, pairs, strict=True))
        return cls(roughness=roughness, metal=1.0, F0=F0, F82=F82, compensation=compensation)

    @classmethod
    def principled(cls, color: Triple, metallic: Value, roughness: Value, level: Value, ior: Value,
                   tint: Triple = WHITE, compensation: Value = 1.0) -> Facets:
        """Return the lobes of the Principled BSDF without transmission, coat and sheen. The specular level scales the
        reflectance that follows from the index of refraction, and so that index.
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
        """Return the reflection of Glass BSDF."""
        weight = v.largest(color)
        return cls(roughness=roughness, dielectric=weight, ior=ior, tint=tuple(v.divide(c, weight) for c in color),
                   compensation=compensation)

    def coated(self, weight: Value, roughness: Value, ior: Value, tint: Triple) -> Facets:
        """Return these facets below a clear coat."""
        return replace(self, coat=v.clamp(weight), coat_roughness=v.clamp(roughness), coat_ior=v.maximum(ior, 1.0),
                       coat_tint=_held(tint))

    @classmethod
    def fibres(cls, color: Triple, roughness: Value) -> Facets:
        """Return the lobe of the Sheen BSDF: fibres alone."""
        return cls().with_sheen(1.0, roughness, color)

    def with_sheen(self, weight: Value, roughness: Value, tint: Triple) -> Facets:
        """Return these facets below fibres."""
        tint = tuple(v.maximum(c, 0.0) for c in tint)  # type: ignore[assignment]
        most = v.maximum(v.largest(tint), 1.0)  # the engine takes no colour above 1
        return replace(self, sheen=v.maximum(weight, 0.0) * most, sheen_roughness=v.clamp(roughness),
                       sheen_tint=_held(v.divide(c, most) for c in tint))

    def times(self, share: Value) -> Facets:
        """Return the facets with this share of their light."""
        return replace(self, metal=self.metal * share, dielectric=self.dielectric * share, share=self.share * share)

    def fibres_normal(self, normal: Triple, coats: Triple) -> Triple:
        """Return that of the fibres, between the normals of what is below the coat and of the coat, as in Cycles."""
        if v.is_constant(self.coat) and self.coat >= 1:
            return coats
        return v.normalized(tuple(v.mixed(n, c, self.coat) for n, c in zip(normal, coats, strict=True)))  # type: ignore[arg-type]

    def above_alone(self, normal: Triple) -> tuple[Facets, Facets]:
        """Return the coat, as much as is seen below the fibres, and these, with nothing below. normal: that of fibres.
        """
        coat = replace(self, metal=0.0, dielectric=0.0, layered=0.0, sheen=0.0)
        if not (v.is_constant(self.sheen) and self.sheen == 0):
            past, *_ = replace(self, coat=0.0).dims(WHITE, (normal, normal))
            coat = coat.times(past)
        return coat, replace(self, metal=0.0, dielectric=0.0, layered=0.0, coat=0.0)

    def dims(self, color: Triple, normals: tuple[Triple, Triple]) -> Triple:
        """Return what of a colour below the coat and the fibres is seen. normals: of these two."""
        if not self.covers:
            return color
        several = float(FORMULAS.get("coat_several", True))
        coat = (self.coat, self.coat_roughness, v.minimum(self.coat_ior, 1000.0), *self.coat_tint, several)
        sheen = (self.sheen, self.sheen_roughness, *self.sheen_tint)
        if same(*normals):
            over = [(*coat, *sheen, *normals[0])]
        else:  # each by itself, where it is there
            over = [(*coat, 0.0, 0.0, *WHITE, *normals[0]), (0.0, 0.0, 1.5, *WHITE, several, *sheen, *normals[1])]
            over = [one for one, weight in zip(over, (self.coat, self.sheen), strict=True)
                    if not (v.is_constant(weight) and weight == 0)]
        for one in over:
            color = tuple(c * t for c, t in zip(color, v.outputs("covered", 3, *one), strict=True))  # type: ignore[assignment]
        return color

    def coat_reflectance(self) -> Value:
        """Return the reflectance of the coat at normal incidence."""
        return self.coat * squared((self.coat_ior - 1) / (self.coat_ior + 1))

    def above(self) -> Value:
        """Return about how much light the fibres and the coat return."""
        return self.share * (self.sheen + self.coat_reflectance())

    @property
    def covers(self) -> bool:
        """Return whether a coat or fibres lie over what is diffuse."""
        return not (v.is_constant(self.coat, self.sheen) and self.coat == self.sheen == 0)

    @property
    def shines(self) -> bool:
        """Return whether there is any lobe."""
        return self.covers or not (v.is_constant(self.metal, self.dielectric) and self.metal == self.dielectric == 0)

    def fits(self, other: Facets, matt: bool, others_matt: bool) -> bool:
        """Return whether one layer can have exactly the lobes of both. matt: whether there is something diffuse in
        each.
        """
        a, b = self, other
        if (a.covers and (b.shines or others_matt)) or (b.covers and (a.shines or matt)):
            return False
        below = ("layered", "ior", "tint", "roughness", "compensation")  # by which what is diffuse is dimmed
        for one, two, there in ((a, b, others_matt), (b, a, matt)):
            if there and not (v.is_constant(one.layered) and one.layered == 0) and not (
                    two.shines and all(same(getattr(a, name), getattr(b, name)) for name in below)):
                return False
        if not (a.shines and b.shines):
            return True
        names = ["roughness", "compensation"]
        for lobe, own in (("metal", ("F0", "F90", "F82")), ("dielectric", ("ior", "tint"))):
            if not any(v.is_constant(w) and w == 0 for w in (getattr(a, lobe), getattr(b, lobe))):
                names += own
        return all(same(getattr(a, name), getattr(b, name)) for name in names)

    def plus(self, other: Facets, below: tuple[Value, Value], mirrors: tuple[bool, bool]) -> Facets:
        """Return the sum of two; where there can only be one value it is the mean.

        below: how much of what is diffuse is each one's; mirrors: which of them Fresnel's equations of glass are for.
        """
        a, b = self, other
        metals, plates = (a.metal, b.metal), (a.dielectric, b.dielectric)
        shine = tuple(m * v.largest(s.F0) + d * squared((s.ior - 1) / (s.ior + 1))
                      for m, d, s in zip(metals, plates, (a, b), strict=True))
        made = Facets(
            roughness=weighted((a.roughness,), (b.roughness,), *shine)[0],
            metal=metals[0] + metals[1],
            F0=weighted(a.F0, b.F0, *metals), F90=weighted(a.F90, b.F90, *metals), F82=weighted(a.F82, b.F82, *metals),
            dielectric=plates[0] + plates[1],
            ior=weighted((a.ior,), (b.ior,), *plates)[0], tint=weighted(a.tint, b.tint, *plates),
            layered=weighted((a.layered,), (b.layered,), *below)[0],
            compensation=weighted((a.compensation,), (b.compensation,), *shine)[0])
        if a.covers and b.covers:
            return made._covered_by_both(a, b)
        above = b if b.covers else a
        shares = [s.share for s, counts in zip((a, b), mirrors, strict=True) if counts]
        return replace(made, share=above.share if above.covers else sum(shares) if shares else 1.0,
                       **{name: getattr(above, name) for name in ABOVE})

    def _covered_by_both(self, a: Facets, b: Facets) -> Facets:
        """Return these below the means of the coats and fibres of two others."""
        coats, sheens = (a.coat * a.share, b.coat * b.share), (a.sheen * a.share, b.sheen * b.share)
        return replace(
            self, coat=coats[0] + coats[1], coat_tint=weighted(a.coat_tint, b.coat_tint, *coats),
            coat_roughness=weighted((a.coat_roughness,), (b.coat_roughness,), *coats)[0],
            coat_ior=weighted((a.coat_ior,), (b.coat_ior,), *coats)[0],
            sheen=sheens[0] + sheens[1], sheen_tint=weighted(a.sheen_tint, b.sheen_tint, *sheens),
            sheen_roughness=weighted((a.sheen_roughness,), (b.sheen_roughness,), *sheens)[0])

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of the engine's Material; none if there is no lobe."""
        if not self.shines:
            return {}
        return {
            "highlight": 'GGX', "roughness": v.clamp(self.roughness),
            "metal": v.maximum(self.metal, 0.0), "F0": list(self.F0), "F90": list(self.F90), "F82": list(self.F82),
            "dielectric": v.maximum(self.dielectric, 0.0), "dielectric_ior": v.clamp(self.ior, 1e-5, 1000.0),
            "dielectric_tint": list(self.tint), "layered": v.clamp(self.layered),
            "compensation": v.clamp(self.compensation),
            "coat": v.clamp(self.coat), "coat_roughness": self.coat_roughness,
            "coat_ior": v.minimum(self.coat_ior, 1000.0), "coat_tint": list(self.coat_tint),
            **{name: list(n) for name in ("coat_normal", "sheen_normal") if (n := getattr(self, name))},
            "sheen": self.sheen, "sheen_roughness": self.sheen_roughness, "sheen_tint": list(self.sheen_tint),
            "share": v.maximum(self.share, 0.0),
        }


NO_FACETS = Facets()
# What lies over the lobes.
ABOVE = ("coat", "coat_roughness", "coat_ior", "coat_tint", "coat_normal", "sheen", "sheen_roughness", "sheen_tint",
         "sheen_normal")


def same(a: Any, b: Any) -> bool:
    """Return whether two values or colours are the same number, or the same expression."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return all(same(x, y) for x, y in zip(a, b, strict=True))
    return a is b or bool(v.is_constant(a, b) and a == b)


def squared(a: Value) -> Value:
    """Return the value times itself."""
    return a * a


def weighted(a: tuple, b: tuple, weight_a: Value, weight_b: Value) -> Any:
    """Return the weighted mean of two colours or numbers; the first where both weights are 0."""
    for one, nothing in ((a, weight_b), (b, weight_a)):
        if v.is_constant(nothing) and nothing == 0:
            return one
    total = weight_a + weight_b
    counts = v.greater(total, 0.0)
    share_a, share_b = v.divide(weight_a, total), v.divide(weight_b, total)
    return tuple(v.where(counts, x * share_a + y * share_b, x) for x, y in zip(a, b, strict=True))


def _held(color) -> Triple:
    """Return a colour between 0 and 1."""
    return tuple(v.clamp(c) for c in color)  # type: ignore[return-value]


def _conductor(c: float, n: Value, k: Value) -> Value:
    """Return Fresnel's equations of a conductor in air at the cosine c (M. Born, E. Wolf: Principles of optics,
    14.4.1).
    """
    cc, ss = c * c, 1.0 - c * c
    real = n * n - k * k - ss
    both = v.square_root(real * real + 4.0 * (n * n) * (k * k))
    twice = 2.0 * c * v.square_root(0.5 * (both + real))
    sharp = v.divide(both + cc - twice, both + cc + twice)
    flat = v.divide(cc * both + ss * ss - twice * ss, cc * both + ss * ss + twice * ss)
    return 0.5 * sharp * (1.0 + flat)
