"""The light that surfaces return: Ia·ka·Od + Σ S·Ω + emission, and how shadows dim it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..film.passes import shadow_number
from ..gathered.records import Gathered, Records
from ..rays.geometry import Hits
from ..shadows import blocks, grouped, pairs
from ..shadows.method import Check, Lobes, Method, Receivers
from ..shadows.registry import NONE
from ..shadows.terminator import Terminator
from ..support.bits import mask_of
from ..support.rows import even
from ..support.statistics import Statistics
from ..surface import clusters, colours, shading
from ..surface.layers import Layer
from ..surface.seen import seen_in_mirrors
from .plan import Plan
from .world import World

# So many receivers × lights are held at once at most. Arrays of so many numbers are of 16 MB: much larger
# ones never come from memory that was used before, and with thousands of lamps clearing new pages took a tenth of the
# time.
SHADED = 1 << 22
FAN = 8.0  # about so many of the rays that a rough surface sends out count as much as the one of a mirror


class Sums(NamedTuple):
    """The light of hits, added up."""

    colour: NDArray[np.float64]  # (n,3)
    terms: dict[str, NDArray[np.float64]]  # pass → its share (n,3) of colour; {} where nobody asks
    shadows: dict[str, NDArray[np.float64]]  # shadow pass → (n,3), of what the camera sees first


class Lighting:
    """The lights of a world, with their shadows by a method."""

    def __init__(self, world: World, plan: Plan, method: Method, passes: Sequence[str], stats: Statistics) -> None:
        """method: that of the plan. passes: of the picture, of which some show shadows."""
        self._world, self._plan, self._method, self._stats = world, plan, method, stats
        self._targets, self._linked = world.lights.targets(), shading.linked(world.scene)
        self._kernels = shading.kernels(world.lights, world.materials)
        shown = _shown_by_mirrors(world)
        self.usual = 0.0  # the light of a usual pixel, where it was measured
        self._shown = shown if plan.reflections and shown.any() else None
        self.everywhere: Records | None = None  # light from everywhere, where the scene has it
        s = world.scene.settings
        self._Ia = (0.0 if s.by_sky else s.ambient) * np.array(world.scene.world_color)
        self.terminator = Terminator(world.scene, world.surfaces)
        groups = np.array([light.shadow_pass for light in world.scene.lights], np.int64)
        self._clusters = self._clusters_of(method)
        self._shadow_lights = {name: np.flatnonzero((groups == shadow_number(name)) | (name == "Shadow"))
                               for name in passes if name.startswith("Shadow")}

    @property
    def together(self) -> bool:
        """Return whether lamps count together from far away: faster for receivers that are close to each other."""
        return self._clusters is not None

    def _clusters_of(self, method: Method) -> clusters.Clusters | None:
        """Return lamps that count together from far away; None: each counts by itself, for the whole scene."""
        world, lights = self._world, self._world.lights
        if method.lamp_tree is None or not clusters.suits(lights) or self._linked is not None or world.lamps.any:
            return None
        if (world.materials.also >= 0).any() or not (self._shown is None or self._shown.all()):
            return None
        return clusters.Clusters(lights, *method.lamp_tree)

    def light_visibility(self, P: NDArray[np.float64], N: NDArray[np.float64],
                         triangle: NDArray[np.int32] | None = None) -> NDArray[np.float32]:
        """Return S_i (n,L,C) of all lights in front of receivers P with unit geometric normals N, both (n,3).

        `triangle` (n,): the triangles on which they are. None: they are on surfaces that every light lights and that
        receive soft shadows.
        """
        toward = self._targets
        away = np.where(toward.directional[None, :, None], toward.position[None], toward.position[None] - P[:, None])
        facing = (away * N[:, None]).sum(2) > 0
        active = np.zeros((len(P), max(1, (len(self._world.scene.lights) + 63) // 64)), np.uint64)
        for i in range(facing.shape[1]):
            active[:, i >> 6] |= facing[:, i].astype(np.uint64) << np.uint64(i & 63)
        if triangle is not None and self._linked is not None:
            active &= self._linked[self._world.owner(triangle)]
        at = Receivers(np.ascontiguousarray(P), np.ascontiguousarray(N), active, triangle)
        return self._method(at, lambda: None)

    def direct(self, hits: Hits, direction: NDArray, check: Check, parts: bool = False, first: bool = False,
               work: NDArray | None = None, layers: Sequence[Layer] = ()) -> Sums:
        """Return Ia·ka·Od + Σ S·Ω + emission (n,3), for hits of rays with `direction`.

        Also return its terms, by the passes that show them, if `parts`; and the shadow passes, (n,3), if `first`.
        `work` (n,4) is filled with the values of the debug passes. layers: further ones of the hits.
        """
        Od, sums = self.unshaded(hits, direction, parts, first, check, layers)
        self.add_light(hits, direction, Od, sums, check, work, layers=layers)
        return sums

    def unshaded(self, hits: Hits, direction: NDArray, parts: bool, first: bool, check: Check = lambda: None,
                 layers: Sequence[Layer] = ()) -> tuple[NDArray, Sums]:
        """Return Od (n,3) of the hits, as lights see it, and the results of `direct` without the light of lights."""
        m = hits.table
        Od = colours.matt(hits, self._world.textures)
        colour, ambient = np.empty_like(Od), np.empty_like(Od)
        shading.dim(m, hits, direction, Od)
        shading.unlit(m, hits.row, self._Ia, Od, colour, ambient)
        for layer in layers:
            more = m.ka[layer.hits.row, None] * layer.Od * self._Ia
            colour[layer.rows] += more
            ambient[layer.rows] += more
        terms = {"Emission": m.emission[hits.row], "Ambient": ambient, "Diffuse": np.zeros_like(colour),
                 "Glossy": np.zeros_like(colour)} if parts else {}
        if self.everywhere is not None:
            found = self._arriving_from_everywhere(hits, Od, layers, parts, check)
            indirect = m.kd[hits.row, None] * Od * found.light
            for layer in layers:
                own = layer.hits
                indirect[layer.rows] += own.table.kd[own.row, None] * layer.Od * found.light[layer.rows]
            colour += indirect
            if parts:
                terms |= {"Diffuse Indirect": indirect, "Ambient Occlusion": np.repeat(found.sky[:, None], 3, axis=1)}
        return Od, Sums(colour, terms, {name: np.zeros_like(colour) for name in self._shadow_lights if first})

    def _arriving_from_everywhere(self, hits: Hits, Od: NDArray, layers: Sequence[Layer], parts: bool,
                                  check: Check) -> Gathered:
        """Return the light from everywhere at hits: 0 where they return none, unless a pass (parts) shows it there."""
        assert self.everywhere is not None
        wanted = (hits.table.kd[hits.row] > 0) & Od.any(1) | parts
        for layer in layers:
            wanted[layer.rows] = True
        rows = np.flatnonzero(wanted)
        if len(rows) == len(wanted):
            return self.everywhere(hits, check)
        found = Gathered(np.zeros_like(Od), np.zeros(len(Od)))
        found.light[rows], found.sky[rows] = self.everywhere(hits.at(rows), check)
        return found

    def add_light(self, hits: Hits, direction: NDArray, Od: NDArray, sums: Sums, check: Check,
                  work: NDArray | None = None, lights: NDArray[np.uint64] | None = None,
                  layers: Sequence[Layer] = ()) -> None:
        """Add the light of some lights (W,), or of all (None), to the results of `direct`."""
        colour, terms, shadows = sums
        for part, lit, _, S in self.lit(self._surfaces(hits, direction, Od), bool(shadows), check, work, lights,
                                        layers=layers):
            with self._stats.stage("shading"):
                both = (terms["Diffuse"][part], terms["Glossy"][part]) if terms else ()
                shading.gather(lit, self.emitted(lit, S), colour[part], *both)
                for own in (layer.at(part) for layer in layers):
                    some = self._surfaces(own.hits, own.direction, own.Od)
                    light = [np.zeros((len(own.rows), 3)) for _ in (0, *both)]
                    shading.gather(some, self.emitted(some, S[own.rows]), *light)
                    for whole, more in zip((colour[part], *both), light, strict=True):
                        whole[own.rows] += more
                for name, shadow in shadows.items():
                    shown = self._shadow_lights[name]
                    shadow[part] = S[:, shown].sum(1, dtype=np.float64) / max(len(shown), 1)

    def emitted(self, lit: shading.Lit, S: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return S (n,L,C) multiplied by the colours that the nodes of lamps give, as `shading.gather` needs it."""
        return self._world.lamps(lit.hits.P, lit.hits.Ns, S)

    def caught(self, hits: Hits, direction: NDArray, check: Check, work: NDArray | None = None) -> NDArray[np.float64]:
        """Return all light (n,3) that a white matt surface at hits returns: Ia + Σ S·Ω, and what arrives from
        everywhere. `work` is as in `direct`.
        """
        light = self.arriving(hits, direction, check, None, work) + self._Ia
        if self.everywhere is not None and len(hits.P):
            light += self.everywhere(hits, check).light
        return light

    def arriving(self, hits: Hits, direction: NDArray, check: Check, visibility: Method | None,
                 work: NDArray | None = None) -> NDArray[np.float64]:
        """Return the light of all lamps (n,3) that a white matt surface at hits returns, with the shadows of
        `visibility`. None: of the picture's method, each lamp's own. `work` is as in `direct`.
        """
        m, whole = hits.table, visibility is None
        white = m._replace(kd=np.ones_like(m.kd), ks=np.zeros_like(m.ks), ggx=np.zeros_like(m.ggx))
        light = np.zeros((len(hits.P), 3))
        surfaces = self._surfaces(hits, direction, np.ones_like(light))._replace(materials=white, kernels=None)
        for part, some, _, S in self.lit(surfaces, False, check, work, visibility=visibility, whole=whole):
            with self._stats.stage("shading"):
                shading.gather(some, self.emitted(some, S), light[part])
        return light

    def _surfaces(self, hits: Hits, direction: NDArray, Od: NDArray) -> shading.Lit:
        """Return these hits, in the light of all lights."""
        kernels = self._kernels if hits.table is self._world.materials else None
        return shading.Lit(self._world.lights, hits.table, hits, direction, Od, self._shown, kernels=kernels)

    def lit(self, surfaces: shading.Lit, unlit: bool, check: Check, work: NDArray | None = None,
            lights: NDArray[np.uint64] | None = None, visibility: Method | None = None,
            narrow: NDArray[np.uint64] | None = None, layers: Sequence[Layer] = (), whole: bool = False) -> Iterator[
                tuple[slice, shading.Lit, NDArray[np.uint64], NDArray[np.float32]]]:
        """Yield, batch by batch, (rows, the arguments of surfaces for `shading.gather`, active, S (n,L,C)). Yields
        nothing without lights.

        unlit: see `shading.reaching`. lights (W,): the lights that count; None: all. visibility: another method than
        the plan's. narrow: see `Receivers`. layers: further layers of the hits, whose lights count too. whole: S of
        each lamp is wanted.
        """
        method = visibility or self._method
        together = self._clusters if method.threshold and lights is None and not (unlit or whole) else None
        count, n = len(self._world.scene.lights), len(surfaces.hits.P)
        most = max(64, SHADED // max(1, count))
        block = surfaces.hits.block
        step = even(n, most)
        parts = [slice(i, min(i + step, n)) for i in range(0, n, step)] if block is None else blocks.slices(block, most)
        for part in parts if count else ():
            check()
            lit = surfaces.at(part)
            some = lit.hits
            active = np.empty((len(some.P), (count + 63) // 64), np.uint64)
            with self._stats.stage("shading"):
                lift = self.terminator.lift(some)
                facing = some if lift is None else some._replace(Ng=lift.side)
                asked = None if together is None else together(lit, facing.Ng, method.threshold * _larger(some))
                if asked is None:
                    self._reaching(lit._replace(hits=facing), unlit, active)
                else:
                    lit, active = lit._replace(groups=asked.groups), asked.active
                    if visibility is None:
                        grouped.tell(self._stats, asked.bound, asked.total, some.weight)
                for own in (layer.at(part) for layer in layers):
                    more, at = np.empty((len(own.rows), active.shape[1]), np.uint64), own.hits
                    at = at if lift is None else at._replace(Ng=lift.side[own.rows])
                    self._reaching(self._surfaces(at, own.direction, own.Od), False, more)
                    active[own.rows] |= more
                if self._linked is not None:
                    shading.unlink(self._linked, self._world.owner(some.triangle), active)
                if lights is not None:
                    active &= lights
            if lift is not None and self._plan.shadows != NONE and visibility is None:
                with self._stats.stage("shadow terminator"):
                    self.terminator.clear(lift, some, self._targets, active, self._world.closest)
            probe = work[part] if work is not None and self._plan.kind.counts else None
            rows = None if narrow is None else narrow[part]
            weight, shown = self._weights(lit, active, method.weighs, asked)
            S = method(Receivers(some.P, some.Ng, active, some.triangle, lift, rows, some.apart, weight, shown,
                                 some.sample, some.block, None if asked is None else asked.several), check, probe)
            if visibility is None and method.highlights is not None and lit.materials.ggx.any():
                lobes = Lobes(some.Ns, lit.direction, shading.alphas(lit.materials, some.row))
                receivers = Receivers(some.P, some.Ng, active, some.triangle, lift, sample=some.sample)
                lit = lit._replace(highlights=method.highlights(receivers, S, lobes, check))
            self.terminator.fade(some, self._targets, S)
            yield part, lit, active, S

    def _reaching(self, lit: shading.Lit, unlit: bool, active: NDArray[np.uint64]) -> None:
        """Do the same as `shading.reaching`, but for lamps that smooth surfaces show as they are: where these have no
        highlights of such a lamp, and are not matt, nobody needs to know whether it is visible.
        """
        shading.reaching(lit, unlit, active)
        if unlit or lit.shown is None:
            return
        rough = shading.rough_only(lit.materials, lit.hits.row)
        if rough is not None:
            returned, shown = np.empty_like(active), mask_of(np.flatnonzero(lit.shown), len(lit.shown))
            shading.reaching(lit._replace(materials=rough, kernels=None), False, returned)
            active &= returned | ~shown

    def _weights(self, lit: shading.Lit, active: NDArray[np.uint64], always: bool,
                 asked: clusters.Asked | None) -> tuple[NDArray[np.float32] | None, NDArray[np.float64] | None]:
        """Return `weight` and `shown` of receivers, see `Receivers`. always: the method needs the former in any case.
        asked: what is known already.
        """
        hits, shown = lit.hits, None
        if hits.apart is not None and self.usual > 0:
            shown = np.where(np.isinf(hits.apart), hits.weight / self.usual, 0.0)
        if asked is not None:
            return asked.weight, shown
        if not always and (shown is None or not shown.any()):
            return None, None
        with self._stats.stage("shading"):
            weight = shading.each(lit, active)
            if self._plan.threshold and self._world.lamps.any:  # a bound needs what nodes of lamps say
                every = pairs.seen(active, len(self._world.scene.lights))
                red, green, blue = np.moveaxis(self.emitted(lit, every), 2, 0)
                weight *= np.maximum(np.maximum(red, green), blue)  # far faster than `max`
            return weight, shown

    def measure(self, hits: Hits, direction: NDArray) -> None:
        """Find the light of a usual pixel, from hits of the camera's rays with `direction`: the median of the light
        that surfaces lit by lamps would return without shadows.
        """
        if not len(hits.P) or not self._world.scene.lights:
            return
        lit = self._surfaces(hits, direction, colours.matt(hits, self._world.textures))
        active = np.empty((len(hits.P), (len(self._world.scene.lights) + 63) // 64), np.uint64)
        shading.reaching(lit, False, active)
        light = shading.each(lit, active).sum(1, dtype=np.float64)
        self.usual = float(np.median(light[light > 0])) if light.any() else 0.0


def _shown_by_mirrors(world: World) -> NDArray[np.bool_]:
    """Return which lamps (L,) smooth surfaces show as they are: those that rays see, and those that stand for suns of
    the world and for surfaces that give light, which rays see.
    """
    shown = np.array([seen_in_mirrors(light) for light in world.scene.lights], np.bool_)
    others = len(world.lamp_objects) + (len(world.sky.suns) if world.sky.varies else 0)
    shown[len(shown) - others:] = True
    return shown


def _larger(hits: Hits) -> NDArray[np.float64]:
    """Return how many times the light threshold may be as large at hits (n,), because what rays find there counts so
    little: what a faint reflection shows of a pixel may be as wrong as a larger share of its own light.
    """
    if hits.weight is None:
        return np.ones(len(hits.P))
    return np.clip(1 / np.maximum(FAN * hits.weight, 1e-300), 1, FAN)
