"""A surface as shader nodes describe it, and its translation to Whitted's parameters (method §1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from . import values as v
from .facets import NO_FACETS, WHITE, Facets, squared, weighted
from .nodes import constant
from .values import Triple, Value

BLACK: Triple = (0.0, 0.0, 0.0)

# A surface smoother than the first mirrors its surroundings, one rougher than the second does not, between
# them the mirror image fades: the engine's reflections are not blurred, so a rough surface must have none.
MIRROR_ROUGHNESS = (0.1, 0.15)
# Phong's highlights do not become smaller than this (roughness 0.2; those of GGX end at 0.1): a point light in a mirror
# would be a dot that no number of samples finds in every frame.
LARGEST_EXPONENT = 312.0


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

    @classmethod
    def principled(cls, color: Triple, metallic: Value, roughness: Value, specular: Value,
                   ior: Value = 1.5, tint: Triple = WHITE, compensation: Value = 1.0) -> Surface:
        """Principled BSDF: diffuse with a faint white reflection, or a metal's coloured reflection."""
        ior = v.maximum(ior, 1e-5)
        # Fresnel's, at normal incidence; 4 % at 1.5
        f0 = v.minimum(2.0 * v.maximum(specular, 0.0) * squared((ior - 1) / (ior + 1)), 1.0)
        # A metal has no diffuse part; what it does not mirror sharply of the world, ambient light stands for.
        return cls(color=color, kd=1 - metallic, ka=1 - metallic * mirrored(roughness), roughness=roughness,
                   specular=_triple(f0 * t * (1 - metallic) + c * metallic for c, t in zip(color, tint, strict=True)),
                   facets=Facets.principled(color, metallic, roughness, specular, ior, tint, compensation))

    @classmethod
    def diffuse(cls, color: Triple, roughness: Value = 0.0) -> Surface:
        """Diffuse BSDF."""
        return cls(color=color, diffuse_roughness=roughness)

    @classmethod
    def metal(cls, color: Triple, facets: Facets) -> Surface:
        """Glossy and Metallic BSDF: nothing diffuse; color: what is reflected at normal incidence."""
        return cls(color=color, kd=0.0, ka=1 - mirrored(facets.roughness), roughness=facets.roughness, specular=color,
                   facets=facets)

    @classmethod
    def glass(cls, color: Triple, ior: Value, fresnel: bool, facets: Facets = NO_FACETS,
              frosted: Value = 0.0) -> Surface:
        """Glass and Refraction BSDF: nothing diffuse, `color` passes at each crossing."""
        f0 = squared((ior - 1) / (ior + 1)) if fresnel else 0.0
        return cls(color=BLACK, kd=0.0, ka=0.0, specular=(f0,) * 3, roughness=0.0, kt=color, ior=ior, fresnel=fresnel,
                   facets=facets, frosted=frosted)

    @classmethod
    def translucent_of(cls, color: Triple) -> Surface:
        """Translucent BSDF: only the light on the other side."""
        return cls(color=BLACK, kd=0.0, ka=0.0, translucent=color)

    @classmethod
    def transparent(cls, color: Triple) -> Surface:
        """Transparent BSDF: what is behind, in `color`; white is no surface at all."""
        clear = constant(color) and min(color) >= 1
        return cls(color=BLACK, kd=0.0, ka=0.0, kt=BLACK if clear else color, alpha=0.0 if clear else 1.0)

    @classmethod
    def emitting(cls, radiance: Triple) -> Surface:
        """Emission: light, and nothing else."""
        return cls(color=BLACK, kd=0.0, ka=0.0, emission=radiance)

    def plus(self, other: Surface, mine: Value = 1.0, others: Value = 1.0) -> Surface:
        """The weighted sum of two surfaces: Add Shader, and Mix Shader with weights that add up to 1."""
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
        shine_a, shine_b = mine * v.largest(a.specular), others * v.largest(b.specular)
        # Of two colours, each counts as much as it is seen: in diffuse, else in ambient light.
        seen_a, seen_b = mine * a.kd, others * b.kd
        facets = a.facets.plus(b.facets, mine, others, (seen_a, seen_b))
        matt = v.greater(seen_a + seen_b, 0.0)
        seen_a, seen_b = v.where(matt, seen_a, mine * a.ka), v.where(matt, seen_b, others * b.ka)
        through_a, through_b = mine * v.largest(a.kt), others * v.largest(b.kt)
        mostly_a = not v.is_constant(through_a, through_b) or through_a >= through_b
        return Surface(
            color=weighted(a.color, b.color, seen_a, seen_b),
            kd=mine * a.kd + others * b.kd,
            ka=mine * a.ka + others * b.ka,
            specular=added(scaled(a.specular, mine), scaled(b.specular, others)),
            roughness=weighted((a.roughness,), (b.roughness,), shine_a, shine_b)[0],
            emission=added(scaled(a.emission, mine), scaled(b.emission, others)),
            kt=added(scaled(a.kt, mine), scaled(b.kt, others)),
            ior=weighted((a.ior,), (b.ior,), through_a, through_b)[0],
            diffuse_roughness=weighted((a.diffuse_roughness,), (b.diffuse_roughness,), seen_a, seen_b)[0],
            translucent=added(scaled(a.translucent, mine), scaled(b.translucent, others)),
            frosted=weighted((a.frosted,), (b.frosted,), through_a, through_b)[0],
            fresnel=a.fresnel if mostly_a else b.fresnel,
            alpha=alpha,
            normal=_bent(a, b, v.largest((seen_a, shine_a, through_a)), v.largest((seen_b, shine_b, through_b))),
            facets=facets,
        )

    def whitted(self) -> dict[str, Any]:
        """Whitted's parameters of the engine's Material, each a value or, of colours, a list of three.

        Highlights: GGX of width α = roughness² has the Blinn exponent 2/α² − 2, and a Phong exponent is a quarter
        of Blinn's, as R turns twice as fast as the half vector. The lobe (R·V)ⁿ·(n+2)/2π reflects all light at
        normal incidence; 1/π is in the light's intensity already, so ks = (n+2)/2 times the reflectance.
        """
        rough = v.maximum(self.roughness, 1e-3)
        fourth = rough ** 4 if v.is_constant(rough) else (rough * rough) * (rough * rough)
        n = v.minimum(v.maximum((2 / fourth - 2) / 4, 1.0), LARGEST_EXPONENT)
        coat = self.facets.coat_reflectance() * mirrored(self.facets.coat_roughness)
        shine = v.largest(self.specular)
        shines = v.greater(shine, 0.0)
        return {
            "ka": self.ka, "kd": self.kd, "Od": list(self.color),
            "ks": shine * (n + 2) / 2,
            "Os": [v.where(shines, c * v.divide(1.0, shine), 1.0) for c in self.specular],
            "nShiny": n,
            "mirror": list(_triple(c * mirrored(self.roughness) + coat for c in self.specular)),
            "emission": list(self.emission),
            "kt": list(self.kt), "ior": self.ior, "fresnel": self.fresnel, "alpha": self.alpha,
        } | ({"normal": list(self.normal)} if self.normal else {})


def mirrored(roughness: Value) -> Value:
    """Which share of the specular reflection is a sharp mirror image."""
    low, high = MIRROR_ROUGHNESS
    return v.clamp((high - roughness) / (high - low))


def scaled(color: Triple, factor: Value) -> Triple:
    """`color` times `factor`."""
    return _triple(c * factor for c in color)


def added(a: Triple, b: Triple) -> Triple:
    """The sum of two colours."""
    return _triple(x + y for x, y in zip(a, b, strict=True))


def _triple(numbers) -> Triple:
    return tuple(numbers)  # type: ignore[return-value]


def _bent(a: Surface, b: Surface, weight_a: Value, weight_b: Value) -> Triple | None:
    """The normal of two surfaces together: one, as the engine has no more, each as much as it is seen."""
    if a.normal is b.normal or (a.normal and b.normal and all(x is y for x, y in zip(a.normal, b.normal, strict=True))):
        return a.normal
    if v.is_constant(weight_b) and weight_b == 0:
        return a.normal
    if v.is_constant(weight_a) and weight_a == 0:
        return b.normal
    own: Triple = v.outputs("normal", 3)  # type: ignore[assignment]
    return v.normalized(weighted(a.normal or own, b.normal or own, weight_a, weight_b))
