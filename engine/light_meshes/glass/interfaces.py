"""What happens at a surface that lets light through: alpha, media by priority, Snell, Fresnel, kt."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.geometry import Hits, Surfaces
from ..rays.stacks import stacks
from ..scene.description import Scene
from ..support.compiled import kernel
from ..surface.textures import Texture
from .bodies import around, bodies, facets
from .media import Media, closed

MEDIA = 32  # bodies that a ray can be in at once, at most; what it enters beyond that is forgotten


class Face(NamedTuple):
    """The interface at each hit of a batch."""

    real: NDArray[np.bool_]  # (n,) False: inside a medium of higher priority, nothing is there
    bends: NDArray[np.bool_]  # (n,) the ray behind it goes another way
    kt: NDArray[np.float64]  # (n,3) share that passes
    mirror: NDArray[np.float64]  # (n,3) share that is reflected
    refracted: NDArray[np.float64]  # (n,3) unit direction behind the surface
    media: NDArray[np.int32]  # (n,m) bodies that the ray is in behind it, −1: none


class Interfaces:
    """The transparent side of a scene's materials."""

    def __init__(self, scene: Scene, surfaces: Surfaces, textures: list[Texture | None]) -> None:
        m = scene.materials
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
        self.lets_through = (passes & shadow)[material]  # (T,) shadow rays
        # A body of index 1 is air inside glass of lower priority. Elsewhere it is none: Transparent BSDFs are such.
        least = self._priority[self._ior != 1].min(initial=np.iinfo(np.int32).max)
        medium = ((self._ior != 1) | (self._priority > least)) & (self._kt > 0).any(1)
        bends = medium[material] & (scene.settings.refraction != "NONE")
        solid = bends & closed(surfaces, bends)
        b = bodies(surfaces, solid, self._ior[material], self._priority[material])
        self._bodies = b._replace(of=np.where(solid & np.append(b.overlaps(), False)[b.of], b.of, np.int32(-1)))
        self.bending = self._bodies.of >= 0  # (T,)
        self._grazing = np.ones(len(solid))  # (T,) squared sine up to which a ray still leaves, see `_interface`
        self._grazing[self.bending] = facets(surfaces, np.flatnonzero(self.bending))
        self._room = min(2 * len(b.rank), MEDIA)  # a body that overlaps itself is entered twice
        casts = np.array([o.visible_shadow for o in scene.objects], np.bool_)
        owner = scene.geometry.instance_object[surfaces.instance]
        self._in_shadow_paths = self.lets_through & (casts[owner] if len(owner) else False)
        self.bends_shadows = bool((self._in_shadow_paths & self.bending).any())
        self.stacks = stacks(surfaces, passes[material], self.bending)
        self.transparent = bool(passes[material].any())
        self.cutouts = bool(cut[material].any())
        self.coloured = bool((self._kt[:, :1] != self._kt)[material].any())

    def media(self, casters: NDArray[np.bool_]) -> Media:
        """What the solver of refracted paths needs of each triangle, if only `casters` (T,) are there."""
        s = self._surfaces
        material = s.materials[s.source]
        alpha = self._alpha[material][:, None]
        shown = self._in_shadow_paths & casters
        return Media(shown, shown & self.bending, self._ior[material], 1 - alpha + alpha * self._kt[material],
                     self._priority[material])

    def _alpha_of(self, material: NDArray[np.int32], uv: NDArray[np.float32]) -> NDArray[np.float64]:
        alpha = self._alpha[material]
        image = self._image[material]
        for i, texture in enumerate(self._textures):
            rows = np.flatnonzero(image == i)
            if texture is not None and len(rows):
                alpha[rows] *= texture.alpha(uv[rows])
        return alpha

    def alpha(self, hits: Hits) -> NDArray[np.float64]:
        """Share (n,) of the surface that is there."""
        return self._alpha_of(hits.material, hits.uv)

    def factor(self, triangle: NDArray[np.int32], u: NDArray[np.float32],
               v: NDArray[np.float32]) -> NDArray[np.float32]:
        """What one straight crossing lets through, (n,3): 1 − α + α·kt."""
        s = self._surfaces
        material = s.materials[s.source[triangle]]
        uv: NDArray = np.zeros((len(triangle), 2), np.float32)
        if len(s.uvs):
            corners = s.at_corners(s.uvs, triangle).astype(np.float32)
            uv = corners[:, 0] * (1 - u - v)[:, None] + corners[:, 1] * u[:, None] + corners[:, 2] * v[:, None]
        alpha = self._alpha_of(material, uv)[:, None]
        return (1 - alpha + alpha * self._kt[material]).astype(np.float32)

    def seen_through(self, material: NDArray[np.int32]) -> NDArray[np.float64]:
        """How much (n,) of what is behind shows as through a Transparent BSDF, which is no glass."""
        clear = (self._ior == 1) & ~self._fresnel
        return np.where(clear, np.minimum(self._kt.mean(1), 1), 0)[material]

    def interface(self, hits: Hits, rays: dict[str, NDArray]) -> Face:
        """What becomes of rays that hit `hits`."""
        n = len(hits.P)
        face = Face(np.empty(n, np.bool_), np.empty(n, np.bool_), np.empty((n, 3)), np.empty((n, 3)),
                    np.empty((n, 3)), rays["media"].copy())
        _interface(hits, rays["direction"], self._bodies.of, self._bodies.ior, self._bodies.rank, self._grazing,
                   self._ior, self._fresnel, self._kt, self._mirror, face)
        return face

    def around(self, points: NDArray[np.float64]) -> NDArray[np.int32]:
        """What rays that begin at points (n,3) are in, as `Face.media`."""
        return around(self._surfaces, self._bodies, points, self._room)


