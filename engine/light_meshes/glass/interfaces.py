"""Surfaces that let light through: alpha, media by priority, Snell's law, Fresnel's equations, kt."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits, Surfaces
from ..rays.stacks import stacks
from ..rays.tracer import Passing
from ..scene.description import Scene, Settings
from ..support.native import kernel
from ..surface.looks import Looks
from ..surface.textures import Texture, alpha_images
from .aside import Aside
from .bodies import around, bodies, facets
from .media import Media, closed

_cross, _factor, _straight = kernel("interfaces_cross"), kernel("interfaces_factor"), kernel("straight_light")
MEDIA = 32  # the largest number of bodies that a ray can be in at once; further bodies are ignored


class Face(NamedTuple):
    """The interface at each hit of a batch."""

    real: NDArray[np.bool_]  # (n,) False: it is inside a medium of higher priority and has no effect
    bends: NDArray[np.bool_]  # (n,) the ray changes its direction
    kt: NDArray[np.float64]  # (n,3) the share of light that passes
    mirror: NDArray[np.float64]  # (n,3) the share of light that is reflected
    refracted: NDArray[np.float64]  # (n,3) unit direction behind the surface
    media: NDArray[np.int32]  # (n,m) bodies in which the ray is behind the surface, −1 if none


class Interfaces:
    """The properties of a scene's materials that concern transparency."""

    def __init__(self, scene: Scene, surfaces: Surfaces, textures: list[Texture | None], looks: Looks,
                 whole: bool = True) -> None:
        """whole: look for triangles in one place, which takes long with many sheets."""
        self.whole = whole
        m, self._looks = scene.materials, looks
        self._surfaces, self._textures = surfaces, textures
        self._alpha = np.array([x.alpha for x in m], np.float64)
        self._image = np.array([x.alpha_image for x in m], np.int32)
        self._kt = np.array([x.kt for x in m], np.float64).reshape(-1, 3)
        self._mirror = np.array([x.mirror for x in m], np.float64).reshape(-1, 3)
        self._ior = np.array([x.ior for x in m], np.float64)
        self._priority = np.array([x.priority for x in m], np.int32)
        self._fresnel = np.array([x.fresnel for x in m], np.bool_)
        material = surfaces.materials[surfaces.source]
        cut = (self._alpha < 1) | (self._image >= 0)
        passes = cut | (self._kt > 0).any(1)
        shadow = np.array([x.transparent_shadow for x in m], np.bool_)
        self._by_uv = bool((self._image >= 0).any() or looks.cuts.any())  # whether holes differ from place to place
        self._images, asked = alpha_images(textures)
        # (M,) materials of which kernels cannot tell how much they let through
        self._asked = looks.cuts | (asked[self._image] & (self._image >= 0) if len(asked) else False)
        self.passes = passes[material]  # (T,) whether rays pass, all or in part
        self.lets_through = self.passes & shadow[material]  # (T,) whether shadow rays do
        # A body of index 1 is air if there is glass of lower priority around it. Otherwise it is no medium; Transparent
        # BSDFs are like this.
        least = self._priority[self._ior != 1].min(initial=np.iinfo(np.int32).max)
        medium = ((self._ior != 1) | (self._priority > least)) & (self._kt > 0).any(1)
        bends = medium[material] & (scene.settings.refraction != "NONE")
        solid = bends & closed(surfaces, bends)
        b = bodies(surfaces, solid, self._ior[material], self._priority[material])
        self._bodies = b._replace(of=np.where(solid & np.append(b.overlaps(), False)[b.of], b.of, np.int32(-1)))
        self.bending = self._bodies.of >= 0  # (T,)
        # (T,) the squared sine up to which a ray still leaves; see `interfaces_cross`
        self._grazing = np.ones(len(solid))
        self._grazing[self.bending] = facets(surfaces, np.flatnonzero(self.bending))
        # (T,) the index by which Fresnel's equations dim a straight ray at a crossing, 0: they do not. It is negative
        # for bodies, where light that is reflected inside leaves at one of the two faces, too.
        dim = np.where(self._fresnel & (self._ior != 1) & (self._kt > 0).any(1) & ~cut, self._ior, 0)[material]
        self.dims = np.where(self.bending, -dim, dim).astype(np.float32)
        self._room = min(2 * len(b.rank), MEDIA)  # twice, because a body that overlaps itself is entered twice
        casts = np.array([o.visible_shadow for o in scene.objects], np.bool_)
        owner = scene.geometry.instance_object[surfaces.instance]
        self._in_shadow_paths = self.lets_through & (casts[owner] if len(owner) else False)
        self.bends_shadows = bool((self._in_shadow_paths & self.bending).any())
        self._dims_shadows = bool((self._in_shadow_paths & (self.dims > 0)).any())
        self.stacks = stacks(surfaces, self.passes, self.bending) if whole else None
        self.transparent = bool(self.passes.any())
        self.cut = cut[material]  # (T,) triangles of which parts may be missing
        self.cutouts = bool(self.cut.any())
        self.coloured = bool((self._kt[:, :1] != self._kt)[material].any())

    def media(self, casters: NDArray[np.bool_]) -> Media:
        """Return what the solver for refracted paths needs of each triangle, if only `casters` (T,) exist."""
        s = self._surfaces
        material = s.materials[s.source]
        alpha = self._alpha[material][:, None]
        shown = self._in_shadow_paths & casters
        return Media(shown, shown & self.bending, self._ior[material], 1 - alpha + alpha * self._kt[material],
                     self._priority[material])

    def aside(self, settings: Settings, radius: NDArray[np.float64]) -> Aside | None:
        """Return what says how much of straight rays of light through bodies counts; None: all. radius (L,): half of
        the width of lamps, see `Aside`.
        """
        counts = self.bends_shadows or self._dims_shadows
        if settings.glass_shadows != "SOLID" or settings.refraction != "VIEW" or not counts:
            return None
        return Aside(self._surfaces, self._bodies, self._ior, self._fresnel, radius)

    def passing(self, aside: Aside | None) -> Passing:
        """Return what surfaces let through of straight rays of light. aside: see `Interfaces.aside`."""
        turning = (*(None,) * 6, 0.0) if aside is None else aside.arrays
        first = None if self.stacks is None else self.stacks.first
        kernel = _straight.of(*self._surfaces[3:], self._alpha, self._kt, self._image, self._asked, self._images, first,
                              *turning)
        return Passing(self.factor, aside, kernel)

    def _alpha_of(self, alpha: NDArray[np.float64], image: NDArray[np.int32],
                  uv: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return alpha (n,) multiplied by that of images (n,), −1: none, at uv (n,2)."""
        for i, texture in enumerate(self._textures):
            rows = np.flatnonzero(image == i)
            if texture is not None and len(rows):
                alpha[rows] *= texture.alpha(uv[rows])
        return alpha

    def alpha(self, hits: Hits) -> NDArray[np.float64]:
        """Return the share (n,) of the surface that is there."""
        return self._alpha_of(hits.table.alpha[hits.row], hits.table.alpha_image[hits.row], hits.uv)

    def factor(self, triangle: NDArray[np.int32], u: NDArray[np.float32],
               v: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the factor (n,3) for light at one straight crossing: 1 − α + α·kt."""
        s, n = self._surfaces, len(triangle)
        factor, left = np.empty((n, 3), np.float32), np.empty(n, np.bool_)
        if _factor(s.source, s.materials, s.piece, s.uvs, self._alpha, self._kt, self._image, self._asked, self._images,
                   triangle, u, v, factor, left):
            rows = np.flatnonzero(left)
            factor[rows] = self._factor_of(triangle[rows], u[rows], v[rows])
        return factor

    def _factor_of(self, triangle: NDArray[np.int32], u: NDArray[np.float32],
                   v: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the same, for any material."""
        s = self._surfaces
        material = s.materials[s.source[triangle]]
        uv: NDArray = np.zeros((len(triangle), 2), np.float32)
        if len(s.uvs) and self._by_uv:
            corners = s.at_corners(s.uvs, triangle).astype(np.float32)
            uv = corners[:, 0] * (1 - u - v)[:, None] + corners[:, 1] * u[:, None] + corners[:, 2] * v[:, None]
        alpha, kt = self._alpha_of(self._alpha[material], self._image[material], uv), self._kt[material]
        self._looks.let_through(material, triangle, u, v, uv, alpha, kt)
        return (1 - alpha[:, None] + alpha[:, None] * kt).astype(np.float32)

    def seen_through(self, hits: Hits) -> NDArray[np.float64]:
        """Return how much (n,) of what is behind shows as through a Transparent BSDF; 0 for glass."""
        m, row = hits.table, hits.row
        clear = (m.ior[row] == 1) & ~m.fresnel[row]
        return np.where(clear, np.minimum(m.kt[row].mean(1), 1), 0)

    def interface(self, hits: Hits, direction: NDArray[np.float64], media: NDArray[np.int32]) -> Face:
        """Return what becomes of rays that hit `hits` along direction (n,3), in the bodies media (n,m), as
        `Face.media`.
        """
        n = len(hits.P)
        face = Face(np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty((n, 3)), np.empty((n, 3)),
                    np.empty((n, 3)), media.copy())
        m = hits.table
        _cross(hits.Ng, hits.Ns, hits.row, hits.triangle, hits.front, direction, self._bodies.of,
               self._bodies.ior, self._bodies.rank, self._grazing, m.ior, m.fresnel, m.kt, m.mirror, m.share, *face)
        return face

    def around(self, points: NDArray[np.float64]) -> NDArray[np.int32]:
        """Return the bodies around points (n,3) at which rays begin, as in `Face.media`."""
        return around(self._surfaces, self._bodies, points, self._room)
