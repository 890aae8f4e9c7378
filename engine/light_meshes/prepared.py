"""A scene made ready to be looked at: triangles, accelerator, lights and the shadow method its plan asks for."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from . import light_size, shading, textures
from .area_sampling import AreaSampling
from .bits import has
from .camera import camera_rays, depth, filter_offsets
from .casters import Group, casters, union
from .geometry import Hits, flatten, surface
from .interfaces import Interfaces
from .lattice import lattice
from .optics import DEPTH
from .plan import plan
from .refraction import RefractedPaths
from .scene import Scene
from .semitransparent import Refraction, SemitransparentMeshes, SharpThrough
from .statistics import Statistics
from .tracing import Tracer
from .visibility import LightMeshes, Sharp, Unshadowed

SHADED = 1 << 22  # receivers × lights held at once, at most


class Prepared:
    """A scene made ready: triangles, accelerator, lights and the shadow method that its plan asks for."""

    def __init__(self, scene: Scene, passes: Sequence[str] = ("Combined",)) -> None:
        self.stats = Statistics()
        self.passes = tuple(passes)
        with self.stats.stage("geometry"):
            self.surfaces, self.warnings = flatten(scene)
        self.textures, sentences = textures.load(scene.images)  # none where no material has an image
        self.warnings += sentences
        self.glass = Interfaces(scene, self.surfaces, self.textures)
        with self.stats.stage("accelerator"):
            full = scene.settings.refraction == "FULL" and scene.settings.shadows != "AREA_SAMPLING"
            bent = self.glass.bending & full
            self.casters = casters(scene, self.surfaces, bent)
            self.tracer = Tracer(scene, self.surfaces, self.glass.lets_through, bent, self.casters.sets)
        self.scene = scene
        if scene.settings.auto_h:
            settings = dataclasses.replace(scene.settings, h=measured_h(self))
            self.scene = dataclasses.replace(scene, settings=settings)
        self.plan = plan(self.scene, self.glass, self.casters, self.passes)
        self.lights = shading.light_arrays(scene.lights)
        self.linked = shading.linked(scene)
        self.materials = shading.material_arrays(scene.materials)
        self.refraction = self._refraction()
        self.visibility = self._visibility()
        self.offsets = filter_offsets(scene.settings.samples, scene.settings.filter_size)

    def _visibility(self) -> Unshadowed | Sharp | LightMeshes | AreaSampling | SharpThrough:
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
        steps, sentences = light_size.steps(self, light_size.own_radii(self))
        self.warnings += sentences
        soft = union(self.casters.soft, len(scene.lights))
        reach = np.unique([step for i, step in enumerate(steps) if has(soft, i)])
        nodes = lattice(s.h, reach, s.lattice_rotation, s.lattice_origin)
        how = self.casters, nodes, np.searchsorted(reach, np.minimum(steps, reach[-1])), s.weights == "SMOOTH"
        if self.plan.channels:
            return SemitransparentMeshes(*needed, *how, self.plan.uniform_skip, *through, s.glass == "BOUNDED",
                                         self.glass.cutouts)
        return LightMeshes(*needed, *how, self.plan.uniform_skip)

    def _refraction(self) -> Refraction | None:
        if not self.plan.paths:
            return None
        s = self.scene.settings
        solvers = {}
        for n in sorted({g.casters for g in (*self.casters.whole, *self.casters.soft, *self.casters.sharp)}):
            media = self.glass.media(self.casters.sets[n])
            if media.solid.any():
                solvers[n] = RefractedPaths(self.surfaces, media, self.lights.targets(), self.tracer, s.h, n)
        if not solvers:  # what bends blocks no light
            return None
        return Refraction(solvers, s.h / 2 if s.caustics == "FOCUS" else None, s.leak_free)

    def path_warnings(self) -> list[str]:
        """A sentence a light whose paths were followed through fewer bends than usual, after a render."""
        if self.refraction is None:
            return []
        bends = np.min([solver.bends() for solver in self.refraction.solvers.values()], 0)
        return [f"light '{light.name}': so many glass surfaces scatter it that it was followed through {most} bends "
                f"only, and some of its light behind glass is missing"
                for light, most in zip(self.scene.lights, bends, strict=True) if most < DEPTH]

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
        receives = None
        if triangle is not None:
            receives = self._receives(triangle)
            if self.linked is not None:
                active &= self.linked[self.owner(triangle)]
        return self.visibility(np.ascontiguousarray(P), np.ascontiguousarray(N), active, lambda: None, receives)

    def owner(self, triangle: NDArray[np.int32]) -> NDArray[np.int32]:
        """Objects (n,) that triangles (n,) belong to."""
        return self.scene.geometry.instance_object[self.surfaces.instance[triangle]]

    def _receives(self, triangle: NDArray[np.int32]) -> NDArray[np.bool_] | None:
        return None if self.casters.receives is None else self.casters.receives[triangle]

    def closest(self, kind: str, origin: NDArray, direction: NDArray, normal: NDArray | None = None,
                reach: NDArray | None = None, casters: int = 0) -> tuple[NDArray[np.bool_], Hits]:
        """Which rays hit (n,), and the surface at those that do."""
        triangle, u, v = self.tracer.closest(kind, origin, direction, normal, reach, casters)
        hit = triangle >= 0
        n = int(hit.sum())
        hits = Hits(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.zeros((n, 2), np.float32),
                    np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.bool_))
        surface(self.surfaces, triangle[hit], u[hit], v[hit], origin[hit], direction[hit], *hits)
        return hit, hits

    def coarse_view(self) -> tuple[NDArray[np.float64], Hits]:
        """What the camera sees on a grid of 64 × 64 rays: directions (n,3) of those that hit, and where."""
        camera = dataclasses.replace(self.scene.camera, width=64, height=64, crop=None)
        origin, direction, reach = camera_rays(camera, (0, 0, 64, 64), np.zeros((1, 2)))
        hit, hits = self.closest("camera", origin, direction, None, reach)
        return direction[hit], hits

    def direct(self, hits: Hits, direction: NDArray, check: Callable[[], None]) -> tuple[NDArray, NDArray]:
        """Ia·ka·Od + Σ S·Ω + emission (n,3), and the mean S (n,), of hits of rays with `direction`."""
        m, settings, lights = self.materials, self.scene.settings, len(self.scene.lights)
        Od = m.Od[hits.material]
        if self.textures:
            image = m.image[hits.material]
            for i, texture in enumerate(self.textures):
                if texture is not None:
                    texture.lookup(hits.uv, np.flatnonzero(image == i), Od)
        ambient = settings.ambient * np.array(self.scene.world_color)
        colour = m.emission[hits.material] + m.ka[hits.material][:, None] * Od * ambient
        shadow = np.zeros(len(hits.P))
        step = max(64, SHADED // max(1, lights))
        for i in range(0, len(hits.P) if lights else 0, step):
            check()
            part = slice(i, min(i + step, len(hits.P)))
            n = part.stop - part.start
            out = np.empty((n, lights, 3), np.float32)
            active = np.zeros((n, (lights + 63) // 64), np.uint64)
            with self.stats.stage("shading"):
                shading.omega(self.lights, m, hits.P[part], hits.Ng[part], hits.Ns[part], direction[part], Od[part],
                              hits.material[part], "Shadow" in self.passes, out, active)
                if self.linked is not None:
                    shading.unlink(self.linked, self.owner(hits.triangle[part]), out, active)
            S = self.visibility(hits.P[part], hits.Ng[part], active, check, self._receives(hits.triangle[part]))
            with self.stats.stage("shading"):
                shading.gather(S.reshape(n, lights, -1), out, colour[part], shadow[part])
        return colour, shadow


def measured_h(ready: Prepared) -> float:
    """A step h that suits what the camera sees: 1/200 of the picture's width at the median visible depth.

    The median over the picture is not moved by a far horizon or a large ground. Two digits, so that it reads well.
    """
    camera = ready.scene.camera
    _, hits = ready.coarse_view()
    left, right, bottom, top = camera.window
    width = max(abs(right - left), abs(top - bottom))
    if len(hits.P) == 0:  # nothing in view
        width = ready.surfaces.scale
    elif camera.perspective:
        width *= float(np.median(depth(camera, hits.P)))
    return float(f"{max(width / 200, 1e-30):.1e}")