@kernel
def _top(media, rank):
    """The body of highest rank, −1: none."""
    best = -1
    for b in media:
        if b >= 0 and (best < 0 or rank[b] > rank[best]):
            best = b
    return best


@kernel
def fresnel(eta, cosine):
    """Unpolarised reflectance at an interface with relative index eta = n2/n1; 1 at total reflection."""
    square = 1.0 - (1.0 - cosine * cosine) / (eta * eta)
    if square <= 0.0:
        return 1.0
    t = np.sqrt(square)
    s, p = (cosine - eta * t) / (cosine + eta * t), (eta * cosine - t) / (eta * cosine + t)
    return (s * s + p * p) / 2.0


@kernel
def _interface(hits, direction, bodies, index, rank, grazing, ior, by_fresnel, kt, mirror, face):
    # A ray that entered a round body can always leave it. Its facets err: a grazing ray may meet one whose normal looks
    # away, and reflect totally at another. Both are taken for grazing, or single pixels would show what is elsewhere.
    for n in range(len(hits.P)):
        m = hits.material[n]
        media = face.media[n]
        n1, n2 = 1.0, 1.0
        face.real[n] = True
        face.bends[n] = False
        body = bodies[hits.triangle[n]]
        if body >= 0:
            before = _top(media, rank)
            if hits.front[n]:
                slot = -1
                for j in range(len(media)):
                    if media[j] < 0:
                        slot = j
                        break
                if slot >= 0:
                    media[slot] = body
            else:
                if before < 0:
                    before = body  # the ray began inside
                for j in range(len(media)):
                    if media[j] == body:
                        for k in range(j, len(media) - 1):
                            media[k] = media[k + 1]
                        media[-1] = -1
                        break
            after = _top(media, rank)
            n1 = index[before] if before >= 0 else 1.0
            n2 = index[after] if after >= 0 else 1.0
            face.real[n] = before != after
            face.bends[n] = n1 != n2
        d, N = direction[n], hits.Ns[n]
        d0, d1, d2 = d[0], d[1], d[2]
        cosine = -(d0 * N[0] + d1 * N[1] + d2 * N[2])
        if cosine <= 0.0:
            length = np.sqrt(1.0 - cosine * cosine)
            d0, d1, d2 = (d0 + cosine * N[0]) / length, (d1 + cosine * N[1]) / length, (d2 + cosine * N[2]) / length
            cosine = 0.0
        eta = n1 / n2
        square = 1.0 - eta * eta * (1.0 - cosine * cosine)
        if square <= 0.0 and 1.0 - square <= grazing[hits.triangle[n]] and not by_fresnel[m]:
            square = 1e-12
        reflected = 0.0
        if by_fresnel[m]:
            if face.bends[n]:
                reflected = fresnel(n2 / n1, cosine)
            elif body < 0 and ior[m] != 1.0 and (kt[m, 0] > 0.0 or kt[m, 1] > 0.0 or kt[m, 2] > 0.0):
                reflected = fresnel(ior[m], cosine)
        for c in range(3):
            face.refracted[n, c] = d[c]
            if by_fresnel[m]:
                face.mirror[n, c] = reflected
                face.kt[n, c] = kt[m, c] * (1.0 - reflected)
            else:
                face.mirror[n, c] = mirror[m, c]
                face.kt[n, c] = kt[m, c]
        if not face.real[n]:
            for c in range(3):
                face.kt[n, c], face.mirror[n, c] = 0.0, 0.0
        elif face.bends[n]:
            if square <= 0.0:  # total internal reflection: what would pass comes back
                for c in range(3):
                    face.mirror[n, c] = max(face.mirror[n, c], kt[m, c])
                    face.kt[n, c] = 0.0
            else:
                f = eta * cosine - np.sqrt(square)
                r = face.refracted[n]
                r[0], r[1], r[2] = eta * d0 + f * N[0], eta * d1 + f * N[1], eta * d2 + f * N[2]
                G = hits.Ng[n]
                into = r[0] * G[0] + r[1] * G[1] + r[2] * G[2]
                if into >= 0.0:  # bent shading normals must not send it back out
                    for c in range(3):
                        face.refracted[n, c] -= (into + 1e-6) * G[c]
                length = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
                for c in range(3):
                    face.refracted[n, c] /= length
