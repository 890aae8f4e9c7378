"""A surface as shader nodes describe it, and its translation to Whitted's parameters (method §1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from . import values as v
from .facets import NO_FACETS, WHITE, Facets, same, squared, weighted
from .nodes import constant
from .values import Triple, Value

BLACK: Triple = (0.0, 0.0, 0.0)

# A surface smoother than the first mirrors its surroundings, one rougher than the second does not, between
# them the mirror image fades: the engine's reflections are not blurred, so a rough surface must have none.
MIRROR_ROUGHNESS = (0.1, 0.15)
# Phong's highlights do not become smaller than this (roughness 0.2; those of GGX end at 0.1): a point light in a mirror
# would be a dot that no number of samples finds in every frame.
LARGEST_EXPONENT = 312.0
LAYERS = 7  # that a material may have beside the first; what is more goes into the last


@dataclass(frozen=True)
class Surface:
    """The diffuse and the specular part of a surface, and what else a shader adds.

    Each value is a number, or an expression where a texture says it (see `values`).
    """

    color: Triple = (0.8, 0.8, 0.8)  # of the diffuse part
    kd: Value = 1.0
    ka: Value = 1.0  # share of the world's light that comes back unmirrored, in `color`
    specular: Triple = BLACK  # reflectance at normal incidence
    roughness: Value = 1.0  # of the specular part
    emission: Triple = BLACK  # radiance
    kt: Triple = BLACK  # what passes at each crossing
    ior: Value = 1.0
    diffuse_roughness: Value = 0.0
    translucent: Triple = BLACK  # share of the light on the other side that comes through, scattered
    frosted: Value = 0.0  # roughness of what lets light through
    fresnel: bool = False  # reflects and passes by Fresnel's equations
    alpha: Value = 1.0  # share of the surface that is there
    normal: Triple | None = None  # for shading; None: the surface's own
    facets: Facets = NO_FACETS  # the highlights of lamps
    layers: tuple[Surface, ...] = ()  # what else reflects light there; of these only that counts

    @classmethod
    def principled(cls, color: Triple, metallic: Value, roughness: Value, specular: Value,
                   ior: Value = 1.5, tint: Triple = WHITE, compensation: Value = 1.0) -> Surface:
        """Return the Principled BSDF: diffuse with a faint white reflection, or a metal's coloured reflection."""
        ior = v.maximum(ior, 1e-5)
        # Fresnel's, at normal incidence; 4 % at 1.5
        f0 = v.minimum(2.0 * v.maximum(specular, 0.0) * squared((ior - 1) / (ior + 1)), 1.0)
        # A metal has no diffuse part; what it does not mirror sharply of the world, ambient light stands for.
        return cls(color=color, kd=1 - metallic, ka=1 - metallic * mirrored(roughness), roughness=roughness,
                   specular=_triple(f0 * t * (1 - metallic) + c * metallic for c, t in zip(color, tint, strict=True)),
                   facets=Facets.principled(color, metallic, roughness, specular, ior, tint, compensation))

    @classmethod
    def diffuse(cls, color: Triple, roughness: Value = 0.0) -> Surface:
        """Return the Diffuse BSDF."""
        return cls(color=color, diffuse_roughness=roughness)

    @classmethod
    def metal(cls, color: Triple, facets: Facets) -> Surface:
        """Return the Glossy or Metallic BSDF: nothing diffuse. color: the reflectance at normal incidence."""
        return cls(color=color, kd=0.0, ka=1 - mirrored(facets.roughness), roughness=facets.roughness, specular=color,
                   facets=facets)

    @classmethod
    def glass(cls, color: Triple, ior: Value, fresnel: bool, facets: Facets = NO_FACETS,
              frosted: Value = 0.0) -> Surface:
        """Return the Glass or Refraction BSDF: nothing diffuse; the share `color` passes at each crossing."""
        f0 = squared((ior - 1) / (ior + 1)) if fresnel else 0.0
        return cls(color=BLACK, kd=0.0, ka=0.0, specular=(f0,) * 3, roughness=0.0, kt=color, ior=ior, fresnel=fresnel,
                   facets=facets, frosted=frosted)

    @classmethod
    def translucent_of(cls, color: Triple) -> Surface:
        """Return the Translucent BSDF: only light that arrives on the other side counts."""
        return cls(color=BLACK, kd=0.0, ka=0.0, translucent=color)

    @classmethod
    def transparent(cls, color: Triple) -> Surface:
        """Return the Transparent BSDF: it shows what is behind, multiplied by `color`; with white there is no surface
        at all.
        """
        clear = constant(color) and min(color) >= 1
        return cls(color=BLACK, kd=0.0, ka=0.0, kt=BLACK if clear else color, alpha=0.0 if clear else 1.0)

    @classmethod
    def emitting(cls, radiance: Triple) -> Surface:
        """Return the Emission shader: light, and nothing else."""
        return cls(color=BLACK, kd=0.0, ka=0.0, emission=radiance)

    def plus(self, other: Surface, mine: Value = 1.0, others: Value = 1.0) -> Surface:
        """Return the weighted sum of two surfaces: Add Shader, and Mix Shader with weights that add up to 1.

        What does not fit into one becomes a further layer.
        """
        a, b = self, other
        # Beside what is not there the other is as it was, and less of it is there.
        for nothing, there, weight in ((a, b, others), (b, a, mine)):
            if v.is_constant(nothing.alpha) and nothing.alpha == 0:
                return replace(there, alpha=v.minimum(there.alpha * weight, 1.0) if v.is_constant(there.alpha, weight)
                               else there.alpha * weight)
        # All but alpha is said of the part that is there.
        alpha = v.minimum(mine * a.alpha + others * b.alpha, 1.0)
        there = v.greater(alpha, 0.0)
        mine, others = (v.where(there, v.divide(w * s.alpha, alpha), w) for w, s in ((mine, a), (others, b)))
        parts = [part for s, w in ((a, mine), (b, others)) for part in s.times(w).parts()]
        kept: list[Surface] = []
        for part in sorted(parts, key=lambda s: not s.fresnel):  # glass is the first layer
            place = next((n for n, s in enumerate(kept) if s.fits(part)), min(len(kept), LAYERS))
            kept[place:] = [kept[place].joined(part) if place < len(kept) else part, *kept[place + 1:]]
        first, *layers = kept
        for layer in layers:
            first = first.joined(replace(NOTHING, kt=layer.kt, ior=layer.ior, frosted=layer.frosted,
                                         emission=layer.emission))
        return replace(first, alpha=alpha, layers=tuple(replace(layer, kt=BLACK, emission=BLACK) for layer in layers))

    def under_smooth_coat(self, normal: Triple | None, coats: Triple | None) -> Surface:
        """Return the surface with its coat as a layer of its own, if the coat's normal differs from that of the surface
        below.
        """
        if same(normal, coats):
            return replace(self, facets=replace(self.facets, coat_normal=coats))  # which dims by it, too
        own: Triple = v.outputs("normal", 3)  # type: ignore[assignment]
        over, between = coats or own, self.facets.fibres_normal(normal or own, coats or own)
        coat, fibres = self.facets.above_alone(between)
        further = [replace(NOTHING, normal=coats, facets=coat)]
        if not _zero(fibres.sheen):
            further.append(replace(NOTHING, normal=between, facets=fibres))
        # Below them both dim, but have no light of their own.
        return replace(self, facets=replace(self.facets, share=0.0, coat_normal=over, sheen_normal=between),
                       layers=(*self.layers, *further))

    def times(self, share: Value) -> Surface:
        """Return this surface with this share of its light."""
        if v.is_constant(share) and share == 1:
            return self
        return replace(
            self, kd=self.kd * share, ka=self.ka * share, specular=scaled(self.specular, share),
            emission=scaled(self.emission, share), kt=scaled(self.kt, share), facets=self.facets.times(share),
            translucent=scaled(self.translucent, share), layers=tuple(layer.times(share) for layer in self.layers))

    def parts(self) -> tuple[Surface, ...]:
        """Return the layers, each as a surface, the first one first."""
        return (replace(self, layers=(), alpha=1.0), *self.layers)

    @property
    def reflects(self) -> bool:
        """Return whether it reflects any light."""
        return self.facets.shines or not _zero(self.kd, *self.specular)

    @property
    def is_flat(self) -> bool:
        """Return whether a normal makes no difference to it."""
        return not self.reflects and _zero(*self.translucent) and v.is_constant(self.ior) and self.ior == 1

    def fits(self, other: Surface) -> bool:
        """Return whether one layer can be exactly both of these."""
        a, b = self, other
        if not (a.is_flat or b.is_flat or same(a.normal, b.normal)):
            return False
        if not (a.reflects and b.reflects):
            return True
        if a.fresnel or b.fresnel:
            return a.fresnel and b.fresnel
        matt = not _zero(a.kd), not _zero(b.kd)
        rough = all(matt) and not _zero(a.diffuse_roughness, b.diffuse_roughness)
        return (a.facets.fits(b.facets, *matt)
                and not (all(matt) and not same(a.diffuse_roughness, b.diffuse_roughness))
                and not (rough and not same(a.color, b.color)))

    def joined(self, other: Surface) -> Surface:
        """Return both surfaces in one layer; a value of which there can only be one is the mean."""
        a, b = self, other
        shine_a, shine_b = v.largest(a.specular), v.largest(b.specular)
        # Of two colours, each counts as much as it is seen: in diffuse, else in ambient light.
        facets = a.facets.plus(b.facets, (a.kd, b.kd), (a.fresnel, b.fresnel))
        matt = v.greater(a.kd + b.kd, 0.0)
        seen_a, seen_b = v.where(matt, a.kd, a.ka), v.where(matt, b.kd, b.ka)
        through_a, through_b = v.largest(a.kt), v.largest(b.kt)
        mostly_a = not v.is_constant(through_a, through_b) or through_a >= through_b
        return Surface(
            color=weighted(a.color, b.color, seen_a, seen_b),
            kd=a.kd + b.kd,
            ka=a.ka + b.ka,
            specular=added(a.specular, b.specular),
            roughness=weighted((a.roughness,), (b.roughness,), shine_a, shine_b)[0],
            emission=added(a.emission, b.emission),
            kt=added(a.kt, b.kt),
            ior=weighted((a.ior,), (b.ior,), through_a, through_b)[0],
            diffuse_roughness=weighted((a.diffuse_roughness,), (b.diffuse_roughness,), seen_a, seen_b)[0],
            translucent=added(a.translucent, b.translucent),
            frosted=weighted((a.frosted,), (b.frosted,), through_a, through_b)[0],
            fresnel=a.fresnel if mostly_a else b.fresnel,
            normal=_bent(a, b, v.largest((seen_a, shine_a, through_a, *a.translucent, a.facets.above())),
                         v.largest((seen_b, shine_b, through_b, *b.translucent, b.facets.above()))),
            facets=facets,
        )

    def merged(self) -> Surface:
        """Return all layers in one, with means where they differ."""
        found = replace(self, layers=())
        for layer in self.layers:
            found = found.joined(layer)
        return replace(found, alpha=self.alpha)

    def whitted(self, phong: bool = True) -> dict[str, Any]:
        """Whitted's parameters of the engine's Material, each a value or, of colours, a list of three. phong: whether
        those of Phong's highlights are needed where they are no numbers; else any expressions stand for them.

        Highlights: GGX of width α = roughness² has the Blinn exponent 2/α² − 2, and a Phong exponent is a quarter
        of Blinn's, as R turns twice as fast as the half vector. The lobe (R·V)ⁿ·(n+2)/2π reflects all light at
        normal incidence; 1/π is in the light's intensity already, so ks = (n+2)/2 times the reflectance. Layers have
        means in them.
        """
        if self.layers:
            return self.merged().whitted(phong)
        coat = self.facets.coat_reflectance() * mirrored(self.facets.coat_roughness)
        ks, Os, n = self._phong(phong)
        return {
            "ka": self.ka, "kd": self.kd, "Od": list(self.color), "ks": ks, "Os": Os, "nShiny": n,
            "mirror": list(_triple(c * mirrored(self.roughness) + coat for c in self.specular)),
            "emission": list(self.emission),
            "kt": list(self.kt), "ior": self.ior, "fresnel": self.fresnel, "alpha": self.alpha,
        } | ({"normal": list(self.normal)} if self.normal else {})

    def _phong(self, needed: bool) -> tuple[Value, list[Value], Value]:
        """Return ks, Os and nShiny; for those that are no numbers, if they are not needed, what they depend on."""
        n, Os, shine = self.roughness, list(self.specular), v.largest(self.specular)
        if needed or v.is_constant(n):
            rough = v.maximum(n, 1e-3)
            fourth = rough ** 4 if v.is_constant(rough) else (rough * rough) * (rough * rough)
            n = v.minimum(v.maximum((2 / fourth - 2) / 4, 1.0), LARGEST_EXPONENT)
        if needed or v.is_constant(*Os):
            shines = v.greater(shine, 0.0)
            Os = [v.where(shines, c * v.divide(1.0, shine), 1.0) for c in self.specular]
        varies = next((x for x in (n, shine) if not v.is_constant(x)), None)
        return shine * (n + 2) / 2 if needed or varies is None else varies, Os, n


