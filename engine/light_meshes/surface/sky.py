"""The world around a scene: the radiance that arrives from each direction where no surface is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..scene.description import Scene


class Sky:
    """The radiance of a scene's world by direction."""

    def __init__(self, scene: Scene) -> None:
        self._color = np.array(scene.world_color, np.float64)
        self.dark = not self._color.any()  # whether it gives no light at all

    def seen(self, direction: NDArray[np.float64]) -> NDArray[np.float64]:
        """The radiance (n,3) that rays of unit `direction` (n,3) see who miss all surfaces, as sharp as it is; one
        row (3,) where it is the same in all directions.
        """
        return self._color

    def light(self, direction: NDArray[np.float64]) -> NDArray[np.float64]:
        """The radiance (n,3), or one row (3,), that lights surfaces from unit `direction` (n,3).

        It may be smoother than `seen`, and is without the suns that became lamps of their own.
        """
        return self._color
