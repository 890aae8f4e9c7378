"""`shadow_rate`: soft light is computed at sparse points of the picture and interpolated between them.

The light that a white matt surface reflects, Σ S·Ω, is smooth on the scale of r. So is a highlight if the surface is
hardly curved. Both are computed at the centres of the pixels of a picture that is `rate` times coarser; four of these
are the corners of a block. A sample of the camera takes the mean of the corners of its block, weighted by its place
between them and multiplied by its own colours, if

- corners and sample lie on one instance with nearly the same normal, and the sample lies between the corners in space;
- the corners agree: their differences change the sample by at most TOLERANCE of the picture's light;
- the lights could not change it by more: S changes in steps, node by node, and at once for lights that are close
  together;
- the block is not larger than r, so that no shadow fits between its corners; with few nodes the limit is smaller.

Otherwise blocks of half the size are tried, and so on down to a pixel. The remaining samples are computed directly. All
this depends only on where a sample is in the picture and in the scene, not on tiles, threads or order. Light seen in
mirrors and through glass is computed at each sample, and so are shadows that are not soft, and lamps whose nodes say
more than how their light falls off.

The picture's light is the light that a white matt surface would reflect if nothing cast a shadow; a tenth of what the
camera sees is brighter. So lights of a thousand times the power give the same picture, a thousand times as bright.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rays.camera import camera_rays, coarser
from ..rays.geometry import Hits
from ..shadows.casters import Casters, smooth_lights
from ..shadows.meshes.lattice import above_a_plane
from ..shadows.method import Check
from ..shadows.unshadowed import Unshadowed
from ..support.bits import mask_of
from ..support.native import kernel
from ..support.statistics import Statistics
from ..surface import shading
from ..surface.layers import Layer
from .lighting import Lighting, Sums
from .world import World

_film, _ask, _agree = kernel("sparse_film"), kernel("sparse_ask"), kernel("sparse_agree")
_between, _add = kernel("sparse_between"), kernel("sparse_add")

TOLERANCE = 1 / 40  # of the picture's light: the largest effect of a difference between corners
# the assumed change of S within a block for a light that is partly visible, by the weights
JUMP = {"UNIFORM": 1 / 8, "SMOOTH": 1 / 16}
TOGETHER = 0.2  # about the largest angle between lights whose shadows have their edges at the same places
BLUR = 4.0  # the largest shift of a sample by the lens, in pixels


class Corners(NamedTuple):
    """The points of one step that a tile needs, and where they are in the grid."""

    step: int  # in pixels
    x: int  # of the grid's first point
    y: int
    # (rows, columns) index of the point; −1: not needed, or nothing there that receives soft shadows
    row: NDArray[np.int32]
    P: NDArray[np.float64]  # (n,3) this and the next arrays are as in Hits
    Ng: NDArray[np.float64]
    Ns: NDArray[np.float64]
    material: NDArray[np.int32]
    instance: NDArray[np.int32]
    turned: NDArray[np.float64]  # (n,3) the direction of the mirrored ray
    light: NDArray[np.float64]  # (n,3 or 6) diffuse RGB, and gloss RGB if the scene has any
    rough: NDArray[np.float64]  # (n,2) `shading.steps`, for diffuse light and for gloss


class Blocks(NamedTuple):
    """The blocks (rows, columns) between four corners each; a block has the index of its lower left corner."""

    usable: NDArray[np.bool_]
    material: NDArray[np.int32]  # of all four corners; −1 if they differ
    turn: NDArray[np.float64]  # 1 − cosine of the largest angle between the corners' `turned`
    size: NDArray[np.float64]  # square of the diagonal, world
    spread: NDArray[np.float64]  # (…,2) how much the corners differ in diffuse light and in gloss


def typical(world: World, lighting: Lighting) -> float:
    """Return the picture's light; of its brightest channel."""
    m, lights = world.materials, len(world.scene.lights)
    direction, hits = world.coarse_view()
    matt = m._replace(kd=np.ones_like(m.kd), ks=np.zeros_like(m.ks), ggx=np.zeros_like(m.ggx))
    light = np.zeros((len(hits.P), 3))
    surfaces = shading.Lit(world.lights, matt, hits, direction, np.ones_like(light))
    for part, lit, _, S in lighting.lit(surfaces, False, lambda: None, visibility=Unshadowed(lights)):
        shading.gather(lit, lighting.emitted(lit, S), light[part])
    brightest = light.max(1)
    return float(np.percentile(brightest[brightest > 0], 90)) if brightest.any() else 0.0


def groups(world: World) -> NDArray[np.int64]:
    """Return the number (L,) of each light's group: those that stand together as seen from the middle of the view."""
    targets = world.lights.targets()
    _, hits = world.coarse_view()
    middle = np.median(hits.P, axis=0) if len(hits.P) else np.zeros(3)
    way = targets.position - np.where(targets.directional, 0.0, 1.0)[:, None] * middle
    way /= np.maximum(np.sqrt((way * way).sum(1)), 1e-300)[:, None]
    group, count = np.full(len(way), -1, np.int64), 0
    for i in range(len(way)):
        if group[i] < 0:
            group[(group < 0) & (way @ way[i] >= np.cos(TOGETHER))] = count
            count += 1
    return group


