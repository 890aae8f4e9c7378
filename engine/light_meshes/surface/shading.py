"""Ω(i,P), the local illumination by light i without visibility (method §1), and the sums over lights."""

from __future__ import annotations

import threading
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lights import registry
from ..rays.geometry import Hits
from ..rays.tracer import Targets
from ..scene.description import Light, Material, Scene
from ..support.native import kernel
from . import sized

_DIRECTIONAL = [registry.NAMES.index(name) for name, kind in registry.KINDS.items() if kind.directional]
_reaching, _gather, _steps = kernel("shading_reaching"), kernel("shading_gather"), kernel("shading_steps")
_each = kernel("shading_each")
_reflecting = kernel("shading_reflecting")
_unlit, unlink, mirrored = kernel("shading_unlit"), kernel("shading_unlink"), kernel("shading_mirrored")
_tables, _dim = kernel("ggx_tables"), kernel("ggx_dim")
_last = threading.local()  # the two tables of materials that each thread's kernels were given last
LEAST_SIGHT = 1e-3  # the same there
SMOOTHEST = 0.1  # as in ggx.h: highlights of lamps are not smaller than those of this roughness
TABLES = 32 * 32 + 32 + 16**3  # numbers of the tables in ggx.h


class Lights(NamedTuple):
    """All lights as arrays; see scene.Light for the units."""

    type: NDArray[np.int8]  # (L,) index into `lights.registry.NAMES`, or `sized.kind` of a lamp with a size
    position: NDArray[np.float64]  # (L,3)
    direction: NDArray[np.float64]  # (L,3) unit, the way the light travels
    intensity: NDArray[np.float64]  # (L,3)
    edge: NDArray[np.float64]  # (L,) the first of the type's `numbers`
    slope: NDArray[np.float64]  # (L,) the second
    axes: NDArray[np.float64]  # (L,3,3) SKEWED_…: scene.Light.axes
    extent: NDArray[np.float64]  # (L,8) `sized.extents`
    diffuse: NDArray[np.bool_]  # (L,)
    glossy: NDArray[np.bool_]  # (L,)

    def targets(self) -> Targets:
        """Return the targets of shadow rays."""
        sun = np.isin(self.type, [*_DIRECTIONAL, sized.SKY])
        return Targets(np.where(sun[:, None], -self.direction, self.position), sun)


def light_arrays(lights: tuple[Light, ...]) -> Lights:
    """Return the scene's lights as arrays."""
    numbers = np.array([registry.KINDS[light.type].numbers(light) for light in lights], np.float64).reshape(-1, 2)
    edge, slope = np.ascontiguousarray(numbers.T)
    direction = np.array([light.direction for light in lights], np.float64).reshape(-1, 3)
    length = np.sqrt((direction**2).sum(1, keepdims=True))
    return Lights(
        np.array([_kind(light) for light in lights], np.int8),
        np.array([light.position for light in lights], np.float64).reshape(-1, 3),
        direction / np.where(length > 0, length, 1),
        np.array([light.intensity for light in lights], np.float64).reshape(-1, 3),
        edge, slope, np.array([light.axes or np.zeros((3, 3)) for light in lights], np.float64).reshape(-1, 3, 3),
        sized.extents(lights),
        np.array([light.diffuse for light in lights], np.bool_), np.array([light.glossy for light in lights], np.bool_),
    )


def _kind(light: Light) -> int:
    """Return the light's number in `Lights.type`."""
    own = sized.kind(light)
    return registry.number(light) if own is None else own


