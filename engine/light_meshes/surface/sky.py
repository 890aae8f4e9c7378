"""The world around a scene: the radiance that arrives from each direction where no surface is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Camera, Light, Scene
from .points import LIGHTING, Points
from .profiles import Lookup
from .programs import run
from .sky_table import Table, tabulated
from .suns import suns
from .textures import Texture

BY_DIRECTION = {"position", "normal", "true_normal", "incoming", "window"}  # operations that differ by direction
# Texels along a side of the table: without images, or where only the mean is asked for; with images that have fewer or
# more than LARGE along theirs.
COARSE, FEW, MANY = 256, 512, 1024
LARGE = 2048


class Sky:
    """The radiance of a scene's world by direction."""

    def __init__(self, scene: Scene, textures: Sequence[Texture | None] = (), camera: Camera | None = None,
                 old: Sky | None = None, check: Callable[[], None] = lambda: None) -> None:
        """textures: of the scene's images. camera: of the picture; None: the scene's. old: that of the picture before,
        whose table is taken over where it is still right. check() raises to give up.
        """
        self._program, self._textures = scene.world, textures
        self._key = _key(scene, textures, camera or scene.camera)
        self.found: list[tuple[Light, float]] = []  # the suns, and the share of all the world's light that each has
        self._table: Table | None = None
        self._color = np.array(scene.world_color, np.float64)
        self.varies = bool(scene.world)  # whether `seen` depends on the direction, or on what looks
        if self.varies:
            self._around = _around(scene, camera or scene.camera)
            if old is not None and old._key == self._key:
                self.found, self._table, self._color = old.found, old._table, old._color
            else:
                self._prepare(scene, check)
        self.mean: NDArray[np.float64] = self._color  # (3,) of all the light, with the suns'
        self.dark = not (self._table.mean if self._table else self._color).any()  # whether `light` is 0

    def seen(self, direction: NDArray[np.float64], ray: NDArray[np.int8] | None = None) -> NDArray[np.float64]:
        """Return the radiance (n,3) that rays of unit `direction` (n,3) see who miss all surfaces, as sharp as it is;
        one row (3,) where it is the same in all directions.

        ray (n,): kinds of rays, as `points` has them; None: all are those that light surfaces.
        """
        if not self.varies:
            return self._color
        n = len(direction)
        away, none = -direction, np.zeros(n, np.int32)
        points = Points(direction, away, away, away, np.ones(n, np.bool_), np.zeros((n, 2)), none,
                        np.full(n, LIGHTING, np.int8) if ray is None else ray, self._around)
        return run(self._program, points, self._textures)["emission"]

    def light(self, direction: NDArray[np.float64],
              width: float | NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Return the radiance (n,3), or one row (3,), that lights surfaces from unit `direction` (n,3).

        It is the mean in a cone of the solid angle `width` (steradians; one for all, or (n,)), so that rays that share
        the sky among them gather all of it, without noise; None: as fine as the table is. It is without the suns that
        became lamps of their own (`suns`).
        """
        return self._table.look(direction, width) if self._table else self._color

    @property
    def constant(self) -> NDArray[np.float64] | None:
        """Return what `light` is (3,) where it is the same in all directions."""
        return None if self._table else self._color

    def alike(self, other: Sky) -> bool:
        """Return whether the same light comes from the same directions."""
        return self._key == other._key and bool((self._color == other._color).all())

    @property
    def suns(self) -> tuple[Light, ...]:
        """Return the lamps that stand for what is small and bright in the world, and is not in `light`."""
        return tuple(light for light, _ in self.found)

    def decisions(self) -> list[tuple[str, str, str]]:
        """Return the decisions about the world, with their reasons, for the plan."""
        if not self.varies:
            return []
        table = self._table
        rows = [("world", "by direction" if self._program.sees(*BY_DIRECTION) else "by kind of ray",
                 f"its light is looked up in {table.size} × {table.size} directions" if table else
                 "it lights by its mean")]
        if self.found:
            said = ", ".join(f"'{light.name}' {np.degrees(light.angle):.3g} degrees wide with {share:.1%}"
                             for light, share in self.found[:3])
            more = f" and {len(self.found) - 3} more" if len(self.found) > 3 else ""
            rows.append(("suns of the world", str(len(self.found)), f"{said} of its light{more}"))
        return rows

    def _prepare(self, scene: Scene, check: Callable[[], None]) -> None:
        """Make the table, and find the suns."""
        if not self._program.sees(*BY_DIRECTION):
            self._color = self.seen(np.array([[0.0, 0.0, 1.0]]))[0]
            return
        lights = scene.settings.by_sky
        if not lights and scene.settings.ambient == 0:
            self._color = np.zeros(3)
            return
        widest = max([t.width for i in self._program.images() if (t := self._textures[i])], default=0)
        size = MANY if widest > LARGE else FEW if widest else COARSE
        size = size if lights else COARSE
        samples = 4 if widest > 2 * LARGE else 3 if widest > LARGE // 2 and size == FEW else 2
        finest = tabulated(self.seen, size, samples, check)
        if lights:
            self.found = suns(finest, self.seen)
            self._table = Table(finest)
        # A lamp's intensity is what a white matt surface returns of it: the irradiance divided by π.
        self._color = finest.mean(0) + sum((np.array(light.intensity) / 4 for light in self.suns), np.zeros(3))


def _around(scene: Scene, camera: Camera) -> Any:
    """Return the profiles, and the camera's data that programs may ask about. What the camera sees are directions."""
    return SimpleNamespace(camera=camera, to_camera=np.linalg.inv(camera.matrix)[:3], eye=camera.matrix[:3, 3],
                           profiles=[Lookup(profile) for profile in scene.profiles])


def _key(scene: Scene, textures: Sequence[Texture | None], camera: Camera) -> tuple[Any, ...]:
    """Return everything on which the table depends."""
    s = scene.settings
    seen = (camera.matrix.tobytes(), camera.window, camera.perspective) if scene.world.sees_camera() else None
    images = [(t := textures[i]) and t.key for i in sorted(scene.world.images())]
    profiles = [scene.profiles[i] for i in sorted(scene.world.profiles())]
    return scene.world, images, profiles, seen, s.by_sky, s.ambient == 0