class Sparse:
    """Interpolates the light of the surfaces that the camera of a prepared scene sees first."""

    def __init__(self, world: World, lighting: Lighting, casters: Casters, ball: tuple[float, float],
                 offsets: NDArray[np.float64], stats: Statistics) -> None:
        """casters: those of the picture's shadows. ball: h, and the least r of lights in steps. offsets (samples,2): in
        the pixel filter.
        """
        self._world, self._lighting, self._stats, self._offsets = world, lighting, stats, offsets
        self._camera = dataclasses.replace(world.camera, crop=None)
        s, m, lights = world.scene.settings, world.materials, len(world.scene.lights)
        least = 1 if s.samples >= 4 else 2  # one point per pixel saves nothing unless it serves several samples
        self._steps = [s.shadow_rate >> k for k in range(s.shadow_rate.bit_length()) if s.shadow_rate >> k >= least]
        self._share, self._tint = m.gloss()
        self._gloss = bool((self._share > 0).any())
        self._white = m._replace(kd=np.ones_like(m.kd), ks=np.sign(m.ks), Os=np.ones_like(m.Os))
        nodes = above_a_plane(ball[1])  # nodes around a point on a plane; each changes S by a step of 1/nodes
        self._jump, uniform = max(JUMP[s.weights], 1 / nodes), s.weights == "UNIFORM"
        self._step = 1 / nodes if uniform else 0.0
        self._lights = smooth_lights(casters, lights) & ~world.lamps.varied
        self._sharp = mask_of(range(lights), lights) & ~self._lights
        self._receives = casters.receives
        # A node above a block's middle may be in the ball of no corner. With smooth weights and a small block its
        # weight is small.
        share = 1.0 if uniform else min(1.0, np.sqrt(nodes / 40))
        self._largest = ball[0] * ball[1] * share
        self.light, self._together = typical(world, lighting), groups(world)
        self._reach = float(np.abs(offsets).max()) + 0.01 + BLUR * (self._camera.lens_radius > 0)

    def direct(self, hits: Hits, direction: NDArray, pixel: NDArray, box: tuple[int, int, int, int], check: Check,
               parts: bool, work: NDArray | None, layers: Sequence[Layer] = ()) -> Sums:
        """Return the same as `Lighting.direct` for the surfaces that the camera sees. pixel (n,): the sample of the
        tile `box` to which each hit belongs.
        """
        m = hits.table
        Od, sums = self._lighting.unshaded(hits, direction, parts, True, layers=layers)
        colour, terms, _ = sums  # there are no shadow passes, the plan makes sure
        with self._stats.stage("interpolation"):
            film, left = self._film(hits, pixel, box)
            left = left[hits.row[left] == hits.material[left]]  # what a program says is no corner's
            if layers:
                left = left[m.also[hits.row[left]] < 0]
            done, light = np.zeros(len(film), np.bool_), np.empty((len(film), 6 if self._gloss else 3))
        for k, step in enumerate(self._steps):
            check()
            if len(left):
                corners = self._corners(step, film, left, box, check)
                with self._stats.stage("interpolation"):
                    before = len(left)
                    left = self._between(corners, film, left, hits, Od, light, done)
                    self._stats.add(**{"refined" if k else "interpolated": before - len(left)})
        with self._stats.stage("interpolation"):
            some, rest = np.flatnonzero(done), np.flatnonzero(~done)
            matt, glossy = (terms["Diffuse"], terms["Glossy"]) if terms else (colour, colour)
            _add(some, hits.row, m.kd, Od, light, 0, matt)
            if self._gloss:
                _add(some, hits.material, self._share, self._tint.take(hits.material, axis=0), light, 3, glossy)
            if terms:
                colour += matt + glossy
        self._stats.add(computed=len(rest))
        self._add_light(rest, None, hits, direction, Od, sums, check, work, layers)
        if self._sharp.any():
            self._add_light(some, self._sharp, hits, direction, Od, sums, check, work)
        return sums

    def _add_light(self, rows: NDArray, lights: NDArray | None, hits: Hits, direction: NDArray, Od: NDArray,
                   sums: Sums, check: Check, work: NDArray | None, layers: Sequence[Layer] = ()) -> None:
        """Do the same as `Lighting.add_light` for some of the hits."""
        some = Sums(sums.colour[rows], {name: a[rows] for name, a in sums.terms.items()}, {})
        count = None if work is None else np.zeros((len(rows), work.shape[1]))
        self._lighting.add_light(hits.at(rows), direction[rows], Od[rows], some, check, count, lights,
                                 [layer.among(rows) for layer in layers])
        sums.colour[rows] = some.colour
        for name, a in some.terms.items():
            sums.terms[name][rows] = a
        if work is not None:
            work[rows] = count

    def _film(self, hits: Hits, pixel: NDArray, box: tuple[int, int, int, int]) -> tuple[NDArray, NDArray]:
        """Return the place of hits on the film (n,2), in pixels, and the rows of those that may be interpolated."""
        c, film = self._camera, np.empty((len(hits.P), 2))
        view = np.array([box[0], box[1], box[2] - box[0], len(self._offsets)], np.int64)
        left = np.empty(len(hits.P), np.int64)
        matrix, window = np.ascontiguousarray(c.matrix, np.float64), np.array(c.window, np.float64)
        count = _film(matrix, window, c.perspective, c.width,
                      c.height, hits.P, hits.triangle, self._receives, pixel, view, self._reach, film, left)
        return film, left[:count]

    def _corners(self, step: int, film: NDArray, left: NDArray, box: tuple[int, int, int, int],
                 check: Check) -> Corners:
        """Return the points of a step around the rows of `film` in `left`."""
        # One more on each side than `floor` gives, so that rounding does not matter.
        x0, y0 = (int((low + 0.5 - self._reach) // step) - 2 for low in box[:2])
        x1, y1 = (int((high - 0.5 + self._reach) // step) + 3 for high in box[2:])
        row = np.full((y1 - y0, x1 - x0), -1, np.int32)
        with self._stats.stage("interpolation"):
            _ask(film, left, step, x0, y0, row)
            asked = np.flatnonzero(row == 0)
        with self._stats.stage("camera rays"):
            rays = camera_rays(dataclasses.replace(coarser(self._camera, step), lens_radius=0.0), (x0, y0, x1, y1),
                               np.zeros((1, 2)))
            origin, direction, reach = (a[asked] for a in rays)
            hit, hits = self._world.closest("camera", origin, direction, None, reach)
        rows, direction = np.flatnonzero(hit), direction[hit]
        if self._receives is not None:
            takes = self._receives[hits.triangle]
            rows, direction, hits = rows[takes], direction[takes], hits.at(takes)
        row[:] = -1
        row.reshape(-1)[asked[rows]] = np.arange(len(rows), dtype=np.int32)
        self._stats.add(points=len(rows))
        turned = np.empty_like(direction)
        shading.mirrored(direction, hits.Ng, hits.Ns, turned)
        return Corners(step, x0, y0, row, hits.P, hits.Ng, hits.Ns, hits.material,
                       self._world.surfaces.instance[hits.triangle], turned, *self._light(hits, direction, step, check))

    def _light(self, hits: Hits, direction: NDArray, step: int, check: Check) -> tuple[NDArray, NDArray]:
        """Compute Corners.light and Corners.rough.

        Lamps with a size have edges narrower than r where shadows touch: no block of more than a pixel bridges them.
        """
        n = len(hits.P)
        white, light, rough = np.ones((n, 3)), np.zeros((n, 6 if self._gloss else 3)), np.zeros((2, n))
        both, matt, gloss = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
        surfaces = shading.Lit(self._world.lights, self._white, hits, direction, white)
        narrow = None if step == 1 else np.zeros((n, len(self._lights)), np.uint64)
        for part, lit, _, S in self._lighting.lit(surfaces, False, check, None, self._lights, None, narrow):
            with self._stats.stage("shading"):
                S = self._lighting.emitted(lit, S)
                shading.gather(lit, S, both[part], matt[part], gloss[part])
                rows = None if narrow is None else narrow[part]
                shading.steps(lit, S, self._together, rows, self._jump, self._step, *rough[:, part])
        light[:, :3] = matt
        if self._gloss:
            light[:, 3:] = gloss
        return light, np.ascontiguousarray(rough.T)

    def _blocks(self, corners: Corners) -> Blocks:
        rows, columns = corners.row.shape
        shape = rows - 1, columns - 1
        blocks = Blocks(np.zeros(shape, np.bool_), np.empty(shape, np.int32), np.empty(shape), np.empty(shape),
                        np.empty((*shape, 2)))
        _agree(*corners[3:], self._gloss, self._largest**2, *blocks)
        return blocks

    def _between(self, corners: Corners, film: NDArray, left: NDArray, hits: Hits, Od: NDArray, light: NDArray,
                 done: NDArray[np.bool_]) -> NDArray:
        """Fill light and done of the rows in `left` for which their block can be used; return the other rows."""
        m, rest = self._world.materials, np.empty(len(left), np.int64)
        count = _between(*corners[3:], *self._blocks(corners), *corners[:3], film, left, hits.P, hits.Ng, hits.Ns,
                         hits.material, self._world.surfaces.instance[hits.triangle], m.kd, self._share,
                         self._tint, m.nShiny, Od,
                         self._gloss, TOLERANCE * self.light, light, done, rest)
        return rest[:count]
