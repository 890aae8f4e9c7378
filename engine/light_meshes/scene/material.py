"""The description of a material, with its units."""

from __future__ import annotations

from dataclasses import dataclass

from .programs import NO_PROGRAM, Program

HIGHLIGHTS = ("PHONG", "GGX")
RGB = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """Whitted's parameters (method §1): Ω = f_att·I·[kd·Od·(N·L) + ks·Os·(R·V)^nShiny].

    With the highlight GGX the second term is that of microfacets (method §1), and ks, Os and nShiny only say about
    how large and bright it is. A metal's lobe and a dielectric's are added. Both have one roughness; highlights are not
    smaller than those of roughness 0.1, or a lamp in a smooth surface would be a dot that few rays find.
    """

    name: str
    Od: RGB = (0.8, 0.8, 0.8)
    ka: float = 1.0
    kd: float = 1.0
    ks: float = 0.0
    Os: RGB = (1.0, 1.0, 1.0)
    nShiny: float = 50.0
    mirror: RGB = (0.0, 0.0, 0.0)  # ks of the recursive term, coloured; 0 for a surface with only highlights
    emission: RGB = (0.0, 0.0, 0.0)  # radiance
    kt: RGB = (0.0, 0.0, 0.0)  # kt·Ot: the factor for light at each crossing
    ior: float = 1.0  # acts only at closed meshes; an open sheet does not bend rays
    priority: int = 0  # where media overlap, the one with the highest priority counts
    fresnel: bool = False  # compute mirror and kt from Fresnel's equations
    translucent: RGB = (0.0, 0.0, 0.0)  # share of the light on the other side that comes through, scattered
    frosted: float = 0.0  # roughness of glass: how much what it mirrors and what passes is blurred
    alpha: float = 1.0  # the share of the surface that is there; the rest is a hole that neither bends nor shades
    alpha_image: int = -1  # index of the image whose alpha channel multiplies alpha; -1: none
    transparent_shadow: bool = True  # False: casts the shadow of an opaque surface
    image: int = -1  # index of the image that replaces Od; -1: none
    cast_soft_shadows: bool = True  # False: the shadows that it casts are sharp (method §4b)
    receive_soft_shadows: bool = True  # False: the shadows that fall on it are sharp (method §4c)
    index: int = 0  # the artist's number for the Material Index pass
    cryptomatte: int = 0  # the number of its name for Cryptomatte
    program: Program = NO_PROGRAM  # computes some of all these values point by point, from the material's nodes
    highlight: str = "PHONG"  # or GGX, for which all that follows is
    blurred: bool = False  # its lobes show what is around, more or less sharp; `mirror` does not count then
    roughness: float = 0.5  # α is its square
    metal: float = 0.0  # weight of the metal's lobe, and what it reflects
    F0: RGB = (1.0, 1.0, 1.0)  # at normal incidence,
    F90: RGB = (1.0, 1.0, 1.0)  # at a grazing angle,
    F82: RGB = (1.0, 1.0, 1.0)  # and at 82°, as a share of what Schlick's formula has there
    dielectric: float = 0.0  # weight of the dielectric's lobe,
    dielectric_ior: float = 1.5  # whose index of refraction is apart from that of glass,
    dielectric_tint: RGB = (1.0, 1.0, 1.0)  # and what colours it at normal incidence
    layered: float = 0.0  # share of the diffuse light that is below the dielectric, and dimmed by what that reflects
    compensation: float = 1.0  # share of the light that microfacets reflect several times which counts
    diffuse_roughness: float = 0.0  # of the diffuse part; also without GGX
    coat: float = 0.0  # weight of a clear coat, which has a lobe of its own and dims all below but emission
    coat_roughness: float = 0.0
    coat_ior: float = 1.5
    coat_tint: RGB = (1.0, 1.0, 1.0)  # of what passes it straight
    sheen: float = 0.0  # weight of a layer of fibres over all that, also the coat, which dims what is below
    sheen_roughness: float = 0.3
    sheen_tint: RGB = (1.0, 1.0, 1.0)
    # Formulas of which releases of Cycles have different ones: with False, those of before 4.3, 4.5 and 4.5.
    matt_several: bool = True  # light counts that a rough diffuse part scatters several times
    coat_several: bool = True  # light counts that a coat's microfacets reflect several times, and it dims more
    facet_bumps: bool = True  # scattered light is softened over bumps as facets would; else by its angle alone
    layers: tuple[Material, ...] = ()  # what else reflects light there; of these only that counts, and no program
    # Of the light of coat and sheen themselves, and of what is mirrored by Fresnel's equations, which counts; the other
    # weights have it in them.
    share: float = 1.0

    @property
    def emits(self) -> bool:
        """Return whether the surface gives light of its own, at least where its program says so."""
        return any(self.emission) or "emission" in self.program.values


DEFAULT_MATERIAL = Material("default")