NOTHING = Surface(color=BLACK, kd=0.0, ka=0.0)


def mirrored(roughness: Value) -> Value:
    """Return the share of the specular reflection that is a sharp mirror image."""
    low, high = MIRROR_ROUGHNESS
    return v.clamp((high - roughness) / (high - low))


def scaled(color: Triple, factor: Value) -> Triple:
    """Return `color` times `factor`."""
    return _triple(c * factor for c in color)


def added(a: Triple, b: Triple) -> Triple:
    """Return the sum of two colours."""
    return _triple(x + y for x, y in zip(a, b, strict=True))


def _triple(numbers) -> Triple:
    return tuple(numbers)  # type: ignore[return-value]


def _bent(a: Surface, b: Surface, weight_a: Value, weight_b: Value) -> Triple | None:
    """Return the normal of two surfaces together: one, as the engine has no more, each as much as it is seen."""
    if same(a.normal, b.normal) or b.is_flat:
        return a.normal
    if a.is_flat:
        return b.normal
    if v.is_constant(weight_b) and weight_b == 0:
        return a.normal
    if v.is_constant(weight_a) and weight_a == 0:
        return b.normal
    own: Triple = v.outputs("normal", 3)  # type: ignore[assignment]
    return v.normalized(weighted(a.normal or own, b.normal or own, weight_a, weight_b))


def _zero(*values: Value) -> bool:
    """Return whether all of these are the number 0."""
    return v.is_constant(*values) and not any(values)