class Materials(NamedTuple):
    """All materials as arrays; see scene.Material."""

    Od: NDArray[np.float64]  # (M,3)
    ka: NDArray[np.float64]  # (M,)
    kd: NDArray[np.float64]
    ks: NDArray[np.float64]
    Os: NDArray[np.float64]  # (M,3)
    nShiny: NDArray[np.float64]
    mirror: NDArray[np.float64]  # (M,3)
    emission: NDArray[np.float64]  # (M,3)
    image: NDArray[np.int32]
    kt: NDArray[np.float64]  # (M,3)
    ior: NDArray[np.float64]
    fresnel: NDArray[np.bool_]
    translucent: NDArray[np.float64]  # (M,3)
    frosted: NDArray[np.float64]
    alpha: NDArray[np.float64]
    alpha_image: NDArray[np.int32]
    also: NDArray[np.int32]  # the row of the next layer; −1: there is none (`layers`)
    bent: NDArray[np.float64]  # (M,3) of a layer: its normal; NaN: the surface's own
    blurred: NDArray[np.bool_]  # lobes of microfacets show what is around
    # Lobes that were widened, but show lamps themselves, as mirrors do: 1 the one below a coat, 2 the coat's, 3 both.
    mirroring: NDArray[np.int8]
    ggx: NDArray[np.bool_]  # highlights of microfacets, by all that follows
    roughness: NDArray[np.float64]
    metal: NDArray[np.float64]
    F0: NDArray[np.float64]  # (M,3)
    F90: NDArray[np.float64]  # (M,3)
    F82: NDArray[np.float64]  # (M,3)
    dielectric: NDArray[np.float64]
    dielectric_ior: NDArray[np.float64]
    dielectric_tint: NDArray[np.float64]  # (M,3)
    layered: NDArray[np.float64]
    compensation: NDArray[np.float64]
    coat: NDArray[np.float64]
    coat_roughness: NDArray[np.float64]
    coat_ior: NDArray[np.float64]
    coat_tint: NDArray[np.float64]  # (M,3)
    diffuse_roughness: NDArray[np.float64]
    share: NDArray[np.float64]
    sheen: NDArray[np.float64]
    sheen_roughness: NDArray[np.float64]
    sheen_tint: NDArray[np.float64]  # (M,3)
    # The cosines of the eye to the normals of a coat and of fibres that programs bend; 0: they do not.
    on_coat: NDArray[np.float64]
    on_sheen: NDArray[np.float64]
    # Formulas, of which releases of Cycles have different ones.
    matt_several: NDArray[np.bool_]
    coat_several: NDArray[np.bool_]
    facet_bumps: NDArray[np.bool_]

    def facets(self) -> tuple[NDArray[np.float64], NDArray[np.float64]] | tuple[None, None]:
        """Return what the kernels want to know of GGX, a row (37,) a material, and its tables; (None, None): none has
        it.
        """
        kept: list[tuple[Materials, tuple]] = getattr(_last, "tables", [])  # a table serves many kernels
        for table, found in kept:
            if table is self:
                return found
        some = self.ggx.any() or self.diffuse_roughness.any() or not self.facet_bumps.all()
        found = (np.column_stack(self[20:]), _facet_tables()) if some else (None, None)
        _last.tables = [(self, found), *kept[:1]]
        return found

    def behind(self) -> Materials:
        """Return the surfaces as light sees them that comes through them, scattered: matt surfaces on their other side.
        """
        none, black = np.zeros_like(self.kd), np.zeros_like(self.Od)
        return self._replace(Od=self.translucent, ka=np.ones_like(none), kd=np.ones_like(none), ks=none, emission=black,
                             image=np.full_like(self.image, -1), also=np.full_like(self.also, -1),
                             ggx=np.zeros_like(self.ggx), diffuse_roughness=none)

    @property
    def taken(self) -> tuple[NDArray | None, ...]:
        """Return the arguments for the kernels in `shading.c` that say what materials are, in their order."""
        return self.kd, self.ks, self.Os, self.nShiny, *self.facets()

    def gloss(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return ks (M,) and Os (M,3), the factors of the highlights that `gather` returns for ks = Os = 1. Highlights
        of GGX contain their colour already.
        """
        return np.where(self.ggx, 1.0, self.ks), np.where(self.ggx[:, None], 1.0, self.Os)


@cache
def _facet_tables() -> NDArray[np.float64]:
    """Return how much microfacets reflect in all, by roughness and angle (ggx.h). All scenes share these tables; they
    are made when they are first needed.
    """
    tables = np.empty(TABLES)
    if _tables(tables):
        raise AssertionError("the tables of ggx.h have another size")
    tables.flags.writeable = False
    return tables


def material_arrays(materials: tuple[Material, ...]) -> Materials:
    """Return the scene's materials as arrays; the layers of all follow behind the last material."""
    also, further = [-1] * len(materials), list[Material]()
    for n, m in enumerate(materials):
        first = len(also)
        also[n] = first if m.layers else -1
        also += [-1 if k == len(m.layers) else first + k for k in range(1, len(m.layers) + 1)]
        further += m.layers
    materials = (*materials, *further)

    def column(name: str) -> NDArray[np.float64]:
        return np.array([getattr(m, name) for m in materials], np.float64)

    def colour(name: str) -> NDArray[np.float64]:
        return column(name).reshape(-1, 3)

    def flag(name: str) -> NDArray[np.bool_]:
        return np.array([getattr(m, name) for m in materials], np.bool_)

    return Materials(
        colour("Od"), column("ka"), column("kd"), column("ks"), colour("Os"), column("nShiny"), colour("mirror"),
        colour("emission"), np.array([m.image for m in materials], np.int32), colour("kt"), column("ior"),
        flag("fresnel"), colour("translucent"), column("frosted"),
        column("alpha"),
        np.array([m.alpha_image for m in materials], np.int32), np.array(also, np.int32),
        np.full((len(materials), 3), np.nan),
        np.array([m.blurred and m.highlight == "GGX" and not m.fresnel for m in materials], np.bool_),
        np.zeros(len(materials), np.int8),
        np.array([m.highlight == "GGX" for m in materials], np.bool_), column("roughness"), column("metal"),
        colour("F0"), colour("F90"), colour("F82"), column("dielectric"), column("dielectric_ior"),
        colour("dielectric_tint"), column("layered"), column("compensation"),
        column("coat"), column("coat_roughness"), column("coat_ior"), colour("coat_tint"),
        column("diffuse_roughness"), column("share"), column("sheen"), column("sheen_roughness"), colour("sheen_tint"),
        np.zeros(len(materials)), np.zeros(len(materials)), flag("matt_several"), flag("coat_several"),
        flag("facet_bumps"),
    )


class Kernels(NamedTuple):
    """Kernels for certain lights and materials, which are checked only once."""

    reaching: Any
    gather: Any


def kernels(lights: Lights, materials: Materials) -> Kernels:
    """Return the kernels for many batches of receivers with the same lights and materials."""
    first = *lights, *materials.taken
    return Kernels(_reaching.of(*first), _gather.of(*first))


class Lit(NamedTuple):
    """A batch of receivers for the sums over lights: the hits of rays with `direction`."""

    lights: Lights
    materials: Materials
    hits: Hits
    direction: NDArray[np.float64]  # (n,3) unit
    Od: NDArray[np.float64]  # (n,3)
    shown: NDArray[np.bool_] | None = None  # (L,) lamps that mirrors show as they are, and so not as highlights
    # (n,L,C) by which S is multiplied for highlights; None: by 1
    highlights: NDArray[np.float32] | None = None
    kernels: Kernels | None = None  # those of these lights and materials, if they are at hand
    groups: Any = None  # `clusters.Groups`, by which light is summed; None: lamp by lamp

    def at(self, rows: slice) -> Lit:
        """Return these receivers."""
        return self._replace(hits=self.hits.at(rows), direction=self.direction[rows], Od=self.Od[rows])

    @property
    def receivers(self) -> tuple[NDArray | None, ...]:
        """Return the arguments for the kernels in `shading.c` that say where the receivers are, in their order."""
        h = self.hits
        return h.P, h.Ng, h.Ns, self.direction, self.Od, h.row, h.unbent

    @property
    def taken(self) -> tuple[NDArray | None, ...]:
        """Return the arguments for the kernels in `shading.c`, in their order."""
        return (*self.lights, *self.materials.taken, *self.receivers)


def reaching(lit: Lit, unlit: bool, active: NDArray[np.uint64]) -> None:
    """Fill active (n,W) with the bits of the lights for which ξ_i·Ω_i ≠ 0.

    `unlit`: also set the bits of lights that reach P (ξ_i·I_i·f_att ≠ 0) but from which the material reflects nothing;
    the shadow passes need these.
    """
    if lit.kernels is None:
        _reaching(*lit.taken, unlit, active)
    else:
        lit.kernels.reaching(*lit.receivers, unlit, active)


def gather(lit: Lit, S: NDArray[np.float32], colour: NDArray[np.float64], matt: NDArray[np.float64] | None = None,
           gloss: NDArray[np.float64] | None = None) -> None:
    """Add U = Σ_i S_i·Ω_i, eqs. (2), (4) and (7), to colour (n,3), and its two terms to matt and gloss (n,3).

    S is (n,L,C): one number for each light, or RGB. S must be 0 where ξ_i·Ω_i is 0; this is not checked again.
    """
    if lit.groups is not None:
        lit.groups.gather(S, colour, matt, gloss)
        return
    rough = None if lit.shown is None else rough_only(lit.materials, lit.hits.row)
    if rough is None or lit.shown is None:
        if lit.kernels is None:
            _gather(*lit.taken, S, lit.highlights, colour, matt, gloss)
        else:
            lit.kernels.gather(*lit.receivers, S, lit.highlights, colour, matt, gloss)
        return
    lights = lit.lights
    others = lights._replace(glossy=lights.glossy & ~lit.shown)
    shown = lights._replace(glossy=lights.glossy & lit.shown, diffuse=np.zeros_like(lights.diffuse))
    _gather(*lit._replace(lights=others).taken, S, lit.highlights, colour, matt, gloss)
    _gather(*lit._replace(lights=shown, materials=rough).taken, S, lit.highlights, colour, matt, gloss)


def alphas(m: Materials, row: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the square of the roughness (n,) of GGX highlights, that of a coat if it is smoother; 0 without such
    highlights. row (n,): the rows of the materials.
    """
    coated = (m.coat > 0) & (m.coat_roughness >= 0)
    rough = np.where(coated, np.minimum(m.roughness, m.coat_roughness), m.roughness)
    return np.where(m.ggx, np.maximum(rough, SMOOTHEST) ** 2, 0.0)[row]


def each(lit: Lit, active: NDArray[np.uint64]) -> NDArray[np.float32]:
    """Return how much of each active light (n,W) surfaces return if nothing is in its way: (n,L), the largest of RGB.
    """
    out = np.empty((len(lit.hits.P), len(lit.lights.type)), np.float32)
    _each(*lit.taken, active, out)
    return out


def rough_only(materials: Materials, row: NDArray[np.int32]) -> Materials | None:
    """Return the materials without the highlights of lobes that are as smooth as mirrors, whose rays see the lamps
    themselves; None where none of those at `row` (n,) has such a lobe.
    """
    m = materials
    base = m.ggx & ((m.roughness < SMOOTHEST) | (m.mirroring & 1 > 0))
    coat = m.ggx & (m.coat > 0) & ((m.coat_roughness < SMOOTHEST) | (m.mirroring & 2 > 0))
    if not (base | coat)[row].any():
        return None
    return materials._replace(metal=np.where(base, 0.0, materials.metal),
                              dielectric=np.where(base, 0.0, materials.dielectric),
                              coat_roughness=np.where(coat, -1.0, materials.coat_roughness))


def steps(lit: Lit, S: NDArray[np.float32], group: NDArray[np.int64], narrow: NDArray[np.uint64] | None, jump: float,
          step: float, matt: NDArray[np.float64], gloss: NDArray[np.float64]) -> None:
    """Fill matt and gloss (n,) with how much the light of a white surface may change nearby.

    A light that is partly visible changes by the share `jump`, one in narrow (n,W) by all, all others by `step`. group
    (L,): lights with the same number are close together and count as one, which is partly visible, or narrow, if one of
    them is. Different groups are independent, so the root of the sum of their squares is used. Where S > 1 (focused
    light), the value is multiplied by S.
    """
    group = np.asarray(group, np.int64)
    _steps(*lit.taken, S, group, np.argsort(group, kind="stable"), narrow, jump, step, matt, gloss)


def unlit(materials: Materials, material: NDArray[np.int32], Ia: NDArray[np.float64], Od: NDArray[np.float64],
          colour: NDArray[np.float64], ambient: NDArray[np.float64]) -> None:
    """Fill colour (n,3) with emission + Ia·ka·Od, and ambient (n,3) with only the second term."""
    _unlit(materials.ka, materials.emission, material, Ia, Od, colour, ambient)


def dim(materials: Materials, hits: Hits, direction: NDArray[np.float64], Od: NDArray[np.float64]) -> None:
    """Multiply Od (n,3) of hits of rays along `direction` by the share of light that a dielectric above does not
    reflect.
    """
    ggx, tables = materials.facets()
    if ggx is not None and (
            materials.layered.any() or materials.coat.any() or materials.sheen.any()):
        _dim(ggx, tables, direction, mirroring(hits, direction), hits.unbent, hits.row, Od)


def mirroring(hits: Hits, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normals (n,3) at which lobes mirror: the normals of nodes, bent back where a ray along `direction`
    would be mirrored into the surface.
    """
    return hits.Ns if hits.unbent is None else sent_out(hits.Ns, hits.unbent, hits.Ng, direction)


def sent_out(Ns: NDArray[np.float64], smooth: NDArray[np.float64], Ng: NDArray[np.float64],
             direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normals nearest to Ns (n,3), made of `smooth` by nodes, that mirror rays along `direction` out."""
    out = np.empty_like(Ns)
    _reflecting(direction, Ng, Ns, np.ascontiguousarray(smooth), out)
    return out


def covered(coat: tuple[Any, ...], sheen: tuple[Any, ...], Ns: NDArray[np.float64],
            incoming: NDArray[np.float64], coats: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Return what of light from below gets through a coat and fibres (n,3), to eyes along `incoming` (n,3).

    coat: weight, roughness, ior, the tint's channels, and whether light counts that it reflects several times; sheen:
    weight, roughness and the tint's channels; each a number or (n,). Ns: the normals, and coats: those of
    coats, where these are others.
    """
    n = len(Ns)
    rows, passed = np.zeros((n, 37)), np.ones((n, 3))
    rows[:, 0] = 1.0  # the columns are those of ggx.h
    for column, values in ((19, coat[:6]), (27, sheen), (35, coat[6:])):
        for k, value in enumerate(values):
            rows[:, column + k] = value
    _dim(rows, _facet_tables(), -incoming, Ns, coats, np.arange(n, dtype=np.int32), passed)
    return passed


def linked(scene: Scene) -> NDArray[np.uint64] | None:
    """Return bits (objects, W) of the lights that light each object; None if all lights light all objects."""
    if all(light.receivers is None for light in scene.lights):
        return None
    lit = np.full((len(scene.objects), (len(scene.lights) + 63) // 64), ~np.uint64(0))
    for i, light in enumerate(scene.lights):
        if light.receivers is not None:
            dark = np.setdiff1d(np.arange(len(scene.objects)), light.receivers)
            lit[dark, i >> 6] &= ~(np.uint64(1) << np.uint64(i & 63))
    return lit
