"""A scene made ready to be looked at: triangles, accelerator, lights and the shadow method its plan asks for."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..film.passes import shadow_number
from ..glass.interfaces import Interfaces
from ..glass.refraction import RefractedPaths
from ..rays.camera import camera_rays, filter_offsets
from ..rays.geometry import Hits, flatten, surface
from ..rays.tracer import Tracer
from ..scene.description import Camera, Scene
from ..shadows import radius as light_size
from ..shadows.area_sampling import AreaSampling
from ..shadows.casters import Group, casters, union
from ..shadows.meshes.certificate import Certificate, certificate
from ..shadows.meshes.lattice import lattice
from ..shadows.meshes.semitransparent import Refraction, SemitransparentMeshes, SharpThrough
from ..shadows.terminator import Terminator
from ..shadows.visibility import LightMeshes, Sharp, Unshadowed
from ..support import processors
from ..support.bits import has
from ..support.statistics import Statistics
from ..surface import shading, textures
from . import automatic_step, memory, reuse
from .plan import darkness, plan
from .sparse import Sparse

SHADED = 1 << 22  # receivers × lights held at once, at most
Sums = tuple[NDArray, dict[str, NDArray], dict[str, NDArray]]  # colour, its terms and the shadow passes of `direct`


class Prepared:
    """A scene made ready: triangles, accelerator, lights and the shadow method that its plan asks for."""

    def __init__(self, scene: Scene, passes: Sequence[str] = ("Combined",), *, previous: Prepared | None = None,
                 camera: Camera | None = None, check: Callable[[], None] = lambda: None) -> None:
        """previous: what was prepared before, of which all that is still right is taken over (see `reuse`).

        camera: of the rays, where it is not the scene's; h is measured by the scene's. `check` raises to give up.
        """
        began = time.perf_counter()
        self.stats = Statistics()
        self.passes = tuple(passes)
        light_size.check(scene.settings)
        parts = memory.before(dataclasses.replace(scene, camera=camera or scene.camera), passes)
        memory.check(parts)
        with self.stats.stage("geometry"):
            scene = reuse.shared_geometry(scene, previous)
            view = camera or scene.camera
            self.surfaces, self.lost = reuse.surfaces(scene, view, previous) or flatten(scene, view)
        check()
        self.textures: list[textures.Texture | None]  # of all images
        with self.stats.stage("textures"):
            self.textures, sentences = textures.load(scene.images, textures.alphas(scene), processors.count(),
                                                     previous.textures if previous else [])
        self.warnings = [*darkness(scene), *self.lost, *sentences]
        self.scene = scene
        self.glass = reuse.interfaces(self, previous) or Interfaces(scene, self.surfaces, self.textures)
        check()
        with self.stats.stage("accelerator"):
            full = scene.settings.refraction == "FULL" and scene.settings.shadows != "AREA_SAMPLING"
            bent = self.glass.bending & full
            self.casters = casters(scene, self.surfaces, bent)
            self.tracer = Tracer(scene, self.surfaces, self.glass.lets_through, bent, self.casters.sets,
                                 reuse.tracer(self, previous), self.glass.stacks)
        check()
        self.described = scene
        self.lights = shading.light_arrays(scene.lights)
        self.linked = shading.linked(scene)
        self.terminator = Terminator(scene, self.surfaces)
        self.materials = shading.material_arrays(scene.materials)
        self.measured_h, self.step_reason = 0.0, ""
        if scene.settings.auto_h:
            self.measured_h = (scene.settings.measured_h or reuse.measured_h(self, previous)
                               or automatic_step.measured_h(self))
            self.warnings += automatic_step.take(self, self.measured_h)
        if camera is not None:
            self.scene = dataclasses.replace(self.scene, camera=camera)
        self.plan = plan(self.scene, self.glass, self.casters, self.passes, self.step_reason)
        groups = np.array([light.shadow_pass for light in scene.lights], np.int64)
        self._shadow_lights = {name: np.flatnonzero((groups == shadow_number(name)) | (name == "Shadow"))
                               for name in self.passes if name.startswith("Shadow")}
        self._number()
        self.refraction = self._refraction(previous)
        self.radii: dict[int, float] = {}  # r of lights that have one of their own
        self.certificate: Certificate | None = None
        self.visibility = self._visibility(previous)
        if isinstance(self.visibility, LightMeshes):
            parts.append(memory.nodes(self))
        self.warnings += memory.check(parts)
        self.memory = memory.expected(parts)  # bytes
        self.nodes_kept = reuse.nodes(self, previous)
        self.offsets = filter_offsets(scene.settings.samples, scene.settings.filter_size)
        self.sparse = Sparse(self) if self.plan.shadow_rate > 1 else None
        self.seconds = time.perf_counter() - began

    def _number(self) -> None:
        """What passes write of each object and material: indices, mattes, holes."""
        scene = self.scene
        self.material_index = np.array([m.index for m in scene.materials], np.float64)
        self.object_index = np.array([o.index for o in scene.objects], np.float64)
        self.cryptomatte = {
            "CryptoObject": np.array([o.cryptomatte for o in scene.objects], np.uint32),
            "CryptoAsset": np.array([o.cryptomatte_asset for o in scene.objects], np.uint32),
            "CryptoMaterial": np.array([m.cryptomatte for m in scene.materials], np.uint32)}
        self.holdout = np.array([o.holdout for o in scene.objects], np.bool_)
        self.catcher = np.array([o.shadow_catcher for o in scene.objects], np.bool_)

    def _visibility(self, previous: Prepared | None) -> Unshadowed | Sharp | LightMeshes | AreaSampling | SharpThrough:
        scene, s = self.scene, self.scene.settings
        if self.plan.shadows == "NONE":
            return Unshadowed(scene.lights)
        needed = scene.lights, self.lights.targets(), self.tracer, self.stats
        through = self.glass.factor, self.plan.channels, self.refraction

        def sharp(groups: tuple[Group, ...]) -> Sharp | SharpThrough:
            return SharpThrough(*needed, groups, *through) if self.plan.channels else Sharp(*needed, groups)

        if self.plan.shadows == "SHARP":
            return sharp(self.casters.whole)
        if self.plan.shadows == "AREA_SAMPLING":
            edges = sharp(self.casters.sharp) if self.casters.sharp else None
            return AreaSampling(*needed, self.casters, sharp(self.casters.whole), edges, s.light_samples, s.seed)
        own = self.own_radii
        steps, sentences = light_size.steps(self, own)
        suits = self.measured_h or automatic_step.measured_h(self)
        self.warnings += [*sentences, *light_size.small(self, steps, suits)]
        soft = union(self.casters.soft, len(scene.lights))
        self.radii = {i: float(f"{s.h * steps[i]:.9g}") for i in own if has(soft, i)}
        reach = np.unique([step for i, step in enumerate(steps) if has(soft, i)] or [s.kI])  # none where forced
        nodes = lattice(s.h, reach, s.lattice_rotation, s.lattice_origin)
        if self.plan.certificate:
            self._certify(previous, s.h * float(reach[-1]))
        ring = np.searchsorted(reach, np.minimum(steps, reach[-1]))
        how = self.casters, nodes, ring, s.weights == "SMOOTH"
        if self.plan.channels:
            return SemitransparentMeshes(*needed, *how, self.plan.uniform_skip, self.certificate, *through,
                                         s.glass == "BOUNDED", self.glass.cutouts)
        return LightMeshes(*needed, *how, self.plan.uniform_skip, self.certificate)

    def _certify(self, previous: Prepared | None, r: float) -> None:
        """Make the certificate, if there are bodies."""
        casts = np.array([o.visible_shadow for o in self.scene.objects], np.bool_)
        meets = casts[self.owner(np.arange(len(self.surfaces.triangles), dtype=np.int32))]
        with self.stats.stage("certificate"):
            self.certificate = reuse.certificate(self, previous, meets, r) or certificate(self.surfaces, meets, r)
        if self.certificate is None:
            self.plan.reasons["certificate"] = "off: no object is convex, no surface plane"

    def _refraction(self, previous: Prepared | None) -> Refraction | None:
        if not self.plan.paths:
            return None
        s = self.scene.settings
        solvers = reuse.solvers(self, previous)
        if solvers is None:
            solvers = {}
            for n in sorted({g.casters for g in (*self.casters.whole, *self.casters.soft, *self.casters.sharp)}):
                media = self.glass.media(self.casters.sets[n])
                if media.solid.any():
                    solvers[n] = RefractedPaths(self.surfaces, media, self.lights.targets(), self.tracer, s.h, n,
                                                s.caustics == "FOCUS")
        if not solvers:  # what bends blocks no light
            return None
        return Refraction(solvers, s.h / 2 if s.caustics == "FOCUS" else None, s.leak_free)

    @cached_property
    def own_radii(self) -> dict[int, float]:
        """r of the lights that have one of their own, as asked for."""
        return light_size.own_radii(self)

    @cached_property
    def footprints(self) -> reuse.Footprints:
        """The shadow casters as the next picture compares them with its own."""
        return reuse.footprints(self)

    def path_warnings(self) -> list[str]:
        """A sentence a light that was not followed through all the glass in its way, after a render."""
        solvers = list(self.refraction.solvers.values()) if self.refraction else []
        most = [min((n for solver in solvers if (n := solver.lost(i))), default=0)
                for i in range(len(self.scene.lights))]
        return [f"light '{light.name}': it was followed through {n} bends only, so many surfaces of glass stand in its "
                f"way or scatter it; behind more of them it falls straight through"
                for light, n in zip(self.scene.lights, most, strict=True) if n]

    @property
    def soft(self) -> LightMeshes:
        """The light meshes, where the plan has them."""
        assert isinstance(self.visibility, LightMeshes)
        return self.visibility

    def light_visibility(self, P: NDArray[np.float64], N: NDArray[np.float64],
                         triangle: NDArray[np.int32] | None = None) -> NDArray[np.float32]:
        """S_i (n,L) of all lights in front of receivers P with unit geometric normals N, both (n,3).

        triangle (n,): that they are on; None: on surfaces that every light lights and soft shadows fall on.
        """
        toward = self.lights.targets()
        away = np.where(toward.directional[None, :, None], toward.position[None], toward.position[None] - P[:, None])
        facing = (away * N[:, None]).sum(2) > 0
        active = np.zeros((len(P), max(1, (len(self.scene.lights) + 63) // 64)), np.uint64)
        for i in range(facing.shape[1]):
            active[:, i >> 6] |= facing[:, i].astype(np.uint64) << np.uint64(i & 63)
        if triangle is not None and self.linked is not None:
            active &= self.linked[self.owner(triangle)]
        return self.visibility(np.ascontiguousarray(P), np.ascontiguousarray(N), active, lambda: None, triangle)

    def owner(self, triangle: NDArray[np.int32]) -> NDArray[np.int32]:
        """Objects (n,) that triangles (n,) belong to."""
        return self.scene.geometry.instance_object[self.surfaces.instance[triangle]]

    def closest(self, kind: str, origin: NDArray, direction: NDArray, normal: NDArray | None = None,
                reach: NDArray | None = None, casters: int = 0,
                passed: tuple[NDArray, NDArray] | None = None) -> tuple[NDArray[np.bool_], Hits]:
        """Which rays hit (n,), and the surface at those that do."""
        triangle, u, v = self.tracer.closest(kind, origin, direction, normal, reach, casters, passed)
        hit = triangle >= 0
        n = int(np.count_nonzero(hit))
        hits = Hits(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.zeros((n, 2), np.float32),
                    np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.bool_))
        rows = slice(None) if n == len(hit) else np.flatnonzero(hit)
        surface(self.surfaces, triangle[rows], u[rows], v[rows], origin[rows], direction[rows], hits)
        return hit, hits

    def coarse_view(self) -> tuple[NDArray[np.float64], Hits]:
        """What the scene's own camera sees on a grid of 64 × 64 rays: directions (n,3) of those that hit, and where."""
        camera = dataclasses.replace(self.described.camera, width=64, height=64, crop=None)
        origin, direction, reach = camera_rays(camera, (0, 0, 64, 64), np.zeros((1, 2)))
        hit, hits = self.closest("camera", origin, direction, None, reach)
        return direction[hit], hits

    def direct(self, hits: Hits, direction: NDArray, check: Callable[[], None], parts: bool = False,
               first: bool = False, work: NDArray | None = None) -> Sums:
        """Ia·ka·Od + Σ S·Ω + emission (n,3), of hits of rays with `direction`.

        And its terms, by the passes that show them, where `parts`; and the shadow passes, (n,3), where `first`. work
        (n,4): filled with what the debug passes show.
        """
        Od, sums = self.unshaded(hits, parts, first)
        self.add_light(hits, direction, Od, sums, check, work)
        return sums

    def unshaded(self, hits: Hits, parts: bool, first: bool) -> tuple[NDArray, Sums]:
        """Od (n,3) of the hits, and what `direct` returns, without the light of lights."""
        m, settings = self.materials, self.scene.settings
        Od = m.Od.take(hits.material, axis=0)
        if self.textures:
            image = m.image[hits.material]
            for i, texture in enumerate(self.textures):
                if texture is not None:
                    texture.lookup(hits.uv, np.flatnonzero(image == i), Od)
        colour, ambient = np.empty_like(Od), np.empty_like(Od)
        shading.unlit(m, hits.material, settings.ambient * np.array(self.scene.world_color), Od, colour, ambient)
        terms = {"Emission": m.emission[hits.material], "Ambient": ambient, "Diffuse": np.zeros_like(colour),
                 "Glossy": np.zeros_like(colour)} if parts else {}
        return Od, (colour, terms, {name: np.zeros_like(colour) for name in self._shadow_lights if first})

    def add_light(self, hits: Hits, direction: NDArray, Od: NDArray, sums: Sums, check: Callable[[], None],
                  work: NDArray | None = None, lights: NDArray[np.uint64] | None = None) -> None:
        """Add the light of some lights (W,), None: of all, to what `direct` returns."""
        colour, terms, shadows = sums
        for part, lit, _, S in self.lit(hits, direction, self.materials, Od, bool(shadows), check, work, lights):
            with self.stats.stage("shading"):
                both = (terms["Diffuse"][part], terms["Glossy"][part]) if terms else ()
                shading.gather(lit, S, colour[part], *both)
                for name, shadow in shadows.items():
                    shown = self._shadow_lights[name]
                    shadow[part] = S[:, shown].sum(1, dtype=np.float64) / max(len(shown), 1)

    def shadow_ratio(self, hits: Hits, direction: NDArray, check: Callable[[], None],
                     work: NDArray | None = None) -> NDArray[np.float64]:
        """(Σ S·Ω + Ia)/(Σ Ω + Ia) (n,3): what shadows leave of the light that a white matt surface returns.

        1 where no light comes. work: as in `direct`.
        """
        m = self.materials
        white = m._replace(kd=np.ones_like(m.kd), ks=np.zeros_like(m.ks))
        lit = np.empty((len(hits.P), 3))
        lit[:] = self.scene.settings.ambient * np.array(self.scene.world_color)
        full = lit.copy()
        unshadowed = Unshadowed(self.scene.lights)
        for part, some, active, S in self.lit(hits, direction, white, np.ones_like(lit), False, check, work):
            with self.stats.stage("shading"):
                shading.gather(some, S, lit[part])
                V = unshadowed(hits.P[part], hits.Ng[part], active, check)
                shading.gather(some, V[..., None], full[part])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(full > 0, np.clip(lit / full, 0, 1), 1)

    def lit(self, hits: Hits, direction: NDArray, materials: shading.Materials, Od: NDArray, unlit: bool,
            check: Callable[[], None], work: NDArray | None, lights: NDArray[np.uint64] | None = None,
            visibility: Unshadowed | None = None) -> Iterator[tuple[slice, shading.Lit, NDArray, NDArray]]:
        """(rows, what `shading.gather` wants to know of them, active, S (n,L,C)) of the hits, batch by batch.

        None without lights. lights (W,): those that count; None: all. visibility: another than the plan's.
        """
        count = len(self.scene.lights)
        step = max(64, SHADED // max(1, count))
        for i in range(0, len(hits.P) if count else 0, step):
            check()
            part = slice(i, min(i + step, len(hits.P)))
            some = hits.at(part)
            lit = shading.Lit(self.lights, materials, some, direction[part], Od[part])
            active = np.empty((len(some.P), (count + 63) // 64), np.uint64)
            with self.stats.stage("shading"):
                lift = self.terminator.lift(some)
                facing = some if lift is None else some._replace(Ng=lift.side)
                shading.reaching(lit._replace(hits=facing), unlit, active)
                if self.linked is not None:
                    shading.unlink(self.linked, self.owner(some.triangle), active)
                if lights is not None:
                    active &= lights
            if lift is not None and self.plan.shadows != "NONE" and visibility is None:
                with self.stats.stage("shadow terminator"):
                    self.terminator.clear(lift, some, self.lights.targets(), active, self.closest)
            where = some.P, some.Ng, active, check, some.triangle, lift
            if visibility is not None:
                S = visibility(*where)
            elif work is not None and isinstance(self.visibility, LightMeshes):
                S = self.visibility(*where, work[part])
            else:
                S = self.visibility(*where)
            S = S.reshape(*S.shape[:2], -1)
            self.terminator.fade(some, self.lights.targets(), S)
            yield part, lit, active, S
