"""A scene made ready to be looked at: triangles, accelerator, lights and the shadow method its plan asks for."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from . import shading, textures
from .area_sampling import AreaSampling
from .camera import camera_rays, depth, filter_offsets
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
            self.tracer = Tracer(scene, self.surfaces, self.glass.lets_through, bent)
        self.scene = scene
        if scene.settings.auto_h:
            settings = dataclasses.replace(scene.settings, h=measured_h(self))
            self.scene = dataclasses.replace(scene, settings=settings)
        self.plan = plan(self.scene, self.glass, self.passes)
        self.lights = shading.light_arrays(scene.lights)
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
        sharp = SharpThrough(*needed, *through) if self.plan.channels else Sharp(*needed)
        if self.plan.shadows == "SHARP":
            return sharp
        if self.plan.shadows == "AREA_SAMPLING":
            return AreaSampling(*needed, sharp, s.light_samples, s.seed)
        nodes = lattice(s.h, s.kI, s.lattice_rotation, s.lattice_origin)
        if self.plan.channels:
            return SemitransparentMeshes(*needed, nodes, self.plan.uniform_skip, *through, s.glass == "BOUNDED",
                                         self.glass.cutouts)
        return LightMeshes(*needed, nodes, self.plan.uniform_skip)

    def _refraction(self) -> Refraction | None:
        if not self.plan.paths:
            return None
        s = self.scene.settings
        solver = RefractedPaths(self.surfaces, self.glass.media(), self.lights.targets(), self.tracer, s.h)
        return Refraction(solver, s.h / 2 if s.caustics == "FOCUS" else None, s.leak_free)

    def path_warnings(self) -> list[str]:
        """A sentence a light whose paths were followed through fewer bends than usual, after a render."""
        if self.refraction is None:
            return []
        return [f"light '{light.name}': so many glass surfaces scatter it that it was followed through {most} bends "
                f"only, and some of its light behind glass is missing"
                for light, most in zip(self.scene.lights, self.refraction.solver.bends(), strict=True) if most < DEPTH]

    @property
    def soft(self) -> LightMeshes:
        """The light meshes, where the plan has them."""
        assert isinstance(self.visibility, LightMeshes)
        return self.visibility

    def light_visibility(self, P: NDArray[np.float64], N: NDArray[np.float64]) -> NDArray[np.float32]:
        """S_i (n,L) of all lights in front of receivers P with unit geometric normals N, both (n,3)."""
        toward = self.lights.targets()
        away = np.where(toward.directional[None, :, None], toward.position[None], toward.position[None] - P[:, None])
        facing = (away * N[:, None]).sum(2) > 0
        active = np.zeros((len(P), max(1, (len(self.scene.lights) + 63) // 64)), np.uint64)
        for i in range(facing.shape[1]):
            active[:, i >> 6] |= facing[:, i].astype(np.uint64) << np.uint64(i & 63)
        return self.visibility(np.ascontiguousarray(P), np.ascontiguousarray(N), active, lambda: None)

    def closest(self, kind: str, origin: NDArray, direction: NDArray, normal: NDArray | None = None,
                reach: NDArray | None = None) -> tuple[NDArray[np.bool_], Hits]:
        """Which rays hit (n,), and the surface at those that do."""
        triangle, u, v = self.tracer.closest(kind, origin, direction, normal, reach)
        hit = triangle >= 0
        n = int(hit.sum())
        hits = Hits(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.zeros((n, 2), np.float32),
                    np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.bool_))
        surface(self.surfaces, triangle[hit], u[hit], v[hit], origin[hit], direction[hit], *hits)
        return hit, hits

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
            S = self.visibility(hits.P[part], hits.Ng[part], active, check)
            with self.stats.stage("shading"):
                shading.gather(S.reshape(n, lights, -1), out, colour[part], shadow[part])
        return colour, shadow


def measured_h(ready: Prepared) -> float:
    """A step h that suits what the camera sees: 1/200 of the picture's width at the median visible depth.

    The median over the picture is not moved by a far horizon or a large ground. Two digits, so that it reads well.
    """
    camera = dataclasses.replace(ready.scene.camera, width=64, height=64, crop=None)
    origin, direction, reach = camera_rays(camera, (0, 0, 64, 64), np.zeros((1, 2)))
    _, hits = ready.closest("camera", origin, direction, None, reach)
    left, right, bottom, top = camera.window
    width = max(abs(right - left), abs(top - bottom))
    if len(hits.P) == 0:  # nothing in view
        width = ready.surfaces.scale
    elif camera.perspective:
        width *= float(np.median(depth(camera, hits.P)))
    return float(f"{max(width / 200, 1e-30):.1e}")
