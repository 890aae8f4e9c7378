"""A surface as shader nodes describe it, and its translation to Whitted's parameters (method §1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

RGB = tuple[float, ...]  # three of them
BLACK: RGB = (0.0, 0.0, 0.0)

# A surface smoother than the first value mirrors its surroundings, one rougher than the second does not; between them
# the mirror image fades. The engine cannot blur reflections, so a rough surface must have none.
MIRROR_ROUGHNESS = (0.1, 0.15)
# Highlights are not made smaller than this (roughness 0.2). The mirror image of a point light would be a dot that no
# number of samples finds in every frame.
LARGEST_EXPONENT = 312.0


@dataclass(frozen=True)
class Surface:
    """The diffuse and the specular part of a surface, and its emission, transparency and images."""

    color: RGB = (0.8, 0.8, 0.8)  # of the diffuse part
    kd: float = 1.0
    ka: float = 1.0  # share of the world's light that is reflected diffusely, in `color`
    specular: RGB = BLACK  # reflectance at normal incidence
    roughness: float = 1.0  # of the specular part
    emission: RGB = BLACK  # radiance
    image: Any = None  # an image texture node that replaces `color`
    uv_map: str = ""  # the UV map of the image; empty means the mesh's default
    kt: RGB = BLACK  # the factor for light at each crossing
    ior: float = 1.0
    fresnel: bool = False  # whether it reflects and transmits by Fresnel's equations
    alpha: float = 1.0  # the share of the surface that is there
    alpha_image: Any = None  # an image texture node whose alpha is multiplied with `alpha`

    @classmethod
    def principled(cls, color: RGB, metallic: float, roughness: float, specular: float, ior: float = 1.5) -> Surface:
        """Principled BSDF: diffuse with a faint white reflection, or the coloured reflection of a metal."""
        ior = max(ior, 1e-5)
        # Fresnel reflectance at normal incidence; 4 % for an IOR of 1.5
        f0 = 0.08 * specular * ((ior - 1) / (ior + 1) / 0.2) ** 2
        # A metal has no diffuse part. Ambient light replaces the part of the world that it does not mirror sharply.
        return cls(color=color, kd=1 - metallic, ka=1 - metallic * mirrored(roughness), roughness=roughness,
                   specular=tuple(f0 * (1 - metallic) + c * metallic for c in color))

    @classmethod
    def diffuse(cls, color: RGB) -> Surface:
        """Diffuse BSDF."""
        return cls(color=color)

    @classmethod
    def glossy(cls, color: RGB, roughness: float) -> Surface:
        """Glossy BSDF, which is treated as a metal."""
        return cls.principled(color, 1.0, roughness, 0.0)

    @classmethod
    def glass(cls, color: RGB, ior: float, fresnel: bool) -> Surface:
        """Glass and Refraction BSDF: no diffuse part; each crossing multiplies the light by `color`."""
        f0 = ((ior - 1) / (ior + 1)) ** 2 if fresnel else 0.0
        return cls(color=BLACK, kd=0.0, ka=0.0, specular=(f0,) * 3, roughness=0.0, kt=color, ior=ior, fresnel=fresnel)

    @classmethod
    def transparent(cls, color: RGB) -> Surface:
        """Transparent BSDF: shows what is behind, multiplied by `color`. White means no surface at all."""
        clear = min(color) >= 1
        return cls(color=BLACK, kd=0.0, ka=0.0, kt=BLACK if clear else color, alpha=0.0 if clear else 1.0)

    @classmethod
    def emitting(cls, radiance: RGB) -> Surface:
        """Emission only."""
        return cls(color=BLACK, kd=0.0, ka=0.0, emission=radiance)

    def plus(self, other: Surface, mine: float = 1.0, others: float = 1.0) -> Surface:
        """Return the weighted sum of two surfaces. It is used for Add Shader, and for Mix Shader with weights that add
        up to 1.
        """
        a, b = self, other
        # All parameters but alpha describe the part of the surface that is there.
        alpha = min(mine * a.alpha + others * b.alpha, 1.0)
        mine, others = (w * s.alpha / alpha if alpha > 0 else w for w, s in ((mine, a), (others, b)))
        shine_a, shine_b = mine * max(a.specular), others * max(b.specular)
        # Weight each of the two colours by its share of the diffuse light, or of the ambient light if there is no
        # diffuse part.
        seen_a, seen_b = mine * a.kd, others * b.kd
        if seen_a + seen_b == 0:
            seen_a, seen_b = mine * a.ka, others * b.ka
        imaged = a if a.image else b
        return Surface(
            color=_weighted(a.color, b.color, seen_a, seen_b),
            kd=mine * a.kd + others * b.kd,
            ka=mine * a.ka + others * b.ka,
            specular=added(scaled(a.specular, mine), scaled(b.specular, others)),
            roughness=_weighted((a.roughness,), (b.roughness,), shine_a, shine_b)[0],
            emission=added(scaled(a.emission, mine), scaled(b.emission, others)),
            image=imaged.image, uv_map=imaged.uv_map or a.uv_map or b.uv_map,
            kt=added(scaled(a.kt, mine), scaled(b.kt, others)),
            ior=_weighted((a.ior,), (b.ior,), mine * max(a.kt), others * max(b.kt))[0],
            fresnel=a.fresnel if mine * max(a.kt) >= others * max(b.kt) else b.fresnel,
            alpha=alpha, alpha_image=a.alpha_image or b.alpha_image,
        )

    def whitted(self) -> dict:
        """Return Whitted's parameters for the engine's Material.

        Highlights: GGX of width α = roughness² corresponds to the Blinn exponent 2/α² − 2. A Phong exponent is a
        quarter of Blinn's, because R turns twice as fast as the half vector. The lobe (R·V)ⁿ·(n+2)/2π reflects all
        light at normal incidence. The light's intensity already contains 1/π, so ks = (n+2)/2 times the reflectance.
        """
        n = min(max((2 / max(self.roughness, 1e-3) ** 4 - 2) / 4, 1.0), LARGEST_EXPONENT)
        shine = max(self.specular)
        return {
            "ka": self.ka, "kd": self.kd, "Od": list(self.color),
            "ks": shine * (n + 2) / 2, "Os": list(scaled(self.specular, 1 / shine)) if shine > 0 else [1.0, 1.0, 1.0],
            "nShiny": n,
            "mirror": list(scaled(self.specular, mirrored(self.roughness))),
            "emission": list(self.emission),
            "kt": list(self.kt), "ior": self.ior, "fresnel": self.fresnel, "alpha": self.alpha,
        }


def mirrored(roughness: float) -> float:
    """Return the share of the specular reflection that is a sharp mirror image."""
    low, high = MIRROR_ROUGHNESS
    return min(max((high - roughness) / (high - low), 0.0), 1.0)


def scaled(color: RGB, factor: float) -> RGB:
    """`color` times `factor`."""
    return tuple(c * factor for c in color)


def added(a: RGB, b: RGB) -> RGB:
    """The sum of two colours."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _weighted(a: tuple, b: tuple, weight_a: float, weight_b: float) -> tuple:
    total = weight_a + weight_b
    return added(scaled(a, weight_a / total), scaled(b, weight_b / total)) if total > 0 else a
