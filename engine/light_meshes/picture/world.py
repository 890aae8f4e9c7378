"""The world of a picture: its triangles and their textures, ready to be hit by rays, and how much light surfaces let
through.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..glass.interfaces import Interfaces
from ..rays.camera import camera_rays
from ..rays.geometry import Hits, Surfaces, flatten, same_frame, surfacing
from ..rays.tracer import Pixels, Tracer
from ..scene.description import Camera, Light, Scene, same
from ..scene.programs import LETS_THROUGH
from ..shadows.casters import Casters, casters
from ..shadows.registry import KINDS
from ..support import processors
from ..support.rows import where
from ..support.statistics import Statistics
from ..surface import shading, textures
from ..surface.lamps import Lamps
from ..surface.looks import Looks
from ..surface.sky import Sky

COARSE = 64  # rays along each side of the coarse view


@dataclass(frozen=True, eq=False)
class World:
    """A scene's surfaces, lights and materials as arrays, and the tracer that finds them."""

    # As it was described, so that the coarse view is that of its own camera; with the lamps that stand for the suns of
    # its world, and its mean as world colour.
    scene: Scene
    camera: Camera  # of the picture
    surfaces: Surfaces
    lost: list[str]  # a sentence for each object with triangles that cannot be drawn
    textures: list[textures.Texture | None]  # of all images
    unread: list[str]  # a sentence for each texture that cannot be read
    glass: Interfaces
    casters: Casters
    tracer: Tracer
    lights: shading.Lights
    materials: shading.Materials
    looks: Looks
    lamps: Lamps
    sky: Sky
    as_lamps: NDArray[np.bool_] | None = None  # (T,) triangles whose light comes from lamps in their place; None: none
    lamp_objects: tuple[int, ...] = ()  # the objects in whose place these lamps are, the last ones of `lights`

    def look(self, hits: Hits, direction: NDArray[np.float64], ray: NDArray[np.int8], flat: bool = False) -> Hits:
        """Return the hits of rays along `direction`, with what the programs of their materials say of them; see
        `Looks`.
        """
        return self.looks(self.materials, hits, direction, ray, flat)

    def owner(self, triangle: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the objects (n,) to which triangles (n,) belong."""
        return self.scene.geometry.instance_object[self.surfaces.instance[triangle]]

    @cached_property
    def surface(self) -> Callable[..., None]:
        """Do the same as `geometry.surfacing` for these surfaces; their arrays are checked once."""
        return surfacing(self.surfaces)

    def closest(self, kind: str, origin: NDArray, direction: NDArray, normal: NDArray | None = None,
                reach: NDArray | None = None, casters: int = 0,
                passed: tuple[NDArray, NDArray] | None = None,
                pixels: Pixels | None = None) -> tuple[NDArray[np.bool_], Hits]:
        """Return which rays hit something (n,), and the surfaces that they hit. The arguments are those of
        `Tracer.closest`.
        """
        triangle, u, v = self.tracer.closest(kind, origin, direction, normal, reach, casters, passed, pixels)
        hit = triangle >= 0
        n, rows = int(np.count_nonzero(hit)), None
        material = np.empty(n, np.int32)
        hits = Hits(np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.zeros((n, 2), np.float32),
                    material, np.empty(n, np.int32), np.empty(n, np.bool_), material, self.materials)
        if n < len(hit):
            rows = where(hit)
        self.surface(rows, triangle, u, v, origin, direction, hits)
        return hit, hits

    def coarse_view(self) -> tuple[NDArray[np.float64], Hits]:
        """Return what the scene's own camera sees on a grid of 64 × 64 rays: the directions (n,3) of those that hit,
        and the hits.
        """
        camera = dataclasses.replace(self.scene.camera, width=COARSE, height=COARSE, crop=None)
        origin, direction, reach = camera_rays(camera, (0, 0, COARSE, COARSE), np.zeros((1, 2)))
        hit, hits = self.closest("camera", origin, direction, None, reach)
        return direction[hit], hits


def world(scene: Scene, camera: Camera, stats: Statistics, check: Callable[[], None], old: World | None,
          lamps: tuple[Light, ...] = (), whole: bool = True) -> World:
    """Return the world of `scene` for a picture by `camera`.

    old: that of the picture before, of which all is taken over that is still right. check() raises to give up.
    lamps: more lights than the scene has. whole: see `Interfaces`.
    """
    with stats.stage("geometry"):
        if old and same(scene.geometry, old.scene.geometry):  # one copy in memory, and known to be equal
            scene = dataclasses.replace(scene, geometry=old.scene.geometry)
        surfaces, lost = _kept_surfaces(scene, camera, old) or flatten(scene, camera)
    check()
    with stats.stage("textures"):
        images, unread = textures.load(scene.images, textures.alphas(scene), processors.count(),
                                       old.textures if old else [])
    check()
    with stats.stage("sky"):
        sky = Sky(scene, images, camera, old.sky if old else None, check)
        if sky.varies:
            scene = dataclasses.replace(scene, lights=(*scene.lights, *sky.suns), world_color=tuple(sky.mean.tolist()))
        scene = dataclasses.replace(scene, lights=(*scene.lights, *lamps)) if lamps else scene
    looks = Looks(scene, surfaces, images, camera)
    alike = old if old and surfaces is old.surfaces else None
    if alike and alike.glass.whole >= whole and (
            _interfaces_key(scene, images, camera) == _interfaces_key(alike.scene, alike.textures, alike.camera)):
        glass = alike.glass
    else:
        glass = Interfaces(scene, surfaces, images, looks, whole)
    check()
    with stats.stage("accelerator"):
        who, tracer = blockers(scene, surfaces, glass, alike.tracer if alike else None)
    check()
    return World(scene, camera, surfaces, lost, images, unread, glass, who, tracer, shading.light_arrays(scene.lights),
                 shading.material_arrays(scene.materials), looks, Lamps(scene, images, camera), sky)


def blockers(scene: Scene, surfaces: Surfaces, glass: Interfaces, old: Tracer | None) -> tuple[Casters, Tracer]:
    """Return which surfaces are in the way of which light, and what traces them. old: see `Tracer`."""
    settings, kind = scene.settings, KINDS[scene.settings.shadows]
    bent = glass.bending & (settings.refraction == "FULL" and kind.bends)
    who = casters(scene, surfaces, bent, kind.soft and settings.mode != "LOCAL", kind.lattice)
    return who, Tracer(scene, surfaces, glass.lets_through, bent, who.sets, old, glass.stacks)


def _kept_surfaces(scene: Scene, camera: Camera, old: World | None) -> tuple[Surfaces, list[str]] | None:
    """Return the old triangles, if they are the same and in a frame that suits the camera; and the warnings about them.
    """
    if old and scene.geometry is old.scene.geometry and _traced(scene) == _traced(old.scene) and (
            _frame_key(camera) == _frame_key(old.camera) or same_frame(old.surfaces, scene, camera)):
        return old.surfaces, old.lost
    return None


def _traced(scene: Scene) -> list[tuple[str, bool, bool]]:
    """Return the names that warnings mention, and which objects the camera, or any ray, may meet."""
    return [(o.name, o.visible_camera, o.visible_camera or o.visible_reflection or o.visible_shadow)
            for o in scene.objects]


def _frame_key(camera: Camera) -> tuple:
    """Return those values of a camera that decide about the frame."""
    return camera.matrix.tolist(), camera.window, camera.perspective, camera.clip_start


def _interfaces_key(scene: Scene, images: list[textures.Texture | None], camera: Camera) -> tuple:
    """Return everything besides the triangles on which `Interfaces` depends."""
    return (
        [(m.alpha, m.alpha_image, m.kt, m.mirror, m.share, m.ior, m.priority, m.fresnel, m.transparent_shadow,
          m.program)
         for m in scene.materials],
        [texture and texture.key for texture in images], scene.settings.refraction,
        [o.visible_shadow for o in scene.objects],
        [(camera.matrix.tobytes(), camera.window, camera.perspective, camera.width, camera.height)
         for m in scene.materials if m.program.sees_camera(LETS_THROUGH)][:1],
    )
